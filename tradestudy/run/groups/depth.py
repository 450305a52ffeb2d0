"""/depth: every camera over distance and over the study's sweep."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.analysis.depth import QUANTILES, WAYS
from tradestudy.analysis.depth_points import DepthPoint, DepthTable, depth_table
from tradestudy.analysis.usable import LIMIT_NAMES, Interval
from tradestudy.execution import Steps
from tradestudy.imaging.picture import matching_needs
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.sweep import point_labels, sweep_axes, sweep_points


def depth_group(definition: StudyDefinition, steps: Steps) -> xr.Dataset:
    """/depth over (swept parameters, camera, distance)."""
    axes = sweep_axes(definition)
    points = [DepthPoint.of(point.case) for point in sweep_points(definition, axes)]
    tables = steps.map("depth", depth_table, points, point_labels(axes))
    part_names = list(dict.fromkeys(name for table in tables for name in table.parts))
    intervals = max(len(rows) for table in tables for rows in table.intervals)
    shape = tuple(len(axis.labels) for axis in axes)
    arrays = [_depth_arrays(table, part_names, max(intervals, 1)) for table in tables]
    stacked = {
        name: np.stack([array[name] for array in arrays]).reshape(shape + np.shape(arrays[0][name]))
        for name in arrays[0]
    }
    leading = tuple(axis.path for axis in axes)
    coordinates: dict[str, Any] = {axis.path: list(axis.labels) for axis in axes}
    coordinates |= _coordinates(definition, definition.case.distance, part_names)
    result = dataset("depth", stacked, coordinates, leading=leading, attributes={"matching_needs": matching_needs()})
    for axis in axes:
        result[axis.path].attrs = {"units": axis.units, "long_name": axis.path, "declared": axis.declared}
    return result


def depth_at_places_group(definition: StudyDefinition, places: tuple[float, ...]) -> xr.Dataset:
    """/depth_at_places: the same at the distances of the decision, between those of the scene, as declared."""
    distance = np.array(sorted(set(places)))
    point = replace(DepthPoint.of(definition.case), distance=distance)
    table = depth_table(point)
    intervals = max(map(len, table.intervals), default=0)
    return dataset(
        "depth_at_places",
        _depth_arrays(table, list(table.parts), max(intervals, 1)),
        _coordinates(definition, distance, list(table.parts)),
    )


def _coordinates(definition: StudyDefinition, distance: FloatArray, part_names: list[str]) -> dict[str, Any]:
    return {
        "camera": list(definition.case.cameras),
        "distance": distance,
        "side": ["nearer", "farther"],
        "way": list(WAYS),
        "quantile": list(QUANTILES),
        "part": part_names,
        "limit": list(LIMIT_NAMES),
    }


def _depth_arrays(table: DepthTable, part_names: list[str], most_intervals: int) -> dict[str, Any]:
    """The variables of /depth for one case, camera first."""
    evaluations = table.evaluations
    distance = evaluations[0].distance
    missing = np.full_like(distance, np.nan)

    def over_limits(attribute: str, absent: float) -> FloatArray:
        rows = [
            [
                np.broadcast_to(
                    np.asarray(getattr(limits[name], attribute) if name in limits else absent, dtype=np.float64),
                    distance.shape,
                )
                for name in LIMIT_NAMES
            ]
            for limits in table.limits
        ]
        return np.moveaxis(np.array(rows), 1, 2)

    def over_intervals(attribute: str, absent: Any) -> Any:
        return np.array([_padded(rows, attribute, absent, most_intervals) for rows in table.intervals])

    uncertainty = np.stack([e.uncertainty for e in evaluations])
    return {
        "depth_discrimination": np.stack([e.discrimination.T for e in evaluations]),
        "depth_uncertainty": uncertainty[:, WAYS.index("both")],
        "depth_uncertainty_error": np.stack([e.uncertainty_error for e in evaluations]),
        "depth_uncertainty_way": np.moveaxis(uncertainty, 1, 2),
        "depth_uncertainty_part": np.stack(
            [np.stack([e.parts.get(name, missing) for name in part_names], axis=-1) for e in evaluations]
        ),
        "depth_quantile": np.stack([np.moveaxis(e.quantile, 0, 1) for e in evaluations]),
        "failed_fraction": np.stack([e.failed_fraction.T for e in evaluations]),
        "equivalent_baseline": np.stack([e.equivalent_baseline for e in evaluations]),
        "disparity_px": np.stack([e.disparity_px for e in evaluations]),
        "disparity_error_px": np.stack([e.disparity_error_px for e in evaluations]),
        "disparity_error_px_error": np.stack([e.disparity_error_px_error for e in evaluations]),
        "virtual_depth": np.stack(table.virtual_depth),
        "usable": np.stack(table.usable),
        "limit_value": over_limits("value", math.nan),
        "limit_met": over_limits("met", -1.0).astype(np.int8),
        "limit_bound": over_limits("bound", math.nan)[:, 0],
        "usable_near": over_intervals("near", math.nan),
        "usable_far": over_intervals("far", math.nan),
        "near_limit": over_intervals("near_limit", ""),
        "far_limit": over_intervals("far_limit", ""),
    }


def _padded(rows: tuple[Interval, ...], attribute: str, absent: Any, length: int) -> list[Any]:
    return [getattr(row, attribute) for row in rows] + [absent] * (length - len(rows))


def depth_as_declared(definition: StudyDefinition) -> xr.Dataset:
    """/depth of the study as declared, without its sweep."""
    table = depth_table(DepthPoint.of(definition.case))
    return dataset("depth", _depth_arrays(table, list(table.parts), 1 + max(map(len, table.intervals))), {})
