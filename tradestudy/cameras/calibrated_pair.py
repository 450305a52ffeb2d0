"""Calibrated cameras, and a calibrated pair of them, which measures depth instead of the design."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Final, Protocol

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.depth_measurement import ErrorVocabulary
from tradestudy.cameras.parts import Sensor
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_model import IDEAL, LensModel

Lenses = tuple[LensModel, LensModel]
"""Lens models of the left and the right camera."""
PINHOLES: Final[Lenses] = (IDEAL, IDEAL)
RADIAL: Final = ("k1", "k2")
"""The coefficients that are parameters of a camera by default."""
LARGEST_FOCAL_RATIO: Final = 1.05
"""Focal lengths of two cameras [px] that differ by more make a pair unequal."""


@dataclass(frozen=True, kw_only=True)
class CalibratedCamera:
    """A calibrated camera.

    Parameters
    ----------
    focal_lengths
        Horizontal and vertical focal length [px].
    principal_point
        Position in the picture, whose first pixel has its centre at (0, 0) [px].
    lens
        Lens model.
    """

    focal_lengths: tuple[float, float]
    principal_point: tuple[float, float]
    lens: LensModel

    @property
    def scale(self) -> float:
        """Scale of the picture on the axis [px]."""
        return math.sqrt(math.prod(self.focal_lengths)) * self.lens.scale_on_axis

    def on_sensor(self, sensor: Sensor) -> tuple[tuple[float, float], tuple[float, float]]:
        """Principal distances along x and y, and the principal point from the middle of a sensor [m]."""
        pitch, ends = sensor.pixel_pitch, (sensor.columns - 1, sensor.rows - 1)
        (fx, fy), (x, y) = self.focal_lengths, self.principal_point
        return (fx * pitch, fy * pitch), ((x - ends[0] / 2.0) * pitch, (y - ends[1] / 2.0) * pitch)


@dataclass(frozen=True, kw_only=True)
class CalibratedPair:
    """A calibrated pair of cameras.

    Parameters
    ----------
    parameters
        For the left and then the right camera: focal lengths and principal point [px], and coefficients of its lens
        model [1, rad]. Then the rotation vector [rad] and the translation [m] from the left camera's frame to the right
        one's, as `calibration.projection` expects them.
    lenses
        Lens models of both cameras.
    free
        Names of the coefficients of both cameras that are parameters and can be in error.
    """

    parameters: tuple[float, ...]
    lenses: Lenses = PINHOLES
    free: tuple[str, ...] = RADIAL

    @property
    def focal_length(self) -> float:
        """The `common_focal_length` of the means of both cameras [px]."""
        left, right = (np.mean(camera.focal_lengths) for camera in self.cameras)
        return float(common_focal_length(left, right))

    @property
    def cameras(self) -> tuple[CalibratedCamera, CalibratedCamera]:
        """The left and the right camera."""
        count = len(self.parameters[:-6]) // 2
        left, right = (
            _camera(self.parameters[first : first + count], lens, self.free)
            for first, lens in zip((0, count), self.lenses, strict=True)
        )
        return left, right

    @property
    def is_unequal(self) -> bool:
        """Whether the scales of the two pictures differ by more than `LARGEST_FOCAL_RATIO`."""
        scales = [camera.scale for camera in self.cameras]
        return max(scales) > LARGEST_FOCAL_RATIO * min(scales)

    @property
    def rotation(self) -> FloatArray:
        """Rotation vector from the frame of the left camera to that of the right one [rad], shape (3,)."""
        return np.array(self.parameters[-6:-3])

    @property
    def translation(self) -> FloatArray:
        """Position of the left camera in the frame of the right one [m], shape (3,)."""
        return np.array(self.parameters[-3:])


def _camera(interior: tuple[float, ...], lens: LensModel, free: tuple[str, ...]) -> CalibratedCamera:
    fx, fy, cx, cy, *coefficients = map(float, interior)
    return CalibratedCamera(
        focal_lengths=(fx, fy),
        principal_point=(cx, cy),
        lens=replace(lens, **dict(zip(free, coefficients, strict=True))),
    )


def common_focal_length(left: ArrayLike, right: ArrayLike) -> FloatArray:
    """Focal length c of the equal pair that measures directions as precisely: ``2/c² = 1/c_l² + 1/c_r²``.

    An error of u pixels is an angle of u/c. If the errors of both pictures are independent and equal in pixels of their
    own camera, those of the two directions add up to ``u² (1/c_l² + 1/c_r²)``, as do those of two cameras with c.

    Parameters
    ----------
    left, right : arrays (...)
        Focal lengths of the two cameras [px], or both in another unit.
    """
    shorter, longer = np.minimum(left, right), np.maximum(left, right)
    return np.asarray(shorter * np.sqrt(2.0 / (1.0 + np.square(shorter / longer))))


class PairGeometry(Protocol):
    """Two equal cameras side by side, of any kind with `corners_calibrate`."""

    error_vocabulary: ClassVar[ErrorVocabulary]

    @property
    def sensor(self) -> Sensor:
        """The sensor of each camera."""

    @property
    def baseline(self) -> float:
        """Distance between the two centres of projection [m]."""

    @property
    def principal_distance(self) -> float:
        """Distance from the centre of projection to the sensor [m]."""

    @property
    def distortion(self) -> LensModel:
        """Lens model of both cameras."""

    @property
    def convergence_angle(self) -> float:
        """Angle between the optical axes [rad]."""

    @property
    def field_of_view(self) -> float:
        """Horizontal field of view of one camera [rad]."""
