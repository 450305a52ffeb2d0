"""Over which values of an input a requirement is met, against closed forms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tradestudy
from tradestudy.analysis.depth import depth_uncertainty
from tradestudy.analysis.inverse_questions import Solved
from tradestudy.analysis.required_values import solve_requirement
from tradestudy.errors import StudyError

STUDIES = Path(__file__).parents[2] / "studies"
WIDTH = 1280 * 3e-6  # of the sensor [m]
BASELINE = {"says": "Which baseline?", "vary": "stereo-75mm.baseline", "low": "20 mm", "high": "400 mm"}


def asked(requirement: dict[str, Any], question: dict[str, Any] | None = None) -> Solved:
    """The answer to an inverse question about one requirement on the 75 mm head of the robot."""
    needed = {"says": "needed", "camera": "stereo-75mm", **requirement}
    study = tradestudy.load(STUDIES / "robot.yaml").with_values(
        {
            "requirements": {"needed": needed},
            "solve": {"which": {**(question or BASELINE), "requirement": "needed"}},
            "usable_range": None,
        }
    )
    definition = study.plan().definition
    return solve_requirement(definition, definition.file.solve["which"])


def test_the_baseline_for_an_overlap_is_that_of_the_closed_form() -> None:
    """Parallel views of width W behind a lens of focal length f share 1 − B f/(Z W): at 0.4 m, 60 % up to 0.4 Z W/f."""
    found = asked({"overlap": {"above": "60 %", "over": ["0.4 m", "3 m"]}})
    (one,) = found.solutions
    assert one.value == pytest.approx(0.4 * 0.4 * WIDTH / 2.65e-3, rel=2e-4)
    assert one.error < 2e-4 * one.value
    assert found.answer.startswith("met up to ")
    assert found.answer.endswith("(sought from 20 mm); declared: 75 mm")


def test_a_requirement_can_be_met_between_two_values() -> None:
    """A longer baseline measures better at 3 m; from Z W/f on the views share nothing at 0.4 m."""
    needed = {"depth_uncertainty": {"below_relative": "1 %", "over": ["0.4 m", "3 m"]}}
    begins, ends = asked(needed, {**BASELINE, "high": "1 m"}).solutions
    definition = tradestudy.load(STUDIES / "robot.yaml").plan().definition
    case = definition.with_values({"stereo-75mm.baseline": f"{begins.value} m"}).case
    relative = depth_uncertainty(case.cameras["stereo-75mm"], np.array([3.0]))[0] / 3.0
    assert relative == pytest.approx(0.01, rel=0.005)
    assert ends.value == pytest.approx(0.4 * WIDTH / 2.65e-3, rel=2e-4)


def test_nowhere_says_how_near_and_anywhere_says_so() -> None:
    nowhere = asked({"depth_uncertainty": {"below_relative": "0.01 %", "over": ["0.4 m", "3 m"]}})
    assert nowhere.solutions == ()
    assert "met nowhere between 20 mm and 400 mm: nearest at 400 mm, missed by " in nowhere.answer
    assert "; it may be met beyond that end" in nowhere.answer
    anywhere = asked({"depth_uncertainty": {"below_relative": "50 %", "over": ["0.4 m", "3 m"]}})
    assert anywhere.answer == "met anywhere between 20 mm and 400 mm; declared: 75 mm"


def test_what_is_counted_is_asked_in_whole_numbers() -> None:
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
        ({**BASELINE, "requirement": "needed", "at": "1 m"}, "a requirement has distances of its own"),
        ({**BASELINE, "requirement": "needed", "camera": "stereo-75mm"}, "give one of equal"),
    ],
)
def test_impossible_questions_are_refused_at_their_place(question: dict[str, Any], message: str) -> None:
    wide = {"says": "w", "camera": "any", "usable": {"over": ["0.4 m", "3 m"]}}
    with pytest.raises(StudyError, match=message):
        tradestudy.load(STUDIES / "robot.yaml").with_values(
            {"requirements": {"needed": wide}, "solve": {"which": question}}
        )
