"""One camera over the distances of a study: what a worker computes, and all the input that it needs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tradestudy.cameras.depth_camera import DepthCamera, Limit, UsableCriteria
from tradestudy.cameras.depth_measurement import CORNERS, FieldPosition, towards_corners
from tradestudy.depth.evaluation import ERROR_SOURCES, DepthEvaluation, distribution, evaluate_depth
from tradestudy.depth.usable import LIMIT_NAMES, Interval, all_met, evaluate_limits, usable_intervals
from tradestudy.execution import Steps
from tradestudy.imaging.picture import matching_needs
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.results import coordinate_names, dataset, padded_attributes
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.varying import SweepAxis, point_labels, sweep_axes


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthPoint:
    """A camera that measures depth, the limits of its usable range, and the distances [m] to evaluate."""

    camera: DepthCamera
    criteria: UsableCriteria
    distance: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthTable:
    """Depth errors and usable range of one camera."""

    evaluation: DepthEvaluation
    limits: Mapping[str, Limit]
    intervals: tuple[Interval, ...]
    virtual_depth: FloatArray
    usable: BoolArray


def depth_table(point: DepthPoint) -> DepthTable:
    """Evaluate the depth errors and the usable range of a camera."""
    camera, criteria, distance = point.camera, point.criteria, point.distance
    limits = dict(evaluate_limits(camera, criteria, distance, depth=distribution))
    return DepthTable(
        evaluation=evaluate_depth(camera, distance),
        limits=limits,
        intervals=usable_intervals(camera, criteria, distance),
        virtual_depth=camera.virtual_depth(distance),
        usable=all_met(limits, distance.shape),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldPoint:
    """A camera that measures depth, the positions in the picture and the distances [m] to evaluate."""

    camera: DepthCamera
    fields: tuple[FieldPosition, ...]
    distance: FloatArray


def depth_over_field(point: FieldPoint) -> list[DepthEvaluation]:
    """Evaluate a camera at each field position."""
    return [evaluate_depth(point.camera, point.distance, field) for field in point.fields]


def over_designs(
    group: str,
    values: Mapping[str, Any],
    coordinates: Mapping[str, Any],
    axes: Sequence[SweepAxis],
    attributes: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """A group of results whose variables may start with the swept parameters, in the order of the axes."""
    names = coordinate_names([axis.path for axis in axes])
    swept = {name: list(axis.labels) for name, axis in zip(names, axes, strict=True)}
    result = dataset(group, values, {**swept, **coordinates}, leading=tuple(swept), attributes=attributes)
    for name, axis in zip(names, axes, strict=True):
        result[name].attrs = {
            "units": axis.units,
            "long_name": name.replace("_", " "),
            "path": axis.path,
            "declared": axis.declared,
            "measures": "" if axis.dimension is None else axis.dimension.name,
        }
    return result


OFF_AXIS: Final = "depth off the axis"
"""Name of the step that computes depth off the axis."""

DepthTables = Mapping[tuple[DepthCamera, UsableCriteria], DepthTable]


def depth_tables(study: PreparedStudy, designs: Sequence[PreparedStudy], steps: Steps) -> DepthTables:
    """Depth errors and usability of each camera of each design, over the distances of the study.

    A camera that several designs share is computed once, under the label of the first of them.
    """
    labels: dict[tuple[DepthCamera, UsableCriteria], tuple[str, str]] = {}
    for design, label in zip(designs, point_labels(sweep_axes(study)), strict=True):
        for camera_name, camera in design.case.cameras.items():
            labels.setdefault((camera, design.case.criteria), (camera_name, label))
    distance = study.case.distance
    points = [DepthPoint(camera=camera, criteria=criteria, distance=distance) for camera, criteria in labels]
    words = [f"{camera_name}, {label}" for camera_name, label in labels.values()]
    return dict(zip(labels, steps.map("depth", depth_table, points, words), strict=True))


def depth_group(study: PreparedStudy, designs: Sequence[PreparedStudy], tables: DepthTables) -> xr.Dataset:
    """/depth over (swept parameters, camera, distance); the designs are those of `sweep_points`."""
    axes, distance = sweep_axes(study), study.case.distance
    keys = [(camera, design.case.criteria) for design in designs for camera in design.case.cameras.values()]
    arrays, part_names = depth_arrays([tables[key] for key in keys])
    shape = (*(len(axis.labels) for axis in axes), len(study.case.cameras))
    stacked = {name: array.reshape(shape + array.shape[1:]) for name, array in arrays.items()}
    coordinates = depth_coordinates(study, distance, part_names)
    return over_designs("depth", stacked, coordinates, axes, {"matching_needs": matching_needs()})


def depth_at_places_group(study: PreparedStudy, places: tuple[float, ...]) -> xr.Dataset:
    """/depth_at_places: the variables of /depth at the distances of the decision, for the study as declared."""
    distance = np.array(sorted(set(places)))
    arrays, part_names = depth_arrays(
        [
            depth_table(DepthPoint(camera=camera, criteria=study.case.criteria, distance=distance))
            for camera in study.case.cameras.values()
        ]
    )
    return dataset("depth_at_places", arrays, depth_coordinates(study, distance, part_names))


def depth_field_group(study: PreparedStudy, fields: tuple[float, ...], steps: Steps) -> xr.Dataset:
    """/depth_field: depth errors off the axis, over (camera, field, corner, distance), for the study as declared."""
    cameras, distance = study.case.cameras, study.case.distance
    points = [
        FieldPoint(
            camera=camera,
            fields=tuple(place for field in fields for place in towards_corners(field)),
            distance=distance,
        )
        for camera in cameras.values()
    ]
    table = steps.map(OFF_AXIS, depth_over_field, points, list(cameras))
    flat = [evaluation for camera in table for evaluation in camera]
    arrays, part_names = _error_arrays(flat)
    shape = (len(cameras), len(fields), len(CORNERS))
    values = {name: array.reshape(shape + array.shape[1:]) for name, array in arrays.items()}
    coordinates = depth_coordinates(study, distance, part_names)
    return dataset(
        "depth_field",
        values,
        {name: coordinates[name] for name in ("camera", "distance", "error_source", "quantile", "part")}
        | {"field": list(fields), "corner": list(CORNERS)},
    )


def depth_coordinates(study: PreparedStudy, distance: FloatArray, part_names: list[str]) -> dict[str, Any]:
    """Labels along the dimensions of /depth that have them."""
    cameras = study.case.cameras
    return {
        "camera": list(cameras),
        "distance": distance,
        "side": ["nearer", "farther"],
        "error_source": list(ERROR_SOURCES),
        "quantile": list(next(iter(cameras.values())).propagation.probabilities),
        "part": part_names,
        "limit": list(LIMIT_NAMES),
    }


def depth_arrays(tables: Sequence[DepthTable]) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """The variables of /depth, with the camera as first dimension, and the names of all parts of the error."""
    evaluations = [table.evaluation for table in tables]
    distance = evaluations[0].distance

    def over_limits(attribute: str, absent: float) -> FloatArray:
        rows = [
            [
                np.broadcast_to(
                    np.asarray(
                        getattr(table.limits[limit], attribute) if limit in table.limits else absent, dtype=np.float64
                    ),
                    distance.shape,
                )
                for limit in LIMIT_NAMES
            ]
            for table in tables
        ]
        return np.moveaxis(np.array(rows), 1, 2)

    intervals = padded_attributes(
        [table.intervals for table in tables],
        dict.fromkeys(("near", "far", "near_error", "far_error"), math.nan) | {"near_limit": "", "far_limit": ""},
    )
    errors, part_names = _error_arrays(evaluations)
    arrays = {
        **errors,
        "depth_discrimination": np.stack([e.discrimination.T for e in evaluations]),
        "equivalent_baseline": np.stack([e.equivalent_baseline for e in evaluations]),
        "disparity_px": np.stack([e.disparity_px for e in evaluations]),
        "disparity_error_px": np.stack([e.disparity_error_px for e in evaluations]),
        "disparity_error_px_error": np.stack([e.disparity_error_px_error for e in evaluations]),
        "virtual_depth": np.stack([table.virtual_depth for table in tables]),
        "usable": np.stack([table.usable for table in tables]),
        "limit_value": over_limits("value", math.nan),
        "limit_met": over_limits("met", -1.0).astype(np.int8),
        "limit_bound": over_limits("bound", math.nan)[:, 0],
        "usable_near": intervals["near"],
        "usable_far": intervals["far"],
        "usable_near_error": intervals["near_error"],
        "usable_far_error": intervals["far_error"],
        "near_limit": intervals["near_limit"],
        "far_limit": intervals["far_limit"],
    }
    return arrays, part_names


def _error_arrays(evaluations: Sequence[DepthEvaluation]) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """The variables for depth errors, with the camera as first dimension, and the names of all their parts."""
    part_names = list(dict.fromkeys(part for evaluation in evaluations for part in evaluation.shares))

    def over_error_sources(attribute: str) -> FloatArray:
        return np.stack([getattr(evaluation, attribute).T for evaluation in evaluations])

    def widths(variable: str, attribute: str) -> dict[str, FloatArray]:
        by_suffix = {end: over_error_sources(attribute + end) for end in ("", "_error")}
        return {variable + end: values[..., ERROR_SOURCES.index("both")] for end, values in by_suffix.items()} | {
            f"{variable}_by_error_source{end}": values for end, values in by_suffix.items()
        }

    missing = np.full_like(evaluations[0].distance, np.nan)
    uncertainty = widths("depth_uncertainty", "uncertainty")
    return {
        **uncertainty,
        "relative_uncertainty": uncertainty["depth_uncertainty"] / evaluations[0].distance,
        **widths("depth_error_radius", "error_radius"),
        "variance_share": np.stack(
            [
                np.stack([evaluation.shares.get(part, missing) for part in part_names], axis=-1)
                for evaluation in evaluations
            ]
        ),
        "depth_quantile": np.stack([np.moveaxis(evaluation.quantile, 0, 1) for evaluation in evaluations]),
        "failed_fraction": over_error_sources("failed_fraction"),
        "failed_fraction_error": over_error_sources("failed_fraction_error"),
        "converged": np.stack([evaluation.converged for evaluation in evaluations]),
    }, part_names
