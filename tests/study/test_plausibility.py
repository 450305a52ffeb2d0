"""Implausible input causes a warning at its place, which a basis silences."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import tradestudy
from tradestudy.cli import app

STUDIES = Path(__file__).parents[2] / "studies"
ROBOT = STUDIES / "robot.yaml"
UNUSUAL = {
    "stereo-75mm.baseline": ("50 m", "50 m is unusual (100 µm to 10 m is common)"),
    "raytrix-r5.microlenses.gap": ("100 mm", "100 mm is unusual (10 µm to 10 mm is common)"),
    "stereo-75mm.sensor.pixel_pitch": ("3 mm", "3 mm is unusual"),
    "scene.wavelength": ("30 um", "30 µm is unusual (200 nm to 20 µm is common)"),
    "usable_range.relative_uncertainty": ("100 %", "100 % is unusual"),
    "scene.picture.light.electrons": ("20000 electrons", "full well of"),
    "stereo-75mm.lenses.f_number": ("0.5", "0.5 is unusual (0.7 to 200 is common)"),
    "stereo-75mm.calibration.errors.yaw.standard_deviation": ("80 deg", "80° is unusual"),
    "accuracy.tolerance": ("0.1", "0.1 means 10 %; write '0.1 %' for 0.1 %"),
    "decision.at": ("[8 m]", "lies beyond the distances of the scene"),
    "requirements.near-and-mid.depth_uncertainty.over": ("[0.2 m, 1 m]", "reaches beyond the distances of the scene"),
}


@pytest.mark.parametrize(("path", "said"), [(path, said) for path, (_, said) in UNUSUAL.items()])
def test_implausible_values_cause_a_warning_at_their_place_only(path: str, said: str) -> None:
    reported = CliRunner().invoke(app, ["check", str(ROBOT), "--set", f"{path}={UNUSUAL[path][0]}"])
    assert reported.exit_code == 0, reported.output
    (line,) = [one for one in reported.stderr.splitlines() if one.startswith("warning: ")]
    assert line.startswith("warning: --set:")
    assert path.split(".")[-1] in line
    assert said.replace("\N{NO-BREAK SPACE}", " ") in line.replace("\N{NO-BREAK SPACE}", " ")


def test_a_focal_length_in_the_wrong_unit_is_warned_about() -> None:
    (reported,) = tradestudy.load(
        ROBOT, ["stereo-75mm.lenses.focal_length=2.65 m", "stereo-75mm.focus_distance=autofocus"]
    ).warnings
    assert "cameras.stereo-75mm.lenses.focal_length: 2.65 m is unusual" in reported.replace("\N{NO-BREAK SPACE}", " ")


def test_a_basis_silences_a_warning_and_each_place_is_reported_once() -> None:
    stated = "stereo-75mm.baseline={value: 50 m, basis: datasheet}"
    assert tradestudy.load(ROBOT, [stated]).warnings == ()
    both = tradestudy.load(ROBOT, ["stereo-50mm.sensor.pixel_pitch=3 mm"]).warnings  # which the other head inherits
    assert len(both) == 1


def test_a_tolerance_without_a_percent_sign_is_warned_about() -> None:
    (reported,) = tradestudy.load(ROBOT, tolerance="0.1").warnings
    assert reported.startswith("--tolerance:1:1: accuracy.tolerance: 0.1 means 10")
    assert tradestudy.load(ROBOT, tolerance="10 %").warnings == ()
    assert tradestudy.load(ROBOT, tolerance="0.01").warnings == ()


@pytest.mark.parametrize("study", sorted(STUDIES.glob("*.yaml")), ids=lambda path: path.stem)
def test_no_shipped_study_warns(study: Path) -> None:
    assert tradestudy.load(study).warnings == ()


def test_a_report_keeps_the_warnings() -> None:
    few = ["scene.distances.points=4", "stereo-75mm.baseline=50 m"]
    result = tradestudy.load(ROBOT, few).run()
    kept = result.data["assumptions"]["warning"].values.tolist()
    assert any("50 m is unusual" in str(one).replace("\N{NO-BREAK SPACE}", " ") for one in kept)


STEREO = """%YAML:1.0
---
image_width: 640
image_height: 480
M1: !!opencv-matrix {rows: 3, cols: 3, dt: d, data: [800., 0., 320., 0., 800., 240., 0., 0., 1.]}
M2: !!opencv-matrix {rows: 3, cols: 3, dt: d, data: [800., 0., 320., 0., 800., 240., 0., 0., 1.]}
D1: !!opencv-matrix {rows: 1, cols: 5, dt: d, data: [0., 0., 0., 0., 0.]}
D2: !!opencv-matrix {rows: 1, cols: 5, dt: d, data: [0., 0., 0., 0., 0.]}
R: !!opencv-matrix {rows: 3, cols: 3, dt: d, data: [1., 0., 0., 0., 1., 0., 0., 0., 1.]}
T: !!opencv-matrix {rows: 3, cols: 1, dt: d, data: [-90., 0., 0.]}
"""
IMPORTING = """format: 2
study: importing
title: Blur of an imported rig
question: Where is it usable?
cameras:
  rig:
    from: rig.yml
    length_unit: mm
    lenses: {f_number: 4}
    focus_distance: 0.6 m
scene: {distances: {from: 0.3 m, to: 2 m, points: 10, spacing: log}, wavelength: 550 nm}
usable_range: {blur: 2 px}
"""


def test_an_assumed_pixel_pitch_is_warned_about_only_where_blur_depends_on_it(tmp_path: Path) -> None:
    (tmp_path / "rig.yml").write_text(STEREO, encoding="utf-8")
    study = tmp_path / "importing.yaml"

    def warnings(text: str, *overrides: str) -> tuple[str, ...]:
        study.write_text(text, encoding="utf-8")
        return tradestudy.load(study, list(overrides)).warnings

    (reported,) = warnings(IMPORTING)
    assert "cameras.rig.from: " in reported
    assert "pixel_pitch" in reported
    assert warnings(IMPORTING, "rig.sensor.pixel_pitch=3 um") == ()
    assert warnings(IMPORTING.replace("blur: 2 px", "relative_uncertainty: 50 %")) == ()
    assert len(warnings(IMPORTING.replace("    lenses: {f_number: 4}\n", ""))) == 1  # the default f-number blurs too
    assert warnings(IMPORTING.replace("    focus_distance: 0.6 m\n", "")) == ()  # refocused at each distance


@pytest.mark.parametrize(
    ("matrix", "said"),
    [
        ("8.8e-9, 0., 320., 0., 8.8e-9, 240.", "a focal length of 8.8e-09 px is unusual for a picture of 640 × 480 px"),
        ("800., 0., 320., 0., 400., 240.", "focal lengths of 800 and 400 px mean pixels that are not square"),
        ("800., 0., 5000., 0., 800., 240.", "the principal point (5000, 240) px lies outside the picture"),
    ],
)
def test_a_camera_matrix_that_does_not_fit_its_picture_is_warned_about(tmp_path: Path, matrix: str, said: str) -> None:
    good = "800., 0., 320., 0., 800., 240."
    (tmp_path / "rig.yml").write_text(STEREO.replace(good, matrix, 1), encoding="utf-8")
    (tmp_path / "importing.yaml").write_text(IMPORTING, encoding="utf-8")
    reported = tradestudy.load(tmp_path / "importing.yaml", ["rig.sensor.pixel_pitch=3 um"]).warnings
    assert any("cameras.rig.from: " in one and said in one for one in reported), reported


def test_a_relative_bound_without_a_percent_sign_is_warned_about() -> None:
    """0.5 is half of the distance; a reader of data sheets means half a per cent."""
    bound = {
        "says": "half a per cent",
        "camera": "any",
        "depth_uncertainty": {"below_relative": 0.5, "over": ["1 m", "2 m"]},
    }
    (said,) = tradestudy.load(ROBOT).with_values({"requirements.needed": bound}).warnings
    assert "requirements.needed.depth_uncertainty.below_relative: 0.5 means 50 %; write '0.5 %'" in said


def test_a_posterior_of_few_draws_is_warned_about(tmp_path: Path) -> None:
    """From n draws, a standard deviation is known to 1/√(2 n): 5 % from 200, and 1 % from 5000."""
    for count, warned in ((200, True), (5000, False)):
        rows = np.random.default_rng(0).normal(0.0, 2e-4, count)
        (tmp_path / "draws.csv").write_text("yaw\n" + "\n".join(f"{one!r}" for one in rows.tolist()))
        values = {"errors": None, "posterior": {"file": str(tmp_path / "draws.csv")}}
        study = tradestudy.load(ROBOT).with_values(
            {f"stereo-75mm.calibration.{key}": one for key, one in values.items()}
        )
        assert any("determine a standard deviation to about 5 %" in one for one in study.warnings) is warned


def test_equal_light_on_unequal_pixels_is_warned_about() -> None:
    """Pixels of 5.5 µm have 3.4 times the area of those of 3 µm."""
    (said,) = tradestudy.load(ROBOT).with_values({"scene.picture.light.at_pixel_pitch": None}).warnings
    assert "pixels of 3 µm and 5.5 µm are taken to collect equal light" in said
    alike = {"scene.picture.light.at_pixel_pitch": None, "raytrix-r5.sensor.pixel_pitch": "3 um"}
    assert tradestudy.load(ROBOT).with_values(alike).warnings == ()
