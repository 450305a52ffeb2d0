"""Fit what a matcher adds to the matching bound, from depth maps with known truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.cameras.depth_map import DepthMap, TrueDepth
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.estimation.score import middle_and_spread
from tradestudy.imaging.matcher import Matcher
from tradestudy.optics.arrays import BoolArray, Samples
from tradestudy.optics.window_matching import Reason

_FALSE: Final = 6.0  # a match is false beyond this many spreads from the median
_BINS: Final = 8
LEAST_WINDOWS: Final = 50


@dataclass(frozen=True, kw_only=True)
class MatcherFit:
    """A matcher fitted to measured errors, with standard errors.

    Parameters
    ----------
    matcher
        The matcher, as a study may declare it under ``matcher``.
    factor_error, floor_error, false_matches_error
        Standard errors of its factor, its floor [samples] and its fraction of false matches.
    windows
        Number of non-overlapping windows to which the errors are equivalent.
    """

    matcher: Matcher
    factor_error: float
    floor_error: float
    false_matches_error: float
    windows: float

    @property
    def declaration(self) -> str:
        """The matcher as a line of a study file, with its standard errors as a comment."""
        one = self.matcher
        return (
            f"matcher: {{factor: {one.factor:.3g}, floor: {one.floor:.2g} px, "
            f"false_matches: {one.false_matches * 100.0:.2g} %}}  # ± {self.factor_error:.2g}, "
            f"± {self.floor_error:.1g} px, ± {self.false_matches_error * 100.0:.1g} %, from {self.windows:.0f} windows"
        )


def fit_matcher(found: DepthMap, truth: TrueDepth, window_px: float) -> MatcherFit:
    """Compare the errors of a map with the bound that follows from the texture of each window.

    Depth errors are scaled to disparity errors; the bound b of each window is the standard deviation that the map
    states (`match_windows`). The variance of the errors in classes of equal b is fitted with ``k² b² + f²``, k ≥ 1 and
    f ≥ 0.

    Parameters
    ----------
    found, truth
        Measured and true depth in the same pixels.
    window_px
        Side of the windows, which overlap.

    Raises
    ------
    OutOfRangeError
        There are too few windows, or the map has no disparities.
    """
    both = (found.reason == Reason.MEASURED) & truth.measurable & (found.deviation > 0.0)
    bound = found.disparity_deviation[both]
    windows = bound.size / window_px**2
    if not np.all(np.isfinite(bound)):
        raise OutOfRangeError("this camera measures no disparity")
    require_windows(windows)
    return fit_errors((found.depth - truth.depth)[both] / found.deviation[both] * bound, bound, windows)


def require_windows(windows: float) -> None:
    """Refuse to fit a matcher to too few non-overlapping windows.

    Raises
    ------
    OutOfRangeError
        There are fewer than 50.
    """
    if not windows >= LEAST_WINDOWS:
        raise OutOfRangeError(
            "independent matching windows",
            value=f"{windows:.0f}",
            limit=f"{LEAST_WINDOWS} or more",
            remedy="render a larger sensor or more texture",
        )


def true_matches(error: Samples) -> BoolArray:
    """Which errors are close enough to their median for a true match."""
    middle, spread = middle_and_spread(error)
    return np.asarray(np.abs(error - middle) <= _FALSE * spread)


def fit_errors(error: Samples, bound: Samples, windows: float) -> MatcherFit:
    """Fit a matcher to disparity errors [samples] of independent windows and their bounds; see `fit_matcher`."""
    from scipy.optimize import nnls

    false, b2, variance = 0, np.empty(_BINS), np.empty(_BINS)
    for k, one in enumerate(np.array_split(np.argsort(bound), _BINS)):
        true = one[true_matches(error[one])]
        false += one.size - true.size
        b2[k], variance[k] = np.mean(np.square(bound[true])), np.var(error[true])
    share = false / bound.size
    spread = variance * np.sqrt(2.0 * _BINS / windows)
    # k² = 1 + an excess; neither the excess nor f² may be negative.
    design = np.stack([b2, np.ones(_BINS)], axis=-1) / spread[:, np.newaxis]
    scale = np.linalg.norm(design, axis=0)
    (more, floor2), _ = nnls(design / scale, (variance - b2) / spread)
    more, floor2 = more / scale[0], floor2 / scale[1]
    errors = np.sqrt(np.diag(np.linalg.pinv(design.T @ design)))
    factor, floor = float(np.sqrt(1.0 + more)), float(np.sqrt(floor2))
    return MatcherFit(
        matcher=Matcher(factor=factor, floor=floor, false_matches=share),
        factor_error=float(errors[0] / (2.0 * factor)),
        floor_error=float(errors[1] / (2.0 * floor)) if floor2 > errors[1] else float(np.sqrt(errors[1])),
        false_matches_error=float(np.sqrt(max(share * (1.0 - share), 1.0 / windows) / windows)),
        windows=windows,
    )
