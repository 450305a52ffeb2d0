"""/depth_of_field and /criteria: each camera's sharp range, resolution, and criteria with a single value."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tradestudy.answers.trade_criteria import CRITERIA, Relief, criterion_of
from tradestudy.cameras.camera import Camera
from tradestudy.cameras.focus import SharpRange
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset, padded
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.schema.questions import DepthOfFieldPart
from tradestudy.study.schema.requirements import criterion_dimension

# The resolution in the scene has its extremes at an end, or where blur takes over from sampling; 401 points find them.
_SCENE_POINTS: Final = 401


def depth_of_field_group(study: PreparedStudy, asked: DepthOfFieldPart) -> xr.Dataset:
    """/depth_of_field over (camera, criterion, distance).

    Models without diffraction leave it out of every criterion; ``diffraction`` records the measure that was applied.
    """
    case, wavelength = study.case, study.case.wavelength
    cameras, sharp = case.all_cameras, case.sharp
    ranges = [[one.focus.sharp_range(criterion) for criterion in sharp.values()] for one in cameras.values()]
    values = {
        "blur_px": [criterion.blur_px for criterion in sharp.values()],
        "diffraction": [criterion.measure for criterion in sharp.values()],
        **_slices(ranges),
        **_stretches(ranges),
        "extent": [[found.extent for found in row] for row in ranges],
        "scene_share": [[found.share_of(*asked.range) for found in row] for row in ranges],
        "reason": [[found.reason for found in row] for row in ranges],
        "images": [
            [one.focus.images(criterion, *asked.range) for criterion in sharp.values()] for one in cameras.values()
        ],
        **_resolutions(cameras, case.distance, wavelength, asked.range),
        "microlenses_seeing": [camera.microlenses_seeing(case.distance) for camera in cameras.values()],
        "total_covering_plane": [camera.total_covering_plane for camera in cameras.values()],
    }
    attributes: dict[str, Any] = {"scene_near": asked.range[0], "scene_far": asked.range[1]}
    if asked.equal_resolution is not None:
        size = asked.equal_resolution
        resolved = [camera.focus.sharp_range_at_resolution(size, wavelength) for camera in cameras.values()]
        values |= {
            "resolved_near": padded([found.union.covered[:, 0] for found in resolved]),
            "resolved_far": padded([found.union.covered[:, 1] for found in resolved]),
            "resolved_extent": [found.extent for found in resolved],
            "resolved_scene_share": [found.share_of(*asked.range) for found in resolved],
            "resolved_reason": ["" if found.extent > 0.0 else found.reason for found in resolved],
        }
        attributes["equal_resolution"] = size
    coordinates: dict[str, Any] = {"camera": list(cameras), "sharp": list(sharp), "distance": case.distance}
    return dataset("depth_of_field", values, coordinates, attributes=attributes)


def _ragged(ranges: list[list[SharpRange]], rows: Sequence[Any], absent: Any = math.nan) -> NDArray[Any]:
    """Rows of every camera and criterion, padded, with those two dimensions restored."""
    return padded(rows, absent).reshape(len(ranges), len(ranges[0]), -1)


def _slices(ranges: list[list[SharpRange]]) -> Mapping[str, Any]:
    flat = [found for row in ranges for found in row]
    return {
        "slice_name": _ragged(ranges, [found.names for found in flat], ""),
        "slice_near": _ragged(ranges, [found.slices.near for found in flat]),
        "slice_far": _ragged(ranges, [found.slices.far for found in flat]),
    }


def _stretches(ranges: list[list[SharpRange]]) -> Mapping[str, Any]:
    unions = [found.union for row in ranges for found in row]
    return {
        f"{name}_{side}": _ragged(ranges, [getattr(one, attribute)[:, column] for one in unions])
        for name, attribute in (("sharp", "covered"), ("gap", "gaps"), ("overlap", "overlaps"))
        for column, side in enumerate(("near", "far"))
    }


def _resolutions(
    cameras: Mapping[str, Camera], distance: FloatArray, wavelength: float, scene: tuple[float, float]
) -> Mapping[str, Any]:
    within = np.linspace(*scene, _SCENE_POINTS)
    found = [camera.focus.lateral_resolution(distance, wavelength) for camera in cameras.values()]
    in_scene = [camera.focus.lateral_resolution(within, wavelength) for camera in cameras.values()]
    return {
        "lateral_resolution": [one.size for one in found],
        "resolution_of_sampling": [one.sampling for one in found],
        "resolution_of_blur": [one.blur for one in found],
        "resolution_of_diffraction": [one.diffraction for one in found],
        "diffraction_width": [one.diffraction_width for one in found],
        "scene_resolution": [float(np.max(one.size)) for one in in_scene],
        "scene_diffraction": [float(np.max(one.diffraction_width)) for one in in_scene],
    }


def criteria_group(study: PreparedStudy) -> xr.Dataset:
    """/criteria over (camera, criterion), each value with its basis; sharpness as in the chosen models."""
    case = study.case
    cameras, relief = case.all_cameras, Relief.of(case)
    others = list(dict.fromkeys(name for part in case.attributes.values() for name in part.others))
    names = [*(criterion.name for criterion in CRITERIA), *others]
    rows = [[criterion_of(case, camera, name) for name in names] for camera in cameras]
    units = [criterion_dimension(name, case.attributes.values()) for name in others]
    paths = [*(criterion.path for criterion in CRITERIA), *(f"attributes.others.{other}" for other in others)]
    basis = [
        [attribute.basis or _basis(study, name, path) for attribute, path in zip(row, paths, strict=True)]
        for name, row in zip(cameras, rows, strict=True)
    ]
    return dataset(
        "criteria",
        {
            "value": [[attribute.text for attribute in row] for row in rows],
            "number": [[attribute.number for attribute in row] for row in rows],
            "basis": basis,
            "number_units": [
                *(criterion.units for criterion in CRITERIA),
                *("" if one is None else one.unit or "1" for one in units),
            ],
            "says": [*(criterion.says for criterion in CRITERIA), *["as declared"] * len(others)],
        },
        {"camera": list(cameras), "criterion": names},
        attributes={
            "scene_near": relief.near,
            "scene_far": relief.far,
            "step_height": relief.step_height,
            "surface_tilt": relief.surface_tilt,
        },
    )


def _basis(study: PreparedStudy, camera: str, path: str) -> str:
    """The basis of a declared value; "declared" where the study states none."""
    place = ("cameras", camera, *path.split("."))
    annotation = study.document.annotations.get(place)
    if annotation is not None and annotation.basis is not None:
        return annotation.basis
    return "declared" if study.document.entry(place) is not None else ""
