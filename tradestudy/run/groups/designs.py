"""/decision for every design of a sweep: the best camera at a few distances, and the crossovers of two cameras."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.analysis.design_verdicts import Curve, best_at, crossings
from tradestudy.results import distances_without_decision
from tradestudy.run.groups.depth import DepthTables
from tradestudy.run.groups.over_designs import over_designs
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.varying import sweep_axes


def design_verdicts(definition: StudyDefinition, designs: Sequence[StudyDefinition], tables: DepthTables) -> xr.Dataset:
    """Variables of /decision over the swept parameters; the designs are those of `sweep_points`."""
    axes, decision = sweep_axes(definition), definition.file.decision
    places = np.array(decision.at if decision else distances_without_decision(definition.case.distance))
    best, along, crossed = [], [], []
    for design in designs:
        case = design.case
        curves = {name: Curve.of(camera, tables[camera, case.criteria]) for name, camera in case.cameras.items()}
        among = decision.candidates if decision and decision.candidates else curves
        chosen = {name: curves[name] for name in among}
        best.append(best_at(chosen, places))
        along.append(best_at(chosen, case.distance))
        if decision is not None:
            pair = (decision.between[0], decision.between[1])
            crossed.append(crossings(curves[pair[0]], curves[pair[1]], pair))
    shape = tuple(len(axis.labels) for axis in axes)
    values: dict[str, Any] = {
        "design_best_camera": np.array(best, dtype=object).reshape(*shape, len(places)),
        "design_best_camera_along": np.array(along, dtype=object).reshape(*shape, -1),
    }
    if decision is not None:
        most = max(1, *(len(row) for row in crossed))
        for name, empty in (("distance", math.nan), ("error", math.nan), ("nearer", "")):
            rows = [[getattr(one, name) for one in row] + [empty] * (most - len(row)) for row in crossed]
            values[f"design_crossover_{name}"] = np.array(rows).reshape(*shape, most)
    return over_designs("decision", values, {"design_place": places, "distance": definition.case.distance}, axes)
