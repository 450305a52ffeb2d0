"""Depth uncertainty of calibrated cameras: what propagation costs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from tradestudy.analysis.propagation import sampling_of
from tradestudy.calibration.declaration import CalibrationStudyPart
from tradestudy.calibration.uncertain_cameras import UncertainCamera, UncertainCameras
from tradestudy.cost.depth import propagation_cost
from tradestudy.cost.depth_case import DepthCase
from tradestudy.cost.draws_saved import SOBOL
from tradestudy.cost.entries import CostTable, nothing_measured
from tradestudy.cost.measuring import MOST_PLACES, Allowance
from tradestudy.execution.progress import Progress
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.evaluation import depth_from_inverse
from tradestudy.uncertainty.linear import linear

_UNBOUNDED: Final = (
    "its errors have no covariance, or it sees no distance of the calibration with infinity three deviations away"
)


def calibration_cost(
    part: CalibrationStudyPart,
    uncertain: UncertainCameras,
    titles: Mapping[str, str],
    allowance: Allowance,
    progress: Progress,
) -> CostTable:
    """Cost of the depth uncertainty of every camera of the calibration part, on the axis, noise and calibration.

    Cameras whose interval of depth is bounded at none of its distances are left out and named.
    """
    places = np.array(part.distance_values())
    wanted = places[np.unique(np.linspace(0, places.size - 1, min(MOST_PLACES, places.size)).astype(int))]
    found = {name: _case(camera, titles[name], wanted) for name, camera in uncertain.cameras.items()}
    cases = [case for case in found.values() if case is not None]
    name, title = "calibrated_depth_uncertainty", "Depth uncertainty with all calibration errors"
    says = (
        f"Half the central 68.27 % interval of depth of {len(cases)} cameras on the axis at up to {MOST_PLACES} "
        "distances each where infinity is three deviations away, through the exact models: seconds for all of them "
        "together, relative error at the worst."
    )
    if not cases:
        return nothing_measured(name, title, says, f"everything: of each camera, {_UNBOUNDED}")
    rule = sampling_of(part.accuracy, part.budget, wanted.size)
    measured = propagation_cost(
        cases,
        allowance,
        progress,
        name=name,
        title=title,
        says=says,
        chosen=SOBOL,
        asked=part.accuracy,
        more=((SOBOL, f"until {100.0 * part.accuracy:g} %", rule),),
    )
    unbounded = tuple(f"{titles[one]}: {_UNBOUNDED}" for one, case in found.items() if case is None)
    ways = {SOBOL: "calibration.accuracy, which says how many draws, and calibration.budget, which bounds them"}
    return replace(measured, left_out=(*unbounded, *measured.left_out), ways=ways)


def _case(camera: UncertainCamera, title: str, places: FloatArray) -> DepthCase | None:
    """The camera where its interval is bounded: a line in inverse depth, three deviations to infinity, tells."""
    if camera.sources.covariance() is None:
        return None
    line = linear(camera.model(places, 0.0), camera.sources, inverse_depth=True)
    assert line.inverse_estimate is not None  # it was asked for
    assert line.inverse_uncertainty is not None
    with np.errstate(invalid="ignore"):  # where the camera does not see, everything is NaN and left out
        bounded = line.inverse_estimate > 3.0 * line.inverse_uncertainty
    seen = places[bounded & np.isfinite(depth_from_inverse(line.inverse_estimate))]
    if seen.size == 0 or not math.isfinite(float(seen[0])):
        return None
    return DepthCase(
        name=camera.name,
        title=title,
        model=camera.model(seen, 0.0),
        sources=camera.sources,
        distance=seen,
        closed_form=None,
    )
