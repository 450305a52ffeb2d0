"""A kind of camera is one room: adding one and removing one touch nothing but the tuple of kinds."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

ROOT = Path(__file__).parents[2]
KINDS = Path("tradestudy", "cameras", "kinds.py")

STUDY = """
format: 2
study: laser
title: Laser triangulation against a stereo rig
question: Which of them measures better?
cameras:
  scanner:
    kind: laser-triangulation
    title: Scanner
    lens: {focal_length: 8 mm, f_number: 8}
    sensor: {pixels: [2048, 1024], pixel_pitch: 5 um}
    baseline: 100 mm
    projector_angle: 5 deg
    focus_distance: 1 m
    depth: {disparity_error: 0.1 px, discrimination_step: 0.1 px}
    calibration:
      errors:
        projector_angle: {standard_deviation: 0.01 deg}
        baseline: {half_width: 0.1 mm}
        focal_length: {standard_deviation: 5 um}
  scanner-derived: {like: scanner, title: Scanner with its own picture, depth: {disparity_error: derived}}
  rig:
    kind: stereo
    title: Rig
    lenses: {focal_length: 8 mm, f_number: 8}
    sensor: {pixels: [2048, 1024], pixel_pitch: 5 um}
    baseline: 100 mm
    convergence_distance: infinity
    focus_distance: 1 m
    depth: {estimator: disparity, disparity_error: 0.1 px, discrimination_step: 0.1 px}
    calibration: {errors: {yaw: {standard_deviation: 0.01 deg}}}
scene:
  distances: {from: 0.3 m, to: 3 m, points: 21}
  wavelength: 550 nm
  picture:
    texture: {contrast: 15 %, correlation_length: 2 mm}
    matching_window: 15 px
    light: {electrons: 4000 electrons, at_f_number: 8}
    read_noise: 10 electrons
    full_well: 20000 electrons
    bit_depth: 12
usable_range: {blur: 4 px, relative_uncertainty: 5 %}
depth_of_field:
  range: [0.9 m, 1.1 m]
  criteria: {two-pixels: {blur: 2 px, diffraction: none}}
relief: {step_height: 10 mm, surface_tilt: 20 deg}
decision: {between: [scanner, rig], at: [0.5 m, 1 m]}
propagation: {seed: 1, field_places: [30 %], max_draws: 16384}
sweep: {scanner.baseline: [50 mm, 200 mm]}
requirements:
  near: {camera: any, says: near, depth_uncertainty: {below_relative: 1 %, over: [0.5 m, 1 m]}}
"""


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the package and the studies that may be changed."""
    for folder in ("tradestudy", "studies"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def call(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the copy's command line."""
    environment = os.environ | {"PYTHONPATH": str(folder)}
    command = [sys.executable, "-m", "tradestudy", *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def invoke(folder: Path, *arguments: str) -> str:
    """What a call that succeeds prints."""
    found = call(folder, *arguments)
    assert found.returncode == 0, found.stdout + found.stderr
    return found.stdout


def replace_once(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1, old
    path.write_text(text.replace(old, new), encoding="utf-8")


@pytest.mark.slow
def test_a_new_kind_is_one_file_and_one_entry(copy: Path) -> None:
    source = Path(__file__).with_name("laser_triangulation.py")
    assert len(source.read_text(encoding="utf-8").splitlines()) <= 250
    shutil.copy(source, copy / "tradestudy" / "cameras")
    replace_once(copy / KINDS, "    StereoDeclaration,\n", "    StereoDeclaration,\n    LaserDeclaration,\n")
    imported = "from tradestudy.cameras.laser_triangulation import LaserDeclaration\n\nKINDS: Final"
    replace_once(copy / KINDS, "KINDS: Final", imported)
    (copy / "laser.yaml").write_text(STUDY, encoding="utf-8")

    assert "3 cameras" in invoke(copy, "check", "laser.yaml")
    assert "scanner" in invoke(copy, "plan", "laser.yaml")
    invoke(copy, "run", "laser.yaml", "--out", "out", "--quiet")
    assert (copy / "out" / "report.pdf").stat().st_size > 10_000
    report = (copy / "out" / "report.html").read_text(encoding="utf-8")
    assert "Depth from a projected line" in report
    assert "angle of the projector" in report

    tree = xr.open_datatree(copy / "out" / "results.nc", engine="h5netcdf")
    depth = tree["depth"].to_dataset().sel(camera="scanner")
    # 0.1 px of 5 µm: δZ = Z² δu/(f B), and the baseline is swept.
    for baseline in (0.05, 0.1, 0.2):
        noise = (
            depth["depth_uncertainty_by_error_source"]
            .sel(error_source="noise")
            .sel(baseline=baseline)
            .sel(distance=3.0)
        )
        assert float(noise) == pytest.approx(3.0**2 * 0.5e-6 / (8e-3 * baseline), rel=2e-3)
    calibrated = depth["depth_uncertainty_by_error_source"].sel(
        {"error_source": "calibration", "baseline": 0.1, "distance": 3.0}
    )
    # As errors of the place of the line: f/cos²θ δθ, f/Z δB, and u/f δf, at Z = 3 m.
    slopes = np.array(
        [
            8e-3 / np.cos(np.radians(5.0)) ** 2 * np.radians(0.01),
            8e-3 / 3.0 * 1e-4 / np.sqrt(3.0),
            (0.1 / 3.0 - np.tan(np.radians(5.0))) * 5e-6,
        ]
    )
    expected = np.hypot.reduce(slopes) * 3.0**2 / (8e-3 * 0.1)
    assert float(calibrated) == pytest.approx(expected, rel=0.05)

    wrong = call(copy, "check", "laser.yaml", "--set", "scanner.projector_angle=5 mm")
    assert wrong.returncode == 2
    assert "cameras.scanner.projector_angle" in wrong.stderr


@pytest.mark.slow
def test_a_kind_can_be_removed(copy: Path) -> None:
    shutil.rmtree(copy / "tradestudy" / "cameras" / "unfocused_plenoptic")
    kinds = (copy / KINDS).read_text(encoding="utf-8").splitlines(keepends=True)
    (copy / KINDS).write_text("".join(line for line in kinds if "Unfocused" not in line), encoding="utf-8")

    with_such_a_camera = []
    for study in sorted((copy / "studies").glob("*.yaml")):
        found = call(copy, "check", str(study))
        if found.returncode:
            with_such_a_camera.append(study.name)
            assert "'unfocused-plenoptic'" in found.stderr
    assert with_such_a_camera == ["arms_length.yaml", "hand_lens.yaml", "rock_scene.yaml"]
    for name in ("plenoptic_vs_stereo", "close_range"):
        few = ["--set", "scene.distances.points=11"]
        invoke(copy, "run", f"studies/{name}.yaml", "--out", name, "--no-pdf", "--quiet", *few)
