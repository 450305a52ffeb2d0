"""The depth loop: render pictures of planes, measure depth in them, and compare its errors with the prediction."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np

from tradestudy.answers.depth_maps import predicted_availability, score_values, window_at
from tradestudy.answers.pictures import take_picture
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_map import DepthMap, DepthReaderOfKind, DepthSearch, TrueDepth
from tradestudy.depth.evaluation import depth_uncertainty
from tradestudy.errors import OutOfRangeError
from tradestudy.execution import Steps
from tradestudy.execution.executor import part_of_point
from tradestudy.imaging.estimation import (
    DepthScore,
    MatcherFit,
    fit_errors,
    flat_picture,
    require_windows,
    score,
    true_matches,
    white_picture,
)
from tradestudy.imaging.models import PictureSettings, Texture
from tradestudy.imaging.picture import PictureDisparityError
from tradestudy.imaging.render.tiles import Recording, Tile
from tradestudy.models.rendered_scene import pattern_of_scene, plane_across
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.window_matching import Reason
from tradestudy.results import dataset
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.schema.scene import DepthLoopPart

if TYPE_CHECKING:
    import xarray as xr  # only for types here: plans import this, too

STEP: Final = "depth loop"
_SEARCHED_PX: Final = 8.0  # of disparity, on either side of the plane
_SEARCHED: Final = 0.15  # of the distance, where the disparity changes little
_DEVIATIONS: Final = 6.0  # predicted standard deviations that are always searched
_PILOT: Final = 200  # side [pixels] of the first picture, from which the number of windows is estimated
_SPARE: Final = 1.1
_TRIED: Final = 0.1  # typical fraction of the time of a plane until its first picture is measured
_RENDERED: Final = 0.65  # typical fraction of the time of a depth map until its pictures are rendered
MOST_PICTURES: Final = 8
"""Maximum number of whole pictures of a plane, each with its own texture and noise, to collect windows from."""
_SEEDS_APART: Final = 1000  # more than there are distances
NOISE: Final = "shot+read+quantisation"
"""Sensor noise of all pictures of a loop."""
_FARTHEST: Final = 100.0  # times the distance

_Map = TypeVar("_Map", DepthMap, TrueDepth)


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopPoint:
    """One camera in front of one plane.

    Parameters
    ----------
    name, camera, reader
        Name of the camera, its design, and the reader that measures depth in its pictures.
    settings, window_px
        Texture, light and sensor of these pictures, and the side of the matching window [samples].
    distance
        Distance of the plane [m].
    windows, samples
        Number of windows without common pixels to measure, and rays per pixel.
    seed
        Seed of texture and noise; each further picture of the plane adds a constant.
    """

    name: str
    camera: DepthCamera
    reader: DepthReaderOfKind
    settings: PictureSettings
    window_px: float
    distance: float
    windows: int
    samples: int
    seed: int


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopFinding:
    """The depth measured on one plane.

    Parameters
    ----------
    score
        Comparison with truth and prediction; None where the camera cannot measure.
    errors_px, bounds_px
        Disparity errors [samples] and the bounds of their windows, for windows without common pixels.
    available
        Predicted share of the object points that the estimator sees in two pictures, on the rendered part of the
        sensor.
    blur_px
        Geometric blur of the matched picture [samples].
    reason
        Why there is no score, or empty.
    """

    score: DepthScore | None
    errors_px: FloatArray
    bounds_px: FloatArray
    available: float
    blur_px: float
    reason: str


def loop_points(study: PreparedStudy, part: DepthLoopPart) -> dict[tuple[str, float, float, float], LoopPoint]:
    """Every camera in front of every plane, by its name, distance [m], contrast and electrons.

    Raises
    ------
    OutOfRangeError
        A camera cannot measure depth in its pictures.
    """
    scene = study.file.scene
    assert scene is not None  # the study has been checked
    assert scene.picture is not None
    picture, light = scene.picture, scene.picture.light
    if light.electrons is None and not part.electrons:
        raise OutOfRangeError(
            "light given in photons yields different electrons in the cameras of a depth loop",
            remedy="give depth_loop.electrons, or scene.picture.light.electrons",
        )
    names = part.cameras or tuple(study.case.cameras)
    seed = study.file.propagation.seed
    points = {}
    for camera_name, (number, distance), contrast, electrons in itertools.product(
        names,
        enumerate(part.distances),
        part.contrasts or (picture.texture.contrast,),
        part.electrons or (light.electrons or math.nan,),
    ):
        camera, reader = study.case.cameras[camera_name], study.file.cameras[camera_name].reader
        if reader is None:
            raise OutOfRangeError(
                f"{camera_name} cannot measure depth in its pictures", remedy="leave it out of depth_loop.cameras"
            )
        if not np.array_equal(camera.modelled_distance(distance), distance):
            raise OutOfRangeError(
                f"{camera_name} corrects measured depth (depth.scaling), which would count as an error in its pictures",
                remedy="leave it out of depth_loop.cameras, or depth.scaling out of the camera",
            )
        scale = 1.0 if part.texture_scaled_from is None else distance / part.texture_scaled_from
        texture = Texture(contrast=contrast, correlation_length=picture.texture.correlation_length * scale)
        declared = picture.settings(scene.wavelength, camera.sensor)
        settings = replace(declared, texture=texture, light=replace(declared.light, electrons=electrons))
        points[camera_name, distance, contrast, electrons] = LoopPoint(
            name=camera_name,
            camera=camera,
            reader=reader,
            settings=settings,
            window_px=window_at(settings, camera, distance),
            distance=distance,
            windows=part.windows,
            samples=part.samples,
            seed=seed if distance in part.fitted_at else seed + 1 + number,
        )
    return points


def measure_loop(
    points: dict[tuple[str, float, float, float], LoopPoint], steps: Steps
) -> dict[tuple[str, float, float, float], LoopFinding]:
    """Measure every plane on the workers."""
    labels = [f"{camera_name} at {distance:g} m" for camera_name, distance, _, _ in points]
    return dict(zip(points, steps.map(STEP, measure_on_plane, list(points.values()), labels), strict=True))


def measure_on_plane(point: LoopPoint) -> LoopFinding:
    """Render one plane and measure its depth: a small picture first, to find out how many pixels are needed."""
    camera = _with_picture(point.camera, point.settings)
    geometry = camera.picture_geometry(np.array([point.distance]))
    blur = float(np.ravel(geometry.blur_px)[0])
    if not np.all(np.isfinite(geometry.magnification)):
        reason = "the plane is too near for the lens to form a picture of it"
        return LoopFinding(
            score=None, errors_px=np.empty(0), bounds_px=np.empty(0), available=0.0, blur_px=blur, reason=reason
        )
    small = _cropped(camera, point.distance, _PILOT)
    try:
        with part_of_point(0.0, _TRIED):
            depth_map, truth = _depth(camera, small, point)
        measured = _windows(depth_map, truth, point)
        if 0.0 < measured < point.windows:
            # The number of windows is proportional to the area of the picture.
            side = math.ceil(_PILOT * math.sqrt(_SPARE * point.windows / measured))
            small = _cropped(camera, point.distance, side)
            pictures = math.ceil(side**2 / (small.sensor.rows * small.sensor.columns))
            with part_of_point(_TRIED, 1.0):
                depth_map, truth = _enough(camera, small, point, pictures)
        predicted = float(depth_uncertainty(camera, np.array([point.distance]), "noise")[0])
        scored, reason = score(depth_map, truth, np.full(truth.depth.shape, predicted), point.window_px), ""
        errors, bounds = _of_windows_apart(depth_map, truth, point.window_px)
    except OutOfRangeError as refused:
        scored, reason = None, str(refused)
        errors = bounds = np.empty(0)
    return LoopFinding(
        score=scored,
        errors_px=errors,
        bounds_px=bounds,
        available=predicted_availability(small, point.distance),
        blur_px=blur,
        reason=reason,
    )


def _windows(depth_map: DepthMap, truth: TrueDepth, point: LoopPoint) -> float:
    """Number of windows without common pixels that the measured points fill."""
    return np.count_nonzero((depth_map.reason == Reason.MEASURED) & truth.measurable) / point.window_px**2


def _enough(camera: DepthCamera, small: DepthCamera, point: LoopPoint, pictures: int) -> tuple[DepthMap, TrueDepth]:
    """Depth maps of enough pictures to contain the requested windows, one below the other.

    ``pictures`` is their expected number, for the progress.
    """
    maps: list[tuple[DepthMap, TrueDepth]] = []
    for number in range(MOST_PICTURES):
        if maps and sum(_windows(depth_map, truth, point) for depth_map, truth in maps) >= point.windows:
            break
        expected = max(pictures, number + 1)
        with part_of_point(number / expected, (number + 1) / expected):
            maps.append(_depth(camera, small, replace(point, seed=point.seed + number * _SEEDS_APART)))
    return _stacked([depth_map for depth_map, _ in maps]), _stacked([truth for _, truth in maps])


def _stacked(maps: Sequence[_Map]) -> _Map:
    """Maps stacked into one, with all their rows."""
    names = [field.name for field in fields(maps[0])]
    return replace(maps[0], **{name: np.concatenate([getattr(part, name) for part in maps]) for name in names})


def _of_windows_apart(depth_map: DepthMap, truth: TrueDepth, window_px: float) -> tuple[FloatArray, FloatArray]:
    """Disparity errors [samples] and the bounds of their windows, for windows without common pixels."""
    step = math.ceil(window_px)
    apart = np.zeros(depth_map.depth.shape, bool)
    apart[::step, ::step] = True
    apart &= (depth_map.reason == Reason.MEASURED) & truth.measurable & (depth_map.deviation > 0.0)
    # Both deviations describe the same noise, so their ratio converts errors of depth to errors of disparity.
    bounds = np.asarray(depth_map.disparity_deviation[apart], np.float64)
    errors = np.asarray((depth_map.depth - truth.depth)[apart] / depth_map.deviation[apart], np.float64) * bounds
    return errors, bounds


def _with_picture(camera: DepthCamera, settings: PictureSettings) -> DepthCamera:
    """The camera with its derived error computed for these settings; unchanged if it declares its error."""
    law = camera.disparity_error_px
    if not isinstance(law, PictureDisparityError):
        return camera
    return replace(camera, disparity_error_px=replace(law, settings=settings))


def _depth(camera: DepthCamera, small: DepthCamera, point: LoopPoint) -> tuple[DepthMap, TrueDepth]:
    """Depth map and true depth of the plane, on a part of the sensor."""
    distance, settings = point.distance, point.settings
    near, far = _searched(camera, distance)
    reader = point.reader(camera=small, search=DepthSearch(near=near, far=far, window_px=point.window_px))
    exposures = small.exposures(distance, {}, None, settings.stop_separation)
    pattern = pattern_of_scene(settings.texture, exposures, (distance, distance), point.seed)
    recording = Recording(
        light=settings.light, noise=settings.sensor_noise, model=NOISE, pixel_fill=settings.pixel_fill
    )
    taken = {
        exposure.name: take_picture(
            Tile(
                camera=point.name,
                exposure=exposure,
                scene=plane_across(distance, pattern),
                recording=recording,
                samples=point.samples,
                seed=point.seed,
                rows=(0, exposure.sensor.rows),
                columns=(0, exposure.sensor.columns),
            )
        )
        for exposure in exposures
    }
    flat = {
        exposure.name: flat_picture(taken[exposure.name][0], white_picture(exposure, recording), recording)
        for exposure in exposures
    }
    truth = reader.truth(
        {name: depth for name, (_, depth) in taken.items()}, {name: picture.pure for name, picture in flat.items()}
    )
    with part_of_point(_RENDERED, 1.0):
        depth_map = reader.read(flat)
    return depth_map, truth


def _cropped(camera: DepthCamera, distance: float, side_px: int) -> DepthCamera:
    """The camera with only the middle of its sensor, so that all its pictures share a square of the plane.

    The square has the given side; if the pictures share only a narrower strip, the strip is longer, with the same area.
    """
    sensor = camera.sensor
    shift, shift_down = _shifts_of_middles(camera, distance)
    # Shifted by this much to either side, the pictures share a strip that is narrower by twice as much.
    widest = sensor.columns - 2 * shift
    across = min(side_px, widest) if widest > 0 else side_px
    down = min(math.ceil(side_px**2 / across), sensor.rows)
    across = max(across, math.ceil(side_px**2 / down))
    # Parity is preserved, so that pixels keep their positions.
    columns = min(sensor.columns, across + 2 * shift + (sensor.columns - across) % 2)
    rows = min(sensor.rows, down + 2 * shift_down + (sensor.rows - down) % 2)
    cropped = camera.cropped(columns, rows)
    if (measurement := camera.calibration.measurement) is not None:
        changed = replace(camera.calibration, measurement=measurement.cropped(columns, rows))
        cropped = replace(cropped, calibration=changed)
    return cropped


def _shifts_of_middles(camera: DepthCamera, distance: float) -> tuple[int, int]:
    """Largest shifts across and down [px] between what a picture shows of the plane in its middle and the axis."""
    magnification = float(np.ravel(camera.picture_geometry(np.array([distance])).magnification)[0])
    exposures = camera.exposures(distance, {}, None, 0.0)
    if len(exposures) == 1:  # it shares the plane with no other
        return 0, 0
    offsets = []
    for exposure in exposures:
        cones, rotation = exposure.cones(np.zeros(1), np.zeros(1)), np.array(exposure.pose.rotation)
        start = rotation @ np.append(cones.start[:, 0], 0.0) + np.array(exposure.pose.centre)
        ray = rotation @ np.append(cones.slope[:, 0], 1.0)
        offsets.append(np.abs(start + (distance - start[2]) / ray[2] * ray)[:2])
    across, down = np.max(offsets, axis=0) * magnification / camera.sensor.pixel_pitch
    return math.ceil(across), math.ceil(down)


def _searched(camera: DepthCamera, distance: float) -> tuple[float, float]:
    """The searched distances [m]: a range of disparity around the plane, or less if distance and noise permit."""
    # Disparity is linear in inverse depth, so a range around its middle is symmetric there.
    a = distance * np.array([1.0, 1.001])
    per_px = abs(float(np.diff(1.0 / a)[0] / np.diff(camera.disparity_px(a))[0]))
    noise = float(depth_uncertainty(camera, np.array([distance]), "noise")[0]) / distance**2
    half = min(_SEARCHED_PX * per_px, max(_SEARCHED / distance, _DEVIATIONS * noise))
    return 1.0 / (1.0 / distance + half), 1.0 / max(1.0 / distance - half, 1.0 / (_FARTHEST * distance))


def depth_loop_group(study: PreparedStudy, part: DepthLoopPart, steps: Steps) -> xr.Dataset:
    """/depth_loop over cameras, distances, contrasts and electrons."""
    points = loop_points(study, part)
    measured = measure_loop(points, steps)
    cameras = list(dict.fromkeys(key[0] for key in points))
    labels = {
        dimension: list(dict.fromkeys(key[k] for key in points))
        for k, dimension in enumerate(("camera", "distance", "contrast", "electrons"))
    }
    shape = tuple(map(len, labels.values()))
    findings = list(measured.values())
    fits = {
        camera_name: _fit(
            [finding for key, finding in measured.items() if key[0] == camera_name and key[1] in part.fitted_at]
        )
        for camera_name in cameras
    }
    over = [_over_matcher(finding, fits[key[0]]) for key, finding in measured.items()]

    def arranged(values: Sequence[Any]) -> Any:
        return np.array(values).reshape(shape)

    return dataset(
        "depth_loop",
        {
            **{
                name: arranged(values) for name, values in score_values([finding.score for finding in findings]).items()
            },
            "predicted_availability": arranged([finding.available for finding in findings]),
            "reason": arranged([finding.reason for finding in findings]),
            "blur_px": arranged([finding.blur_px for finding in findings]),
            "over_matcher": arranged([value for value, _ in over]),
            "over_matcher_error": arranged([error for _, error in over]),
            "fitted": [float(distance in part.fitted_at) for distance in labels["distance"]],
            **_matchers([fits[camera_name] for camera_name in cameras]),
        },
        labels,
    )


def _fit(findings: Sequence[LoopFinding]) -> MatcherFit | str:
    """The matcher of one camera, or why there is none.

    Errors are taken from their median at each distance, as in tests of the matcher, because a bias is not noise.
    """
    measured = [finding for finding in findings if finding.errors_px.size]
    try:
        require_windows(sum(finding.errors_px.size for finding in measured))
    except OutOfRangeError as refused:
        return str(refused)
    errors = np.concatenate([finding.errors_px - np.median(finding.errors_px) for finding in measured])
    bounds = np.concatenate([finding.bounds_px for finding in measured])
    return fit_errors(errors, bounds, float(errors.size))


def _over_matcher(finding: LoopFinding, fit: MatcherFit | str) -> tuple[float, float]:
    """Standard deviation of the errors of true matches relative to the matcher's prediction, and its standard error."""
    if isinstance(fit, str) or not finding.errors_px.size:
        return math.nan, math.nan
    relative = finding.errors_px / fit.matcher.error_px(finding.bounds_px)
    relative = relative[true_matches(relative)]
    # The standard error follows from the measured kurtosis, because the errors need not be normal.
    spread, kurtosis = float(np.std(relative)), float(np.mean(((relative - relative.mean()) / relative.std()) ** 4))
    return spread, spread * math.sqrt((kurtosis - 1.0) / (4.0 * relative.size))


def _matchers(fits: Sequence[MatcherFit | str]) -> dict[str, list[Any]]:
    values: dict[str, list[Any]] = {"matcher": [fit if isinstance(fit, str) else fit.declaration for fit in fits]}
    for parameter in ("factor", "floor", "false_matches"):
        values[f"matcher_{parameter}"] = [
            math.nan if isinstance(fit, str) else float(getattr(fit.matcher, parameter)) for fit in fits
        ]
        values[f"matcher_{parameter}_error"] = [
            math.nan if isinstance(fit, str) else float(getattr(fit, f"{parameter}_error")) for fit in fits
        ]
    return values


def matcher_file(data: xr.Dataset, study: str) -> str:
    """The fitted matchers as YAML for the ``cameras`` of a study, with their errors as comments.

    Parameters
    ----------
    data
        The group ``/depth_loop``.
    study
        Name of the study.
    """
    lines = [f"# Fitted by the depth loop of {study}, for cameras with disparity_error: derived.", "cameras:"]
    for camera_name, matcher, factor in zip(
        data["camera"].values, data["matcher"].values, data["matcher_factor"].values, strict=True
    ):
        if math.isnan(factor):
            lines.append(f"  # {camera_name}: {matcher}")
        else:
            declared, _, errors = str(matcher).partition("  # ")
            lines += [f"  {camera_name}:", f"    depth:  # {errors}", f"      {declared}"]
    return "\n".join(lines) + "\n"
