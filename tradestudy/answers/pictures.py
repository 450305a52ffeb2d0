"""Pictures of a study's scene: rendered for every camera, reduced for results, and written as files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.effects import OFF
from tradestudy.errors import UnaffordableError
from tradestudy.execution import Steps
from tradestudy.imaging.render.sight import waves_of
from tradestudy.imaging.render.tiles import WORKER_BYTES, Recorded, Rendered, Tile, record_tile, render_tile, tiles_of
from tradestudy.imaging.scenes.pattern import RandomPattern
from tradestudy.imaging.scenes.scene import SceneSource
from tradestudy.machine import available_memory
from tradestudy.models.choice import choose_each
from tradestudy.models.rendered_scene import Taken, declared_image, recording_of, set_up, whole_pictures
from tradestudy.models.scene_pictures import picture_problems
from tradestudy.optics.arrays import FloatArray
from tradestudy.results.storage import replace_file, replacing
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.schema.scene import Rig, SceneImagePart
from tradestudy.wording import json_text

LARGEST: Final = 256
"""Most rows and columns of a reduced picture."""


def padded(values: NDArray[Any], shape: tuple[int, ...]) -> FloatArray:
    """The values padded with NaN beyond their last row and column."""
    whole = np.full(shape, np.nan)
    whole[: values.shape[0], : values.shape[1]] = values
    return whole


STEP: Final = "rendering"
_BYTES_PER_PIXEL: Final = 16  # values and depth, in tiles and assembled
_COMPRESSION: Final = 1  # level for PNG files: noise hardly compresses, and higher levels take seven times as long
_BYTES_PER_SAMPLE: Final = 24  # of a texture while it is generated


@dataclass(frozen=True, kw_only=True, eq=False)
class TakenPicture:
    """One rendered picture.

    Parameters
    ----------
    camera, name
        Name of the camera, and of the picture.
    values, depth
        Digital numbers or electrons, and true depth [m]; shape (rows, columns).
    saturated
        Number of saturated pixels.
    sampling_error
        Relative difference from a picture with 16 times the rays and, by waves, twice as many computed spreads.
    model_error
        By rays, the relative change that diffraction would make, from a trial; by waves, the share of the light that
        diffraction sends beyond the range that is computed.
    tile
        The whole picture as one tile.
    """

    camera: str
    name: str
    values: NDArray[Any]
    depth: NDArray[np.float32]
    saturated: int
    sampling_error: float
    model_error: float
    tile: Tile

    @property
    def pixel_pitch(self) -> float:
        """Distance between its pixels [m]."""
        return self.tile.exposure.sensor.pixel_pitch


@dataclass(frozen=True, kw_only=True, eq=False)
class Rendering:
    """All pictures of a study's scene, and the inputs that they were rendered from."""

    study: PreparedStudy
    image: SceneImagePart
    scene: SceneSource
    cameras: Sequence[Taken]
    pictures: Sequence[TakenPicture]


def render_scene(study: PreparedStudy, steps: Steps) -> Rendering:
    """Render every picture of the study's scene.

    Parameters
    ----------
    study
        A study with ``scene.image``, its calibrations inferred.
    steps
        How tiles are computed.

    Raises
    ------
    StudyError
        The study declares no scene to render, or its scene cannot be rendered.
    UnaffordableError
        The pictures do not fit into the free memory; raised before anything is rendered.
    """
    image, picture = declared_image(study)
    refuse_too_large(study, workers=int(getattr(steps.executor, "count", 1)))
    scene, cameras = set_up(study)
    whole, errors = [], []
    for taken, (by_waves, change) in zip(cameras, _models(study), strict=True):
        recording = recording_of(image, picture, taken.camera.sensor)
        for whole_tile in whole_pictures(study, image, scene, taken, recording):
            waves = waves_of(whole_tile.exposure, scene, study.case.wavelength) if by_waves else None
            whole.append(replace(whole_tile, waves=waves))
            errors.append(change if waves is None else waves.bent_farther)
    tiles = [tiles_of(whole_tile) for whole_tile in whole]
    flat = [tile for parts in tiles for tile in parts]
    labels = [f"{tile.camera} {tile.exposure.name}, row {tile.rows[0]}, column {tile.columns[0]}" for tile in flat]
    # In the order of their pictures, so that each picture takes the next results for its tiles.
    rendered = iter(steps.map(STEP, render_tile, flat, labels))
    pictures = [
        assemble(whole_tile, [(tile, next(rendered)) for tile in parts], error)
        for whole_tile, parts, error in zip(whole, tiles, errors, strict=True)
    ]
    return Rendering(study=study, image=image, scene=scene, cameras=cameras, pictures=pictures)


def write_pictures(rendering: Rendering, directory: Path) -> list[Path]:
    """Write the pictures, their depth, and a description of the cameras that took them."""
    written: list[Path] = []
    facts_of: dict[str, dict[str, Any]] = {}
    for picture in rendering.pictures:
        written.append(_write_picture(picture, directory / picture.camera, rendering.image.depth_format))
        facts_of.setdefault(picture.camera, {})[picture.name] = _picture_facts(picture, written[-1], rendering)
    for taken in rendering.cameras:
        facts = _camera_facts(rendering, taken, facts_of[taken.name])
        replace_file(directory / taken.name / "camera.json", f"{json_text(facts)}\n".encode())
    return written


def _models(study: PreparedStudy) -> list[tuple[bool, float]]:
    """For each camera that takes pictures, whether it uses waves, and the change that the choice of models makes."""
    forced = study.file.effects.forced()
    free = picture_problems(study, {}) if forced else ()
    # A forced model is the most complete one allowed and so changes nothing; its change by forcing counts instead.
    return [
        (
            choice.models["main_lens_diffraction"] != OFF,
            {**choice.changes, **choice.by_forcing}["pixel_intensity"].relative,
        )
        for choice in choose_each(study, picture_problems(study, forced), free)
    ]


def refuse_too_large(study: PreparedStudy, *, workers: int = 1, rig: Rig | None = None) -> None:
    """Refuse pictures that do not fit into the free memory; ``rig`` overrides that of the study.

    Raises
    ------
    StudyError
        The scene cannot be rendered.
    UnaffordableError
        The pictures do not fit.
    """
    scene, cameras = set_up(study, rig=rig)
    sensors = [exposure.sensor for taken in cameras for exposure in taken.exposures]
    pixels = sum(sensor.columns * sensor.rows for sensor in sensors)
    patterns = {surface.pattern for surface in scene.surfaces if isinstance(surface.pattern, RandomPattern)}
    per_worker = WORKER_BYTES + sum(_BYTES_PER_SAMPLE * pattern.side**2 for pattern in patterns)
    needed, free = pixels * _BYTES_PER_PIXEL + workers * per_worker, available_memory()
    if needed > free:
        largest = max(sensors, key=lambda sensor: sensor.columns * sensor.rows)
        raise UnaffordableError(
            f"memory for the pictures of this scene, the largest with {largest.columns} × {largest.rows} pixels",
            value=f"{needed / 1e9:.1f} GB on {workers} worker{'s' * (workers != 1)}",
            limit=f"{free / 1e9:.1f} GB free",
            remedy="render fewer cameras (scene.image.cameras) or smaller sensors, or use fewer workers",
        )


def take_picture(whole: Tile) -> tuple[NDArray[Any], NDArray[np.float32]]:
    """Values and depth of a picture by rays, rendered in this process, without the error of its sampling."""
    return _joined(whole, [(tile, record_tile(tile)) for tile in tiles_of(whole)])


def assemble(whole: Tile, parts: Sequence[tuple[Tile, Rendered]], model_error: float) -> TakenPicture:
    """Assemble a picture from its tiles."""
    values, depth = _joined(whole, parts)
    difference, size = (sum(rendered.sampling_error[k] for _, rendered in parts) for k in (0, 1))
    return TakenPicture(
        camera=whole.camera,
        name=whole.exposure.name,
        values=values,
        depth=depth,
        saturated=sum(rendered.saturated for _, rendered in parts),
        sampling_error=(difference / size) ** 0.5 if size > 0.0 else 0.0,
        model_error=model_error,
        tile=whole,
    )


def _joined(whole: Tile, parts: Sequence[tuple[Tile, Recorded]]) -> tuple[NDArray[Any], NDArray[np.float32]]:
    """Values and depths of the tiles of a picture."""
    shape = (whole.rows[1], whole.columns[1])
    values = np.empty(shape, parts[0][1].values.dtype)
    depth = np.empty(shape, np.float32)
    for tile, recorded in parts:
        values[slice(*tile.rows), slice(*tile.columns)] = recorded.values
        depth[slice(*tile.rows), slice(*tile.columns)] = recorded.depth
    return values, depth


def _write_picture(picture: TakenPicture, folder: Path, depth_format: str) -> Path:
    """Write digital numbers as PNG, electrons as TIFF; depth in metres."""
    from PIL import Image

    values, depth = picture.values, picture.depth
    digital = picture.tile.recording.is_digital
    path = folder / f"{picture.name}.{'png' if digital else 'tiff'}"
    with replacing(path) as part:
        if digital:
            Image.fromarray(values).save(part, format="PNG", compress_level=_COMPRESSION)
        else:
            Image.fromarray(values).save(part, format="TIFF", description="electrons")
    with replacing(folder / f"{picture.name}_depth.{depth_format}") as part:
        if depth_format == "npy":
            with part.open("wb") as file:
                np.save(file, depth)
        else:
            Image.fromarray(depth).save(part, format="TIFF", description="depth along the axis of the camera, metres")
    return path


def _picture_facts(picture: TakenPicture, path: Path, rendering: Rendering) -> dict[str, Any]:
    """Facts about one picture, for ``camera.json``."""
    tolerance = rendering.study.file.accuracy.asked().tolerances["pixel_intensity"]
    pose = picture.tile.exposure.pose
    return {
        "file": path.name,
        "depth_file": f"{picture.name}_depth.{rendering.image.depth_format}",
        "centre": list(pose.centre),
        "rotation": [list(row) for row in pose.rotation],
        "saturated_pixels": picture.saturated,
        "model": "rays" if picture.tile.waves is None else "waves",
        "sampling_error": round(picture.sampling_error, 6),
        "model_error": round(picture.model_error, 6),
        "within_tolerance": math.hypot(picture.sampling_error, picture.model_error) <= tolerance,
        **picture.tile.exposure.description(),
    }


def _camera_facts(rendering: Rendering, taken: Taken, pictures: Mapping[str, Any]) -> dict[str, Any]:
    """The content of ``camera.json``."""
    study, image, sensor = rendering.study, rendering.image, taken.camera.sensor
    recording = next(picture.tile.recording for picture in rendering.pictures if picture.camera == taken.name)
    part = study.file.cameras[taken.name]
    near, far = rendering.scene.extent
    values: dict[str, Any] = (
        {"unit": "digital number", "electrons_per_number": recording.noise.step_electrons}
        if recording.is_digital
        else {"unit": "electron"}
    )
    return {
        "camera": taken.name,
        "title": part.title,
        "kind": part.kind,
        "study": study.file.study,
        "units": "lengths in metres, angles in radians, light in electrons",
        "coordinates": "x to the right (columns), y down (rows), z into the scene; upright; positions on the sensor "
        "are relative to its middle; a ray (x, y, z) of the camera is rotation × (x, y, z) + centre in the scene",
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
            "of": "the point that the middle of a pixel's brightest cone of light comes from, along the axis of the "
            "camera; infinite where it meets nothing, NaN where the pupil sends no light",
        },
        "scene": {"nearest": near, "farthest": far, "samples": image.samples or taken.camera.rays_per_pixel},
        "sampling_error": "relative difference (root mean square) from pictures with 16 times the samples, at places "
        "across each picture, without noise; by waves, also from pictures with twice as many spreads along each axis",
        "model_error": "by rays: relative change of pixel intensities (L2) that diffraction would make, from a trial; "
        "by waves: share of the light that diffraction sends beyond the computed range, redistributed within it",
        "within_tolerance": "whether both errors, added in quadrature, meet accuracy.pixel_intensity of the study",
        "rig": image.rig,
        "errors": {name: value.tolist() for name, value in taken.errors.items()},
        "properties": {name: str(value) for name, value in taken.camera.properties()},
        "pictures": dict(pictures),
    }
