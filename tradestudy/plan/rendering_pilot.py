"""Predict the time to render a scene or a depth loop: time a few pixels and scale by their number."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from tradestudy.analysis.scene_pictures import declared_image, recording_of, set_up, whole_pictures
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.effects.models import OFF
from tradestudy.imaging.models import PictureSettings
from tradestudy.imaging.render.sensor import Recording
from tradestudy.imaging.render.tiles import Tile, expected_electrons
from tradestudy.imaging.scenes.pattern import RandomPattern
from tradestudy.imaging.scenes.plain_surfaces import Flat
from tradestudy.imaging.scenes.scene import Plain, SceneSource
from tradestudy.optics.arrays import FloatArray
from tradestudy.plan.pilots import seconds_of
from tradestudy.plan.problems.scene_pictures import TRIAL_TEXTURE, name_of
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.depth_loop import DepthLoopPart
from tradestudy.wording import counted

_SIDE: Final = 64  # rendered pixels across and down
# A loop first renders a trial, and only a part of its pictures shows points that appear in two of them.
_PIXELS_OF_A_LOOP: Final = 5.0  # rendered per pixel of the windows; 3.5 for a stereo rig, 6 for a raw plenoptic picture
_READING: Final = 1.4  # rendering and reading depth, relative to rendering alone
# Computing the tables of spreads takes most of the difference, and would take as long in a pilot.
_WAVES_OVER_RAYS: Final = 2.0  # 1.1 for a stereo pair, 3 for a raw plenoptic picture
_PATTERN: Final = 512  # samples of a texture, whose size hardly matters for the time


def scene_work(definition: StudyDefinition) -> Iterator[tuple[str, tuple[float, ...], str]]:
    """Steps of rendering the scene with the chosen models: name, time of each camera [s], work in words."""
    image, picture = declared_image(definition)
    scene, cameras = set_up(definition, rig="as-designed", texture_side=TRIAL_TEXTURE)
    rendering: list[float] = []
    reading: list[float] = []
    pixels = 0
    for taken in cameras:
        recording = recording_of(image, picture, taken.camera.sensor)
        pictures = whole_pictures(definition, image, scene, taken, recording)
        by_rays = len(pictures) * picture_seconds(pictures[0])
        models = definition.models.get(name_of(taken.name), {})
        by_waves = models.get("main_lens_diffraction", OFF) != OFF
        rendering.append(by_rays * (_WAVES_OVER_RAYS if by_waves else 1.0))
        if image.depth_maps and (reader := definition.file.cameras[taken.name].reader) is not None:
            reading.append(by_rays * reader.relative_effort)
        pixels += sum(one.rows[1] * one.columns[1] for one in pictures)
    work = f"{pixels / 1e6:.3g} million pixels of {counted(len(cameras), 'camera')}"
    yield "rendering", tuple(rendering), work
    if image.depth_maps:
        yield "depth maps", tuple(reading), work


def picture_seconds(whole: Tile) -> float:
    """Time of a picture by rays [s], given as one tile: extrapolated from a patch in its middle."""
    rows, columns = (
        (max(0, (size - _SIDE) // 2), min(size, (size + _SIDE) // 2)) for size in (whole.rows[1], whole.columns[1])
    )
    patch = replace(whole, rows=rows, columns=columns)
    expected_electrons(replace(patch, rows=(rows[0], rows[0] + 1)))  # prepares texture and surfaces
    share = whole.rows[1] * whole.columns[1] / (float(np.diff(rows)[0]) * float(np.diff(columns)[0]))
    return share * min(seconds_of(lambda: expected_electrons(patch)) for _ in range(2))


def loop_work(definition: StudyDefinition, part: DepthLoopPart) -> tuple[tuple[float, ...], str]:
    """Time of each plane of the study's depth loop [s], in order, and the amount of work in words."""
    varied = max(1, len(part.contrasts or ())) * max(1, len(part.electrons or ()))
    cameras = [definition.case.cameras[name] for name in part.cameras or definition.case.cameras]
    settings = _settings(definition, cameras[0])
    planes = np.concatenate([np.repeat(plane_seconds(camera, part, settings), varied) for camera in cameras])
    return tuple(planes.tolist()), counted(planes.size, "plane")


def _settings(definition: StudyDefinition, camera: DepthCamera) -> PictureSettings:
    """Texture, light and sensor of a study that renders pictures."""
    scene = definition.file.scene
    assert scene is not None  # the study was checked
    assert scene.picture is not None
    return scene.picture.settings(scene.wavelength, camera.sensor)


def plane_seconds(camera: DepthCamera, part: DepthLoopPart, settings: PictureSettings) -> FloatArray:
    """Time of a camera's plane at each distance of a depth loop [s], in one texture and light."""
    geometry = camera.picture_geometry(np.array(part.distances))
    window = settings.asked_window(geometry.magnification, geometry.sample_pitch)
    window = np.minimum(window, geometry.compared.widest_px) * geometry.sample_pitch / camera.sensor.pixel_pitch
    pixels = part.windows * np.square(window) * _PIXELS_OF_A_LOOP
    middle = part.distances[len(part.distances) // 2]
    return np.asarray(pixels * pixel_seconds(camera, middle, settings, part.samples) * _READING)


def pixel_seconds(camera: DepthCamera, distance: float, settings: PictureSettings, samples: int) -> float:
    """Time per pixel of a plane [s], in the middle of the first picture."""
    exposure = camera.exposures(distance, {}, None, settings.stop_separation)[0]
    sensor, texture = exposure.sensor, settings.texture
    plane = Flat(
        centre=(0.0, 0.0, distance),
        first=(1.0, 0.0, 0.0),
        second=(0.0, 1.0, 0.0),
        size=(math.inf, math.inf),
        pattern=RandomPattern(texture=texture, sample=texture.correlation_length / 4.0, side=_PATTERN, seed=0),
    )
    whole = Tile(
        camera="pilot",
        exposure=exposure,
        scene=SceneSource(surfaces=(Plain(surface=plane),), background=0.0),
        recording=Recording(light=settings.light, noise=settings.sensor_noise, model="off"),
        samples=samples,
        seed=0,
        rows=(0, sensor.rows),
        columns=(0, sensor.columns),
    )
    return picture_seconds(whole) / (sensor.rows * sensor.columns)
