"""The distribution of one measured depth at each distance, from which every number about depth is taken."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from tradestudy.cameras.calibration import ONE_SIGMA
from tradestudy.depth.brackets import between, falling, stencil
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
        failures = self.failures()
        return failures + self.false_matches * (1.0 - failures)

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
        widths = self.half_widths(ONE_SIGMA)
        return judged_by_larger(_mean(widths), self.error_radius, widths, self.error_radii)

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
        # The nearest probability: rounding may make it differ from the wanted one.
        low = int(np.argmin(np.abs(np.array(self.probabilities) - (1.0 - coverage) / 2.0)))
        near, far = self.quantiles[:, low], self.quantiles[:, len(self.probabilities) - 1 - low]
        unbounded = np.isinf(far)  # the near end may be infinite, too, and ∞ − ∞ is not a width
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
        t = float(stdtrit(len(self.quantiles) - 1, 0.975))  # of 95 %, two-sided
        with np.errstate(divide="ignore", invalid="ignore"):  # no failures, no width, or an infinite one
            of_failed = t * self.failed_fraction_error / self.failed_fraction
            reported = [self.half_widths(1.0 - 2.0 * p) for p in self.probabilities[: len(self.probabilities) // 2]]
            for widths in (*reported, self.judged_widths):
                width = _mean(widths)
                of_width = t * standard_error(widths) / width
                if widest is not None:
                    of_width = np.where(width >= widest, 0.0, of_width)
                # An error that is NaN, where nothing is measured or a width is 0, does not count.
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
    if len(values) == 1:  # as without draws, in thousands of small arrays
        return np.asarray(values[0])
    with np.errstate(invalid="ignore"):
        return np.asarray(np.mean(values, axis=0))


def standard_error(values: FloatArray) -> FloatArray:
    """Standard error of the mean over scrambles; 0 for a single one, NaN if any is infinite."""
    count = len(values)
    if count < 2:
        return np.where(np.isfinite(values[0]), 0.0, np.nan)
    finite = np.where(np.isinf(values).any(axis=0), np.nan, values)
    return np.asarray(np.std(finite, axis=0, ddof=1) / np.sqrt(count))


FARTHEST_SCORE: Final = 9.0
"""Scores are sought up to this many standard deviations; the probability beyond is below 1e-18."""
_RADIUS_TO: Final = 3e-5  # standard deviations, with linear interpolation within
_ROUNDING: Final = 1e-12  # of a distance, by which depth misses it without any error
_SECTIONS: Final = 8  # of a bracket in one round
_INNERMOST: Final = 0.2  # of a bracket
_SECANTS: Final = 3


def error_radius(read: Callable[[FloatArray], FloatArray], distance: FloatArray, share: float) -> FloatArray:
    """Quantile of |depth − truth| of measurements that one standard normal score determines.

    The measurements within the radius r are those between a far depth at the score u and a near depth at the score v,
    with Φ(v) − Φ(u) equal to the share and both depths equally far from the truth.

    Parameters
    ----------
    read
        Depth [m] at scores (scores, distances), the smaller the larger the score; +∞ or NaN is a failure.
    distance
        True distances [m].
    share
        Share of all measurements within the radius; from 1 on, the radius is infinite.

    Returns
    -------
    array (distances,)
        Radius [m]; +∞ where failures leave too few measurements.
    """
    from scipy.special import ndtr, ndtri

    if share >= 1.0:
        return np.full(distance.shape, np.inf)

    def beyond(lean: FloatArray) -> FloatArray:
        """A margin, how far the depth at the far score exceeds the truth, and how far the near one falls short.

        Of the measurements outside the radius, the share Φ(lean) is farther: depth is smooth in ``lean`` at both ends,
        unlike in the far score. The margin has the sign of the difference between the other two values. It is a
        difference of inverse depths, and hence almost linear, and finite even where a depth is infinite.
        """
        far, near = ndtri((1.0 - share) * ndtr([lean, -lean]))
        depths = read(np.concatenate([far, -near]))
        depths = np.where(np.isnan(depths), np.inf, depths)
        above, below = depths[: len(far)] - distance, np.abs(distance - depths[len(far) :])
        with np.errstate(divide="ignore"):  # a depth of 0
            return np.stack([1.0 / (distance + below) - 1.0 / depths[: len(far)], above, below], axis=1)

    reach = np.full(distance.shape, FARTHEST_SCORE)
    _, ends = last_score(reach, beyond, to=_RADIUS_TO, estimate=_lean_of_line(read, distance, share))
    margin, above, below = ends.swapaxes(0, 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        to_high = np.clip(margin[0] / (margin[0] - margin[1]), 0.0, 1.0)
        interpolated = above[0] + to_high * (above[1] - above[0])
    # Where the margin has one sign, both ends are the same; where it jumps because the far depth becomes infinite,
    # only the upper end has a finite radius.
    crossed = np.isfinite(interpolated) & (margin[0] > 0.0) & (margin[1] < 0.0)
    return without_rounding(np.where(crossed, interpolated, np.maximum(above, below)[1]), distance)


def _lean_of_line(read: Callable[[FloatArray], FloatArray], distance: FloatArray, share: float) -> FloatArray:
    """The lean of `error_radius` if inverse depth were linear in the score, as it almost is; 0 where it is unknown."""
    from scipy.special import ndtr, ndtri

    outside = 1.0 - share
    score = -float(ndtri(outside / 2.0))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # unbounded or unknown depths
        far, near = distance / read(np.array([[-score], [score]]) * np.ones(distance.shape))
        middle, slope = (near + far) / 2.0, (near - far) / (2.0 * score)

        def margin(lean: FloatArray) -> FloatArray:
            at_far, at_near = ndtri(outside * ndtr([lean, -lean]))  # scores, the near one reversed
            below = np.abs(1.0 - 1.0 / (middle - slope * at_near))
            return np.asarray(1.0 / (1.0 + below) - (middle + slope * at_far))

        # To first order in the relative error of depth, from the densities at the centre and at the ends.
        first = slope * score**2 * math.exp(-(score**2) / 2.0) / outside
        before, lean = np.zeros(distance.shape), np.clip(first, -1.0, 1.0)
        of_before = margin(before)
        for _ in range(_SECANTS):
            of_lean = margin(lean)
            step = np.nan_to_num(of_lean * (lean - before) / (of_lean - of_before), posinf=0.0, neginf=0.0)
            before, of_before, lean = lean, of_lean, np.clip(lean - step, -FARTHEST_SCORE, FARTHEST_SCORE)
    return np.asarray(np.nan_to_num(lean))


def without_rounding(error: FloatArray, distance: FloatArray) -> FloatArray:
    """Errors of depth [m], 0 where they are no larger than rounding makes them."""
    return np.asarray(np.where(error <= _ROUNDING * distance, 0.0, error))


def last_score(
    reach: FloatArray, read: Callable[[FloatArray], FloatArray], *, to: FloatArray | float, estimate: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Brackets of the scores (distances,) at which a falling margin ceases to be positive, and what is read there.

    The first round reads scores on both sides of an estimate, the others those `between` the ends of the brackets.

    Parameters
    ----------
    reach
        The largest score, of either sign. If the margin has the same sign up to it, both ends of the bracket are the
        end of this range on whose side the change would lie.
    read
        The margin and any other values, shape (scores, values, distances), at scores (scores, distances).
    to
        Largest width of the brackets.
    estimate
        Estimates of the scores: a good one ends the search after the first round.

    Returns
    -------
    tuple of arrays
        Scores, shape (2, distances), and values, shape (2, values, distances), at both ends.
    """
    columns = np.arange(reach.size)
    # The innermost of the scores are less than half a bracket from the estimate, the others ever farther.
    ratio = (_INNERMOST * to / reach) ** (-2.0 / (_SECTIONS - 2))
    first = falling(0.5 + 0.5 * estimate / reach, ratio, _SECTIONS)
    scores = reach * (2.0 * np.vstack([np.zeros(reach.shape), first, np.ones(reach.shape)]) - 1.0)
    values, previous = read(scores), np.full(reach.shape, np.inf)
    while True:
        # Only margins before the first that is not positive count: a bracket then holds a change of sign even where
        # rounding makes several.
        positive = np.sum(np.logical_and.accumulate(values[:, 0] > 0.0, axis=0), axis=0)
        ends = np.clip([positive - 1, positive], 0, len(scores) - 1)
        low, high = scores[ends, columns]
        values_at_ends = values[ends, :, columns].swapaxes(1, 2)  # numpy moves the sliced axis to the end
        if not np.any(high - low > to):
            return np.stack([low, high]), values_at_ends
        four = stencil(positive - 1, len(scores))
        inner = between((low, high), (scores[four, columns], values[four, 0, columns]), previous, _SECTIONS)
        scores = np.concatenate([[low], inner, [high]])
        values, previous = np.concatenate([values_at_ends[:1], read(inner), values_at_ends[1:]]), high - low
