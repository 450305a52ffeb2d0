"""Depth from a raw picture, by matching the micro-images that the declared estimator pairs.

An object of virtual depth v appears on the array at Y through the centre of the pupil, and the microlens at c images
it ``(c − Y)(1/v − b_L/z)`` from the centre of its micro-image. From a position u on the pupil it appears at C instead
of Y, and its image lies ``(c − C)(1/v − b_L/z) + u b_L/z`` from there. Lengths are in pixels.

Micro-images are sampled so coarsely that detail near the resolution limit is mostly aliased. Interpolated along the
oblique directions of the lattice, aliased detail biases every disparity towards certain fractions of a pixel (pixel
locking). The bias depends on the direction, so that it becomes noise when directions are combined. Micro-images are
therefore slightly smoothed before they are compared, which halves the bias and costs little texture.
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
from tradestudy.cameras.depth_measurement import places_within
from tradestudy.cameras.focused_plenoptic.design import FocusedPlenoptic
from tradestudy.cameras.focused_plenoptic.estimator import neighbour_distance
from tradestudy.cameras.focused_plenoptic.focus import NO_SCALING
from tradestudy.cameras.microlens_pictures import (
    MARGIN,
    Indices,
    MicrolensGrid,
    microlens_grid,
    moved,
    sampled,
    smoothed,
    squares,
    with_correlated_noise,
)
from tradestudy.errors import OutOfRangeError
from tradestudy.execution.executor import tell
from tradestudy.optics.arrays import BoolArray, Samples
from tradestudy.optics.two_apertures import centroid_of_common_part
from tradestudy.optics.window_matching import (
    Matches,
    PairOfPictures,
    Reason,
    gradient_along,
    match_windows,
    odd_window,
)

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
        """Ratio b_L/z of array gap to the distance of the pupil."""
        return float(self.camera.geometry.image_spread({}))

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

    def filled_depth(self, depth_map: DepthMap) -> Samples:
        """Depth of every sample [m] for `view`: smoothed measurements, with gaps filled from the nearest sample.

        Raises
        ------
        OutOfRangeError
            The map contains no depth.
        """
        from scipy.ndimage import distance_transform_edt, median_filter

        rows, columns = np.nonzero(np.isfinite(depth_map.depth))
        if not rows.size:
            raise OutOfRangeError(
                "number of depths in the map", value="0", limit="1 or more", remedy="use a scene with texture"
            )
        depth = np.asarray(depth_map.depth[rows, columns], np.float64)
        inverse = 1.0 / self.camera.virtual_depth(depth)
        at = np.stack([columns, rows]).astype(float)
        grid, lens = self._grid, self._nearest(at, image=True)
        place = grid.centre[:, lens] - (at - grid.image_centre[:, lens]) / (inverse - self._over)
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
        away = (at - grid.image_middle) / (1.0 + self._over) if image else at - grid.middle
        first, second = np.rint(np.linalg.solve(grid.basis, away)).astype(np.intp)
        return grid.numbered(first, second)

    def _gathered(
        self, inverse_virtual_depth: Samples, place: tuple[float, float], reach: float, *, is_view: bool
    ) -> Samples:
        """Mean over the microlenses within reach [px] of each sample; in a view, nearer ones have greater weight."""
        grid, at = self._grid, self._places
        values = np.where(self.picture.pure, self.picture.values, np.float32(np.nan))
        turn = (inverse_virtual_depth - self._over).ravel()
        narrower = self.camera.microlenses.gap / self.camera.principal_distance
        shift = np.array(place)[:, np.newaxis] * narrower / self.camera.sensor.pixel_pitch
        first, second = np.rint(np.linalg.solve(grid.basis, at - grid.middle)).astype(np.intp)
        pitch = float(np.linalg.norm(grid.basis[:, 0]))
        span = int(np.ceil(1.2 * (reach / pitch + 1.0)))
        total, weight = np.zeros(turn.size), np.zeros(turn.size)
        for i in range(-span, span + 1):
            for j in range(-span, span + 1):
                if np.linalg.norm(grid.basis @ np.array([i, j])) > reach + pitch:
                    continue
                lens = grid.numbered(first + i, second + j)
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


_LENSES_AT_ONCE: Final = 400  # microlenses, so that one step fits into the cache
_PIXELS_AT_ONCE: Final = 500_000  # pixels whose depth is computed at once, to save memory
_LEAST_SHARE: Final = 0.15  # of a window that both micro-images must show
_LARGEST_DISAGREEMENT: Final = 4.0  # standard deviations by which matches of one point may differ
_VIEW_SHIFT: Final = 0.25  # of the pupil diameter, by which views are shifted
_TABLE_RADII: Final = 2048  # number of radii in the table of centroids
_SAME_SURFACE_PX: Final = 0.5  # difference of disparity allowed between the two pixels that show a point
Step = tuple[int, int]


@dataclass(frozen=True, kw_only=True, eq=False)
class RawPictureReader(DepthReader):
    """Depth measured with a focused plenoptic camera as designed.

    Parameters
    ----------
    camera, search
        The camera, and the depths to search.
    """

    camera: FocusedPlenoptic
    search: DepthSearch

    @cached_property
    def _grid(self) -> MicrolensGrid:
        return microlens_grid(self.camera)

    @cached_property
    def _inverse_virtual_depths(self) -> Samples:
        """1/v at the searched distances; decreases with distance."""
        v = self.camera.virtual_depth(self.search.distances)
        inverse = 1.0 / v
        if not (np.all(np.isfinite(inverse)) and np.all(v * v[0] > 0.0)):
            raise OutOfRangeError(
                "the searched depths lie on both sides of the plane that is imaged onto the microlens array",
                value=f"{self.search.near:g} to {self.search.far:g} m",
                limit="one side",
                remedy="narrow scene.distances, or move the total covering plane",
            )
        return np.asarray(inverse)

    @cached_property
    def _rendered(self) -> Samples:
        """1/v of objects at the searched distances in rendered pictures, which have no depth scaling."""
        return np.asarray(1.0 / replace(self.camera, depth_scaling=NO_SCALING).virtual_depth(self.search.distances))

    @cached_property
    def _searched(self) -> Samples:
        """Smallest and largest 1/v that objects at the searched distances have anywhere in the picture."""
        ends = np.append(self._inverse_virtual_depths[[0, -1]], self._rendered[[0, -1]])
        if not self.camera.is_centred:
            distances = self.search.distances[[0, -1]]
            apart = np.stack([self.camera.observe_at(distances, place)[0] for place in places_within(1.0)])
            ends = np.append(ends, apart / self.camera.estimator_baseline(distances) - 1.0)
        return np.array([np.nanmin(ends), np.nanmax(ends)])

    @cached_property
    def _steps(self) -> tuple[Step, ...]:
        """Lattice steps from a microlens to those that the estimator compares with it, including opposite steps."""
        camera, grid = self.camera, self._grid
        array = camera.microlenses
        same_type = camera.lenses == "sharpest-type" and array.types > 1
        least = float(np.min(np.abs(self._inverse_virtual_depths)))
        reach = 2.0 * grid.radius / max(least - float(camera.geometry.image_spread({})), 1e-9)
        if camera.estimator in ("adjacent-pair", "same-type-pair"):
            reach = neighbour_distance(camera.estimator, array) / camera.sensor.pixel_pitch * (1.0 + 1e-6)
        span = math.ceil(2.0 * reach / np.linalg.norm(grid.basis[:, 0]))
        steps = [
            (i, j)
            for i in range(-span, span + 1)
            for j in range(-span, span + 1)
            if (i, j) != (0, 0) and self._length((i, j)) <= reach and (not same_type or (i - j) % array.types == 0)
        ]
        return tuple(sorted(steps, key=self._length))

    def _length(self, step: Step) -> float:
        """Baseline of a step [px]."""
        return float(np.linalg.norm(self._grid.basis @ np.array(step)))

    @cached_property
    def _sharpest(self) -> NDArray[np.intp]:
        """Sharpest type at each searched distance."""
        return np.asarray(np.argmin(self.camera.blur_px(self.search.distances), axis=0))

    @cached_property
    def _types(self) -> NDArray[np.intp]:
        """Type of each microlens."""
        types = self.camera.microlenses.types
        return np.asarray((self._grid.first - self._grid.second) % types)

    @property
    def _by_type(self) -> bool:
        return self.camera.lenses == "sharpest-type" and self.camera.microlenses.types > 1

    @cached_property
    def _used(self) -> Indices:
        """Microlenses of the types that are sharpest at any of the searched distances."""
        if not self._by_type:
            return np.arange(self._grid.first.size)
        return np.flatnonzero(np.isin(self._types, np.unique(self._sharpest)))

    def read(self, pictures: Mapping[str, FlatPicture]) -> DepthMap:
        """Depth of every pixel whose object point the estimator finds in a second micro-image."""
        picture = pictures["raw"]
        values = smoothed(squares(self._grid, picture.values, picture.pure))
        variance = squares(self._grid, picture.variance, picture.pure)
        matches = {}
        for number, step in enumerate(self._steps):
            tell(number / len(self._steps))
            matches[step] = self._matches(step, values, variance)
        for step in self._steps:
            opposite = matches[-step[0], -step[1]]
            self._reject_contradicted(step, matches[step], opposite)
        inverse, deviation, reason = self._combined(matches)
        return self._on_sensor(picture, inverse, deviation, reason)

    def made_of(self, pictures: Mapping[str, FlatPicture], depth_map: DepthMap, middle: float) -> dict[str, Samples]:
        """Pictures refocused on the middle of the scene, sharp throughout, and seen from the left and the right."""
        synthesis = RawPictureSynthesis(camera=self.camera, search=self.search, picture=pictures["raw"])
        made = {"refocused": synthesis.refocused(middle)} if self.search.near <= middle <= self.search.far else {}
        if np.any(np.isfinite(depth_map.depth)):
            depth, aside = synthesis.filled_depth(depth_map), _VIEW_SHIFT * self.camera.main_lens.pupil_diameter
            made["all_in_focus"] = synthesis.view(depth)
            made["view_left"] = synthesis.view(depth, (-aside, 0.0))
            made["view_right"] = synthesis.view(depth, (aside, 0.0))
        return made

    def _matches(self, step: Step, values: Samples, variance: Samples) -> Matches:
        """Matches of all used microlenses with those a step away; disparities along the step [px]."""
        grid, used = self._grid, self._used
        shape = (used.size, grid.side, grid.side)
        matches = Matches(
            disparity=np.full(shape, np.nan, np.float32),
            deviation=np.full(shape, np.nan, np.float32),
            reason=np.full(shape, Reason.NO_PARTNER, np.uint8),
        )
        partner = grid.beside(step)
        paired = np.flatnonzero(partner[used] >= 0)
        for begin in range(0, paired.size, _LENSES_AT_ONCE):
            part = paired[begin : begin + _LENSES_AT_ONCE]
            matched = self._matched(step, used[part], partner[used[part]], values, variance)
            matches.disparity[part], matches.deviation[part] = matched.disparity, matched.deviation
            matches.reason[part] = matched.reason
        return matches

    def _matched(self, step: Step, lenses: Indices, partners: Indices, values: Samples, variance: Samples) -> Matches:
        grid = self._grid
        move = grid.basis @ np.array(step)
        length = self._length(step)
        along = move / length
        inner = slice(MARGIN, -MARGIN)
        gradient = gradient_along(values[lenses], (float(along[0]), float(along[1])))[:, inner, inner]
        window = odd_window(self.search.window_px)
        reference = values[lenses, inner, inner]
        base = grid.corner[:, lenses] - grid.corner[:, partners] + move[:, np.newaxis] + MARGIN
        ends = length * self._searched
        steps = range(math.floor(ends[0]) - 2, math.floor(ends[1]) + 4)

        place = grid.corner[:, lenses] - grid.image_centre[:, lenses]
        arrives = grid.corner[:, lenses] + move[:, np.newaxis] - grid.image_centre[:, partners]
        own_shift = self._shift_along(place, lenses, along)

        def difference(k: int) -> tuple[Samples, Samples, BoolArray]:
            step_along = (along * k)[:, np.newaxis]
            change = moved(values, partners, base + step_along, grid.side) - reference
            shift = self._shift_along(arrives + step_along, partners, along) * self._defocus(partners, k / length)
            shift -= own_shift * self._defocus(lenses, k / length)
            noise = variance[lenses, inner, inner] + moved(variance, partners, base + step_along, grid.side)
            return change + gradient * shift, noise, np.isfinite(change)

        return match_windows(
            [
                PairOfPictures(
                    gradient=gradient, difference=difference, noise_gradient=with_correlated_noise(gradient, window)
                )
            ],
            steps,
            window=window,
            least_share=_LEAST_SHARE,
            largest_deviation=self.search.largest_deviation_px,
        )

    def _defocus(self, lenses: Indices, inverse_virtual_depth: float) -> Samples:
        """Ratio of a ray's distance from the chief ray on the sensor to its height on the microlens."""
        focal_lengths = np.asarray(self.camera.microlenses.focal_lengths)[self._types[lenses]]
        ratio = 1.0 - self._grid.gap[lenses] / focal_lengths + inverse_virtual_depth
        return np.asarray(ratio, np.float32)[:, np.newaxis, np.newaxis]

    @cached_property
    def _centroid_ratios(self) -> Samples:
        """Centroid on the microlens of the light that reaches a pixel, as a multiple of the pixel's position, by type.

        Away from the centre of a micro-image, the pupil vignettes the cone of light on one side. The centroid of a
        defocused point is then off its chief ray, in opposite directions in two micro-images, which would bias every
        disparity.
        """
        camera = self.camera
        array, pixel = camera.microlenses, camera.sensor.pixel_pitch
        radius = (np.arange(_TABLE_RADII) + 0.5) / _TABLE_RADII * self._table_end
        ratios = []
        for f in array.focal_lengths:
            # The pupil, projected from the pixel onto the microlens.
            scale = camera.main_lens.pupil_ratio + camera.principal_distance * (1.0 / array.gap - 1.0 / f)
            scale = math.copysign(max(abs(scale), 1e-6), scale)
            apart = radius * pixel * camera.principal_distance / array.gap / scale
            middle = centroid_of_common_part(
                np.abs(apart), array.aperture_diameter / 2.0, camera.main_lens.pupil_diameter / 2.0 / abs(scale)
            )
            ratios.append(np.sign(scale) * np.nan_to_num(middle) / pixel / radius)
        return np.array(ratios, np.float32)

    def _shift_along(self, place: Samples, lenses: Indices, along: Samples) -> Samples:
        """Centroid of the light on the microlens along a direction [px], for all pixels of squares at `place`."""
        line = np.arange(self._grid.side)
        x, y = ((place[k][:, np.newaxis] + line).astype(np.float32) for k in (0, 1))
        distance = np.sqrt(np.square(x)[:, np.newaxis, :] + np.square(y)[:, :, np.newaxis])
        bins = np.minimum(distance * np.float32(_TABLE_RADII / self._table_end), _TABLE_RADII - 1).astype(np.intp)
        ratio = self._centroid_ratios.ravel()[bins + (_TABLE_RADII * self._types[lenses])[:, np.newaxis, np.newaxis]]
        across, down = (np.float32(component) for component in along)
        return np.asarray(ratio * (across * x[:, np.newaxis, :] + down * y[:, :, np.newaxis]))

    @property
    def _table_end(self) -> float:
        """Largest distance of the pixels of a square from the centre of its micro-image [px]."""
        return 3.0 * self._grid.radius

    def _reject_contradicted(self, step: Step, forth: Matches, back: Matches) -> None:
        """Reject matches that the reverse match contradicts."""
        row, y, x = np.nonzero(forth.reason == Reason.MEASURED)
        d = forth.disparity[row, y, x]
        partner, px, py = self._partner(step, row, x, y, d)
        ok = (partner >= 0) & (px >= 0) & (py >= 0) & (px < forth.disparity.shape[2]) & (py < forth.disparity.shape[1])
        row, y, x, partner, px, py = (indices[ok] for indices in (row, y, x, partner, px, py))
        apart = np.abs(back.disparity[partner, py, px] - forth.disparity[row, y, x])
        spread = np.hypot(back.deviation[partner, py, px], forth.deviation[row, y, x])
        wrong = apart > np.maximum(_LARGEST_DISAGREEMENT * spread, _SAME_SURFACE_PX)
        forth.reason[row[wrong], y[wrong], x[wrong]] = Reason.INCONSISTENT

    def _partner(
        self, step: Step, row: Indices, x: Indices, y: Indices, disparity: Samples
    ) -> tuple[Indices, Indices, Indices]:
        """Where the matches of pixels lie: index among the used microlenses, and pixel in that microlens's square."""
        grid, used = self._grid, self._used
        number = np.full(grid.first.size + 1, -1, np.intp)
        number[used] = np.arange(used.size)
        partners = grid.beside(step)[used[row]]
        move = grid.basis @ np.array(step)
        along = move / self._length(step)
        place = [
            grid.corner[k, used[row]] + pixel + move[k] + along[k] * disparity - grid.corner[k, partners]
            for k, pixel in ((0, x), (1, y))
        ]
        return number[partners], *(np.rint(coordinate).astype(np.intp) for coordinate in place)

    def _combined(self, matches: Mapping[Step, Matches]) -> tuple[Samples, Samples, NDArray[np.uint8]]:
        """1/v, its standard deviation and reasons in the squares, combined by the estimator's rule."""
        first = next(iter(matches.values()))
        shape = first.disparity.shape
        best, deviation = np.full(shape, np.nan, np.float32), np.full(shape, np.inf, np.float32)
        reason = np.full(shape, Reason.NO_PARTNER, np.uint8)
        rank, takes_widest = np.full(shape, np.inf, np.float32), self.camera.estimator == "widest-pair"
        for step, pair in matches.items():
            length = np.float32(self._length(step))
            good = pair.reason == Reason.MEASURED
            worth = -length + 0.0 * pair.deviation if takes_widest else pair.deviation / length
            better = good & (worth < rank)
            rank[better] = worth[better]
            best[better], deviation[better] = pair.disparity[better] / length, pair.deviation[better] / length
            reason[better] = Reason.MEASURED
            explained = (reason == Reason.NO_PARTNER) & ~good
            reason[explained] = pair.reason[explained]
        if self.camera.estimator == "least-squares":
            return *self._least_squares(matches, best, deviation), reason
        return best, deviation, reason

    def _least_squares(
        self, matches: Mapping[Step, Matches], best: Samples, best_deviation: Samples
    ) -> tuple[Samples, Samples]:
        """Weighted mean of all pairs that agree with the most precise one.

        All pairs of a pixel share its micro-image, whose noise contributes half of the variance of each pair.
        """
        total, weights, squares = (np.zeros(best.shape, np.float32) for _ in range(3))
        shared = np.zeros(best.shape, np.float32)
        for step, pair in matches.items():
            length = np.float32(self._length(step))
            value, deviation = pair.disparity / length, pair.deviation / length
            agrees = (pair.reason == Reason.MEASURED) & (
                np.abs(value - best) <= _LARGEST_DISAGREEMENT * np.hypot(deviation, best_deviation)
            )
            weight = np.where(agrees, 1.0 / np.square(deviation), 0.0).astype(np.float32)
            total += weight * np.where(agrees, value, 0.0)
            weights += weight
            squares += weight
            shared += np.where(agrees, weight * deviation, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):  # none agrees where none was measured
            return total / weights, np.sqrt(0.5 * squares + 0.5 * np.square(shared)) / weights

    def _on_sensor(
        self, picture: FlatPicture, inverse: Samples, deviation: Samples, reason: NDArray[np.uint8]
    ) -> DepthMap:
        """The depth map on the pixels of the sensor, from 1/v in the squares."""
        shape = picture.values.shape
        w, spread = (np.full(shape, np.nan, np.float32) for _ in range(2))
        reasons = np.where(picture.pure, Reason.LESS_SHARP, Reason.NO_LIGHT).astype(np.uint8)
        row, y, x, rows, columns = self._pixels(picture.pure)
        w[rows, columns], spread[rows, columns] = inverse[row, y, x], deviation[row, y, x]
        reasons[rows, columns] = reason[row, y, x]
        measured = reasons == Reason.MEASURED
        if self._by_type:
            kinds = np.full(shape, -1, np.intp)
            kinds[rows, columns] = self._types[self._used[row]]
            nearest = self._nearest(w)
            less = measured & (self._sharpest[nearest] != kinds)
            reasons[less] = Reason.LESS_SHARP
            measured &= ~less
        depth, rate = self._depth(np.where(measured, w, np.nan))
        if not self.camera.is_centred:
            row, rows, columns = (indices[measured[rows, columns]] for indices in (row, rows, columns))
            depth[rows, columns] = self._depth_at(self._used[row], np.stack([columns, rows]), w[rows, columns])
        baseline = self.camera.estimator_baseline(self.search.distances) / self.camera.sensor.pixel_pitch
        reasons[measured & ~np.isfinite(depth)] = Reason.OUT_OF_RANGE
        return DepthMap(
            depth=np.where(np.isfinite(depth), depth, np.nan),
            deviation=spread * np.abs(rate),
            disparity_deviation=np.where(measured, spread * baseline[self._nearest(w)], np.nan),
            reason=reasons,
        )

    def _pixels(self, pure: BoolArray) -> tuple[Indices, Indices, Indices, Indices, Indices]:
        """Pixels within their own micro-image: square, row and column in it; row and column on the sensor."""
        grid, used = self._grid, self._used
        inner = slice(MARGIN, -MARGIN)
        row, y, x = np.nonzero(np.isfinite(squares(grid, pure.astype(np.float32), pure)[used, inner, inner]))
        corner = grid.corner[:, used[row]]
        return row, y, x, corner[1] + y, corner[0] + x

    def _nearest(self, inverse: Samples) -> NDArray[np.intp]:
        """Index of the searched distance with the closest 1/v."""
        table = self._inverse_virtual_depths
        order = np.argsort(table)
        number = np.interp(np.nan_to_num(inverse), table[order], order.astype(float))
        return np.asarray(np.rint(number).astype(np.intp))

    def _depth(self, inverse: Samples) -> tuple[Samples, Samples]:
        """Depth [m] and its derivative with respect to 1/v [m], interpolated in inverse depth."""
        if not np.any(np.isfinite(inverse)):
            return np.full(inverse.shape, np.nan), np.full(inverse.shape, np.nan)
        values = np.linspace(float(np.nanmin(inverse)), float(np.nanmax(inverse)) + 1e-9, 4097)
        distances = self.search.distances[self._nearest(values)]
        baseline = self.camera.estimator_baseline(distances)
        with np.errstate(divide="ignore", invalid="ignore"):  # depths at infinity, which are out of range
            table = 1.0 / self.camera.depth_of_disparity(values * baseline, distances)
            inverse_depth = np.interp(inverse, values, table)
            depth = np.where(np.isnan(inverse), np.nan, 1.0 / inverse_depth)
            rate = np.interp(inverse, values, np.gradient(table, values)) * np.square(depth)
        return np.asarray(depth), np.asarray(rate)

    def _depth_at(self, lenses: Indices, at: Samples, inverse: Samples) -> Samples:
        """Depth [m] by the known values of the calibration, from 1/v at pixels (2, points) behind microlenses."""
        grid, camera = self._grid, self.camera
        depth = np.full(inverse.shape, np.nan)
        for begin in range(0, inverse.size, _PIXELS_AT_ONCE):
            part = slice(begin, begin + _PIXELS_AT_ONCE)
            w, lens = inverse[part].astype(np.float64), lenses[part]
            turn = w - float(camera.geometry.image_spread({}))
            place = grid.on_sensor(grid.centre[:, lens] - (at[:, part] - grid.image_centre[:, lens]) / turn)
            depth[part] = camera.depth_at(w, place, self.search.distances[self._nearest(w)])
        return depth

    def truth(self, depths: Mapping[str, Samples], pure: Mapping[str, BoolArray]) -> TrueDepth:
        """True depth in the raw picture; measurable where one of the estimator's microlenses sees the same point."""
        depth = np.asarray(depths["raw"], np.float64)
        table, order = self._rendered, np.argsort(1.0 / self.search.distances)
        with np.errstate(divide="ignore", invalid="ignore"):
            w = np.interp(1.0 / depth, (1.0 / self.search.distances)[order], table[order], left=np.nan, right=np.nan)
        row, y, x, rows, columns = self._pixels(pure["raw"])
        known_w = np.full((self._used.size, self._grid.side, self._grid.side), np.nan)
        known_w[row, y, x] = w[rows, columns]
        measurable = np.zeros(depth.shape, bool)
        known = np.isfinite(w[rows, columns])
        if self._by_type:
            known &= self._sharpest[self._nearest(w[rows, columns])] == self._types[self._used[row]]
        row, y, x, rows, columns = (indices[known] for indices in (row, y, x, rows, columns))
        for step in self._steps:
            length = self._length(step)
            partner, px, py = self._partner(step, row, x, y, known_w[row, y, x] * length)
            inside = (partner >= 0) & (px >= 0) & (py >= 0) & (px < known_w.shape[2]) & (py < known_w.shape[1])
            theirs = np.full(row.shape, np.nan)
            theirs[inside] = known_w[partner[inside], py[inside], px[inside]]
            seen = np.abs(theirs - known_w[row, y, x]) * length <= _SAME_SURFACE_PX
            measurable[rows[seen], columns[seen]] = True
        return TrueDepth(depth=depth, measurable=measurable)
