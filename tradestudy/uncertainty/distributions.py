"""Distributions of single errors: quantile function, mean and standard deviation where they exist.

All sampling goes through the quantile function, which preserves the evenness of quasi-random points. scipy is imported
inside functions, so that checking a study does not load it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.errors import OutOfRangeError

FloatArray = NDArray[np.float64]


def at_scores(distribution: Distribution, scores: FloatArray) -> FloatArray:
    """Map standard normal scores z to draws: x = Q(Φ(z)), directly for a normal distribution.

    Φ rounds to 1 above 8.2 standard deviations; it is clipped to the last double below 1, which keeps unbounded
    distributions finite.
    """
    if isinstance(distribution, Normal):
        return np.asarray(distribution.mean + distribution.standard_deviation * scores)
    from scipy.special import ndtr

    probability = np.clip(ndtr(scores), np.finfo(float).tiny, 1.0 - np.finfo(float).epsneg)
    return distribution.quantile(probability)


def _require_finite(what: str, *values: float) -> None:
    if unfit := [value for value in values if isinstance(value, str) or hasattr(value, "units")]:
        remedy = "convert it to the unit in which the function computes"
        raise OutOfRangeError(
            f"a parameter of {what}", value=repr(unfit[0]), limit="a number without unit", remedy=remedy
        )
    if not all(math.isfinite(value) for value in values):
        raise OutOfRangeError(
            f"{what} has a non-finite parameter",
            value=", ".join(f"{value:g}" for value in values),
            limit="finite numbers",
            remedy="correct the study, or omit the source",
        )


def _require_not_negative(what: str, value: float) -> None:
    if value < 0.0:
        raise OutOfRangeError(what, value=f"{value:g}", limit=">= 0", remedy="give its magnitude")


def _require_ordered(what: str, *values: float) -> None:
    _require_finite(what, *values)
    if any(later < earlier for earlier, later in pairwise(values)):
        raise OutOfRangeError(
            f"{what} needs its limits in increasing order",
            value=", ".join(f"{value:g}" for value in values),
            limit="low <= ... <= high",
            remedy="swap them",
        )


@dataclass(frozen=True)
class Normal:
    """Normal distribution.

    Parameters
    ----------
    mean : float
        Mean [unit of the quantity].
    standard_deviation : float
        Standard deviation [unit of the quantity], ≥ 0. If it is zero, the quantity is constant.

    Raises
    ------
    OutOfRangeError
        A parameter is not finite, or the standard deviation is negative.
    """

    mean: float
    standard_deviation: float

    def __post_init__(self) -> None:
        _require_finite("a normal distribution", self.mean, self.standard_deviation)
        _require_not_negative("the standard deviation of a normal distribution", self.standard_deviation)

    def quantile(self, probability: ArrayLike) -> FloatArray:
        """Return the quantiles at probabilities from 0 to 1 [unit of the quantity], in the shape of the argument.

        They are −∞ at 0 and +∞ at 1, or the mean everywhere if the standard deviation is 0.
        """
        from scipy.special import ndtri

        return _scaled(self.mean, self.standard_deviation, ndtri(np.asarray(probability, float)))


def _scaled(location: float, scale: float, standard: FloatArray) -> FloatArray:
    """Quantiles of a distribution from those of the standard one, which may be infinite although the scale is 0."""
    return np.asarray(location + scale * standard if scale > 0.0 else np.full_like(standard, location))


@dataclass(frozen=True, kw_only=True)
class _Limited:
    """A distribution that is symmetric between two limits."""

    low: float
    high: float

    @property
    def mean(self) -> float:
        """The middle between the limits."""
        return 0.5 * (self.low + self.high)


@dataclass(frozen=True, kw_only=True)
class Uniform(_Limited):
    """Uniform (rectangular) distribution between two limits.

    Parameters
    ----------
    low : float
        Lower limit [unit of the quantity].
    high : float
        Upper limit [unit of the quantity], at least ``low``.

    Raises
    ------
    OutOfRangeError
        A limit is not finite, or ``low`` exceeds ``high``.
    """

    def __post_init__(self) -> None:
        _require_ordered("a uniform distribution", self.low, self.high)

    @property
    def standard_deviation(self) -> float:
        """(high − low)/√12."""
        return (self.high - self.low) / math.sqrt(12.0)

    def quantile(self, probability: ArrayLike) -> FloatArray:
        """Return the quantiles at probabilities from 0 to 1 [unit of the quantity], in the shape of the argument."""
        return np.asarray(self.low + (self.high - self.low) * np.asarray(probability, float))


@dataclass(frozen=True, kw_only=True)
class Triangular:
    """Triangular distribution between two limits, with its peak at ``mode``.

    Parameters
    ----------
    low : float
        Lower limit [unit of the quantity].
    mode : float
        Position of the peak [unit of the quantity], between ``low`` and ``high``.
    high : float
        Upper limit [unit of the quantity], at least ``low``.

    Raises
    ------
    OutOfRangeError
        A value is not finite, or ``low`` ≤ ``mode`` ≤ ``high`` does not hold.
    """

    low: float
    mode: float
    high: float

    def __post_init__(self) -> None:
        _require_ordered("a triangular distribution", self.low, self.mode, self.high)

    @property
    def mean(self) -> float:
        """(low + mode + high)/3."""
        return (self.low + self.mode + self.high) / 3.0

    @property
    def standard_deviation(self) -> float:
        """√((r² + s² + (r + s)²)/36), where r = mode − low and s = high − mode."""
        r, s = self.mode - self.low, self.high - self.mode
        return math.sqrt((r * r + s * s + (r + s) ** 2) / 36.0)

    def quantile(self, probability: ArrayLike) -> FloatArray:
        """Return the quantiles at probabilities from 0 to 1 [unit of the quantity], in the shape of the argument."""
        p = np.asarray(probability, float)
        r, s = self.mode - self.low, self.high - self.mode
        rising = self.low + np.sqrt(p * r * (r + s))
        falling = self.high - np.sqrt((1.0 - p) * s * (r + s))
        return np.where(p * (r + s) <= r, rising, falling)


@dataclass(frozen=True, kw_only=True)
class StudentT:
    """Student's t distribution with a location and a scale, as for the mean of a few repeated measurements.

    Parameters
    ----------
    location : float
        Median [unit of the quantity]; for repeated measurements, their mean.
    scale : float
        Scale [unit of the quantity], ≥ 0; for n measurements with sample standard deviation s, s/√n.
    degrees_of_freedom : float
        Degrees of freedom ν [1], > 0; for n measurements, n − 1.

    Raises
    ------
    OutOfRangeError
        A parameter is not finite, the scale is negative, or the degrees of freedom are not positive.
    """

    location: float
    scale: float
    degrees_of_freedom: float

    def __post_init__(self) -> None:
        _require_finite("a Student t distribution", self.location, self.scale, self.degrees_of_freedom)
        _require_not_negative("the scale of a Student t distribution", self.scale)
        if self.degrees_of_freedom <= 0.0:
            raise OutOfRangeError(
                "the degrees of freedom of a Student t distribution",
                value=f"{self.degrees_of_freedom:g}",
                limit="> 0",
                remedy="n measurements have n - 1 degrees of freedom",
            )

    @property
    def mean(self) -> float | None:
        """The location; None for ν ≤ 1, where the mean does not exist."""
        return self.location if self.degrees_of_freedom > 1.0 else None

    @property
    def standard_deviation(self) -> float | None:
        """The scale times √(ν/(ν − 2)); None for ν ≤ 2, where the standard deviation does not exist."""
        nu = self.degrees_of_freedom
        return self.scale * math.sqrt(nu / (nu - 2.0)) if nu > 2.0 else None

    def quantile(self, probability: ArrayLike) -> FloatArray:
        """Return the quantiles at probabilities from 0 to 1 [unit of the quantity], in the shape of the argument.

        They are −∞ at 0 and +∞ at 1, or the location everywhere if the scale is 0.
        """
        from scipy.special import stdtrit

        p = np.asarray(probability, float)
        standard = np.where(p == 0.0, -np.inf, stdtrit(self.degrees_of_freedom, p))  # stdtrit gives +∞ at 0
        return _scaled(self.location, self.scale, standard.astype(np.float64))


@dataclass(frozen=True, kw_only=True)
class Arcsine(_Limited):
    """Arcsine (U-shaped) distribution between two limits, as for a sinusoidal disturbance of unknown phase.

    Parameters
    ----------
    low : float
        Lower limit [unit of the quantity].
    high : float
        Upper limit [unit of the quantity], at least ``low``.

    Raises
    ------
    OutOfRangeError
        A limit is not finite, or ``low`` exceeds ``high``.
    """

    def __post_init__(self) -> None:
        _require_ordered("an arcsine distribution", self.low, self.high)

    @property
    def standard_deviation(self) -> float:
        """(high − low)/√8."""
        return (self.high - self.low) / math.sqrt(8.0)

    def quantile(self, probability: ArrayLike) -> FloatArray:
        """Return the quantiles at probabilities from 0 to 1 [unit of the quantity], in the shape of the argument."""
        phase = np.pi * (np.asarray(probability, float) - 0.5)
        return np.asarray(self.mean + 0.5 * (self.high - self.low) * np.sin(phase))


@dataclass(frozen=True, kw_only=True)
class CurvilinearTrapezoid(_Limited):
    """Uniform distribution whose limits are known only to within ± ``inexactness`` (JCGM 101:2008, 6.4.3).

    Both limits move by the same amount in opposite directions, so that their midpoint is fixed. All amounts
    from ``-inexactness`` to ``inexactness`` are equally probable.

    Parameters
    ----------
    low : float
        Nominal lower limit [unit of the quantity].
    high : float
        Nominal upper limit [unit of the quantity], at least ``low``.
    inexactness : float
        Largest shift of each limit [unit of the quantity], from 0 to (high − low)/2.

    Raises
    ------
    OutOfRangeError
        A value is not finite, ``low`` exceeds ``high``, or the inexactness is negative or exceeds (high − low)/2.
    """

    inexactness: float

    def __post_init__(self) -> None:
        _require_ordered("a curvilinear trapezoid", self.low, self.high)
        _require_finite("a curvilinear trapezoid", self.inexactness)
        half_width = 0.5 * (self.high - self.low)
        if not 0.0 <= self.inexactness <= half_width:
            raise OutOfRangeError(
                "the inexactness of the limits of a curvilinear trapezoid",
                value=f"{self.inexactness:g}",
                limit=f"0 to the half-width {half_width:g}",
                remedy="widen the limits or state them more precisely",
            )

    @property
    def standard_deviation(self) -> float:
        """√((high − low)²/12 + inexactness²/9)."""
        return math.sqrt((self.high - self.low) ** 2 / 12.0 + self.inexactness**2 / 9.0)

    def quantile(self, probability: ArrayLike) -> FloatArray:
        """Return the quantiles at probabilities from 0 to 1 [unit of the quantity], in the shape of the argument."""
        p = np.asarray(probability, float)
        w, d = 0.5 * (self.high - self.low), self.inexactness
        if d == 0.0:
            return np.asarray(self.low + 2.0 * w * p)
        # By symmetry, only the lower half is inverted. At the probability `corner`, its flank meets the plateau.
        lower = np.minimum(p, 1.0 - p)
        corner = ((w + d) - (w - d) - (w - d) * _log_ratio(w + d, w - d)) / (4.0 * d)
        flank = (w + d) * _flank_depth(4.0 * d * np.minimum(lower, corner) / (w + d))
        plateau_density = _log_ratio(w + d, w - d) / (4.0 * d)
        plateau = 2.0 * d + (lower - corner) / plateau_density if w > d else flank
        from_edge = np.where(lower <= corner, flank, plateau)
        distance = w + d - from_edge
        return np.where(p <= 0.5, self.mean - distance, self.mean + distance)


def _log_ratio(outer: float, inner: float) -> float:
    """ln(outer/inner), or 0 for inner = 0, where it is multiplied by zero."""
    return math.log(outer / inner) if inner > 0.0 else 0.0


def _flank_depth(e: FloatArray) -> FloatArray:
    """Solve s + (1 − s) ln(1 − s) = e on [0, 1] by Newton's method from above; the left side is convex."""
    tiny = np.finfo(float).tiny
    # The left side is at least s²/2, so the start is never below the root.
    s = np.minimum(np.sqrt(2.0 * np.maximum(e, 0.0)), 1.0 - 1e-12)
    for _ in range(12):
        log = np.log1p(-s)
        s = np.clip(s + (s + (1.0 - s) * log - e) / np.minimum(log, -tiny), 0.0, 1.0 - 1e-15)
    return np.asarray(s)


@dataclass(frozen=True, eq=False)
class Empirical:
    """Distribution given by draws, each with the same probability.

    The quantile at probability p is the ⌈n p⌉-th smallest of n draws, without interpolation.

    Parameters
    ----------
    draws : array
        Finite values [unit of the quantity], shape (n,), n ≥ 2.

    Raises
    ------
    OutOfRangeError
        There are fewer than two draws, the array has more than one dimension, or a draw is not finite.
    """

    draws: FloatArray
    _sorted: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        draws = np.array(self.draws, float)
        if draws.ndim != 1 or draws.size < 2 or not np.all(np.isfinite(draws)):
            raise OutOfRangeError(
                "empirical draws",
                value=f"shape {draws.shape}, {int(np.sum(~np.isfinite(draws)))} of them not finite",
                limit="one column of at least two finite values",
                remedy="remove draws that are not finite, if any, and note this in the study",
            )
        draws.setflags(write=False)
        object.__setattr__(self, "draws", draws)
        object.__setattr__(self, "_sorted", np.sort(draws))

    @property
    def mean(self) -> float:
        """Mean of the draws."""
        return float(np.mean(self.draws))

    @property
    def standard_deviation(self) -> float:
        """Standard deviation of the draws, with divisor n instead of n − 1."""
        return float(np.std(self.draws))

    def quantile(self, probability: ArrayLike) -> FloatArray:
        """Return the quantiles at probabilities from 0 to 1 [unit of the quantity], in the shape of the argument."""
        n = self._sorted.size
        rank = np.ceil(np.asarray(probability, float) * n).astype(np.int64) - 1
        return np.asarray(self._sorted[np.clip(rank, 0, n - 1)])


@dataclass(frozen=True, kw_only=True, eq=False)
class FrozenDistribution:
    """A distribution of scipy.stats with its parameters; mean and standard deviation are None if not finite."""

    frozen: Any
    mean: float | None
    standard_deviation: float | None

    def quantile(self, probability: ArrayLike) -> FloatArray:
        """Return the quantiles at probabilities from 0 to 1 [unit of the quantity], in the shape of the argument."""
        quantiles = self.frozen.ppf if hasattr(self.frozen, "ppf") else self.frozen.icdf
        return np.asarray(quantiles(np.asarray(probability, float)), float)


Distribution = (
    Normal | Uniform | Triangular | StudentT | Arcsine | CurvilinearTrapezoid | Empirical | FrozenDistribution
)
"""The distribution of one error; mean and standard deviation are None where they do not exist."""
