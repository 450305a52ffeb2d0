"""As a new user would: a study with a rig of one's own decides from the posterior of its corners."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from tests.data.simulate_corners import FILE as SIMULATED
from tests.data.simulate_corners import Numbers, pictures
from tests.study.conftest import STUDIES
from tradestudy import load
from tradestudy.api import Result
from tradestudy.calibration import posteriors
from tradestudy.cli import app

pytestmark = pytest.mark.usefixtures("empty_figures", "fewer_checks")

RIG = "stereo-65-across"
FEW = "scene.distances={from: 0.3 m, to: 5 m, points: 9, spacing: log}"
SMALLER = (
    "scene.distances={from: 100 mm, to: 10 m, points: 9, spacing: log}",
    "decision.at=[1 m]",
    "decision.candidates=null",
    *(f"{name}=null" for name in ("raytrix-r5-galilean", "stereo-65-diagonal", "stereo-printed", "stereo-short")),
    *(f"{name}=null" for name in ("readings", "solve", "claims")),
)
CALIBRATED = (
    f"{RIG}.calibration.errors=null",
    f"{RIG}.calibration.corners={{file: stereo_65_corners.csv, max_steps: 100}}",
)


@pytest.fixture(scope="module")
def fewer_checks() -> Iterator[None]:
    """Poses are refitted at fewer draws: tests/calibration/test_relative_pose_posterior.py is about that check."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(posteriors, "CHECKED_POINTS", 20)
        yield


def depth_of(result: Result, group: str = "depth") -> Any:
    return result.data[group].to_dataset()


def undistorted(camera: Numbers, column: Numbers, row: Numbers) -> tuple[Numbers, Numbers]:
    """Slopes of rays by cameras (6, draws) from their places in a picture, by iteration of the radius."""
    x, y = (column - camera[2]) / camera[0], (row - camera[3]) / camera[1]
    factor = np.ones_like(x)
    for _ in range(200):
        r2 = (x**2 + y**2) / factor**2
        factor = 1.0 + camera[4] * r2 + camera[5] * r2**2
    return x / factor, y / factor


def depths_read(best: Numbers, rigs: Numbers, points: Numbers) -> Numbers:
    """Depths that believed rigs (draws, 18) read of what the best one sees of points (D, 3), shape (draws, D) [m].

    A point on the left ray, R (x, y, 1) + w t in the right camera's frame, is imaged in the right one's seen column.
    """
    depths = []
    for seen in pictures(best, points):
        x, y = undistorted(rigs[:, :6].T, seen[0], seen[1])
        column, _ = undistorted(rigs[:, 6:12].T, seen[2], seen[3])
        turned = Rotation.from_rotvec(rigs[:, 12:15]).apply(np.column_stack([x, y, np.ones_like(x)]))
        inverse = (column * turned[:, 2] - turned[:, 0]) / (rigs[:, 15] - column * rigs[:, 17])
        depths.append(np.where(inverse > 0.0, 1.0 / inverse, np.inf))
    return np.stack(depths, axis=-1)


@pytest.fixture(scope="module")
def own_corners(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """`real_rig` beside a corner file of 12 of its 29 views."""
    folder = tmp_path_factory.mktemp("own")
    header, *rows = (STUDIES / "data" / "stereo_chessboard_corners.csv").read_text(encoding="utf-8").splitlines()
    kept = [header, *(row for row in rows if int(row.split(",")[0]) <= 12)]
    (folder / "corners.csv").write_text("\n".join(kept) + "\n", encoding="utf-8")
    text = (STUDIES / "real_rig.yaml").read_text(encoding="utf-8")
    study = folder / "rig.yaml"
    study.write_text(
        text.replace("from: data/stereo_chessboard_corners.csv", "from: corners.csv").replace(
            "    title: Webcams\n", "    title: Webcams\n    calibration: {corners: {max_steps: 200}}\n"
        ),
        encoding="utf-8",
    )
    return load(study, (FEW, "sensitivity=null")).run()


def test_a_rig_with_another_corner_file_measures_as_its_posterior_says(own_corners: Result) -> None:
    """Depths triangulated in plain numpy from the saved draws, on the axis."""
    found = depth_of(own_corners).sel(camera="webcams", error_source="calibration")
    distance = found["distance"].values
    posterior = own_corners.data["calibration"].to_dataset().sel(posterior="webcams")
    shared = posterior["posterior_best"].notnull().values
    best, draws = posterior["posterior_best"].values[shared], posterior["posterior_draw"].values[:, shared]
    turned = Rotation.from_rotvec(best[12:15]).as_matrix()
    centre, axis = -turned.T @ best[15:18], turned[2] + [0.0, 0.0, 1.0]
    points = np.stack([np.append(centre[:2] / 2 + z * axis[:2] / axis[2], z) for z in distance])
    depths = depths_read(best, best + draws - draws.mean(axis=0), points)
    low, high = np.quantile(depths, [0.158655, 0.841345], axis=0)
    width, error = (
        found["depth_uncertainty_by_error_source"].values,
        found["depth_uncertainty_by_error_source_error"].values,
    )
    np.testing.assert_array_less(np.abs(width - (high - low) / 2.0), 0.01 * width + 3.0 * error)
    np.testing.assert_allclose(found["depth_quantile"].values[:, [1, 3]], np.stack([low, high], axis=-1), rtol=1e-3)


def test_fewer_views_leave_more_uncertain_and_limit_the_range(own_corners: Result) -> None:
    """All 29 views leave 0.49, 16 and 118 mm at 0.5, 2 and 5 m; 12 leave more, beside the same noise."""
    found = depth_of(own_corners).sel(camera="webcams")
    width = found["depth_uncertainty_by_error_source"].sel(error_source="calibration")
    assert np.all(width.interp(distance=[0.5, 2.0, 5.0]) > np.array([0.49e-3, 16e-3, 118e-3]))
    assert float(found["variance_share"].sel(part="relative position", distance=5.0)) > 0.3
    both = np.hypot(width, found["depth_uncertainty_by_error_source"].sel(error_source="noise"))
    np.testing.assert_allclose(found["depth_uncertainty"].values, both.values, rtol=0.02)
    assert (found["depth_uncertainty"] == found["depth_uncertainty_by_error_source"].sel(error_source="both")).all()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The headline study and its cameras, beside the corners of its stereo rig."""
    made = tmp_path_factory.mktemp("headline")
    shutil.copytree(STUDIES / "cameras", made / "cameras")
    shutil.copy(STUDIES / "plenoptic_vs_stereo.yaml", made)
    shutil.copy(SIMULATED, made)
    return made


@pytest.fixture(scope="module")
def before(folder: Path) -> Result:
    return load(folder / "plenoptic_vs_stereo.yaml", SMALLER).run()


@pytest.fixture(scope="module")
def after(folder: Path) -> Result:
    return load(folder / "plenoptic_vs_stereo.yaml", (*SMALLER, *CALIBRATED)).run()


def test_corners_leave_the_rig_surer_than_a_yaw_of_a_fifth_of_a_degree(before: Result, after: Result) -> None:
    """B = 100 mm: Z²ψ/B(1 + (B/2Z)²) is 35.0 mm at 1 m for the declared 0.2°."""
    at = {"camera": RIG, "distance": 1.0, "error_source": "calibration"}
    declared, known = (
        float(depth_of(one, "depth_at_places").sel(at)["depth_uncertainty_by_error_source"]) for one in (before, after)
    )
    assert declared == pytest.approx(np.radians(0.2) / 0.1 * (1 + 0.05**2), rel=0.01)
    assert known < 0.03 * declared


def test_matching_noise_then_dominates_the_rig(before: Result, after: Result) -> None:
    """0.1 px of 10 µm by 8 mm at 1 m: 1.25 mm, and no group of the calibration comes near."""
    shares = [
        depth_of(one, "depth_at_places").sel(camera=RIG, distance=1.0)["variance_share"] for one in (before, after)
    ]
    assert [str(share.idxmax("part").item()) for share in shares] == ["relative rotation", "noise"]
    noise = depth_of(after, "depth_at_places").sel(camera=RIG, distance=1.0, error_source="noise")
    assert float(noise["depth_uncertainty_by_error_source"]) == pytest.approx(1e-6 / (8.0e-3 * 0.1), rel=0.01)
    assert float(shares[1].sel(part="noise")) > 0.8


def test_answer_and_requirements_follow_from_the_posterior(before: Result, after: Result) -> None:
    best = [one.data["decision"].to_dataset()["best_camera"].sel(error_source="both") for one in (before, after)]
    assert [str(one.sel(distance=10.0).item()) for one in best] == ["", RIG]
    met = [one.data["requirements"].to_dataset()["met"].sel(requirement="mid-range") for one in (before, after)]
    assert [bool(one) for one in met] == [False, True]
    named = after.data["requirements"].to_dataset()["camera_deciding"].sel(requirement="mid-range")
    assert str(named.item()) == RIG
    # The same numbers everywhere: the ratio of the decision is that of /depth_at_places, of half width or radius.
    both = depth_of(after, "depth_at_places").sel(distance=1.0)
    widths = np.fmax(both["depth_uncertainty"], both["depth_error_radius"])
    ratio = after.data["decision"].to_dataset()["uncertainty_ratio"].sel(place=1.0, error_source="both").item()
    assert ratio == pytest.approx(float(widths.sel(camera="raytrix-r5") / widths.sel(camera=RIG)), rel=1e-12)


def test_declared_geometry_that_contradicts_the_corners_is_refused(folder: Path, tmp_path: Path) -> None:
    """Ten views determine the 100 mm of the generator well enough."""
    rows = SIMULATED.read_text(encoding="utf-8").splitlines()
    few = [rows[0], *(row for row in rows[1:] if int(row.split(",")[0]) % 3 == 0)]
    (folder / "few_corners.csv").write_text("\n".join(few) + "\n", encoding="utf-8")
    calibrated = (one.replace(SIMULATED.name, "few_corners.csv") for one in CALIBRATED)
    changes = [*SMALLER, *calibrated, f"{RIG}.baseline=60 mm"]
    options = [word for change in changes for word in ("--set", change)]
    reported = CliRunner().invoke(
        app, ["run", str(folder / "plenoptic_vs_stereo.yaml"), "--out", str(tmp_path / "out"), "--quiet", *options]
    )
    assert reported.exit_code == 2
    (line,) = reported.output.splitlines()
    assert line.startswith(f"--set:12:1: cameras.{RIG}.calibration.corners: ")
    assert all(part in line for part in ("60 mm", f"correct cameras.{RIG}.baseline"))
    fitted = re.search(r"(\d+\.\d+) ± (\d+\.\d+) mm", line)
    assert fitted is not None, line
    assert float(fitted[1]) == pytest.approx(100.0, abs=4.0 * float(fitted[2]))
    assert float(fitted[2]) < 0.1
    assert not (tmp_path / "out").exists()
