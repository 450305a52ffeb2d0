"""Predictions of a run's seconds: pilots times counts. Time itself is never asserted; a pilot is given its seconds."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import pytest

import tradestudy
from tradestudy.analysis.claims import claims_in_order
from tradestudy.calibration.target import target_inference
from tradestudy.execution.steps import shares_before
from tradestudy.optics.arrays import FloatArray
from tradestudy.plan import pilots
from tradestudy.plan.predicted_time import PredictedStep, Stopwatch, predicted_steps
from tradestudy.study.definition import StudyDefinition

pytestmark = pytest.mark.usefixtures("only_rays")

STUDIES = Path(__file__).parents[2] / "studies"


class Idle(Stopwatch):
    """Of a machine that does nothing else."""

    @property
    def waiting(self) -> float:
        return 1.0


class Busy(Stopwatch):
    """Of a machine with one other program for each core."""

    @property
    def waiting(self) -> float:
        return 2.0


@lru_cache
def planned(name: str, *overrides: str) -> StudyDefinition:
    return tradestudy.load(STUDIES / f"{name}.yaml", overrides).plan().definition


def seconds_by_step(name: str, *overrides: str) -> dict[str, float]:
    return {step.name: step.seconds for step in predicted_steps(planned(name, *overrides), Idle())}


@lru_cache
def measured(name: str) -> tuple[PredictedStep, ...]:
    """By pilots that are run and timed."""
    return predicted_steps(planned(name), Idle())


@pytest.fixture
def a_second_each(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every pilot takes a second, whatever it does."""

    def seconds_of(work: object) -> float:
        assert callable(work)
        work()
        return 1.0

    monkeypatch.setattr(pilots, "seconds_of", seconds_of)


@pytest.mark.parametrize(("processor", "wall"), [(2.5, 4.0), (5.0, 2.5)])
def test_the_predicted_time_follows_the_clocks(processor: float, wall: float) -> None:
    """Others use the processor, or threads share the work."""
    clocks = [partial(next, itertools.count(10.0, step)) for step in (processor, wall)]
    done: list[int] = []
    assert pilots.timed(lambda: done.append(1), clocks) == (None, 2.5)
    assert done == [1]


@pytest.mark.usefixtures("a_second_each")
def test_everything_takes_longer_on_a_machine_that_is_in_use() -> None:
    idle, busy = (predicted_steps(planned("hard_cases"), watch) for watch in (Idle(), Busy()))
    assert [one.seconds for one in busy] == [2.0 * one.seconds for one in idle]


@pytest.mark.parametrize("name", sorted(path.stem for path in STUDIES.glob("*.yaml")))
def test_every_step_takes_some_seconds_of_counted_work(name: str) -> None:
    for step in measured(name):
        assert 0.0 <= step.seconds < math.inf
        assert step.work


@pytest.mark.usefixtures("a_second_each")
@pytest.mark.parametrize(
    ("study", "override", "step", "times"),
    [
        # 2 elements and 3 wavelengths at 11 or 22 f-numbers, and at 2 more of each element
        ("fresnel_validity", "fresnel_validity.f_numbers.points=22", "Fresnel against Kirchhoff, on axis", 24 / 13),
        ("fresnel_validity", "fresnel_validity.f_numbers.points=22", "Fresnel against Kirchhoff, off axis", 23 / 12),
        ("calibration_plan", "cameras.rig.calibration.target.max_steps=100", "calibration", 100 / 500),
        ("calibration_plan", "cameras.rig.calibration.target.max_steps=5000", "calibration", 1.0),
        ("stereo_design", "requirements.far=null", "requirements", 1 / 2),
    ],
)
def test_seconds_are_those_of_a_pilot_times_a_count(study: str, override: str, step: str, times: float) -> None:
    before, after = seconds_by_step(study)[step], seconds_by_step(study, override)[step]
    assert after == pytest.approx(times * before, rel=1e-12)


def test_the_pilot_of_a_calibration_evaluates_half_of_the_walkers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten parameters, and twice as many walkers and two."""
    shapes = []

    def log_probability(tried: FloatArray) -> FloatArray:
        shapes.append(tried.shape)
        return np.zeros(len(tried))

    monkeypatch.setattr(target_inference, "log_probability_about", lambda *_: log_probability)
    (asked,) = planned("calibration_plan").calibrations_to_infer().values()
    pilots.inference_seconds(asked, 0.0)
    assert set(shapes) == {(11, 10)}


@pytest.mark.usefixtures("a_second_each")
def test_the_axis_counts_once_among_the_places_of_a_sensitivity_analysis() -> None:
    at = {
        places: seconds_by_step("calibration", f"propagation.field_places=[{places}]")["sensitivity"]
        for places in ("70 %", "0 %, 70 %", "35 %, 70 %")
    }
    assert at["0 %, 70 %"] == at["70 %"]
    assert at["35 %, 70 %"] == pytest.approx(1.5 * at["70 %"], rel=1e-12)


@pytest.mark.usefixtures("a_second_each")
def test_every_pair_takes_the_time_of_both_its_cameras_to_rank() -> None:
    pair = "[stereo-50mm, raytrix-r5]"
    one, two = (
        seconds_by_step("robot", f"decision.between={pair}", f"decision.compare=[{pairs}]")["ranks"]
        for pairs in (pair, f"{pair}, [stereo-75mm, raytrix-r5]")
    )
    assert two == pytest.approx(2.0 * one, rel=1e-12)


def test_only_the_cameras_that_a_sweep_changes_are_counted_for_each_of_its_designs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pilots, "seconds_of", lambda _work: 0.0)
    monkeypatch.setattr(pilots, "table_seconds", lambda *_: 1.0)
    definition = planned("stereo_design")
    case = definition.case
    designs = {
        camera
        for point in tradestudy.study.sweep.sweep_points(definition, tradestudy.study.sweep.sweep_axes(definition))
        for camera in point.case.cameras.values()
    }
    assert len(designs) < len(case.cameras) * 130
    assert seconds_by_step("stereo_design")["depth"] == len(designs)


def test_wide_windows_off_the_axis_cost_more_than_their_targets() -> None:
    """A pilot computes windows a quarter as wide, with a tenth of the targets."""
    from tradestudy.optics.psf_difference import target_count

    windows = (5.0, 10.0, 20.0)
    wide, narrow = (target_count([w / k for w in windows], symmetric=False) for k in (1.0, 4.0))
    assert 5.0 < wide / narrow < 16.0
    assert target_count(windows, symmetric=True) < 0.01 * wide


def test_reading_an_existing_picture_costs_nothing() -> None:
    """Two readings of the spot make pictures anew for the claims; without them claims take no time."""
    (anew,) = (step.seconds for step in measured("light_spot") if step.name == "claims")
    none = seconds_by_step("light_spot", "claims.S2.under=[]", "claims.S3.under=[]")["claims"]
    assert none < 0.1 * anew


@pytest.mark.parametrize("name", ["light_spot", "plenoptic_vs_stereo"])
def test_the_parts_of_a_step_add_up_to_it(name: str) -> None:
    steps = {step.name: step for step in measured(name)}
    file = planned(name).file
    claims = steps["claims"]
    readings = ["", *file.readings]
    assert len(claims.parts) == len(claims_in_order(file.claims, readings)) + len(file.requirements)
    for step in steps.values():
        if step.parts:
            assert math.fsum(step.parts) <= step.seconds * (1.0 + 1e-12)
    # A picture is computed for the first claim that needs it, and then kept.
    if name == "light_spot":
        assert sorted(claims.parts)[0] == 0.0 < sorted(claims.parts)[-1]


def test_parts_of_a_step_are_shared_out_by_their_predicted_seconds() -> None:
    assert shares_before((1.0, 3.0, 4.0), 3) == [0.0, 0.125, 0.5, 1.0]
    assert shares_before((), 4) == shares_before((0.0,) * 4, 4) == [0.0, 0.25, 0.5, 0.75, 1.0]
