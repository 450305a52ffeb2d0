"""The focused plenoptic camera (plenoptic II): microlenses relay the image of the main lens onto the sensor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.cameras.depth_camera import (
    DepthErrorPart,
    DisparityError,
    ErrorShape,
    Limit,
    UsableCriteria,
    disparity_error_at,
    require_disparity_error,
    require_expansion,
)
from tradestudy.cameras.focus import MicrolensTypesFocus
from tradestudy.cameras.parts import Lens, MicrolensArray, Sensor, require_positive
from tradestudy.cameras.plenoptic_calibration import PlenopticCalibration
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.depth_of_field.microlens_relay import inverse_focus_virtual_depth, relay_blur_diameter
from tradestudy.optics.microlens_coverage import (
    least_squares_baseline,
    projected_radius_over_pitch,
    seen_count_probability,
    widest_pair_baseline,
)
from tradestudy.optics.microlens_projection import microlens_object_distance, virtual_depth
from tradestudy.optics.thin_lens import focus_shift
from tradestudy.optics.triangulation import plenoptic_depth

PlenopticEstimator = Literal["adjacent-pair", "same-type-pair", "widest-pair", "least-squares"]


@dataclass(frozen=True, kw_only=True)
class FocusedPlenoptic:
    """Main lens, microlens array at z, sensor at b_L behind the array.

    Parameters
    ----------
    main_lens, sensor, microlenses
        The parts.
    mla_distance
        Main lens to array z [m].
    estimator
        Which micro-images depth is measured from: two neighbours, two neighbours of the same type, the two farthest
        apart, or least squares over all.
    lenses
        Which microlenses the estimator may use: ``all`` types, or those of the ``sharpest-type`` at each distance. Two
        neighbours are of different types, so ``adjacent-pair`` uses all; ``same-type-pair`` uses the sharpest.
    disparity_error_px
        Standard deviation of the disparity of one pair [px], of which one image coordinate has 1/√2, or the law it
        follows from.
    discrimination_step_px
        The disparity step [px] of the depth discrimination.
    calibration
        See `PlenopticCalibration`.
    expansion
        Standard deviation of the relative change of z with temperature since the calibration.

    Raises
    ------
    OutOfRangeError
        For parts that do not fit together.
    """

    main_lens: Lens
    sensor: Sensor
    microlenses: MicrolensArray
    mla_distance: float
    estimator: PlenopticEstimator
    lenses: Literal["all", "sharpest-type"]
    disparity_error_px: DisparityError
    discrimination_step_px: float
    calibration: PlenopticCalibration = field(default_factory=PlenopticCalibration)
    expansion: float = 0.0

    family: Literal["plenoptic"] = field(default="plenoptic", init=False)

    def __post_init__(self) -> None:
        require_positive("distance from main lens to microlens array", self.mla_distance)
        require_disparity_error(self.disparity_error_px)
        require_positive("discrimination step", self.discrimination_step_px, "px")
        require_expansion(self.expansion)
        only = {"adjacent-pair": "all", "same-type-pair": "sharpest-type"}.get(self.estimator)
        if only is not None and self.lenses != only:
            raise OutOfRangeError(
                f"the estimator {self.estimator} has no choice of lenses", value=self.lenses, limit=only
            )
        if self.microlenses.pitch > self.sensor.width:
            raise OutOfRangeError(
                "the sensor is smaller than one microlens",
                value=f"pitch {self.microlenses.pitch * 1e6:g} um",
                limit=f"at most {self.sensor.width * 1e6:g} um",
            )

    @property
    def focus(self) -> MicrolensTypesFocus:
        """What the types of microlenses keep sharp."""
        return MicrolensTypesFocus(
            main_lens=self.main_lens,
            microlenses=self.microlenses,
            mla_distance=self.mla_distance,
            sample_pitch=self.sensor.pixel_pitch,
        )

    def microlens_object_distance(self, distance: ArrayLike) -> FloatArray:
        """a_L = z − b_M [m], signed: positive Keplerian, negative Galilean."""
        return microlens_object_distance(distance, self.mla_distance, self.main_lens.focal_length)

    def virtual_depth(self, distance: ArrayLike) -> FloatArray:
        """v = a_L / b_L."""
        return virtual_depth(distance, self.mla_distance, self.microlenses.gap, self.main_lens.focal_length)

    def radius_over_pitch(self, distance: ArrayLike) -> FloatArray:
        """Radius of the disc in which microlenses see a point, over the pitch; infinite objects allowed.

        NaN for objects inside the focal length, which have no image behind the main lens.
        """
        a_L = self.microlens_object_distance(distance)
        real = a_L < self.mla_distance
        radius = projected_radius_over_pitch(
            microlens_object_distance=np.where(real, a_L, 0.0),
            mla_distance=self.mla_distance,
            pupil_diameter=self.main_lens.pupil_diameter,
            microlens_pitch=self.microlenses.pitch,
        )
        return np.asarray(np.where(real, radius, np.nan))

    @property
    def _counting(self) -> Literal["all_lenses", "given_type"]:
        return "given_type" if self.lenses == "sharpest-type" and self.microlenses.types > 1 else "all_lenses"

    def estimator_baseline(self, distance: ArrayLike) -> FloatArray:
        """The distance Δx [m] of two microlenses that would measure as well as the estimator.

        The pitch for neighbours; times √3 for neighbours of the same type of three on a hexagonal array; for the
        widest pair and for least squares effective in the mean square of the error over the places of a point in the
        lattice, which grows with the
        absolute v and with v². NaN where the microlenses it needs are never there.
        """
        p, array = self.microlenses.pitch, self.microlenses
        if self.estimator in ("adjacent-pair", "same-type-pair"):
            same = self.estimator == "same-type-pair" and array.types > 1
            return np.full(np.shape(distance), p * (math.sqrt(3.0) if same else 1.0))
        law = widest_pair_baseline if self.estimator == "widest-pair" else least_squares_baseline
        radius = self.radius_over_pitch(distance)
        found = law(np.nan_to_num(radius), layout=array.layout, types=array.types, counting=self._counting)
        return np.asarray(np.where(np.isfinite(radius), found.over_pitch, np.nan) * p)

    def disparity(self, distance: ArrayLike) -> FloatArray:
        """Disparity over the estimator's baseline, ``Δσ = Δx / v`` [m], signed like v."""
        v = self.virtual_depth(distance)
        with np.errstate(divide="ignore"):  # an image on the array has no finite disparity
            return np.asarray(self.estimator_baseline(distance) / v)

    def disparity_px(self, distance: ArrayLike) -> FloatArray:
        """The disparity [px], signed like v."""
        return self.disparity(distance) / self.sensor.pixel_pitch

    def _depth_of(
        self, disparity: ArrayLike, true_disparity: ArrayLike, baseline: ArrayLike, **off: ArrayLike
    ) -> FloatArray:
        """Depth [m] of a disparity; past zero it is what the true sign tends to, not the other relay's image."""
        f = self.main_lens.focal_length + np.asarray(off.get("focal_length", 0.0))
        depth = plenoptic_depth(
            disparity,
            baseline,
            mla_distance=self.mla_distance + np.asarray(off.get("mla_distance", 0.0)),
            microlens_gap=self.microlenses.gap + np.asarray(off.get("microlens_gap", 0.0)),
            focal_length=f,
        )
        crossed = np.sign(disparity) * np.sign(true_disparity) <= 0.0
        depth = np.where(crossed, np.where(np.asarray(true_disparity) > 0.0, np.inf, f), depth)
        return np.asarray(np.where(np.isnan(disparity), np.nan, depth))

    def images(self, distance: ArrayLike) -> BoolArray:
        """Where an object lies beyond the focal length of the main lens, so that this forms a real image of it."""
        return np.asarray(np.asarray(distance, dtype=np.float64) > self.main_lens.focal_length)

    def disparity_of_infinity(self, distance: ArrayLike) -> FloatArray:
        """Disparity [m] of infinity over the baseline that the estimator has at a distance.

        Minus infinity for an object so near that its image lies on the other side of the array than that of infinity:
        no error of disparity takes it there without passing a_L = 0.
        """
        reached = self.estimator_baseline(distance) / self.virtual_depth(np.inf)
        return np.asarray(np.where(self.disparity(distance) * reached > 0.0, reached, -np.inf))

    def depth_of_disparity(self, disparity: ArrayLike, distance: ArrayLike) -> FloatArray:
        """Eq. 8 [m] with the baseline that the estimator has at a true distance; see `plenoptic_depth`."""
        return self._depth_of(disparity, self.disparity(distance), self.estimator_baseline(distance))

    def depth_discrimination(self, distance: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Change of depth [m] that moves the disparity by one step, nearer and farther (which may be infinite).

        The estimator's baseline is held at its value at the distance. A step through zero disparity ends where the
        disparity tends to before it: at infinity for a Keplerian relay, at the front focal point for a Galilean one.
        """
        a = np.asarray(distance, dtype=np.float64)
        d, step = self.disparity(a), self.discrimination_step_px * self.sensor.pixel_pitch
        return a - self.depth_of_disparity(d + step, a), self.depth_of_disparity(d - step, a) - a

    def depth_error_parts(self, distance: ArrayLike) -> tuple[DepthErrorPart, ...]:
        """Parts of the error as errors of disparity [m], to first order.

        A change δs of the focus shift read from a fixed picture acts like ``δd = Δx δs / (b_L v²)``, and ``∂s/∂z = 1``,
        ``∂s/∂b_L = −v`` and, for all that the focal length does to depth, ``−(1 + s/f)²``, of opposite sign to z:
        the two are one part, with their correlation.
        """
        f, gap = self.main_lens.focal_length, self.microlenses.gap
        s, v = focus_shift(distance, f), self.virtual_depth(distance)
        d = self.disparity(distance)
        errors = self.calibration
        sigma_z, sigma_f = errors.mla_distance.standard_deviation, errors.focal_length.standard_deviation
        weight = (1.0 + s / f) ** 2
        joint = sigma_z**2 - 2.0 * errors.correlation * weight * sigma_z * sigma_f + (weight * sigma_f) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):  # an image on the array has no disparity: NaN is meant
            per_shift = d / (gap * v)
        parts: tuple[tuple[str, FloatArray, ErrorShape], ...] = (
            ("pixel_noise", disparity_error_at(self, distance) * self.sensor.pixel_pitch, "normal"),
            ("mla_distance_and_focal_length", np.abs(per_shift) * np.sqrt(np.maximum(joint, 0.0)), "normal"),
            ("microlens_gap", np.abs(d / gap) * errors.microlens_gap.standard_deviation, errors.microlens_gap.shape),
            ("temperature", np.abs(per_shift) * self.mla_distance * self.expansion, "normal"),
        )
        return tuple(
            DepthErrorPart(
                name=name,
                disparity_error=np.asarray(error),
                shape=shape,
                error_class="per measurement" if name == "pixel_noise" else "per rig",
            )
            for name, error, shape in parts
            if np.any(error > 0.0)
        )

    def depth_with_errors(self, distance: ArrayLike, errors: Mapping[str, ArrayLike]) -> FloatArray:
        """The depth [m] that eq. 8 gives for a fixed picture read with parameters that are off by ``errors``.

        Parameters
        ----------
        distance
            True distance [m].
        errors
            ``pixel_noise`` [m of disparity], ``mla_distance``, ``focal_length``, ``microlens_gap`` [m]; missing is 0.

        Returns
        -------
        FloatArray
            Exact, not linearised; +infinity for disparities that belong to no point in front of the camera.
        """
        known = {"pixel_noise", "mla_distance", "focal_length", "microlens_gap"}
        if unknown := set(errors) - known:
            raise OutOfRangeError(
                "a focused plenoptic camera has no such error",
                value=str(sorted(unknown)),
                limit=str(sorted(known)),
            )
        e = {name: np.asarray(errors.get(name, 0.0), dtype=np.float64) for name in known}
        true = self.disparity(distance)
        noise = e.pop("pixel_noise")
        return self._depth_of(true + noise, true, self.estimator_baseline(distance), **e)

    def error_directions(self, distance: ArrayLike) -> Mapping[str, tuple[Mapping[str, ArrayLike], ...]]:
        """One standard deviation of each error; z and f_M split into what they share and what f_M has alone."""
        return self.calibration.error_directions(
            disparity_error_at(self, distance) * self.sensor.pixel_pitch, self.expansion * self.mla_distance
        )

    def equivalent_baseline(self, distance: ArrayLike) -> FloatArray:
        """Baseline [m] of the stereo rig of this focal length and disparity error that measures as well.

        ``B = (a/(a − f))² f Δx / (b_L v²)``.
        """
        a, f = np.asarray(distance, dtype=np.float64), self.main_lens.focal_length
        v2 = self.virtual_depth(a) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):  # v = 0: an image on the array
            return np.asarray(
                (1.0 + focus_shift(a, f) / f) ** 2 * f * self.estimator_baseline(a) / (self.microlenses.gap * v2)
            )

    def blur_px(self, distance: ArrayLike) -> FloatArray:
        """Geometric blur of each type's micro-image, ``D |1/v − 1/v₀|`` [px]; shape (types, …), D the lens diameter."""
        v = self.virtual_depth(distance)
        array = self.microlenses
        in_focus = inverse_focus_virtual_depth(array.focal_lengths, array.gap).reshape((-1,) + (1,) * v.ndim)
        return relay_blur_diameter(v, in_focus, array.aperture_diameter) / self.sensor.pixel_pitch

    def availability(self, distance: ArrayLike) -> FloatArray:
        """Share of points seen by at least two of the microlenses that the estimator uses."""
        radius = self.radius_over_pitch(distance)
        counting = self._counting
        found = seen_count_probability(
            np.nan_to_num(radius),
            at_least=2,
            layout=self.microlenses.layout,
            types=self.microlenses.types,
            counting=counting,
        )
        return np.asarray(np.where(np.isfinite(radius), found, 0.0))

    def limits(self, distance: ArrayLike, criteria: UsableCriteria) -> Mapping[str, Limit]:
        """Real image, total covering plane, availability, focus and last disparity step, as far as asked for."""
        a = np.asarray(distance, dtype=np.float64)
        f = self.main_lens.focal_length
        found = {"real_image": Limit(value=a, bound=f, met=self.images(a))}
        if criteria.virtual_depth is not None:
            value = np.abs(self.virtual_depth(a))
            found["total_covering_plane"] = Limit(
                value=value, bound=criteria.virtual_depth, met=value >= criteria.virtual_depth * (1.0 - 1e-9)
            )
        if criteria.availability is not None:
            value = self.availability(a)
            found["availability"] = Limit(value=value, bound=criteria.availability, met=value >= criteria.availability)
        if criteria.blur_px is not None:
            value = self._blur_of_used_types(a)
            found["focus"] = Limit(value=value, bound=criteria.blur_px, met=value <= criteria.blur_px)
        if criteria.disparity_step_px is not None:
            value = (self.disparity(a) - self.disparity_of_infinity(a)) / self.sensor.pixel_pitch
            found["last_disparity_step"] = Limit(
                value=value, bound=criteria.disparity_step_px, met=value > criteria.disparity_step_px
            )
        return found

    def least_sharp_type(self, distance: ArrayLike) -> NDArray[np.intp]:
        """Number of the type that gives the least sharp picture that the estimator needs: second best of neighbours."""
        order = np.argsort(self.blur_px(distance), axis=0)
        if self.estimator == "adjacent-pair":
            return np.asarray(order[min(1, len(order) - 1)])
        return np.asarray(order[-1] if self.lenses == "all" else order[0])

    def _blur_of_used_types(self, distance: FloatArray) -> FloatArray:
        """Blur [px] of the least sharp picture that the estimator needs."""
        used = self.least_sharp_type(distance)
        return np.asarray(np.take_along_axis(self.blur_px(distance), used[np.newaxis], axis=0)[0])
