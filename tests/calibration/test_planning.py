"""Planned calibrations: the certainty expected from views of a board, against refits, published figures and runs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

import tradestudy
from tests.calibration.cameras import board, focused, normal, shown, stereo
from tradestudy.answers.calibration import infer_calibrations
from tradestudy.answers.questions import questions_group, solve
from tradestudy.answers.required_values import solve_requirement
from tradestudy.answers.solutions import planned
from tradestudy.calibration import sampling
from tradestudy.calibration.camera_target import (
    TargetProblem,
    TargetToInfer,
    expected_fit,
    fit_target,
    planned_calibration,
)
from tradestudy.calibration.projection import move, project
from tradestudy.calibration.synthetic_target import Priors, SyntheticTarget, flat_grid, observe_target
from tradestudy.cameras.calibration import ONE_SIGMA
from tradestudy.depth.evaluation import distribution
from tradestudy.depth.linear import linearised_depth
from tradestudy.errors import StudyError
from tradestudy.execution import Steps
from tradestudy.optics.arrays import FloatArray
from tradestudy.report.document import Paragraph, plain_text
from tradestudy.report.sections.answer import describe_answer
from tradestudy.results.views.conclusions import rests_on
from tradestudy.study.prepared import PreparedStudy
from tradestudy.uncertainty.joint import JointNormal
from tradestudy.units import FRACTION, pretty

REFITS = 200
DESIGN = np.array([460.0, 460.0, 319.5, 179.5])  # fx, fy, cx, cy [px]
RIG = """
format: 2
study: planned
title: Planned
question: How many views of a board does the rig need?
cameras:
  rig:
    kind: stereo
    title: Rig
    lenses: {field_of_view: 65.24 deg, across: width, f_number: 8}
    sensor: {pixels: [1024, 1024], pixel_pitch: 10 um}
    baseline: 100 mm
    depth: {disparity_error: 0.1 px, discrimination_step: 0.1 px}
    calibration:
      errors:
        yaw: {standard_deviation: 0.2 deg}
        left_focal_length: {standard_deviation: 20 um}
        right_focal_length: {standard_deviation: 20 um}
        right_principal_point_x: {standard_deviation: 20 um}
      target: {columns: 4, rows: 4, spacing: 100 mm, corner_noise: 0.1 px, max_steps: 500, VIEWS}
scene: {distances: [0.5 m, 1 m, 2 m], wavelength: 550 nm}
"""
SPREAD = "views: 8, distances: [0.8 m, 2.5 m], half_field_angle: 6 deg, tilt: 17 deg"
QUESTION = {"says": "How many views make the calibration part of the uncertainty 0.6 mm at 1 m?", "at": "1 m"}
VIEWS = {**QUESTION, "vary": "rig.calibration.target.views", "low": "3", "high": "200", "errors": "calibration"}


def pinhole(parameters: FloatArray, points: FloatArray) -> FloatArray:
    return project(np.concatenate([parameters, np.zeros((*parameters.shape[:-1], 2))], axis=-1), points)


def circling(views: int) -> SyntheticTarget:
    """9 × 6 corners of 25 mm, tilted by 0.5 rad in turn all around and moved about 0.5 m before the camera."""
    turn = 2.0 * np.pi * np.arange(views) / views
    rotations = [0.5 * np.cos(turn), 0.5 * np.sin(turn), 0.0 * turn]
    centres = [0.08 * np.cos(2.0 * turn), 0.04 * np.sin(3.0 * turn), 0.5 + 0.0 * turn]
    poses = np.column_stack([*rotations, *centres])
    return SyntheticTarget(points=flat_grid(9, 6, 0.025), poses=poses, noise=np.full(2, 0.1))


FLAT = Priors(
    names=("fx", "fy", "cx", "cy"),
    mean=DESIGN,
    standard_deviation=np.full(4, np.inf),
    lower=DESIGN - 100.0,
    upper=DESIGN + 100.0,
)


@pytest.mark.parametrize(("views", "stated"), [(5, 0.969), (20, 0.487)])
def test_expected_deviations_are_those_of_refits_and_those_stated(views: int, stated: float) -> None:
    target = circling(views)
    seen = pinhole(DESIGN, move(target.poses, target.points))
    problem = TargetProblem(observed=seen, target=target, model=pinhole, priors=FLAT)
    expected = expected_fit(problem).standard_deviation
    assert expected[0] == pytest.approx(stated, abs=5e-4)
    rng = np.random.default_rng(0)
    fits = []
    for _ in range(REFITS):
        noisy = replace(problem, observed=observe_target(target, pinhole, DESIGN, rng))
        fits.append(fit_target(noisy).laplace.mean)
    # 200 refits give a standard deviation to 5 %
    np.testing.assert_allclose(np.std(fits, axis=0, ddof=1) / expected, 1.0, atol=0.1)


def covariance(part: Any, camera: Any = None, priors: Any = None, plan: int = 0) -> FloatArray:
    yaw = normal("yaw", np.radians(0.2))
    (group,) = planned_calibration(shown(camera or stereo(), priors or (yaw,), part), plan).groups
    assert isinstance(group, JointNormal)
    return group.covariance


@pytest.mark.parametrize("plan", range(3))
def test_views_that_are_added_never_make_a_plan_less_certain(plan: int) -> None:
    priors = tuple(normal(name, 20e-6) for name in ("mla_distance", "focal_length"))
    near = {"spacing": 0.02, "distances": (0.16, 0.6)}
    found = [covariance(board(views=views, **near), focused(), priors, plan) for views in (4, 5, 8, 13, 60)]
    for fewer, more in itertools.pairwise(found):
        assert np.linalg.eigvalsh(fewer - more).min() > -1e-9 * np.trace(fewer)


def test_planned_uncertainty_falls_with_the_root_of_the_number_of_views() -> None:
    few, many = (covariance(board(views=views))[0, 0] for views in (250, 1000))
    assert np.sqrt(few / many) == pytest.approx(2.0, rel=0.03)


def loaded(folder: Path, views: str = SPREAD, more: Mapping[str, Any] | None = None) -> tradestudy.Study:
    file = folder / "study.yaml"
    file.write_text(RIG.replace("VIEWS", views), encoding="utf-8")
    return tradestudy.load(file).with_values(more or {})


def inferred_width(study: PreparedStudy) -> float:
    """Half the interval of depth at 1 m of the rig under its sampled calibration [m]."""
    known, *_ = infer_calibrations(study.with_values({"rig.calibration.target.max_steps": 150}), Steps())
    return float(distribution(known.case.cameras["rig"], np.array([1.0]), "calibration").half_widths(ONE_SIGMA)[0, 0])


@pytest.mark.slow
def test_the_number_of_views_for_a_certainty_is_that_of_an_inferred_calibration(tmp_path: Path) -> None:
    """The number is planned; posteriors of one board shown to three rigs are sampled, and vary by 9 % between rigs."""
    study = loaded(tmp_path, more={"solve": {"views": {**VIEWS, "camera": "rig", "uncertainty": "0.6 mm"}}})
    definition = study.plan().study
    solved = solve(definition, definition.file.solve["views"])
    (one,) = solved.solutions
    assert one.value == round(one.value)
    assert solved.answer.startswith(f"{one.value:.0f} ± {math.ceil(one.error)};")
    assert 0.0 < one.error < 0.1 * one.value
    enough = definition.with_values({"solve": None, "rig.calibration.target.views": int(one.value)})
    few = inferred_width(enough.with_values({"rig.calibration.target.views": 8}))
    found = [inferred_width(enough.with_values({"propagation.seed": seed})) for seed in range(3)]
    assert few > 1.5 * max(found)
    assert np.mean(found) == pytest.approx(0.6e-3, rel=0.12)


@pytest.mark.parametrize(("goal", "named"), [("0.6 mm", True), ("1.5 mm", False)])
def test_an_answer_rests_on_corner_noise_by_its_share_of_the_planned_variance(
    tmp_path: Path, goal: str, named: bool
) -> None:
    """A covariance C of priors P and views contains C P⁻¹ C from the priors; the rest is from the corner noise."""
    asked = {"solve": {"views": {**VIEWS, "camera": "rig", "uncertainty": goal}}}
    study = loaded(tmp_path, more=asked).plan().study
    data = questions_group(study, lambda _step, _share: None)
    views = int(data["solved_value"].item())
    rig = planned(study.with_values({"rig.calibration.target.views": views})).case.cameras["rig"]
    line = linearised_depth(rig, np.array([1.0]), 0.0, "calibration")
    weighted = line.covariance @ line.sensitivity[:, 0]
    priors = np.array([np.radians(0.2) if name == "yaw" else 20e-6 for name in line.parameters])
    share = 1.0 - np.sum((weighted / priors) ** 2) / (weighted @ line.sensitivity[:, 0])
    assert (share > 0.5) == named
    said = rests_on(xr.DataTree.from_dict({"/": xr.Dataset(), "/decision": data}))
    if named:
        found = data["solved_rests_on_share"].item()
        assert found == pytest.approx(share, abs=2e-3)  # the interval is not quite linear in the errors
        where = f"{pretty(found, FRACTION, digits=2)} of the variance due to calibration at 1 m"
        assert said == (f"corner noise of the rig, declared 0.1 px ({where})",)
    else:
        assert said == ()


def test_views_for_a_requirement_are_planned(tmp_path: Path) -> None:
    needed = {"says": "n", "camera": "rig", "depth_uncertainty": {"below": "1.5 mm", "over": ["0.5 m", "1 m"]}}
    question = {key: VIEWS[key] for key in ("says", "vary", "low", "high")} | {"requirement": "needed"}
    asked = {"requirements": {"needed": needed}, "solve": {"views": question}}
    study = loaded(tmp_path, more=asked).plan().study
    (one,) = solve_requirement(study, study.file.solve["views"]).solutions
    assert one.value == round(one.value)
    assert 3 < one.value < 200


@pytest.mark.parametrize(
    ("vary", "low", "high", "goal"),
    [("tilt", "5 deg", "40 deg", "1.2 mm"), ("distances.0", "0.5 m", "2 m", "1.2 mm")],
)
def test_tilt_and_distance_for_a_certainty(tmp_path: Path, vary: str, low: str, high: str, goal: str) -> None:
    path = f"rig.calibration.target.{vary}"
    question = {**VIEWS, "vary": path, "low": low, "high": high, "camera": "rig", "uncertainty": goal}
    study = loaded(tmp_path, more={"solve": {"one": question}}).plan().study
    (one,) = solve(study, study.file.solve["one"]).solutions
    assert 0.0 < one.error < 0.15 * one.value


def poses(rotations: str) -> str:
    places = ("0.1 m, 0 m, 1 m", "-0.1 m, 0.1 m, 1.5 m", "0 m, -0.1 m, 2 m")
    shown = zip(rotations.split("; "), places, strict=True)
    return f"poses: [{', '.join(f'{{rotation: [{one}], position: [{place}]}}' for one, place in shown)}]"


TILTED = poses("20 deg, 0 deg, 0 deg; 0 deg, 20 deg, 0 deg; 0 deg, -20 deg, 10 deg")
SPUN = poses("0 deg, 0 deg, 10 deg; 0 deg, 0 deg, 0 deg; 0 deg, 0 deg, -60 deg")
ALIKE = poses("20 deg, 0 deg, 0 deg; 20 deg, 0 deg, 0 deg; 20 deg, 0 deg, 0 deg")


def pair_pictures(parameters: FloatArray, rotations: FloatArray, places: FloatArray) -> FloatArray:
    """What a parallel pair sees of 4 × 4 corners: yaw, left and right principal distance, right principal point.

    Rotations by scipy; points are seen from the middle of the baseline.
    """
    yaw, left, right, centre = parameters
    x, y = np.meshgrid(np.arange(4) - 1.5, np.arange(4) - 1.5)
    grid = 0.1 * np.column_stack([x.ravel(), y.ravel(), np.zeros(16)])
    points = np.concatenate([Rotation.from_rotvec(r).apply(grid) + t for r, t in zip(rotations, places, strict=True)])
    from_left = points + np.array([0.05, 0.0, 0.0])
    from_right = Rotation.from_rotvec([0.0, yaw, 0.0]).apply(points - np.array([0.05, 0.0, 0.0]))
    seen_left = left * from_left[:, :2] / from_left[:, 2:]
    seen_right = right * from_right[:, :2] / from_right[:, 2:] + [centre, 0.0]
    return np.concatenate([seen_left.ravel(), seen_right.ravel()]) / 10e-6


def test_given_poses_are_used_for_the_plan(tmp_path: Path) -> None:
    """Against the inverse of the whole information of errors and poses, by plain differences."""
    (asked,) = loaded(tmp_path, TILTED).plan().study.definition.calibrations_to_infer().values()
    assert isinstance(asked, TargetToInfer)
    (group,) = planned_calibration(asked, 0).groups
    assert isinstance(group, JointNormal)
    assert planned_calibration(asked, 1).groups == (group,)
    rotations = np.radians([[20.0, 0.0, 0.0], [0.0, 20.0, 0.0], [0.0, -20.0, 10.0]])
    places = np.array([[0.1, 0.0, 1.0], [-0.1, 0.1, 1.5], [0.0, -0.1, 2.0]])
    focal = 0.5 * 1024 * 10e-6 / np.tan(np.radians(65.24) / 2.0)
    design = np.concatenate([[0.0, focal, focal, 0.0], rotations.ravel(), places.ravel()])
    steps = np.concatenate([[1e-5, 1e-7, 1e-7, 1e-7], np.full(18, 1e-5)])

    def whitened(vector: FloatArray) -> FloatArray:
        return pair_pictures(vector[:4], vector[4:13].reshape(3, 3), vector[13:].reshape(3, 3)) / 0.1

    jacobian = np.column_stack([(whitened(design + s) - whitened(design - s)) / 2.0 for s in np.diag(steps)])
    priors = np.diag(np.concatenate([steps[:4] / [np.radians(0.2), 20e-6, 20e-6, 20e-6], np.zeros(18)]))
    inverse = np.linalg.pinv(np.concatenate([jacobian, priors]))
    covariance = (inverse @ inverse.T * np.outer(steps, steps))[:4, :4]
    names = ("yaw", "left_focal_length", "right_focal_length", "right_principal_point_x")
    order = [group.parameters.index(name) for name in names]
    found = np.sqrt(np.diag(group.covariance))[order]
    np.testing.assert_allclose(found, np.sqrt(np.diag(covariance)), rtol=1e-4)


@pytest.mark.parametrize("views", [SPUN, ALIKE, SPREAD.replace("17 deg", "0.5 deg")])
def test_boards_that_are_not_tilted_against_each_other_are_refused(tmp_path: Path, views: str) -> None:
    with pytest.raises(StudyError) as refused:
        loaded(tmp_path, views)
    (problem,) = refused.value.problems
    assert problem.path == f"cameras.rig.calibration.target.{views[: views.index(':')].replace('views', 'tilt')}"
    assert "at least 1°" in problem.what
    assert "position_known_to" in problem.what
    loaded(tmp_path, f"{views}, position_known_to: 1 mm")  # a stage gives the distances; tilts would otherwise


@pytest.mark.parametrize(
    ("views", "key"), [(f"{TILTED}, views: 8", "views"), (SPREAD.replace(", tilt: 17 deg", ""), "tilt")]
)
def test_views_are_either_spread_or_given(tmp_path: Path, views: str, key: str) -> None:
    with pytest.raises(StudyError, match=rf"target.*{key}"):
        loaded(tmp_path, views)


def test_a_calibration_that_only_a_design_leaves_unconverged_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sampling, "MINIMUM_LENGTHS", 15.0)  # shorter chains will do for the sentence
    steps = "rig.calibration.target.max_steps"
    fifth = {"rig.calibration.errors.pitch.standard_deviation": "0.2 deg"}  # chains of five parameters soon converge
    result = loaded(tmp_path, more={**fifth, steps: 300, "sweep": {steps: [100]}}).run()
    assert result.data["calibration"]["posterior_converged"].values.tolist() == [True]
    (unmet,) = result.unmet_requirements
    assert unmet.startswith("calibrations did not converge for Rig under 1 of 1 other sets of values (")
    (told,) = [line for line in result.lines() if line.startswith("Not converged")]
    assert told.startswith("Not converged: the calibration of Rig under 1 of 1 other sets of values (")
    page = " ".join(plain_text(one.text) for one in describe_answer(result.data) if isinstance(one, Paragraph))
    assert "Not converged: the calibration of Rig under 1 of 1 other sets of values (" in page
