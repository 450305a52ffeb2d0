"""Depth maps of the rendered pictures of a study's scene, written beside them and held against the true depth."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from tradestudy.analysis.depth import depth_uncertainty
from tradestudy.cameras.camera import Camera
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_map import DepthMap, DepthSearch, FlatPicture, TrueDepth
from tradestudy.errors import OutOfRangeError
from tradestudy.execution import Steps
from tradestudy.imaging.estimation.flat_field import flat_picture, white_picture
from tradestudy.imaging.estimation.matcher_fit import fit_matcher
from tradestudy.imaging.estimation.score import DepthScore, score
from tradestudy.imaging.render.sensor import Recording
from tradestudy.optics.arrays import FloatArray, Samples
from tradestudy.optics.window_matching import REASONS
from tradestudy.results.storage import replace_file, replacing
from tradestudy.run.inference import infer_calibrations
from tradestudy.run.pictures import Taken, declared_image, recording_of, set_up
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.picture import Window

STEP: Final = "depth maps"
_DISTANCES: Final = 33  # at which the predicted uncertainty is computed; linear in between


def map_depths(definition: StudyDefinition, directory: Path, steps: Steps) -> dict[str, DepthScore]:
    """Measure depth in the pictures of every camera that was rendered, and write the maps.

    Cameras read their pictures as they were designed; what they are less their design is an error of the map.

    Parameters
    ----------
    definition
        A study with ``scene.image``.
    directory
        Where `render_pictures` has written the pictures; each camera's folder gets ``depth_map``, with its standard
        deviation, reasons, the true depth in the same pixels, and ``depth_map.json``.
    steps
        Who hears of the progress.

    Raises
    ------
    OutOfRangeError
        Where a camera cannot measure depth in its pictures, or a matcher is not installed.
    """
    image, picture = declared_image(definition)
    definition, _ = infer_calibrations(definition, steps)
    scene, cameras = set_up(definition, image, picture)
    recording = recording_of(image, picture)
    if recording.mosaic is not None:
        raise OutOfRangeError(
            "depth maps from pictures behind a mosaic of colour filters",
            remedy="leave scene.image.mosaic out, or render without --depth",
        )
    distances = definition.case.distance
    scores = {}
    for number, taken in enumerate(cameras):
        search = DepthSearch(
            near=float(distances.min()),
            far=float(distances.max()),
            window_px=_window_px(picture.matching_window, taken, sum(scene.extent) / 2.0),
        )
        folder = directory / taken.name
        reader_of_kind = definition.file.cameras[taken.name].reader
        if reader_of_kind is None:
            raise OutOfRangeError(
                f"no depth can be measured in the pictures of {taken.name}",
                remedy="leave it out of scene.image with cameras: […], or render without --depth",
            )
        reader = reader_of_kind(camera=taken.camera, search=search)
        pictures, depths = _read(taken, recording, folder, image.depth_format)
        found, truth = reader.read(pictures), reader.truth(depths, {name: one.pure for name, one in pictures.items()})
        way = "both" if image.rig == "drawn" else "noise"
        scored = score(found, truth, _predicted(taken.camera, np.asarray(truth.depth, np.float64), way))
        scores[taken.name] = replace(scored, matcher=_matcher(found, truth, search.window_px))
        _write(found, truth, scores[taken.name], search, folder, image.depth_format)
        for name, values in reader.made_of(pictures, found, sum(scene.extent) / 2.0).items():
            _write_floats(folder / f"{name}.{image.depth_format}", values, "brightness over that of a white scene")
        steps.progress(STEP, (number + 1) / len(cameras))
    return scores


def _window_px(window: Window, taken: Taken, distance: float) -> float:
    """Side of the window [samples] where the scene is, at most the widest that the camera has."""
    camera = taken.camera
    if not isinstance(camera, DepthCamera):
        if window.of == "picture":
            return window.size
        raise OutOfRangeError(
            f"the matching window of {taken.name}, which measures no disparity",
            value="a length on the object",
            limit="pixels",
            remedy="give scene.picture.matching_window in px, or leave the camera out of scene.image",
        )
    geometry = camera.picture_geometry(np.array([distance]))
    size = window.size
    if window.of == "object":
        size *= float(geometry.magnification[0]) / geometry.sample_pitch
    return min(size, geometry.compared.widest_px)


def _read(
    taken: Taken, recording: Recording, folder: Path, depth_format: str
) -> tuple[dict[str, FlatPicture], dict[str, FloatArray]]:
    """The pictures of a camera over its white picture, and their true depths."""
    from PIL import Image

    suffix = "png" if recording.is_digital else "tiff"
    pictures, depths = {}, {}
    for exposure in taken.camera.exposures(taken.reference_distance, {}, None, taken.stop_separation):
        with Image.open(folder / f"{exposure.name}.{suffix}") as file:
            values = np.asarray(file)
        pictures[exposure.name] = flat_picture(values, white_picture(exposure, recording), recording)
        depths[exposure.name] = _read_depth(folder / f"{exposure.name}_depth.{depth_format}")
    return pictures, depths


def _read_depth(path: Path) -> FloatArray:
    from PIL import Image

    if path.suffix == ".npy":
        return np.asarray(np.load(path))
    with Image.open(path) as file:
        return np.asarray(file)


def _matcher(found: DepthMap, truth: TrueDepth, window_px: float) -> str:
    """The declaration of the matcher that the errors show, or why there is none."""
    try:
        return fit_matcher(found, truth, window_px).declaration
    except OutOfRangeError as reason:
        return f"no matcher can be told: {reason}"


def _predicted(camera: Camera, depth: FloatArray, way: str) -> FloatArray:
    """Depth uncertainty [m] of a camera at true depths; NaN for one that measures no disparity."""
    known = np.isfinite(depth)
    if not isinstance(camera, DepthCamera) or not np.any(known):
        return np.full(depth.shape, np.nan)
    ends = float(depth[known].min()), float(depth[known].max())
    distances = np.linspace(*ends, _DISTANCES) if ends[0] < ends[1] else np.array(ends[:1])
    return np.interp(depth, distances, depth_uncertainty(camera, distances, way))


def _write(
    found: DepthMap, truth: TrueDepth, scored: DepthScore, search: DepthSearch, folder: Path, depth_format: str
) -> None:
    """Depths in metres, reasons as bytes."""
    from PIL import Image

    for name, values, what in (
        ("depth_map", found.depth, "estimated depth along the axis, metres; NaN where none was measured"),
        ("depth_map_deviation", found.deviation, "standard deviation of the estimated depth by noise, metres"),
        ("depth_map_true", truth.depth, "true depth in the pixels of the estimated one, metres"),
    ):
        _write_floats(folder / f"{name}.{depth_format}", values, what)
    with replacing(folder / "depth_map_reason.png") as part:
        Image.fromarray(found.reason).save(part, format="PNG")
    with replacing(folder / "depth_map_measurable.png") as part:
        Image.fromarray(truth.measurable.astype(np.uint8) * np.uint8(255)).save(part, format="PNG")
    facts: Mapping[str, Any] = {
        "unit": "m",
        "orientation": "upright: x to the right, y down",
        "searched": [search.near, search.far],
        "window_px": search.window_px,
        "reasons": {str(int(reason)): text for reason, text in REASONS.items()},
        "measurable": "255 where the estimator has two pictures of a point and nothing hides it",
        "score": {key: _plain(value) for key, value in asdict(scored).items()},
    }
    replace_file(folder / "depth_map.json", f"{json.dumps(facts, indent=2, ensure_ascii=False)}\n".encode())


def _plain(value: Any) -> Any:
    """JSON has no NaN."""
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _write_floats(path: Path, values: Samples, what: str) -> None:
    from PIL import Image

    values = np.asarray(values, np.float32)
    with replacing(path) as part:
        if path.suffix == ".npy":
            with part.open("wb") as file:
                np.save(file, values)
        else:
            Image.fromarray(values).save(part, format="TIFF", description=what)
