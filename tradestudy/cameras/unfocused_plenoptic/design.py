"""The unfocused plenoptic camera (plenoptic I): the main lens's image on the microlenses, its pupil under each of them.

Each pixel under a microlens sees the scene through its own part of the main lens's pupil. A point at distance a appears
in two views whose parts are Δu apart shifted by

    d = Δu z (1/a − 1/a₀),    1/a₀ = 1/f − 1/z,

on the array, by similar triangles from the pupil through the image point. This is exactly a parallel stereo rig with
baseline Δu and principal distance z whose disparities are relative to the plane of focus. One lateral sample is one
microlens. If the entrance pupil lies outside the principal planes, a and a₀ count from the pupil in this equation, and
the principal distance c of the array stands for z; see `Lens`.

With errors in all parameters: The two pixels of a pair of views lie N apart under every microlens, measured from the
centre of its white image, which is the image of the exit pupil at a distance z_p in front of the array. A pixel at a
distance o from that centre, under a microlens at x, looks along the slope ``o/b_L + x/z_p``. The rays of both views
through an image at a_L in front of the array therefore meet the array d' apart, ``d' (1 − a_L/z_p) = N a_L/b_L``. The
disparity is d = −d', positive for points nearer than the focus.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.camera import DerivedValue, Properties
from tradestudy.cameras.depth_camera import Formula, Method
from tradestudy.cameras.depth_measurement import Errors, value_of
from tradestudy.cameras.focus import SingleLensFocus, require_focus
from tradestudy.cameras.microlens_exposure import ArrayGeometry, Observation, PlaceOnArray, disparity_error
from tradestudy.cameras.parts import Lens
from tradestudy.cameras.picture_geometry import LensStage, PictureGeometry
from tradestudy.cameras.plenoptic import PlenopticCamera, fill_properties
from tradestudy.cameras.unfocused_plenoptic.views import (
    ComparedViews,
    ViewEstimator,
    baseline_of_views,
)
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.plenoptic_depth_of_field import view_pupil_diameter
from tradestudy.optics.refocusing import Refocusing
from tradestudy.optics.thin_lens import blur_diameter, image_distance
from tradestudy.optics.triangulation import depth_of_inverse
from tradestudy.units import ANGLE, LENGTH, NUMBER

METHOD: Final = Method(
    name="unfocused",
    title="Depth from an unfocused plenoptic camera",
    statements=(
        "The main lens images the plane of focus, at *a*~0~, onto the array at *z*, and each pixel under a "
        "microlens sees its own part of the pupil. Two views whose parts are Δ*u* apart show a point at "
        "distance *a* shifted by *d* on the array: a stereo rig inside one lens. Its samples are microlenses, not "
        "pixels; disparity errors are therefore given in microlenses.",
        Formula(
            typst="d = Delta u thin z (1/a - 1/a_0), quad 1/a = 1/f_M - 1/z + d / (Delta u thin z)",
            alt="d equals delta u times z times the quantity one over a minus one over a zero. One over a equals one "
            "over f M minus one over z plus d over delta u z.",
        ),
        "If the entrance pupil lies outside the principal planes, *a* and *a*~0~ count from the pupil in this "
        "equation, and the principal distance of the array stands for *z*.",
    ),
)


_MOST_ACROSS: Final = 1000  # pixels; with more, arrays of views would take too much memory


@dataclass(frozen=True, kw_only=True)
class UnfocusedPlenoptic(PlenopticCamera):
    """Main lens, microlens array at the image distance of the focus, and sensor one microlens focal length behind it.

    Parameters
    ----------
    main_lens, sensor, microlenses, field_curvature
        See `PlenopticCamera`; the array has one type of microlens, whose focal length is its gap.
    focus_distance
        a₀ [m]: the distance that is imaged onto the array; may be infinite.
    estimator
        Views that are compared: the two outermost ones, or all of them by least squares over both coordinates.
    disparity_error_px
        Standard deviation of the disparity of one pair of views, in microlenses (the lateral sample of a view), or the
        law that gives it.
    discrimination_step_px
        The disparity step of the depth discrimination, in microlenses.

    Raises
    ------
    OutOfRangeError
        The parts do not fit together, or a microlens covers too few pixels for two views.
    """

    method: ClassVar[Method] = METHOD
    refocuses: ClassVar[bool] = True
    rays_per_pixel: ClassVar[int] = 12  # its microlenses show the texture more sharply than those of other kinds

    focus_distance: float
    estimator: ViewEstimator

    def __post_init__(self) -> None:
        super().__post_init__()
        require_focus(self.focus_distance, self.main_lens, "main lens")
        if self.microlenses.types != 1 or self.microlenses.focal_lengths[0] != self.microlenses.gap:
            raise OutOfRangeError(
                "an unfocused plenoptic camera needs microlenses of one type, one focal length in front of the sensor",
                value=f"{self.microlenses.types} types, gap {self.microlenses.gap * 1e6:g} um",
                remedy="use a focused plenoptic camera for other arrangements",
            )
        if not self.microlenses.pitch < _MOST_ACROSS * self.sensor.pixel_pitch:
            raise OutOfRangeError(
                "pixels across a microlens",
                value=f"{self.microlenses.pitch / self.sensor.pixel_pitch:.3g}",
                limit=f"less than {_MOST_ACROSS}",
                remedy="check the pixel pitch and the pitch of the microlenses",
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

    @cached_property
    def mla_distance(self) -> float:
        """Distance z from main lens to array [m]: the image distance of the focus."""
        return float(image_distance(self.focus_distance, self.main_lens.focal_length))

    @cached_property
    def view_pupil_diameter(self) -> float:
        """B = p_px c/f_L [m]: width of the part of the pupil that a pixel sees, and baseline of neighbouring views."""
        return float(
            view_pupil_diameter(
                float(self.from_pupil(self.focus_distance)),
                focal_length=self._thin.focal_length,
                pixel_pitch=self.sensor.pixel_pitch,
                microlens_focal_length=self.microlenses.gap,
            )
        )

    @property
    def micro_image_diameter(self) -> float:
        """Diameter of the pupil's image under a microlens [m]; it equals the pitch where the f-numbers match."""
        return self.main_lens.pupil_diameter * self.microlenses.gap / self.principal_distance

    @property
    def _micro_image_used(self) -> float:
        """Diameter of the part of the micro-image within the cell of its microlens [m]."""
        return min(self.micro_image_diameter, self.microlenses.pitch)

    @cached_property
    def view_positions(self) -> FloatArray:
        """Centres of the views in the entrance pupil [m], shape (views, 2).

        There is one view for each pixel whose centre lies in the image of the pupil and in the cell of the microlens.
        The pixel grid is centred on a pixel if the pitch is an odd number of pixels, and between pixels if it is even.
        """
        pixel = self.sensor.pixel_pitch
        across = round(self.microlenses.pitch / pixel)
        # Rounding must not exclude a pixel on the rim.
        reach = self._micro_image_used / 2.0 * (1.0 + 1e-12)
        line = (np.arange(across) - (across - 1) / 2.0) * pixel
        x, y = np.meshgrid(line, line)
        inside = np.hypot(x, y) <= reach
        scale = self.principal_distance / self.microlenses.gap
        return np.stack((x[inside], y[inside]), axis=-1) * scale

    @property
    def views_across(self) -> int:
        """Number of views in a row through the middle of the pupil."""
        positions = self.view_positions
        # Rounded, because equal positions may differ in their last digits.
        return len(np.unique(np.round(positions[:, 0] / self.view_pupil_diameter, 6))) if len(positions) else 0

    @property
    def views(self) -> int:
        """Number of views."""
        return len(self.view_positions)

    @cached_property
    def estimator_baseline(self) -> float:
        """The distance Δu [m] of two views that would measure as well as the estimator; see `baseline_of_views`."""
        return baseline_of_views(self.estimator, self.view_positions)

    @property
    def focus(self) -> SingleLensFocus:
        """The range of refocusing, in which each view is sharp: that of a lens as wide as the pupil of one view.

        Its lateral sample is one microlens. An image refocused by computation is the sum of the views, and no sharper
        than each of them.
        """
        f = self._thin.focal_length
        return SingleLensFocus(
            lens=Lens(focal_length=f, f_number=f / self.view_pupil_diameter),
            focus_distance=float(self.from_pupil(self.focus_distance)),
            sample_pitch=self.microlenses.pitch,
            name="refocused views",
            lens_behind=self.main_lens.entrance_pupil,
        )

    @cached_property
    def _thin(self) -> Lens:
        """The thin lens in place of the entrance pupil that images as the main lens does, for views and their blur."""
        return self.main_lens.thin(float(self.from_pupil(self.focus_distance)))

    @cached_property
    def refocusing(self) -> Refocusing:
        """See `Camera.refocusing`; the views of the outermost pixels are those in a row through the middle."""
        lens, pixel = self.main_lens, self.sensor.pixel_pitch
        return Refocusing(
            focus_distance=self.focus_distance,
            focal_length=lens.focal_length,
            entrance_pupil=lens.entrance_pupil,
            principal_separation=lens.principal_separation,
            view_slope=pixel / self.microlenses.gap,
            microlens_pitch=self.microlenses.pitch,
            views_across=self.views_across,
            pupil_views=self._micro_image_used / pixel,
        )

    def disparity(self, distance: ArrayLike) -> FloatArray:
        """``d = Δu c (1/a − 1/a₀)`` [m on the array], from the pupil: 0 in the plane of focus, negative beyond."""
        return np.asarray(self.estimator_baseline * self.principal_distance * self._beyond_focus(distance))

    def _beyond_focus(self, distance: ArrayLike) -> FloatArray:
        """``1/a − 1/a₀`` [1/m], of distances from the entrance pupil."""
        return np.asarray(1.0 / self.from_pupil(distance) - 1.0 / self.from_pupil(self.focus_distance))

    def depth_of_disparity(self, disparity: ArrayLike, distance: ArrayLike) -> FloatArray:  # noqa: ARG002 - the same at every distance
        """``1/a = 1/a₀ + d/(Δu c)`` [m], from the pupil; infinite at and beyond the disparity of infinity."""
        reach = self.estimator_baseline * self.principal_distance
        depth = depth_of_inverse(1.0 / self.from_pupil(self.focus_distance) + np.asarray(disparity) / reach)
        return np.asarray(depth - self.main_lens.entrance_pupil)

    def equivalent_baseline(self, distance: ArrayLike) -> FloatArray:
        """Baseline ``Δu c/f`` [m] of the equally precise stereo rig with this focal length and disparity error.

        The rig stands where distances count from, by ``(Z/a)²`` farther from the object than the pupil.
        """
        z = np.asarray(distance, dtype=np.float64)
        nearer = np.where(np.isinf(z), 1.0, z / self.from_pupil(z))
        return np.asarray(
            self.estimator_baseline * self.principal_distance / self.main_lens.focal_length * np.square(nearer)
        )

    def picture_geometry(self, distance: ArrayLike) -> PictureGeometry:
        """The views, each with one sample per microlens, through a part of the pupil.

        Microlenses mix neighbouring views, but do not blur them.
        """
        a = np.asarray(distance, dtype=np.float64)
        a = np.where(self.images(a), a, np.nan)
        array, f, z, view = self.microlenses, self._thin.focal_length, self.principal_distance, self.view_pupil_diameter
        from_pupil = self.from_pupil(a)
        stage = LensStage(
            aperture_diameter=view,
            focal_length=np.full_like(a, f),
            object_distance=from_pupil,
            plane_distance=np.full_like(a, z),
            blur_diameter=blur_diameter(from_pupil, self.from_pupil(self.focus_distance), f, view),
            relay=np.ones_like(a),
        )
        return PictureGeometry(
            distance=a,
            magnification=z / from_pupil,
            sample_pitch=array.pitch,
            sample_width=array.aperture_diameter,
            sample_shape="disc",
            pixel_pitch=self.sensor.pixel_pitch,
            compared=ComparedViews(
                estimator=self.estimator,
                positions=self.view_positions,
                pupil_diameter=self._micro_image_used * z / array.gap,
                side_px=self._shared_side(a),
            ),
            light_f_number=np.full_like(a, array.gap / array.aperture_diameter),
            pupil_diameter=self.main_lens.pupil_diameter,
            main_lens=stage,
            microlens=None,
        )

    def _shared_side(self, distance: FloatArray) -> FloatArray:
        """Side of the largest square that both outermost views show [microlenses]: the sensor minus their disparity."""
        apart = np.abs(np.ptp(self.view_positions[:, 0]) * self.principal_distance * self._beyond_focus(distance))
        along = np.maximum(self.sensor.width - apart, 0.0)
        return np.asarray(np.minimum(along, self.sensor.height) / self.microlenses.pitch)

    @property
    def geometry(self) -> ArrayGeometry:
        """The geometry with the array at the image of the plane of focus."""
        return self.geometry_at(self.mla_distance)

    @property
    def pixels_apart(self) -> float:
        """Distance between the pixels of the estimator's two views under a microlens [m]: ``Δu b_L/c``."""
        return self.estimator_baseline * self.microlenses.gap / self.principal_distance

    def observe(self, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Observation:
        """Disparity of a point, in microlenses of the design, and its position on the sensor.

        Exact for thin lenses; NaN for points that the main lens does not image. Pixel noise and the scatter of the
        microlens centres, which varies over the array, belong to `believe`.
        """
        errors, geometry = self.with_known(errors), self.geometry
        place = geometry.place_of(errors, x, y, z)
        a_L = geometry.microlens_object_distance(errors, place, z)
        shift = -self.pixels_apart * a_L / (place.gap * (1.0 - _over_pupil_distance(a_L, errors, place)))
        return shift / geometry.pitch_scale(errors), *place.on_sensor

    def rescaled(self, seen: Observation, changed: Errors, scale: FloatArray) -> Observation:
        """See `PlenopticCamera.rescaled`; disparities are relative to the true, then to the calibrated centres.

        A pixel chosen by the centre c that was calibrated for its microlens lies ``o = (c + o₀) s − c m`` from the true
        centre, where ``c = x (1 + b_L/z_p)``, s and m are the factors of pixels and array, and b_L/z_p is unchanged.
        With ``r = m/s`` and N as calibrated, two views through one image are therefore
        ``d = g/(r + (1 − r)(1 + b_L/z_p) g/N)`` apart, where g is the disparity between the true centres, in pitches
        that have grown with the array.
        """
        shift, x, y = seen
        geometry = self.geometry
        array = geometry.pitch_scale(changed)
        g, r = shift * array, array / scale
        kept = g / (r + (1.0 - r) * (1.0 + geometry.image_spread({})) * g / self.pixels_apart)
        return kept, x / scale, y / scale

    def believe(self, errors: Errors, seen: Observation, distance: ArrayLike) -> tuple[FloatArray, BoolArray]:  # noqa: ARG002 - the same views at every distance
        """Inverse depth from the rays of both views; zero at infinity and negative beyond.

        ``a_L = −d/(N/b_L − d/z_p)``, ``b = z − a_L``, ``1/a = 1/f − 1/b``; where the pupil lies in the main lens,
        ``1/a = 1/f − 1/z + d b_L/(N z²)``. Invalid where a calibrated length is not positive, the calibrated distortion
        has no inverse, or the two rays do not meet behind the main lens.
        """
        shift, seen_x, seen_y = seen
        turned = np.cos(value_of(errors, "array_rotation"))  # relative to the camera, which contains what is known
        errors, geometry = self.with_known(errors), self.geometry
        place = geometry.place_seen(errors, seen_x, seen_y)
        turned = turned * geometry.pitch_scale(errors)
        d = shift * turned + disparity_error(errors)
        pupil = geometry.pupil_distance(errors, place.distance)
        opening = self.pixels_apart / place.gap - _over_pupil_distance(d, errors, place)
        # Finite also for an image at infinity, where the opening is 0.
        image_times_opening = place.flat_distance * opening + place.stretch * d
        meet = ~(image_times_opening <= 0.0)
        image_times_opening = np.where(meet, image_times_opening, np.nan)
        with np.errstate(divide="ignore"):  # an image at infinity
            moved = place.undisplacement(image_times_opening / opening)
        inverse = 1.0 / geometry.focal_length_with(errors) - opening / (image_times_opening + moved * opening)
        return inverse, place.valid & (turned > 0.0) & (pupil > 0.0) & meet

    def observe_target(self, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, ...]:
        """Disparity of a corner, and its position."""
        return self.observe(errors, x, y, z)

    def properties(self) -> Properties:
        """Distances, microlenses, views and field of view."""
        array, lens, sensor = self.microlenses, self.main_lens, self.sensor
        nearer, farther = (float(self.refocusing.distance(shift)) for shift in (1.0, -1.0))
        return (
            ("distance from main lens to array, z", DerivedValue(self.mla_distance, LENGTH)),
            ("microlens focal length, f_L", DerivedValue(array.gap, LENGTH)),
            ("pupil diameter", DerivedValue(lens.pupil_diameter, LENGTH)),
            ("microlens f-number, gap/pitch", DerivedValue(array.gap / array.pitch, NUMBER)),
            (
                "image-side f-number of the main lens",
                DerivedValue(self.principal_distance / lens.pupil_diameter, NUMBER),
            ),
            ("pixels per microlens", DerivedValue(array.pitch / sensor.pixel_pitch, NUMBER)),
            *fill_properties(array),
            ("diameter of the micro-image of the pupil", DerivedValue(self.micro_image_diameter, LENGTH)),
            ("views", DerivedValue(self.views, NUMBER)),
            ("views across", DerivedValue(self.views_across, NUMBER)),
            ("diameter of the pupil of one view", DerivedValue(self.view_pupil_diameter, LENGTH)),
            (
                "nearer distance at which the disparity of neighbouring views is one microlens",
                DerivedValue(nearer, LENGTH),
            ),
            (
                "farther distance at which the disparity of neighbouring views is one microlens",
                DerivedValue(farther, LENGTH),
            ),
            ("horizontal field of view, focused at infinity", DerivedValue(lens.field_of_view(sensor.width), ANGLE)),
            (
                "diagonal field of view, focused at infinity",
                DerivedValue(lens.field_of_view(sensor.diagonal), ANGLE),
            ),
            *self.lens_places(),
        )


def _over_pupil_distance(length: FloatArray, errors: Errors, place: PlaceOnArray) -> FloatArray:
    """A length over the distance z_p from the exit pupil to the array [1]; 0 for a pupil at infinity."""
    return length * place.geometry.pupil_ratio / place.geometry.pupil_distance(errors, place.distance)
