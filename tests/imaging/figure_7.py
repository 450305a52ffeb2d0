"""The camera of Figure 7 of the paper, and pictures of small parts of what it sees."""

from __future__ import annotations

from typing import Any

import numpy as np

from tradestudy.cameras.light_cones import Exposure, LightCones
from tradestudy.cameras.microlens_exposure import ArrayGeometry, MicrolensExposure
from tradestudy.cameras.parts import Lens, MicrolensArray, Sensor
from tradestudy.imaging.render.nodes import lit_area, nodes
from tradestudy.imaging.render.sight import sight
from tradestudy.imaging.scenes.pattern import Pattern
from tradestudy.imaging.scenes.scene import Scene
from tradestudy.imaging.scenes.surfaces import Flat
from tradestudy.optics.arrays import FloatArray

PIXEL, PITCH, APERTURE = 5.5e-6, 126.5e-6, 113.7e-6
F, F_L, GAP, Z = 12.5e-3, 0.432e-3, 0.587e-3, 15.271e-3
PUPIL = F / 3.8
ENDLESS = (np.inf, np.inf)


def figure_7(pixels: int = 256, focal_lengths: tuple[float, ...] = (F_L,), **changes: Any) -> MicrolensExposure:
    sensor = Sensor(columns=pixels, rows=pixels, pixel_pitch=PIXEL)
    gap, z = changes.pop("gap", GAP), changes.pop("z", Z)
    values: dict[str, Any] = {
        "name": "raw",
        "sensor": sensor,
        "main_lens": Lens(focal_length=F, f_number=3.8),
        "microlenses": MicrolensArray(
            layout="hexagonal", pitch=PITCH, gap=gap, focal_lengths=focal_lengths, aperture_diameter=APERTURE
        ),
        "geometry": ArrayGeometry(
            focal_length=F,
            mla_distance=z,
            gap=gap,
            pitch=PITCH,
            corner=sensor.diagonal / 2.0,
            field_curvature=0.0,
        ),
        "errors": {},
        "reference_distance": 0.15,
    }
    return MicrolensExposure(**(values | changes))


def places(exposure: Exposure, rows: slice, columns: slice) -> tuple[FloatArray, FloatArray]:
    """Centres of pixels [m], upright."""
    sensor = exposure.sensor
    down, across = (grid.ravel() for grid in np.mgrid[rows, columns])
    return (
        (across + 0.5 - sensor.columns / 2) * sensor.pixel_pitch,
        (down + 0.5 - sensor.rows / 2) * sensor.pixel_pitch,
    )


def lit_share(cones: LightCones) -> FloatArray:
    return lit_area(cones, PIXEL) / (np.pi * cones.lens_radius**2) * cones.light


def picture(exposure: Exposure, scene: Scene, rows: slice, columns: slice, samples: int = 10) -> FloatArray:
    """Light on some pixels, 1/N² where a lens is wholly lit by brightness 1."""
    cones = exposure.cones(*places(exposure, rows, columns))
    seen = sight(scene, cones, exposure.pose, nodes(samples), exposure.sensor.pixel_pitch, -1)
    shape = (rows.stop - rows.start, columns.stop - columns.start)
    light = np.bincount(cones.pixel, weights=lit_share(cones) * seen.brightness, minlength=shape[0] * shape[1])
    return light.reshape(shape)


def wall(pattern: Pattern, distance: float) -> Scene:
    """A plane across the axis, the pattern's first sample in its middle."""
    plane = Flat(
        centre=(0.0, 0.0, distance),
        first=(1.0, 0.0, 0.0),
        second=(0.0, 1.0, 0.0),
        size=ENDLESS,
        pattern=None,  # type: ignore[arg-type]  # a built scene has its pattern beside it
    )
    return Scene(surfaces=[plane], patterns=[pattern], background=0.0)
