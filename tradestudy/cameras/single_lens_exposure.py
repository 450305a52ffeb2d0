"""A picture through one thin lens; each pixel sees the whole pupil."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tradestudy.cameras.light_cones import AT_ORIGIN, Description, LightCones, Pose, Stop
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_models.lens_model import LensModel, slopes
from tradestudy.optics.lens_models.rational import IDEAL
from tradestudy.optics.thin_lens import image_distance


@dataclass(frozen=True, kw_only=True)
class SingleLensExposure:
    """A thin lens focused at one distance, and a sensor behind it.

    Parameters
    ----------
    name, sensor, pose
        See `Exposure`.
    lens
        The lens that gathers the light.
    focus_distance
        Distance in focus [m]; infinity is allowed.
    principal_distance
        Distance that converts positions on the sensor to slopes [m]; None for the image distance of the focus.
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
    principal_distance: float | None = None
    principal_point: tuple[float, float] = (0.0, 0.0)
    distortion: LensModel = IDEAL
    stop_separation: float = 0.0

    @property
    def image_distance(self) -> float:
        """Distance from lens to sensor [m], which determines the light on the sensor."""
        return float(image_distance(self.focus_distance, self.lens.focal_length))

    @property
    def _scale(self) -> float:
        return self.image_distance if self.principal_distance is None else self.principal_distance

    def cones(self, x: FloatArray, y: FloatArray, beyond: float = 0.0) -> LightCones:  # noqa: ARG002  # all have theirs
        """``start = η``, ``slope = (s + δ)/c − η/a₀``."""
        c, radius = self._scale, self.lens.pupil_diameter / 2.0
        across, down = (x - self.principal_point[0]) / c, (y - self.principal_point[1]) / c
        cosine_squared = 1.0 / (1.0 + across * across + down * down)
        across, down = slopes(*self.distortion.ray(across, down))
        dark = np.isnan(across)  # pixels beyond the field of the lens
        slope = np.where(dark, 0.0, np.stack([across, down]))
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

    def description(self) -> Description:
        """Lens, focus and interior orientation."""
        return {
            "focal_length": self.lens.focal_length,
            "pupil_diameter": self.lens.pupil_diameter,
            "focus_distance": self.focus_distance,
            "lens_to_sensor": self.image_distance,
            "principal_distance": self._scale,
            "principal_point": list(self.principal_point),
            "distortion_model": self.distortion.name,
            **{f"distortion_{name}": value for name, value in self.distortion.coefficients().items()},
        }
