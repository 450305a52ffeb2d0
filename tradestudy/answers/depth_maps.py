"""Depth maps from the rendered pictures of a study's scene, compared with the true depth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.answers.pictures import LARGEST, Rendering, padded
from tradestudy.cameras.camera import Camera
from tradestudy.cameras.depth_camera import DepthCamera, UsableCriteria
from tradestudy.cameras.depth_map import DepthMap, DepthReader, DepthSearch, TrueDepth
from tradestudy.cameras.light_cones import Description, Exposure
from tradestudy.depth.evaluation import depth_uncertainty
from tradestudy.errors import OutOfRangeError
from tradestudy.execution import Steps
from tradestudy.execution.executor import part_of_point, tell
from tradestudy.imaging.estimation import (
    VARIANCE_OF_SPREAD,
    DepthScore,
    fit_matcher,
    flat_picture,
    middle_and_spread,
    score,
    white_picture,
)
from tradestudy.imaging.models import PictureSettings
from tradestudy.imaging.render.sight import waves_of
from tradestudy.imaging.render.tiles import Recording
from tradestudy.imaging.render.waves import Waves
from tradestudy.models.rendered_scene import Taken, declared_image, extent_and_cameras
from tradestudy.optics.arrays import FloatArray, Samples
from tradestudy.optics.window_matching import REASONS, Reason
from tradestudy.results import GROUPS
from tradestudy.results.storage import replace_file, replacing
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.schema.scene import Rig
from tradestudy.wording import json_text

STEP: Final = "depth maps"
_WHITE: Final = 0.15  # fraction of the time of a map until its white pictures are computed
_READ: Final = 0.75  # until its depth is read
_DISTANCES: Final = 33  # where the predicted uncertainty is computed; interpolated linearly in between


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraReader:
    """A camera of the study, with the reader that measures depth in its pictures as designed.

    Parameters
    ----------
    taken
        The camera as it takes the pictures.
    search, reader
        The distances and window to search, and the reader that measures depth.
    exposures
        The pictures of the camera without errors; its white pictures are computed from them.
    """

    taken: Taken
    search: DepthSearch
    reader: DepthReader
    exposures: Sequence[Exposure]


@dataclass(frozen=True, kw_only=True, eq=False)
class PicturesToRead:
    """All inputs of one depth map.

    Parameters
    ----------
    reader
        The reader that makes the map.
    recording
        How the sensor recorded the light.
    values, depths
        Values of the pictures and their true depth [m], by name.
    waves
        Diffraction in each picture; None if it was rendered by rays.
    has_errors
        Whether the camera that takes the pictures has errors of its calibration.
    middle
        Distance of the middle of the scene [m].
    """

    reader: CameraReader
    recording: Recording
    values: Mapping[str, NDArray[Any]]
    depths: Mapping[str, NDArray[np.float32]]
    waves: Mapping[str, Waves | None]
    has_errors: bool
    middle: float


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredDepth:
    """Depth measured in the pictures of one camera, with the truth.

    Parameters
    ----------
    camera
        Name of the camera.
    search
        The distances and window that were searched.
    found, truth
        Measured and true depth, in the same pixels.
    predicted
        Depth uncertainty at the true depth of each pixel [m]; NaN where there is none.
    score
        Comparison of the measured depth with truth and prediction.
    made
        Pictures that the camera computes from its depth, by name.
    frame
        The camera that the map belongs to; see `DepthReader.frame`.
    """

    camera: str
    search: DepthSearch
    found: DepthMap
    truth: TrueDepth
    predicted: FloatArray
    score: DepthScore
    made: Mapping[str, Samples]
    frame: Description

    @property
    def arrays(self) -> dict[str, Samples]:
        """Measured depth, its standard deviation and the true depth [m], and the computed pictures, by name."""
        depths = {
            "depth_map": self.found.depth,
            "depth_map_deviation": self.found.deviation,
            "depth_map_true": self.truth.depth,
        }
        return {name: np.asarray(values, np.float32) for name, values in {**depths, **self.made}.items()}


def set_up_readers(study: PreparedStudy, *, rig: Rig | None = None) -> list[CameraReader]:
    """The depth readers of all cameras that take pictures of the scene.

    Parameters
    ----------
    study
        A study with ``scene.image``, its calibrations inferred unless ``rig`` is as-designed.
    rig
        Overrides that of the study.

    Raises
    ------
    OutOfRangeError
        A camera cannot measure depth in its pictures.
    """
    image, picture = declared_image(study)
    extent, cameras = extent_and_cameras(study, rig=rig)
    if image.mosaic is not None:
        raise OutOfRangeError(
            "depth maps from pictures taken through a mosaic of colour filters",
            remedy="remove scene.image.mosaic, or request no depth maps",
        )
    distances, wavelength = study.case.distance, study.case.wavelength
    ends = float(distances.min()), float(distances.max())
    return [
        reader_of(
            study,
            taken,
            ends,
            window_of(picture.settings(wavelength, taken.camera.sensor), taken, sum(extent) / 2.0),
        )
        for taken in cameras
    ]


def reader_of(study: PreparedStudy, taken: Taken, ends: tuple[float, float], window_px: float) -> CameraReader:
    """The reader that measures depth between two distances [m] in a camera's pictures, with windows of this side.

    ``window_px`` is in samples.

    Raises
    ------
    OutOfRangeError
        The camera cannot measure depth in its pictures.
    """
    reader_of_kind = study.file.cameras[taken.name].reader
    if reader_of_kind is None:
        raise OutOfRangeError(
            f"{taken.name} cannot measure depth in its pictures",
            remedy="leave it out of scene.image with cameras: […], or request no depth maps",
        )
    search = DepthSearch(near=ends[0], far=ends[1], window_px=window_px)
    return CameraReader(
        taken=taken,
        search=search,
        reader=reader_of_kind(camera=taken.camera, search=search),
        exposures=taken.camera.exposures(taken.reference_distance, {}, None, taken.stop_separation),
    )


def measure_depth(rendering: Rendering, readers: Sequence[CameraReader], steps: Steps) -> list[MeasuredDepth]:
    """Measure depth in the pictures of every camera that has a reader.

    The readers assume the designed cameras, so a camera's deviations from its design become errors of the map.

    Raises
    ------
    OutOfRangeError
        A matcher is not installed.
    """
    points = [
        PicturesToRead(
            reader=reader,
            recording=next(
                picture.tile.recording for picture in rendering.pictures if picture.camera == reader.taken.name
            ),
            values={
                picture.name: picture.values for picture in rendering.pictures if picture.camera == reader.taken.name
            },
            depths={
                picture.name: picture.depth for picture in rendering.pictures if picture.camera == reader.taken.name
            },
            waves=_waves(rendering, reader),
            has_errors=rendering.image.rig == "drawn",
            middle=sum(rendering.scene.extent) / 2.0,
        )
        for reader in readers
    ]
    if not points:
        return []
    # Written as files instead of checkpoints: the maps of large sensors are as large as their pictures.
    labels = [reader.taken.name for reader in readers]
    return replace(steps, checkpoints=None).map(STEP, read_depth, points, labels)


def _waves(rendering: Rendering, reader: CameraReader) -> dict[str, Waves | None]:
    """Diffraction in the pictures of the camera as designed; None for pictures rendered by rays."""
    by_waves = {
        picture.name: picture.tile.waves is not None
        for picture in rendering.pictures
        if picture.camera == reader.taken.name
    }
    wavelength = rendering.study.case.wavelength
    return {
        exposure.name: waves_of(exposure, rendering.scene, wavelength) if by_waves[exposure.name] else None
        for exposure in reader.exposures
    }


def read_depth(point: PicturesToRead) -> MeasuredDepth:
    """One camera's depth map, its comparison with the truth, and the pictures computed from it."""
    camera_reader, recording = point.reader, point.recording
    pictures = {
        exposure.name: flat_picture(
            point.values[exposure.name], white_picture(exposure, recording, point.waves[exposure.name]), recording
        )
        for exposure in camera_reader.exposures
    }
    tell(_WHITE)
    with part_of_point(_WHITE, _READ):
        depth_map = camera_reader.reader.read(pictures)
    truth = camera_reader.reader.truth(point.depths, {name: picture.pure for name, picture in pictures.items()})
    depth = np.asarray(truth.depth, np.float64)
    predicted, shift = predicted_uncertainty(camera_reader.taken.camera, depth, "noise"), np.zeros(depth.shape)
    # Noise spreads the depths, but the pictures contain a single draw of the calibration errors, which shifts them all.
    if point.has_errors:
        shift = predicted_uncertainty(camera_reader.taken.camera, depth, "calibration")
    scored = score(depth_map, truth, predicted, camera_reader.search.window_px, shift)
    return MeasuredDepth(
        camera=camera_reader.taken.name,
        search=camera_reader.search,
        found=depth_map,
        truth=truth,
        predicted=predicted,
        score=replace(scored, matcher=_matcher(point, depth_map, truth)),
        made=camera_reader.reader.made_of(pictures, depth_map, point.middle),
        frame=camera_reader.reader.frame(),
    )


def window_of(settings: PictureSettings, taken: Taken, distance: float) -> float:
    """Side of the window [samples] in the middle of the scene."""
    camera = taken.camera
    if isinstance(camera, DepthCamera):
        return window_at(settings, camera, distance)
    if settings.window_px is not None:
        return settings.window_px
    raise OutOfRangeError(
        f"the matching window of {taken.name}, which measures no disparity",
        value="a length on the object",
        limit="pixels",
        remedy="give scene.picture.matching_window in px, or leave the camera out of scene.image",
    )


def window_at(settings: PictureSettings, camera: DepthCamera, distance: float) -> float:
    """Side of the window [samples] at a distance [m], at most the widest that the camera allows."""
    geometry = camera.picture_geometry(np.array([distance]))
    window = settings.asked_window(geometry.magnification, geometry.sample_pitch)
    return min(float(window[0]), geometry.compared.widest_px)


def _matcher(point: PicturesToRead, depth_map: DepthMap, truth: TrueDepth) -> str:
    """The matcher fitted to the errors, as a declaration for study files; or why there is none."""
    camera = point.reader.taken.camera
    if point.has_errors and isinstance(camera, DepthCamera) and camera.calibration.groups:
        return (
            "no matcher can be fitted to these errors, because they include those of the calibration; set "
            "scene.image.rig to as-designed"
        )
    try:
        return fit_matcher(depth_map, truth, point.reader.search.window_px).declaration
    except OutOfRangeError as reason:
        return f"no matcher can be fitted: {reason}"


def predicted_uncertainty(camera: Camera, depth: FloatArray, error_source: str) -> FloatArray:
    """Depth uncertainty [m] of a camera at true depths; NaN for a camera that measures no disparity."""
    known = np.isfinite(depth)
    if not isinstance(camera, DepthCamera) or not np.any(known):
        return np.full(depth.shape, np.nan)
    ends = float(depth[known].min()), float(depth[known].max())
    distances = np.linspace(*ends, _DISTANCES) if ends[0] < ends[1] else np.array(ends[:1])
    return np.interp(depth, distances, depth_uncertainty(camera, distances, error_source))


def predicted_availability(camera: Camera, distance: float) -> float:
    """Predicted share of the object points at a distance [m] that the estimator sees in two pictures."""
    if not isinstance(camera, DepthCamera):
        return math.nan
    limits = camera.limits(np.array([distance]), UsableCriteria())
    shares = [float(np.ravel(limits[limit].value)[0]) for limit in ("overlap", "availability") if limit in limits]
    return math.prod(min(max(share, 0.0), 1.0) for share in shares) if shares else math.nan


def write_depth(measured: MeasuredDepth, folder: Path, depth_format: str) -> None:
    """Write ``depth_map`` with its standard deviation, reasons and true depth, and ``depth_map.json``; depths in m."""
    from PIL import Image

    depth_map, truth, search = measured.found, measured.truth, measured.search
    descriptions = {
        "depth_map": "measured depth along the axis, metres; NaN where none was measured",
        "depth_map_deviation": "standard deviation of the measured depth due to noise, metres",
        "depth_map_true": "true depth in the pixels of depth_map, metres",
    }
    for name, values in measured.arrays.items():
        words = descriptions.get(name, "brightness relative to a white scene")
        _write_floats(folder / f"{name}.{depth_format}", values, words)
    with replacing(folder / "depth_map_reason.png") as part:
        Image.fromarray(depth_map.reason).save(part, format="PNG")
    with replacing(folder / "depth_map_measurable.png") as part:
        Image.fromarray(truth.measurable.astype(np.uint8) * np.uint8(255)).save(part, format="PNG")
    facts: Mapping[str, Any] = {
        "unit": "m",
        "orientation": "upright: x to the right, y down",
        "frame": measured.frame or "that of the picture",
        "searched": [search.near, search.far],
        "window_px": search.window_px,
        "reasons": {str(int(reason)): text for reason, text in REASONS.items()},
        "measurable": "255 where the estimator sees a point in two pictures and nothing hides it",
        "score": _plain(asdict(measured.score)),
    }
    replace_file(folder / "depth_map.json", f"{json_text(facts)}\n".encode())


def _plain(value: Any) -> Any:
    """The value with NaN replaced by None, which JSON can represent."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _write_floats(path: Path, values: Samples, description: str) -> None:
    from PIL import Image

    with replacing(path) as part:
        if path.suffix == ".npy":
            with part.open("wb") as file:
                np.save(file, values)
        else:
            Image.fromarray(values).save(part, format="TIFF", description=description)


_CLASSES: Final = 6
_LARGEST_BLOCK: Final = 64  # px
_FILLED: Final = 0.8  # of the share of the largest blocks that contain a depth


def score_values(scores: Sequence[DepthScore | None]) -> dict[str, list[float]]:
    """The variables ``depth_…`` of /depth_loop or /pictures; without a score, 0 for counts and NaN for estimates."""
    columns = {}
    for variable in [key for key in GROUPS["depth_loop"] if key.startswith("depth_") and not key.endswith("_error")]:
        attribute, error = variable.removeprefix("depth_"), f"{variable}_error"
        unknown = math.nan if error in GROUPS["depth_loop"] else 0.0
        columns[variable] = [unknown if scored is None else float(getattr(scored, attribute)) for scored in scores]
        if error in GROUPS["depth_loop"]:
            columns[error] = [math.nan if scored is None else scored.standard_errors[attribute] for scored in scores]
    return columns


def depth_map_values(depths: Sequence[MeasuredDepth], cameras: Mapping[str, Camera]) -> dict[str, Any]:
    """The variables of /pictures about measured depth."""
    blocks = [_block(depth) for depth in depths]
    maps = [_reduced(depth, block) for depth, block in zip(depths, blocks, strict=True)]
    shape = tuple(max(array.shape[k] for reduced in maps for array in reduced.values()) for k in (0, 1))
    classes = [_classes(depth) for depth in depths]
    middles = [
        float(np.nanmedian(depth.truth.depth[depth.truth.measurable])) if depth.score.seen else 0.0 for depth in depths
    ]
    return {
        **score_values([depth.score for depth in depths]),
        "predicted_availability": [
            predicted_availability(cameras[depth.camera], middle) if middle else math.nan
            for depth, middle in zip(depths, middles, strict=True)
        ],
        "matcher": [depth.score.matcher for depth in depths],
        "map_block": [float(block) for block in blocks],
        **{name: [padded(reduced[name], shape) for reduced in maps] for name in maps[0]},
        **{name: [classed[name] for classed in classes] for name in classes[0]},
    }


def _block(measured: MeasuredDepth) -> int:
    """The smallest block side, a power of two, for which hardly fewer blocks contain a depth than for the largest.

    Smaller blocks would be empty between the micro-images of the types that are out of focus.
    """
    has_depth = np.isfinite(measured.found.depth)
    sides = [1 << k for k in range(_LARGEST_BLOCK.bit_length()) if max(has_depth.shape) <= LARGEST << k]
    sides = [side for side in sides if side <= min(has_depth.shape)] or [1]
    shares = [float(np.mean(np.any(_in_blocks(has_depth, side), axis=-1))) for side in sides]
    return next(side for side, share in zip(sides, shares, strict=True) if share >= _FILLED * shares[-1])


def _reduced(measured: MeasuredDepth, block: int) -> dict[str, FloatArray]:
    depth_map, truth = measured.found, measured.truth
    surface = np.isfinite(truth.depth) & ~np.isin(depth_map.reason, (Reason.NO_LIGHT, Reason.LESS_SHARP))
    # Pixels without a depth for reasons of the microlens array say nothing about what hides what.
    hidden = np.where(surface | truth.measurable, ~truth.measurable, np.nan)
    sharp = measured.made.get("all_in_focus")
    return {
        "map_depth": _blockwise(depth_map.depth, block, np.nanmedian),
        "map_depth_error": _blockwise(
            np.where(truth.measurable, depth_map.depth - truth.depth, np.nan), block, np.nanmedian
        ),
        "map_hidden": _blockwise(hidden, block, np.nanmean),
        "map_sharp": np.full((1, 1), np.nan)
        if sharp is None
        else _blockwise(sharp, math.ceil(max(sharp.shape) / LARGEST), np.nanmean),
    }


def _in_blocks(values: NDArray[Any], block: int) -> NDArray[Any]:
    """Shape (rows, columns, pixels of a block); incomplete blocks at the right and bottom edges are left out."""
    rows, columns = (size // block for size in values.shape)
    inside = values[: rows * block, : columns * block].reshape(rows, block, columns, block)
    return np.moveaxis(inside, 1, 2).reshape(rows, columns, block * block)


def _blockwise(values: NDArray[Any], block: int, middle: Any) -> FloatArray:
    """One number for each block from its finite values; NaN for a block without any."""
    parts = np.asarray(_in_blocks(values, block), np.float64)
    known = np.any(np.isfinite(parts), axis=-1)
    blockwise = np.full(known.shape, np.nan)
    if np.any(known):
        blockwise[known] = middle(np.where(np.isfinite(parts[known]), parts[known], np.nan), axis=-1)
    return blockwise


def _classes(measured: MeasuredDepth) -> dict[str, FloatArray]:
    """Errors by class of true depth; their standard errors follow from the number of windows in each class."""
    names = ("distance", "bias", "bias_error", "spread", "spread_error", "predicted")
    columns = {f"class_{column}": np.full(_CLASSES, np.nan) for column in names}
    usable = np.isfinite(measured.found.depth) & measured.truth.measurable
    true = np.asarray(measured.truth.depth[usable], np.float64)
    error, predicted = (measured.found.depth - measured.truth.depth)[usable], measured.predicted[usable]
    for k, members in enumerate(np.array_split(np.argsort(true, kind="stable"), _CLASSES)):
        windows = members.size / measured.search.window_px**2
        if windows < 2.0:
            continue
        middle, spread = middle_and_spread(error[members])
        values = (
            np.median(true[members]),
            middle,
            spread * math.sqrt(math.pi / 2.0 / windows),  # for the median of normal errors
            spread,
            spread * math.sqrt(VARIANCE_OF_SPREAD / windows),
            np.median(predicted[members]),
        )
        for column, value in zip(names, values, strict=True):
            columns[f"class_{column}"][k] = value
    return columns
