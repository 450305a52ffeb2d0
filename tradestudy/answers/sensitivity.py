"""The error sources that drive a camera's depth: tornado by source and Sobol indices, over distance."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_measurement import CORNERS, PicturePlace, towards_corners
from tradestudy.depth.draws import inverse_depth_model, uncertain_groups, uncertain_sources
from tradestudy.depth.evaluation import distribution
from tradestudy.errors import OutOfRangeError
from tradestudy.execution import Steps
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.study.prepared import PreparedStudy
from tradestudy.uncertainty.sensitivity import SobolIndices, Tornado, parameter_tornado, sobol_indices, tornado

_SOBOL_DRAWS = 2**9  # readers need shares to two digits


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraSensitivity:
    """Tornado by group and, unless it would mislead, by parameter; Sobol indices of inverse depth.

    ``corner`` names the corner of the picture towards which the field position lies; empty on the axis. ``parameters``
    is None if a tornado by parameter is refused, for the reason in ``refused``; ``indices`` is None if the sources have
    no variance, as ``no_indices`` states.
    """

    corner: str
    groups: Tornado
    parameters: Tornado | None
    refused: str
    indices: SobolIndices | None
    no_indices: str


@dataclass(frozen=True, kw_only=True, eq=False)
class SensitivityPoint:
    """One camera of a study, with the distances [m] and field positions of its sensitivity analysis."""

    name: str
    camera: DepthCamera
    distance: FloatArray
    fields: tuple[float, ...]


def sensitivity_over_field(point: SensitivityPoint) -> list[CameraSensitivity]:
    """`sensitivity_of` at every field position, towards the corner where depth is least certain."""
    return [sensitivity_of(point.name, point.camera, point.distance, field) for field in point.fields]


def sensitivity_of(name: str, camera: DepthCamera, distance: FloatArray, field: float) -> CameraSensitivity:
    """Find the error sources that drive the depth of one camera at distances [m] and a field position.

    Off the axis, towards the corner where the camera sees most of the distances and is least certain there.
    """
    corner = _least_certain_corner(camera, distance, field) if field else ""
    place = dict(zip(CORNERS, towards_corners(field), strict=True))[corner] if corner else 0.0
    model, sources = inverse_depth_model(camera, distance, place), uncertain_sources(camera, "both")
    seed = camera.propagation.seed
    # As many draws as keep a batch within 2¹⁴ depths, but no fewer than 2⁸.
    batch = max(2**8, 2**14 >> max(distance.size - 1, 0).bit_length())
    point = f"{name}/{field:g}/sensitivity"
    groups = tornado(model, sources, seed=seed, point=point, inverse_depth=True, batch_draws=batch)
    parameters, refused = None, ""
    try:
        parameters = parameter_tornado(
            model, sources, seed=seed, point=f"{point}/parameter", inverse_depth=True, batch_draws=batch
        )
    except OutOfRangeError as error:
        refused = str(error)
    indices, no_indices = None, ""
    try:
        indices = sobol_indices(
            model, sources, draws=_SOBOL_DRAWS, seed=seed, point=f"{point}/sobol", batch_draws=batch
        )
    except OutOfRangeError as error:
        no_indices = str(error)
    return CameraSensitivity(
        corner=corner,
        groups=groups,
        parameters=parameters,
        refused=refused,
        indices=indices,
        no_indices=no_indices,
    )


def _least_certain_corner(camera: DepthCamera, distance: FloatArray, field: float) -> str:
    def uncertainty(place: PicturePlace) -> tuple[int, float]:
        relative = distribution(camera, distance, "both", place).half_width / distance
        return int(np.sum(~np.isnan(relative))), float(np.nansum(relative))

    by_corner = dict(zip(CORNERS, map(uncertainty, towards_corners(field)), strict=True))
    return max(by_corner, key=lambda corner: by_corner[corner])


def sensitivity_group(study: PreparedStudy, distance: FloatArray, steps: Steps) -> xr.Dataset:
    """/sensitivity over (camera, field, distance, source), on the axis and at the declared field positions."""
    cameras, fields = study.case.cameras, study.file.propagation.axis_and_places
    groups = [{group.name: group for group in uncertain_groups(camera, "both")} for camera in cameras.values()]
    points = [
        SensitivityPoint(name=name, camera=camera, distance=distance, fields=fields) for name, camera in cameras.items()
    ]
    analyses = steps.map("sensitivity", sensitivity_over_field, points, list(cameras))
    sources = list(dict.fromkeys(source for camera in groups for source in camera))
    parameters = list(
        dict.fromkeys(
            parameter
            for camera in analyses
            for field in camera
            if field.parameters is not None
            for parameter in field.parameters.names
        )
    )
    shape = (len(cameras), len(fields), distance.size)
    by_source = {name: np.full((*shape, len(sources)), np.nan) for name in _SOURCE_VARIABLES}
    by_parameter = {name: np.full((*shape, len(parameters)), np.nan) for name in _PARAMETER_VARIABLES}
    refused = np.full(shape, "", dtype=object)
    for i, camera_analyses in enumerate(analyses):
        for j, analysis in enumerate(camera_analyses):
            for kind, into, columns, alone in (
                ("source", by_source, sources, analysis.groups),
                ("parameter", by_parameter, parameters, analysis.parameters),
            ):
                if alone is not None:
                    _fill(into[f"{kind}_uncertainty"][i, j], columns, alone.names, alone.half_width)
                    _fill(into[f"{kind}_uncertainty_error"][i, j], columns, alone.names, alone.half_width_error)
            refused[i, j] = analysis.no_indices if analysis.indices is None else analysis.indices.refused
            if analysis.indices is not None:
                for order, suffix in itertools.product(("first", "total"), ("", "_error")):
                    share = getattr(analysis.indices, order + suffix)
                    _fill(by_source[f"{order}_index{suffix}"][i, j], sources, analysis.indices.names, share)
    values: dict[str, Any] = {
        **by_source,
        "source_class": [[c[s].error_class.value if s in c else "" for s in sources] for c in groups],
        "source_parameters": [[", ".join(c[s].parameters) if s in c else "" for s in sources] for c in groups],
        "corner": [[analysis.corner for analysis in camera_analyses] for camera_analyses in analyses],
        "parameter_refused": [camera_analyses[0].refused for camera_analyses in analyses],
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
