"""A picture through one lens: its field angles and scale, its exposure, and its geometry for a matcher."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.camera import DerivedValue, Properties
from tradestudy.cameras.light_cones import AT_ORIGIN, Description, LightCones, Pose, Stop
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.cameras.picture_geometry import LensStage, PictureGeometry, WholePictures
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_model import IDEAL, LensModel, slopes
from tradestudy.optics.thin_lens import blur_diameter, image_distance
from tradestudy.units import ANGLE


def edge_angle(lens: LensModel, across: float, down: float) -> float:
    """Angle from the axis [rad] of normalised image coordinates; at most the valid field of the lens."""
    x, y, z = (float(component) for component in lens.ray(across, down))
    return float(lens.valid_field) if math.isnan(x) else math.atan2(math.hypot(x, y), z)


@dataclass(frozen=True)
class PictureEdges:
    """The edges of a picture, and the lens through which they are seen.

    Parameters
    ----------
    lens
        Its model.
    across, down
        Left and right, upper and lower edge, in normalised image coordinates.
    """

    lens: LensModel
    across: tuple[float, float]
    down: tuple[float, float]

    @classmethod
    def of(
        cls,
        lens: LensModel,
        sensor: Sensor,
        principal_distances: tuple[float, float],
        principal_point: tuple[float, float] = (0.0, 0.0),
    ) -> PictureEdges:
        """The edges of a sensor, with both principal distances and the principal point from its middle [m]."""
        (left, right), (top, bottom) = (
            ((-extent / 2.0 - middle) / c, (extent / 2.0 - middle) / c)
            for extent, c, middle in zip(
                (sensor.width, sensor.height), principal_distances, principal_point, strict=True
            )
        )
        return cls(lens, (left, right), (top, bottom))

    @property
    def angles(self) -> tuple[float, float, float, float]:
        """Angles [rad] from the axis to the left, right, upper and lower edge, never beyond the lens's valid field.

        An edge on the other side of the axis has a negative angle.
        """
        (left, right), (top, bottom) = self.across, self.down
        return (
            -math.copysign(edge_angle(self.lens, left, 0.0), left),
            math.copysign(edge_angle(self.lens, right, 0.0), right),
            -math.copysign(edge_angle(self.lens, 0.0, top), top),
            math.copysign(edge_angle(self.lens, 0.0, bottom), bottom),
        )

    @property
    def fields_of_view(self) -> tuple[float, float]:
        """Angles [rad] between the left and right edge, and the upper left and lower right corner."""
        (left, right), (top, bottom) = self.across, self.down
        return sum(self.angles[:2]), edge_angle(self.lens, left, top) + edge_angle(self.lens, right, bottom)


def properties_of_lens(lens: LensModel, what: str) -> Properties:
    """Name, nonzero coefficients and valid field of a lens model; nothing for a pinhole."""
    if lens == IDEAL:
        return ()
    coefficients = ", ".join(f"{name} {value:g}" for name, value in lens.coefficients().items() if value)
    return (
        (what, f"{lens.name} ({coefficients})"),
        (f"valid field of the {what}, from the axis", DerivedValue(float(lens.valid_field), ANGLE)),
    )


def place_across(lens: LensModel, angle: ArrayLike) -> FloatArray:
    """Normalised image coordinates (..., 2) of a direction at an angle to the right of the axis [rad].

    For a pinhole, x is the tangent of the angle; NaN outside the valid field.
    """
    angle = np.asarray(angle, dtype=np.float64)
    return lens.project(np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=-1))


def scale_across(lens: LensModel, slope: ArrayLike) -> FloatArray:
    """Derivative of the image coordinate x with respect to the slope x/z: 1 for a pinhole."""
    slope = np.asarray(slope, dtype=np.float64)
    points = np.stack([slope, np.zeros_like(slope), np.ones_like(slope)], axis=-1)
    scale: FloatArray = lens.derivatives(points, ())[0][..., 0, 0]
    return scale


@dataclass(frozen=True, kw_only=True)
class SingleLensExposure:
    """A lens focused at one distance, and a sensor behind it; distances count from its entrance pupil.

    Parameters
    ----------
    name, sensor, pose
        See `Exposure`.
    lens
        The lens that gathers the light.
    focus_distance
        Distance in focus [m]; infinity is allowed.
    principal_distances
        Distances that convert horizontal and vertical positions on the sensor to slopes [m]; they differ where a
        calibration says so. None for the image distance of the focus.
    principal_point
        Position where the axis meets the sensor [m].
    distortion
        Lens model, which maps slopes.
    stop_separation
        Distance of a second, equal stop in front of the pupil [m], 0 for none; see `field_illumination`.
    """

    name: str
    sensor: Sensor
    lens: Lens
    focus_distance: float
    pose: Pose = AT_ORIGIN
    principal_distances: tuple[float, float] | None = None
    principal_point: tuple[float, float] = (0.0, 0.0)
    distortion: LensModel = IDEAL
    stop_separation: float = 0.0

    @property
    def image_distance(self) -> float:
        """Principal distance of the sensor [m], which determines the light on it; see `Lens.thin`."""
        return float(image_distance(self.focus_distance, self.lens.thin(self.focus_distance).focal_length))

    @property
    def scales(self) -> FloatArray:
        """Principal distances along x and y [m], shape (2,)."""
        return np.array(self.principal_distances or (self.image_distance, self.image_distance))

    def place(self, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
        """Positions on the sensor [m], (2, ...), of directions in the frame of the camera; NaN outside its field."""
        image = np.moveaxis(self.distortion.project(np.stack(np.broadcast_arrays(x, y, z), axis=-1)), -1, 0)
        along = (2, *[1] * (image.ndim - 1))
        return np.asarray(image * self.scales.reshape(along) + np.reshape(self.principal_point, along))

    def cones(self, x: FloatArray, y: FloatArray, beyond: float = 0.0) -> LightCones:  # noqa: ARG002  # all have theirs
        """``start = η``, ``slope = ray((s − s₀)/c) + δ ∂slope/∂s − η/a₀``.

        The derivative is that of a pixel's area, for both axes alike. Pixels outside the field of the lens are dark,
        and so are those that look beside or behind the scene, where no surface is.
        """
        across, down = (np.stack([x, y]) - np.reshape(self.principal_point, (2, 1))) / self.scales[:, np.newaxis]
        radius = self.lens.pupil_diameter / 2.0
        cosine_squared = 1.0 / (1.0 + across * across + down * down)
        slope = np.stack(slopes(*self.distortion.ray(across, down)))
        ahead = np.tensordot(np.array(self.pose.rotation[2]), np.concatenate([slope, np.ones((1, x.size))]), 1)
        dark = ~(ahead > 0.0)
        slope = np.where(dark, 0.0, slope)
        c = self._distance_of_area(slope)
        stop = None
        if self.stop_separation > 0.0:
            stop = Stop(
                place=slope * self.stop_separation,
                by_pixel=self.stop_separation / c,
                by_lens=1.0 - self.stop_separation / self.focus_distance,
                radius=radius,
            )
        return LightCones(
            pixel=np.arange(x.size),
            start=np.zeros_like(slope),
            slope=slope,
            start_by_pixel=0.0,
            start_by_lens=1.0,
            slope_by_pixel=1.0 / c,
            slope_by_lens=-1.0 / self.focus_distance,
            lens_radius=radius,
            stop=stop,
            light=np.where(dark, 0.0, np.square(cosine_squared * 2.0 * radius / self.image_distance)),
            image_distance=-c,
            lens_type=0,
        )

    def _distance_of_area(self, slope: FloatArray) -> float | FloatArray:
        """Distance c [m] that converts lengths on the sensor to slopes at points of the picture, by the area of pixels.

        ``c² = c_x c_y |det ∂(image)/∂(slope)|``.
        """
        c = math.sqrt(math.prod(self.scales))
        if self.distortion == IDEAL:
            return c
        ray = np.concatenate([slope, np.ones_like(slope[:1])]).T
        by_slope = self.distortion.derivatives(ray, ())[0][:, :, :2]
        return np.asarray(c * np.sqrt(np.abs(np.linalg.det(by_slope))))

    def description(self) -> Description:
        """Lens, focus and interior orientation."""
        pupil = self.lens.entrance_pupil
        return {
            "focal_length": self.lens.focal_length,
            "pupil_diameter": self.lens.pupil_diameter,
            "focus_distance": self.focus_distance,
            "lens_to_sensor": float(image_distance(self.focus_distance - pupil, self.lens.focal_length)),
            **({"entrance_pupil": pupil} if pupil else {}),
            "principal_distance": float(self.scales[0]),
            "principal_distance_vertical": float(self.scales[1]),
            "principal_point": list(self.principal_point),
            "distortion_model": self.distortion.name,
            **{f"distortion_{name}": value for name, value in self.distortion.coefficients().items()},
        }


def picture_through_lens(distance: FloatArray, lens: Lens, sensor: Sensor, focus: FloatArray) -> PictureGeometry:
    """The picture of objects at distances [m] through a lens focused at ``focus`` [m] for each; NaN without one.

    Distances count from the entrance pupil. The largest window is the whole sensor.
    """
    f, pupil = np.where(np.isnan(focus), lens.focal_length, lens.thin_focal_length(focus)), lens.pupil_diameter
    to_sensor = image_distance(focus, f)
    stage = LensStage(
        aperture_diameter=pupil,
        focal_length=f,
        object_distance=distance,
        plane_distance=to_sensor,
        blur_diameter=blur_diameter(distance, focus, f, pupil),
        relay=np.ones_like(distance),
    )
    return PictureGeometry(
        distance=distance,
        magnification=to_sensor / distance,
        sample_pitch=sensor.pixel_pitch,
        sample_width=sensor.pixel_pitch,
        sample_shape="square",
        pixel_pitch=sensor.pixel_pitch,
        compared=WholePictures(side_px=np.full_like(distance, min(sensor.columns, sensor.rows))),
        light_f_number=stage.f_number,
        pupil_diameter=pupil,
        main_lens=stage,
        microlens=None,
    )
