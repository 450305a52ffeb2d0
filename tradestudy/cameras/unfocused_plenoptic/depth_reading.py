"""Depth from the views of an unfocused plenoptic camera: opposite parts of the pupil, matched as pairs of pictures.

In the view through u, a point of disparity s [samples per metre of pupil] is shifted by −u s relative to the central
view. The views through u and −u are compared at the positions predicted by a common s, so that all pairs of views share
the frame of the central view, and each pair has independent noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.depth_map import DepthMap, DepthReader, DepthSearch, FlatPicture, TrueDepth
from tradestudy.cameras.microlens_pictures import Indices, MicrolensGrid, microlens_grid, sampled
from tradestudy.cameras.unfocused_plenoptic.design import UnfocusedPlenoptic
from tradestudy.optics.arrays import BoolArray, Samples
from tradestudy.optics.microlens_coverage import LATTICES
from tradestudy.optics.triangulation import depth_of_inverse
from tradestudy.optics.window_matching import (
    PairOfPictures,
    Reason,
    cubic_weights,
    gradient_along,
    match_windows,
    odd_window,
)

_LEAST_SHARE: Final = 0.5  # of a window that both views must show
_SMOOTHING: Final = 0.8  # samples; finer detail in views is mostly aliased, with wrong disparities
_SAME_SURFACE_PX: Final = 0.5  # difference of disparity, between the outermost views, allowed among neighbours


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewsReader(DepthReader):
    """Depth measured with an unfocused plenoptic camera as designed.

    The map has one value for each microlens, in rows from the top. Every other row of a hexagonal array is interpolated
    by half a pitch, onto a regular grid.

    Parameters
    ----------
    camera, search
        The camera, and the depths to search.
    """

    camera: UnfocusedPlenoptic
    search: DepthSearch

    @cached_property
    def _grid(self) -> MicrolensGrid:
        return microlens_grid(self.camera)

    @cached_property
    def _places(self) -> tuple[Indices, Indices, tuple[int, int]]:
        """Row and column of each microlens on the regular grid, and the shape of the grid."""
        skew, _ = LATTICES[self.camera.microlenses.layout].second_vector
        grid = self._grid
        row = grid.second - grid.low[1]
        column = grid.first + np.floor(skew * grid.second).astype(np.intp)
        column = column - column.min()
        return row, column, (int(row.max()) + 1, int(column.max()) + 1)

    @cached_property
    def _half_pairs(self) -> Samples:
        """One view of each pair of opposite views that the estimator uses [m on the pupil], shape (pairs, 2).

        Views at the rim of the pupil are excluded, because microlenses that are not aligned with pixels lack them.
        """
        views = self.camera.view_positions
        rim = self.camera.main_lens.pupil_diameter / 2.0 - self.camera.view_pupil_diameter
        views = views[np.hypot(*views.T) <= rim]
        if self.camera.estimator == "outermost-views":
            rows = np.abs(views[:, 1])
            middle = views[rows <= rows.min() * (1.0 + 1e-9)]
            return np.asarray(middle[[np.argmax(middle[:, 0])]])
        return np.asarray(views[(views[:, 0] > 0.0) | ((views[:, 0] == 0.0) & (views[:, 1] > 0.0))])

    @property
    def _longest(self) -> float:
        """Baseline [m] for which disparity steps are counted."""
        return 2.0 * float(np.max(np.hypot(*self._half_pairs.T)))

    @property
    def _baseline_ratio(self) -> float:
        """Ratio of that baseline to the estimator's."""
        return self._longest / self.camera.estimator_baseline

    def _view(self, picture: FlatPicture, place: Samples) -> Samples:
        """The view through a position (2,) on the pupil [m], on the regular grid; NaN where missing."""
        camera, grid = self.camera, self._grid
        pixel = place * camera.microlenses.gap / camera.principal_distance / camera.sensor.pixel_pitch
        values = np.where(picture.pure, picture.values, np.float32(np.nan))
        row, column, shape = self._places
        view = np.full(shape, np.nan, np.float32)
        view[row, column] = sampled(values, grid.image_centre + pixel[:, np.newaxis])
        return self._straightened(view)

    def _straightened(self, view: Samples) -> Samples:
        """Rows that the lattice shifts by half a sample, interpolated onto the regular grid by cubics."""
        skew, _ = LATTICES[self.camera.microlenses.layout].second_vector
        if skew == 0.0:
            return view
        odd = np.flatnonzero((np.arange(view.shape[0]) + self._grid.low[1]) % 2 == 1)
        wide = np.pad(view[odd], ((0, 0), (2, 1)), constant_values=np.nan)
        weights = cubic_weights(0.5).astype(view.dtype)
        columns = view.shape[1]
        # Sample j of an odd row lies at j + ½, so position j lies between samples j − 1 and j.
        view[odd] = sum(weights[k] * wide[:, k : k + columns] for k in range(4))
        return view

    def read(self, pictures: Mapping[str, FlatPicture]) -> DepthMap:
        """Depth at every microlens with enough views."""
        camera, picture = self.camera, pictures["raw"]
        middle = self._view(picture, np.zeros(2))
        smooth = _ShiftableView.of(middle)
        template = np.where(smooth.seen, smooth.at(np.zeros(2)), np.float32(np.nan))
        pairs = [self._pair(picture, template, u) for u in self._half_pairs]
        ends = np.sort(camera.disparity_px(np.array([self.search.near, self.search.far])) * self._baseline_ratio)
        steps = range(math.floor(ends[0]) - 2, math.floor(ends[1]) + 4)
        matches = match_windows(
            pairs,
            steps,
            window=odd_window(self.search.window_px),
            least_share=_LEAST_SHARE,
            largest_deviation=self.search.largest_deviation_px * min(1.0, self._baseline_ratio),
        )
        reason = matches.reason
        reason[np.isnan(middle)] = Reason.NO_LIGHT
        disparity = np.where(reason == Reason.MEASURED, matches.disparity, np.nan) / self._baseline_ratio
        deviation = np.where(reason == Reason.MEASURED, matches.deviation, np.nan) / self._baseline_ratio
        depth = self._depth(disparity * camera.sample_pitch)
        reason[(reason == Reason.MEASURED) & ~np.isfinite(depth)] = Reason.OUT_OF_RANGE
        depth = np.where(reason == Reason.MEASURED, depth, np.nan)
        rate = camera.sample_pitch / (camera.estimator_baseline * camera.principal_distance)
        return DepthMap(
            depth=depth,
            deviation=deviation * rate * np.square(camera.from_pupil(depth)),
            disparity_deviation=deviation,
            reason=reason,
        )

    def _depth(self, disparity: Samples) -> Samples:
        """Depth [m] from disparities [m] at the microlenses of the regular grid; infinite at and beyond infinity."""
        camera = self.camera
        if camera.is_centred:
            return camera.depth_of_disparity(disparity, self.search.far)
        row, column, shape = self._places
        x, y = np.full((2, *shape), np.nan)
        x[row, column], y[row, column] = self._grid.on_sensor(self._grid.centre)
        seen = [np.asarray(values, np.float64) for values in (disparity, self._straightened(x), self._straightened(y))]
        inverse, valid = camera.believe({}, (seen[0], seen[1], seen[2]), self.search.far)
        return depth_of_inverse(np.where(valid, inverse, np.nan))

    def _pair(self, picture: FlatPicture, template: Samples, place: Samples) -> PairOfPictures:
        """The views through a position on the pupil and the opposite one."""
        first, second = (_ShiftableView.of(self._view(picture, position)) for position in (-place, place))
        # The noise varies so slowly over the picture that it need not be shifted with the views.
        noisy = replace(picture, values=picture.variance)
        variance = self._view(noisy, -place) + self._view(noisy, place)
        rise = LATTICES[self.camera.microlenses.layout].second_vector[1]  # row spacing over column spacing
        per_step = place / self._longest * np.array([1.0, 1.0 / rise])
        gradient = gradient_along(template, (-2.0 * float(per_step[0]), -2.0 * float(per_step[1])))

        def difference(step: int) -> tuple[Samples, Samples, BoolArray]:
            change = second.at(-per_step * step) - first.at(per_step * step)
            return change, variance, first.seen & second.seen

        return PairOfPictures(gradient=gradient, difference=difference)

    def truth(self, depths: Mapping[str, Samples], pure: Mapping[str, BoolArray]) -> TrueDepth:
        """True depth in the central view; measurable away from depth discontinuities."""
        from scipy.ndimage import maximum_filter, minimum_filter

        row, column, shape = self._places
        x, y = np.rint(self._grid.image_centre).astype(np.intp)
        raw = np.where(pure["raw"], depths["raw"], np.nan)
        inside = (x >= 0) & (y >= 0) & (x < raw.shape[1]) & (y < raw.shape[0])
        on_grid = np.full(shape, np.nan)
        on_grid[row[inside], column[inside]] = raw[y[inside], x[inside]]
        depth = self._straightened(on_grid)
        within = self.search.includes(depth)
        disparity = self.camera.disparity_px(np.where(within, depth, self.search.far)) * self._baseline_ratio
        smooth = maximum_filter(disparity, 3) - minimum_filter(disparity, 3) <= _SAME_SURFACE_PX
        return TrueDepth(depth=depth, measurable=within & smooth)


@dataclass(frozen=True, kw_only=True, eq=False)
class _ShiftableView:
    """A view, stored as the spectrum of its even extension, that can be shifted by fractions of a sample without blur.

    Views sample their texture coarsely. Local interpolation would blur them after shifts by fractions of a sample but
    not by whole samples, and thus bias every disparity away from whole samples.

    Parameters
    ----------
    spectrum
        Spectrum of the extension.
    seen
        Where samples and their neighbours exist, shape (rows, columns).
    """

    spectrum: NDArray[np.complex64]
    seen: BoolArray

    @classmethod
    def of(cls, view: Samples) -> _ShiftableView:
        """Prepare a view; missing samples are filled from the nearest ones."""
        from scipy import fft
        from scipy.ndimage import binary_erosion, distance_transform_edt

        present = np.isfinite(view)
        if np.any(present):
            nearest = distance_transform_edt(~present, return_distances=False, return_indices=True)
            view = view[nearest[0], nearest[1]]
        even = np.concatenate([view, view[::-1]])
        even = np.concatenate([even, even[:, ::-1]], axis=1)
        across, down = fft.rfftfreq(even.shape[1]), fft.fftfreq(even.shape[0])[:, np.newaxis]
        passed = np.exp(-2.0 * np.square(np.pi * _SMOOTHING) * (np.square(across) + np.square(down)))
        spectrum = fft.rfft2(even.astype(np.float32)) * passed.astype(np.float32)
        return cls(spectrum=spectrum, seen=binary_erosion(present, np.ones((3, 3), bool)))

    def at(self, move: Samples) -> Samples:
        """The view shifted by (x, y) [samples]: each position takes the value at that offset."""
        from scipy import fft

        rows, columns = self.seen.shape
        across, down = (fft.rfftfreq(2 * columns), fft.fftfreq(2 * rows))
        turn = np.exp(2j * np.pi * move[1] * down)[:, np.newaxis] * np.exp(2j * np.pi * move[0] * across)
        shifted = fft.irfft2(self.spectrum * turn.astype(np.complex64), s=(2 * rows, 2 * columns))
        return np.asarray(shifted[:rows, :columns], np.float32)
