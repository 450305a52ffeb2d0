"""Depth uncertainty of calibrated cameras: what propagation costs."""

from __future__ import annotations

import math

import numpy as np

from tradestudy.cost.case import Case
from tradestudy.cost.depth import propagation_cost
from tradestudy.cost.draws_saved import SOBOL
from tradestudy.cost.entries import Measured
from tradestudy.cost.measuring import MOST_PLACES, Allowance
from tradestudy.study.calibration.cameras import UncertainCameras
from tradestudy.study.calibration.propagation import sampling_of
from tradestudy.study.calibration.uncertain_camera import UncertainCamera
from tradestudy.study.progress import Progress
from tradestudy.study.schema.calibration import CalibrationStudyPart
from tradestudy.uncertainty.evaluation import depth_from_inverse
from tradestudy.uncertainty.linear import linear


def calibration_cost(
    part: CalibrationStudyPart, uncertain: UncertainCameras, allowance: Allowance, progress: Progress
) -> Measured | None:
    """Cost of the depth uncertainty of every camera of the calibration part, on the axis, noise and calibration."""
    places = np.array(part.distance_values())
    wanted = places[np.unique(np.linspace(0, places.size - 1, min(MOST_PLACES, places.size)).astype(int))]
    cases = [case for camera in uncertain.cameras.values() if (case := _case(camera, wanted)) is not None]
    if not cases:
        return None
    rule = sampling_of(part.accuracy, part.budget, wanted.size)
    return propagation_cost(
        cases,
        allowance,
        progress,
        name="calibrated_depth_uncertainty",
        title="Depth uncertainty with all calibration errors",
        says=f"Half the central 68.27 % interval of depth of {len(cases)} cameras on the axis at up to {MOST_PLACES} "
        "distances each where infinity is three deviations away, through the exact models: seconds for all of them "
        "together, relative error at the worst.",
        chosen=SOBOL,
        asked=part.accuracy,
        more=((SOBOL, f"until {100.0 * part.accuracy:g} %", rule),),
    )


def _case(camera: UncertainCamera, places: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> Case | None:
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
    return Case(
        name=camera.name, model=camera.model(seen, 0.0), sources=camera.sources, distance=seen, closed_form=None
    )
