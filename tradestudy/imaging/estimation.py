"""Depth maps from pictures: flat-fielding, comparison with the truth, and the matcher that their errors suggest."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.depth_map import DepthMap, FlatPicture, TrueDepth
from tradestudy.cameras.light_cones import Exposure
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.models import Matcher
from tradestudy.imaging.render.nodes import LEAST_NODES, lit_area
from tradestudy.imaging.render.tiles import Recording
from tradestudy.imaging.render.waves import Waves
from tradestudy.optics.arrays import BoolArray, FloatArray, Samples
from tradestudy.optics.window_matching import Reason, odd_window
from tradestudy.units import FRACTION, LENGTH, PIXELS, pretty, significant

_ROWS_AT_ONCE: Final = 16
_FULL_WITHIN: Final = 4.0  # of the full well, in standard deviations of the read noise
_LEAST_LIGHT: Final = 0.3  # relative to the brightest pixels; below it, flat-fielding mainly amplifies noise
_LEAST_SHARE: Final = 0.9  # fraction of a pixel's light that must come through one lens


@dataclass(frozen=True, kw_only=True, eq=False)
class WhitePicture:
    """The picture of a uniform white scene.

    Parameters
    ----------
    electrons
        Expected electrons of every pixel, shape (rows, columns).
    share
        Fraction of each pixel's light that comes through the lens contributing most.
    """

    electrons: Samples
    share: Samples


def white_picture(exposure: Exposure, recording: Recording, waves: Waves | None = None) -> WhitePicture:
    """The white picture that a calibration of the designed camera would record; by waves if they are given."""
    sensor = exposure.sensor
    gain = recording.electrons_at_f1(sensor)
    width = sensor.pixel_pitch * recording.pixel_fill
    electrons, share = (np.empty((sensor.rows, sensor.columns), np.float32) for _ in range(2))
    for top in range(0, sensor.rows, _ROWS_AT_ONCE):
        rows, columns = np.mgrid[top : min(top + _ROWS_AT_ONCE, sensor.rows), : sensor.columns]
        x = (columns.ravel() + 0.5 - sensor.columns / 2.0) * sensor.pixel_pitch
        y = (rows.ravel() + 0.5 - sensor.rows / 2.0) * sensor.pixel_pitch
        if waves is None:
            cones = exposure.cones(x, y)
            lit = lit_area(cones, width) / (np.pi * cones.lens_radius**2) * cones.light
        else:
            cones = exposure.cones(x, y, waves.beyond)
            lit = waves.tables(LEAST_NODES)[LEAST_NODES].passed_pixel(cones, width) * cones.light
        total, most = np.bincount(cones.pixel, weights=lit, minlength=x.size), np.zeros(x.size)
        np.maximum.at(most, cones.pixel, lit)
        electrons[rows[:, 0]] = (gain * total).reshape(rows.shape)
        share[rows[:, 0]] = np.divide(most, total, out=np.zeros(x.size), where=total > 0.0).reshape(rows.shape)
    return WhitePicture(electrons=electrons, share=share)


def flat_picture(values: NDArray[Any], white: WhitePicture, recording: Recording) -> FlatPicture:
    """Flat-field recorded digital numbers or electrons; saturated and dim pixels become NaN."""
    noise = recording.noise
    if recording.is_digital:
        electrons = values * noise.step_electrons - recording.black_level
        full = values >= 2**noise.bits - 1
        rounding = noise.step_electrons / 2.0
    else:
        electrons = np.asarray(values, np.float64)
        full, rounding = np.zeros(electrons.shape, bool), 0.0
    # The read noise of a full pixel may be negative.
    noise_of_full = _FULL_WITHIN * noise.read_noise_electrons if "read" in recording.model else 0.0
    full |= electrons >= noise.full_well_electrons - noise_of_full - rounding
    bright = white.electrons > _LEAST_LIGHT * float(np.percentile(white.electrons, 99.0))
    variance = np.zeros_like(electrons)
    if recording.model != "off":
        variance = np.maximum(electrons, 0.0)
    if "read" in recording.model:
        variance = variance + noise.read_noise_electrons**2
    if recording.is_digital:
        variance = variance + noise.step_electrons**2 / 12.0
    usable = bright & ~full
    flat = np.where(usable, white.electrons, np.nan)
    return FlatPicture(
        values=(electrons / flat).astype(np.float32),
        variance=(variance / np.square(flat)).astype(np.float32),
        pure=usable & (white.share >= _LEAST_SHARE),
    )


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
    predicted, predicted_bias
        Median of the camera's predicted depth uncertainty at the true distances from noise, which spreads depths, and
        from the errors of the calibration, which shift them [m]; NaN where there is none.
    relative_bias, relative_spread
        Bias and spread of the errors relative to the predicted effect of noise at their distances.
    within
        Fraction of errors within three times the predicted depth uncertainty from both.
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
    predicted_bias: float
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
            return f"{text}; none has a depth: {max(self.reasons, key=self.reasons.__getitem__)}"
        bias, spread = (pretty(length, LENGTH) for length in (self.bias, self.spread))
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


def score(
    depth_map: DepthMap, truth: TrueDepth, predicted: Samples, window_px: float, calibration: Samples | float = 0.0
) -> DepthScore:
    """Compare a map with the truth.

    Parameters
    ----------
    depth_map, truth
        Measured and true depth in the same pixels.
    predicted
        Depth uncertainty from noise at the true depth of each pixel [m]; NaN where there is none.
    window_px
        Side of the matched windows [pixels of the map].
    calibration
        Depth uncertainty from the errors of the calibration [m], if the pictures have them.
    """
    measured = depth_map.reason == Reason.MEASURED
    compared = measured & truth.measurable
    surface = np.isfinite(truth.depth) & ~np.isin(depth_map.reason, (Reason.NO_LIGHT, Reason.LESS_SHARP))
    row, column = (np.arange(size) * _BLOCKS // size for size in compared.shape)
    block = row[:, np.newaxis] * _BLOCKS + column  # the part of the map to which each pixel belongs
    points, visible, filled = (
        np.bincount(block[mask], minlength=_BLOCKS**2)
        for mask in (surface | truth.measurable, truth.measurable, compared)
    )
    shift = np.broadcast_to(calibration, compared.shape)
    of_errors = _Errors.of(depth_map, truth, (predicted, shift), compared, block)
    neighbours = [_Pairs.of(depth_map, truth, compared, block, lag) for lag in (1, odd_window(window_px))]

    def numbers(keep: BoolArray) -> dict[str, float]:
        return {
            **of_errors.numbers(keep),
            "filled": _ratio(filled[keep].sum(), visible[keep].sum()),
            "available": _ratio(visible[keep].sum(), points[keep].sum()),
            "neighbour_correlation": neighbours[0].correlation(keep),
            "window_correlation": neighbours[1].correlation(keep),
        }

    whole = numbers(np.ones(_BLOCKS**2, bool))
    missing = depth_map.reason[truth.measurable & ~measured]
    return DepthScore(
        points=int(points.sum()),
        seen=int(visible.sum()),
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
    shift: FloatArray
    own: FloatArray
    own_px: FloatArray
    block: NDArray[np.intp]

    @classmethod
    def of(
        cls,
        depth_map: DepthMap,
        truth: TrueDepth,
        predicted: tuple[Samples, Samples],
        compared: BoolArray,
        block: NDArray[np.intp],
    ) -> _Errors:
        return cls(
            error=np.asarray((depth_map.depth - truth.depth)[compared], np.float64),
            predicted=np.asarray(predicted[0][compared], np.float64),
            shift=np.asarray(predicted[1][compared], np.float64),
            own=np.asarray(depth_map.deviation[compared], np.float64),
            own_px=np.asarray(depth_map.disparity_deviation[compared], np.float64),
            block=block[compared],
        )

    def numbers(self, keep: BoolArray) -> dict[str, float]:
        """Statistics of some parts of the map."""
        among = keep[self.block]
        error, predicted, bound = self.error[among], self.predicted[among], self.own[among]
        shift = self.shift[among]
        with np.errstate(divide="ignore", invalid="ignore"):  # not finite if nothing is predicted
            relative, over_bound = error / predicted, error / bound
        bias, spread = middle_and_spread(error)
        relative_bias, relative_spread = middle_and_spread(relative)
        bias_px, spread_px = middle_and_spread(over_bound * self.own_px[among])
        allowed = 3.0 * np.hypot(predicted, shift)
        finite = np.isfinite(relative)
        return {
            "bias": bias,
            "spread": spread,
            "own": middle_and_spread(bound)[0],
            "predicted": middle_and_spread(predicted)[0],
            "predicted_bias": middle_and_spread(shift)[0],
            "relative_bias": relative_bias,
            "relative_spread": relative_spread,
            "within": _ratio(float(np.count_nonzero(np.abs(error[finite]) <= allowed[finite])), int(finite.sum())),
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
    def of(
        cls, depth_map: DepthMap, truth: TrueDepth, compared: BoolArray, block: NDArray[np.intp], lag: int
    ) -> _Pairs:
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = np.where(compared, (depth_map.depth - truth.depth) / depth_map.deviation, np.nan)
        relative[~(np.abs(relative) <= _CLIPPED)] = np.nan
        left, right = relative[:, :-lag], relative[:, lag:]
        finite = np.isfinite(left) & np.isfinite(right)
        return cls(left=left[finite], right=right[finite], block=block[:, :-lag][finite])

    def correlation(self, keep: BoolArray) -> float:
        """Correlation of the pairs in some parts of the map; NaN for fewer than three pairs."""
        among = keep[self.block]
        if np.count_nonzero(among) < 3:
            return math.nan
        return float(np.corrcoef(self.left[among], self.right[among])[0, 1])


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
        name: float(np.sqrt((n - 1) * np.var([statistics[name] for statistics in without])))
        if math.isfinite(value)
        else math.nan
        for name, value in whole.items()
    }


def _ratio(part: float, whole: float) -> float:
    return float(part / whole) if whole else math.nan


def middle_and_spread(values: Samples) -> tuple[float, float]:
    """Median, and half the central 68.27 % interval."""
    values = values[np.isfinite(values)]
    if not values.size:
        return math.nan, math.nan
    low, middle, high = (float(percentile) for percentile in np.percentile(values, _CENTRAL))
    return middle, (high - low) / 2.0


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
        matcher = self.matcher
        return (
            f"matcher: {{factor: {matcher.factor:.3g}, floor: {matcher.floor:.2g} px, "
            f"false_matches: {matcher.false_matches * 100.0:.2g} %}}  # ± {self.factor_error:.2g}, "
            f"± {self.floor_error:.1g} px, ± {self.false_matches_error * 100.0:.1g} %, from {self.windows:.0f} windows"
        )


def fit_matcher(depth_map: DepthMap, truth: TrueDepth, window_px: float) -> MatcherFit:
    """Compare the errors of a map with the bound that follows from the texture of each window.

    Depth errors are scaled to disparity errors; the bound b of each window is the standard deviation that the map
    states (`match_windows`). The variance of the errors in classes of equal b is fitted with ``k² b² + f²``, k ≥ 1 and
    f ≥ 0.

    Parameters
    ----------
    depth_map, truth
        Measured and true depth in the same pixels.
    window_px
        Side of the windows, which overlap.

    Raises
    ------
    OutOfRangeError
        There are too few windows, or the map has no disparities.
    """
    compared = (depth_map.reason == Reason.MEASURED) & truth.measurable & (depth_map.deviation > 0.0)
    bound = depth_map.disparity_deviation[compared]
    windows = bound.size / window_px**2
    if not np.all(np.isfinite(bound)):
        raise OutOfRangeError("this camera measures no disparity")
    require_windows(windows)
    return fit_errors((depth_map.depth - truth.depth)[compared] / depth_map.deviation[compared] * bound, bound, windows)


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
    for k, members in enumerate(np.array_split(np.argsort(bound), _BINS)):
        true = members[true_matches(error[members])]
        false += members.size - true.size
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
