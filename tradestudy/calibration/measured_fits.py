"""What measured depth errors imply: exponent, disparity noise, floor, offset, scale, and sub-pixel locking.

Every fit scales its errors by the scatter of the points about it, and states 95 % intervals by Student's t, so that few
points give wide intervals. Points count as independent.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray

CONFIDENCE: Final = 0.95
MEAN_OF_NORMAL: Final = math.sqrt(2.0 / math.pi)
"""Mean absolute value of a normal error without bias, relative to its standard deviation: 0.798."""
SAMPLES: Final = 2.0  # per period of sub-pixel locking, below which it cannot be seen
_FEWEST_OF_RIPPLE, _FEWEST_PERIODS = 8, 2.0
_SCALES: Final = (0.75, 4.0 / 3.0)  # of the declared disparity, among which the period is sought
_TRIES: Final = 20  # scales tried in the width of one peak
_PEAKS: Final = 4  # independent scales in the width of one peak, with two harmonics and a fold
_SIGNIFICANT: Final = 0.01  # largest probability that scatter alone would look like a ripple
_STEPS: Final = 200
_SMALLEST_VARIANCE: Final = 1e-9  # of the largest measured one


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """A fitted value with its standard error and the ends of its 95 % interval; NaN where it cannot be fitted."""

    value: float = math.nan
    error: float = math.nan
    low: float = math.nan
    high: float = math.nan

    def excludes(self, value: float, within: float = 0.0) -> bool:
        """Whether the interval is known and contains no value that differs by less than a fraction of it."""
        return value + abs(value) * within < self.low or value - abs(value) * within > self.high

    def times(self, factor: float) -> Fitted:
        """The value in another unit, of either sign."""
        ends = sorted((self.low * factor, self.high * factor))
        return Fitted(value=self.value * factor, error=self.error * abs(factor), low=ends[0], high=ends[1])


UNKNOWN: Final = Fitted()


def _interval(value: float, error: float, free: int) -> Fitted:
    from scipy.stats import t

    half = float(t.ppf(0.5 + CONFIDENCE / 2.0, free)) * error
    return Fitted(value=value, error=error, low=value - half, high=value + half)


def _least_squares(columns: FloatArray, values: FloatArray, deviation: FloatArray) -> tuple[Fitted, ...]:
    """Weighted linear least squares; ``deviation`` gives the relative size of each point's error."""
    free = values.size - columns.shape[1]
    unknown = tuple(UNKNOWN for _ in range(columns.shape[1]))
    if free < 1:
        return unknown
    a, y = columns / deviation[:, None], values / deviation
    size = np.linalg.norm(a, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    a = a / size  # columns may have different units
    solution, _, rank, _ = np.linalg.lstsq(a, y, rcond=None)
    if rank < columns.shape[1]:
        return unknown
    variance = np.sum((y - a @ solution) ** 2) / free
    errors = np.linalg.norm(np.linalg.inv(np.linalg.qr(a, mode="r")), axis=1) * math.sqrt(variance)
    return tuple(
        _interval(float(value), float(error), free) for value, error in zip(solution / size, errors / size, strict=True)
    )


def exponent(distance: FloatArray, deviation: FloatArray) -> Fitted:
    """The exponent p of ``deviation = k Z^p`` by least squares of logarithms.

    Parameters
    ----------
    distance, deviation : arrays (N,)
        Distances and depth errors, positive, in any unit.
    """
    columns = np.column_stack([np.log(distance), np.ones_like(distance)])
    return _least_squares(columns, np.log(deviation), np.ones_like(distance))[0]


def noise_and_floor(deviation: FloatArray, px_per_m: FloatArray) -> tuple[Fitted, Fitted]:
    """Disparity noise s [px] and depth floor u [m] of ``σ² = (s/g)² + u²``, with the change g of disparity with depth.

    Each σ² is a mean of squares, with the same relative error in all points; the fit maximises its gamma likelihood by
    iterated least squares. An interval that begins at 0 means that the points show no such part. The floor needs
    distances over which g varies.

    Parameters
    ----------
    deviation : array (N,)
        Standard deviations, or root-mean-square errors, of depth [m], positive.
    px_per_m : array (N,)
        Magnitude g of the change of disparity with depth [px/m].
    """
    squares = deviation**2
    columns = np.column_stack([px_per_m**-2.0, np.ones_like(px_per_m)])
    weights = squares
    smallest = _SMALLEST_VARIANCE * squares
    fitted: tuple[Fitted, ...] = (UNKNOWN, UNKNOWN)
    for _ in range(_STEPS):
        fitted = _least_squares(columns, squares, weights)
        predicted = np.maximum(columns @ [part.value for part in fitted], smallest)
        if np.allclose(predicted, weights, rtol=1e-10) or not np.isfinite(predicted).all():
            break
        weights = predicted
    return _root(fitted[0]), _root(fitted[1])


def _root(square: Fitted) -> Fitted:
    """The root of a fitted square; 0 where the square is negative."""
    value, low, high = (math.sqrt(max(end, 0.0)) for end in (square.value, square.low, square.high))
    if math.isnan(square.value):
        return UNKNOWN
    return Fitted(value=value, error=square.error / (2.0 * value) if value else high, low=low, high=high)


def disparity_errors(bias: FloatArray, deviation: FloatArray, distance: FloatArray, px_per_m: FloatArray) -> FloatArray:
    """Mean disparity errors [px] behind mean depth errors b [m]: ``e = −g b' Z/(Z + b')``, ``b' = b − σ²/Z``.

    Exact for disparities that are linear in 1/Z. The second term is the shift of the mean of depths that is due to
    their own noise σ [m], to second order; it is small where σ is below a tenth of the distance Z.
    """
    shifted = bias - deviation**2 / distance
    return np.asarray(-px_per_m * shifted * distance / (distance + shifted))


def offset_and_scale(
    errors_px: FloatArray, disparity_px: FloatArray, deviation: FloatArray, px_per_m: FloatArray | None = None
) -> tuple[Fitted, Fitted, Fitted]:
    """Offset o [px], relative scale s and zero shift z [m] of ``e = o + s d − g z``.

    The offset is a relative rotation of the cameras; the scale is the error of focal length times baseline; the shift
    is that of the point from which the tape measures. Without ``px_per_m``, the shift is known to be zero.

    Parameters
    ----------
    errors_px, disparity_px : arrays (N,)
        Mean errors of disparity, and disparities relative to infinity [px].
    deviation : array (N,)
        Relative sizes of the errors of ``errors_px``.
    px_per_m : array (N,), optional
        Magnitude g of the change of disparity with depth [px/m].
    """
    columns = [np.ones_like(disparity_px), disparity_px, *([] if px_per_m is None else [-px_per_m])]
    offset, scale, *shift = _least_squares(np.column_stack(columns), errors_px, deviation)
    return offset, scale, shift[0] if shift else UNKNOWN


@dataclass(frozen=True, kw_only=True)
class Ripple:
    """Sub-pixel locking: ``b + A sin(2π k d + φ)``, or its magnitude.

    Parameters
    ----------
    scale
        k: true disparity over the declared one.
    amplitude, mean
        A and b [px].
    phase
        φ [rad], for A > 0.
    share
        Share of the variance of the points that it explains.
    probability
        Probability that independent scatter explains as much at any scale that was tried.
    points
        Number of points used.
    reason
        Why there is no fit; empty if there is one.
    """

    scale: Fitted = UNKNOWN
    amplitude: Fitted = UNKNOWN
    mean: Fitted = UNKNOWN
    phase: float = math.nan
    share: float = math.nan
    probability: float = math.nan
    points: int = 0
    reason: str = ""

    @property
    def found(self) -> bool:
        """Whether scatter alone hardly explains the ripple."""
        return self.probability < _SIGNIFICANT

    def at(self, disparity_px: FloatArray) -> FloatArray:
        """``b + A sin(2π k d + φ)`` [px] at declared disparities d [px]."""
        return np.asarray(
            self.mean.value + self.amplitude.value * np.sin(2.0 * np.pi * self.scale.value * disparity_px + self.phase)
        )


def ripple(errors_px: FloatArray, disparity_px: FloatArray, *, signed: bool) -> Ripple:
    """Fit sub-pixel locking to disparity errors [px] at declared disparities [px].

    The fit uses the longest run of points with two samples per period of one pixel, and scales of the declared
    disparity from 3/4 to 4/3. The largest peak among two harmonics is the start of least squares. Standard errors are
    enlarged by ``√((1 + ρ)/(1 − ρ))`` for residuals whose neighbours have a correlation ρ above 0.

    Parameters
    ----------
    errors_px, disparity_px : arrays (N,)
        Disparity errors, and disparities relative to infinity.
    signed
        Whether the errors are means with their sign; else they are magnitudes, of which |b + A sin(…)| is fitted.
    """
    order = np.argsort(disparity_px, kind="stable")
    d, e = disparity_px[order], errors_px[order]
    run = _sampled(d)
    d, e = d[run], e[run]
    if d.size < _FEWEST_OF_RIPPLE or np.ptp(d) < _FEWEST_PERIODS:
        reason = (
            f"the table has two samples per period of one pixel for {max(d.size, 1)} points over "
            f"{np.ptp(d) if d.size else 0.0:.2g} periods; {_FEWEST_OF_RIPPLE} points over {_FEWEST_PERIODS:g} periods "
            "are needed"
        )
        return Ripple(points=d.size, reason=reason)
    low, high = _SCALES
    tries = np.linspace(low, high, 1 + math.ceil((high - low) * float(np.ptp(d)) * _TRIES))
    start = float(tries[np.argmin([_left_by_harmonics(e, d, scale) for scale in tries])])
    return _refined(e, d, start, signed=signed, tried=1.0 + _PEAKS * (high - low) * float(np.ptp(d)))


def _sampled(disparity: FloatArray) -> slice:
    """The longest run of increasing disparities [px] without a gap above half a period."""
    ends = [0, *(np.flatnonzero(np.diff(disparity) > 1.0 / SAMPLES) + 1).tolist(), disparity.size]
    first, last = max(itertools.pairwise(ends), key=lambda run: run[1] - run[0])
    return slice(first, last)


def _left_by_harmonics(errors: FloatArray, disparity: FloatArray, scale: float) -> float:
    """The sum of squares that a mean and two harmonics leave; a fold at zero gives the second one."""
    x = 2.0 * np.pi * scale * disparity
    columns = np.column_stack([np.ones_like(x), np.cos(x), np.sin(x), np.cos(2.0 * x), np.sin(2.0 * x)])
    coefficients = np.linalg.lstsq(columns, errors, rcond=None)[0]
    return float(np.sum((errors - columns @ coefficients) ** 2))


def _refined(errors: FloatArray, disparity: FloatArray, start: float, *, signed: bool, tried: float) -> Ripple:
    from scipy.optimize import least_squares
    from scipy.stats import f as f_distribution

    def residuals(values: FloatArray) -> FloatArray:
        mean, amplitude, phase, scale = values
        wave = mean + amplitude * np.sin(2.0 * np.pi * scale * disparity + phase)
        return np.asarray((wave if signed else np.abs(wave)) - errors)

    size, level = float(np.std(errors)) * math.sqrt(2.0), float(np.mean(errors))
    means = (level,) if signed else (level, level / 2.0, 0.0)
    starts = [(mean, size, phase, start) for mean in means for phase in np.arange(8) * np.pi / 4.0]
    # Least squares ends in the nearest minimum: eight phases are tried and, for magnitudes, a mean below their average.
    best = min((least_squares(residuals, values) for values in starts), key=lambda fit: float(fit.cost))
    free, remaining, total = errors.size - 4, 2.0 * float(best.cost), float(np.sum((errors - level) ** 2))
    ratio = (total - remaining) / 3.0 / (remaining / free) if remaining > 0.0 else math.inf
    pairs = float(best.fun[1:] @ best.fun[:-1]) / remaining if remaining > 0.0 else 0.0
    wider = math.sqrt((1.0 + max(pairs, 0.0)) / (1.0 - max(pairs, 0.0)))
    try:
        jacobian = np.asarray(best.jac)
        deviations = wider * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)) * remaining / free)
    except np.linalg.LinAlgError:
        raise OutOfRangeError(
            "sub-pixel locking cannot be fitted",
            value=f"{errors.size} equal disparity errors",
            limit="errors that vary",
            remedy="check the column of errors",
        ) from None
    mean, amplitude, _, scale = (
        _interval(float(value), float(error), free) for value, error in zip(best.x, deviations, strict=True)
    )
    turned = np.sign(amplitude.value) or 1.0  # b − A sin x is b + A sin(x + π)
    phase = float(best.x[2]) + (0.0 if turned > 0.0 else np.pi)
    if not signed and mean.value < 0.0:  # and |b + A sin x| is |−b + A sin(x + π)|
        mean, phase = mean.times(-1.0), phase + np.pi
    return Ripple(
        scale=scale,
        amplitude=amplitude.times(turned),
        mean=mean,
        phase=phase % (2.0 * np.pi),
        share=1.0 - remaining / total,
        probability=min(1.0, tried * float(f_distribution.sf(ratio, 3, free))),
        points=errors.size,
    )
