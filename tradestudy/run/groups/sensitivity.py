"""/sensitivity: how much each error source contributes to a camera's depth uncertainty, over distance."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.analysis.depth_draws import uncertain_groups
from tradestudy.analysis.sensitivity import SensitivityPoint, sensitivity_over_field
from tradestudy.execution import Steps
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.study.definition import StudyDefinition


def sensitivity_group(definition: StudyDefinition, distance: FloatArray, steps: Steps) -> xr.Dataset:
    """/sensitivity over (camera, field, distance, source), on the axis and at the declared field positions."""
    cameras, fields = definition.case.cameras, definition.file.propagation.axis_and_places
    groups = [{group.name: group for group in uncertain_groups(camera, "both")} for camera in cameras.values()]
    asked = [
        SensitivityPoint(name=name, camera=camera, distance=distance, fields=fields) for name, camera in cameras.items()
    ]
    found = steps.map("sensitivity", sensitivity_over_field, asked, list(cameras))
    sources = list(dict.fromkeys(name for camera in groups for name in camera))
    parameters = list(
        dict.fromkeys(
            name
            for camera in found
            for field in camera
            if field.parameters is not None
            for name in field.parameters.names
        )
    )
    shape = (len(cameras), len(fields), distance.size)
    by_source = {name: np.full((*shape, len(sources)), np.nan) for name in _SOURCE_VARIABLES}
    by_parameter = {name: np.full((*shape, len(parameters)), np.nan) for name in _PARAMETER_VARIABLES}
    refused = np.full(shape, "", dtype=object)
    for i, camera_found in enumerate(found):
        for j, one in enumerate(camera_found):
            for kind, into, columns, alone in (
                ("source", by_source, sources, one.groups),
                ("parameter", by_parameter, parameters, one.parameters),
            ):
                if alone is not None:
                    errors = np.stack([bar.half_width_error for bar in alone.bars])
                    _fill(into[f"{kind}_uncertainty"][i, j], columns, alone.names, alone.half_width)
                    _fill(into[f"{kind}_uncertainty_error"][i, j], columns, alone.names, errors)
            refused[i, j] = one.no_indices if one.indices is None else one.indices.refused
            if one.indices is not None:
                for name, suffix in itertools.product(("first", "total"), ("", "_error")):
                    share = getattr(one.indices, name + suffix)
                    _fill(by_source[f"{name}_index{suffix}"][i, j], sources, one.indices.names, share)
    values: dict[str, Any] = {
        **by_source,
        "source_class": [[c[s].error_class.value if s in c else "" for s in sources] for c in groups],
        "source_parameters": [[", ".join(c[s].parameters) if s in c else "" for s in sources] for c in groups],
        "corner": [[one.corner for one in camera_found] for camera_found in found],
        "parameter_refused": [camera_found[0].refused for camera_found in found],
        "index_refused": refused,
    }
    coordinates: dict[str, Any] = {
        "camera": list(cameras),
        "field": list(fields),
        "distance": distance,
        "source": sources,
    }
    if parameters:
        values |= by_parameter
        coordinates["parameter"] = parameters
    return dataset("sensitivity", values, coordinates)


_SOURCE_VARIABLES = (
    "source_uncertainty", "source_uncertainty_error", "first_index", "first_index_error", "total_index",
    "total_index_error",
)  # fmt: skip
_PARAMETER_VARIABLES = ("parameter_uncertainty", "parameter_uncertainty_error")


def _fill(into: FloatArray, columns: list[str], names: tuple[str, ...], values: FloatArray) -> None:
    """Write rows by name (names, distances) into columns (distances, columns)."""
    for name, row in zip(names, values, strict=True):
        into[:, columns.index(name)] = row
