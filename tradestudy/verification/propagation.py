"""Hard cases of uncertainty propagation: missing moments, no valid draws, singular covariances, extreme scales."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from scipy.special import ndtr, ndtri

from tradestudy.errors import TradestudyError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.any_function import Spread, propagate_through
from tradestudy.uncertainty.distributions import Empirical, Normal
from tradestudy.uncertainty.evaluation import Model
from tradestudy.uncertainty.sensitivity import sobol_indices
from tradestudy.uncertainty.sources import ErrorClass, Source, Sources
from tradestudy.verification.case import Family, Law, NumericCase, OutcomeCase, Stated

_CONFIDENCE: Final = 6.0  # standard errors, from sixteen replicates
_YAW = {"distance": 10.0, "baseline": 0.1, "yaw": math.radians(0.2)}
_STANDARD_NORMAL: Final = Normal(mean=0.0, standard_deviation=1.0)
_ONE_SIGMA: Final = float(2.0 * ndtr(1.0) - 1.0)  # coverage
_SOBOL_DRAWS: Final = 2**9


def _normal(name: str, deviation: float) -> Source:
    distribution = Normal(mean=0.0, standard_deviation=deviation)
    return Source(name=name, distribution=distribution, error_class=ErrorClass.MEASUREMENT)


def _sobol(model: Model, deviations: Mapping[str, float]) -> str:
    groups = tuple(_normal(name, deviation) for name, deviation in deviations.items())
    found = sobol_indices(model, Sources(groups=groups), draws=_SOBOL_DRAWS, seed=0, point="hard case")
    return f"indices {found.first[:, 0]}, {found.refused[0]}"


def _without_moments() -> tuple[NumericCase, ...]:
    """Stereo depth under a yaw error: its quantiles exist, its moments do not."""

    def inverse_depth(distance: float, baseline: float, yaw: float) -> Spread:
        """Finite where depth is infinite; one is the reciprocal of the other."""
        return propagate_through(
            lambda turned: 1.0 / distance + turned / baseline,
            {"turned": Normal(mean=0.0, standard_deviation=yaw)},
            coverage=0.95,
            tolerance=1e-3,
        )

    def quantile(of: Callable[[Spread], float]) -> Callable[..., Stated]:
        def ours(distance: float, baseline: float, yaw: float) -> Stated:
            found = inverse_depth(distance, baseline, yaw)
            depth = 1.0 / of(found)
            # The error of the less certain end of the interval; the median, where more draws fall, has a smaller one.
            return Stated(value=depth, error=_CONFIDENCE * float(found.error[0]) * depth**2)

        return ours

    def naive(probability: float) -> Callable[..., float]:
        return lambda distance, baseline, yaw: distance + float(ndtri(probability)) * distance**2 / baseline * yaw

    laws: tuple[tuple[str, float, Callable[[Spread], float]], ...] = (
        ("2.5 %", 0.025, lambda found: float(found.high[0])),
        ("50 %", 0.5, lambda found: float(found.median)),
        ("97.5 %", 0.975, lambda found: float(found.low[0])),
    )
    return tuple(
        NumericCase(
            name=f"{percent} quantile of a depth without moments",
            law=Law(
                name=f"{percent} quantile of stereo depth",
                naive=naive(probability),
                ours=quantile(of),
                magnified=False,
            ),
            inputs=_YAW,
        )
        for percent, probability, of in laws
    )


def _weighted(weights: tuple[float, ...], covariance: FloatArray) -> float:
    """Standard deviation of a weighted sum of normal variables, by a Cholesky factor."""
    return float(np.linalg.norm(np.linalg.cholesky(covariance).T @ np.array(weights)))


def _weighted_by_draws(weights: tuple[float, ...], covariance: FloatArray) -> Stated:
    """Half width of the central 68.27 % interval of the weighted sum."""
    found = propagate_through(
        lambda *values: np.asarray(sum(weight * value for weight, value in zip(weights, values, strict=True))),
        [0.0] * len(weights),
        covariance=covariance,
        coverage=_ONE_SIGMA,
        tolerance=1e-3,
        most_draws=2**18,
    )
    return Stated(value=float(found.half_width[0]), error=_CONFIDENCE * float(found.error[0]))


def _singular() -> tuple[NumericCase, ...]:
    """Correlations of ±1, and a covariance that is singular up to rounding."""
    plus, minus = ({"xx": 0.01, "xy": sign * 0.01, "yy": 0.01} for sign in (1.0, -1.0))
    dependent = {"xx": 0.01, "xy": 0.003, "yy": 0.09}

    def law(name: str, weights: tuple[float, ...]) -> Law:
        build = _pair if len(weights) == 2 else _sum_as_third
        return Law(
            name=name,
            naive=lambda **values: _weighted(weights, build(**values)),
            ours=lambda **values: _weighted_by_draws(weights, build(**values)),
            magnified=False,
        )

    return tuple(
        NumericCase(name=f"{case}, Monte Carlo", law=law(name, weights), inputs=values)
        for case, name, weights, values in (
            ("x − y at correlation +1", "u(x − y), error relative to u(x)", (1.0, -1.0), plus),
            ("x + y at correlation −1", "u(x + y), error relative to u(x)", (1.0, 1.0), minus),
            ("x + y at correlation +1", "u(x + y)", (1.0, 1.0), plus),
            ("x + y + z with z = x + y", "u(x + y + z)", (1.0, 1.0, 1.0), dependent),
            ("x + y − z with z = x + y", "u(x + y − z), error relative to u(x)", (1.0, 1.0, -1.0), dependent),
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
            found = propagate_through(lambda x: scale * x, {"x": _STANDARD_NORMAL})
            return f"standard deviation {float(found.standard_deviation):.3g}"

        return lambda: _answer(answer)

    def of_input(scale: float) -> Callable[[], str]:
        return lambda: _answer(lambda: _sobol(lambda values: values["x"], {"x": scale}))

    words, of_one = ("squares", "allowed", "unit"), ("standard deviation of x", "allowed", "unit")
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
        return _sobol(
            lambda values: np.where(values["x"] > 2.5, np.nan, values["x"] + 2.0 * values["y"]), {"x": 1.0, "y": 1.0}
        )

    def our_failures() -> str:
        found = propagate_through(lambda x: np.full_like(x, np.nan), {"x": _STANDARD_NORMAL})
        return f"median {float(found.median):.3g}"

    return (
        OutcomeCase(
            name="every draw fails",
            law="refused, and the failed draws are counted",
            naive=lambda: _quietly(lambda: f"mean {np.nanmean(np.full(100, np.nan))}"),
            ours=lambda: _answer(our_failures),
            expected=("refused", "non-finite values", "1024 of 1024"),
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
        return _sobol(lambda values: 3.0 + 0.0 * values["x"], {"x": 1.0})

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
