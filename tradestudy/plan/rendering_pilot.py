"""How long the pictures of a study's scene take to render: a few pixels of each, of a plane, times their number."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from tradestudy.cameras.camera import Camera
from tradestudy.imaging.models import PictureSettings
from tradestudy.imaging.render.sensor import Recording
from tradestudy.imaging.render.tiles import Tile, expected_electrons
from tradestudy.imaging.scenes.pattern import RandomPattern
from tradestudy.imaging.scenes.plain_surfaces import Flat
from tradestudy.imaging.scenes.scene import Plain, SceneSource
from tradestudy.plan.pilots import seconds_of
from tradestudy.study.schema.scene_image import SceneImagePart, StairsPart

_SIDE: Final = 64  # pixels across and down that are rendered
_PATTERN: Final = 512  # samples of a texture, whose size hardly matters for the time


def pixels_of(camera: Camera, distance: float, settings: PictureSettings) -> int:
    """Pixels of all pictures that a camera takes of a scene whose middle is at a distance [m]."""
    exposures = camera.exposures(distance, {}, None, settings.stop_separation)
    return sum(one.sensor.columns * one.sensor.rows for one in exposures)


def rendering_seconds(camera: Camera, image: SceneImagePart, distance: float, settings: PictureSettings) -> float:
    """Processor seconds of all pictures that a camera takes of a scene.

    Parameters
    ----------
    camera
        As it was designed.
    image
        The scene; its surfaces count, not their shapes: a rock takes from half to 1.2 times as long as a plane.
    distance
        Of its middle [m].
    settings
        Texture, light and sensor.
    """
    exposure = camera.exposures(distance, {}, None, settings.stop_separation)[0]
    sensor, texture = exposure.sensor, settings.texture
    plane = Flat(
        centre=(0.0, 0.0, distance),
        first=(1.0, 0.0, 0.0),
        second=(0.0, 1.0, 0.0),
        size=(math.inf, math.inf),
        pattern=RandomPattern(texture=texture, sample=texture.correlation_length / 4.0, side=_PATTERN, seed=0),
    )
    rows, columns = (
        (max(0, (size - _SIDE) // 2), min(size, (size + _SIDE) // 2)) for size in (sensor.rows, sensor.columns)
    )
    tile = Tile(
        camera="pilot",
        exposure=exposure,
        scene=SceneSource(surfaces=(Plain(surface=plane),), background=0.0),
        recording=Recording(light=settings.light, noise=settings.sensor_noise, model="off"),
        samples=image.samples,
        seed=0,
        rows=rows,
        columns=columns,
    )
    expected_electrons(replace(tile, rows=(rows[0], rows[0] + 1)))  # makes the texture, and what is kept for all
    each = seconds_of(lambda: expected_electrons(tile)) / float(np.diff(rows)[0] * np.diff(columns)[0])
    faces = sum(2 * one.treads - 1 if isinstance(one, StairsPart) else 1 for one in image.surfaces)
    return each * faces * pixels_of(camera, distance, settings)
