"""Predictions of a run's seconds: every step, in counts of work; the record of measured runs holds them."""

from __future__ import annotations

import json
import math
from functools import lru_cache
from pathlib import Path

import pytest

import tradestudy
from tradestudy.errors import OutOfRangeError
from tradestudy.machine import machine_speed
from tradestudy.plan.predicted_time import PredictedStep, predicted_seconds
from tradestudy.study.definition import StudyDefinition

ROOT = Path(__file__).parents[2]
STUDIES = ROOT / "studies"
RECORD = json.loads((ROOT / "tests" / "benchmarks" / "step_costs.json").read_text(encoding="utf-8"))
ADAPTIVE = {"calibration", "sensitivity"}
DRAWN = {"depth", "depth off the axis"}  # where a camera is exact


@lru_cache
def planned(name: str, *overrides: str) -> StudyDefinition:
    return tradestudy.load(STUDIES / f"{name}.yaml", overrides).plan().definition


def steps_of(name: str, *overrides: str, speed: float = 1.0) -> dict[str, PredictedStep]:
    return {step.name: step for step in predicted_seconds(planned(name, *overrides), speed)}


@pytest.mark.parametrize("name", sorted(path.stem for path in STUDIES.glob("*.yaml")))
def test_samplers_state_a_range_and_everything_else_a_number(name: str) -> None:
    exact = any(camera.propagation.model == "exact" for camera in planned(name).case.cameras.values())
    ranges = ADAPTIVE | (DRAWN if exact else set())
    for step in steps_of(name).values():
        assert 0.0 <= step.low <= step.high < math.inf
        assert (step.low == step.high) == (step.name not in ranges)
        assert step.work


def test_twice_the_speed_takes_half_the_time() -> None:
    slow, fast = steps_of("plenoptic_vs_stereo"), steps_of("plenoptic_vs_stereo", speed=2.0)
    assert {name: step.low / 2.0 for name, step in slow.items()} == pytest.approx(
        {name: step.low for name, step in fast.items()}
    )


@pytest.mark.parametrize("speed", [0.0, -1.0, math.inf, math.nan])
def test_no_speed_is_refused(speed: float) -> None:
    with pytest.raises(OutOfRangeError):
        steps_of("stereo_design", speed=speed)


@pytest.mark.parametrize(
    ("study", "override", "step"),
    [
        ("stereo_design", "scene.distances.points=1200", "depth"),
        ("real_rig", "propagation.max_draws=1048576", "depth off the axis"),
        ("calibration", "stereo-65-calibrated.calibration.target.max_steps=100000", "calibration"),
        ("light_spot", "light_spot.tolerance=0.1 %", "image of the spot"),
        ("light_spot", "light_spot.spot.diameter=8 mm", "image of the spot"),
    ],
)
def test_more_work_takes_longer(study: str, override: str, step: str) -> None:
    assert steps_of(study, override)[step].high > 1.2 * steps_of(study)[step].high


def test_reading_a_picture_that_was_made_costs_nothing() -> None:
    """Two readings of the spot make pictures anew for the claims; without them claims take no time."""
    anew = steps_of("light_spot")["claims"].low
    none = steps_of("light_spot", "claims.S2.under=[]", "claims.S3.under=[]")["claims"].low
    assert none < 0.2 < 10.0 < anew


@pytest.mark.parametrize(
    ("study", "step"),
    [(study, step) for study, one in RECORD.items() if "pictures" not in one["steps"] for step in one["steps"]],
    ids=str,
)
def test_the_record_of_runs_is_within_a_factor_of_two(study: str, step: str) -> None:
    one = RECORD[study]
    measured = one["steps"][step]["processor"]
    predicted = steps_of(study, speed=one["speed"]).get(step)
    if predicted is None:
        assert measured < 1.0  # what is not predicted is too short to count
        return
    if max(measured, predicted.low) < 1.0:
        return
    if predicted.low < predicted.high:
        assert predicted.low <= measured <= predicted.high
    else:
        assert predicted.low / 2.0 <= measured <= 2.0 * predicted.high


@pytest.mark.parametrize("study", [study for study, one in RECORD.items() if "pictures" in one["steps"]])
def test_pictures_of_cameras_are_foreseen_with_the_steps_that_make_them(study: str) -> None:
    """They are made wherever depth is asked for first, so that only the sum of those steps can be told."""
    together = ("start", "depth", "decision", "claims", "pictures")
    measured = sum(RECORD[study]["steps"][step]["processor"] for step in together)
    steps = {step.name: step.low for step in tradestudy.load(STUDIES / f"{study}.yaml").plan().steps}
    predicted = sum(steps[step] for step in together if step in steps) * machine_speed() / RECORD[study]["speed"]
    assert predicted / 2.0 <= measured <= 2.0 * predicted
