"""What a run refuses about pictures of scenes and planes, found before anything is computed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tradestudy.analysis.scene_pictures import declared_image, extent_and_cameras, recording_of
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_map import DepthSearch
from tradestudy.errors import OutOfRangeError, Problem, StudyError
from tradestudy.imaging.models import mean_electrons
from tradestudy.imaging.render.tiles import Recording
from tradestudy.run.depth_loop import NOISE, loop_points
from tradestudy.run.depth_maps import set_up_readers
from tradestudy.run.pictures import refuse_too_large
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.scene import Rig
from tradestudy.units import ELECTRONS, pretty

_SEARCHED = 1.1  # times the distance of a plane, and divided by it: any range would do


def refuse_pictures(definition: StudyDefinition) -> None:
    """Refuse pictures that a run of the study would not render, or in which it could not measure depth.

    Raises
    ------
    StudyError
        The scene cannot be rendered, a camera cannot measure depth in its pictures, the matcher is not installed, or
        the pictures in which depth is to be measured would be saturated.
    UnaffordableError
        The pictures do not fit into the free memory.
    """
    scene, loop = definition.file.scene, definition.file.depth_loop
    problems: list[Problem] = []
    if scene is not None and scene.image is not None:
        # A rig is drawn from its calibration, which may have to be inferred first.
        inferred = all(camera.calibration.inferred for camera in definition.case.cameras.values())
        rig: Rig | None = None if inferred else "as-designed"
        refuse_too_large(definition, rig=rig)
        if scene.image.depth_maps:
            problems += _problems_of_depth_maps(definition, rig)
    if loop is not None:
        problems += _problems_of_loop(definition)
    if problems:
        raise StudyError(problems)


def _problems_of_depth_maps(definition: StudyDefinition, rig: Rig | None) -> Iterator[Problem]:
    where: tuple[str, ...] = ("scene", "image", "depth_maps")
    try:
        set_up_readers(definition, rig=rig)
    except OutOfRangeError as error:
        yield definition.document.locate(where).problem(where, str(error))
    image, picture = declared_image(definition)
    extent, cameras = extent_and_cameras(definition, rig=rig)
    for taken in cameras:
        recording = recording_of(image, picture, taken.camera.sensor)
        if what := _saturated(taken.name, taken.camera, recording, sum(extent) / 2.0):
            where = ("scene", "picture", "light")
            yield definition.document.locate(where).problem(where, what)


def _problems_of_loop(definition: StudyDefinition) -> Iterator[Problem]:
    where, loop = ("depth_loop",), definition.file.depth_loop
    assert loop is not None
    found: set[str] = set()
    try:
        for point in loop_points(definition, loop).values():
            near, far = point.distance / _SEARCHED, point.distance * _SEARCHED
            search = DepthSearch(near=near, far=far, window_px=point.window_px)
            if point.name not in found:
                point.reader(camera=point.camera, search=search)
            settings = point.settings
            recording = Recording(
                light=settings.light, noise=settings.sensor_noise, model=NOISE, pixel_fill=settings.pixel_fill
            )
            if point.name not in found and (what := _saturated(point.name, point.camera, recording, point.distance)):
                yield definition.document.locate(where).problem(where, what)
            found.add(point.name)
    except OutOfRangeError as error:
        yield definition.document.locate(where).problem(where, str(error))


def _saturated(name: str, camera: object, recording: Recording, distance: float) -> str:
    """Why depth cannot be measured in pictures of which more than half of the pixels saturate; empty if it can."""
    if not isinstance(camera, DepthCamera):
        return ""
    f_number = camera.picture_geometry(np.array([distance])).light_f_number
    mean = float(np.ravel(mean_electrons(recording.light, f_number, camera.sensor.pixel_pitch))[0])
    if not mean >= recording.saturation_electrons:
        return ""
    return (
        f"the pictures of {name} would be saturated: {pretty(mean, ELECTRONS)} on the axis, of which a pixel holds "
        f"{pretty(recording.saturation_electrons, ELECTRONS)}; reduce the light, or measure no depth in them"
    )
