"""/refocusing: planes on which unfocused cameras can refocus, both depths of field there, and pairs of views."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from tradestudy.answers.depth import over_designs
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.refocusing import Refocusing
from tradestudy.results import padded
from tradestudy.study.prepared import Case, PreparedStudy
from tradestudy.study.schema.questions import RefocusingPart
from tradestudy.study.varying import sweep_axes


def refocusing_group(study: PreparedStudy, designs: Sequence[PreparedStudy], part: RefocusingPart) -> xr.Dataset:
    """/refocusing over (camera, plane) and (camera, pair), and the range and number of planes over designs."""
    cameras = cameras_to_refocus(study.case)
    refocusing = [study.case.all_cameras[name].refocusing for name in cameras]
    shifts = padded([part.shifts or camera.planes(part.blur) for camera in refocusing])
    pairs = padded([[*map(float, part.pairs or dict.fromkeys((1, camera.views_across - 1)))] for camera in refocusing])
    planes = [refocused(camera, row, part.blur) for camera, row in zip(refocusing, shifts, strict=True)]
    rows = list(zip(refocusing, pairs, shifts, strict=True))
    values: dict[str, Any] = {
        "views_across": [camera.views_across for camera in refocusing],
        "shift": shifts,
        **{name: [plane[name] for plane in planes] for name in planes[0]},
        "infinity_shift": [camera.shift(math.inf) for camera in refocusing],
        "largest_shift": [camera.largest_shift for camera in refocusing],
        **_reach(refocusing, part.blur),
        "pair_pixels": pairs,
        "pair_baseline": [camera.baseline(row) for camera, row, _ in rows],
        "pair_disparity_px": [np.multiply.outer(row, shift) for _, row, shift in rows],
    }
    axes = sweep_axes(study)
    if axes:
        cases = [design.case for design in designs]
        shape = (*(len(axis.labels) for axis in axes), len(cameras))
        ends = [_reach([case.all_cameras[name].refocusing for name in cameras], largest_blur(case)) for case in cases]
        values |= {f"design_{name}": np.reshape([row[name] for row in ends], shape) for name in ends[0]}
    return over_designs("refocusing", values, {"camera": list(cameras)}, axes, {"blur_px": part.blur})


def cameras_to_refocus(case: Case) -> tuple[str, ...]:
    """Names of the cameras that the study refocuses."""
    assert case.refocusing is not None  # in a valid study
    return case.refocusing.asked({name: camera.refocuses for name, camera in case.all_cameras.items()})


def largest_blur(case: Case) -> float:
    """Largest blur [microlenses] that counts as sharp in a study that refocuses."""
    assert case.refocusing is not None  # in a valid study
    return case.refocusing.blur


def refocused(camera: Refocusing, shifts: ArrayLike, blur: float) -> dict[str, FloatArray]:
    """The variables of /refocusing along ``plane`` for shifts [microlenses] and a largest blur [microlenses]."""
    distance, shift = camera.distance(shifts), np.asarray(shifts, dtype=np.float64)
    distance = np.where(np.isnan(shift), np.nan, distance)
    rays, blurred = camera.ray_limits(shifts), camera.blur_limits(shifts, blur)
    return {
        "refocused_distance": distance,
        "from_pupil": camera.from_pupil(distance),
        "from_array": camera.from_array(distance),
        "ray_near": rays.near,
        "ray_far": rays.far,
        "blur_near": blurred.near,
        "blur_far": blurred.far,
    }


def reach(camera: Refocusing, blur: float) -> dict[str, float]:
    """Ends of the range on which a camera can refocus, and the number of its distinct planes."""
    near, far = camera.reach(blur)
    return {"near": near, "far": far, "planes": len(camera.planes(blur))}


def _reach(cameras: Sequence[Refocusing], blur: float) -> dict[str, list[float]]:
    reaches = [reach(camera, blur) for camera in cameras]
    return {name: [end[name] for end in reaches] for name in reaches[0]}


def refocused_planes(camera: Refocusing, shifts: ArrayLike | None, blur: float) -> xr.Dataset:
    """The planes of one camera over ``shift``: those of shifts [microlenses], or all distinct ones."""
    chosen = camera.planes(blur) if shifts is None else np.atleast_1d(np.asarray(shifts, dtype=np.float64))
    camera.require_shifts(chosen)
    return _over("shift", chosen, refocused(camera, chosen, blur), reach(camera, blur))


def triangulated(camera: Refocusing, pixels: int, disparity: ArrayLike) -> xr.Dataset:
    """Distances that a pair of views of one camera measures over ``disparity`` [microlenses], and its baseline."""
    camera.require_pair(pixels)
    disparities = np.atleast_1d(np.asarray(disparity, dtype=np.float64))
    camera.require_shifts(disparities / pixels)
    distance = camera.triangulate(pixels, disparities)
    lengths = {
        "distance": distance,
        "from_pupil": camera.from_pupil(distance),
        "from_array": camera.from_array(distance),
    }
    return _over("disparity", disparities, lengths, {"baseline": float(camera.baseline(pixels))})


def _over(axis: str, along: FloatArray, lengths: dict[str, FloatArray], attributes: dict[str, float]) -> xr.Dataset:
    variables = {name: (axis, values, {"units": "m"}) for name, values in lengths.items()}
    return xr.Dataset(variables, {axis: along}, attributes)
