"""Over which values of an input a requirement is met, against closed forms."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import tradestudy
from tradestudy.answers.required_values import _beside_the_nearest, _nearest, _Trial, _Tried, solve_requirement
from tradestudy.answers.requirement_answer import RequirementAnswer
from tradestudy.answers.solutions import Solved
from tradestudy.depth.evaluation import depth_uncertainty
from tradestudy.errors import OutOfRangeError, StudyError
from tradestudy.units import LENGTH

STUDIES = Path(__file__).parents[2] / "studies"
WIDTH = 1280 * 3e-6  # of the sensor [m]
BASELINE = {"says": "Which baseline?", "vary": "stereo-75mm.baseline", "low": "20 mm", "high": "400 mm"}


def asked(requirement: dict[str, Any], question: dict[str, Any] | None = None) -> Solved:
    """The answer to an inverse question about one requirement on the 75 mm head of the robot."""
    needed = {"says": "needed", "camera": "stereo-75mm", **requirement}
    others = () if needed["camera"] == "any" else ("trade_off", "decision", "stereo-50mm", "raytrix-r5")
    study = tradestudy.load(STUDIES / "robot.yaml").with_values(
        {
            "requirements": {"needed": needed},
            "solve": {"which": {**(question or BASELINE), "requirement": "needed"}},
            "usable_range": None,
            "scene.distances.points": 20,
            **dict.fromkeys(others),
        }
    )
    definition = study.prepared
    return solve_requirement(definition, definition.file.solve["which"])


def test_the_baseline_for_an_overlap_is_that_of_the_closed_form() -> None:
    """Parallel views of width W behind a lens of focal length f share 1 − B f/(Z W): at 0.4 m, 60 % up to 0.4 Z W/f."""
    found = asked({"overlap": {"above": "60 %", "over": ["0.4 m", "3 m"]}})
    (one,) = found.solutions
    assert one.value == pytest.approx(0.4 * 0.4 * WIDTH / 2.65e-3, rel=2e-4)
    assert one.error < 2e-4 * one.value
    assert found.answer.startswith("met up to ")
    assert re.search(r"from 20 mm.*declared: 75 mm$", found.answer)


def test_a_requirement_can_be_met_between_two_values() -> None:
    """A longer baseline measures better at 3 m; from Z W/f on the views share nothing at 0.4 m."""
    needed = {"depth_uncertainty": {"below_relative": "1 %", "over": ["0.4 m", "3 m"]}}
    begins, ends = asked(needed, {**BASELINE, "high": "1 m"}).solutions
    study = tradestudy.load(STUDIES / "robot.yaml").prepared
    case = study.with_values({"stereo-75mm.baseline": f"{begins.value} m"}).case
    relative = depth_uncertainty(case.cameras["stereo-75mm"], np.array([3.0]))[0] / 3.0
    assert relative == pytest.approx(0.01, rel=0.005)
    assert ends.value == pytest.approx(0.4 * WIDTH / 2.65e-3, rel=2e-4)


def test_a_requirement_met_nowhere_names_the_nearest_value_and_one_met_everywhere_says_so() -> None:
    nowhere = asked({"depth_uncertainty": {"below_relative": "0.01 %", "over": ["0.4 m", "3 m"]}})
    assert nowhere.solutions == ()
    # 0.134 %: mostly the calibration error, which no baseline cures.
    assert re.match(r"met nowhere between 20 mm and 400 mm: .* at 400 mm \(.* %.*\); declared: 75 mm", nowhere.answer)
    short = asked({"depth_uncertainty": {"below_relative": "0.12 %", "over": ["2.5 m", "3 m"]}})
    assert re.match(r"met nowhere .* at 400 mm \(.*\); beyond that end, it is met at 800 mm; decl", short.answer)
    anywhere = asked({"depth_uncertainty": {"below_relative": "50 %", "over": ["0.4 m", "3 m"]}})
    assert anywhere.solutions == ()
    assert re.match(r"met every.* 20 mm .* 400 mm; declared: 75 mm$", anywhere.answer)


def test_a_requirement_that_another_camera_meets_is_not_ascribed_to_the_one_that_varies() -> None:
    """With a yaw error of 2°, only the other head measures 3 m to 4 %: it has 0.01°."""
    yaw = {"says": "Which yaw?", "vary": "stereo-75mm.calibration.errors.yaw.standard_deviation"}
    needed = {"depth_uncertainty": {"below_relative": "4 %", "over": ["0.5 m", "3 m"]}}
    found = asked({**needed, "camera": "any"}, {**yaw, "low": "0.001 deg", "high": "2 deg"})
    alone = asked(needed, {**yaw, "low": "0.001 deg", "high": "2 deg"})
    assert len(alone.solutions) == 1
    assert found.solutions == alone.solutions
    own = re.escape(alone.answer.partition("; declared")[0])
    assert re.match(
        rf"75 mm stereo head: {own}; 50 mm stereo head: met everywhere .*; Raytrix R5: met nowhere ", found.answer
    )


def test_several_requirements_are_met_between_their_own_limits() -> None:
    """1 % at 3 m wants a long baseline, 60 % overlap at 0.4 m one of at most 0.4 · 0.4 m W/f."""
    far = {
        "says": "far",
        "camera": "stereo-75mm",
        "depth_uncertainty": {"below_relative": "1 %", "over": ["2 m", "3 m"]},
    }
    near = {"says": "near", "camera": "stereo-75mm", "overlap": {"above": "60 %", "over": ["0.4 m", "3 m"]}}
    study = tradestudy.load(STUDIES / "robot.yaml").with_values(
        {
            "requirements": {"near-and-mid": None, "far": far, "near": near},
            "solve": {"which": {**BASELINE, "requirement": ["far", "near"]}},
            "usable_range": None,
        }
    )
    definition = study.prepared
    begins, ends = solve_requirement(definition, definition.file.solve["which"]).solutions
    assert ends.value == pytest.approx(0.4 * 0.4 * WIDTH / 2.65e-3, rel=2e-4)
    case = definition.with_values({"stereo-75mm.baseline": f"{begins.value} m"}).case
    assert depth_uncertainty(case.cameras["stereo-75mm"], np.array([3.0]))[0] / 3.0 == pytest.approx(0.01, rel=0.005)
    with pytest.raises(StudyError, match="no requirement is called 'nearer'"):
        study.with_values({"solve.which.requirement": ["far", "nearer"]})


def test_a_bound_that_varies_is_the_bound_that_counts() -> None:
    """With a worst value of u, the requirement is met from a bound of u on: in `solve` and in a sweep."""
    needed = {"depth_uncertainty": {"below": "20 mm", "over": ["0.5 m", "1 m"]}}
    bound = {
        "says": "Which bound?",
        "vary": "requirements.needed.depth_uncertainty.below",
        "low": "0.1 mm",
        "high": "1 m",
    }
    (one,) = asked(needed, bound).solutions
    study = tradestudy.load(STUDIES / "robot.yaml").with_values(
        {"requirements": {"needed": {"says": "needed", "camera": "stereo-75mm", **needed}}, "usable_range": None}
    )
    case = study.prepared.case
    worst = float(depth_uncertainty(case.cameras["stereo-75mm"], np.array([1.0]))[0])
    assert one.value == pytest.approx(worst, rel=1e-3)
    swept = study.with_values({"sweep": {bound["vary"]: ["0.1 mm", "1 m"]}, "trade_off": None}).run()
    assert swept.data["requirements"]["design_met"].sel(requirement="needed").values.tolist() == [0, 1, 1]


def test_counts_are_solved_for_in_whole_numbers() -> None:
    """Fewer bits mean more noise: the least depth at which a requirement holds is a whole number of bits."""
    bits = {"says": "How many bits?", "vary": "scene.picture.bit_depth", "low": "4", "high": "12"}
    tight = {"depth_uncertainty": {"below_relative": "0.75 %", "over": ["0.4 m", "3 m"]}}
    found = asked(tight, bits)
    assert all(one.value == round(one.value) for one in found.solutions)
    assert found.answer.startswith("met ")


@pytest.mark.parametrize(
    ("question", "message"),
    [
        ({**BASELINE, "requirement": "neded"}, "no requirement is called 'neded'.*needed"),
        ({**BASELINE, "requirement": "needed", "at": "1 m"}, r"solve\.which: .*\bat\b.*requirement"),
        ({**BASELINE, "requirement": "needed", "camera": "stereo-75mm"}, "give one of equal"),
    ],
)
def test_impossible_questions_are_refused_at_their_place(question: dict[str, Any], message: str) -> None:
    wide = {"says": "w", "camera": "any", "usable": {"over": ["0.4 m", "3 m"]}}
    with pytest.raises(StudyError, match=message):
        tradestudy.load(STUDIES / "robot.yaml").with_values(
            {"requirements": {"needed": wide}, "solve": {"which": question}}
        )


def test_a_plain_number_is_shown_without_a_unit() -> None:
    f_number = {"says": "Which f-number?", "vary": "stereo-75mm.lenses.f_number", "low": "1", "high": "32"}
    found = asked({"depth_uncertainty": {"below": "3 mm", "over": ["0.4 m", "1 m"]}}, f_number)
    ends = found.solutions[-1].value
    assert 2.0 < ends < 32.0
    assert re.search(r"to \d\.\d\d;", found.answer)
    assert "%" not in found.answer


def test_written_ends_lie_within_the_range_that_meets_the_requirement() -> None:
    f_number = {"says": "Which f-number?", "vary": "stereo-75mm.lenses.f_number", "low": "1", "high": "32"}
    found = asked({"depth_uncertainty": {"below": "3 mm", "over": ["0.4 m", "1 m"]}}, f_number)
    first, last = (one.value for one in found.solutions)
    match = re.match(r"met from (\S+) to (\S+);", found.answer)
    assert match
    from_, to = map(float, match.groups())
    assert first <= from_ < first + 0.01
    assert last - 0.01 < to <= last


def test_the_declared_value_is_among_those_tried() -> None:
    """Blur f² |a − a₀|/(N a p a₀) of at most 0.065 px at 0.95 and 1.05 m: met from 0.995 to 1.002 m alone."""
    close = {"says": "close", "camera": "stereo-75mm", "usable": {"over": ["0.95 m", "1.05 m"]}}
    study = tradestudy.load(STUDIES / "robot.yaml").with_values(
        {
            "requirements": {"close": close},
            "usable_range": {"blur": "0.065 px"},
            "solve": {
                "focus": {
                    "says": "Which focus?", "vary": "stereo-75mm.focus_distance", "low": "0.3 m", "high": "3 m",
                    "requirement": "close",
                }
            },
        }
    )  # fmt: skip
    definition = study.prepared
    near, far = (one.value for one in solve_requirement(definition, definition.file.solve["focus"]).solutions)

    def blur(place: float, focus: float) -> float:
        return (2.65e-3) ** 2 / 2.0 * abs(place - focus) / (place * (focus - 2.65e-3)) / 3e-6

    assert blur(1.05, near) == pytest.approx(0.065, rel=2e-3)
    assert blur(0.95, far) == pytest.approx(0.065, rel=2e-3)


def test_a_missed_guard_band_is_not_reported_as_a_missed_bound() -> None:
    kept = RequirementAnswer(
        camera="a", met=False, value=0.5, bound=1.0, place=1.0, error=0.1, margin=1.0, unusable=0.0, reason="guarded"
    )
    reported = _nearest([_Trial(value=1.0, answer=kept), _Trial(value=2.0, answer=replace(kept, margin=0.5))], LENGTH)
    assert re.search(r"at 1 m, .*guard band", reported)
    assert "%" not in reported


def missed(margin: float) -> RequirementAnswer:
    return RequirementAnswer(
        camera="a", met=False, value=2.0, bound=1.0, place=1.0, error=0.0, margin=margin, unusable=0.0, reason="missed"
    )


def test_among_equally_close_values_the_declared_one_is_named() -> None:
    trials = [_Trial(value=value, answer=missed(margin)) for value, margin in ((1.0, -0.2), (2.0, -0.2), (3.0, -0.5))]
    assert "at 1 m" in _nearest(trials, LENGTH)
    assert "at 2 m" in _nearest(trials, LENGTH, {2.0})
    assert "at 1 m" in _nearest(trials, LENGTH, {3.0})


@pytest.mark.parametrize("margin", [-0.2, -math.inf])  # infinite: without a value at some place
def test_a_value_without_influence_is_said_to_have_none(margin: float) -> None:
    words = _nearest([_Trial(value=value, answer=missed(margin)) for value in (1.0, 2.0, 3.0)], LENGTH)
    assert "depend" in words
    assert " m " not in words


def first_beyond(limit: float, *, below: bool) -> Callable[[Iterable[float]], float | None]:
    return lambda values: next((one for one in values if (one <= limit if below else one >= limit)), None)


def test_a_value_beyond_the_nearer_end_at_which_it_is_met_is_named() -> None:
    rising = [_Trial(value=value, answer=missed(value - 4.0)) for value in (1.0, 2.0, 3.0)]
    assert _nearest(rising, LENGTH, (), first_beyond(5.0, below=False)).endswith("beyond that end, it is met at 6 m")
    assert "beyond" not in _nearest(rising, LENGTH, (), first_beyond(0.5, below=True))
    falling = [_Trial(value=value, answer=missed(-value)) for value in (1.0, 2.0, 3.0)]
    assert _nearest(falling, LENGTH, (), first_beyond(0.4, below=True)).endswith("beyond that end, it is met at 100 mm")
    inner = [_Trial(value=value, answer=missed(-abs(value - 2.0) - 1.0)) for value in (1.0, 2.0, 3.0)]
    assert "beyond" not in _nearest(inner, LENGTH, (), first_beyond(0.4, below=True))


def test_a_value_that_acts_only_beyond_the_range_is_not_called_without_influence() -> None:
    alike = [_Trial(value=value, answer=missed(-1.0)) for value in (1.0, 2.0, 3.0)]
    words = _nearest(alike, LENGTH, (), first_beyond(0.4, below=True))
    assert words == "equally far from it everywhere (missed); met at 100 mm"
    some = [
        _Trial(value=value, answer=missed(margin)) for value, margin in ((1.0, -math.inf), (2.0, -0.2), (3.0, -0.1))
    ]
    assert "closest at 3 m" in _nearest(some, LENGTH)


def test_values_beyond_the_range_that_the_study_refuses_are_passed_over() -> None:
    def judged(value: float) -> list[Any]:
        if value < 2.0:
            raise OutOfRangeError("baseline", value=f"{value} m", limit="2 m", remedy="take more")
        return [(replace(missed(1.0), met=True), {})]

    stub = SimpleNamespace(varying=SimpleNamespace(possible=round), _judged=judged)
    assert _Tried.met_beyond(stub, [1.4, 2.6]) == 3.0  # type: ignore[arg-type]
    assert _Tried.met_beyond(stub, [1.4]) is None  # type: ignore[arg-type]


def test_the_closest_value_is_found_between_the_places_that_are_tried_first() -> None:
    """The margin of this requirement is largest at 4.66 and falls to both sides."""
    known = {value: missed(-abs(np.log(value / 4.66)) - 0.09) for value in np.geomspace(2.0, 12.0, 17)}
    first = max(known, key=lambda value: known[value].margin)
    for _ in range(4):
        for value in _beside_the_nearest(known):
            known[value] = missed(-abs(np.log(value / 4.66)) - 0.09)
    best = max(known, key=lambda value: known[value].margin)
    assert abs(np.log(best / 4.66)) < 0.01 < abs(np.log(first / 4.66))


def test_an_impossible_value_is_refused_when_the_study_is_read(tmp_path: Path) -> None:
    text = (STUDIES / "robot.yaml").read_text().replace("cameras/", f"{STUDIES}/cameras/")
    question = "{says: types, vary: raytrix-r5.microlenses.types, low: 1, high: 3, requirement: near-and-mid}"
    file = tmp_path / "types.yaml"
    file.write_text(f"{text}\nsolve:\n  types: {question}\n")
    with pytest.raises(StudyError, match=r"types\.yaml:\d+:\d+: solve\.types\.vary: .*'2' is not possible"):
        tradestudy.load(file)
