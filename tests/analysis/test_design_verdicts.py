"""Verdicts read off the curves of a design, against closed forms and against the full evaluation of the same study."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tradestudy
from tradestudy.answers.decision import decide_pair
from tradestudy.answers.depth import DepthPoint, depth_table
from tradestudy.answers.designs import Curve, best_at, crossings
from tradestudy.depth.evaluation import judged_at

STUDIES = Path(__file__).parents[2] / "studies"
GRID = np.geomspace(0.1, 5.0, 40)


def curve(values: np.ndarray, usable: tuple[float, float] = (0.1, 5.0), error: float = 0.0) -> Curve:
    return Curve(
        distance=GRID,
        uncertainty=values,
        error=np.where(np.isinf(values), 0.0, error) * np.nan_to_num(values),
        usable=[usable],
    )


def test_two_power_laws_cross_where_they_do_on_paper() -> None:
    """0.01 Z² = 0.02 Z at Z = 2, exactly on straight lines over logarithms."""
    (found,) = crossings(curve(0.01 * GRID**2), curve(0.02 * GRID), ("quadratic", "linear"))
    assert found.distance == pytest.approx(2.0, rel=1e-12)
    assert found.error == pytest.approx(0.0, abs=1e-9)
    assert found.nearer == "quadratic"


def test_a_bent_curve_crosses_within_the_stated_error() -> None:
    """a Z² (1 + (Z/Z₀)²) = b Z has one root, which numpy finds from its polynomial."""
    (found,) = crossings(curve(0.01 * GRID**2 * (1.0 + (GRID / 0.7) ** 2)), curve(0.02 * GRID), ("a", "b"))
    roots = np.roots([0.01 / 0.7**2, 0.0, 0.01, -0.02])
    (root,) = roots[np.isreal(roots)].real
    assert abs(found.distance - root) <= found.error
    assert found.error < 0.01 * root


def test_errors_of_curves_move_the_crossing_by_their_ratio_over_the_slope() -> None:
    """Logarithms of slopes 2 and 1: an error of 1 % of either moves the crossing by 1 % of the distance."""
    (found,) = crossings(curve(0.01 * GRID**2, error=0.01), curve(0.02 * GRID), ("a", "b"))
    assert found.error == pytest.approx(0.01 * 2.0, rel=1e-6)


def test_only_usable_cameras_are_best_and_equal_ones_are_tied() -> None:
    places = np.array([0.2, 0.5, 3.0])
    near, far = curve(0.01 * GRID, (0.1, 0.3)), curve(0.02 * GRID, (0.4, 2.0))
    known = {"near": 0.01 * places, "far": 0.02 * places}
    assert best_at({"near": near, "far": far}, places, known) == ["near", "far", ""]
    alike = {"a": curve(0.01 * GRID, error=0.02), "b": curve(0.0101 * GRID)}
    assert best_at(alike, np.array([0.5]), {"a": np.array([0.005]), "b": np.array([0.00505])}) == ["a, b"]


def test_an_unbounded_uncertainty_causes_no_warning_and_is_never_best() -> None:
    unbounded = curve(np.where(GRID > 1.0, np.inf, 0.001 * GRID), error=0.0)
    places = np.array([GRID[5], 3.0])
    known = {"one": np.array([0.001 * GRID[5], np.inf]), "other": 0.02 * places}
    assert best_at({"one": unbounded, "other": curve(0.02 * GRID)}, places, known) == ["one", "other"]
    assert crossings(unbounded, curve(0.02 * GRID), ("one", "other")) == ()


def test_curves_agree_with_a_full_evaluation() -> None:
    """Crossover and winners of the shipped sweep as declared, against the root finder on the exact curves."""
    study = tradestudy.load(STUDIES / "stereo_design.yaml", ["sweep=null"]).prepared
    case, pair = study.case, ("raytrix-r5", "stereo")
    places = np.array(study.file.decision.at)  # type: ignore[union-attr]  # the study has one
    curves = {
        name: Curve.of(camera, depth_table(DepthPoint(camera=camera, criteria=case.criteria, distance=case.distance)))
        for name, camera in case.cameras.items()
    }
    truth = decide_pair(case, pair, places)
    known = {name: judged_at(camera, places) for name, camera in case.cameras.items()}
    assert best_at(curves, places, known) == [row[-1] for row in truth.winner]
    found = crossings(curves[pair[0]], curves[pair[1]], pair)
    assert len(found) == len(truth.crossings["both"]) > 0
    for one, exact in zip(found, truth.crossings["both"], strict=True):
        assert abs(one.distance - exact.distance) <= max(one.error, 1e-6 * exact.distance)
        assert one.error < 0.02 * exact.distance
        assert one.nearer == exact.nearer


def test_two_distances_do_not_change_which_camera_is_best_between_them(tmp_path: Path) -> None:
    """The uncertainty of the longer rig is √((k Z²)² + (Z/100)²), below the straight line between its ends."""
    rig = """
    kind: stereo
    lenses: {focal_length: 12 mm, f_number: 8}
    sensor: {pixels: [1280, 1024], pixel_pitch: 5 um}
    depth: {disparity_error: 3 px}
    baseline: """
    text = f"""
format: 2
study: two
title: Two distances
question: Which rig is best?
cameras:
  long:{rig}120 mm
    calibration: {{errors: {{baseline: {{standard_deviation: 1.2 mm}}}}}}
  short:{rig}67.5 mm
scene: {{distances: {{from: 0.4 m, to: 1.2 m, points: 2, spacing: log}}, wavelength: 550 nm}}
decision: {{between: [long, short], at: [0.6 m, 0.7 m]}}
sweep: {{long.lenses.f_number: [8, 16]}}
"""
    (tmp_path / "two.yaml").write_text(text, encoding="utf-8")
    data = tradestudy.load(tmp_path / "two.yaml").run().data["decision"].to_dataset()
    assert data["design_best_camera"].values.tolist() == [["short", "long"]] * 2
    noise = 15e-6 / 12e-3  # 3 px over the focal length
    long, short = (np.hypot(noise / b * 0.7, share) for b, share in ((0.12, 0.01), (0.0675, 0.0)))
    assert long < short
