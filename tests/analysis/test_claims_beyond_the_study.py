"""Claims whose answer lies beyond the distances of the study, and requirements on sharpness with several gaps."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tradestudy
from tradestudy.answers.claims import claim_value
from tradestudy.answers.requirement_answer import _gaps

STUDIES = Path(__file__).parents[2] / "studies"
RIG = {
    "stereo-75mm.depth.disparity_error": "0.1 px",
    "stereo-75mm.calibration.errors": None,
    "usable_range": {"overlap": "10 %"},
}


def distance_at(threshold: str) -> float:
    """Distance at which depth by a head of 75 mm and 2.65 mm, with 0.1 px of 3 µm of noise, becomes so uncertain."""
    claim: dict[str, Any] = {
        "says": "far",
        "source": "data sheet",
        "quantity": "relative_uncertainty_distance",
        "camera": "stereo-75mm",
        "threshold": threshold,
        "expect": {"above": "1 m"},
        "tolerance_reason": "a bound",
    }
    study = tradestudy.load(STUDIES / "robot.yaml").with_values({**RIG, "claims": {"far": claim}})
    return claim_value(study.prepared.file.claims["far"], study.prepared.case)


@pytest.mark.parametrize("threshold", [0.0001, 0.005, 0.1])
def test_it_is_found_nearer_and_farther_than_the_distances_of_the_study(threshold: float) -> None:
    """From 0.3 to 4 m: noise is r = z σ/(f B) of the disparity; depth from z/(1 + r) to z/(1 − r) has 68.27 %."""
    noise = distance_at(f"{100 * threshold} %") * 0.1 * 3e-6 / (2.65e-3 * 75e-3)
    assert noise / (1.0 - noise**2) == pytest.approx(threshold, rel=1e-6)


def test_ranges_that_are_not_sharp_are_all_named() -> None:
    covered = np.array([[0.5, 0.95], [0.964, 1.04]])
    assert _gaps(covered, 0.9, 1.1) == [(0.95, 0.964), (1.04, 1.1)]
    assert _gaps(np.empty((0, 2)), 0.9, 1.1) == [(0.9, 1.1)]
    assert _gaps(np.array([[0.1, math.inf]]), 0.9, 1.1) == [(0.9, 0.9)]
