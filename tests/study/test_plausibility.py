"""Implausible input causes a warning at its place, which a basis silences."""

from __future__ import annotations

from pathlib import Path

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
