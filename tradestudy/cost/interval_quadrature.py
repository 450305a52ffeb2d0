"""Intervals of depth without drawing: what moves depth most is solved for, everything else is integrated.

Along the direction in which inverse depth changes most steeply the share of depths below one is a normal integral
up to the place where the model crosses it. Across that direction depth changes to second order alone, so that this
place hardly moves and a few Gauss nodes to a dimension integrate it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import ndtr, ndtri, roots_hermitenorm, roots_legendre

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.distributions import Normal, Uniform
from tradestudy.uncertainty.evaluation import Model
from tradestudy.uncertainty.sources import Source, Sources

_MOST_NODES: Final = 2**16
_REACH, _FAR = 12.0, 8.5  # deviations to either side; beyond the second ones there is nothing that a double could hold
_STEP: Final = 1e-3  # deviations, of difference quotients
_MOST_STEPS: Final = 80
_ROUNDED: Final = 16.0 * np.finfo(float).eps  # of an inverse depth, by the models' rounding
_SHARES: Final = (1e-300, 1.0 - 1e-16)


def half_width_by_quadrature(model: Model, sources: Sources, interval: tuple[float, float], nodes: int) -> FloatArray:
    """Half the interval between two quantiles of depth, by quadrature over all errors.

    Parameters
    ----------
    model
        Of inverse depth [1/m], without refusals of its own; it takes values of shape (nodes, places).
    sources
        What is uncertain: independent normal and uniform errors.
    interval
        Probabilities of the nearer and the farther end.
    nodes
        Of every dimension that is integrated; 1 leaves all but the steepest direction at its middle.

    Returns
    -------
    array, shape (places,)
        Half-widths [m]; infinite where the interval has no far end.

    Raises
    ------
    OutOfRangeError
        Where the errors are of another kind, none that is normal moves depth, or the nodes are too many.
    """
    problem = _problem(model, sources)
    if nodes**problem.transverse > _MOST_NODES:
        raise OutOfRangeError(
            "nodes of a quadrature over all errors",
            value=f"{nodes} in each of {problem.transverse} dimensions",
            limit=f"{_MOST_NODES} altogether",
            remedy="draw instead",
        )
    offset, weight = _rule(problem, nodes)
    near, far = (1.0 / _quantile(problem, offset, weight, probability) for probability in interval)
    unbounded = np.isnan(far)
    return np.asarray(np.where(unbounded, np.inf, (far - near) / 2.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Problem:
    """A model of inverse depth over standard scores, its steepest direction among the normal ones for every place.

    ``basis`` has shape (places, normal, normal), the steepest ascent of inverse depth as its first column; values of
    a parameter are ``centre + scale × score``, uniform scores within ±1.
    """

    model: Model
    normal: tuple[str, ...]
    uniform: tuple[str, ...]
    centre: dict[str, float]
    scale: dict[str, float]
    basis: FloatArray
    slope: FloatArray
    nominal: FloatArray

    @property
    def transverse(self) -> int:
        """Dimensions that are integrated."""
        return len(self.normal) - 1 + len(self.uniform)

    def inverse_depth(self, offset: dict[str, FloatArray], along: FloatArray) -> FloatArray:
        """Of all nodes, shape (nodes, places), so far along the steepest direction."""
        moved = {
            name: offset[name] + self.scale[name] * self.basis[:, row, 0] * along
            for row, name in enumerate(self.normal)
        }
        return np.asarray(self.model({**offset, **moved}).values, dtype=np.float64)


def _problem(model: Model, sources: Sources) -> _Problem:
    laws = {group.name: group.distribution for group in sources.active_groups if isinstance(group, Source)}
    normal = {name: law for name, law in laws.items() if isinstance(law, Normal)}
    uniform = {name: law for name, law in laws.items() if isinstance(law, Uniform)}
    if other := [group.name for group in sources.groups if group.name not in {**normal, **uniform}]:
        raise OutOfRangeError(
            "errors of a quadrature", value=", ".join(other), limit="independent, normal or uniform", remedy="draw them"
        )
    nominal = np.asarray(model(sources.nominal()).values)[0]
    centre = {name: law.mean for name, law in normal.items()} | {name: law.mean for name, law in uniform.items()}
    scale = {name: law.standard_deviation for name, law in normal.items()}
    scale |= {name: (law.high - law.low) / 2.0 for name, law in uniform.items()}
    steps = np.concatenate([np.eye(len(normal)), -np.eye(len(normal))], axis=1) * _STEP
    around = {name: np.full((2 * len(normal), 1), value) for name, value in centre.items()}
    around |= {name: centre[name] + scale[name] * steps[row][:, None] for row, name in enumerate(normal)}
    above, below = np.split(np.asarray(model(around).values), 2)
    gradient = np.asarray((above - below) / (2.0 * _STEP)).T  # (places, normal)
    slope = np.linalg.norm(gradient, axis=1)
    if not np.all(slope > 0.0):
        raise OutOfRangeError("effect of the normal errors on depth", value="none", limit="some", remedy="draw instead")
    return _Problem(
        model=model,
        normal=tuple(normal),
        uniform=tuple(uniform),
        centre=centre,
        scale=scale,
        basis=_orthonormal(gradient / slope[:, None]),
        slope=slope,
        nominal=nominal,
    )


def _orthonormal(first: FloatArray) -> FloatArray:
    """Orthonormal bases, shape (places, n, n), whose first columns these unit vectors are: Householder reflections."""
    sign = np.where(first[:, :1] >= 0.0, 1.0, -1.0)
    normal = first.copy()
    normal[:, :1] += sign
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    basis = np.eye(first.shape[1]) - 2.0 * normal[:, :, None] * normal[:, None, :]
    basis[:, :, 0] = first  # the reflection's is its opposite for positive first components
    return basis


def _rule(problem: _Problem, nodes: int) -> tuple[dict[str, FloatArray], FloatArray]:
    """What every parameter is beside the steepest direction, shape (nodes, places or 1), and the nodes' weights."""
    beside = len(problem.normal) - 1
    rules = [
        *(roots_hermitenorm(nodes) for _ in problem.normal[1:]),
        *(roots_legendre(nodes) for _ in problem.uniform),
    ]
    which = np.indices((nodes,) * len(rules)).reshape(len(rules), nodes ** len(rules))
    across = np.array([place[node] for (place, _), node in zip(rules, which, strict=True)]).reshape(which.shape)
    weight = np.ones(which.shape[1])
    for (_, one), places in zip(rules, which, strict=True):
        weight *= one[places] / one.sum()
    offset = {}
    for row, name in enumerate(problem.normal):
        scores = np.einsum("dn,pd->np", across[:beside], problem.basis[:, row, 1:])
        offset[name] = problem.centre[name] + problem.scale[name] * scores.reshape(weight.size, -1)
    for row, name in enumerate(problem.uniform, start=beside):
        offset[name] = problem.centre[name] + problem.scale[name] * across[row][:, None]
    return offset, weight


def _quantile(problem: _Problem, offset: dict[str, FloatArray], weight: FloatArray, probability: float) -> FloatArray:
    """Inverse depth that a share ``probability`` of all lies above; NaN where less than that is above zero.

    A secant in the normal score of the share, which is linear in inverse depth where the model is.
    """
    least = 1e-9 * problem.nominal
    wanted = float(ndtri(probability))

    def score(target: FloatArray, within: float = 1e-13) -> FloatArray:
        share = np.einsum("n,np->p", weight, ndtr(-_crossing(problem, offset, target, within)))
        return np.asarray(ndtri(np.clip(share, _SHARES[0], _SHARES[1])))  # the weights sum to 1 but for rounding

    bounded = score(least, 1e-2) > wanted
    target = np.maximum(problem.nominal - wanted * problem.slope, least)
    miss = score(target) - wanted
    slope = -1.0 / problem.slope
    for _ in range(_MOST_STEPS):
        moved = np.maximum(target - miss / slope, least)
        change = moved - target
        if np.all(np.abs(change[bounded]) <= 1e-13 * target[bounded]):
            return np.where(bounded, moved, np.nan)
        found = score(moved) - wanted
        with np.errstate(invalid="ignore", divide="ignore"):  # one that stands keeps its slope
            secant = (found - miss) / change
        slope = np.where(np.isfinite(secant) & (secant < 0.0), secant, slope)
        target, miss = moved, found
    return np.where(bounded, target, np.nan)


def _crossing(problem: _Problem, offset: dict[str, FloatArray], target: FloatArray, within: float) -> FloatArray:
    """How far along the steepest direction inverse depth crosses a target, shape (nodes, places); ±12 for never.

    Secants within a bracket, which is halved where one leaves it.
    """
    shape = (len(next(iter(offset.values()))), target.size)
    low, high = np.full(shape, -_REACH), np.full(shape, _REACH)
    slope = np.broadcast_to(problem.slope, shape)
    last = np.zeros(shape)
    value = problem.inverse_depth(offset, last) - target
    place = np.clip(last - value / slope, -_REACH, _REACH)
    for _ in range(_MOST_STEPS):
        found = problem.inverse_depth(offset, place) - target
        low, high = np.where(found < 0.0, place, low), np.where(found >= 0.0, place, high)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # one that stands keeps its slope
            secant = (found - value) / (place - last)
            slope = np.where(np.isfinite(secant) & (secant > 0.0), secant, slope)
            new = place - found / slope
        new = np.where((new >= low) & (new <= high), new, (low + high) / 2.0)
        last, value, place = place, found, new
        settled = np.abs(place - last) <= within + _ROUNDED * target / problem.slope
        if np.all(settled | (high < -_FAR) | (low > _FAR)):
            break
    return place
