"""Depth from two pictures: OpenCV finds disparity to whole pixels, and matching of windows refines it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Any, Final, Literal

import numpy as np

from tradestudy.cameras.calibrated_pair import LARGEST_FOCAL_RATIO
from tradestudy.cameras.depth_map import DepthMap, DepthReader, DepthSearch, FlatPicture, TrueDepth
from tradestudy.cameras.light_cones import AT_ORIGIN, Description
from tradestudy.cameras.parts import Sensor
from tradestudy.cameras.single_lens import SingleLensExposure
from tradestudy.cameras.stereo.design import StereoRig
from tradestudy.cameras.stereo.pair import SIDES
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray, IndexArray, Samples
from tradestudy.optics.lens_model import IDEAL
from tradestudy.optics.window_matching import (
    Matches,
    PairOfPictures,
    Reason,
    gradient_along,
    match_windows,
    odd_window,
)

_PATCHES: Final = 16  # along each side of the picture
_HALF_PATCH: Final = 15  # px
_LARGEST_OFFSET: Final = 0.02  # of the longer side of the picture; a calibrated rig has no larger one
_LEAST_REACH_PX: Final = 4  # rows searched even in a small picture
_LEAST_CORRELATION: Final = 0.7  # least correlation of two patches that show the same texture
_CORRELATION_DROP: Final = 0.1  # by which the correlation must fall on both sides of its only peak
_FEWEST_PATCHES: Final = 20  # patches needed to fit the five coefficients
_FEWEST_LINES: Final = 4  # different rows and columns in which they must lie
_LEAST_AGREEING: Final = 0.7  # fraction of the patches that must agree with the fit
_AGREEMENT_PX: Final = 0.5  # largest residual of a patch that agrees with the fit
_SCATTER_PX: Final = 0.2  # residual beyond which a patch counts as an outlier
_NEGLIGIBLE_PX: Final = 0.1  # too small an offset to affect matching windows
_SIGNIFICANT: Final = 3.0  # standard errors by which an offset must differ from zero


def row_alignment(left: Samples, right: Samples, steps: range, library: Any) -> Callable[[Samples], Samples]:
    """A function that resamples the right picture so that each point lies in the same row as in the left one.

    Small rotations between two parallel pinholes, different principal distances and a shift of the sensor displace rows
    by ``a + b u + c v + d u v + e v²`` (u, v from the middle of the picture), whatever the depth: a and e by pitch, b
    by roll, d by yaw. The coefficients are fitted, with a Cauchy loss, to patches of the left picture that are found
    again in the right one. Columns remain unchanged, since an error along them cannot be distinguished from depth.

    Parameters
    ----------
    left, right
        Pictures of parallel pinholes, shape (rows, columns); NaN where there is no light.
    steps
        Disparities to search [px].
    library
        OpenCV.

    Returns
    -------
    Callable[[Samples], Samples]
        Resamples a picture of the right camera. It returns the picture itself if no offset is both above 0.1 px and
        above three standard errors, or if too few patches are found or agree; patches count only where texture
        determines their row. Beyond the outermost patches, offsets are constant.
    """
    places, offsets = _offsets(left, right, steps, library)
    if len(offsets) < _FEWEST_PATCHES or min(np.unique(places[:, k]).size for k in (0, 1)) < _FEWEST_LINES:
        return _unchanged
    from scipy.optimize import least_squares

    hull = np.stack([places.min(axis=0), places.max(axis=0)])
    base = _basis(places, left.shape)
    start = np.array([np.median(offsets), 0.0, 0.0, 0.0, 0.0])

    def residuals(coefficients: FloatArray) -> FloatArray:
        return np.asarray(base @ coefficients - offsets)

    fit = least_squares(residuals, start, loss="cauchy", f_scale=_SCATTER_PX)
    # The standard deviation of normal residuals, which outliers hardly change.
    scatter = 1.4826 * float(np.median(np.abs(fit.fun)))
    agreeing = float(np.mean(np.abs(fit.fun) < _AGREEMENT_PX))
    border = _basis(np.stack(np.meshgrid(*np.linspace(hull[0], hull[1], 5).T), axis=-1).reshape(-1, 2), left.shape)
    error = scatter * np.linalg.norm(border @ np.linalg.pinv(base), axis=1)
    moved = np.abs(border @ fit.x)
    if agreeing < _LEAST_AGREEING or not np.any((moved > _NEGLIGIBLE_PX) & (moved > _SIGNIFICANT * error)):
        return _unchanged
    return lambda picture: _resampled(picture, fit.x, hull)


def _unchanged(picture: Samples) -> Samples:
    return picture


def _offsets(left: Samples, right: Samples, steps: range, library: Any) -> tuple[FloatArray, FloatArray]:
    """Patches of the left picture that are found in the right one: their row and column there, and row offset [px]."""
    reach = max(_LEAST_REACH_PX, math.ceil(_LARGEST_OFFSET * max(left.shape)))
    high, wide = _HALF_PATCH + reach, _HALF_PATCH
    first, second = (np.nan_to_num(picture).astype(np.float32) for picture in (left, right))
    lit = np.isfinite(left), np.isfinite(right)
    rows, columns = left.shape
    places, offsets = [], []
    for row in _middles(rows, high):
        for column in _middles(columns, wide):
            patch = np.s_[row - wide : row + wide + 1, column - wide : column + wide + 1]
            # The part of the right picture in which the patch can lie.
            start = max(column - steps[-1] - wide, 0)
            strip = np.s_[row - high : row + high + 1, start : min(column - steps[0] + wide + 1, columns)]
            if second[strip].shape[1] <= 2 * wide + 2 or not (lit[0][patch].all() and lit[1][strip].all()):
                continue
            alike = library.matchTemplate(second[strip], first[patch], library.TM_CCOEFF_NORMED)
            down, along = map(int, np.unravel_index(int(np.argmax(alike)), alike.shape))
            if alike[down, along] < _LEAST_CORRELATION or not _is_lone_peak(alike.max(axis=1)):
                continue
            # The vertex of the parabola through three correlations; a lone peak has neighbours on both sides.
            above, peak, below = alike[down - 1 : down + 2, along].astype(float)
            places.append((row, start + wide + along))
            offsets.append(down - reach + 0.5 * (above - below) / (above - 2.0 * peak + below))
    return np.array(places, dtype=np.float64).reshape(-1, 2), np.array(offsets)


def _middles(size: int, margin: int) -> IndexArray:
    """Middles of patches that do not overlap, at least ``margin`` from both ends; none if the picture is too small."""
    span = size - 1 - 2 * margin
    return (
        np.linspace(margin, size - 1 - margin, min(_PATCHES, span // (2 * _HALF_PATCH + 1) + 1)).astype(int)
        if span > 0
        else np.zeros(0, int)
    )


def _is_lone_peak(best_of_row: Samples) -> bool:
    """Whether the best correlation at any disparity, as a function of the row, has a single peak inside its range.

    Stripes and gratings do not: stripes look the same when shifted along themselves, and gratings repeat.
    """
    near = np.flatnonzero(best_of_row > best_of_row.max() - _CORRELATION_DROP)
    return bool(near[0] > 0 and near[-1] < best_of_row.size - 1 and near[-1] - near[0] + 1 == near.size)


def _basis(places: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """The terms 1, u, v, u v, v², shape (..., 5), of rows and columns (..., 2), in units of half the longer side."""
    v, u = ((places[..., k] + 0.5 - shape[k] / 2.0) / (max(shape) / 2.0) for k in (0, 1))
    return np.stack([np.ones_like(u), u, v, u * v, v * v], axis=-1)


def _resampled(picture: Samples, coefficients: FloatArray, hull: FloatArray) -> Samples:
    """A picture with its rows shifted up by the fitted offsets, constant outside a hull; NaN where it has no data."""
    rows, columns = np.indices(picture.shape)
    down = _basis(np.clip(np.stack([rows, columns], axis=-1), *hull), picture.shape) @ coefficients
    return _interpolated(picture, np.stack([rows + down, columns]), order=3)


def _interpolated(picture: Samples, place: Samples, *, order: Literal[1, 3]) -> Samples:
    """A picture at rows and columns (2, …), by splines of an order; NaN where it has no data."""
    from scipy.ndimage import map_coordinates

    missing = map_coordinates(np.isnan(picture).astype(np.float32), place, order=1, mode="constant", cval=1.0)
    values = map_coordinates(np.nan_to_num(picture).astype(np.float32), place, order=order, mode="nearest")
    return np.where(missing > 0.0, np.nan, values).astype(picture.dtype)


_LEAST_SHARE: Final = 0.5  # of a window that both pictures must show
_TILE: Final = 128  # rows and columns matched at once; the smaller, the fewer disparities they have
_BESIDE: Final = 3  # steps beyond the known disparities: two for the cubic, one for rounding
_FEWEST_STEPS: Final = 6
_GREYS: Final = (5.0, 245.0)  # to which the 1st and 99th percentiles are mapped in the 8-bit pictures for the matcher
_LARGEST_BLOCK: Final = 11  # px; the largest that OpenCV recommends
_SAME_SURFACE_PX: Final = 0.5  # difference of disparity allowed between the two pixels that image a point
_OPENCV_STEP: Final = 16  # disparities are in sixteenths of a pixel, and their number is a multiple of 16


@dataclass(frozen=True, kw_only=True, eq=False)
class PairReader(DepthReader):
    """Depth measured with a stereo rig as calibrated or designed; the map has the pixels of the left picture.

    Pictures are rectified unless they are of parallel pinholes with equal centred pictures; the map is then in the
    frame of the rectified left picture. Those of an unequal pair are rectified to the pixels of the coarser camera.
    Finally, rows that are displaced by errors of the rig are aligned.

    Parameters
    ----------
    camera, search
        The rig, and the depths to search.

    Raises
    ------
    OutOfRangeError
        If OpenCV is not installed.
    """

    camera: StereoRig
    search: DepthSearch

    def __post_init__(self) -> None:
        if find_spec("cv2") is None:  # refused here, before pictures are rendered for it
            raise _without_opencv()

    @cached_property
    def _exposures(self) -> Mapping[str, SingleLensExposure]:
        """The geometry of both pictures, which does not depend on the distance in focus."""
        return {exposure.name: exposure for exposure in self.camera.exposures(self.search.far, {}, None, 0.0)}

    @cached_property
    def _pinhole(self) -> tuple[float, float, float]:
        """Principal distance and principal point of both rectified cameras [px].

        They have the mean scale on the axis, or the smaller one of an unequal pair, and the mean of what the middles of
        both sensors see in their middle.
        """
        sensor, seen = self._grid, []
        for exposure in self._exposures.values():
            cones = exposure.cones(np.zeros(1), np.zeros(1))
            x, y, z = np.array(exposure.pose.rotation) @ np.append(cones.slope[:, 0], 1.0)
            seen.append((x / z, y / z))
        scales = [self._scale_of(side) for side in SIDES]
        c = min(scales) if self.camera.unequal else float(np.mean(scales))
        across, down = np.mean(seen, axis=0)
        return c, (sensor.columns - 1) / 2.0 - c * float(across), (sensor.rows - 1) / 2.0 - c * float(down)

    @property
    def _grid(self) -> Sensor:
        """The sensor whose pixels rectified pictures have: that of the coarser camera."""
        return self.camera.coarser[1]

    def _scale_of(self, side: str) -> float:
        """Scale of a picture on the axis [px]."""
        exposure = self._exposures[side]
        return math.sqrt(math.prod(exposure.scales)) * exposure.distortion.scale_on_axis / exposure.sensor.pixel_pitch

    @property
    def _scale(self) -> float:
        """Product of disparity and depth [px m] in rectified pictures."""
        left, right = (np.array(self._exposures[side].pose.centre) for side in SIDES)
        return self._pinhole[0] * float(np.linalg.norm(right - left))

    @property
    def _steps(self) -> range:
        """Disparities to search [px], at most the width of a picture and the search range of the rig's matcher."""
        first = math.floor(self._scale / self.search.far) - 2
        last = min(math.floor(self._scale / self.search.near) + 4, self._grid.columns)
        if (largest := self.camera.disparity_range_px) is not None:
            if self.camera.unequal:  # counts in pixels at the common focal length of the rig
                largest *= self._pinhole[0] * self.camera.sensor.pixel_pitch / self.camera.principal_distance
            last = min(last, math.floor(largest) + 1)
        return range(first, max(last, first + 4))

    def _depth(self, disparity: Samples) -> Samples:
        """Depth [m] from disparities in rectified pictures [px]."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.where(disparity > 0.0, self._scale / disparity, np.inf))

    def frame(self) -> Description:
        """The rectified left camera."""
        c, x, y = self._pinhole
        sensor = self._grid
        middle = (sensor.columns - 1) / 2.0, (sensor.rows - 1) / 2.0
        return {
            "centre": list(self._exposures["left"].pose.centre),
            "rotation": [list(row) for row in AT_ORIGIN.rotation],
            "principal_distance": c * sensor.pixel_pitch,
            "principal_point": [(place - mid) * sensor.pixel_pitch for place, mid in zip((x, y), middle, strict=True)],
        }

    def read(self, pictures: Mapping[str, FlatPicture]) -> DepthMap:
        """Depth of every pixel of the left picture whose matches from left to right and from right to left agree."""
        left, right = (
            self._parallel(self._matched(np.where(pictures[side].pure, pictures[side].values, np.nan), side), side)
            for side in SIDES
        )
        noise = [
            self._parallel(
                self._matched(np.where(pictures[side].pure, pictures[side].variance, np.nan), side, power=2),
                side,
                order=1,  # splines of order 3 could make variances negative
            )
            for side in SIDES
        ]
        aligned = row_alignment(left, right, self._steps, _opencv())
        right, noise[1] = aligned(right), aligned(noise[1])
        start = self._whole_pixels(left, right)
        disparity, deviation = np.full_like(left, np.nan), np.full_like(left, np.nan)
        reason = np.zeros(left.shape, np.uint8)
        for top, begin in itertools.product(range(0, left.shape[0], _TILE), range(0, left.shape[1], _TILE)):
            tile = (slice(top, top + _TILE), slice(begin, begin + _TILE))
            matches = self._tile((left, noise[0]), (right, noise[1]), start, tile)
            disparity[tile], deviation[tile], reason[tile] = matches.disparity, matches.deviation, matches.reason
        unknown = ~np.isfinite(start)
        # Where even the smallest disparity leads out of the right picture.
        unseen = ~np.isfinite(_moved(right, self._steps[0], (0, left.shape[1])))
        reason[unknown] = np.where(unseen[unknown], Reason.NO_PARTNER, Reason.NO_MATCH)
        reason[np.isnan(left)] = Reason.NO_LIGHT
        depth = self._depth(np.where(reason == Reason.MEASURED, disparity, np.nan))
        reason[(reason == Reason.MEASURED) & ~np.isfinite(depth)] = Reason.OUT_OF_RANGE
        good = reason == Reason.MEASURED
        deviation = np.where(good, deviation, np.nan)
        depth = np.where(good, depth, np.nan)
        return DepthMap(
            depth=depth,
            deviation=deviation * np.square(depth) / self._scale,
            disparity_deviation=deviation,
            reason=reason,
        )

    def _tile(
        self,
        left: tuple[Samples, Samples],
        right: tuple[Samples, Samples],
        start: Samples,
        tile: tuple[slice, slice],
    ) -> Matches:
        """Disparity in a part of the left picture, to fractions of a pixel, from both pictures and their variances.

        Only steps near those of semi-global matching are computed, which are few in so small a part.
        """
        window = odd_window(self.search.window_px)
        low, high = (max(0, part.start - window) for part in tile), (part.stop + window for part in tile)
        rows, columns = (slice(*ends) for ends in zip(low, high, strict=True))
        picture, variance, start = (values[rows, columns] for values in (*left, start))
        across = (columns.start, columns.start + picture.shape[1])
        right_picture, right_variance = (values[rows] for values in right)

        def difference(step: int) -> tuple[Samples, Samples, BoolArray]:
            change = _moved(right_picture, step, across) - picture
            return change, variance + _moved(right_variance, step, across), np.isfinite(change)

        wider = match_windows(
            [PairOfPictures(gradient=gradient_along(picture, (-1.0, 0.0)), difference=difference)],
            self._near(start),
            window=window,
            least_share=_LEAST_SHARE,
            largest_deviation=self.search.largest_deviation_px,
            start=start,
        )
        first = [wanted.start - part.start for wanted, part in zip(tile, (rows, columns), strict=True)]
        inner = tuple(slice(k, k + _TILE) for k in first)
        return Matches(disparity=wider.disparity[inner], deviation=wider.deviation[inner], reason=wider.reason[inner])

    def _near(self, start: Samples) -> range:
        """The disparities to search [px] around those known in advance: at least six."""
        steps, known = self._steps, start[np.isfinite(start)]
        if not known.size:
            return steps[:_FEWEST_STEPS]
        low = max(steps.start, math.floor(float(known.min())) - _BESIDE)
        high = min(steps.stop, max(math.ceil(float(known.max())) + _BESIDE + 1, low + _FEWEST_STEPS))
        return range(max(steps.start, min(low, high - _FEWEST_STEPS)), high)

    def _whole_pixels(self, left: Samples, right: Samples) -> Samples:
        """Disparity of the left picture [px] by semi-global matching; NaN where left and right disagree.

        H. Hirschmüller, "Stereo processing by semiglobal matching and mutual information", IEEE Trans. PAMI 30, 328
        (2008), as implemented in OpenCV: with blocks instead of mutual information, and five directions.
        """
        cv2 = _opencv()
        steps = self._steps
        values = np.concatenate([left.ravel(), right.ravel()])
        dark, bright = np.nanpercentile(values, (1.0, 99.0))
        scale = (_GREYS[1] - _GREYS[0]) / max(float(bright - dark), 1e-12)
        count = -(-len(steps) // _OPENCV_STEP) * _OPENCV_STEP
        # OpenCV skips pixels so close to the left edge that some disparities would leave the right picture.
        margin = max(0, steps[0] + count)
        greys = [
            np.pad(
                np.clip(np.nan_to_num(_GREYS[0] + (picture - dark) * scale), 0, 255).astype(np.uint8),
                ((0, 0), (margin, 0)),
            )
            for picture in (left, right)
        ]
        block = min(odd_window(self.search.window_px), _LARGEST_BLOCK)
        matcher = cv2.StereoSGBM_create(
            minDisparity=steps[0],
            numDisparities=count,
            blockSize=block,
            # As OpenCV recommends for pictures with one channel.
            P1=8 * block**2,
            P2=32 * block**2,
            disp12MaxDiff=1,
            uniquenessRatio=5,
        )
        disparity = np.asarray(matcher.compute(*greys), np.float32)[:, margin:] / _OPENCV_STEP
        return np.where(disparity >= steps[0], disparity, np.nan)

    @cached_property
    def _needs_no_rectification(self) -> bool:
        """Whether the pictures are rectified as taken."""
        rectified = {
            view.pose.rotation == AT_ORIGIN.rotation and view.distortion == IDEAL and view.principal_point == (0.0, 0.0)
            for view in self._exposures.values()
        }
        scales = {scale for view in self._exposures.values() for scale in view.scales}
        return rectified == {True} and len(scales) == 1

    def _parallel(self, picture: Samples, side: str, order: Literal[1, 3] = 3) -> Samples:
        """The rectified picture, as of a pinhole camera whose axis is perpendicular to the baseline."""
        if self._needs_no_rectification:
            return picture
        sensor = self._exposures[side].sensor
        x, y = self._exposures[side].place(*self._rays(side)) / sensor.pixel_pitch
        outside = float(-sensor.columns - sensor.rows)  # outside the field of the lens counts as outside the picture
        place = np.nan_to_num(np.stack([y + (sensor.rows - 1) / 2.0, x + (sensor.columns - 1) / 2.0]), nan=outside)
        return _interpolated(picture, place, order=order)

    def _matched(self, picture: Samples, side: str, power: int = 1) -> Samples:
        """The picture of the finer camera of an unequal pair, or its variance (power 2), with pixels of the coarser.

        The smoothing is Gaussian, with the variance (r² − 1)/12 px² by which pixels r times as wide exceed its own.
        """
        from scipy.ndimage import correlate1d

        ratio = self._scale_of(side) / self._pinhole[0]
        if not self.camera.unequal or ratio <= LARGEST_FOCAL_RATIO:
            return picture
        spread = (ratio * ratio - 1.0) / 12.0
        reach = math.ceil(4.0 * math.sqrt(spread))
        kernel = np.exp(-0.5 * np.square(np.arange(-reach, reach + 1)) / spread)
        # Variances of independent noise add with the squares of the weights.
        kernel = np.power(kernel / kernel.sum(), power)
        for axis in (0, 1):
            picture = correlate1d(picture, kernel, axis=axis, mode="nearest")
        return picture

    def _rays(self, side: str) -> Samples:
        """Rays of the pixels of the rectified camera in the frame of the actual one, shape (3, rows, columns)."""
        c, middle_x, middle_y = self._pinhole
        rows, columns = np.mgrid[: self._grid.rows, : self._grid.columns]
        rays = np.stack([(columns - middle_x) / c, (rows - middle_y) / c, np.ones_like(rows, dtype=float)])
        rotation = np.array(self._exposures[side].pose.rotation)
        return np.asarray(np.einsum("ij,irc->jrc", rotation, rays))

    def truth(self, depths: Mapping[str, Samples], pure: Mapping[str, BoolArray]) -> TrueDepth:
        """True depth in the left picture; measurable where the right picture shows the same surface."""
        left, right = (
            self._true_depth(np.where(pure[side], depths[side], np.nan).astype(np.float64), side) for side in SIDES
        )
        rows, columns = np.indices(left.shape)
        with np.errstate(divide="ignore", invalid="ignore"):
            disparity = self._scale / left
            place = columns - disparity
            inside = (place >= 0.0) & (place <= left.shape[1] - 1) & np.isfinite(left)
            beside = np.rint(np.where(inside, place, 0.0)).astype(np.intp)
            same = np.abs(self._scale / right[rows, beside] - disparity) <= _SAME_SURFACE_PX
        return TrueDepth(depth=left, measurable=inside & same & self.search.includes(left))

    def _true_depth(self, depth: Samples, side: str) -> Samples:
        """True depth along the axis of the rectified camera [m]."""
        if self._needs_no_rectification:
            return depth
        # A point at depth Z along the camera's own axis lies at Z/ray_z along the rectified one, where rays have z = 1.
        return np.asarray(self._parallel(depth, side, order=1) / self._rays(side)[2])


def _moved(picture: Samples, step: int, columns: tuple[int, int]) -> Samples:
    """Columns, from a first one up to another, of a picture moved right by whole pixels; NaN where it shows nothing."""
    first, end = columns[0] - step, columns[1] - step
    moved = np.full((picture.shape[0], end - first), np.nan, picture.dtype)
    low, high = max(0, first), min(picture.shape[1], end)
    if low < high:
        moved[:, low - first : high - first] = picture[:, low:high]
    return moved


def _opencv() -> Any:
    """OpenCV, loaded on first use."""
    try:
        import cv2
    except ImportError:
        raise _without_opencv() from None
    return cv2


def _without_opencv() -> OutOfRangeError:
    return OutOfRangeError(
        "depth from stereo pictures needs OpenCV, which is not installed",
        remedy="install the extra `images` of this program, in its folder: pip install '.[images]'",
    )
