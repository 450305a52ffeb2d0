"""Propagation of declared distributions through any function, to intervals of any coverage."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.evaluation import Model, Replicate, alignment_with
from tradestudy.uncertainty.inputs import Correlation, sources_of
from tradestudy.uncertainty.outputs import order_quantile
from tradestudy.wording import few

if TYPE_CHECKING:
    from tradestudy.uncertainty.inputs import Covariance, Inputs

_REPLICATES: Final = 16
_FIRST_DRAWS: Final = 2**10
_BATCH: Final = 2**14
_CONFIDENCE: Final = 0.975
# Draws of each replicate expected beyond an end. Of independent draws, the bias of the mean of 16 sample quantiles is
# then at most two thirds of its standard error in a normal tail; of Sobol points, less.
_BEYOND: Final = 10
_ROUNDING: Final = 1e-14
_MAGNITUDES: Final = (1e-140, 1e140)  # a double can represent their squares, summed over any number of draws

Function = Callable[..., ArrayLike]


@dataclass(frozen=True, kw_only=True, eq=False)
class Spread:
    """Result of `propagate_through`: the distribution of the function's output.

    Arrays have the unit of the output. In their shapes, m is the number of intervals, and … stands for the shape of the
    output for one draw.

    Parameters
    ----------
    coverage
        Probability of each of the m intervals.
    median
        Median, shape (…).
    standard_deviation
        Standard deviation of the outputs, shape (…). If the standard deviation of the distribution is infinite or
        undefined, this value grows with the number of draws.
    low
        Lower ends of the intervals, shape (m, …). An interval is central: values below and above it are equally
        probable.
    high
        Upper ends of the intervals, shape (m, …).
    error
        For each interval, the greater of the standard errors of its two ends, estimated from the scatter between
        independent replicates; shape (m, …). If the output takes discrete values and an end lies where one value gives
        way to the next, the step between these values is included. Where inputs are given as draws, the error does
        not allow for the draws being only a sample.
    draws
        Total number of draws.
    converged
        Whether every end of every interval is known to within the tolerance, at 95 % confidence.
    values
        Outputs for all draws, shape (…, draws).
    """

    coverage: tuple[float, ...]
    median: FloatArray
    standard_deviation: FloatArray
    low: FloatArray
    high: FloatArray
    error: FloatArray
    draws: int
    converged: bool
    values: FloatArray = field(repr=False)

    @property
    def half_width(self) -> FloatArray:
        """Half the width of each interval, shape (m, …)."""
        return np.asarray(0.5 * (self.high - self.low))


def propagate_through(
    function: Function,
    inputs: Inputs,
    *,
    correlation: Correlation | None = None,
    covariance: Covariance | None = None,
    coverage: float | Sequence[float] = (0.6827, 0.95),
    tolerance: float = 0.01,
    most_draws: int = 2**22,
    seed: int = 0,
) -> Spread:
    """Propagate the distributions of inputs through a function by the Monte Carlo method (JCGM 101:2008).

    The draws are scrambled Sobol points in 16 independent replicates; the scatter between the replicates gives the
    errors of the intervals. In the first round, about 10 or more draws of each replicate lie beyond either end of every
    interval. The number of draws is then doubled until every end is known to within the tolerance at 95 % confidence,
    or until another doubling would exceed ``most_draws``.

    Parameters
    ----------
    function
        Function that takes each input as a keyword argument, an array of shape (draws,), and returns an array of real
        numbers, of shape (draws,) or (draws, …). Inputs without names are passed by position.
    inputs
        The distributions of at least one input, in one of these forms:

        * by the names of the function's arguments, such as ``{"gap": Uniform(low=-0.03, high=0.03)}``. Frozen
          distributions of scipy.stats can be given too, such as ``{"gap": scipy.stats.norm(0.0, 0.03)}``. A tuple of
          names stands for inputs with a joint distribution: ``{("block", "gap"): draws}``;
        * without names, in the order of the function's arguments: a sequence of distributions, such as
          ``[Normal(25.0, 0.01), scipy.stats.norm(0.0, 0.03)]``;
        * as joint draws: a DataFrame with a column for each argument, or a matrix of shape (draws, inputs), with at
          least two rows and as many rows as columns. Every row is equally probable and is used as a whole, which
          keeps all dependences between its values;
        * as ``scipy.stats.multivariate_normal(mean, cov)``;
        * as numbers, by name or in order: the means of inputs with the given ``covariance``.
    correlation
        Correlations of pairs of inputs, such as ``{("block", "gap"): 0.5}``; all other pairs are uncorrelated. Inputs
        that are not normal are joined by a Gaussian copula; the correlations are then those of the standard normal
        variables from which it generates the inputs. Inputs whose joint distribution is given cannot have others.
    covariance
        Covariance of the inputs that are given as numbers, which are then jointly normal: a DataFrame whose rows and
        columns have the names of these inputs, or a matrix in the order of the inputs if all are numbers.
    coverage
        Probability of the interval that is reported, between 0 and 1; or one probability for each of several intervals.
    tolerance
        Largest error of each end of an interval at 95 % confidence, as a fraction of half the width of the interval,
        between 0 and 1. (The attribute ``error`` of the result is a standard error, and thus smaller.)
    most_draws
        Largest number of draws. It must be at least 16384, and more for coverages above about 98 %.
    seed
        Seed of the draws, ≥ 0: the same call gives the same digits.

    Returns
    -------
    Spread
        Median, standard deviation and intervals, with the errors of the intervals. ``converged`` says whether the
        tolerance was reached.

    Raises
    ------
    OutOfRangeError
        An argument has the wrong type or a number is outside its range; ``most_draws`` is too small for the coverage; a
        correlation names an unknown or constant input, or contradicts another; a covariance names an input that is not
        given as a number; no joint distribution has these correlations; or the function returns an array of the wrong
        shape, no values, values that are not finite real numbers, or values so large or small that a double cannot
        represent their squares.

    Examples
    --------
    The sum of two lengths, and half the width of the interval that contains it with a probability of 99 %:

    >>> from tradestudy.uncertainty import Normal, Uniform, propagate_through
    >>> found = propagate_through(
    ...     lambda block, gap: block + gap,
    ...     {"block": Normal(mean=25.0, standard_deviation=0.01), "gap": Uniform(low=-0.03, high=0.03)},
    ...     coverage=[0.99],
    ... )
    >>> print(f"{found.median:.2f} ± {found.half_width[0]:.3f}, each end with an error of {found.error[0]:.1g}")
    25.00 ± 0.045, each end with an error of 0.0001
    >>> found.converged
    True
    """
    if isinstance(coverage, str):
        raise OutOfRangeError("a coverage", value=repr(coverage), limit="a number between 0 and 1")
    try:
        levels = np.atleast_1d(np.asarray(coverage, dtype=np.float64))
    except (TypeError, ValueError):
        raise OutOfRangeError("a coverage", value=repr(coverage), limit="between 0 and 1") from None
    _require(levels, tolerance, most_draws, seed)
    draws = _first_draws(levels, most_draws)
    sources, by_position = sources_of(inputs, covariance=covariance, correlation=correlation)
    if by_position:
        function = _by_name(function)
    nominal = {name: value.ravel() for name, value in sources.nominal().items()}
    # One call at the nominal values finds the shape of the output, and arguments that do not fit, before any draw.
    try:
        shape = _real_numbers(function(**nominal)).shape[1:]
    except TypeError as refused:
        kind = "position" if by_position else "name"
        refused.add_note(f"The function receives the inputs {few(list(nominal))} by {kind}, each as an array of draws.")
        raise
    if 0 in shape:
        raise OutOfRangeError(
            "the function returned no values",
            value=f"shape (draws, {', '.join(map(str, shape))})",
            limit="at least one",
        )
    model = _model(function, shape)
    alignment = alignment_with([model], sources)
    replicates = [
        Replicate(
            model, sources, seed=seed, point="function", replicate=number,
            alignment=alignment, inverse_depth=False,
        )
        for number in range(_REPLICATES)
    ]  # fmt: skip
    # The median comes first and is only reported; the criterion below uses the ends of the intervals.
    probabilities = np.concatenate([[0.5], 0.5 * (1.0 - levels), 0.5 * (1.0 + levels)])
    while True:
        for replicate in replicates:
            replicate.lengthen(draws, _BATCH)
        sorted_values = [np.sort(replicate.values, axis=-1) for replicate in replicates]
        _require_squares(sorted_values)
        quantiles = np.stack([order_quantile(ascending, probabilities) for ascending in sorted_values])
        mean = quantiles.mean(axis=0)
        steps = np.mean([_steps(ascending, probabilities) for ascending in sorted_values], axis=0)
        error = np.hypot(quantiles.std(axis=0, ddof=1) / math.sqrt(_REPLICATES), 0.5 * steps)
        (low, high), ends = np.split(mean[1:], 2), np.maximum(*np.split(error[1:], 2))
        # An interval without width, as of a constant output, has no relative tolerance: its ends differ by rounding.
        rounding = _ROUNDING * np.maximum(np.abs(low), np.abs(high))
        precise = float(stdtrit(_REPLICATES - 1, _CONFIDENCE)) * ends <= tolerance * 0.5 * (high - low) + rounding
        if precise.all() or 2 * draws * _REPLICATES > most_draws:
            break
        draws *= 2
    values = np.concatenate([replicate.values for replicate in replicates], axis=1)
    return Spread(
        coverage=tuple(levels.tolist()),
        median=mean[0].reshape(shape),
        standard_deviation=values.std(axis=1, ddof=1).reshape(shape),
        low=low.reshape(-1, *shape),
        high=high.reshape(-1, *shape),
        error=ends.reshape(-1, *shape),
        draws=draws * _REPLICATES,
        converged=bool(precise.all()),
        values=values.reshape(*shape, -1),
    )


def _require(coverage: FloatArray, tolerance: float, most_draws: int, seed: int) -> None:
    for what, value, kind, limit in (
        ("the tolerance", tolerance, numbers.Real, "a number between 0 and 1"),
        ("the number of draws", most_draws, numbers.Integral, "a whole number"),
        ("the seed", seed, numbers.Integral, "a whole number"),
    ):
        if not isinstance(value, kind):
            raise OutOfRangeError(what, value=repr(value), limit=limit)
    between = coverage.ndim == 1 and coverage.size > 0 and bool(np.all((coverage > 0.0) & (coverage < 1.0)))
    limits: list[tuple[str, bool, Any, str]] = [
        ("a coverage", between, coverage.tolist(), "between 0 and 1"),
        ("the tolerance", 0.0 < tolerance < 1.0, tolerance, "between 0 and 1"),
        ("the number of draws", most_draws >= _REPLICATES * _FIRST_DRAWS, most_draws,
         f"at least {_REPLICATES * _FIRST_DRAWS}"),
        ("the seed", seed >= 0, seed, "0 or more"),
    ]  # fmt: skip
    for what, fine, value, limit in limits:
        if not fine:
            raise OutOfRangeError(what, value=str(value), limit=limit)


def _first_draws(coverage: FloatArray, most_draws: int) -> int:
    """Draws of a replicate that leave enough of them beyond every end, a power of two."""
    tail = 0.5 * (1.0 - float(coverage.max()))
    draws = max(_FIRST_DRAWS, 1 << math.ceil(math.log2(_BEYOND / tail)))
    if draws * _REPLICATES > most_draws:
        raise OutOfRangeError(
            f"the number of draws for a coverage of {coverage.max():.10g}",
            value=str(most_draws),
            limit=f"at least {draws * _REPLICATES}",
            remedy="raise most_draws or lower the coverage, so that draws fall beyond the ends of the interval",
        )
    return draws


def _real_numbers(returned: ArrayLike) -> FloatArray:
    """What the function returned, refused unless it is an array of real numbers, none masked or with a unit."""
    held = getattr(returned, "data", returned) if hasattr(returned, "attrs") else returned  # xarray may hold a quantity
    if hasattr(held, "magnitude") or hasattr(held, "unit"):  # of pint and astropy
        raise OutOfRangeError(
            "the function returned a quantity",
            value=f"{held!r:.60}",
            limit="numbers without unit",
            remedy="return its numbers in the unit that the results shall have, such as found.to('mm').magnitude",
        )
    try:
        array = np.asarray(returned)
    except ValueError:  # rows of unequal length
        array = np.asarray(None)
    real = array.dtype.kind in "buif"
    if not real or (isinstance(returned, np.ma.MaskedArray) and returned.mask.any()):
        raise OutOfRangeError(
            "the function returned values that are not real numbers",
            value="masked values" if real else f"an array of type {array.dtype}",
            limit="real numbers",
            remedy="return the real part and the imaginary part separately, and no masked values",
        )
    return array.astype(np.float64, copy=False)


def _require_squares(ascending: Sequence[FloatArray]) -> None:
    """Refuse outputs so small that their standard deviation would be zero."""
    size = np.max([np.abs(values[:, [0, -1]]) for values in ascending], axis=(0, 2))
    if np.any(beyond := (size > 0.0) & (size < _MAGNITUDES[0])):
        raise _without_squares(size[beyond][0])


def _without_squares(size: float) -> OutOfRangeError:
    return OutOfRangeError(
        "the function returned values whose squares a double cannot represent",
        value=f"up to {size:.3g}",
        limit=f"magnitudes from {_MAGNITUDES[0]:g} to {_MAGNITUDES[1]:g}, or 0",
        remedy="return them in another unit",
    )


def _steps(ascending: FloatArray, probabilities: FloatArray) -> FloatArray:
    """Step at the edge of a discrete value around each quantile, else 0; shape (probabilities, outputs).

    There, all replicates may err alike, which their scatter does not show. Draws of equal value give it away.
    """
    count = ascending.shape[-1]
    # Two order statistics on either side of the quantile: in a continuous output, no two of the four are equal.
    low = np.clip((probabilities * count - 0.5).astype(np.int64) - 1, 0, count - 4)
    around = np.diff(ascending[..., low[:, None] + np.arange(4)], axis=-1)
    return np.moveaxis(np.where(around.min(axis=-1) == 0.0, around.max(axis=-1), 0.0), -1, 0)


def _by_name(function: Function) -> Function:
    """The function with arguments whose names are ignored."""
    return lambda **values: function(*values.values())


def _model(function: Function, shape: tuple[int, ...]) -> Model:
    def model(values: Mapping[str, FloatArray]) -> FloatArray:
        draws = max(column.size for column in values.values())
        arguments = {name: np.broadcast_to(column.ravel(), (draws,)) for name, column in values.items()}
        outputs = _real_numbers(function(**arguments))
        if outputs.shape != (draws, *shape):
            raise OutOfRangeError(
                "the function returned an array of the wrong shape",
                value=str(outputs.shape),
                limit=str((draws, *shape)),
                remedy="compute one value, or one array, for every draw",
            )
        if not np.isfinite(outputs).all():
            raise OutOfRangeError(
                "the function returned non-finite values",
                value=f"{np.sum(~np.isfinite(outputs))} of {outputs.size}",
                remedy="limit the distributions to inputs for which the function is defined",
            )
        if (largest := np.abs(outputs).max()) > _MAGNITUDES[1]:
            raise _without_squares(largest)
        return outputs.reshape(draws, -1)

    return model
