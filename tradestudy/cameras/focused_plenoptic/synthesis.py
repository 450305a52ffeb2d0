"""Pictures synthesised from a raw one: refocused, seen from other positions on the pupil, or sharp throughout.

An object of virtual depth v appears on the array at Y through the centre of the pupil, and the microlens at c images
it ``(c − Y)(1/v − b_L/z)`` from the centre of its micro-image. From a position u on the pupil it appears at C instead
of Y, and its image lies ``(c − C)(1/v − b_L/z) + u b_L/z`` from there. Lengths are in pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from tradestudy.cameras.depth_map import DepthMap, DepthSearch, FlatPicture
from tradestudy.cameras.focused_plenoptic.design import FocusedPlenoptic
from tradestudy.cameras.microlens_pictures import Indices, MicrolensGrid, microlens_grid, sampled
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, Samples

SAMPLE_PX: Final = 2
"""Sensor pixels per pixel of the synthesised picture: micro-images are demagnified by 2 or more."""
_VIEW_REACH: Final = 1.0  # pitches from a position in a view within which microlenses contribute


@dataclass(frozen=True, kw_only=True, eq=False)
class RawPictureSynthesis:
    """Synthesis of pictures from one raw picture.

    Parameters
    ----------
    camera, search
        The camera as designed, and the distances to which pictures can be refocused.
    picture
        The raw picture.
    """

    camera: FocusedPlenoptic
    search: DepthSearch
    picture: FlatPicture

    @cached_property
    def _grid(self) -> MicrolensGrid:
        return microlens_grid(self.camera)

    @property
    def _over(self) -> float:
        """Ratio b_L/z of array gap to array distance."""
        return self.camera.microlenses.gap / self.camera.mla_distance

    @cached_property
    def _middle(self) -> Samples:
        """Centre of the sensor [px], shape (2, 1)."""
        sensor = self.camera.sensor
        return np.array([[sensor.columns], [sensor.rows]]) / 2.0 - 0.5

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a synthesised picture."""
        sensor = self.camera.sensor
        return sensor.rows // SAMPLE_PX, sensor.columns // SAMPLE_PX

    @cached_property
    def _places(self) -> Samples:
        """Positions of all samples on the array [sensor px], shape (2, samples)."""
        rows, columns = np.indices(self.shape)
        at = np.stack([columns.ravel(), rows.ravel()]) * float(SAMPLE_PX) + (SAMPLE_PX - 1) / 2.0
        return np.asarray(at)

    def refocused(self, distance: float) -> Samples:
        """The picture through the whole pupil, refocused on a distance [m]; NaN where no microlens contributes.

        Raises
        ------
        OutOfRangeError
            The distance lies outside the searched range.
        """
        if not self.search.near <= distance <= self.search.far:
            raise OutOfRangeError(
                "refocus distance",
                value=f"{distance:g} m",
                limit=f"{self.search.near:g} to {self.search.far:g} m",
                remedy="choose a distance within the searched range",
            )
        inverse = 1.0 / float(self.camera.virtual_depth(np.array([distance]))[0])
        reach = self._grid.radius / max(abs(inverse - self._over), 1e-6)
        return self._gathered(np.full(self.shape, inverse), (0.0, 0.0), reach, is_view=False)

    def view(self, depth: Samples, place: tuple[float, float] = (0.0, 0.0)) -> Samples:
        """The scene as seen from a position on the pupil [m]; sharp where the depth [m] is correct.

        Parameters
        ----------
        depth
            Depth of the samples of this view, for example from `filled_depth`.
        place
            x and y, inside the pupil.

        Raises
        ------
        OutOfRangeError
            The position lies outside the pupil.
        """
        radius = self.camera.main_lens.pupil_diameter / 2.0
        if not np.hypot(*place) < radius:
            raise OutOfRangeError(
                "distance of a view from the centre of the pupil",
                value=f"{np.hypot(*place) * 1e3:g} mm",
                limit=f"below {radius * 1e3:g} mm",
                remedy="move it towards the centre",
            )
        reach = _VIEW_REACH * float(np.linalg.norm(self._grid.basis[:, 0]))
        return self._gathered(1.0 / self.camera.virtual_depth(depth), place, reach, is_view=True)

    def filled_depth(self, found: DepthMap) -> Samples:
        """Depth of every sample [m] for `view`: smoothed measurements, with gaps filled from the nearest sample.

        Raises
        ------
        OutOfRangeError
            The map contains no depth.
        """
        from scipy.ndimage import distance_transform_edt, median_filter

        rows, columns = np.nonzero(np.isfinite(found.depth))
        if not rows.size:
            raise OutOfRangeError(
                "number of depths in the map", value="0", limit="1 or more", remedy="use a scene with texture"
            )
        depth = np.asarray(found.depth[rows, columns], np.float64)
        inverse = 1.0 / self.camera.virtual_depth(depth)
        at = np.stack([columns, rows]).astype(float)
        centre = self._grid.image_centre[:, self._nearest(at, image=True)]
        on_array = (centre - self._middle) / (1.0 + self._over) + self._middle
        place = on_array - (at - centre) / (inverse - self._over)
        x, y = np.rint((place - (SAMPLE_PX - 1) / 2.0) / SAMPLE_PX).astype(np.intp)
        inside = (x >= 0) & (y >= 0) & (x < self.shape[1]) & (y < self.shape[0])
        total, count = np.zeros(self.shape), np.zeros(self.shape)
        np.add.at(total, (y[inside], x[inside]), depth[inside])
        np.add.at(count, (y[inside], x[inside]), 1.0)
        missing = count == 0.0
        nearest = distance_transform_edt(missing, return_distances=False, return_indices=True)
        mean = np.divide(total, count, out=np.zeros(self.shape), where=~missing)
        return np.asarray(median_filter(mean[nearest[0], nearest[1]], 5))

    def _nearest(self, at: Samples, *, image: bool) -> Indices:
        """The microlens (−1: none) nearest to positions on the array or, by its micro-image, on the sensor [px]."""
        grid = self._grid
        scale = 1.0 + self._over if image else 1.0
        first, second = np.rint(np.linalg.solve(grid.basis, (at - self._middle) / scale)).astype(np.intp)
        return self._numbered(first, second)

    def _numbered(self, first: Indices, second: Indices) -> Indices:
        grid = self._grid
        i, j = first - grid.low[0], second - grid.low[1]
        there = (i >= 0) & (j >= 0) & (i < grid.index.shape[0]) & (j < grid.index.shape[1])
        return np.where(there, grid.index[np.where(there, i, 0), np.where(there, j, 0)], -1)

    def _gathered(
        self, inverse_virtual_depth: Samples, place: tuple[float, float], reach: float, *, is_view: bool
    ) -> Samples:
        """Mean over the microlenses within reach [px] of each sample; in a view, nearer ones have greater weight."""
        grid, at = self._grid, self._places
        values = np.where(self.picture.pure, self.picture.values, np.float32(np.nan))
        turn = (inverse_virtual_depth - self._over).ravel()
        shift = np.array(place)[:, np.newaxis] * self._over / self.camera.sensor.pixel_pitch
        first, second = np.rint(np.linalg.solve(grid.basis, at - self._middle)).astype(np.intp)
        pitch = float(np.linalg.norm(grid.basis[:, 0]))
        span = int(np.ceil(1.2 * (reach / pitch + 1.0)))
        total, weight = np.zeros(turn.size), np.zeros(turn.size)
        for i in range(-span, span + 1):
            for j in range(-span, span + 1):
                if np.linalg.norm(grid.basis @ np.array([i, j])) > reach + pitch:
                    continue
                lens = self._numbered(first + i, second + j)
                beside = grid.centre[:, lens] - at
                offset = beside * turn + shift
                far = np.hypot(*beside)
                used: BoolArray = (lens >= 0) & (far <= reach) & (np.hypot(*offset) <= grid.radius)
                seen = np.full(turn.size, np.nan)
                seen[used] = sampled(values, grid.image_centre[:, lens[used]] + offset[:, used])
                share = np.where(np.isfinite(seen), np.maximum(1.0 - far / reach, 1e-3) if is_view else 1.0, 0.0)
                total += share * np.nan_to_num(seen)
                weight += share
        return np.where(weight > 0.0, total / np.where(weight > 0.0, weight, 1.0), np.nan).reshape(self.shape)
