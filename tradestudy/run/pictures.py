"""The pictures of a study's scene: rendered tile by tile, and written with their true depth and their cameras."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.camera import Camera
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.light_cones import Exposure
from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.errors import Problem, StudyError, UnaffordableError
from tradestudy.execution import Steps
from tradestudy.imaging.models import Texture
from tradestudy.imaging.render.rig import drawn_errors
from tradestudy.imaging.render.sensor import Mosaic, Recording
from tradestudy.imaging.render.tiles import WORKER_BYTES, Rendered, Tile, render_tile, tiles_of
from tradestudy.imaging.scenes.pattern import RandomPattern
from tradestudy.imaging.scenes.scene import SceneSource
from tradestudy.machine import available_memory
from tradestudy.optics.arrays import FloatArray
from tradestudy.results.storage import replace_file, replacing
from tradestudy.run.scene import pattern_of_scene, scene_of
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.picture import PicturePart
from tradestudy.study.schema.scene_image import SceneImagePart

STEP: Final = "rendering"
_BYTES_PER_PIXEL: Final = 16  # values and depth, in tiles and put together
_BYTES_PER_SAMPLE: Final = 24  # of a texture while it is made
_WHERE: Final = ("scene", "image")


@dataclass(frozen=True, kw_only=True, eq=False)
class Taken:
    """A camera of the study, and what it takes pictures with.

    Parameters
    ----------
    name, camera
        As the study has it.
    errors
        What the camera that takes them is less its design, in SI.
    exposures
        Its pictures.
    reference_distance, stop_separation
        What they were asked for with [m]; see `Camera.exposures`.
    """

    name: str
    camera: Camera
    errors: Mapping[str, FloatArray]
    exposures: Sequence[Exposure]
    reference_distance: float
    stop_separation: float


@dataclass(frozen=True, kw_only=True, eq=False)
class TakenPicture:
    """One picture as it was taken.

    Parameters
    ----------
    camera, name
        Whose, and which of its pictures.
    values, depth
        Digital numbers or electrons, and true depth [m]; shape (rows, columns).
    saturated
        How many pixels are full.
    sampling_error
        Relative difference from a picture with 16 times the rays.
    tile
        The whole picture as it was asked for.
    """

    camera: str
    name: str
    values: NDArray[Any]
    depth: NDArray[np.float32]
    saturated: int
    sampling_error: float
    tile: Tile

    @property
    def pixel_pitch(self) -> float:
        """Distance of its pixels [m]."""
        return self.tile.exposure.sensor.pixel_pitch


@dataclass(frozen=True, kw_only=True, eq=False)
class Rendering:
    """All pictures of a study's scene, and what they were taken with."""

    definition: StudyDefinition
    image: SceneImagePart
    scene: SceneSource
    recording: Recording
    cameras: Sequence[Taken]
    pictures: Sequence[TakenPicture]


def render_scene(definition: StudyDefinition, steps: Steps) -> Rendering:
    """Render every picture that the study's scene asks for.

    Parameters
    ----------
    definition
        A study with ``scene.image``, its calibrations inferred.
    steps
        How tiles are computed.

    Raises
    ------
    StudyError
        For a study that declares no scene to render, or one that cannot be.
    UnaffordableError
        Where the pictures do not fit into the memory that is free, before anything is rendered.
    """
    image, picture = declared_image(definition)
    scene, cameras = set_up(definition)
    recording = recording_of(image, picture)
    whole = [
        Tile(
            camera=taken.name,
            exposure=exposure,
            scene=scene,
            recording=recording,
            samples=image.samples,
            seed=definition.file.propagation.seed,
            rows=(0, exposure.sensor.rows),
            columns=(0, exposure.sensor.columns),
        )
        for taken in cameras
        for exposure in taken.exposures
    ]
    _refuse_too_large(whole, scene, workers=int(getattr(steps.executor, "count", 1)))
    tiles = [tiles_of(one) for one in whole]
    flat = [tile for some in tiles for tile in some]
    efforts = [float((tile.rows[1] - tile.rows[0]) * (tile.columns[1] - tile.columns[0])) for tile in flat]
    labels = [f"{tile.camera} {tile.exposure.name}, row {tile.rows[0]}, column {tile.columns[0]}" for tile in flat]
    rendered = iter(steps.map(STEP, render_tile, flat, labels, efforts))
    pictures = [
        put_together(one, [(tile, next(rendered)) for tile in some]) for one, some in zip(whole, tiles, strict=True)
    ]
    return Rendering(
        definition=definition, image=image, scene=scene, recording=recording, cameras=cameras, pictures=pictures
    )


def write_pictures(rendering: Rendering, directory: Path) -> list[Path]:
    """Write pictures, their depth, and what is true of the cameras that took them."""
    written: list[Path] = []
    told: dict[str, dict[str, Any]] = {}
    for one in rendering.pictures:
        written.append(_write_picture(one, directory / one.camera, rendering.image.depth_format))
        told.setdefault(one.camera, {})[one.name] = _picture_facts(one, written[-1], rendering.image)
    for taken in rendering.cameras:
        facts = _camera_facts(rendering, taken, told[taken.name])
        text = json.dumps(facts, indent=2, ensure_ascii=False)
        replace_file(directory / taken.name / "camera.json", f"{text}\n".encode())
    return written


def declared_image(definition: StudyDefinition) -> tuple[SceneImagePart, PicturePart]:
    """What the study declares, or its absence as a mistake."""
    scene = definition.file.scene
    if scene is None or scene.image is None or scene.picture is None:
        problem = definition.document.locate(("scene",)).problem(
            _WHERE, "this key is missing: the surfaces of which render makes pictures"
        )
        raise StudyError([problem])
    return scene.image, scene.picture


def set_up(definition: StudyDefinition) -> tuple[SceneSource, list[Taken]]:
    """The scene, and the cameras that take it, with every mistake at its place."""
    image, picture = declared_image(definition)
    extent, cameras = extent_and_cameras(definition)
    exposures = [exposure for taken in cameras for exposure in taken.exposures]
    pattern = pattern_of_scene(texture_of(picture), exposures, extent, definition.file.propagation.seed)
    return scene_of(image, pattern, definition.folder_of(_WHERE)), cameras


def extent_and_cameras(definition: StudyDefinition) -> tuple[tuple[float, float], list[Taken]]:
    """How near and far the scene reaches [m], and the cameras that take it, before anything is painted on it."""
    image, picture = declared_image(definition)
    texture = texture_of(picture)
    flat = RandomPattern(texture=texture, sample=texture.correlation_length, side=2, seed=0)
    try:
        extent = scene_of(image, flat, definition.folder_of(_WHERE)).extent
    except MistakeAt as mistake:
        problems = [_problem(definition, (*_WHERE, *one.tail), one.what) for one in mistake.all]
        raise StudyError(problems) from None
    return extent, _cameras(definition, image, picture, sum(extent) / 2.0)


def texture_of(picture: PicturePart) -> Texture:
    """What surfaces are painted with."""
    return Texture(contrast=picture.texture.contrast, correlation_length=picture.texture.correlation_length)


def _problem(definition: StudyDefinition, path: tuple[str | int, ...], what: str) -> Problem:
    return definition.document.locate(path).problem(path, what)


def _cameras(definition: StudyDefinition, image: SceneImagePart, picture: PicturePart, middle: float) -> list[Taken]:
    found = []
    for name, camera in definition.case.all_cameras.items():
        if image.cameras is not None and name not in image.cameras:
            continue
        errors: Mapping[str, FloatArray] = {}
        environment = None
        if image.rig == "drawn" and isinstance(camera, DepthCamera):
            errors = drawn_errors(camera, name, definition.file.propagation.seed)
            environment = camera.calibration.environment
        exposures = camera.exposures(middle, errors, environment, picture.stop_separation)
        found.append(
            Taken(
                name=name,
                camera=camera,
                errors=errors,
                exposures=exposures,
                reference_distance=middle,
                stop_separation=picture.stop_separation,
            )
        )
    return found


def recording_of(image: SceneImagePart, picture: PicturePart) -> Recording:
    """What the sensors do with light."""
    settings = picture.settings(1.0)  # rays have no wavelength
    mosaic = image.mosaic
    return Recording(
        light=settings.light,
        noise=settings.sensor_noise,
        model=image.noise,
        black_level=image.black_level,
        pixel_fill=settings.pixel_fill,
        mosaic=None if mosaic is None else Mosaic(pattern=mosaic.pattern, response=mosaic.response),
    )


def _refuse_too_large(whole: Sequence[Tile], scene: SceneSource, *, workers: int) -> None:
    """Refuse pictures that do not fit into the free memory."""
    sensors = [one.exposure.sensor for one in whole]
    pixels = sum(sensor.columns * sensor.rows for sensor in sensors)
    patterns = {one.pattern for one in scene.surfaces if isinstance(one.pattern, RandomPattern)}
    each = WORKER_BYTES + sum(_BYTES_PER_SAMPLE * pattern.side**2 for pattern in patterns)
    needed, free = pixels * _BYTES_PER_PIXEL + workers * each, available_memory()
    if needed > free:
        largest = max(sensors, key=lambda sensor: sensor.columns * sensor.rows)
        raise UnaffordableError(
            f"memory for the pictures of this scene, the largest of {largest.columns} × {largest.rows} pixels",
            value=f"{needed / 1e9:.1f} GB on {workers} worker{'s' * (workers != 1)}",
            limit=f"{free / 1e9:.1f} GB are free",
            remedy="render fewer cameras (scene.image.cameras), smaller sensors, or with fewer workers",
        )


def take_picture(whole: Tile) -> TakenPicture:
    """Render a picture here, tile by tile."""
    return put_together(whole, [(tile, render_tile(tile)) for tile in tiles_of(whole)])


def put_together(whole: Tile, parts: Sequence[tuple[Tile, Rendered]]) -> TakenPicture:
    """The picture that tiles are parts of."""
    shape = (whole.rows[1], whole.columns[1])
    values = np.empty(shape, parts[0][1].values.dtype)
    depth = np.empty(shape, np.float32)
    for tile, rendered in parts:
        values[slice(*tile.rows), slice(*tile.columns)] = rendered.values
        depth[slice(*tile.rows), slice(*tile.columns)] = rendered.depth
    difference, size = (sum(rendered.sampling_error[k] for _, rendered in parts) for k in (0, 1))
    return TakenPicture(
        camera=whole.camera,
        name=whole.exposure.name,
        values=values,
        depth=depth,
        saturated=sum(rendered.saturated for _, rendered in parts),
        sampling_error=(difference / size) ** 0.5 if size > 0.0 else 0.0,
        tile=whole,
    )


def _write_picture(one: TakenPicture, folder: Path, depth_format: str) -> Path:
    """Digital numbers as PNG, electrons as TIFF; depth in metres."""
    from PIL import Image

    values, depth = one.values, one.depth
    digital = one.tile.recording.is_digital
    path = folder / f"{one.name}.{'png' if digital else 'tiff'}"
    with replacing(path) as part:
        if digital:
            Image.fromarray(values).save(part, format="PNG")
        else:
            Image.fromarray(values).save(part, format="TIFF", description="electrons")
    with replacing(folder / f"{one.name}_depth.{depth_format}") as part:
        if depth_format == "npy":
            with part.open("wb") as file:
                np.save(file, depth)
        else:
            Image.fromarray(depth).save(part, format="TIFF", description="depth along the axis of the camera, metres")
    return path


def _picture_facts(one: TakenPicture, path: Path, image: SceneImagePart) -> dict[str, Any]:
    """What is true of one picture."""
    pose = one.tile.exposure.pose
    return {
        "file": path.name,
        "depth_file": f"{one.name}_depth.{image.depth_format}",
        "centre": list(pose.centre),
        "rotation": [list(row) for row in pose.rotation],
        "saturated_pixels": one.saturated,
        "sampling_error": round(one.sampling_error, 6),
        **one.tile.exposure.description(),
    }


def _camera_facts(rendering: Rendering, taken: Taken, pictures: Mapping[str, Any]) -> dict[str, Any]:
    """What stands beside the pictures of a camera."""
    definition, image, recording = rendering.definition, rendering.image, rendering.recording
    sensor = taken.camera.sensor
    part = definition.file.cameras[taken.name]
    near, far = rendering.scene.extent
    values: dict[str, Any] = (
        {"unit": "digital number", "electrons_per_number": recording.electrons_per_number}
        if recording.is_digital
        else {"unit": "electron"}
    )
    return {
        "camera": taken.name,
        "title": part.title,
        "kind": part.kind,
        "study": definition.file.study,
        "units": "lengths in metres, angles in radians, light in electrons",
        "coordinates": "x to the right (columns), y down (rows), z into the scene; upright; the middle of the sensor "
        "is the origin of places on it; a ray of the camera (x, y, z) is rotation × (x, y, z) + centre in the scene",
        "sensor": {"columns": sensor.columns, "rows": sensor.rows, "pixel_pitch": sensor.pixel_pitch},
        "values": {
            **values,
            "black_level_electrons": recording.black_level,
            "read_noise_electrons": recording.noise.read_noise_electrons,
            "full_well_electrons": recording.noise.full_well_electrons,
            "bits": recording.noise.bits,
            "noise": recording.model,
            "mosaic": None if recording.mosaic is None else recording.mosaic.pattern,
        },
        "depth": {
            "unit": "m",
            "of": "what the middle of the brightest cone of light of a pixel comes from, along the axis of the camera; "
            "infinite where that meets nothing, NaN where the pupil sends no light",
        },
        "scene": {"nearest": near, "farthest": far, "samples": image.samples},
        "sampling_error": "relative difference (root mean square) from pictures with 16 times the samples, in places "
        "all over each picture, noise apart",
        "rig": image.rig,
        "errors": {name: value.tolist() for name, value in taken.errors.items()},
        "properties": dict(taken.camera.properties()),
        "pictures": dict(pictures),
    }
