"""What half-widths of depth are held against: two codes of their own, by integration and by many draws.

Written apart from everything that is measured. By integration the strongest normal error is solved for, by Newton's
method along its own axis, and the others are integrated by Gauss rules that are refined one by one until none of them
changes the result; by draws the points are scipy's own scrambled Sobol sequence, unaligned, and the quantiles are
numpy's over all draws of a scramble.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.polynomial.hermite_e import hermegauss
from numpy.polynomial.legendre import leggauss
from scipy.special import erfc, ndtri

from tradestudy.cameras.calibration import ONE_SIGMA
from tradestudy.cost.measuring import REFERENCE_SEED, Allowance
from tradestudy.errors import NotConvergedError, UnaffordableError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.distributions import Normal, Uniform
from tradestudy.uncertainty.evaluation import Model, ranked
from tradestudy.uncertainty.sources import Source, Sources
from tradestudy.units import significant


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthCase:
    """One camera whose depth is asked for.

    Parameters
    ----------
    name, title
        Its key in the study, from which draws take their seed, and its name in words.
    model, sources
        Its exact model of inverse depth, and what is uncertain.
    distance
        Where it is asked for [m].
    """

    name: str
    title: str
    model: Model
    sources: Sources
    distance: FloatArray


ENDS: Final = ((1.0 - ONE_SIGMA) / 2.0, (1.0 + ONE_SIGMA) / 2.0)
"""Probabilities of the ends of the interval whose half-width is asked for."""
SUPERSCRIPTS: Final = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
_SCRAMBLES: Final = 8
_MOST_DRAWS, _FEWEST_DRAWS = 2**20, 2**15
_PILOT_DRAWS: Final = 2**10
_RANKED: Final = 4.0  # times the models' own seconds, of draws with their points and quantiles
_INTEGRATED: Final = 20.0  # times the seconds of the fewest draws, of integration
_BATCH: Final = 2**13
_RULES: Final = (3, 5, 9, 17, 33, 65, 129)  # nodes in one dimension
_MOST_NODES: Final = 2**15
_SMALLEST_CHANGE: Final = 1e-10  # of a half-width, below which a rule is fine enough
_LARGEST_ERROR: Final = 1e-6  # of a half-width, above which draws are tried as well
_ROUNDED: Final = 16.0 * np.finfo(float).eps  # of an inverse depth, by the models' rounding
_STEP: Final = 1e-3  # deviations, of difference quotients
_REACH, _FAR = 12.0, 8.5  # deviations to either side; beyond the second ones there is nothing that a double could hold
_LEAST: Final = 1e-3  # of the inverse depth: as good as infinitely far
_NOWHERE: Final = np.zeros((1, 1))
_MOST_STEPS: Final = 100
_MOST_APART: Final = 6.0  # standard errors of the draws that integration may be away from them


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthReference:
    """Half-widths [m] at all places of all cases, NaN where the interval has no far end, and what they are.

    ``relative_error`` is the worst of all places, NaN where there is none.
    """

    half_width: FloatArray
    relative_error: float
    seconds: float
    words: str


def reference_of(
    cases: Sequence[DepthCase], allowance: Allowance, most_draws: int, alive: Callable[[], None] = lambda: None
) -> DepthReference:
    """The more exact one of integration, where the errors are few and independent, and of many draws.

    Integration is believed only where it agrees with draws to six of their standard errors.

    Parameters
    ----------
    cases
        Cameras with their errors.
    allowance
        Time for the draws, of which there are more as long as it allows twice as many.
    most_draws
        Of what is measured; there are at most eight times as many.
    alive
        Called again and again, for progress.

    Raises
    ------
    UnaffordableError
        Where the time does not allow the fewest draws. Where it does not allow integration, draws are the reference.
    """
    begin = time.perf_counter()
    predicted = _predicted_seconds(cases)
    if not allowance.allows(predicted):
        raise UnaffordableError(
            "time for a reference",
            value=f"about {significant(predicted, 2)} s",
            limit=f"{significant(max(allowance.left, 0.0), 2)} s are left for it",
            remedy="a larger --budget measures it",
        )
    drawn = _scrambles(cases, _FEWEST_DRAWS, alive)
    integrated = _integrated(cases, alive) if allowance.allows(_INTEGRATED * drawn[1]) else None
    if integrated is not None:
        value, error = integrated
        apart = _apart(drawn[0], value)
        if apart <= _MOST_APART and error <= _LARGEST_ERROR:
            return DepthReference(
                half_width=value,
                relative_error=error,
                seconds=time.perf_counter() - begin,
                words="integration over all errors through the exact models by a code of its own, its error the change "
                f"by finer rules; {_power(_FEWEST_DRAWS)} scrambled Sobol draws agree with it to {apart:.1f} of their "
                "standard errors",
            )
    return _by_draws(cases, drawn, allowance, most_draws, alive)


def _predicted_seconds(cases: Sequence[DepthCase]) -> float:
    """Of the fewest draws, by a few at the middle of all errors."""
    taken = []
    for case in cases:
        middle = case.sources.draw(np.zeros((case.sources.dimensions, _PILOT_DRAWS)))
        begin = time.perf_counter()
        case.model(middle)
        taken.append(time.perf_counter() - begin)
    return _RANKED * sum(taken) * _FEWEST_DRAWS / _PILOT_DRAWS


def _power(draws: int) -> str:
    return f"2{str(draws.bit_length() - 1).translate(SUPERSCRIPTS)}"


def _apart(scrambles: FloatArray, value: FloatArray) -> float:
    """Standard errors between the mean of the scrambles and other values, the most of all places where both exist."""
    mean = scrambles.mean(axis=0)
    error = scrambles.std(axis=0, ddof=1) / math.sqrt(_SCRAMBLES)
    both = np.isfinite(mean) & np.isfinite(value)
    return float(np.max(np.abs(mean - value)[both] / error[both], initial=0.0))


def _by_draws(
    cases: Sequence[DepthCase],
    drawn: tuple[FloatArray, float],
    allowance: Allowance,
    most_draws: int,
    alive: Callable[[], None],
) -> DepthReference:
    draws = _FEWEST_DRAWS
    while draws < min(_MOST_DRAWS, 8 * most_draws) and allowance.allows(2.5 * drawn[1]):
        draws *= 2
        drawn = _scrambles(cases, draws, alive)
    widths = np.where(np.isfinite(drawn[0]).all(axis=0), drawn[0], np.nan)
    mean = widths.mean(axis=0)
    errors = widths.std(axis=0, ddof=1) / math.sqrt(_SCRAMBLES) / mean
    return DepthReference(
        half_width=mean,
        relative_error=math.nan if np.isnan(errors).all() else float(np.nanmax(errors)),
        seconds=drawn[1],
        words=f"{_power(draws)} scrambled Sobol draws in {_SCRAMBLES} scrambles of a seed of their own through the "
        "exact models, quantiles by a code of their own",
    )


def _scrambles(cases: Sequence[DepthCase], draws: int, alive: Callable[[], None]) -> tuple[FloatArray, float]:
    """Half-widths of every scramble, shape (scrambles, places), and the seconds they took."""
    from scipy.stats.qmc import Sobol

    begin = time.perf_counter()
    rows = []
    for scramble in range(_SCRAMBLES):
        alive()
        parts = []
        for number, case in enumerate(cases):
            rng = np.random.default_rng((REFERENCE_SEED, scramble, number))
            engine = Sobol(case.sources.dimensions, scramble=True, bits=52, rng=rng)
            depths = []
            for _ in range(max(1, draws // _SCRAMBLES // _BATCH)):
                uniform = engine.random(min(_BATCH, draws // _SCRAMBLES)).T + 2.0**-53
                found = case.model(case.sources.draw(ndtri(uniform)))
                depths.append(ranked(found, inverse_depth=True, draws=uniform.shape[1])[0])
            with np.errstate(invalid="ignore"):  # between two infinite depths: NaN, no far end
                low, high = np.quantile(np.concatenate(depths, axis=1), ENDS, axis=1, method="hazen")
            parts.append((high - low) / 2.0)
        rows.append(np.concatenate(parts))
    return np.stack(rows), time.perf_counter() - begin


def _integrated(cases: Sequence[DepthCase], alive: Callable[[], None]) -> tuple[FloatArray, float] | None:
    """Half-widths by integration and their worst relative error; None where a case cannot be integrated."""
    values, errors = [], []
    for case in cases:
        integral = _integral(case)
        alive()
        try:
            value, error = (None, None) if integral is None else _refined(integral)
        except NotConvergedError:
            return None
        if value is None or error is None:
            return None
        values.append(value)
        errors.append(error)
    worst = np.concatenate(errors)
    return np.concatenate(values), math.nan if np.isnan(worst).all() else float(np.nanmax(worst))


def _refined(integral: _Integral) -> tuple[FloatArray, FloatArray]:
    """Half-widths, and the sum of the changes by the next finer rule of each error and of what rounding does."""
    rule = dict.fromkeys(integral.others, 0)
    value = integral.half_width(rule)
    error = 1e-12 + _ROUNDED * integral.case.distance / value
    for name in integral.others:
        change = np.zeros_like(value)
        while rule[name] + 1 < len(_RULES):
            finer = {**rule, name: rule[name] + 1}
            if math.prod(_RULES[order] for order in finer.values()) > _MOST_NODES:
                break
            found = integral.half_width(finer)
            change = np.abs(found / value - 1.0)
            if np.nanmax(change, initial=0.0) <= _SMALLEST_CHANGE:
                break
            rule, value = finer, found
        error = error + change
    return value, error


@dataclass(frozen=True, kw_only=True, eq=False)
class _Integral:
    """A case whose errors are independent normal and uniform ones; ``solved`` is the normal one that moves it most.

    Every error is its middle and its scale times a score, uniform scores within ±1; inverse depth rises with the score
    of the one that is solved for.
    """

    case: DepthCase
    solved: str
    others: tuple[str, ...]
    normal: frozenset[str]
    middle: dict[str, float]
    scale: dict[str, float]

    def half_width(self, rule: dict[str, int]) -> FloatArray:
        """With so fine a rule for every other error; NaN where the interval has no far end."""
        scores: dict[str, FloatArray] = {}
        weight = np.ones(1)
        for name in self.others:
            node, share = (hermegauss if name in self.normal else leggauss)(_RULES[rule[name]])
            scores = {other: np.repeat(score, node.size) for other, score in scores.items()}
            scores[name] = np.tile(node, weight.size)
            weight = np.repeat(weight, node.size) * np.tile(share / share.sum(), weight.size)
        moved = {name: self.middle[name] + self.scale[name] * score[:, None] for name, score in scores.items()}
        nearer, farther = (self._inverse_end(moved, weight, probability) for probability in ENDS)
        return np.asarray((1.0 / farther - 1.0 / nearer) / 2.0)

    def _inverse_depth(self, moved: dict[str, FloatArray], score: FloatArray) -> FloatArray:
        values = {**moved, self.solved: self.middle[self.solved] + self.scale[self.solved] * score}
        return np.asarray(self.case.model(values).values)

    def _inverse_end(self, moved: dict[str, FloatArray], weight: FloatArray, probability: float) -> FloatArray:
        """Inverse depth that so large a share of all is above, by Newton's method with its density; NaN for none."""
        middle = self._inverse_depth({name: np.full((1, 1), self.middle[name]) for name in self.others}, _NOWHERE)[0]
        least = _LEAST * middle
        bounded = self._above(moved, weight, least)[0] > probability
        target = middle
        for _ in range(_MOST_STEPS):
            share, density = self._above(moved, weight, target)
            step = (share - probability) / density
            # The median is where density is greatest: a first step from there that is too long is cut.
            new = np.where(bounded, np.maximum(target + step, (target + least) / 2.0), middle)
            done = bool(np.all(np.abs(new - target) <= 1e-13 * middle))
            target = new
            if done:
                return np.where(bounded, target, np.nan)
        raise NotConvergedError("quantiles of depth by integration", value=f"{_MOST_STEPS} steps")

    def _above(self, moved: dict[str, FloatArray], weight: FloatArray, target: FloatArray) -> tuple[FloatArray, ...]:
        """Share of inverse depths above a target, and its density there, each of shape (places,)."""
        score, slope = self._crossing(moved, target)
        below = weight @ (np.exp(-(score**2) / 2.0) / slope) / math.sqrt(2.0 * math.pi)
        return weight @ (erfc(score / math.sqrt(2.0)) / 2.0), below

    def _crossing(self, moved: dict[str, FloatArray], target: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Scores at which inverse depth is the target, and its slope there, each of shape (nodes, places).

        Newton's method between a score that is too small and one that is too large, which are halved where it leaves
        them or inverse depth stands still, at and beyond infinity.
        """
        score = np.zeros((len(next(iter(moved.values()))) if moved else 1, target.size))
        low, high = np.full(score.shape, -_REACH), np.full(score.shape, _REACH)
        for _ in range(_MOST_STEPS):
            value = self._inverse_depth(moved, score)
            ahead, behind = (self._inverse_depth(moved, score + sign * _STEP) for sign in (1.0, -1.0))
            slope = (ahead - behind) / (2.0 * _STEP)
            stands = (behind <= 0.0) | (slope <= 0.0)
            slope = np.where(stands, np.inf, slope)
            low, high = np.where(value < target, score, low), np.where(value < target, high, score)
            new = score + (target - value) / slope
            new = np.where(stands | (new < low) | (new > high), (low + high) / 2.0, new)
            step, score = np.abs(new - score), new
            settled = (step <= 1e-12 + _ROUNDED * target / slope) | (high < -_FAR) | (low > _FAR)
            if np.all(settled):
                return score, slope
        raise NotConvergedError("place where depth is a given one", value=f"{_MOST_STEPS} steps of Newton's method")


def _integral(case: DepthCase) -> _Integral | None:
    """The case for integration; None for errors that are of other kinds or too many, or no normal one that acts."""
    laws = {group.name: group.distribution for group in case.sources.active_groups if isinstance(group, Source)}
    simple = all(isinstance(law, Normal | Uniform) for law in laws.values())
    if len(laws) < len(case.sources.groups) or not simple or _RULES[0] ** (len(laws) - 1) > _MOST_NODES:
        return None
    middle = {name: float(law.mean or 0.0) for name, law in laws.items()}
    scale = {
        name: (law.high - law.low) / 2.0 if isinstance(law, Uniform) else float(law.standard_deviation or 0.0)
        for name, law in laws.items()
    }

    def effect(name: str) -> FloatArray:
        ends = []
        for sign in (1.0, -1.0):
            at = {other: np.full((1, 1), middle[other] + sign * scale[other] * (other == name)) for other in laws}
            ends.append(np.asarray(case.model(at).values)[0])
        return np.asarray(ends[0] - ends[1])

    effects = {name: effect(name) for name, law in laws.items() if isinstance(law, Normal)}
    solved = max(effects, key=lambda name: float(np.min(np.abs(effects[name]))), default="")
    if not solved or not np.all(effects[solved] * np.sign(effects[solved][0]) > 0.0):
        return None
    scale[solved] *= float(np.sign(effects[solved][0]))
    return _Integral(
        case=case,
        solved=solved,
        others=tuple(name for name in laws if name != solved and scale[name] > 0.0),
        normal=frozenset(effects),
        middle=middle,
        scale=scale,
    )
