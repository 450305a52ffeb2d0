"""The pictures of a study's scene and the depth measured in them, computed once and written as files."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.answers import pictures
from tradestudy.answers.depth_loop import NOISE, loop_points
from tradestudy.answers.depth_maps import MeasuredDepth, depth_map_values, measure_depth, set_up_readers, write_depth
from tradestudy.answers.pictures import (
    LARGEST,
    Rendering,
    TakenPicture,
    padded,
    refuse_too_large,
    render_scene,
    write_pictures,
)
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_map import DepthSearch
from tradestudy.errors import OutOfRangeError, Problem, StudyError
from tradestudy.execution import Steps
from tradestudy.imaging.models import mean_electrons
from tradestudy.imaging.render.tiles import Recording
from tradestudy.models.rendered_scene import declared_image, extent_and_cameras, recording_of
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.results.storage import list_written
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.schema.scene import Rig
from tradestudy.units import ELECTRONS, pretty

if TYPE_CHECKING:
    import xarray as xr  # only for types here: plans import this, too


@dataclass(frozen=True, kw_only=True, eq=False)
class TakenScene:
    """The pictures of a study's scene, with the depth measured in them.

    Parameters
    ----------
    rendering
        All pictures.
    depths
        Depth measured by each camera; empty if not requested.
    written
        Paths of the picture files.
    """

    rendering: Rendering
    depths: Sequence[MeasuredDepth]
    written: Sequence[Path]

    @property
    def arrays(self) -> dict[str, dict[str, NDArray[Any]]]:
        """The content of the files of pictures and depths by camera and by name of the file without its ending."""
        arrays: dict[str, dict[str, NDArray[Any]]] = {}
        for picture in self.rendering.pictures:
            arrays.setdefault(picture.camera, {}).update(
                {picture.name: picture.values, f"{picture.name}_depth": picture.depth}
            )
        for measured in self.depths:
            arrays[measured.camera].update(measured.arrays)
        return arrays


def files_of_pictures(study: PreparedStudy) -> list[str]:
    """Patterns of the files that `take_scene` writes."""
    names = study.case.all_cameras
    return [f"{escape(camera_name)}/*.{ending}" for camera_name in names for ending in ("png", "tiff", "npy", "json")]


def take_scene(study: PreparedStudy, directory: Path | None, steps: Steps, *, depth: bool) -> TakenScene:
    """Render every picture of the study's scene, measure depth in them if requested, and write both.

    Parameters
    ----------
    study
        A study with ``scene.image``, its calibrations inferred.
    directory
        Output folder, with a subfolder for each camera: its pictures, their depth, ``camera.json`` and its depth map;
        None writes nothing.
    steps
        How tiles and maps are computed.
    depth
        Whether to measure depth.

    Raises
    ------
    StudyError
        The study declares no scene to render, or its scene cannot be rendered.
    UnaffordableError
        The pictures do not fit into the free memory; raised before anything is rendered.
    OutOfRangeError
        A camera cannot measure depth in its pictures; raised before anything is rendered.
    """
    steps.progress(pictures.STEP, 0.0)
    readers = set_up_readers(study) if depth else []
    rendering = render_scene(study, steps)
    written = write_pictures(rendering, directory) if directory is not None else []
    depths = measure_depth(rendering, readers, steps)
    if directory is not None:
        for measured in depths:
            write_depth(measured, directory / measured.camera, rendering.image.depth_format)
        files = [path for pattern in files_of_pictures(study) for path in sorted(directory.glob(pattern))]
        list_written(directory, [path.relative_to(directory).as_posix() for path in files])
    return TakenScene(rendering=rendering, depths=depths, written=written)


_DETAIL: Final = 96  # pixels


def pictures_group(taken: TakenScene) -> xr.Dataset:
    """/pictures over pictures with their rows and columns, and over the cameras that measured depth in them."""
    pictures = taken.rendering.pictures
    reduced = [_reduced(picture) for picture in pictures]
    rows, columns = (max(brightness.shape[k] for brightness, _ in reduced) for k in (0, 1))
    values: dict[str, Any] = {
        "brightness": [padded(brightness, (rows, columns)) for brightness, _ in reduced],
        "true_depth": [padded(depth, (rows, columns)) for _, depth in reduced],
        "detail": [padded(_detail(picture), (_DETAIL, _DETAIL)) for picture in pictures],
        "camera_of": [picture.camera for picture in pictures],
        "block": [float(_block(picture)) for picture in pictures],
        "columns": [float(picture.values.shape[1]) for picture in pictures],
        "rows": [float(picture.values.shape[0]) for picture in pictures],
        "pixel_pitch": [picture.pixel_pitch for picture in pictures],
        "saturated": [float(picture.saturated) for picture in pictures],
        "sampling_error": [picture.sampling_error for picture in pictures],
        "by_waves": [float(picture.tile.waves is not None) for picture in pictures],
        "model_error": [picture.model_error for picture in pictures],
    }
    labels = {"picture": [f"{picture.camera} {picture.name}" for picture in pictures]}
    if taken.depths:
        values |= depth_map_values(taken.depths, {camera.name: camera.camera for camera in taken.rendering.cameras})
        labels["mapped_camera"] = [measured.camera for measured in taken.depths]
    return dataset("pictures", values, labels)


def _block(picture: TakenPicture) -> int:
    largest: int = max(picture.values.shape)
    return math.ceil(largest / LARGEST)


def _reduced(picture: TakenPicture) -> tuple[FloatArray, FloatArray]:
    """Brightness and depth of blocks; incomplete blocks at the right and bottom edges are left out."""
    side = _block(picture)
    rows, columns = (size // side for size in picture.values.shape)
    inside = picture.values[: rows * side, : columns * side].astype(np.float64)
    blocks = inside.reshape(rows, side, columns, side).mean(axis=(1, 3))
    middle = slice(side // 2, None, side)
    return blocks / _brightest(picture), picture.depth[middle, middle][:rows, :columns].astype(np.float64)


def _detail(picture: TakenPicture) -> FloatArray:
    top, left = (max(0, (size - _DETAIL) // 2) for size in picture.values.shape)
    return picture.values[top : top + _DETAIL, left : left + _DETAIL].astype(np.float64) / _brightest(picture)


def _brightest(picture: TakenPicture) -> float:
    return max(float(np.max(picture.values)), np.finfo(np.float64).tiny)


_SEARCHED = 1.1  # times the distance of a plane, and divided by it: any range would do


def refuse_pictures(study: PreparedStudy) -> None:
    """Refuse pictures that a run of the study would not render, or in which it could not measure depth.

    Raises
    ------
    StudyError
        The scene cannot be rendered, a camera cannot measure depth in its pictures, the matcher is not installed, or
        the pictures in which depth is to be measured would be saturated.
    UnaffordableError
        The pictures do not fit into the free memory.
    """
    scene, loop = study.file.scene, study.file.depth_loop
    problems: list[Problem] = []
    if scene is not None and scene.image is not None:
        # A rig is drawn from its calibration, which may have to be inferred first.
        inferred = all(camera.calibration.inferred for camera in study.case.cameras.values())
        rig: Rig | None = None if inferred else "as-designed"
        refuse_too_large(study, rig=rig)
        if scene.image.depth_maps:
            problems += _problems_of_depth_maps(study, rig)
    if loop is not None:
        problems += _problems_of_loop(study)
    if problems:
        raise StudyError(problems)


def _problems_of_depth_maps(study: PreparedStudy, rig: Rig | None) -> Iterator[Problem]:
    where: tuple[str, ...] = ("scene", "image", "depth_maps")
    try:
        set_up_readers(study, rig=rig)
    except OutOfRangeError as error:
        yield study.document.locate(where).problem(where, str(error))
    image, picture = declared_image(study)
    extent, cameras = extent_and_cameras(study, rig=rig)
    for taken in cameras:
        recording = recording_of(image, picture, taken.camera.sensor)
        if problem := _saturated(taken.name, taken.camera, recording, sum(extent) / 2.0):
            where = ("scene", "picture", "light")
            yield study.document.locate(where).problem(where, problem)


def _problems_of_loop(study: PreparedStudy) -> Iterator[Problem]:
    where, loop = ("depth_loop",), study.file.depth_loop
    assert loop is not None
    checked: set[tuple[str, float]] = set()  # neither distance nor contrast changes saturation
    try:
        for point in loop_points(study, loop).values():
            settings = point.settings
            if (camera_and_light := (point.name, settings.light.electrons)) in checked:
                continue
            checked.add(camera_and_light)
            near, far = point.distance / _SEARCHED, point.distance * _SEARCHED
            search = DepthSearch(near=near, far=far, window_px=point.window_px)
            point.reader(camera=point.camera, search=search)
            recording = Recording(
                light=settings.light, noise=settings.sensor_noise, model=NOISE, pixel_fill=settings.pixel_fill
            )
            if problem := _saturated(point.name, point.camera, recording, point.distance):
                yield study.document.locate(where).problem(where, problem)
    except OutOfRangeError as error:
        yield study.document.locate(where).problem(where, str(error))


def _saturated(camera_name: str, camera: object, recording: Recording, distance: float) -> str:
    """Why depth cannot be measured in pictures of which more than half of the pixels saturate; empty if it can."""
    if not isinstance(camera, DepthCamera):
        return ""
    f_number = camera.picture_geometry(np.array([distance])).light_f_number
    mean = float(np.ravel(mean_electrons(recording.light, f_number, camera.sensor.pixel_pitch))[0])
    if not mean >= recording.saturation_electrons:
        return ""
    return (
        f"the pictures of {camera_name} would be saturated: {pretty(mean, ELECTRONS)} on the axis, of which a pixel "
        f"holds {pretty(recording.saturation_electrons, ELECTRONS)}; reduce the light, or measure no depth in them"
    )
