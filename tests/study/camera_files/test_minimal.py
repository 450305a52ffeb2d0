"""Values as people have them: pixels, a field of view, and nothing that has a default."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

import tradestudy
from tests.study.camera_files import written
from tests.study.camera_files.test_import import refusal
from tests.study.camera_files.written import study
from tradestudy.cameras.stereo.design import StereoRig

SENSOR = "sensor: {pixels: [640, 480], pixel_pitch: 3 um}"


def rig(path: Path) -> StereoRig:
    camera = tradestudy.load(path).definition.designs["rig"]
    assert isinstance(camera, StereoRig)
    return camera


def test_a_focal_length_in_pixels_counts_pixel_pitches(tmp_path: Path) -> None:
    camera = rig(study(tmp_path, rig=f"kind: stereo, lenses: {{focal_length: 882.5 px}}, {SENSOR}, baseline: 60 mm"))
    assert camera.lens.focal_length == pytest.approx(2.6475e-3, rel=1e-15)


def test_a_field_of_view_is_that_across_the_width_unless_it_says_so(tmp_path: Path) -> None:
    camera = rig(study(tmp_path, rig=f"kind: stereo, lenses: {{field_of_view: 60 deg}}, {SENSOR}, baseline: 60 mm"))
    assert camera.field_of_view == pytest.approx(math.radians(60.0), rel=1e-14)


@pytest.mark.usefixtures("empty_figures")
def test_the_register_lists_every_default_and_the_first_page_perfect_calibrations(tmp_path: Path) -> None:
    path = study(tmp_path, rig=f"kind: stereo, lenses: {{field_of_view: 60 deg}}, {SENSOR}, baseline: 60 mm")
    result = tradestudy.load(path).run()
    register = result.data["assumptions"]
    defaults = {
        str(one): str(value)
        for one, value, note in zip(
            register["path"].values, register["value"].values, register["note"].values, strict=True
        )
        if "default" in str(note)
    }
    assert defaults == {
        "lenses.across": "width",
        "lenses.f_number": "2.8",
        "right_sensor": "as sensor",
        "convergence_distance": "infinity",
        "focus_distance": "autofocus",
        "depth.estimator": "disparity",
        "depth.disparity_error": "0.1 px",
        "depth.discrimination_step": "0.1 px",
        "depth.disparity_range": "unlimited",
        "distortion": "none",
        "calibration.errors": "none: a perfect calibration",
        "calibration.stability": "none: no change since the calibration",
    }
    result.write(tmp_path / "out", pdf=False)
    page = re.sub(r"<[^>]+>", " ", (tmp_path / "out" / "report.html").read_text(encoding="utf-8"))
    assert "Assumed perfect : the calibration of rig" in " ".join(page.split())


def test_an_error_that_is_declared_is_not_taken_as_perfect(tmp_path: Path) -> None:
    written.camchain(tmp_path / "chain.yaml")
    path = study(
        tmp_path, rig="from: chain.yaml, calibration: {errors: {yaw: {standard_deviation: 0.01 deg}}}", bare="like: rig"
    )
    path.write_text(path.read_text().replace("{like: rig}", "{like: rig, calibration: {errors: null}}"))
    near = "scene.distances=[0.5 m, 1 m]"
    cameras = tradestudy.load(path, [near]).run().data["cameras"]
    assert dict(zip(cameras["camera"].values, cameras["perfect_calibration"].values, strict=True)) == {
        "rig": 0.0,
        "bare": 1.0,
    }
    off = tradestudy.load(path, [near, "effects={calibration: 'off'}"]).run()
    assert "Assumed perfect: the calibration of rig and bare" in off.lines()


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ("lenses: {focal_length: 882.5 px}", "cameras.rig.baseline: this key is missing"),
        ("baseline: 60 mm", "cameras.rig.lenses: give exactly one of focal_length and field_of_view"),
        ("lenses: {focal_length: 0.2 px}, baseline: 60 mm", "1 px to 1×10⁷ px is expected"),
        ("lenses: {focal_length: 882.5}, baseline: 60 mm", "'882.5' has no unit; a length is expected"),
        ("lenses: {focal_length: 8 mm, across: width}, baseline: 60 mm", "across: belongs to field_of_view"),
    ],
)
def test_missing_values_and_values_that_are_not_lengths_are_reported(tmp_path: Path, said: str, message: str) -> None:
    assert message in refusal(study(tmp_path, rig=f"kind: stereo, {SENSOR}, {said}"))


def test_corners_or_a_target_give_an_imported_rig_its_spreads(tmp_path: Path) -> None:
    """The posterior of a simulated board is drawn about the geometry of the file."""
    written.opencv(tmp_path / "rig.yml")
    target = (
        "target: {views: 8, columns: 7, rows: 5, spacing: 30 mm, distances: [0.4 m, 0.8 m], half_field_angle: 10 deg, "
        "tilt: 20 deg, corner_noise: 0.1 px, max_steps: 100}"
    )
    errors = "errors: {yaw: {standard_deviation: 0.2 deg}}"
    path = study(tmp_path, rig=f"from: rig.yml, length_unit: mm, calibration: {{{errors}, {target}}}")
    definition = tradestudy.load(path).definition
    asked = definition.calibrations_to_infer()
    assert len(asked) == 1
    assert np.isfinite(definition.designs["rig"].separation)  # type: ignore[attr-defined]
