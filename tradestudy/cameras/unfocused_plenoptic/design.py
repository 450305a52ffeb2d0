"""The unfocused plenoptic camera (plenoptic I): the main image on the microlenses, the pupil under each of them.

Each pixel under a microlens sees the scene through its own part of the main lens's pupil. A point at distance a appears
in two views whose parts are Δu apart shifted by

    d = Δu z (1/a − 1/a₀),    1/a₀ = 1/f − 1/z,

on the array, by similar triangles from the pupil through the image point: exactly a parallel stereo rig of baseline Δu
and principal distance z, its disparities counted from those of the plane in focus. One lateral sample is one microlens.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.camera import Properties
from tradestudy.cameras.contradictions import Contradiction, lens_contradictions
from tradestudy.cameras.depth_camera import DepthCamera, DepthErrorPart
from tradestudy.cameras.method import Method
from tradestudy.cameras.parts import Lens, MicrolensArray, require_positive
from tradestudy.cameras.picture_geometry import LensStage, PictureGeometry
from tradestudy.cameras.plenoptic import (
    DECLARED_ERRORS,
    PlenopticCalibration,
    array_contradictions,
    fill_factor,
    plenoptic_parts,
)
from tradestudy.cameras.reading import Errors, require_known, value_of
from tradestudy.cameras.unfocused_plenoptic.focus import RefocusedViewsFocus
from tradestudy.cameras.unfocused_plenoptic.method import METHOD
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field import refocus_distance, view_pupil_diameter
from tradestudy.optics.thin_lens import blur_diameter, image_distance
from tradestudy.optics.triangulation import depth_of_inverse
from tradestudy.units import ANGLE, LENGTH, NUMBER, pretty

if TYPE_CHECKING:
    from tradestudy.cameras.stated_declaration import StatedPart

ViewEstimator = Literal["outermost-views", "least-squares"]


@dataclass(frozen=True, kw_only=True)
class UnfocusedPlenoptic(DepthCamera):
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

    family: ClassVar[str] = "plenoptic"
    method: ClassVar[Method] = METHOD

    main_lens: Lens
    microlenses: MicrolensArray
    focus_distance: float
    estimator: ViewEstimator
    calibration: PlenopticCalibration = field(default_factory=PlenopticCalibration)

    def __post_init__(self) -> None:
        super().__post_init__()
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

    @property
    def sample_pitch(self) -> float:
        """The pitch of the microlenses: one lateral sample of a view is one microlens."""
        return self.microlenses.pitch

    @property
    def gathering_lens(self) -> Lens:
        """The main lens."""
        return self.main_lens

    def depth_behind_lens(self, nearest: float) -> float:  # noqa: ARG002 - nothing moves
        """Main lens to sensor [m]."""
        return self.mla_distance + self.microlenses.gap

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

    def disparity_of_infinity(self, distance: ArrayLike) -> FloatArray:
        """``−Δu z/a₀`` [m]."""
        return np.broadcast_to(self.disparity(np.inf), np.shape(distance))

    def depth_of_disparity(self, disparity: ArrayLike, distance: ArrayLike) -> FloatArray:  # noqa: ARG002 - the same at every distance
        """Depth [m] of a disparity by design; infinite at and beyond the disparity of infinity."""
        return self._depth_read(disparity, {})

    def depth_error_parts(self, distance: ArrayLike) -> tuple[DepthErrorPart, ...]:
        """Parts of the error as errors of disparity [m], to first order.

        Depth is read from ``1/a = 1/f − 1/z + d b_L/(n p_px z²)``, n the pixels between the two views. With
        κ = 1/a − 1/a₀ its slopes are ``1/z² − 2κ/z`` in z, ``−1/f²`` in f and ``κ/b_L`` in the gap; times ``Δu z`` they
        are errors of disparity. z and f, of opposite sign, are one part with their correlation.
        """
        z, f, gap = self.mla_distance, self.main_lens.focal_length, self.microlenses.gap
        d = self.disparity(distance)
        reach = self.estimator_baseline * z
        return plenoptic_parts(
            self,
            self.calibration,
            distance,
            of_mla_distance=reach * (1.0 / z**2 - 2.0 * (d / reach) / z),
            of_focal_length=np.full_like(d, reach / f**2),
            of_gap=d / gap,
            expanded=self.expansion * z,
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
        require_known(errors, DECLARED_ERRORS, "an unfocused plenoptic camera")
        noise = np.asarray(errors.get("pixel_noise", 0.0), dtype=np.float64)
        return self._depth_read(self.disparity(distance) + noise, errors)

    def _depth_read(self, disparity: ArrayLike, errors: Errors) -> FloatArray:
        """``1/a = 1/f − 1/z + d b_L/(n p_px z²)`` with f, z and b_L off by ``errors``.

        n p_px [m], the pixels between the two views, is what the picture fixes. Written as differences from the
        design, where ``1/f − 1/z = 1/a₀`` and ``n p_px = Δu b_L/z``, so that nothing cancels.
        """
        z0, f0, gap0 = self.mla_distance, self.main_lens.focal_length, self.microlenses.gap
        off_z, off_f, off_gap = (value_of(errors, name) for name in ("mla_distance", "focal_length", "microlens_gap"))
        z, f = z0 + off_z, f0 + off_f
        slope = np.asarray(disparity) / (self.estimator_baseline * z0) * ((1.0 + off_gap / gap0) * (z0 / z) ** 2)
        return depth_of_inverse(1.0 / self.focus_distance - off_f / (f * f0) + off_z / (z * z0) + slope)

    def error_directions(self, distance: ArrayLike) -> Mapping[str, tuple[Mapping[str, ArrayLike], ...]]:
        """One standard deviation of each error; z and f_M split into what they share and what f_M has alone."""
        return self.calibration.error_directions(self.noise(distance), self.expansion * self.mla_distance)

    def equivalent_baseline(self, distance: ArrayLike) -> FloatArray:
        """Baseline [m] of the stereo rig of this focal length and disparity error that measures as well: ``Δu z/f``."""
        return np.full(np.shape(distance), self.estimator_baseline * self.mla_distance / self.main_lens.focal_length)

    def blur_px(self, distance: ArrayLike) -> FloatArray:
        """Geometric blur of one view on the array, in microlenses."""
        a, f = np.asarray(distance, dtype=np.float64), self.main_lens.focal_length
        real = a > f
        blur = blur_diameter(np.where(real, a, 2.0 * f), self.focus_distance, f, self.view_pupil_diameter)
        return np.asarray(np.where(real, blur / self.microlenses.pitch, np.inf))

    def estimator_blur_px(self, distance: FloatArray) -> FloatArray:
        """That of every view; see `blur_px`."""
        return self.blur_px(distance)

    def picture_geometry(self, distance: ArrayLike) -> PictureGeometry:
        """The views: one sample for each microlens, through a part of the pupil.

        Microlenses mix neighbouring views and do not blur them.
        """
        a = np.asarray(distance, dtype=np.float64)
        a = np.where(self.images(a), a, np.nan)
        array, f, z, view = self.microlenses, self.main_lens.focal_length, self.mla_distance, self.view_pupil_diameter
        stage = LensStage(
            aperture_diameter=view,
            focal_length=np.full_like(a, f),
            object_distance=a,
            plane_distance=np.full_like(a, z),
            blur_diameter=blur_diameter(a, self.focus_distance, f, view),
            relay=np.ones_like(a),
        )
        return PictureGeometry(
            distance=a,
            magnification=z / a,
            sample_pitch=array.pitch,
            sample_width=array.aperture_diameter,
            sample_shape="disc",
            pixel_pitch=self.sensor.pixel_pitch,
            widest_window_px=min(self.sensor.width, self.sensor.height) / array.pitch,
            light_f_number=np.full_like(a, array.gap / array.aperture_diameter),
            pupil_diameter=self.main_lens.pupil_diameter,
            main_lens=stage,
            microlens=None,
        )

    def without_calibration_errors(self) -> UnfocusedPlenoptic:
        """The same camera, perfectly calibrated."""
        return replace(self, calibration=PlenopticCalibration())

    def properties(self) -> Properties:
        """Distances, microlenses, views and field of view."""
        array, lens, sensor = self.microlenses, self.main_lens, self.sensor
        nearer, farther = (float(self.refocus_distance(shift)) for shift in (1.0, -1.0))
        return (
            ("main lens to array z", pretty(self.mla_distance, LENGTH, 5)),
            ("microlens focal lengths f_L", pretty(array.gap, LENGTH, 4)),
            ("pupil diameter", pretty(lens.pupil_diameter, LENGTH, 4)),
            ("microlens f-number b_L/p", pretty(array.gap / array.pitch, NUMBER, 4)),
            ("image-side f-number of the main lens", pretty(self.mla_distance / lens.pupil_diameter, NUMBER, 4)),
            ("pixels per microlens", pretty(array.pitch / sensor.pixel_pitch, NUMBER, 4)),
            ("fill factor of the array", fill_factor(array)),
            ("micro-image of the pupil", pretty(self.micro_image_diameter, LENGTH, 4)),
            ("views", f"{self.views}, {self.views_across} across"),
            ("pupil of one view", pretty(self.view_pupil_diameter, LENGTH, 4)),
            ("refocus distance, shift of one microlens nearer", pretty(nearer, LENGTH, 4)),
            ("refocus distance, shift of one microlens farther", pretty(farther, LENGTH, 4)),
            ("field of view across", pretty(lens.field_of_view(sensor.width), ANGLE, 4)),
            ("field of view on the diagonal", pretty(lens.field_of_view(sensor.diagonal), ANGLE, 4)),
        )

    def contradictions(self, stated: StatedPart | None, tolerance: float) -> Sequence[Contradiction]:  # noqa: ARG002 - none of depth
        """Those of the main lens and of the array."""
        array = array_contradictions(self.main_lens, self.microlenses, self.mla_distance, stated)
        return [*lens_contradictions(self.main_lens, self.sensor, stated), *array]
