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
        Computes `failed` on demand.
    counting_step
        The smallest non-zero share that the draws can resolve.
    """

    probabilities: tuple[float, ...]
    quantiles: FloatArray
    failures: Callable[[], FloatArray]
    counting_step: float = 0.0

    @cached_property
    def failed(self) -> FloatArray:
        """Share of measurements that end at or beyond infinity or give no depth, shape (scrambles, distances)."""
        return self.failures()

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
        return self.half_width_errors(ONE_SIGMA)

    def half_width_errors(self, coverage: float) -> FloatArray:
        """Standard error over scrambles of half the central interval [m] with a given coverage."""
        return _standard_error(self.half_widths(coverage))

    @property
    def failed_fraction(self) -> FloatArray:
        """Mean over scrambles."""
        return _mean(self.failed)

    @property
    def failed_fraction_error(self) -> FloatArray:
        """Standard error over scrambles, at least the resolution of counting draws; 0 if nothing is drawn."""
        return np.maximum(_standard_error(self.failed), self.counting_step)

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
        """The largest Student t interval of the reported half widths, relative to each; 0 where nothing is drawn.

        If an interval has no far end, the failed fraction is judged instead. A bounded interval that is ``widest`` [m]
        or wider is not judged.
        """
        from scipy.special import stdtrit

        worst = np.zeros(self.quantiles.shape[2])
        if len(self.quantiles) < 2:
            return worst
        t = float(stdtrit(len(self.quantiles) - 1, 0.975))
        with np.errstate(divide="ignore", invalid="ignore"):  # no failures, no width, or an infinite one
            of_failed = t * self.failed_fraction_error / self.failed_fraction
            for probability in self.probabilities[: len(self.probabilities) // 2]:
                widths = self.half_widths(1.0 - 2.0 * probability)
                width = _mean(widths)
                of_width = t * _standard_error(widths) / width
                if widest is not None:
                    of_width = np.where(width >= widest, 0.0, of_width)
                worst = np.fmax(worst, np.where(np.isinf(width), of_failed, of_width))
        return worst


def _mean(values: FloatArray) -> FloatArray:
    """Mean over scrambles; +inf if any of them is infinite."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.mean(values, axis=0))


def _standard_error(values: FloatArray) -> FloatArray:
    """Standard error of the mean over scrambles; 0 for a single one, NaN if any is infinite."""
    count = len(values)
    if count < 2:
        return np.where(np.isfinite(values[0]), 0.0, np.nan)
    finite = np.where(np.isinf(values).any(axis=0), np.nan, values)
    return np.asarray(np.std(finite, axis=0, ddof=1) / np.sqrt(count))
