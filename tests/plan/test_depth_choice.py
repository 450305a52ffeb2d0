"""Which models the depth of a camera calls for: the question decides, and what is left out changes what it says."""

from __future__ import annotations

import itertools
import re
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tradestudy
from tests.campaigns.depth_cases import base_study
from tests.campaigns.depth_regret import run, shift_of_ends
from tradestudy.accuracy import Quantity
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_measurement import FieldPosition
from tradestudy.depth.evaluation import depth_uncertainty, evaluate_depth
from tradestudy.depth.linear import scaled_noise
from tradestudy.effects import Models
from tradestudy.errors import StudyError
from tradestudy.models import depth_variant
from tradestudy.models.choice import choose_models
from tradestudy.models.depth_problem import depth_problems
from tradestudy.models.depth_variant import DepthVariant
from tradestudy.models.problem import Change, Changes, SimulationProblem, Slot, choose
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.loading import load_prepared
from tradestudy.study.prepared import Choices, PreparedStudy, apply_models

STUDIES = Path(__file__).parents[2] / "studies"
STEREO = """\
format: 2
study: one-rig
title: One rig
question: What does diffraction change?
cameras:
  rig:
    from: {studies}/cameras/stereo-100mm.yaml
    lenses: {{focal_length: 8 mm}}
    focus_distance: autofocus
    stated: null
    calibration:
      errors: {{yaw: {{standard_deviation: {yaw} deg}}, pitch: null, roll: null, baseline: null, focal_length: null}}
scene: {{distances: {{from: 0.5 m, to: 2 m, points: 3, spacing: log}}, wavelength: 550 nm}}
"""
DIFFRACTION = 0.269  # of the noise, that leaving it out would change


def rig(folder: Path, yaw: float) -> DepthVariant:
    file = folder / "rig.yaml"
    file.write_text(STEREO.format(studies=STUDIES.as_posix(), yaw=yaw), encoding="utf-8")
    (problem,) = depth_problems(load_prepared(file, ()), {})
    return problem._variants[0]


class Diffraction(SimulationProblem):
    """One effect that moves the noise of a rig by a known share."""

    name, title = "rig", "One rig"
    slots = (Slot(name="main_lens_diffraction", models=("off", "kirchhoff")),)

    def __init__(self, variant: DepthVariant, asked: tuple[Quantity, ...]) -> None:
        self.variant, self.asked = variant, asked

    def changes(self, models: Models) -> Changes:
        noise = DIFFRACTION if models["main_lens_diffraction"] == "off" else 0.0
        moved = self.variant.moved({}, noise)
        return {
            "depth_uncertainty": Change(relative=float(moved.uncertainty[1])),
            "depth_noise": Change(relative=float(self.variant.moved_noise({}, noise)[1])),
        }


# Of the whole uncertainty at 1 m: √(1 + s (1.269² − 1)) − 1, s the share of noise in its variance: 1 µm of disparity
# beside 8 mm times the yaw.
@pytest.mark.parametrize(("yaw", "change"), [(0.2, 0.00039), (0.02, 0.0341), (0.002, 0.251)])
def test_effects_on_noise_matter_little_where_noise_is_small(tmp_path: Path, yaw: float, change: float) -> None:
    variant = rig(tmp_path, yaw)
    moved = variant.moved({}, DIFFRACTION)
    assert variant.places[1] == pytest.approx(1.0)
    share = 1.0 / (1.0 + (8e-3 * np.radians(yaw) / 1e-6) ** 2)
    assert moved.uncertainty[1] == pytest.approx(
        np.sqrt(1.0 + share * ((1.0 + DIFFRACTION) ** 2 - 1.0)) - 1.0, rel=0.01
    )
    assert moved.uncertainty[1] == pytest.approx(change, rel=0.02)
    assert variant.moved_noise({}, DIFFRACTION)[1] == pytest.approx(DIFFRACTION, rel=1e-3)


def test_models_that_give_the_same_noise_are_computed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    variant, noises = rig(tmp_path, 0.02), []

    def counted(camera: DepthCamera, distance: FloatArray, place: FieldPosition, scale: FloatArray, more: float) -> Any:
        noises.append(scale)
        return scaled_noise(camera, distance, place, scale, more)

    monkeypatch.setattr(depth_variant, "scaled_noise", counted)
    for calibration in ("off", "linear", "exact"):  # the error of this rig is declared: only these change anything
        for diffraction in ("off", "fresnel", "kirchhoff"):
            models = {"calibration": calibration, "main_lens_diffraction": diffraction}
            variant.moved(models)
            variant.moved_noise(models)
    assert len(noises) == 2  # with and without calibration errors


def test_the_question_decides_whether_diffraction_is_simulated(tmp_path: Path) -> None:
    """At 2 %, diffraction is left out beside a yaw of 0.2°, not beside 0.02°; and never where noise is asked for."""
    tolerances: dict[Quantity, float] = {"depth_uncertainty": 0.02, "depth_noise": 0.02}

    def chosen(yaw: float, *asked: Quantity) -> str:
        problem = Diffraction(rig(tmp_path, yaw), asked)
        return choose(problem, tolerances, {}).models["main_lens_diffraction"]

    assert chosen(0.2, "depth_uncertainty") == "off"
    assert chosen(0.02, "depth_uncertainty") == "kirchhoff"
    assert chosen(0.2, "depth_uncertainty", "depth_noise") == "kirchhoff"


def test_a_declared_tolerance_of_noise_is_asked_and_any_other_is_shown_and_drives_nothing() -> None:
    robot = tradestudy.load(STUDIES / "robot.yaml").plan()
    assert all("depth_noise" not in one.asked for one in robot.problems)
    stereo = next(one for one in robot.problems if one.name == "stereo-75mm")
    assert stereo.changes["depth_noise"].relative > 0.02 > stereo.changes["depth_uncertainty"].relative
    asked = tradestudy.load(STUDIES / "robot.yaml", ["accuracy.depth_noise=2 %"]).plan()
    stereo = next(one for one in asked.problems if one.name == "stereo-75mm")
    assert stereo.models["main_lens_diffraction"] not in ("off", "airy")
    assert stereo.changes["depth_noise"].relative <= 0.02


def test_the_robot_needs_no_diffraction_or_airy_for_its_stereo_heads() -> None:
    """And what is left out, forced in turn, moves the depth uncertainty by less than is said."""
    plan = tradestudy.load(STUDIES / "robot.yaml").plan()
    for name in ("stereo-50mm", "stereo-75mm"):
        problem = next(one for one in plan.problems if one.name == name)
        assert problem.models["main_lens_diffraction"] in ("off", "airy")
        distance = np.array([0.3, 0.6, 1.2, 4.0])
        exact = replace(
            plan.study, choices=Choices(models={name: {**problem.models, "main_lens_diffraction": "kirchhoff"}})
        )
        own, other = (depth_uncertainty(one.case.cameras[name], distance) for one in (plan.study, exact))
        change = float(np.max(np.abs(own / other - 1.0)))
        assert change < problem.changes["depth_uncertainty"].relative < 0.02


def test_a_narrow_focus_between_two_distances_of_the_study_is_caught(tmp_path: Path) -> None:
    """A pair at f/1.4 is in focus for a few millimetres between distances that are 60 mm apart."""
    values = {
        "cameras.one.lenses.focal_length": "25 mm",
        "cameras.one.lenses.f_number": 1.4,
        "scene.picture.light.at_f_number": 1.4,
        "cameras.one.focus_distance": "530 mm",
        "scene.distances": {"from": "500 mm", "to": "560 mm", "points": 2, "spacing": "linear"},
        "scene.picture.spectrum": None,
    }
    (problem,) = depth_problems(base_study("stereo", tmp_path).with_values(values), {})
    (variant,) = problem._variants
    np.testing.assert_allclose(variant.places, [0.50, 0.53, 0.56], rtol=1e-3)
    near, focus, far = np.abs(variant.moved_noise({"pixel_integration": "off"}))
    assert focus > 0.5 > 0.05 > max(near, far)


@pytest.mark.parametrize("model", ["off", "airy", "kirchhoff"])
def test_a_forced_model_is_applied_and_its_change_reported(model: str) -> None:
    plan = tradestudy.load(STUDIES / "robot.yaml", [f"effects.main_lens_diffraction={model}"]).plan()
    for problem in plan.problems:
        assert problem.models["main_lens_diffraction"] == model
        law = plan.study.case.cameras[problem.name].disparity_error_px
        assert law.models.main_lens_diffraction == model
        assert (problem.by_forcing == {}) == (model == "kirchhoff")
        reported = plan.text()
    assert (f"main lens diffraction: {model}, as the study requires, changes the" in reported) == (model != "kirchhoff")


def test_without_diffraction_at_microlenses_their_crosstalk_still_counts() -> None:
    """Without crosstalk, the depth uncertainty of the R5 changes by 3.1 %, though no diffraction spreads the light."""
    changes = ("effects.microlens_diffraction=off", "accuracy.tolerance=0.3 %")
    study = load_prepared(STUDIES / "robot.yaml", changes)
    found = next(one for one in choose_models(study) if one.name == "raytrix-r5")
    distance = study.case.distance[:60]

    def uncertainty(models: Models) -> np.ndarray:
        return depth_uncertainty(
            replace(study, choices=Choices(models={found.name: models})).case.cameras[found.name],
            distance,
        )

    complete: Models = {**found.problem.complete, "calibration": "linear"}
    without: Models = {**complete, "crosstalk": "off"}
    change = np.max(np.abs(uncertainty(without) / uncertainty(complete) - 1.0))
    assert change == pytest.approx(0.0312, rel=0.02)
    told = found.problem.changes({**found.problem.complete, "crosstalk": "off"})["depth_uncertainty"]
    assert told.relative >= change
    assert found.models["crosstalk"] == "share"
    assert found.models["calibration"] == "linear"
    assert np.max(np.abs(uncertainty(found.models) / uncertainty(complete) - 1.0)) <= 0.003


def test_exact_paths_are_tried_on_both_sides_of_the_focus() -> None:
    """Before the focus, where the rule fears most, exact paths change a fast lens's depth less than behind it."""
    head = "stereo-75mm"
    changes = {
        f"cameras.{head}.lenses.f_number": 1.813,
        f"cameras.{head}.baseline": "88 mm",
        f"cameras.{head}.calibration.errors.yaw.standard_deviation": "0.003 deg",
        "scene.distances.points": 60,
        "scene.picture.light.electrons": "7090 electrons",
        "scene.picture.full_well": "2e5 electrons",
        "accuracy.tolerance": "0.18 %",
    }
    study = load_prepared(STUDIES / "robot.yaml").with_values(changes)
    found = next(one for one in choose_models(study) if one.name == head)

    def uncertainty(diffraction: str) -> np.ndarray:
        models: Models = {**found.models, "main_lens_diffraction": diffraction}
        return depth_uncertainty(
            replace(study, choices=Choices(models={head: models})).case.cameras[head],
            study.case.distance,
        )

    change = np.abs(uncertainty("fresnel") / uncertainty("kirchhoff") - 1.0)
    assert change[study.case.distance < 1.0].max() < 0.0019 < 0.0022 < change.max()
    told = found.problem.changes({**found.problem.complete, "main_lens_diffraction": "fresnel"})
    assert told["depth_uncertainty"].relative >= change.max()
    assert found.models["main_lens_diffraction"] == "kirchhoff"


@pytest.mark.slow
def test_a_steep_limit_between_coarse_distances_sets_an_end() -> None:
    """Blur ends matching so steeply that 1 % away from its end the disparity error is far from its limit.

    Diffraction without defocus shifts the ends by 1.5 times the tolerance.
    """
    (found,) = run(range(381, 382), 802)
    assert found.change <= found.tolerance


def test_a_model_that_acts_nowhere_is_a_mistake_with_a_position() -> None:
    study = tradestudy.load(STUDIES / "plenoptic_vs_stereo.yaml", ["effects.main_lens_diffraction=fresnel"])
    with pytest.raises(StudyError, match=r"^effects\.main_lens_diffraction: 'fresnel' .*0\.1 px") as raised:
        study.plan()
    (problem,) = raised.value.problems
    assert re.match(r"--set:1:\d+: effects\.main_lens_diffraction: ", str(problem))


def test_no_clock_moves_the_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine that is busy, or slow, chooses the same."""
    study = load_prepared(STUDIES / "robot.yaml", ())
    before = {one.name: dict(one.models) for one in choose_models(study)}
    ticks = itertools.accumulate(itertools.count(1))
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(ticks)))
    monkeypatch.setattr(time, "monotonic", lambda: float(next(ticks)))
    assert {one.name: dict(one.models) for one in choose_models(study)} == before


# Distances end [mm] ever closer to where the far end of depth is lost: points in place of pixels double the disparity
# error everywhere, and multiply the depth uncertainty there by 1 and at least so much.
@pytest.mark.parametrize(("end", "least"), [(350.0, 1.5), (436.0, 4.0), (470.0, 10.0)])
def test_intervals_far_from_normal_are_computed_anew(tmp_path: Path, end: float, least: float) -> None:
    values = {
        "scene.distances.from": "156.6 mm",
        "scene.distances.to": f"{end} mm",
        "scene.wavelength": "464.7 nm",
        "cameras.one.calibration.stability.temperature.standard_deviation": "12.3 K",
        "scene.picture.texture.contrast": "9 %",
        "scene.picture.texture.correlation_length": "1.5 mm",
        "scene.picture.matching_window": "23 px",
        "scene.picture.light.electrons": "2488 electrons",
        "scene.picture.light.at_f_number": 9.4,
        "scene.picture.read_noise": "13 electrons",
        "scene.picture.bit_depth": 14,
        "cameras.one.main_lens.focal_length": "6 mm",
        "cameras.one.main_lens.f_number": 9.4,
        "cameras.one.focus.distance": "176.5 mm",
    }
    definition = base_study("unfocused", tmp_path).with_values(values)
    (problem,) = depth_problems(definition, {})
    (variant,) = problem._variants
    points = {
        **problem.complete,
        "main_lens_diffraction": "fresnel",
        "calibration": "linear",
        "pixel_integration": "off",
    }
    pixels = {**points, "pixel_integration": "square"}
    alone, whole = (
        depth_uncertainty(
            replace(definition, choices=Choices(models={"one": models})).case.cameras["one"], variant.places
        )
        for models in (points, pixels)
    )
    moved = variant.moved({"pixel_integration": "off", "calibration": "linear"}).uncertainty
    np.testing.assert_allclose(moved, alone / whole - 1.0, rtol=1e-6, atol=1e-9)
    assert moved.max() > least


def test_axes_of_other_cameras_do_not_crowd_out_designs_of_a_camera() -> None:
    """Each camera's choice depends on its own part of the sweep; a shared axis counts for every camera."""
    head = "stereo-50mm.lenses.f_number"
    swept = {head: {"from": 1, "to": 64, "points": 20, "spacing": "log"}}
    others = {
        "cameras.stereo-75mm.baseline": {"from": "20 mm", "to": "300 mm", "points": 20},
        "stereo-75mm.lenses.focal_length": {"from": "1 mm", "to": "4 mm", "points": 20},
    }

    def f_numbers(sweep: dict[str, Any]) -> set[float]:
        study = load_prepared(STUDIES / "robot.yaml").with_values({"sweep": sweep})
        problem = depth_problems(study, {})[0]
        assert problem.name in head
        return {variant.camera.lens.f_number for variant in problem._variants}

    alone = f_numbers(swept)
    assert len(alone) == 21  # with the declared one
    assert f_numbers({**swept, **others}) == alone


def test_a_sweep_that_goes_through_focus_counts_there_too(tmp_path: Path) -> None:
    """Blurred before and behind, at neither end of the sweep diffraction or pixels change anything to speak of."""
    swept = "cameras.one.focus_distance"
    values = {
        "scene.distances.from": "295 mm",
        "scene.distances.to": "305 mm",
        "scene.picture.texture.contrast": "40 %",
        "scene.picture.texture.correlation_length": "0.2 mm",
        "scene.picture.matching_window": "41 px",
        "scene.picture.light.electrons": "20000 electrons",
        "scene.picture.read_noise": "5 electrons",
        "scene.picture.full_well": "1e7 electrons",
        "cameras.one.lenses.focal_length": "18 mm",
        "cameras.one.lenses.f_number": 8,
        "cameras.one.baseline": "20 mm",
        "cameras.one.principal_distance": "focused",
        "cameras.one.calibration.errors.yaw.standard_deviation": "1e-5 deg",
        swept: "100 mm",
    }
    one = base_study("stereo", tmp_path).with_values(values)
    (swept_problem,) = depth_problems(one.with_values({"sweep": {swept: ["100 mm", "0.3 m", "5 m"]}}), {})
    problems = {end: depth_problems(one.with_values({swept: end}), {})[0] for end in ("100 mm", "0.3 m", "5 m")}

    def change(problem: SimulationProblem) -> float:
        return problem.unasked({**problem.complete, "pixel_integration": "off"})["depth_noise"].relative

    assert change(swept_problem) == pytest.approx(change(problems["0.3 m"]))
    assert change(swept_problem) > 3.0 * max(change(problems["100 mm"]), change(problems["5 m"]))


# What a line does not see: errors whose first-order effect vanishes on the axis or everywhere, products of two errors,
# and errors without a variance.
@pytest.mark.parametrize(
    ("errors", "fields"),
    [
        ({"roll": "3 deg"}, []),
        ({"pitch": "2 deg", "roll": "2 deg"}, []),
        ({"pitch": "0.2 deg", "roll": "0.2 deg"}, ["60 %"]),
        ({"right_principal_point_y": "0.1 mm", "roll": "1 deg"}, []),
        ({"yaw": {"shape": "student-t", "degrees_of_freedom": 2, "scale": "0.2 deg", "standard_deviation": None}}, []),
    ],
)
def test_errors_that_a_linear_model_misses_are_not_left_out(
    tmp_path: Path, errors: dict[str, Any], fields: list[str]
) -> None:
    file = tmp_path / "rig.yaml"
    file.write_text(STEREO.format(studies=STUDIES.as_posix(), yaw=0.1), encoding="utf-8")
    own = {name: one if isinstance(one, dict) else {"standard_deviation": one} for name, one in errors.items()}
    values = {f"cameras.rig.calibration.errors.{name}": one for name, one in ({"yaw": None} | own).items()}
    if fields:
        values["propagation.field_places"] = fields
    (problem,) = choose_models(load_prepared(file, ()).with_values(values))
    assert problem.models["calibration"] != "off"
    assert fields or problem.models["calibration"] == "exact"


def test_a_nonlinear_reading_or_question_uses_draws_of_its_own() -> None:
    """The one takes the yaw for a uniform one, the other tries yaws of up to 5°."""
    plan = tradestudy.load(STUDIES / "plenoptic_vs_stereo.yaml").plan()
    assert plan.models("stereo-65-across")["calibration"] == "linear"
    study = plan.study

    def model(one: PreparedStudy) -> str:
        return one.case.cameras["stereo-65-across"].propagation.model

    drawn = {name for name, one in study.readings.items() if model(one) == "exact"}
    assert drawn == {"yaw-uniform"}
    assert model(study.under("yaw-at-half-metre")) == "exact"
    assert {model(study), model(study.readings["yaw-tenth"])} == {"linear"}
    assert re.search(r"\(exact for \W*yaw-uniform\W.*\Wyaw-at-half-metre\W*\)", plan.text())


def test_forced_models_apply_under_every_reading() -> None:
    override = ["effects.calibration=linear"]
    study = tradestudy.load(STUDIES / "plenoptic_vs_stereo.yaml", override).plan().study
    cases = [study, *study.readings.values(), study.under("yaw-at-half-metre")]
    assert {one.case.cameras["stereo-65-across"].propagation.model for one in cases} == {"linear"}


def test_a_tolerance_beyond_the_linear_model_requires_draws() -> None:
    plan = tradestudy.load(STUDIES / "plenoptic_vs_stereo.yaml", tolerance="0.0002 %").plan()
    assert {one.models["calibration"] for one in plan.problems} == {"exact"}
    assert {one.changes["depth_uncertainty"].relative for one in plan.problems} == {0.0}


@pytest.mark.parametrize(
    ("before", "after", "shift"),
    [
        ((0.5, 2.0), (0.5, 2.0), 0.0),
        ((0.5, 2.0), (0.51, 2.0), 0.02),
        ((0.4, 0.5, 0.99, 1.01), (0.4, 0.5), 0.01),  # a narrow range vanishes at 1
        ((0.4, 0.5), (0.4, 0.5, 0.99, 1.01), 0.01),
        ((0.4, 0.99, 1.01, 2.0), (0.4, 2.0), 0.01),  # a narrow gap closes at 1
        ((0.4, 0.99, 1.01, 2.0), (0.4, 2.1), 0.05),
        ((0.4, 1.0), (0.4, 0.5, 0.52, 1.0), 0.02 / 1.02),
        ((0.1, 0.102), (), 0.02),  # only one of its ends can move
        ((0.5, 1.5), (), 0.5),
        ((0.1, 9.0), (), np.inf),
        ((), (), 0.0),
    ],
)
def test_a_range_vanishes_where_its_ends_meet(
    before: tuple[float, ...], after: tuple[float, ...], shift: float
) -> None:
    assert shift_of_ends(before, after, (0.1, 9.0)) == pytest.approx(shift, abs=1e-12)


@pytest.mark.slow
def test_choices_for_random_cameras_keep_their_tolerance() -> None:
    """A sample of the campaign, which measures how well choices keep their tolerance and what they cost."""
    found = list(run(range(3), seed=21))
    assert {one.name.split()[0] for one in found} == {"stereo", "focused", "unfocused"}
    assert all(one.change <= one.tolerance for one in found)


def test_models_are_judged_in_the_light_that_is_left_off_the_axis() -> None:
    """Against depth evaluated there by either set of models, its noise and its calibration."""
    picture = (
        "propagation.field_places=[60 %]",
        "scene.distances.points=9",
        "scene.picture.light.electrons=100 electrons",
    )
    study = load_prepared(STUDIES / "close_range.yaml", picture)
    problem = next(one for one in depth_problems(study, {}) if one.name == "pair-f9.8")
    (variant,) = problem._variants
    bare = {"main_lens_diffraction": "off"}
    without = apply_models(variant.reference, bare)
    found = variant.moved_of_field(bare)
    whole, less = (
        evaluate_depth(camera, variant.places, 0.6).uncertainty[2] for camera in (variant.reference, without)
    )
    assert 0.01 < found <= float(np.nanmax(np.abs(less / whole - 1.0))) * (1.0 + 1e-3)
    some = variant.places[np.unique(np.linspace(0, variant.places.size - 1, 5).astype(int))]
    whole, less = (evaluate_depth(camera, some, 0.6).uncertainty[2] for camera in (variant.reference, without))
    assert found == pytest.approx(float(np.nanmax(np.abs(less / whole - 1.0))), rel=0.02)


def test_a_swept_design_that_needs_draws_is_tried_although_the_declared_one_barely_misses_a_tolerance(
    tmp_path: Path,
) -> None:
    """Linear propagation changes the declared design by 3.6 % and the last one by 18 %; 10 % is allowed."""
    file = tmp_path / "rig.yaml"
    file.write_text(
        "format: 2\nstudy: one\ntitle: One\nquestion: How well?\n"
        "cameras:\n"
        "  a:\n    kind: stereo\n    baseline: 50 mm\n    lenses: {focal_length: 3 mm, f_number: 2}\n"
        "    focus_distance: 1 m\n    sensor: {pixels: [1280, 800], pixel_pitch: 3 um}\n"
        "    depth: {disparity_error: 0.2 px}\n"
        "    calibration: {errors: {yaw: {half_width: 0.02 deg}}}\n"
        "scene: {distances: {from: 0.3 m, to: 3 m, points: 9}, wavelength: 550 nm}\n"
        "accuracy: {tolerance: 1 %, depth_uncertainty: 10 %}\n"
        "usable_range: {relative_uncertainty: 90 %, overlap: 1 %}\n"
        "sweep: {a.calibration.errors.yaw.half_width: [0.02 deg, 0.1 deg]}\n",
        encoding="utf-8",
    )
    planned = tradestudy.load(file).plan().study
    assert planned.choices.models["a"]["calibration"] == "exact"
