"""Inverse questions with one answer, several, none, and one beyond their ends."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tradestudy
from tradestudy.answers import questions as inverse_questions
from tradestudy.answers.questions import solve
from tradestudy.answers.solutions import Solved
from tradestudy.depth.evaluation import depth_uncertainty
from tradestudy.errors import StudyError

STUDIES = Path(__file__).parents[2] / "studies"


def asked(**question: Any) -> tuple[tradestudy.Study, Solved]:
    values = {"says": "which value?", "at": "3 m", **question}
    study = tradestudy.load(STUDIES / "robot.yaml").with_values({"solve": {"own": values}})
    definition = study.plan().study.under("own")
    return study, solve(definition, definition.file.solve["own"])


def uncertainty(study: tradestudy.Study, values: dict[str, str], camera: str, at: float) -> float:
    case = study.plan().study.with_values(values).case
    return float(depth_uncertainty(case.cameras[camera], np.array([at]))[0])


BASELINE = {"vary": "stereo-75mm.baseline", "low": "30 mm", "high": "150 mm"}


@pytest.mark.parametrize("goal", [{"relative": "1 %"}, {"uncertainty": "30 mm"}])
def test_the_baseline_for_one_per_cent_at_three_metres(goal: dict[str, str]) -> None:
    study, found = asked(**BASELINE, camera="stereo-75mm", **goal)
    (one,) = found.solutions
    assert uncertainty(study, {"stereo-75mm.baseline": f"{one.value} m"}, "stereo-75mm", 3.0) == pytest.approx(0.03)
    assert found.answer == "53.4 mm; declared: 75 mm"
    assert [value for value, _ in (found.tried[0], found.tried[-1])] == pytest.approx([0.03, 0.15])
    for value, tried in found.tried[::4]:
        there = uncertainty(study, {"stereo-75mm.baseline": f"{value} m"}, "stereo-75mm", 3.0)
        assert tried == pytest.approx(there)


def test_an_answer_beyond_an_end_is_reported_with_the_remaining_factor() -> None:
    study, found = asked(**{**BASELINE, "low": "60 mm"}, camera="stereo-75mm", relative="1 %")
    assert found.solutions == ()
    assert np.isnan(found.value)
    said = re.fullmatch(
        r"no value .*60 mm.*150 mm: 75 mm stereo head .*1 % at 3 m.*; .*beyond 60 mm, .* factor of ([\d.]+).*",
        found.answer.replace("\N{NO-BREAK SPACE}", " "),
    )
    assert said
    left = 0.03 / uncertainty(study, {"stereo-75mm.baseline": "60 mm"}, "stereo-75mm", 3.0)
    assert float(said[1]) == pytest.approx(left, rel=0.06)


@pytest.mark.parametrize(("goal", "says"), [("3 mm", True), ("30 mm", False)])
def test_noise_that_exceeds_the_calibration_asked_for_is_reported(goal: str, *, says: bool) -> None:
    """A noise of δ px makes Z² δ/(B f) of depth, whatever the calibration."""
    yaw = {"vary": "stereo-75mm.calibration.errors.yaw.standard_deviation", "low": "0.0001 deg", "high": "1 deg"}
    study = tradestudy.load(STUDIES / "robot.yaml").with_values({"stereo-75mm.depth.disparity_error": "0.1 px"})
    question = {"says": "how well?", "at": "3 m", "uncertainty": goal, "errors": "calibration"}
    definition = study.with_values({"solve": {"own": {**yaw, **question, "camera": "stereo-75mm"}}}).plan().study
    found = solve(definition, definition.file.solve["own"])
    assert found.solutions
    rig = definition.case.cameras["stereo-75mm"]
    noise = 9.0 * 0.1 * rig.sensor.pixel_pitch / (rig.baseline * rig.principal_distance)  # type: ignore[attr-defined] # a rig
    assert noise == pytest.approx(0.015, rel=0.5)
    assert (f"{1e3 * noise:.3g} mm" in found.answer) is says
    of_all = question | {"errors": "both"}
    whole = study.with_values({"solve": {"own": {**yaw, **of_all, "camera": "stereo-75mm"}}}).plan().study
    answer = solve(whole, whole.file.solve["own"]).answer
    assert (
        answer.startswith("no value")
        and f"noise of one measurement, {1e3 * noise:.3g} mm, exceeds the goal of {goal}"
        in answer.replace("\N{NO-BREAK SPACE}", " ")
    ) is says


def test_noise_without_a_bound_on_depth_is_reported() -> None:
    """At 3 m the disparity is 75 mm · 2.65 mm/(3 m · 3 um) = 22 px, which noise of 30 px often exceeds."""
    question = {"says": "how well?", "at": "3 m", "uncertainty": "30 mm", "camera": "stereo-75mm"}
    yaw = {"vary": "stereo-75mm.calibration.errors.yaw.standard_deviation", "low": "0.0001 deg", "high": "1 deg"}
    values = {"stereo-75mm.depth.disparity_error": "30 px", "solve": {"own": {**yaw, **question}}}
    definition = tradestudy.load(STUDIES / "robot.yaml").with_values(values).plan().study
    found = solve(definition, definition.file.solve["own"])
    assert found.solutions == ()
    assert found.answer.endswith("the matching noise of one measurement alone leaves its depth without a bound")


def test_both_of_two_solutions_are_reported() -> None:
    """The rig is surest in focus: nearer and farther focus distances blur a target at 0.6 m alike."""
    question = {"vary": "stereo-75mm.focus_distance", "low": "100 mm", "high": "5 m", "camera": "stereo-75mm"}
    goal = 1.02
    base = tradestudy.load(STUDIES / "robot.yaml")
    wide = {"stereo-75mm.lenses.f_number": "1.2", "stereo-75mm.calibration.errors.yaw.standard_deviation": "1e-5 deg"}
    least = uncertainty(base, {**wide, "stereo-75mm.focus_distance": "0.6 m"}, "stereo-75mm", 0.6)
    study = base.with_values(
        {**wide, "solve": {"own": {"says": "?", "at": "0.6 m", "uncertainty": f"{goal * least} m", **question}}}
    )
    definition = study.plan().study.under("own")
    found = solve(definition, definition.file.solve["own"])
    assert len(found.solutions) == 2
    for one in found.solutions:
        there = uncertainty(study, {"stereo-75mm.focus_distance": f"{one.value} m"}, "stereo-75mm", 0.6)
        assert there == pytest.approx(goal * least, rel=1e-3)
    assert found.solutions[0].value < 0.6 < found.solutions[1].value
    assert found.answer.startswith("2 solutions: ")


def test_nothing_is_claimed_throughout_where_a_value_is_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    known = iter([*[[np.nan]] * 3, *[[1.0]] * 6])
    monkeypatch.setattr(inverse_questions, "_log_ratios", lambda *_: np.array(next(known)))
    _, found = asked(**BASELINE, camera="stereo-75mm", relative="1 %")
    assert re.match(r"cannot be .*: at 3", found.answer)


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ({"camera": "stereo-75mm"}, "belong together"),
        ({"camera": "stereo-75mm", "relative": "1 %", "uncertainty": "1 mm"}, "belong together"),
        ({"uncertainty": "1 mm"}, "give one of equal"),
    ],
)
def test_a_question_without_one_goal_is_refused(goal: dict[str, str], message: str) -> None:
    with pytest.raises(StudyError, match=message):
        asked(**BASELINE, **goal)
