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


def depth_of_field_group(study: PreparedStudy, part: DepthOfFieldPart) -> xr.Dataset:
    """/depth_of_field over (camera, criterion, distance).

    Models without diffraction leave it out of every criterion; ``diffraction`` records the measure that was applied.
    """
    case, wavelength = study.case, study.case.wavelength
    cameras, sharp = case.all_cameras, case.sharp
    ranges = [[camera.focus.sharp_range(criterion) for criterion in sharp.values()] for camera in cameras.values()]
    values = {
        "blur_px": [criterion.blur_px for criterion in sharp.values()],
        "diffraction": [criterion.measure for criterion in sharp.values()],
        **_slices(ranges),
        **_stretches(ranges),
        "extent": [[sharp_range.extent for sharp_range in row] for row in ranges],
        "scene_share": [[sharp_range.share_of(*part.range) for sharp_range in row] for row in ranges],
        "reason": [[sharp_range.reason for sharp_range in row] for row in ranges],
        "images": [
            [camera.focus.images(criterion, *part.range) for criterion in sharp.values()] for camera in cameras.values()
        ],
        **_resolutions(cameras, case.distance, wavelength, part.range),
        "microlenses_seeing": [camera.microlenses_seeing(case.distance) for camera in cameras.values()],
        "total_covering_plane": [camera.total_covering_plane for camera in cameras.values()],
    }
    attributes: dict[str, Any] = {"scene_near": part.range[0], "scene_far": part.range[1]}
    if part.equal_resolution is not None:
        size = part.equal_resolution
        resolved = [camera.focus.sharp_range_at_resolution(size, wavelength) for camera in cameras.values()]
        values |= {
            "resolved_near": padded([sharp_range.union.covered[:, 0] for sharp_range in resolved]),
            "resolved_far": padded([sharp_range.union.covered[:, 1] for sharp_range in resolved]),
            "resolved_extent": [sharp_range.extent for sharp_range in resolved],
            "resolved_scene_share": [sharp_range.share_of(*part.range) for sharp_range in resolved],
            "resolved_reason": ["" if sharp_range.extent > 0.0 else sharp_range.reason for sharp_range in resolved],
        }
        attributes["equal_resolution"] = size
    coordinates: dict[str, Any] = {"camera": list(cameras), "sharp": list(sharp), "distance": case.distance}
    return dataset("depth_of_field", values, coordinates, attributes=attributes)


def _ragged(ranges: list[list[SharpRange]], rows: Sequence[Any], absent: Any = math.nan) -> NDArray[Any]:
    """Rows of every camera and criterion, padded, with those two dimensions restored."""
    return padded(rows, absent).reshape(len(ranges), len(ranges[0]), -1)


def _slices(ranges: list[list[SharpRange]]) -> Mapping[str, Any]:
    flat = [sharp_range for row in ranges for sharp_range in row]
    return {
        "slice_name": _ragged(ranges, [sharp_range.names for sharp_range in flat], ""),
        "slice_near": _ragged(ranges, [sharp_range.slices.near for sharp_range in flat]),
        "slice_far": _ragged(ranges, [sharp_range.slices.far for sharp_range in flat]),
    }


def _stretches(ranges: list[list[SharpRange]]) -> Mapping[str, Any]:
    unions = [sharp_range.union for row in ranges for sharp_range in row]
    return {
        f"{name}_{side}": _ragged(ranges, [getattr(union, attribute)[:, column] for union in unions])
        for name, attribute in (("sharp", "covered"), ("gap", "gaps"), ("overlap", "overlaps"))
        for column, side in enumerate(("near", "far"))
    }


def _resolutions(
    cameras: Mapping[str, Camera], distance: FloatArray, wavelength: float, scene: tuple[float, float]
) -> Mapping[str, Any]:
    within = np.linspace(*scene, _SCENE_POINTS)
    resolutions = [camera.focus.lateral_resolution(distance, wavelength) for camera in cameras.values()]
    in_scene = [camera.focus.lateral_resolution(within, wavelength) for camera in cameras.values()]
    return {
        "lateral_resolution": [resolution.size for resolution in resolutions],
        "resolution_of_sampling": [resolution.sampling for resolution in resolutions],
        "resolution_of_blur": [resolution.blur for resolution in resolutions],
        "resolution_of_diffraction": [resolution.diffraction for resolution in resolutions],
        "diffraction_width": [resolution.diffraction_width for resolution in resolutions],
        "scene_resolution": [float(np.max(resolution.size)) for resolution in in_scene],
        "scene_diffraction": [float(np.max(resolution.diffraction_width)) for resolution in in_scene],
    }


def criteria_group(study: PreparedStudy) -> xr.Dataset:
    """/criteria over (camera, criterion), each value with its basis; sharpness as in the chosen models."""
    case = study.case
    cameras, relief = case.all_cameras, Relief.of(case)
    others = list(dict.fromkeys(other for part in case.attributes.values() for other in part.others))
    names = [*(criterion.name for criterion in CRITERIA), *others]
    rows = [[criterion_of(case, camera, name) for name in names] for camera in cameras]
    units = [criterion_dimension(other, case.attributes.values()) for other in others]
    paths = [*(criterion.path for criterion in CRITERIA), *(f"attributes.others.{other}" for other in others)]
    basis = [
        [attribute.basis or _basis(study, camera_name, path) for attribute, path in zip(row, paths, strict=True)]
        for camera_name, row in zip(cameras, rows, strict=True)
    ]
    return dataset(
        "criteria",
        {
            "value": [[attribute.text for attribute in row] for row in rows],
            "number": [[attribute.number for attribute in row] for row in rows],
            "basis": basis,
            "number_units": [
                *(criterion.units for criterion in CRITERIA),
                *("" if dimension is None else dimension.unit or "1" for dimension in units),
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
