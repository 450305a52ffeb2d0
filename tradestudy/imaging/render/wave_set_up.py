"""Set up rendering by waves for a picture: its types of lenses, and the depths that it shows."""

from __future__ import annotations

from typing import Final

import numpy as np

from tradestudy.cameras.light_cones import Exposure, LightCones
from tradestudy.imaging.render.nodes import LEAST_NODES, nodes
from tradestudy.imaging.render.sight import sight
from tradestudy.imaging.render.waves import LensWaves, Waves, paraxial_numbers
from tradestudy.imaging.scenes.pattern import GREY
from tradestudy.imaging.scenes.scene import SceneSource
from tradestudy.optics.two_apertures import Stop, TwoApertures

_GRID: Final = 33  # pixels to sample along each side of a picture
_MORE: Final = 0.05  # relative margin on either side of the depths found


def waves_of(exposure: Exposure, scene: SceneSource, wavelength: float) -> Waves:
    """Set up rendering by waves for a picture of a scene [m], with one set of numbers for each type of lens.

    Errors and field curvature make lenses of one type differ. Their mean determines how light is bent; the numbers of
    each lens determine where it goes.
    """
    sensor = exposure.sensor
    x, y = (
        (np.linspace(0.0, size - 1.0, _GRID).round() + 0.5 - size / 2.0) * sensor.pixel_pitch
        for size in (sensor.columns, sensor.rows)
    )
    places = np.meshgrid(x, y)
    cones = exposure.cones(places[0].ravel(), places[1].ravel())
    depth = sight(scene.build(), cones, exposure.pose, nodes(LEAST_NODES), sensor.pixel_pitch, GREY).depth
    seen = depth[np.isfinite(depth)]
    near, far = (float(np.min(seen)), float(np.max(seen))) if seen.size else scene.extent
    ends = np.array([near, far]) * np.array([1.0 - _MORE, 1.0 + _MORE])
    found, bent = [], 0.0
    types = np.broadcast_to(cones.lens_type, cones.pixel.shape)
    for one in range(int(np.max(types)) + 1):
        own = cones.only(np.flatnonzero(types == one))
        apertures = _apertures(own, wavelength)
        curvature = np.array([float(np.mean(paraxial_numbers(own, end)[2])) for end in ends])
        waves = np.sort((curvature - apertures.focused_curvature) * apertures.waves_per_curvature)
        lens = LensWaves(apertures=apertures, defocus=(float(waves[0]), float(waves[-1])))
        found.append(lens)
        if (stop := own.stop) is not None:
            bent = max(bent, lens.margin / abs(float(np.mean(stop.by_pixel))))
    return Waves(lenses=tuple(found), beyond=bent)


def _apertures(cones: LightCones, wavelength: float) -> TwoApertures:
    if (stop := cones.stop) is None:
        return TwoApertures(wavelength=wavelength, radius=cones.lens_radius)
    reach = float(np.mean(-np.asarray(cones.image_distance) * stop.by_pixel))
    own = Stop(scale=float(np.mean(stop.by_lens)), reach=reach, radius=stop.radius)
    return TwoApertures(wavelength=wavelength, radius=cones.lens_radius, stop=own)
