"""The unfocused plenoptic camera (plenoptic I): the main image on the microlenses, the pupil under each of them.

Each pixel under a microlens sees the scene through its own part of the main lens's pupil. A point at distance a appears
in two views whose parts are Δu apart shifted by

    d = Δu z (1/a − 1/a₀),    1/a₀ = 1/f − 1/z,

on the array, by similar triangles from the pupil through the image point: exactly a parallel stereo rig of baseline Δu
and principal distance z, its disparities counted from those of the plane in focus. One lateral sample is one microlens.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

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
from tradestudy.cameras.focus import RefocusedViewsFocus
from tradestudy.cameras.parts import Lens, MicrolensArray, Sensor, require_positive
from tradestudy.cameras.plenoptic_calibration import PlenopticCalibration
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.depth_of_field import refocus_distance, view_pupil_diameter
from tradestudy.optics.thin_lens import blur_diameter, image_distance

ViewEstimator = Literal["outermost-views", "least-squares"]


@dataclass(frozen=True, kw_only=True)
class UnfocusedPlenoptic:
    """Main lens, microlens array at the image distance of the focus, sensor one microlens focal length behind it.

    Parameters
    ----------
    main_lens, sensor, microlenses
        The parts; the array has one type of microlens, whose focal length is its gap.
    focus_distance
        a₀ [m]: the distance whose image falls on the array; finite.
    estimator
        Which views depth is measured from: the two outermost ones, or all of them by least squares over both
        coordinates.
    disparity_error_px
        Standard deviation of the disparity of one pair of views, in microlenses: the lateral sample of a view; or the
        law it follows from.
    discrimination_step_px
        The disparity step of the depth discrimination, in microlenses.
    calibration
        See `PlenopticCalibration`.
    expansion
        Standard deviation of the relative change of z with temperature since the calibration.

    Raises
    ------
    OutOfRangeError
        For parts that do not fit together, or too few pixels under a microlens for two views.
    """

    main_lens: Lens
    sensor: Sensor
    microlenses: MicrolensArray
    focus_distance: float
    estimator: ViewEstimator
    disparity_error_px: DisparityError
    discrimination_step_px: float
    calibration: PlenopticCalibration = field(default_factory=PlenopticCalibration)
    expansion: float = 0.0

    family: Literal["plenoptic"] = field(default="plenoptic", init=False)

    def __post_init__(self) -> None:
        require_disparity_error(self.disparity_error_px)
        require_positive("discrimination step", self.discrimination_step_px, "px")
        require_expansion(self.expansion)
        require_positive("focus distance", self.focus_distance)
        if not self.focus_distance > self.main_lens.focal_length:
            raise OutOfRangeError(
                "the main lens cannot focus that close",
                value=f"{self.focus_distance * 1e3:g} mm",
                limit=f"beyond the focal length, {self.main_lens.focal_length * 1e3:g} mm",
                remedy="increase the focus distance",
            )
        if self.microlenses.types != 1 or self.microlenses.focal_lengths[0] != self.microlenses.gap:
            raise OutOfRangeError(
                "the microlenses of an unfocused plenoptic camera are of one type, one focal length before the sensor",
                value=f"{self.microlenses.types} types, gap {self.microlenses.gap * 1e6:g} um",
                remedy="use a focused plenoptic camera for other arrangements",
            )
        if self.views_across < 2:
            raise OutOfRangeError(
                "views across the pupil",
                value=str(self.views_across),
                limit="at least 2",
                remedy="use smaller pixels, a wider aperture, or a longer microlens focal length",
            )

    @cached_property
    def mla_distance(self) -> float:
        """Main lens to array z [m]: the image distance of the focus."""
        return float(image_distance(self.focus_distance, self.main_lens.focal_length))

    @cached_property
    def view_pupil_diameter(self) -> float:
        """B = p_px z/f_L [m]: the part of the pupil that a pixel sees through, baseline of neighbouring views."""
        return float(
            view_pupil_diameter(
                self.focus_distance,
                focal_length=self.main_lens.focal_length,
                pixel_pitch=self.sensor.pixel_pitch,
                microlens_focal_length=self.microlenses.gap,
            )
        )

    @property
    def micro_image_diameter(self) -> float:
        """Image of the main lens's pupil under a microlens [m]; it equals the pitch where the f-numbers match."""
        return self.main_lens.pupil_diameter * self.microlenses.gap / self.mla_distance

    @cached_property
    def view_positions(self) -> FloatArray:
        """Centres of the views in the pupil [m], shape (views, 2).

        Pixels whose centre lies in the picture of the pupil and in the cell of the microlens, on a square grid with a
        pixel in the middle where the pitch is an odd number of pixels, a corner of pixels where it is even.
        """
        pixel = self.sensor.pixel_pitch
        across = round(self.microlenses.pitch / pixel)
        reach = min(self.micro_image_diameter, self.microlenses.pitch) / 2.0 * (1.0 + 1e-12)
        line = (np.arange(across) - (across - 1) / 2.0) * pixel
        x, y = np.meshgrid(line, line)
        inside = np.hypot(x, y) <= reach
        scale = self.mla_distance / self.microlenses.gap
        return np.stack((x[inside], y[inside]), axis=-1) * scale

    @property
    def views_across(self) -> int:
        """Views along one row through the middle of the pupil."""
        positions = self.view_positions
        return len(np.unique(np.round(positions[:, 0] / self.view_pupil_diameter, 6))) if len(positions) else 0

    @property
    def views(self) -> int:
        """All views."""
        return len(self.view_positions)

    @cached_property
    def estimator_baseline(self) -> float:
        """The distance Δu [m] of two views that would measure as well as the estimator.

        That of the outermost views along a row; √(2 Σ|u − ū|²) for least squares over both coordinates of all views,
        each with the error of one coordinate.
        """
        positions = self.view_positions
        if self.estimator == "outermost-views":
            return float(np.ptp(positions[:, 0]))
        return math.sqrt(2.0 * float(np.sum((positions - positions.mean(axis=0)) ** 2)))

    @property
    def focus(self) -> RefocusedViewsFocus:
        """What can be refocused on: where each view is sharp."""
        return RefocusedViewsFocus(
            main_lens=self.main_lens,
            focus_distance=self.focus_distance,
            view_pupil_diameter=self.view_pupil_diameter,
            microlens_pitch=self.microlenses.pitch,
        )

    def refocus_distance(self, shift: ArrayLike) -> FloatArray:
        """Distance [m] that shifting neighbouring views by so many microlenses refocuses on; see `refocus_distance`."""
        return refocus_distance(
            shift,
            self.focus_distance,
            focal_length=self.main_lens.focal_length,
            view_pupil_diameter=self.view_pupil_diameter,
            microlens_pitch=self.microlenses.pitch,
        )

    def disparity(self, distance: ArrayLike) -> FloatArray:
        """``d = Δu z (1/a − 1/a₀)`` [m on the array]: 0 in the plane of focus, negative beyond."""
        inverse = 1.0 / np.asarray(distance, dtype=np.float64)
        return np.asarray(self.estimator_baseline * self.mla_distance * (inverse - 1.0 / self.focus_distance))

    def disparity_px(self, distance: ArrayLike) -> FloatArray:
        """The disparity, in microlenses."""
        return self.disparity(distance) / self.microlenses.pitch

    def images(self, distance: ArrayLike) -> BoolArray:
        """Where an object lies beyond the focal length of the main lens, so that this forms a real image of it."""
        return np.asarray(np.asarray(distance, dtype=np.float64) > self.main_lens.focal_length)

    def disparity_of_infinity(self, distance: ArrayLike) -> FloatArray:
        """``−Δu z/a₀`` [m]."""
        return np.broadcast_to(self.disparity(np.inf), np.shape(distance))

    def depth_of_disparity(self, disparity: ArrayLike, distance: ArrayLike) -> FloatArray:  # noqa: ARG002 - the same at every distance
        """``a = Δu z / (d + Δu z/a₀)`` [m]; infinite at and beyond the disparity of infinity."""
        reach = self.estimator_baseline * self.mla_distance
        from_infinity = np.asarray(disparity, dtype=np.float64) + reach / self.focus_distance
        real = from_infinity > 0.0
        return np.asarray(np.where(real, reach / np.where(real, from_infinity, 1.0), np.inf))

    def depth_discrimination(self, distance: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Change of depth [m] that moves the disparity by one step, nearer and farther (which may be infinite)."""
        a = np.asarray(distance, dtype=np.float64)
        d, step = self.disparity(a), self.discrimination_step_px * self.microlenses.pitch
        return a - self.depth_of_disparity(d + step, a), self.depth_of_disparity(d - step, a) - a

    def depth_error_parts(self, distance: ArrayLike) -> tuple[DepthErrorPart, ...]:
        """Parts of the error as errors of disparity [m], to first order.

        Depth is read from ``1/a = 1/f − 1/z + d b_L/(n p_px z²)``, n the pixels between the two views. With
        κ = 1/a − 1/a₀ its slopes are ``1/z² − 2κ/z`` in z, ``−1/f²`` in f and ``κ/b_L`` in the gap; times ``Δu z`` they
        are errors of disparity. z and f, of opposite sign, are one part with their correlation.
        """
        z, f, gap = self.mla_distance, self.main_lens.focal_length, self.microlenses.gap
        d = self.disparity(distance)
        reach = self.estimator_baseline * z
        errors = self.calibration
        from_z = reach * (1.0 / z**2 - 2.0 * (d / reach) / z) * errors.mla_distance.standard_deviation
        from_f = reach / f**2 * errors.focal_length.standard_deviation
        joint = from_z**2 - 2.0 * errors.correlation * from_z * from_f + from_f**2
        parts: tuple[tuple[str, FloatArray, ErrorShape], ...] = (
            ("pixel_noise", disparity_error_at(self, distance) * self.microlenses.pitch, "normal"),
            ("mla_distance_and_focal_length", np.sqrt(np.maximum(joint, 0.0)), "normal"),
            ("microlens_gap", np.abs(d / gap) * errors.microlens_gap.standard_deviation, errors.microlens_gap.shape),
            ("temperature", np.abs(reach * (1.0 / z**2 - 2.0 * (d / reach) / z)) * z * self.expansion, "normal"),
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
        """The depth [m] of a fixed picture read with parameters that are off by ``errors``.

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

        Raises
        ------
        OutOfRangeError
            For an error that the camera does not have.
        """
        known = {"pixel_noise", "mla_distance", "focal_length", "microlens_gap"}
        if unknown := set(errors) - known:
            raise OutOfRangeError(
                "an unfocused plenoptic camera has no such error", value=str(sorted(unknown)), limit=str(sorted(known))
            )
        e = {name: np.asarray(errors.get(name, 0.0), dtype=np.float64) for name in known}
        z0, f0, gap0 = self.mla_distance, self.main_lens.focal_length, self.microlenses.gap
        pixels_between = self.estimator_baseline * gap0 / z0  # n p_px [m], what the picture fixes
        z, f = z0 + e["mla_distance"], f0 + e["focal_length"]
        slope = (self.disparity(distance) + e["pixel_noise"]) * (gap0 + e["microlens_gap"]) / (pixels_between * z**2)
        inverse = (z - f) / (z * f) + slope
        real = inverse > 0.0
        return np.asarray(np.where(real, 1.0 / np.where(real, inverse, 1.0), np.inf))

    def error_directions(self, distance: ArrayLike) -> Mapping[str, tuple[Mapping[str, ArrayLike], ...]]:
        """One standard deviation of each error; z and f_M split into what they share and what f_M has alone."""
        return self.calibration.error_directions(
            disparity_error_at(self, distance) * self.microlenses.pitch, self.expansion * self.mla_distance
        )

    def equivalent_baseline(self, distance: ArrayLike) -> FloatArray:
        """Baseline [m] of the stereo rig of this focal length and disparity error that measures as well: ``Δu z/f``."""
        return np.full(np.shape(distance), self.estimator_baseline * self.mla_distance / self.main_lens.focal_length)

    def blur_px(self, distance: ArrayLike) -> FloatArray:
        """Geometric blur of one view on the array, in microlenses."""
        a, f = np.asarray(distance, dtype=np.float64), self.main_lens.focal_length
        real = a > f
        blur = blur_diameter(np.where(real, a, 2.0 * f), self.focus_distance, f, self.view_pupil_diameter)
        return np.asarray(np.where(real, blur / self.microlenses.pitch, np.inf))

    def limits(self, distance: ArrayLike, criteria: UsableCriteria) -> Mapping[str, Limit]:
        """Real image, focus of the single views and last disparity step, as far as asked for."""
        a = np.asarray(distance, dtype=np.float64)
        f = self.main_lens.focal_length
        found = {"real_image": Limit(value=a, bound=f, met=self.images(a))}
        if criteria.blur_px is not None:
            value = self.blur_px(a)
            found["focus"] = Limit(value=value, bound=criteria.blur_px, met=value <= criteria.blur_px)
        if criteria.disparity_step_px is not None:
            value = (self.disparity(a) - self.disparity_of_infinity(a)) / self.microlenses.pitch
            found["last_disparity_step"] = Limit(
                value=value, bound=criteria.disparity_step_px, met=value > criteria.disparity_step_px
            )
        return found
