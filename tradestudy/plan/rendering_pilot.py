"""How long pictures of a scene or of a depth loop take: a few pixels of a plane, times their number."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tradestudy.cameras.camera import Camera
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.imaging.models import PictureSettings
from tradestudy.imaging.render.sensor import Recording
from tradestudy.imaging.render.tiles import Tile, expected_electrons
from tradestudy.imaging.scenes.pattern import RandomPattern
from tradestudy.imaging.scenes.plain_surfaces import Flat
from tradestudy.imaging.scenes.scene import Plain, SceneSource
from tradestudy.plan.pilots import seconds_of
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.depth_loop import DepthLoopPart
from tradestudy.study.schema.scene_image import SceneImagePart, StairsPart
from tradestudy.wording import counted

_SIDE: Final = 64  # pixels across and down that are rendered
# A loop renders a trial first, and pictures of which a part shows what the estimator has two pictures of.
_PIXELS_OF_A_LOOP: Final = 5.0  # for each that a window needs; 3.5 of a stereo rig, 6 of a raw plenoptic picture
_READING: Final = 2.0  # times the rendering, with that
_PATTERN: Final = 512  # samples of a texture, whose size hardly matters for the time


def rendering_work(definition: StudyDefinition, image: SceneImagePart) -> tuple[float, str]:
    """Processor seconds of all pictures of the study's scene, and what is counted, in words."""
    cameras = [
        camera for name, camera in definition.case.all_cameras.items() if image.cameras is None or name in image.cameras
    ]
    settings, distances = _pictured(definition, cameras)
    middle = float(np.median(distances))
    pixels = sum(pixels_of(camera, middle, settings) for camera in cameras)
    seconds = math.fsum(rendering_seconds(camera, image, middle, settings) for camera in cameras)
    return seconds, f"{pixels / 1e6:.3g} million pixels of {counted(len(cameras), 'camera')}"


def loop_work(definition: StudyDefinition, part: DepthLoopPart) -> tuple[float, str]:
    """Processor seconds of all planes of the study's depth loop, and what is counted, in words."""
    varied = max(1, len(part.contrasts or ())) * max(1, len(part.electrons or ()))
    cameras = [definition.case.cameras[name] for name in part.cameras or definition.case.cameras]
    settings, _ = _pictured(definition, cameras)
    seconds = varied * math.fsum(loop_seconds(camera, part, settings) for camera in cameras)
    return seconds, counted(varied * len(cameras) * len(part.distances), "plane")


def _pictured(definition: StudyDefinition, cameras: Sequence[Camera]) -> tuple[PictureSettings, tuple[float, ...]]:
    """Texture, light and a sensor of a study that renders something, and the distances of its scene [m]."""
    scene = definition.file.scene
    assert scene is not None  # the study was checked
    assert scene.picture is not None
    return scene.picture.settings(scene.wavelength, cameras[0].sensor), tuple(scene.distance_values())


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
    faces = sum(2 * one.treads - 1 if isinstance(one, StairsPart) else 1 for one in image.surfaces)
    each = pixel_seconds(camera, distance, settings, image.samples)
    return each * faces * pixels_of(camera, distance, settings)


def loop_seconds(camera: DepthCamera, part: DepthLoopPart, settings: PictureSettings) -> float:
    """Processor seconds of a camera before all planes of a depth loop, in one texture and light."""
    geometry = camera.picture_geometry(np.array(part.distances))
    window = settings.asked_window(geometry.magnification, geometry.sample_pitch)
    window = np.minimum(window, geometry.compared.widest_px) * geometry.sample_pitch / camera.sensor.pixel_pitch
    pixels = part.windows * float(np.sum(np.square(window))) * _PIXELS_OF_A_LOOP
    middle = part.distances[len(part.distances) // 2]
    return pixels * pixel_seconds(camera, middle, settings, part.samples) * _READING


def pixel_seconds(camera: Camera, distance: float, settings: PictureSettings, samples: int) -> float:
    """Processor seconds of a pixel of a plane, in the middle of the first picture."""
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
        samples=samples,
        seed=0,
        rows=rows,
        columns=columns,
    )
    expected_electrons(replace(tile, rows=(rows[0], rows[0] + 1)))  # makes the texture, and what is kept for all
    return seconds_of(lambda: expected_electrons(tile)) / float(np.diff(rows)[0] * np.diff(columns)[0])
