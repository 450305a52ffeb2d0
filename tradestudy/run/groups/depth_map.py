"""/depth_map: depth uncertainty over the pictures of rigs with lens models."""

from __future__ import annotations

import numpy as np
import xarray as xr

from tradestudy.analysis.depth_map import depth_map, map_places
from tradestudy.results import dataset, distances_without_decision
from tradestudy.study.definition import StudyDefinition


def depth_map_group(definition: StudyDefinition) -> xr.Dataset | None:
    """Maps of all cameras that have one, as declared; None if no camera has one."""
    distance = distances_without_decision(definition.case.distance)
    found = {name: depth_map(camera, distance) for name, camera in definition.case.cameras.items()}
    maps = {name: one for name, one in found.items() if one is not None}
    if not maps:
        return None
    across, down = map_places()
    with np.errstate(invalid="ignore"):  # the error of an unbounded uncertainty is unknown
        errors = np.stack([one.uncertainty * one.error[:, None, None] for one in maps.values()])
        radius_errors = np.stack([one.radius * one.radius_error[:, None, None] for one in maps.values()])
    values = {
        "depth_uncertainty": np.stack([one.uncertainty for one in maps.values()]),
        "depth_uncertainty_error": errors,
        "depth_error_radius": np.stack([one.radius for one in maps.values()]),
        "depth_error_radius_error": radius_errors,
    }
    return dataset("depth_map", values, {"camera": list(maps), "distance": distance, "down": down, "across": across})
