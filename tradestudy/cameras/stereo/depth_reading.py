"""Depth from two pictures: OpenCV finds disparity to whole pixels, and matching of windows refines it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Any, Final, Literal

import numpy as np

from tradestudy.cameras.depth_map import DepthMap, DepthReader, DepthSearch, FlatPicture, TrueDepth
from tradestudy.cameras.light_cones import AT_ORIGIN, Description
from tradestudy.cameras.single_lens_exposure import SingleLensExposure
from tradestudy.cameras.stereo.design import StereoRig
from tradestudy.cameras.stereo.pair import SIDES
from tradestudy.cameras.stereo.row_alignment import row_alignment
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, Samples
from tradestudy.optics.lens_model import IDEAL
from tradestudy.optics.window_matching import (
    Matches,
    PairOfPictures,
    Reason,
    gradient_along,
    match_windows,
    odd_window,
)

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
    frame of the rectified left picture. Finally, rows that are displaced by errors of the rig are aligned.

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
        return {one.name: one for one in self.camera.exposures(self.search.far, {}, None, 0.0)}

    @cached_property
    def _pinhole(self) -> tuple[float, float, float]:
        """Principal distance and principal point of both rectified cameras [px].

        They have the mean scale on the axis, and the mean of what the middles of both sensors see in their middle.
        """
        sensor, seen = self.camera.sensor, []
        for one in self._exposures.values():
            cones = one.cones(np.zeros(1), np.zeros(1))
            x, y, z = np.array(one.pose.rotation) @ np.append(cones.slope[:, 0], 1.0)
            seen.append((x / z, y / z))
        scales = [math.sqrt(math.prod(one.scales)) * one.distortion.scale_on_axis for one in self._exposures.values()]
        c = float(np.mean(scales)) / sensor.pixel_pitch
        across, down = np.mean(seen, axis=0)
        return c, (sensor.columns - 1) / 2.0 - c * float(across), (sensor.rows - 1) / 2.0 - c * float(down)

    @property
    def _scale(self) -> float:
        """Product of disparity and depth [px m] in rectified pictures."""
        left, right = (np.array(self._exposures[side].pose.centre) for side in SIDES)
        return self._pinhole[0] * float(np.linalg.norm(right - left))

    @property
    def _steps(self) -> range:
        """Disparities to search [px], at most the width of a picture and the search range of the rig's matcher."""
        first = math.floor(self._scale / self.search.far) - 2
        last = min(math.floor(self._scale / self.search.near) + 4, self.camera.sensor.columns)
        if self.camera.disparity_range_px is not None:
            last = min(last, math.floor(self.camera.disparity_range_px) + 1)
        return range(first, max(last, first + 4))

    def _depth(self, disparity: Samples) -> Samples:
        """Depth [m] from disparities in rectified pictures [px]."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.where(disparity > 0.0, self._scale / disparity, np.inf))

    def frame(self) -> Description:
        """The rectified left camera."""
        c, x, y = self._pinhole
        sensor = self.camera.sensor
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
            self._parallel(np.where(pictures[side].pure, pictures[side].values, np.nan), side) for side in SIDES
        )
        noise = [
            self._parallel(np.where(pictures[side].pure, pictures[side].variance, np.nan), side, order=1)
            for side in SIDES
        ]
        aligned = row_alignment(left, right, self._steps, _opencv())
        right, noise[1] = aligned(right), aligned(noise[1])
        start = self._whole_pixels(left, right)
        disparity, deviation = np.full_like(left, np.nan), np.full_like(left, np.nan)
        reason = np.zeros(left.shape, np.uint8)
        for top, begin in itertools.product(range(0, left.shape[0], _TILE), range(0, left.shape[1], _TILE)):
            own = (slice(top, top + _TILE), slice(begin, begin + _TILE))
            found = self._tile((left, noise[0]), (right, noise[1]), start, own)
            disparity[own], deviation[own], reason[own] = found.disparity, found.deviation, found.reason
        unknown = ~np.isfinite(start)
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
        own: tuple[slice, slice],
    ) -> Matches:
        """Disparity in a part of the left picture, to fractions of a pixel, from both pictures and their variances.

        Only steps near those of semi-global matching are computed, which are few in so small a part.
        """
        window = odd_window(self.search.window_px)
        low, high = (max(0, one.start - window) for one in own), (one.stop + window for one in own)
        rows, columns = (slice(*ends) for ends in zip(low, high, strict=True))
        picture, variance, start = (one[rows, columns] for one in (*left, start))
        across = (columns.start, columns.start + picture.shape[1])
        other, other_variance = (one[rows] for one in right)

        def difference(step: int) -> tuple[Samples, Samples, BoolArray]:
            found = _moved(other, step, across) - picture
            return found, variance + _moved(other_variance, step, across), np.isfinite(found)

        found = match_windows(
            [PairOfPictures(gradient=gradient_along(picture, (-1.0, 0.0)), difference=difference)],
            self._near(start),
            window=window,
            least_share=_LEAST_SHARE,
            largest_deviation=self.search.largest_deviation_px,
            start=start,
        )
        first = [one.start - part.start for one, part in zip(own, (rows, columns), strict=True)]
        inner = tuple(slice(k, k + _TILE) for k in first)
        return Matches(disparity=found.disparity[inner], deviation=found.deviation[inner], reason=found.reason[inner])

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
        both = np.concatenate([left.ravel(), right.ravel()])
        dark, bright = np.nanpercentile(both, (1.0, 99.0))
        scale = (_GREYS[1] - _GREYS[0]) / max(float(bright - dark), 1e-12)
        count = -(-len(steps) // _OPENCV_STEP) * _OPENCV_STEP
        # OpenCV skips pixels so close to the left edge that some disparities would leave the right picture.
        margin = max(0, steps[0] + count)
        greys = [
            np.pad(
                np.clip(np.nan_to_num(_GREYS[0] + (one - dark) * scale), 0, 255).astype(np.uint8),
                ((0, 0), (margin, 0)),
            )
            for one in (left, right)
        ]
        block = min(odd_window(self.search.window_px), _LARGEST_BLOCK)
        matcher = cv2.StereoSGBM_create(
            minDisparity=steps[0],
            numDisparities=count,
            blockSize=block,
            P1=8 * block**2,
            P2=32 * block**2,
            disp12MaxDiff=1,
            uniquenessRatio=5,
        )
        found = np.asarray(matcher.compute(*greys), np.float32)[:, margin:] / _OPENCV_STEP
        return np.where(found >= steps[0], found, np.nan)

    @cached_property
    def _needs_no_rectification(self) -> bool:
        """Whether the pictures are rectified as taken."""
        rectified = {
            one.pose.rotation == AT_ORIGIN.rotation and one.distortion == IDEAL and one.principal_point == (0.0, 0.0)
            for one in self._exposures.values()
        }
        scales = {scale for one in self._exposures.values() for scale in one.scales}
        return rectified == {True} and len(scales) == 1

    def _parallel(self, picture: Samples, side: str, order: Literal[1, 3] = 3) -> Samples:
        """The rectified picture, as of a pinhole camera whose axis is perpendicular to the baseline."""
        if self._needs_no_rectification:
            return picture
        from scipy.ndimage import map_coordinates

        sensor = self.camera.sensor
        x, y = self._exposures[side].place(*self._rays(side)) / sensor.pixel_pitch
        outside = float(-sensor.columns - sensor.rows)  # outside the field of the lens counts as outside the picture
        place = np.nan_to_num(np.stack([y + (sensor.rows - 1) / 2.0, x + (sensor.columns - 1) / 2.0]), nan=outside)
        missing = map_coordinates(np.isnan(picture).astype(np.float32), place, order=1, mode="constant", cval=1.0)
        found = map_coordinates(np.nan_to_num(picture).astype(np.float32), place, order=order, mode="nearest")
        return np.where(missing > 0.0, np.nan, found).astype(picture.dtype)

    def _rays(self, side: str) -> Samples:
        """Rays of the pixels of the rectified camera in the frame of the actual one, shape (3, rows, columns)."""
        c, middle_x, middle_y = self._pinhole
        rows, columns = np.mgrid[: self.camera.sensor.rows, : self.camera.sensor.columns]
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
