"""Main lens, microlens array and sensor with errors in all parameters, and the light of a raw picture behind them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.cameras.depth_measurement import PIXEL_NOISE, Environment, Errors, value_of
from tradestudy.cameras.light_cones import AT_ORIGIN, Description, LightCones, Pose, Stop
from tradestudy.cameras.parts import Lens, MicrolensArray, Sensor
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.lens_model import Rational
from tradestudy.optics.microlens_coverage import LATTICES
from tradestudy.optics.thin_lens import focus_shift, image_distance

Observation = tuple[FloatArray, FloatArray, FloatArray]
"""The quantity from which depth is measured, and its position on the sensor, x and y [m]."""


def disparity_error(errors: Errors) -> FloatArray:
    """Error of one disparity [m]: its noise and the scatter of two microlens centres.

    Coordinates are relative to the centre of their own microlens; the baseline is that of the regular grid.
    """
    return value_of(errors, PIXEL_NOISE) + math.sqrt(2.0) * value_of(errors, "microlens_center_scatter")


_UNDISTORTED: Final = Rational()
_kept: Final = lru_cache(maxsize=64)(Rational)  # keeps the end of its field, whose search takes longer than depth
_COEFFICIENTS: Final = ("k1", "k2", "k3", "p1", "p2")
_DEPTH_COEFFICIENTS: Final = ("depth_distortion_d1", "depth_distortion_d2")
_STEPS: Final = 6  # of Newton's method, which doubles the digits from about three on


def _distortion(errors: Errors) -> Rational:
    """Lateral distortion of the main lens."""
    present = [name for name in _COEFFICIENTS if f"distortion_{name}" in errors]
    if not present:  # a shortcut saves time in every measurement
        return _UNDISTORTED
    values = {name: value_of(errors, f"distortion_{name}") for name in present}
    if any(value.ndim for value in values.values()):
        # Arrays cannot be keys of the cache.
        return Rational(**values)
    return _kept(**{name: float(value) for name, value in values.items()})


@dataclass(frozen=True, kw_only=True)
class ArrayGeometry:
    """Main lens, array and sensor as designed.

    Parameters
    ----------
    focal_length
        Focal length f_M of the main lens [m].
    mla_distance
        Distance z from main lens to array [m].
    gap
        Distance b_L from array to sensor [m].
    pitch
        Pitch of the microlenses [m].
    corner
        Distance from the axis to the corner of the sensor [m].
    field_curvature
        How much farther from the main lens its image is known to lie in the corner than on the axis [m].
    entrance_pupil
        Distance e of the entrance pupil behind the first principal plane, from which objects count [m]; z and f_M count
        from the second one. Errors leave both pupils where they are, but for `pupil_distance`.
    """

    focal_length: float
    mla_distance: float
    gap: float
    pitch: float
    corner: float
    field_curvature: float
    entrance_pupil: float = 0.0

    @property
    def pupil_ratio(self) -> float:
        """g = 1 + e/f_M, the diameter of the entrance pupil over that of the exit pupil; see `Lens`."""
        return 1.0 + self.entrance_pupil / self.focal_length

    def pupil_distance(self, errors: Errors, distance: ArrayLike) -> FloatArray:
        """g z_p [m], with z_p the distance of the exit pupil from an array that is z behind the main lens.

        It is finite and positive for every pupil, and z for a thin lens: ``g (z + error) − e``.

        Raises
        ------
        OutOfRangeError
            For an error of a pupil at infinity.
        """
        if self.pupil_ratio == 0.0 and "pupil_distance" in errors:
            raise OutOfRangeError(
                "pupil_distance, the error of the distance of an exit pupil at infinity",
                value=f"{float(np.max(np.abs(errors['pupil_distance']))) * 1e3:g} mm",
                limit="not given",
                remedy="remove it, or give a finite exit_pupil",
            )
        z = np.asarray(distance, dtype=np.float64) + value_of(errors, "pupil_distance")
        return np.asarray(self.pupil_ratio * z - self.entrance_pupil)

    def image_spread(self, errors: Errors) -> FloatArray:
        """b_L/z_p [1]: by this fraction, the centres of micro-images lie farther from the axis than their microlenses.

        Only errors of the pupil and of the distance of the array enter.
        """
        return (
            self.gap
            * self.pupil_ratio
            / self.pupil_distance(errors, self.mla_distance + value_of(errors, "mla_distance"))
        )

    def changed(self, errors: Errors, environment: Environment | None) -> Errors:
        """Changes since the calibration, due to the surroundings and the colour of the object, as errors.

        z and b_L expand with the housing, the pitch with the array. The focal length of the main lens drifts with
        temperature, depends on the refractive index of the air, and differs from colour to colour.
        """
        changed: dict[str, ArrayLike] = {}
        if environment is not None and ("temperature_change" in errors or "pressure_change" in errors):
            growth = environment.housing_factor(errors) - 1.0
            changed = {
                "mla_distance": self.mla_distance * growth,
                "microlens_gap": self.gap * growth,
                "microlens_pitch": self.pitch * (environment.array_factor(errors) - 1.0),
                "focal_length": self.focal_length * (environment.focal_length_factor(errors) - 1.0),
            }
        if "color_shift" in errors:
            changed["focal_length"] = value_of(changed, "focal_length") + value_of(errors, "color_shift")
        return changed

    def focal_length_with(self, errors: Errors) -> FloatArray:
        """f_M [m] of a camera that deviates by ``errors``."""
        return self.focal_length + value_of(errors, "focal_length")

    def pitch_scale(self, errors: Errors) -> FloatArray:
        """Ratio of the microlens pitch to that of the design [1]."""
        return 1.0 + value_of(errors, "microlens_pitch") / self.pitch

    def place_of(self, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> PlaceOnArray:
        """The position where the ray from a point [m] through the centre of the pupil meets the array."""
        slopes = _distortion(errors).image(x, y, np.asarray(z, dtype=np.float64) + self.entrance_pupil)
        distance, fall = self.mla_distance + value_of(errors, "mla_distance"), np.ones(())
        # The array lies at z₀ + tilt x, and the ray at x = t slope with t = g z − e, so that
        # t (1 − g tilt slope) = g z₀ − e.
        for slope, axis in zip(slopes, "xy", strict=True):
            if f"array_tilt_{axis}" in errors:  # a shortcut, as for distortion
                tilt = value_of(errors, f"array_tilt_{axis}")
                distance = distance + tilt * value_of(errors, f"principal_point_{axis}")
                fall = fall - self.pupil_ratio * tilt * slope
        distance = self.pupil_distance({}, distance) / fall
        return PlaceOnArray(geometry=self, errors=errors, x=slopes[0] * distance, y=slopes[1] * distance)

    def place_seen(self, errors: Errors, x: FloatArray, y: FloatArray) -> PlaceOnArray:
        """The position on the array of a position on the sensor [m], according to a calibration with ``errors``."""
        x, y = (
            seen - value_of(errors, f"array_offset_{axis}") - value_of(errors, f"principal_point_{axis}")
            for seen, axis in ((x, "x"), (y, "y"))
        )
        return PlaceOnArray(geometry=self, errors=errors, x=x, y=y)

    def microlens_object_distance(self, errors: Errors, place: PlaceOnArray, distance: ArrayLike) -> FloatArray:
        """Distance a_L [m] from the main lens's image of a point at a distance [m] to the array, with depth distortion.

        NaN for points that the main lens does not image.
        """
        a, f = np.asarray(distance, dtype=np.float64), self.focal_length_with(errors)
        image = place.displaced(f + focus_shift(np.where(a > f, a, np.nan), f))[0]
        return (place.flat_distance - image) / place.stretch


@dataclass(frozen=True, kw_only=True, eq=False)
class PlaceOnArray:
    """A position on the array of a camera that deviates from its design.

    Parameters
    ----------
    geometry, errors
        The design, and the deviations of the camera (or of its calibration) from it.
    x, y
        Coordinates from the axis of the main lens [m]; upright.
    """

    geometry: ArrayGeometry
    errors: Errors
    x: FloatArray
    y: FloatArray

    @cached_property
    def _tilt(self) -> FloatArray:
        """How much farther from the main lens the array is here [m]; a tilt rotates it about its own centre."""
        return np.asarray(
            sum(
                value_of(self.errors, f"array_tilt_{axis}") * (at + value_of(self.errors, f"principal_point_{axis}"))
                for axis, at in (("x", self.x), ("y", self.y))
            )
        )

    @cached_property
    def _square(self) -> FloatArray:
        """Square of the ratio of the distance from the axis to that of the corner."""
        return (self.x * self.x + self.y * self.y) / self.geometry.corner**2

    @cached_property
    def distance(self) -> FloatArray:
        """Distance z from main lens to array [m]."""
        return self.geometry.mla_distance + value_of(self.errors, "mla_distance") + self._tilt

    @cached_property
    def gap(self) -> FloatArray:
        """Distance b_L from array to sensor [m]."""
        return self.geometry.gap + value_of(self.errors, "microlens_gap") - self._tilt

    @cached_property
    def flat_distance(self) -> FloatArray:
        """z [m] minus the shift of the image by field curvature, as if the main lens had a flat field."""
        return self.distance - (self.geometry.field_curvature + value_of(self.errors, "field_curvature")) * self._square

    @cached_property
    def stretch(self) -> FloatArray:
        """Factor by which depth distortion stretches a_L [1]."""
        return 1.0 + value_of(self.errors, "depth_distortion") * self._square

    @property
    def _is_displacing(self) -> bool:
        return not self.errors.keys().isdisjoint(_DEPTH_COEFFICIENTS)

    def displaced(self, image: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distance b' [m] of the image of the main lens with the distortion ``d0`` to ``d2``, and its derivative.

        ``b' = b + (1 + d₀ b/z)(d₁ ρ² + d₂ ρ⁴)``, where ρ is the distance of the image at b [m] from the axis over that
        of the corner.
        """
        if not self._is_displacing:
            return image, np.ones(())
        d0, d1, d2 = (value_of(self.errors, f"depth_distortion_d{k}") for k in range(3))
        growth, on_array = d0 / self.geometry.mla_distance, self.geometry.pupil_distance({}, self.distance)
        on_image = self.geometry.pupil_distance({}, image)
        square = self._square * np.square(on_image / on_array)
        rise = 2.0 * self._square * self.geometry.pupil_ratio * on_image / np.square(on_array)
        moved, grown = square * (d1 + d2 * square), 1.0 + growth * image
        return image + grown * moved, 1.0 + growth * moved + grown * rise * (d1 + 2.0 * d2 * square)

    def undisplacement(self, image: FloatArray) -> FloatArray:
        """Distance [m] from an image at b' to that at b, by Newton's method; 0 for infinity. See `displaced`."""
        if not self._is_displacing:
            return np.zeros(())
        finite = np.where(np.isfinite(image), image, np.nan)
        b = finite
        for _ in range(_STEPS):
            seen, slope = self.displaced(b)
            b = b - (seen - finite) / slope
        return np.where(np.isfinite(image), b - finite, 0.0)

    @property
    def ray(self) -> tuple[FloatArray, FloatArray]:
        """Slopes of the ray that meets the array here through the centre of the pupil; NaN without one."""
        distance = self.geometry.pupil_distance({}, self.distance)
        return _distortion(self.errors).ray(self.x / distance, self.y / distance)[:2]

    @cached_property
    def on_sensor(self) -> tuple[FloatArray, FloatArray]:
        """The same position on the sensor [m]."""
        x, y = (
            at + value_of(self.errors, f"principal_point_{axis}") + value_of(self.errors, f"array_offset_{axis}")
            for axis, at in (("x", self.x), ("y", self.y))
        )
        return x, y

    @cached_property
    def valid(self) -> BoolArray:
        """Whether the lengths are positive and the distortion has an inverse."""
        valid = (self.geometry.focal_length_with(self.errors) > 0.0) & (self.gap > 0.0) & (self.distance > 0.0)
        away = self.geometry.pupil_distance({}, self.distance)
        return np.asarray(valid & _distortion(self.errors).has_ray(self.x / away, self.y / away))


Indices = NDArray[np.intp]
_FARTHEST: Final = (
    0.87  # largest distance, in pitches, from a position to the lattice point with its rounded coordinates
)


@dataclass(frozen=True, kw_only=True, eq=False)
class MicrolensExposure:
    """Main lens, array and sensor with errors in all parameters of `PLENOPTIC_ERRORS`.

    Parameters
    ----------
    name, sensor
        See `Exposure`.
    main_lens, microlenses, geometry
        The design.
    errors
        Deviations of the camera from its design: one number for each name, but for ``microlens_center_scatter`` one
        pair for every microlens, shape (microlenses, 2).
    reference_distance
        Distance [m] at which field curvature, depth distortion and radial distortion are exact; elsewhere they are
        accurate to first order.
    """

    name: str
    sensor: Sensor
    main_lens: Lens
    microlenses: MicrolensArray
    geometry: ArrayGeometry
    errors: Errors
    reference_distance: float
    pose: Pose = AT_ORIGIN

    def _error(self, name: str) -> float:
        return float(value_of(self.errors, name))

    @property
    def _basis(self) -> FloatArray:
        """Columns are the steps from a microlens to its neighbours [m]."""
        skew, rise = LATTICES[self.microlenses.layout].second_vector
        turn = self._error("array_rotation")
        c, s = math.cos(turn), math.sin(turn)
        pitch = self.microlenses.pitch * float(self.geometry.pitch_scale(self.errors))
        return pitch * np.array([[c, skew * c - rise * s], [s, skew * s + rise * c]])

    @property
    def offset(self) -> FloatArray:
        """Vector from the middle of the sensor to the middle of the array [m], shape (2, 1)."""
        return np.array([[self._error("array_offset_x")], [self._error("array_offset_y")]])

    @property
    def _axis(self) -> FloatArray:
        """Vector from the middle of the array to the axis of the main lens [m], shape (2, 1)."""
        return np.array([[self._error("principal_point_x")], [self._error("principal_point_y")]])

    def centres(self, first: Indices, second: Indices) -> FloatArray:
        """Centres on the array [m], shape (2, …), of the microlenses with given numbers along both basis vectors."""
        basis = self._basis
        centres = np.stack([basis[k, 0] * first + basis[k, 1] * second for k in (0, 1)])
        scatter = value_of(self.errors, "microlens_center_scatter")
        if scatter.ndim == 2:
            rows, columns = lattice_counts(self.microlenses, self.sensor)
            number = np.clip(first + columns // 2, 0, columns - 1) * rows + np.clip(second + rows // 2, 0, rows - 1)
            # A warmer sensor may need one row more than the design, for which the scatter was drawn.
            centres = centres + np.moveaxis(scatter[number % len(scatter)], -1, 0)
        return centres

    def place_of(self, centre: FloatArray) -> PlaceOnArray:
        """Places of microlenses at centres on the array [m], shape (2, …)."""
        x, y = centre - self._axis
        return PlaceOnArray(geometry=self.geometry, errors=self.errors, x=x, y=y)

    def image_centres(self, centre: FloatArray) -> FloatArray:
        """Centres of the micro-images on the sensor [m] of microlenses at centres on the array [m], shape (2, …)."""
        place = self.place_of(centre)
        over = place.gap * self.geometry.pupil_ratio / self.geometry.pupil_distance(self.errors, place.distance)
        return np.asarray(centre * (1.0 + over) - self._axis * over + self.offset)

    def cones(self, x: FloatArray, y: FloatArray, beyond: float = 0.0) -> LightCones:
        """One cone for each pixel and each microlens that can send it light from the pupil."""
        place = np.stack([x, y]) - self.offset
        z = self.geometry.mla_distance + self._error("mla_distance")
        narrower = (self.geometry.gap + self._error("microlens_gap")) / float(
            self.geometry.pupil_distance(self.errors, z)
        )
        over = narrower * self.geometry.pupil_ratio
        # Where rays through the centre of the pupil pass an array without tilt; the nearest microlens is the first of
        # each pixel.
        near = (place + self._axis * over) / (1.0 + over)
        first, second = np.rint(np.linalg.inv(self._basis) @ near).astype(np.intp)
        steps = self._steps_within(self._reach(over, narrower, beyond) + _FARTHEST)
        parts = [self._through(place, first + i, second + j, beyond) for i, j in steps]
        pixel, start, slope, meets, numbers, types = (
            np.concatenate([part[k] for part in parts], axis=-1) for k in range(6)
        )
        start_by_lens, slope_by_lens, stop_by_lens, start_by_pixel, slope_by_pixel, stop_by_pixel, light, gap = numbers
        return LightCones(
            pixel=pixel,
            start=start,
            slope=slope,
            start_by_pixel=start_by_pixel,
            start_by_lens=start_by_lens,
            slope_by_pixel=slope_by_pixel,
            slope_by_lens=slope_by_lens,
            lens_radius=self.microlenses.aperture_diameter / 2.0,
            stop=Stop(
                place=meets,
                by_pixel=stop_by_pixel,
                by_lens=stop_by_lens,
                radius=self.main_lens.pupil_diameter / 2.0,
            ),
            light=light,
            image_distance=gap,
            lens_type=types,
        )

    def _reach(self, over: float, narrower: float, beyond: float) -> float:
        """Largest distance from the centre of its micro-image to which a microlens sends light, in array pitches.

        Micro-images of the pupil are ``narrower`` than the entrance pupil by this factor.
        """
        array, gap = self.microlenses, self.geometry.gap
        blur = max(abs(gap / f - over - 1.0) for f in array.focal_lengths) * array.aperture_diameter / 2.0
        reach = self.main_lens.pupil_diameter / 2.0 * narrower + blur + self.sensor.pixel_pitch + beyond
        return reach / (1.0 + over) / array.pitch

    def _steps_within(self, reach: float) -> list[tuple[int, int]]:
        """Steps on the lattice to all microlenses within `reach` pitches."""
        lattice = LATTICES[self.microlenses.layout]
        span = math.ceil(reach / lattice.second_vector[1]) + 1
        steps = [(i, j) for i in range(-2 * span, 2 * span + 1) for j in range(-span, span + 1)]
        return [
            (i, j)
            for i, j in steps
            if math.hypot(i + j * lattice.second_vector[0], j * lattice.second_vector[1]) <= reach
        ]

    def _through(
        self, place: FloatArray, first: Indices, second: Indices, beyond: float
    ) -> tuple[Indices, FloatArray, FloatArray, FloatArray, FloatArray, Indices]:
        """Cones of pixels through one microlens each, at positions in the array's plane; only those that light passes.

        Behind the main lens the frame is rotated by 180° about the axis, so that pictures are upright: a point u' there
        is −u' in the plane of the lens. Rays start in the first principal plane. The stop is the exit pupil, in the
        scale of the entrance pupil, where it is finite for a pupil at infinity too.
        """
        centre = self.centres(first, second) - self._axis
        s = place - self._axis
        array = PlaceOnArray(geometry=self.geometry, errors=self.errors, x=centre[0], y=centre[1])
        gap, z = array.gap, array.distance
        # This difference changes by 1 or 2 from a microlens to each of its six neighbours.
        types = (first - second) % 3 if self.microlenses.types == 3 else np.zeros_like(first)
        bend = 1.0 / gap - 1.0 / np.asarray(self.microlenses.focal_lengths)[types]
        g, e = self.geometry.pupil_ratio, self.geometry.entrance_pupil
        to_pupil = self.geometry.pupil_distance(self.errors, z)
        slope = (centre - s) / gap
        meets = g * centre + to_pupil * slope
        # Light passes where the ray through the centre of the microlens meets the stop, to within the sizes there of
        # the microlens and of the pixel.
        widest = self.main_lens.pupil_diameter / 2.0 + np.abs(g + to_pupil * bend) * (
            self.microlenses.aperture_diameter / 2.0
        )
        widest = widest + to_pupil / gap * (self.sensor.pixel_pitch * math.sqrt(0.5) + beyond)
        lit = np.flatnonzero(np.sum(meets * meets, axis=0) < widest * widest)
        centre, slope, meets, bend = centre[:, lit], slope[:, lit], meets[:, lit], bend[lit]
        gap, z, to_pupil = (np.broadcast_to(values, first.shape)[lit] for values in (gap, z, to_pupil))
        f = self._focal_length(centre)
        on_lens = centre + z * slope
        seen = on_lens / f - slope
        if (lens := _distortion(self.errors)) is not _UNDISTORTED:
            # Distortion acts on the ray from the same point at the reference distance through the centre of the
            # entrance pupil.
            farther = 1.0 + e / self.reference_distance
            chief = (seen - on_lens / self.reference_distance) / farther
            seen = seen + (np.stack(lens.ray(chief[0], chief[1])[:2]) - chief) * farther
        turned = 1.0 + z * bend
        numbers = np.stack(
            [
                -turned,
                turned / f - bend,
                g + to_pupil * bend,
                z / gap,
                (1.0 - z / f) / gap,
                -to_pupil / gap,
                np.square(
                    self.microlenses.aperture_diameter
                    / gap
                    / (1.0 + np.sum(np.square(g * centre / (g * z - e)), axis=0))
                ),
                gap,
            ]
        )
        return lit, -on_lens, seen, meets, numbers, types[lit]

    def _focal_length(self, centre: FloatArray) -> FloatArray:
        """f_M [m] of a flat-field lens that forms the images of the main lens; exact at the reference distance."""
        f = self.geometry.focal_length_with(self.errors)
        place = PlaceOnArray(geometry=self.geometry, errors=self.errors, x=centre[0], y=centre[1])
        b = image_distance(self.reference_distance, f)
        # The flat-field lens images the object at b' instead of b, so 1/f' = 1/f − 1/b + 1/b'.
        seen = place.distance - (place.flat_distance - place.displaced(b)[0]) / place.stretch
        return np.asarray(f / (1.0 + f * (b - seen) / (b * seen)))

    def description(self) -> Description:
        """Distances, lattice and types of the array, including errors."""
        geometry, errors = self.geometry, self.errors
        to_pupil = float(geometry.pupil_distance(errors, geometry.mla_distance + self._error("mla_distance")))
        pupil_to_array = to_pupil / geometry.pupil_ratio if geometry.pupil_ratio else math.inf
        return {
            "focal_length": float(geometry.focal_length_with(errors)),
            "pupil_diameter": self.main_lens.pupil_diameter,
            "main_lens_to_array": geometry.mla_distance + self._error("mla_distance"),
            "array_to_sensor": geometry.gap + self._error("microlens_gap"),
            "pupil_to_array": pupil_to_array if math.isfinite(pupil_to_array) else "infinity",
            **({"entrance_pupil": geometry.entrance_pupil} if geometry.entrance_pupil else {}),
            "microlens_layout": self.microlenses.layout,
            "microlens_focal_lengths": list(self.microlenses.focal_lengths),
            "microlens_aperture_diameter": self.microlenses.aperture_diameter,
            "microlens_basis": self._basis.T.tolist(),
            "microlens_type": "(first − second) modulo the number of types, first and second counting along the basis",
            "array_centre_on_sensor": self.offset[:, 0].tolist(),
            "axis_on_array": self._axis[:, 0].tolist(),
        }


def lattice_counts(array: MicrolensArray, sensor: Sensor) -> tuple[int, int]:
    """Rows and columns of a lattice that includes every microlens in front of a sensor, with some to spare."""
    skew, rise = LATTICES[array.layout].second_vector
    rows = math.ceil(sensor.height / (rise * array.pitch)) + 8
    return rows, math.ceil(sensor.width / array.pitch + skew * rows) + 8
