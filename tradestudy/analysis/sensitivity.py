"""The error sources that drive a camera's depth: tornado by source and Sobol indices, over distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tradestudy.analysis.depth import distribution
from tradestudy.analysis.depth_draws import outcome_model, uncertain_sources
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_measurement import CORNERS, PicturePlace, towards_corners
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.propagation import Sampling
from tradestudy.uncertainty.sensitivity import SobolIndices, Tornado, parameter_tornado, sobol_indices, tornado

# Readers need bars and shares to two digits.
_ACCURACY = 0.01
_TORNADO_BUDGET = 2**14
_SOBOL_DRAWS = 2**9


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
    model, sources = outcome_model(camera, distance, place), uncertain_sources(camera, "both")
    sampling, seed = _sampling(distance.size), camera.propagation.seed
    point = f"{name}/{field:g}/sensitivity"
    groups = tornado(model, sources, sampling, seed=seed, point=point, inverse_depth=True)
    parameters, refused = None, ""
    try:
        parameters = parameter_tornado(
            model, sources, sampling, seed=seed, point=f"{point}/parameter", inverse_depth=True
        )
    except OutOfRangeError as error:
        refused = str(error)
    indices, no_indices = None, ""
    try:
        indices = sobol_indices(model, sources, sampling, draws=_SOBOL_DRAWS, seed=seed, point=f"{point}/sobol")
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

    found = dict(zip(CORNERS, map(uncertainty, towards_corners(field)), strict=True))
    return max(found, key=lambda corner: found[corner])


def _sampling(outputs: int) -> Sampling:
    return Sampling(
        absolute_tolerance=0.0,
        relative_tolerance=_ACCURACY,
        budget_draws=_TORNADO_BUDGET,
        batch_draws=max(2**8, 2**14 >> max(outputs - 1, 0).bit_length()),
        memory_bytes=2**28,
    )
