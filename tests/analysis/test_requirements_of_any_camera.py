"""Requirements on criteria and on depth of field: of cameras that measure depth and of those that do not."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tradestudy
from tradestudy.answers.requirement_verdicts import requirements_group
from tradestudy.answers.requirements import Judge, is_kept
from tradestudy.errors import StudyError
from tradestudy.execution import Steps
from tradestudy.report.contents import compose_report
from tradestudy.report.document import PageBreak
from tradestudy.study.plausibility import implausible
from tradestudy.study.varying import sweep_axes, sweep_points
from tradestudy.wording import plain_span

STUDIES = Path(__file__).parents[2] / "studies"
MASSES = {"mahli": "578 g", "r5-no-microlenses": "0.5 kg", "stereo": "about a kilogram"}


def hand_lens(requirement: dict[str, Any], **values: Any) -> tradestudy.Study:
    study = tradestudy.load(STUDIES / "hand_lens.yaml")
    declared = {f"{name}.attributes.others": {"mass": mass} for name, mass in MASSES.items()}
    return study.with_values({**declared, **values, "requirements.own": {"says": "own", **requirement}})


def answer(study: tradestudy.Study) -> tuple[Any, dict[str, Any]]:
    judged, every = Judge().answer(study.file.requirements["own"], study.prepared.case)
    return judged, dict(every)


@pytest.mark.parametrize(
    ("camera", "bound", "met", "deciding", "margin"),
    [
        ("any", {"below": "600 g"}, True, "r5-no-microlenses", 600 / 500 - 1),
        ("any", {"above": "0.6 kg"}, None, "mahli-stack", float("nan")),  # which does not say its mass
        ("mahli", {"below": "578 g"}, False, "mahli", 0.0),
        ("mahli", {"above": "578 g"}, True, "mahli", 0.0),
    ],
)
def test_a_declared_mass_is_compared_with_its_bound(
    camera: str, bound: dict[str, str], met: bool | None, deciding: str, margin: float
) -> None:
    study = hand_lens({"camera": camera, "criterion": {"name": "mass", **bound}})
    judged, _ = answer(study)
    assert (judged.met, judged.camera) == (met, deciding)
    assert judged.margin == pytest.approx(margin, abs=1e-12, nan_ok=True)
    assert is_kept(study.file.requirements["own"], study.prepared.case) is met


def test_all_is_undecided_if_one_camera_has_no_numerical_mass() -> None:
    judged, every = answer(hand_lens({"camera": "all", "criterion": {"name": "mass", "below": "1 kg"}}))
    assert judged.met is None
    assert every["stereo"].reason == "mass: about a kilogram"
    assert every["mahli"].met is True
    assert every["r5-one-type"].met is None
    assert every["r5-one-type"].reason.startswith("mass: not ")
    assert len(every) == 10


@pytest.mark.parametrize(("bound", "met"), [("1 kg", None), ("550 g", False)])  # MAHLI has 578 g
def test_draws_leave_all_undecided_unless_one_camera_misses(bound: str, met: bool | None) -> None:
    study = hand_lens({"camera": "all", "criterion": {"name": "mass", "below": bound}})
    assert answer(study)[0].met is met
    assert is_kept(study.file.requirements["own"], study.prepared.case) is met


@pytest.mark.parametrize(("camera", "met"), [("raytrix-r5", None), ("all", None), ("any", True)])
def test_draws_leave_the_overlap_of_a_single_camera_undecided(camera: str, met: bool | None) -> None:
    half = {"says": "half", "camera": camera, "overlap": {"above": "50 %", "over": ["1 m", "2 m"]}}
    study = tradestudy.load(STUDIES / "robot.yaml").with_values({"requirements.own": half, "usable_range": None})
    assert answer(study)[0].met is met
    assert is_kept(study.file.requirements["own"], study.prepared.case) is met


def test_derived_criteria_count_mechanisms_and_exposures() -> None:
    """MAHLI refocuses by one mechanism; three images of its stack, at 5 s each, keep 140 to 160 mm sharp."""
    study = hand_lens({"camera": "all", "criterion": {"name": "moving parts", "below": 1}})
    judged, every = answer(study)
    assert (judged.met, judged.value) == (False, 1.0)
    assert every["r5-no-microlenses"].met is True
    assert every["r5-no-microlenses"].margin == math.inf
    _, every = answer(hand_lens({"camera": "any", "criterion": {"name": "time per scene", "below": "1 min"}}))
    assert every["mahli-stack"].value == pytest.approx(3 * 5.0)
    assert every["mahli-stack"].margin == pytest.approx(60 / 15 - 1)
    assert every["mahli"].met is None


def test_the_depth_of_field_of_a_single_lens_is_that_of_the_closed_form() -> None:
    """f 12.5 mm, f/3.8, focused at 150 mm, blur 5.5 µm: limits a f²/(f² ± N c (a − f))."""
    f, n, a, c = 12.5e-3, 3.8, 0.15, 5.5e-6
    near, far = (a * f**2 / (f**2 + sign * n * c * (a - f)) for sign in (1, -1))
    name = "r5-no-microlenses"
    deep = hand_lens({"camera": name, "depth_of_field": {"above": "5 mm"}})
    judged, _ = answer(deep)
    assert judged.value == pytest.approx(far - near, rel=1e-9)
    assert judged.margin == pytest.approx((far - near) / 5e-3 - 1, rel=1e-9)
    inside = hand_lens({"camera": name, "depth_of_field": {"over": ["149 mm", "150.5 mm"]}})
    judged, _ = answer(inside)
    assert judged.met
    assert judged.margin == pytest.approx(min(0.149 / near, far / 0.1505) - 1, rel=1e-6)
    outside = hand_lens({"camera": name, "depth_of_field": {"over": ["140 mm", "160 mm"]}})
    judged, _ = answer(outside)
    assert not judged.met
    assert judged.value == pytest.approx(math.log(far / near) / math.log(160 / 140), rel=1e-9)
    assert judged.margin == pytest.approx(judged.value - 1.0)
    assert judged.place == pytest.approx(0.14)
    assert f"0.14 to {math.ceil(1e3 * near) / 1e3:g} m" in judged.reason
    before, _ = answer(hand_lens({"camera": name, "depth_of_field": {"over": ["140 mm", "142 mm"]}}))
    assert plain_span(0.14, 0.142) in before.reason  # nothing in it is sharp


def test_the_sharp_range_in_the_results_meets_the_requirement() -> None:
    """Stacks and microlenses of several types count with all their slices, as /depth_of_field has them."""
    study = hand_lens({"camera": "any", "depth_of_field": {"over": ["140 mm", "160 mm"]}})
    _, every = answer(study)
    found = study.run().data["depth_of_field"].to_dataset().sel(sharp="one-pixel")
    sharp = {
        str(name): float(share) for name, share in zip(found["camera"].values, found["scene_share"].values, strict=True)
    }
    assert {name for name, one in every.items() if one.met} == {
        name for name, share in sharp.items() if share > 1 - 1e-9
    }
    assert any(one.met for one in every.values())
    assert not all(one.met for one in every.values())


def test_a_criterion_that_nothing_meets_gives_the_reason() -> None:
    asked = {"camera": "mahli", "depth_of_field": {"above": "1 mm", "criterion": "one-pixel-airy"}}
    judged, _ = answer(hand_lens(asked))
    assert (judged.met, judged.margin) == (False, -1.0)
    assert judged.reason.startswith("nothing is sharp: ")


@pytest.mark.parametrize(
    ("requirement", "path", "message"),
    [
        ({"criterion": {"name": "mas", "below": "1 kg"}}, "criterion.name", "no .* criterion 'mas'; nearest: 'mass'"),
        ({"criterion": {"name": "mass", "below": "1 m"}}, "criterion.below", "'1 m' is a length"),
        ({"criterion": {"name": "mass"}}, "criterion", "give exactly one of below and above"),
        ({"criterion": {"name": "size", "below": "1 m"}}, "criterion.name", "'size'.* number"),
        ({"depth_of_field": {"above": "1 m", "criterion": "pixel"}}, "depth_of_field.criterion", "nearest: .one-pixel"),
        ({"depth_of_field": {}}, "depth_of_field", "give exactly one of over"),
        ({"depth_of_field": {"above": "1 mm"}, "guard_band": {"risk": "5 %"}}, "guard_band", "no standard error"),
        ({"camera": "mahly", "depth_of_field": {"above": "1 mm"}}, "camera", "nearest: 'mahli'"),
    ],
)  # fmt: skip
def test_missing_things_are_refused_at_their_place(requirement: dict[str, Any], path: str, message: str) -> None:
    with pytest.raises(StudyError, match=message) as raised:
        hand_lens({"camera": "any", **requirement})
    assert raised.value.problems[0].path == f"requirements.own.{path}"


def test_a_range_beyond_the_scene_is_warned_about_as_for_other_quantities() -> None:
    study = hand_lens({"camera": "any", "depth_of_field": {"over": ["140 mm", "300 mm"]}})
    reported = {one.path: one.what for one in implausible(study.prepared)}
    assert reported["requirements.own.depth_of_field.over"].startswith("reaches beyond the distances of the scene")


def test_a_sweep_finds_the_f_number_from_which_a_range_is_sharp() -> None:
    """The far limit a f²/(f² − N c (a − f)) of the single lens reaches 152 mm at N = f² (1 − a/b)/(c (a − f))."""
    lens = "r5-no-microlenses"
    study = hand_lens(
        {"camera": lens, "depth_of_field": {"over": ["149 mm", "152 mm"]}},
        sweep={f"{lens}.lens.f_number": [2, 4, 8, 16]},
    )
    f, a, c = 12.5e-3, 0.15, 5.5e-6
    expected = f**2 * (1 - a / 0.152) / (c * (a - f))
    definition = study.prepared
    found = requirements_group(definition, sweep_points(definition, sweep_axes(definition)), Judge(), Steps())
    own = found.sel(requirement="own")
    assert own["met_from"].values[0] == pytest.approx(expected, rel=2e-3)
    assert list(own["camera"].values) == list(definition.case.all_cameras)
    np.testing.assert_array_equal(own["design_met"].values, [axis >= expected for axis in own["f_number"].values])


PLAIN = """
format: 2
study: plain
title: Two fixed lenses
question: Which one is light and sharp?
cameras:
  near:
    kind: conventional
    title: Near
    lens: {focal_length: 12.5 mm, f_number: 8}
    sensor: {pixels: [2048, 2048], pixel_pitch: 5.5 um}
    focus: {distance: 150 mm}
    attributes: {others: {mass: 400 g}}
  far: {like: near, title: Far, focus: {distance: 300 mm}, attributes: {others: {mass: 90 g}}}
scene: {distances: {from: 100 mm, to: 1 m, points: 20}, wavelength: 550 nm}
depth_of_field: {range: [149 mm, 151 mm], criteria: {one-pixel: {blur: 1 px}}}
requirements:
  sharp: {says: the rock is sharp, camera: any, depth_of_field: {over: [149 mm, 151 mm]}}
  light: {says: not heavy, camera: all, priority: should, criterion: {name: mass, below: 200 g}}
"""


@pytest.mark.parametrize(
    ("name", "remedy"), [("aperture", "give it another name"), ("size", r"declare it as attributes\.envelope")]
)
def test_attributes_with_the_name_of_a_derived_criterion_are_refused(tmp_path: Path, name: str, remedy: str) -> None:
    (tmp_path / "plain.yaml").write_text(PLAIN.replace("mass: 400 g", f"mass: 400 g, {name}: 40 mm"))
    with pytest.raises(StudyError, match=rf"cameras\.near\.attributes\.others\.{name}: has the name .*; {remedy}"):
        tradestudy.load(tmp_path / "plain.yaml")


def test_a_study_without_depth_answers_its_requirements_in_every_place(tmp_path: Path) -> None:
    (tmp_path / "plain.yaml").write_text(PLAIN)
    study = tradestudy.load(tmp_path / "plain.yaml")
    result = study.run()
    answer, sharp, light = result.lines()
    assert answer.startswith("To keep 0.149 to 0.151 m sharp, take Near (")
    assert sharp.startswith("Met: the rock is sharp, by Near (sharp from ")
    assert light == (
        "Not met: not heavy (should), not by Near (mass 400 g; missed by a factor of 2); "
        "but by Far (a factor of 2.2 to spare)"
    )
    assert result.unmet_requirements == []
    blocks = compose_report(result.data, {}, {}).blocks
    first_page = str(list(itertools.takewhile(lambda block: not isinstance(block, PageBreak), blocks)))
    assert "the rock is sharp" in first_page
    assert "not heavy" in first_page
    reported = {one["name"]: one for one in result.conclusions()["requirements"]}
    assert (reported["light"]["met"], reported["light"]["place"]) == (False, None)
    with pytest.raises(StudyError, match="no camera of this study measures depth"):
        study.with_values({"requirements.own": {"says": "near", "camera": "any", "usable": {"over": ["1 m", "2 m"]}}})
