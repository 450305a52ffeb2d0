"""What a plan says and refuses, on the shipped studies; what is chosen is held against computations elsewhere."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tradestudy
from tradestudy.api import Study
from tradestudy.depth.evaluation import depth_uncertainty
from tradestudy.errors import OutOfRangeError, StudyError, UnaffordableError
from tradestudy.models.plan import Plan, _space, size_of_depth
from tradestudy.models.point_spreads import refuse_spreads
from tradestudy.models.slow_steps import work_of
from tradestudy.optics.lens_point_spread import point_spread
from tradestudy.optics.propagation.lens import PointSource
from tradestudy.study.prepared import Choices

STUDIES = Path(__file__).parents[2] / "studies"
ONE_MICROLENS = {"light_spot.microlenses.lenses_across": 1, "light_spot.detector.pixels": 23}
UNIFORM_YAW = """
format: 2
study: uniform
title: A rig whose yaw is anywhere within limits
question: How well does it measure?
cameras:
  rig:
    kind: stereo
    lenses: {focal_length: 8 mm}
    sensor: {pixels: [1024, 1024], pixel_pitch: 10 um}
    baseline: 100 mm
    depth: {disparity_error: 0.1 px}
    calibration: {errors: {yaw: {half_width: 0.2 deg}}}
scene: {distances: {from: 1 m, to: 6 m, points: 6}, wavelength: 550 nm}
"""


@pytest.fixture(scope="module")
def close_range() -> Study:
    return tradestudy.load(STUDIES / "close_range.yaml")


@pytest.fixture(scope="module")
def close_plan(close_range: Study) -> Plan:
    return close_range.plan()


def test_a_plan_is_one_line_for_each_problem_and_one_for_the_run(close_plan: Plan) -> None:
    lines = str(close_plan).splitlines()
    assert [line.split()[0] for line in lines] == [*(one.name for one in close_plan.problems), "run"]
    assert "seconds, mostly report" in lines[-1]
    wide = next(line for line in lines if line.startswith("pair-f5.6"))
    assert "leaving out the exact path (Kirchhoff) at the main lens changes the" in wide
    assert "5 % allowed" in wide.replace("\N{NO-BREAK SPACE}", " ")


def test_a_small_omission_is_stated_with_its_number(close_plan: Plan) -> None:
    declared = next(one for one in close_plan.problems if one.name == "pair-declared")
    change = declared.changes["depth_uncertainty"].relative
    assert 0.0 < change < 1e-5
    line = str(close_plan).split("pair-declared")[1].splitlines()[0].replace("\N{NO-BREAK SPACE}", " ")
    assert "geometry only (the disparity error is fixed at 0.1 px)" in line
    assert (
        f"leaving out nonlinear and non-normal errors changes the depth uncertainty by about {1e6 * change:.2g} ppm"
        in line
    )


def test_a_plan_that_leaves_nothing_out_says_which_omission_it_refused(tmp_path: Path) -> None:
    """Linear propagation takes every error as normal, and so is wrong about one that is uniform."""
    study = tmp_path / "uniform.yaml"
    study.write_text(UNIFORM_YAW, encoding="utf-8")
    line = str(tradestudy.load(study).plan()).splitlines()[0].replace("\N{NO-BREAK SPACE}", " ")
    said = re.search(
        r"exact calibration; nothing left out, because leaving out nonlinear and non-normal errors would change the "
        r"depth uncertainty by about (\S+) % \(trial at a few distances; 1 % allowed\)",
        line,
    )
    assert said is not None, line
    exact, linear = (
        tradestudy.load(study, [f"effects={{calibration: {model}}}"]).run().data["depth"]["depth_uncertainty"]
        for model in ("exact", "linear")
    )
    change = float(abs(linear / exact - 1.0).max())
    assert 0.01 < change <= float(said[1]) / 100.0 < 2.0 * change  # a trial overestimates rather than underestimates


def test_an_omission_that_changes_nothing_is_named() -> None:
    """No light suffices at any distance: then every model gives the same, and the simplest is no omission denied."""
    study = tradestudy.load(STUDIES / "robot.yaml", ["scene.picture.light.electrons=1e-6 electrons"])
    line = str(study.plan()).splitlines()[0]
    assert line.startswith("stereo-50mm")
    assert "no diffraction" in line
    assert "nothing left out" not in line
    assert "leaving out diffraction at the main lens and calibration errors changes nothing" in line


def test_a_change_is_told_apart_from_the_tolerance_that_it_exceeds() -> None:
    """1.006 % beside 1 % allowed is not 1 %."""
    plan = tradestudy.load(STUDIES / "rock_scene.yaml").plan()
    line = next(line for line in str(plan).splitlines() if line.startswith("stereo-pictures"))
    said = re.search(
        r"nothing left out, .* would change the pixel intensity .* by about (\S+) % \(.*; 1 % allowed\)",
        line.replace("\N{NO-BREAK SPACE}", " "),
    )
    assert said is not None, line
    assert 1.0 < float(said[1]) < 1.1


@pytest.mark.parametrize(
    ("study", "line"),
    [
        ("fresnel_validity", "fresnel-validity  Fresnel and Kirchhoff diffraction, because the study compares them"),
        ("hard_cases", "hard-cases  textbook formulas and the program's, each against a reference"),
    ],
)
def test_a_study_that_compares_models_says_why_none_is_chosen(study: str, line: str) -> None:
    plan = tradestudy.load(STUDIES / f"{study}.yaml").plan()
    assert not plan.problems
    assert str(plan).splitlines()[0].startswith(line)


def test_the_plan_of_a_spot_counts_the_waves_that_its_methods_compare() -> None:
    small = [
        "light_spot.microlenses.lenses_across=1",
        "light_spot.detector.pixels=23",
        "light_spot.spot.diameter=50 um",
    ]
    plan = tradestudy.load(
        STUDIES / "light_spot.yaml", [*small, "claims={}", "readings={}", "point_spread=null"]
    ).plan()
    assert str(plan).splitlines()[0].endswith("; at once")
    assert "image of the spot  at once  light-spot, 3 pictures of 1 microlens" in plan.text(verbose=True)


@pytest.mark.parametrize("compared", [{"methods": ["fresnel"], "tolerance": "20 %"}, {"methods": None}])
def test_the_plan_counts_the_chosen_picture_of_a_spot_with_all_its_wavelengths(compared: dict[str, object]) -> None:
    """The chosen picture took 18 s of processor time on a slow machine."""
    spot = {
        "tolerance": None,
        "published_times": None,
        "microlenses.lenses_across": 1,
        "detector.pixels": 23,
        "wavelength": None,
        "spectrum": {"wavelengths": [f"{k} nm" for k in range(450, 651, 50)], "weights": [1] * 5},
        **compared,
    }
    values: dict[str, Any] = {f"light_spot.{key}": value for key, value in spot.items()}
    values |= dict.fromkeys(["claims", "readings", "point_spread"])
    values |= {"effects": {"spectrum": "weighted"}, "accuracy": {"tolerance": "2 %"}}
    plan = tradestudy.load(STUDIES / "light_spot.yaml").with_values(values).plan()
    assert str(plan).splitlines()[0].endswith("; seconds")


def test_the_verbose_plan_lists_every_decision_and_every_step(close_plan: Plan) -> None:
    text = close_plan.text(verbose=True)
    for problem in close_plan.problems:
        for decision in problem.decisions:
            assert f"{decision.slot.replace('_', ' ')}: {decision.model}" in text
        for reason in problem.problem.reasons.values():
            assert reason in text
    for part in close_plan.work:
        assert part.step in text
        assert part.amount in text


def test_a_declared_disparity_error_leaves_the_picture_out_and_says_why(close_plan: Plan) -> None:
    declared = next(one for one in close_plan.problems if one.name == "pair-declared")
    assert set(declared.models.values()) - {declared.models["calibration"]} == {"off"}
    assert declared.problem.reasons["main_lens_diffraction"].startswith("the disparity error is fixed at 0.1 px")


def test_a_hand_lens_that_asks_for_noise_simulates_diffraction(close_plan: Plan) -> None:
    """At f/22 diffraction takes the finest texture, which the yaw would hide if noise were not asked for."""
    assert close_plan.models("pair-f22")["main_lens_diffraction"] != "off"
    assert "depth_noise" in next(one for one in close_plan.problems if one.name == "pair-f22").asked


def test_omissions_change_depth_by_no_more_than_stated(close_range: Study, close_plan: Plan) -> None:
    """Between the distances of the study as well."""
    places = np.array([53e-3, 54.9e-3, 58e-3])
    for name in ("pair-f9.8", "pair-f5.6", "pair-f22"):
        problem = next(one for one in close_plan.problems if one.name == name)
        whole = problem.models | {"main_lens_diffraction": "kirchhoff", "calibration": "linear"}
        own, complete = (
            replace(close_range.prepared, choices=Choices(models={name: models})).case.cameras[name]
            for models in (problem.models, whole)
        )
        for error_source, quantity in (("both", "depth_uncertainty"), ("noise", "depth_noise")):
            moved = np.abs(
                depth_uncertainty(own, places, error_source) / depth_uncertainty(complete, places, error_source) - 1.0
            )
            assert moved.max() <= problem.changes[quantity].relative <= 0.05


def test_a_looser_tolerance_leaves_more_out(close_range: Study) -> None:
    order = ("off", "airy", "fresnel", "kirchhoff")
    taken = []
    for tolerance in ("0.1 %", "2 %", "50 %"):
        plan = tradestudy.load(STUDIES / "close_range.yaml", tolerance=tolerance).plan()
        taken.append(order.index(plan.models("pair-f22")["main_lens_diffraction"]))
    assert taken == sorted(taken, reverse=True)
    assert taken[0] > taken[-1]


def test_a_time_limit_that_is_too_short_is_refused_with_value_limit_and_remedy() -> None:
    study = tradestudy.load(STUDIES / "close_range.yaml", ["accuracy.time_limit=0.01 s"])
    with pytest.raises(
        UnaffordableError, match=r"time limit.*seconds.*10 ms.*raise accuracy\.time_limit, loosen the tolerance"
    ):
        study.plan()


@pytest.mark.parametrize(
    ("study", "override"),
    [
        ("close_range", "effects.crosstalk=coherent"),
        ("close_range", "effects.main_lens_diffraction=boundary_wave"),
        ("light_spot", "accuracy.tolerance=0.01 %"),
        ("plenoptic_vs_stereo", "effects.spectrum=weighted"),
        ("hand_lens", "effects.sensor_noise=shot"),
        ("light_spot", "effects.calibration=linear"),
        ("light_spot", "accuracy.usable_range=2 %"),
        ("light_spot", "point_spread.window=100"),
        ("fresnel_validity", "fresnel_validity.windows=[5, 200]"),
        ("fresnel_validity", "fresnel_validity.elements.main-lens.published_error.f_number=0.2"),
    ],
)
def test_check_refuses_in_the_same_words_what_plan_refuses(study: str, override: str) -> None:
    smaller = ONE_MICROLENS if study == "light_spot" else {}
    loaded = tradestudy.load(STUDIES / f"{study}.yaml", [override]).with_values(smaller)
    with pytest.raises((StudyError, UnaffordableError)) as by_plan:
        loaded.plan()
    with pytest.raises(type(by_plan.value)) as by_check:
        loaded.check()
    assert str(by_check.value) == str(by_plan.value)


def test_check_judges_the_picture_of_a_spot_that_compares_no_methods() -> None:
    spot = {"methods": None, "tolerance": None, "published_times": None, "microlenses.lens_phase": "perfect"}
    values: dict[str, Any] = ONE_MICROLENS | {f"light_spot.{key}": value for key, value in spot.items()}
    study = tradestudy.load(STUDIES / "light_spot.yaml").with_values({**values, "claims": None, "readings": None})
    with pytest.raises(OutOfRangeError, match="perfect microlenses") as by_plan:
        study.plan()
    with pytest.raises(OutOfRangeError) as by_check:
        study.check()
    assert str(by_check.value) == str(by_plan.value)


def test_a_point_spread_is_refused_for_the_numbers_that_its_computation_needs() -> None:
    part = tradestudy.load(STUDIES / "light_spot.yaml").file.point_spread
    assert part is not None
    refuse_spreads(part)
    with pytest.raises(UnaffordableError, match=r"at f/2\.8 in 550 nm light .*window than 95") as before:
        refuse_spreads(part.model_copy(update={"window": 95.0}))
    with pytest.raises(UnaffordableError) as computed:
        point_spread(
            focal_length=12.5e-3,
            f_number=2.8,
            wavelength=550e-9,
            source=PointSource(distance=0.15),
            focus_distance=0.15,
            lens_phase="parabolic",
            method="fresnel",
            window=95.0,
            tolerance=part.tolerance,
        )
    assert before.value.value == computed.value.value


def test_a_tolerance_on_what_the_study_does_not_compute_is_refused_with_its_key() -> None:
    overrides = ["accuracy.psf_width=2 %", "accuracy.depth_noise=3 %", "accuracy.depth_uncertainty=4 %"]
    with pytest.raises(StudyError) as refused:
        tradestudy.load(STUDIES / "close_range.yaml", overrides).plan()
    assert [problem.path for problem in refused.value.problems] == ["accuracy.psf_width"]
    assert "remove" in refused.value.problems[0].what


@pytest.mark.parametrize("override", ["effects.main_lens_diffraction=kirchhoff", "accuracy.tolerance=1 %"])
def test_check_passes_what_plan_passes(override: str) -> None:
    loaded = tradestudy.load(STUDIES / "close_range.yaml", [override])
    assert loaded.check() == loaded.check_summary()
    assert loaded.plan().problems


@pytest.mark.parametrize(
    ("swept", "values", "designs"),
    [
        ("pair-f22.baseline", "[50 mm, 60 mm]", {"pair-f22": 3}),  # with the declared one
        ("cameras.pair-f22.baseline", "[50 mm, 60 mm]", {"pair-f22": 3}),
        (
            "usable_range.overlap",
            "[40 %, 60 %]",
            {"pair-f9.8": 3, "pair-f22": 3, "pair-f5.6": 3, "pair-declared": 3},
        ),
    ],
)
def test_a_plan_counts_the_designs_of_every_camera_that_a_sweep_changes(
    swept: str, values: str, designs: dict[str, int]
) -> None:
    """Usable ranges, and with them the tables of depth, are computed anew for every limit."""
    prepared = tradestudy.load(STUDIES / "close_range.yaml", [f"sweep={{{swept}: {values}}}"]).prepared
    counted = {work.problem: int(work.amount.split()[0]) for work in work_of(prepared) if work.step == "depth"}
    assert counted == dict.fromkeys(prepared.case.cameras, 1) | designs


def test_a_plan_counts_as_many_designs_as_a_run_computes() -> None:
    """Neither a bound of a requirement nor a title changes depth."""
    swept = "stereo.baseline: [50 mm], requirements.far.depth_uncertainty.below_relative: [8 %], raytrix-r5.title: [a]"
    overrides = ["scene.distances.points=12", "raytrix-r5.calibration=null", "stereo.calibration=null"]
    study = tradestudy.load(STUDIES / "stereo_design.yaml", [f"sweep={{{swept}}}", *overrides])
    counted = {work.problem: int(work.amount.split()[0]) for work in study.plan().work if work.step == "depth"}
    assert counted == {"raytrix-r5": 1, "stereo": 2 * 10}  # two baselines, and ten focal lengths of the study itself
    assert study.run().run_record["points"]["depth"]["computed"] == sum(counted.values())


def test_a_plan_names_the_memory_of_a_large_sweep() -> None:
    sweep = "sweep={stereo.baseline: {from: 10 mm, to: 200 mm, points: POINTS, spacing: log}}"
    certain = ["raytrix-r5.calibration=null", "stereo.calibration=null", "requirements=null", "decision=null"]
    few = tradestudy.load(STUDIES / "stereo_design.yaml", [sweep.replace("POINTS", "3"), *certain])
    depth = few.run().data["depth"].to_dataset()
    assert size_of_depth(few.prepared) / 8.0 == pytest.approx(depth.nbytes, rel=0.25)
    assert "memory" not in str(few.plan())
    many = tradestudy.load(
        STUDIES / "stereo_design.yaml", [sweep.replace("POINTS", "999"), "scene.distances.points=1200"]
    )
    assert size_of_depth(many.prepared) == pytest.approx(10.0 * 250.0 * size_of_depth(few.prepared), rel=0.01)
    named = re.search(r"; about (\S+) GB of memory, (\S+) GB on disk", _space(many.prepared))
    assert named is not None
    assert float(named[1]) > float(named[2]) > 1.0
