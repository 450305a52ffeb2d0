"""The distribution of one measured depth at each distance, from which every number about depth is taken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tradestudy.cameras.calibration import ONE_SIGMA
from tradestudy.optics.arrays import BoolArray, FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthDistribution:
    """Quantiles of depth over distances, from independent scrambles; a single one if nothing is drawn.

    Parameters
    ----------
    probabilities
        Probabilities of the quantiles, increasing and symmetric about the median.
    quantiles
        Depths [m], shape (scrambles, probabilities, distances); +inf beyond infinity, NaN where nothing is measured.
    failures
        Computes, on demand, the share of true matches that end at or beyond infinity or give no depth, shape
        (scrambles, distances).
    radii
        Computes `error_radii` on demand.
    counting_step
        The smallest non-zero share that the draws can resolve.
    false_matches
        The share m of false matches, which no quantile includes.
    """

    probabilities: tuple[float, ...]
    quantiles: FloatArray
    failures: Callable[[], FloatArray]
    radii: Callable[[], FloatArray]
    counting_step: float = 0.0
    false_matches: float = 0.0

    @cached_property
    def failed(self) -> FloatArray:
        """Share of measurements that fail, ``1 − (1 − f)(1 − m)`` with the failures f, shape (scrambles, distances)."""
        found = self.failures()
        return found + self.false_matches * (1.0 - found)

    @cached_property
    def error_radii(self) -> FloatArray:
        """Radius about the true distance [m] that contains 68.27 % of all measurements, in each scramble.

        Failures and false matches count as infinitely wrong; shape (scrambles, distances).
        """
        return self.radii()

    @cached_property
    def quantile(self) -> FloatArray:
        """Mean over scrambles, shape (probabilities, distances)."""
        return _mean(self.quantiles)

    @property
    def half_width(self) -> FloatArray:
        """The depth uncertainty: half the central 68.27 % interval [m]; +inf where it has no far end."""
        return _mean(self.half_widths(ONE_SIGMA))

    @property
    def half_width_error(self) -> FloatArray:
        """Standard error of `half_width` over scrambles [m]; 0 where nothing is drawn, NaN where it is unbounded."""
        return standard_error(self.half_widths(ONE_SIGMA))

    @property
    def error_radius(self) -> FloatArray:
        """Mean of `error_radii` over scrambles [m]."""
        return _mean(self.error_radii)

    @property
    def error_radius_error(self) -> FloatArray:
        """Standard error of `error_radius` over scrambles [m]; 0 where nothing is drawn, NaN where it is infinite."""
        return standard_error(self.error_radii)

    @cached_property
    def judged_widths(self) -> FloatArray:
        """The larger of half width and radius [m], in each scramble: requirements and ranks are judged by it.

        The means over scrambles decide which it is, so that the larger of two noisy values is not taken in each.
        """
        return judged_by_larger(self.half_width, self.error_radius, self.half_widths(ONE_SIGMA), self.error_radii)

    @property
    def judged(self) -> FloatArray:
        """Mean of `judged_widths` over scrambles [m]."""
        return _mean(self.judged_widths)

    @property
    def judged_error(self) -> FloatArray:
        """Standard error of `judged` over scrambles [m]; 0 where nothing is drawn, NaN where it is unbounded."""
        return standard_error(self.judged_widths)

    @property
    def failed_fraction(self) -> FloatArray:
        """Mean over scrambles."""
        return _mean(self.failed)

    @property
    def failed_fraction_error(self) -> FloatArray:
        """Standard error over scrambles, at least the resolution of counting draws; 0 if nothing is drawn."""
        return np.maximum(standard_error(self.failed), self.counting_step)

    def half_widths(self, coverage: float) -> FloatArray:
        """Half the central interval [m] with a given coverage, in each scramble; +inf where it has no far end."""
        low = int(np.argmin(np.abs(np.array(self.probabilities) - (1.0 - coverage) / 2.0)))
        near, far = self.quantiles[:, low], self.quantiles[:, len(self.probabilities) - 1 - low]
        unbounded = np.isinf(far)
        return np.asarray(np.where(unbounded, np.inf, (far - np.where(unbounded, 0.0, near)) / 2.0))

    def converged(self, tolerance: float, widest: FloatArray | None = None) -> BoolArray:
        """Where `sampling_error` is within the relative tolerance."""
        return np.asarray(self.sampling_error(widest) <= tolerance)

    def sampling_error(self, widest: FloatArray | None = None) -> FloatArray:
        """The largest Student t interval of the reported half widths and of `judged`, relative to each.

        0 where nothing is drawn. If an interval has no far end, the failed fraction is judged instead. A bounded
        interval that is ``widest`` [m] or wider is not judged.
        """
        from scipy.special import stdtrit

        worst = np.zeros(self.quantiles.shape[2])
        if len(self.quantiles) < 2:
            return worst
        t = float(stdtrit(len(self.quantiles) - 1, 0.975))
        with np.errstate(divide="ignore", invalid="ignore"):  # no failures, no width, or an infinite one
            of_failed = t * self.failed_fraction_error / self.failed_fraction
            reported = [self.half_widths(1.0 - 2.0 * p) for p in self.probabilities[: len(self.probabilities) // 2]]
            for widths in (*reported, self.judged_widths):
                width = _mean(widths)
                of_width = t * standard_error(widths) / width
                if widest is not None:
                    of_width = np.where(width >= widest, 0.0, of_width)
                worst = np.fmax(worst, np.where(np.isinf(width), of_failed, of_width))
        return worst


def judged_by_larger(
    half_width: FloatArray, radius: FloatArray, of_half_width: FloatArray, of_radius: FloatArray
) -> FloatArray:
    """What belongs to the larger of half width and radius: ``of_radius`` where the radius is larger."""
    return np.where(radius > half_width, of_radius, of_half_width)


def share_of_true_matches(false_matches: float) -> float:
    """Share of the true matches within the radius that contains 68.27 % of all measurements; above 1 if too few are."""
    return ONE_SIGMA / (1.0 - false_matches)


def _mean(values: FloatArray) -> FloatArray:
    """Mean over scrambles; +inf if any of them is infinite."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.mean(values, axis=0))


def standard_error(values: FloatArray) -> FloatArray:
    """Standard error of the mean over scrambles; 0 for a single one, NaN if any is infinite."""
    count = len(values)
    if count < 2:
        return np.where(np.isfinite(values[0]), 0.0, np.nan)
    finite = np.where(np.isinf(values).any(axis=0), np.nan, values)
    return np.asarray(np.std(finite, axis=0, ddof=1) / np.sqrt(count))
