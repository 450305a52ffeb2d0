"""Hard cases of uncertainty propagation: missing moments, no valid draws, singular covariances, extreme scales."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from scipy.special import ndtri

from tradestudy.errors import TradestudyError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.distributions import Empirical, Normal
from tradestudy.uncertainty.evaluation import CAUSES, Model, Outcome
from tradestudy.uncertainty.joint import JointNormal
from tradestudy.uncertainty.outputs import Propagated
from tradestudy.uncertainty.propagation import Sampling, linear, propagate
from tradestudy.uncertainty.sensitivity import sobol_indices
from tradestudy.uncertainty.sources import ErrorClass, Source, Sources
from tradestudy.verification.case import Family, Law, NumericCase, OutcomeCase, Stated

Response = Callable[[Mapping[str, FloatArray]], FloatArray]
"""Parameters of shape (draws, 1) → outputs (draws, 1)."""


_CONFIDENCE: Final = 6.0  # standard errors, from eight replicates
_YAW = {"distance": 10.0, "baseline": 0.1, "yaw": math.radians(0.2)}
_NAMES: Final = ("x", "y", "z")
# A few thousand draws show what breaks; the bound of a case is the error that so many draws leave.
_SAMPLING: Final = Sampling(absolute_tolerance=0.0, relative_tolerance=0.0, budget_draws=2**15, first_draws=2**12)
_SOBOL_DRAWS: Final = 2**9


def _model(response: Response) -> Model:
    return lambda values: Outcome(values=np.asarray(response(values)))


def _joint(names: tuple[str, ...], means: FloatArray, covariance: FloatArray) -> Sources:
    group = JointNormal(
        name="inputs", parameters=names, mean=means, covariance=covariance, error_class=ErrorClass.MEASUREMENT
    )
    return Sources(groups=(group,))


def _propagate(
    response: Response, names: tuple[str, ...], means: FloatArray, covariance: FloatArray, *, inverse_depth: bool
) -> tuple[Propagated, str]:
    propagated = propagate(
        _model(response),
        _joint(names, means, covariance),
        _SAMPLING,
        seed=0,
        point="hard case",
        inverse_depth=inverse_depth,
    )
    failures = ", ".join(
        f"{cause} {100.0 * share:g} %" for cause, share in zip(CAUSES, propagated.failed_fraction[:, 0], strict=True)
    )
    return propagated, f"status {propagated.status[0]}; failed draws: {failures}"


def _normal(name: str, deviation: float) -> Source:
    distribution = Normal(mean=0.0, standard_deviation=deviation)
    return Source(name=name, distribution=distribution, error_class=ErrorClass.MEASUREMENT)


def _sobol(response: Response, names: tuple[str, ...], deviations: FloatArray) -> tuple[FloatArray, str]:
    groups = tuple(_normal(name, float(deviation)) for name, deviation in zip(names, deviations, strict=True))
    indices = sobol_indices(
        _model(response), Sources(groups=groups), _SAMPLING, draws=_SOBOL_DRAWS, seed=0, point="hard case"
    )
    return indices.first[:, 0], indices.refused[0]


def _without_moments() -> tuple[NumericCase | OutcomeCase, ...]:
    """Stereo depth under a yaw error: its quantiles exist, its moments do not."""

    def model(distance: float, baseline: float) -> Response:
        return lambda values: 1.0 / distance + values["x"] / baseline

    def propagated(distance: float, baseline: float, yaw: float) -> tuple[Propagated, str]:
        return _propagate(model(distance, baseline), ("x",), np.zeros(1), np.array([[yaw**2]]), inverse_depth=True)

    def quantile(index: int) -> Callable[..., Stated]:
        def ours(distance: float, baseline: float, yaw: float) -> Stated:
            result = propagated(distance, baseline, yaw)[0]
            error = _CONFIDENCE * float(result.quantiles_error[index, 0])
            return Stated(value=float(result.quantiles[index, 0]), error=error)

        return ours

    def naive(probability: float) -> Callable[..., float]:
        return lambda distance, baseline, yaw: distance + float(ndtri(probability)) * distance**2 / baseline * yaw

    def naive_spread() -> str:
        depths = [1.0 / (0.1 + np.random.default_rng(seed).normal(0.0, _YAW["yaw"], 10_000) / 0.1) for seed in range(6)]
        spreads = [float(np.std(draws)) for draws in depths]
        return f"{min(spreads):.3g} to {max(spreads):.3g} m over six seeds"

    def our_spread() -> str:
        spread = float(propagated(**_YAW)[0].standard_deviation[0])
        return "not stated: it does not exist" if math.isnan(spread) else f"{spread:.3g} m"

    laws = (("2.5 %", 0, 0.025), ("50 %", 2, 0.5), ("97.5 %", 4, 0.975))
    return (
        *(
            NumericCase(
                name=f"{percent} quantile of a depth without moments",
                law=Law(
                    name=f"{percent} quantile of stereo depth",
                    naive=naive(probability),
                    ours=quantile(index),
                    magnified=False,
                ),
                inputs=_YAW,
            )
            for percent, index, probability in laws
        ),
        OutcomeCase(
            name="standard deviation of a depth without moments",
            law="none is stated where none exists",
            naive=naive_spread,
            ours=our_spread,
            expected=("not stated",),
        ),
    )


def _weighted(*, monte_carlo: bool) -> tuple[Callable[..., float], Callable[..., Stated]]:
    """Half width of a weighted sum of normal variables: by a Cholesky factor, and as this program propagates it."""

    def naive(weights: tuple[float, ...], covariance: FloatArray) -> float:
        return float(np.linalg.norm(np.linalg.cholesky(covariance).T @ np.array(weights)))

    def ours(weights: tuple[float, ...], covariance: FloatArray) -> Stated:
        names, means = _NAMES[: len(weights)], np.zeros(len(weights))

        def model(values: Mapping[str, FloatArray]) -> FloatArray:
            return np.asarray(sum(w * values[name] for w, name in zip(weights, names, strict=True)))

        if not monte_carlo:
            exact = linear(_model(model), _joint(names, means, covariance))
            return Stated(value=float(exact.standard_uncertainty[0]), error=math.nan)
        result = _propagate(model, names, means, covariance, inverse_depth=False)[0]
        error = _CONFIDENCE * float(result.half_width_error[0])
        return Stated(value=float(result.half_width[0]), error=error)

    return naive, ours


def _singular() -> tuple[NumericCase, ...]:
    """Correlations of ±1, and a covariance that is singular up to rounding."""
    plus, minus = ({"xx": 0.01, "xy": sign * 0.01, "yy": 0.01} for sign in (1.0, -1.0))
    dependent = {"xx": 0.01, "xy": 0.003, "yy": 0.09}
    tiers = ((False, "linear"), (True, "Monte Carlo"))

    def law(name: str, weights: tuple[float, ...], *, monte_carlo: bool, rank: str) -> Law:
        naive, ours = _weighted(monte_carlo=monte_carlo)
        build = _pair if rank == "pair" else _sum_as_third
        return Law(
            name=name,
            naive=lambda **values: naive(weights, build(**values)),
            ours=lambda **values: ours(weights, build(**values)),
            magnified=False,
        )

    return tuple(
        NumericCase(
            name=f"{case}, {tier}",
            law=law(name, weights, monte_carlo=sampled, rank=rank),
            inputs=values,
        )
        for sampled, tier in tiers
        for case, name, weights, rank, values in (
            ("x − y at correlation +1", "u(x − y), error relative to u(x)", (1.0, -1.0), "pair", plus),
            ("x + y at correlation −1", "u(x + y), error relative to u(x)", (1.0, 1.0), "pair", minus),
            ("x + y at correlation +1", "u(x + y)", (1.0, 1.0), "pair", plus),
            ("x + y + z with z = x + y", "u(x + y + z)", (1.0, 1.0, 1.0), "three", dependent),
            ("x + y − z with z = x + y", "u(x + y − z), error relative to u(x)", (1.0, 1.0, -1.0), "three", dependent),
        )
    )


def _pair(xx: float, xy: float, yy: float) -> FloatArray:
    return np.array([[xx, xy], [xy, yy]])


def _sum_as_third(xx: float, xy: float, yy: float) -> FloatArray:
    """Covariance of x, y and x + y: its rank is two, and rounding makes its smallest eigenvalue negative."""
    return np.array([[xx, xy, xx + xy], [xy, yy, xy + yy], [xx + xy, xy + yy, xx + 2.0 * xy + yy]])


def _scales() -> tuple[OutcomeCase, ...]:
    """Outputs whose squares underflow or overflow in double precision."""

    def naive(scale: float) -> Callable[[], str]:
        draws = np.random.default_rng(0).normal(0.0, 1.0, 1000) * scale
        return lambda: f"standard deviation {np.std(draws):.3g}"

    def ours(scale: float) -> Callable[[], str]:
        def answer() -> str:
            result = _propagate(
                lambda values: scale * values["x"], ("x",), np.zeros(1), np.ones((1, 1)), inverse_depth=False
            )[0]
            return f"half width {float(result.half_width[0]):.3g} ± {float(result.half_width_error[0]):.3g}"

        return lambda: _answer(answer)

    def of_input(scale: float) -> Callable[[], str]:
        def answer() -> str:
            sources = Sources(groups=(_normal("x", scale),))
            result = linear(_model(lambda values: values["x"]), sources)
            return f"standard uncertainty {float(result.standard_uncertainty[0]):g}"

        return lambda: _answer(answer)

    words, of_one = ("outputs", "allowed", "unit"), ("standard deviation of x", "allowed", "unit")
    return (
        OutcomeCase(
            name="outputs of 1e-300",
            law="refused: the squares of deviations are zero",
            naive=naive(1e-300),
            ours=ours(1e-300),
            expected=words,
        ),
        OutcomeCase(
            name="outputs of 1e300",
            law="refused: the squares of deviations are infinite",
            naive=naive(1e300),
            ours=ours(1e300),
            expected=words,
        ),
        OutcomeCase(
            name="a standard deviation of 1e-300",
            law="refused: its variance is zero",
            naive=lambda: f"standard uncertainty {np.sqrt(np.float64(1e-300) ** 2):g}",
            ours=of_input(1e-300),
            expected=of_one,
        ),
        OutcomeCase(
            name="a standard deviation of 1e300",
            law="refused: its variance is infinite",
            naive=lambda: f"standard uncertainty {np.sqrt(np.float64(1e300) ** 2):g}",
            ours=of_input(1e300),
            expected=of_one,
        ),
    )


def _failing() -> tuple[OutcomeCase, ...]:
    """Only failed draws, a single draw, and Sobol indices of outputs that include NaN."""

    def naive_sobol() -> str:
        from scipy.stats import norm, sobol_indices

        def model(x: FloatArray) -> FloatArray:
            return np.where(x[0] > 2.5, np.nan, x[0] + 2.0 * x[1])

        normal: Any = norm()  # the stubs of scipy know too few distributions
        indices = sobol_indices(func=model, n=1024, dists=[normal, normal], rng=np.random.default_rng(0))
        return f"first-order indices {np.array2string(indices.first_order, precision=3)}"

    def our_sobol() -> str:
        first, refused = _sobol(
            lambda values: np.where(values["x"] > 2.5, np.nan, values["x"] + 2.0 * values["y"]), ("x", "y"), np.ones(2)
        )
        return f"indices {first.ravel()}, {refused}"

    return (
        OutcomeCase(
            name="every draw fails",
            law="no quantile is stated, and failures are counted by cause",
            naive=lambda: _quietly(lambda: f"mean {np.nanmean(np.full(100, np.nan))}"),
            ours=lambda: _propagate(
                lambda values: np.full_like(values["x"], np.nan),
                ("x",),
                np.zeros(1),
                np.ones((1, 1)),
                inverse_depth=False,
            )[1],
            expected=("status unranked", "nonfinite 100 %"),
        ),
        OutcomeCase(
            name="one draw",
            law="one value does not make a distribution",
            naive=lambda: _quietly(lambda: f"standard deviation {np.std([1.0], ddof=1)}"),
            ours=lambda: _answer(lambda: str(Empirical(draws=np.array([1.0])))),
            expected=("empirical draws", "at least two"),
        ),
        OutcomeCase(
            name="Sobol indices with an output that is not a number",
            law="indices are refused, and the fraction that is not finite is stated",
            naive=lambda: _quietly(naive_sobol),
            ours=our_sobol,
            expected=("nan", "not finite"),
        ),
    )


def _degenerate() -> tuple[OutcomeCase, ...]:
    """An output without variance, and an ensemble of walkers stuck in its own mode."""

    def naive_constant() -> str:
        outputs = np.full(1000, 3.0)
        return f"index {np.float64(np.var(outputs)) / np.var(outputs)}"

    def constant() -> str:
        first, refused = _sobol(lambda values: 3.0 + 0.0 * values["x"], ("x",), np.ones(1))
        return f"indices {first.ravel()}, {refused}"

    def chains() -> FloatArray:
        """Four ensembles of normal walkers, one of them stuck ten standard deviations away, in its own mode."""
        drawn = np.random.default_rng(0).standard_normal((4, 2000, 10, 1))
        drawn[1] += 10.0
        return drawn

    def stuck() -> str:
        from tradestudy.calibration.sampling import diagnose

        diagnostics = diagnose(chains(), np.full(4, 0.3), ("p0",))
        return f"not converged: {'; '.join(diagnostics.failures)}; stuck ensembles: {list(diagnostics.stuck_ensembles)}"

    return (
        OutcomeCase(
            name="an output without variance",
            law="without variance there are no shares of it",
            naive=naive_constant,
            ours=constant,
            expected=("nan", "does not vary"),
        ),
        OutcomeCase(
            name="an ensemble of walkers in a mode of its own",
            law="not converged, and the ensemble is named",
            naive=lambda: f"mean {float(np.mean(chains())):.3g}, from {chains().size} draws",
            ours=stuck,
            expected=("not converged", "ensembles disagree", "stuck ensembles: [1]"),
        ),
    )


def _quietly(ask: Callable[[], str]) -> str:
    """The answer, with the many warnings of the textbook method silenced."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ask()


def _answer(ask: Callable[[], str]) -> str:
    """The answer, or the message of its refusal."""
    try:
        return ask()
    except TradestudyError as error:
        return f"refused: {error}"


PROPAGATION: Final = Family(
    name="propagation",
    title="Propagation of uncertainty",
    cases=(*_without_moments(), *_singular(), *_scales(), *_failing(), *_degenerate()),
)
