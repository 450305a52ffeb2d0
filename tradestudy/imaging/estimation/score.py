"""Compare a measured depth map with the true one, and its errors with the camera's predicted uncertainty."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.depth_map import DepthMap, TrueDepth
from tradestudy.optics.arrays import BoolArray, FloatArray, Samples
from tradestudy.optics.window_matching import Reason, odd_window
from tradestudy.units import FRACTION, LENGTH, PIXELS, pretty, significant

_CENTRAL: Final = (15.865, 50.0, 84.135)  # percentiles; for normal errors, a standard deviation apart
VARIANCE_OF_SPREAD: Final = 0.5 * (0.15865 * 0.84135 - 0.15865**2) / 0.24197**2
"""n Var/σ² of half the central 68.27 % interval of n normal errors, ``(p(1 − p) − p²)/(2φ²)``.

Its ends p and 1 − p have variances p(1 − p)/(nφ²) and a covariance of p²/(nφ²); φ is the density at one standard
deviation.
"""
_BLOCKS: Final = 4  # parts in each direction, for jackknife standard errors
_CLIPPED: Final = 6.0  # in standard deviations; correlations leave out larger errors, one of which could decide them


@dataclass(frozen=True, kw_only=True)
class DepthScore:
    """How a depth map compares with the truth.

    Parameters
    ----------
    points
        Points of the map that show a surface; with several types of microlenses, only those behind the sharpest type.
    seen
        Points that the estimator can measure: it sees them in two pictures, and nothing hides them.
    measured
        Seen points that have a depth.
    measured_unseen
        Points that have a depth although the estimator cannot measure them, such as hidden ones.
    windows
        Number of non-overlapping windows that the measured points fill.
    bias, spread
        Median of measured minus true depth, and half its central 68.27 % interval [m].
    own
        Median of the standard deviations that the map derives from its texture [m]: the effect of noise in each window,
        to first order. Interpolation between pixels can lower it by a few per cent.
    predicted
        Median of the camera's predicted depth uncertainty at the true distances [m]; NaN where there is none.
    relative_bias, relative_spread
        Bias and spread of the errors relative to the prediction at their distances.
    within
        Fraction of errors within three times the predicted depth uncertainty.
    filled, available
        Measured points as a fraction of the seen ones, and seen points as a fraction of all.
    bias_px, spread_px
        Median and half the central 68.27 % interval of the errors in disparity [samples]; NaN if depth is measured
        without disparity.
    over_bound
        Half the central 68.27 % interval of the errors relative to the noise of each window.
    neighbour_correlation, window_correlation
        Correlation of the errors of adjacent points, and of points one window apart.
    standard_errors
        Standard errors of the numbers from ``bias`` on, by name, by a jackknife over 4 × 4 parts of the map, which
        allows for correlated errors of neighbours; NaN if fewer than three parts have measured points.
    reasons
        Seen points without a depth, by reason.
    matcher
        The matcher fitted to these errors, as a line of a study file, or why none can be fitted; see `fit_matcher`.
    """

    points: int
    seen: int
    measured: int
    measured_unseen: int
    windows: float
    bias: float
    spread: float
    own: float
    predicted: float
    relative_bias: float
    relative_spread: float
    within: float
    filled: float
    available: float
    bias_px: float
    spread_px: float
    over_bound: float
    neighbour_correlation: float
    window_correlation: float
    standard_errors: Mapping[str, float]
    reasons: Mapping[str, int]
    matcher: str

    def line(self, name: str) -> str:
        """One or two sentences for the terminal."""
        if not self.seen:
            return f"{name}: its estimator sees no point of the scene in two pictures within scene.distances"
        share = pretty(self.filled, FRACTION)
        text = f"{name}: {share} of {self.seen} unoccluded points measured"
        if not self.measured:
            return f"{text}; none has a depth: {_most(self.reasons)}"
        bias, spread = (pretty(one, LENGTH) for one in (self.bias, self.spread))
        text += f"; error {bias} ± {spread} (median, half the central 68 % interval)"
        if math.isfinite(self.spread_px):
            text += f", {pretty(self.spread_px, PIXELS, 2)} of disparity"
        if math.isnan(self.predicted):
            return f"{text}; this kind of camera has no predicted error"
        return (
            f"{text}, predicted {pretty(self.predicted, LENGTH)}; relative to the predicted uncertainty "
            f"{significant(self.relative_bias, 2)} ± {significant(self.relative_spread, 2)}, "
            f"{pretty(self.within, FRACTION)} of the errors within 3 times it"
        )


def score(found: DepthMap, truth: TrueDepth, predicted: Samples, window_px: float) -> DepthScore:
    """Compare a map with the truth.

    Parameters
    ----------
    found, truth
        Measured and true depth in the same pixels.
    predicted
        Depth uncertainty at the true depth of each pixel [m]; NaN where there is none.
    window_px
        Side of the matched windows [pixels of the map].
    """
    measured = found.reason == Reason.MEASURED
    both = measured & truth.measurable
    surface = np.isfinite(truth.depth) & ~np.isin(found.reason, (Reason.NO_LIGHT, Reason.LESS_SHARP))
    block = _blocks(both.shape)
    points, seen, filled = (
        np.bincount(block[one], minlength=_BLOCKS**2) for one in (surface | truth.measurable, truth.measurable, both)
    )
    of_errors = _Errors.of(found, truth, predicted, both, block)
    neighbours = [_Pairs.of(found, truth, both, block, lag) for lag in (1, odd_window(window_px))]

    def numbers(keep: BoolArray) -> dict[str, float]:
        return {
            **of_errors.numbers(keep),
            "filled": _ratio(filled[keep].sum(), seen[keep].sum()),
            "available": _ratio(seen[keep].sum(), points[keep].sum()),
            "neighbour_correlation": neighbours[0].correlation(keep),
            "window_correlation": neighbours[1].correlation(keep),
        }

    whole = numbers(np.ones(_BLOCKS**2, bool))
    missing = found.reason[truth.measurable & ~measured]
    return DepthScore(
        points=int(points.sum()),
        seen=int(seen.sum()),
        measured=int(filled.sum()),
        measured_unseen=int(np.count_nonzero(measured & ~truth.measurable)),
        windows=float(filled.sum() / window_px**2),
        matcher="",
        **whole,
        standard_errors=_jackknife(numbers, filled > 0, whole),
        reasons={
            Reason(code).name.lower().replace("_", " "): int(count)
            for code, count in zip(*np.unique(missing, return_counts=True), strict=True)
        },
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Errors:
    """Depth errors [m] with their predictions, bounds and parts of the map; shape (measured points,)."""

    error: FloatArray
    predicted: FloatArray
    own: FloatArray
    own_px: FloatArray
    block: NDArray[np.intp]

    @classmethod
    def of(
        cls, found: DepthMap, truth: TrueDepth, predicted: Samples, both: BoolArray, block: NDArray[np.intp]
    ) -> _Errors:
        return cls(
            error=np.asarray((found.depth - truth.depth)[both], np.float64),
            predicted=np.asarray(predicted[both], np.float64),
            own=np.asarray(found.deviation[both], np.float64),
            own_px=np.asarray(found.disparity_deviation[both], np.float64),
            block=block[both],
        )

    def numbers(self, keep: BoolArray) -> dict[str, float]:
        """Statistics of some parts of the map."""
        among = keep[self.block]
        error, predicted, own = self.error[among], self.predicted[among], self.own[among]
        with np.errstate(divide="ignore", invalid="ignore"):  # not finite if nothing is predicted
            relative, over_bound = error / predicted, error / own
        bias, spread = middle_and_spread(error)
        relative_bias, relative_spread = middle_and_spread(relative)
        bias_px, spread_px = middle_and_spread(over_bound * self.own_px[among])
        relative = relative[np.isfinite(relative)]
        return {
            "bias": bias,
            "spread": spread,
            "own": middle_and_spread(own)[0],
            "predicted": middle_and_spread(predicted)[0],
            "relative_bias": relative_bias,
            "relative_spread": relative_spread,
            "within": _ratio(float(np.count_nonzero(np.abs(relative) <= 3.0)), relative.size),
            "bias_px": bias_px,
            "spread_px": spread_px,
            "over_bound": middle_and_spread(over_bound)[1],
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pairs:
    """Errors relative to their bounds, for pairs of points some pixels apart along a row."""

    left: FloatArray
    right: FloatArray
    block: NDArray[np.intp]

    @classmethod
    def of(cls, found: DepthMap, truth: TrueDepth, both: BoolArray, block: NDArray[np.intp], lag: int) -> _Pairs:
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = np.where(both, (found.depth - truth.depth) / found.deviation, np.nan)
        relative[~(np.abs(relative) <= _CLIPPED)] = np.nan
        left, right = relative[:, :-lag], relative[:, lag:]
        known = np.isfinite(left) & np.isfinite(right)
        return cls(left=left[known], right=right[known], block=block[:, :-lag][known])

    def correlation(self, keep: BoolArray) -> float:
        """Correlation of the pairs in some parts of the map; NaN for fewer than three pairs."""
        among = keep[self.block]
        if np.count_nonzero(among) < 3:
            return math.nan
        return float(np.corrcoef(self.left[among], self.right[among])[0, 1])


def _blocks(shape: tuple[int, ...]) -> NDArray[np.intp]:
    """Index of the part of the map to which each pixel belongs."""
    row, column = (np.arange(size) * _BLOCKS // size for size in shape)
    return np.asarray(row[:, np.newaxis] * _BLOCKS + column)


def _jackknife(
    numbers: Callable[[BoolArray], Mapping[str, float]], filled: BoolArray, whole: Mapping[str, float]
) -> dict[str, float]:
    """Standard errors from leaving out each non-empty part in turn."""
    parts = np.flatnonzero(filled)
    n = parts.size
    if n < 3:
        return dict.fromkeys(whole, math.nan)
    everything = np.arange(filled.size)
    without = [numbers(everything != part) for part in parts]
    return {
        name: float(np.sqrt((n - 1) * np.var([one[name] for one in without]))) if math.isfinite(value) else math.nan
        for name, value in whole.items()
    }


def _ratio(part: float, whole: float) -> float:
    return float(part / whole) if whole else math.nan


def middle_and_spread(values: Samples) -> tuple[float, float]:
    """Median, and half the central 68.27 % interval."""
    values = values[np.isfinite(values)]
    if not values.size:
        return math.nan, math.nan
    low, middle, high = (float(one) for one in np.percentile(values, _CENTRAL))
    return middle, (high - low) / 2.0


def _most(reasons: Mapping[str, int]) -> str:
    """The most frequent reason."""
    return max(reasons, key=lambda name: reasons[name])
