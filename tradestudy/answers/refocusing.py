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


def refocusing_group(study: PreparedStudy, designs: Sequence[PreparedStudy], asked: RefocusingPart) -> xr.Dataset:
    """/refocusing over (camera, plane) and (camera, pair), and the range and number of planes over designs."""
    cameras = cameras_to_refocus(study.case)
    found = {name: study.case.all_cameras[name].refocusing for name in cameras}
    shifts = padded([asked.shifts or one.planes(asked.blur) for one in found.values()])
    pairs = padded([[*map(float, asked.pairs or dict.fromkeys((1, one.views_across - 1)))] for one in found.values()])
    planes = [refocused(one, row, asked.blur) for one, row in zip(found.values(), shifts, strict=True)]
    rows = list(zip(found.values(), pairs, shifts, strict=True))
    values: dict[str, Any] = {
        "views_across": [one.views_across for one in found.values()],
        "shift": shifts,
        **{name: [one[name] for one in planes] for name in planes[0]},
        "infinity_shift": [one.shift(math.inf) for one in found.values()],
        "largest_shift": [one.largest_shift for one in found.values()],
        **_reach(list(found.values()), asked.blur),
        "pair_pixels": pairs,
        "pair_baseline": [one.baseline(row) for one, row, _ in rows],
        "pair_disparity_px": [np.multiply.outer(row, shift) for _, row, shift in rows],
    }
    axes = sweep_axes(study)
    if axes:
        cases = [one.case for one in designs]
        shape = (*(len(axis.labels) for axis in axes), len(cameras))
        ends = [_reach([one.all_cameras[name].refocusing for name in cameras], largest_blur(one)) for one in cases]
        values |= {f"design_{name}": np.reshape([one[name] for one in ends], shape) for name in ends[0]}
    return over_designs("refocusing", values, {"camera": list(cameras)}, axes, {"blur_px": asked.blur})


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
    distance, given = camera.distance(shifts), np.asarray(shifts, dtype=np.float64)
    distance = np.where(np.isnan(given), np.nan, distance)
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
    found = [reach(one, blur) for one in cameras]
    return {name: [one[name] for one in found] for name in found[0]}


def refocused_planes(camera: Refocusing, shifts: ArrayLike | None, blur: float) -> xr.Dataset:
    """The planes of one camera over ``shift``: those of shifts [microlenses], or all distinct ones."""
    given = camera.planes(blur) if shifts is None else np.atleast_1d(np.asarray(shifts, dtype=np.float64))
    camera.require_shifts(given)
    return _over("shift", given, refocused(camera, given, blur), reach(camera, blur))


def triangulated(camera: Refocusing, pixels: int, disparity: ArrayLike) -> xr.Dataset:
    """Distances that a pair of views of one camera measures over ``disparity`` [microlenses], and its baseline."""
    camera.require_pair(pixels)
    given = np.atleast_1d(np.asarray(disparity, dtype=np.float64))
    camera.require_shifts(given / pixels)
    there = camera.triangulate(pixels, given)
    found = {"distance": there, "from_pupil": camera.from_pupil(there), "from_array": camera.from_array(there)}
    return _over("disparity", given, found, {"baseline": float(camera.baseline(pixels))})


def _over(axis: str, along: FloatArray, lengths: dict[str, FloatArray], attributes: dict[str, float]) -> xr.Dataset:
    variables = {name: (axis, values, {"units": "m"}) for name, values in lengths.items()}
    return xr.Dataset(variables, {axis: along}, attributes)
