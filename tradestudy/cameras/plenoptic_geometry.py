"""Main lens, microlens array and sensor with errors in all parameters, for all plenoptic cameras."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.depth_measurement import Errors, value_of
from tradestudy.cameras.environment import Environment
from tradestudy.cameras.error_vocabulary import PIXEL_NOISE
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.lens_model import Rational
from tradestudy.optics.thin_lens import focus_shift

Observation = tuple[FloatArray, FloatArray, FloatArray]
"""The quantity from which depth is measured, and its position on the sensor, x and y [m]."""


def disparity_error(errors: Errors) -> FloatArray:
    """Error of one disparity [m]: its noise and the scatter of two microlens centres.

    Coordinates are relative to the centre of their own microlens; the baseline is that of the regular grid.
    """
    return value_of(errors, PIXEL_NOISE) + math.sqrt(2.0) * value_of(errors, "microlens_center_scatter")


def _distortion(errors: Errors) -> Rational:
    """Radial distortion of the main lens."""
    return Rational(k1=value_of(errors, "distortion_k1"), k2=value_of(errors, "distortion_k2"))


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
    """

    focal_length: float
    mla_distance: float
    gap: float
    pitch: float
    corner: float
    field_curvature: float

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
        """The position where the ray from a point [m] through the centre of the main lens meets the array."""
        a = np.asarray(z, dtype=np.float64)
        slopes = _distortion(errors).image(x, y, a)
        distance = self.mla_distance + value_of(errors, "mla_distance")
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
        image = f + focus_shift(np.where(a > f, a, np.nan), f)
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
        return np.asarray(valid & _distortion(self.errors).has_ray(self.x / self.distance, self.y / self.distance))
