"""Requirements at a single distance: verdicts, reasons, usable ranges, sweeps and inverse questions."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tradestudy
from tradestudy.answers.requirement_answer import RequirementAnswer
from tradestudy.answers.requirements import Judge, _shift_to_decide, _unusable, check_requirement, is_kept
from tradestudy.depth.table import judged_uncertainty
from tradestudy.depth.usable import Interval
from tradestudy.errors import StudyError
from tradestudy.study.plausibility import implausible

STUDIES = Path(__file__).parents[2] / "studies"
FOCUS, WIDTH, BASELINE = 2.65e-3, 1280 * 3e-6, 75e-3  # of the 75 mm head, which is focused at 1 m [m]
IMAGE = FOCUS / (1.0 - FOCUS)


def robot(**values: Any) -> tradestudy.Study:
    own = {"says": "own", "camera": "stereo-75mm", **values}
    return tradestudy.load(STUDIES / "robot.yaml").with_values({"requirements": {"near-and-mid": None, "own": own}})


def judged(study: tradestudy.Study) -> RequirementAnswer:
    found, _ = Judge().answer(study.file.requirements["own"], study.prepared.case)
    return found


def test_the_value_is_that_at_the_distance_and_is_not_called_the_worst() -> None:
    study = robot(depth_uncertainty={"below": "20 mm", "at": "0.6 m"})
    found = judged(study)
    value = judged_uncertainty(study.prepared.case.cameras["stereo-75mm"], np.array([0.6]))[0]
    assert (found.value, found.place) == (pytest.approx(value, rel=1e-12), 0.6)
    assert found.met
    assert is_kept(study.file.requirements["own"], study.prepared.case)
    assert found.margin == pytest.approx(20e-3 / value - 1.0)
    assert found.reason.endswith(" at 0.6 m")
    assert "worst" not in found.reason
    missed = robot(depth_uncertainty={"below": f"{0.99 * value} m", "at": "0.6 m"})
    assert judged(missed).met is False
    assert not is_kept(missed.file.requirements["own"], missed.prepared.case)


def test_the_worst_place_of_a_picture_is_still_called_so() -> None:
    reason = judged(robot(depth_uncertainty={"below": "20 mm", "at": "0.6 m"}, field="80 %")).reason
    assert reason.startswith("worst ")
    assert " at 0.6 m, " in reason


@pytest.mark.parametrize(("at", "met"), [("1 m", True), ("3 m", False)])
def test_a_distance_is_usable_or_not(at: str, met: bool) -> None:
    """The R5 is usable up to 1.83 m."""
    found = judged(robot(camera="raytrix-r5", usable={"at": at}))
    assert (found.met, found.unusable) == (met, float(not met))
    strict = judged(robot(camera="raytrix-r5", depth_uncertainty={"below": "1 km", "at": at}))
    assert (strict.met, strict.limit) == (met, "" if met else "relative_uncertainty")
    if not met:
        assert found.reason == "not usable at 3 m: too uncertain"
        assert strict.reason.startswith("not usable at 3 m: too uncertain; ")
        assert strict.margin == -1.0


def test_the_overlap_at_a_distance_is_that_of_the_closed_form() -> None:
    """Parallel views share 1 − b B/(w Z), with the image of 1 m at b."""
    found = judged(robot(overlap={"above": "60 %", "at": "0.5 m"}))
    assert found.value == pytest.approx(1.0 - IMAGE * BASELINE / (WIDTH * 0.5), rel=1e-3)
    assert found.met


def intervals(*ends: tuple[float, float]) -> list[Interval]:
    return [Interval(near=near, far=far, near_limit="blur", far_limit="blur") for near, far in ends]


@pytest.mark.parametrize(
    ("usable", "unusable", "shift"),
    [
        ([(0.5, 2.0)], 0.0, 0.5),  # the far end is 50 % away, the near one 100 %
        ([(1.0, 2.0)], 0.0, 0.0),  # an end that touches the distance covers it
        ([(0.2, 0.8), (1.1, 2.0)], 1.0, 1.0 - 1.0 / 1.1),
        ([(0.2, 0.8), (4.0, 5.0)], 1.0, 1.0 / 0.8 - 1.0),
        ([(2.0, 3.0)], 1.0, 0.5),
        ([], 1.0, math.inf),
    ],
)
def test_usable_ranges_cover_a_distance_or_leave_it(
    usable: list[tuple[float, float]], unusable: float, shift: float
) -> None:
    found, gaps = _unusable(intervals(*usable), (1.0, 1.0))
    assert (found, gaps) == (unusable, [(1.0, 1.0)] * bool(unusable))
    assert _shift_to_decide(intervals(*usable), (1.0, 1.0)) == pytest.approx(shift)


@pytest.mark.parametrize(("at", "met"), [("150 mm", True), ("140 mm", False)])
def test_a_distance_is_sharp_by_the_closed_form_of_a_single_lens(at: str, met: bool) -> None:
    """f 12.5 mm, f/3.8, focused at 150 mm, blur 5.5 µm: limits a f²/(f² ± N c (a − f))."""
    f, n, a, c = 12.5e-3, 3.8, 0.15, 5.5e-6
    near, far = (a * f**2 / (f**2 + sign * n * c * (a - f)) for sign in (1, -1))
    name = "r5-no-microlenses"
    study = tradestudy.load(STUDIES / "hand_lens.yaml").with_values(
        {"requirements": {"own": {"says": "own", "camera": name, "depth_of_field": {"at": at}}}}
    )
    found = judged(study)
    assert found.met is met
    assert found.margin == pytest.approx(min(0.15 / near, far / 0.15) - 1 if met else -1.0, rel=1e-6)
    assert met or found.reason == "not sharp at 0.14 m"


def test_a_distance_beyond_the_study_is_judged_and_warned_about() -> None:
    study = robot(depth_uncertainty={"below": "1 km", "at": "5 m"})
    value = judged_uncertainty(study.prepared.case.cameras["stereo-75mm"], np.array([5.0]))[0]
    found = check_requirement(study.file.requirements["own"], study.prepared.case, "stereo-75mm")
    assert found.value == pytest.approx(value, rel=1e-12)
    reported = {one.path: one.what for one in implausible(study.prepared)}
    assert reported["requirements.own.depth_uncertainty.at"].startswith("lies beyond the distances of the scene")


@pytest.mark.parametrize("distances", [{}, {"at": "1 m", "over": ["1 m", "2 m"]}])
@pytest.mark.parametrize("bound", [{"depth_uncertainty": {"below": "1 mm"}}, {"usable": {}}])
def test_exactly_one_of_over_and_at_is_given(bound: dict[str, Any], distances: dict[str, Any]) -> None:
    ((quantity, limit),) = bound.items()
    with pytest.raises(StudyError, match="exactly one of over") as raised:
        robot(**{quantity: {**limit, **distances}})
    assert raised.value.problems[0].path == f"requirements.own.{quantity}"


def test_the_distance_varies_in_sweeps_and_inverse_questions() -> None:
    """Parallel views share 75 % from B f/(0.25 w) on, for an image in the focal plane."""
    path = "requirements.own.overlap.at"
    result = (
        robot(overlap={"above": "75 %", "at": "0.5 m"})
        .with_values(
            {
                "usable_range": None,
                **dict.fromkeys(("trade_off", "decision", "stereo-50mm", "raytrix-r5")),
                "sweep": {path: ["0.18 m", "0.2 m", "0.3 m"]},
                "solve": {
                    "nearest": {"says": "How near?", "vary": path, "low": "0.18 m", "high": "1 m", "requirement": "own"}
                },
            }
        )
        .run()
    )
    expected = BASELINE * FOCUS / (0.25 * WIDTH)
    own = result.data["requirements"].to_dataset().sel(requirement="own")
    np.testing.assert_array_equal(own["design_met"].values == 1, own[path.rpartition(".")[2]].values >= expected)
    assert own["met_from"].values[0] == pytest.approx(expected, rel=4e-3)
    assert float(own["over_near"]) == float(own["over_far"]) == 0.5
    line = next(line for line in result.lines() if line.startswith("How near?"))
    begins = re.search(r"met from (\d+) mm on", line)
    assert begins
    assert float(begins[1]) == pytest.approx(1e3 * expected, abs=1.0)
