"""The light that a camera gathers from a scene: for every pixel, the cones of rays that its lenses send to it.

All coordinates are upright: x to the right, y down, z along the axis into the scene, and positions on the sensor as in
an upright picture. A ray starts in the plane z = 0 of its camera. It is linear in its position δ on the pixel and its
position η on the lens that it passes last, both relative to their centres:

    start = start₀ + start_δ δ + start_η η,    slope = slope₀ + slope_δ δ + slope_η η    (x and y alike).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.parts import Sensor
from tradestudy.optics.arrays import FloatArray

Description = dict[str, float | int | str | list[float] | list[list[float]]]
PerCone = float | FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Stop:
    """A round aperture elsewhere on the path; a ray passes ``place + by_pixel δ + by_lens η`` from its centre.

    Parameters
    ----------
    place
        Shape (2, cones) [m].
    by_pixel, by_lens
        One number, or one for each cone.
    radius
        Radius of the aperture [m].
    """

    place: FloatArray
    by_pixel: PerCone
    by_lens: PerCone
    radius: float


@dataclass(frozen=True, kw_only=True, eq=False)
class LightCones:
    """Cones of rays through one lens each.

    Parameters
    ----------
    pixel
        Index of the requested pixel to which each cone belongs, shape (cones,).
    start, slope
        Start and slope of the ray through the centres of pixel and lens, shape (2, cones) [m] and [1].
    start_by_pixel, start_by_lens, slope_by_pixel, slope_by_lens
        Their derivatives with respect to δ and η; one number, or one for each cone.
    lens_radius
        Aperture radius of that lens [m].
    stop
        Another aperture that cuts the cone; None if there is none.
    light
        ``cos⁴θ/N²`` of the whole lens, with N its f-number towards the pixel and θ the angle of the ray through the
        centre of the pupil, as in `field_illumination`; shape (cones,).
    image_distance
        Distance from the lens to the pixel [m]; negative where δ is rotated by 180° relative to η, as behind a single
        lens whose picture is upright. Diffraction needs it: a deflection of the ray by κ at the lens acts as
        ``δ = −κ × image_distance``.
    lens_type
        Type of the lens that each cone passes; lenses of one type differ only by errors and by field curvature.
    """

    pixel: NDArray[np.intp]
    start: FloatArray
    slope: FloatArray
    start_by_pixel: PerCone
    start_by_lens: PerCone
    slope_by_pixel: PerCone
    slope_by_lens: PerCone
    lens_radius: float
    stop: Stop | None
    light: FloatArray
    image_distance: PerCone
    lens_type: NDArray[np.intp] | int

    def only(self, kept: NDArray[np.intp]) -> LightCones:
        """The cones with the given indices."""

        def of(value: PerCone) -> PerCone:
            return value[kept] if isinstance(value, np.ndarray) and value.ndim else value

        stop = self.stop
        return replace(
            self,
            pixel=self.pixel[kept],
            start=self.start[:, kept],
            slope=self.slope[:, kept],
            start_by_pixel=of(self.start_by_pixel),
            start_by_lens=of(self.start_by_lens),
            slope_by_pixel=of(self.slope_by_pixel),
            slope_by_lens=of(self.slope_by_lens),
            light=self.light[kept],
            image_distance=of(self.image_distance),
            lens_type=self.lens_type if isinstance(self.lens_type, int) else self.lens_type[kept],
            stop=None
            if stop is None
            else replace(stop, place=stop.place[:, kept], by_pixel=of(stop.by_pixel), by_lens=of(stop.by_lens)),
        )


@dataclass(frozen=True, kw_only=True)
class Pose:
    """Position and orientation of a camera in the scene.

    Parameters
    ----------
    centre
        Centre of its lens [m].
    rotation
        Rows of the matrix that converts directions from the camera's frame to the scene's.
    """

    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: tuple[tuple[float, float, float], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


AT_ORIGIN: Final = Pose()


def pose_of(centre: FloatArray, rotation: FloatArray) -> Pose:
    """A pose from arrays of shape (3,) and (3, 3)."""
    x, y, z = (float(coordinate) for coordinate in centre)
    a, b, c = ((float(row[0]), float(row[1]), float(row[2])) for row in rotation)
    return Pose(centre=(x, y, z), rotation=(a, b, c))


class Exposure(Protocol):
    """One picture that a camera takes of a scene."""

    @property
    def name(self) -> str:
        """Name of the picture, unique for its camera."""

    @property
    def sensor(self) -> Sensor:
        """The sensor that takes it."""

    @property
    def pose(self) -> Pose:
        """The pose of its lens."""

    def cones(self, x: FloatArray, y: FloatArray, beyond: float = 0.0) -> LightCones:
        """The cones of pixels with centres at upright positions [m] from the middle of the sensor, shape (pixels,).

        Light that is bent by diffraction needs cones up to ``beyond`` [m] past the last position that rays through a
        lens reach.
        """

    def description(self) -> Description:
        """The numbers, in SI, that other programs need to use the picture; they include the errors of that camera."""
