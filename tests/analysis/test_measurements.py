"""Measured depth errors beside predicted ones: a camera with known errors, measured as its exact model would be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import tradestudy
from tradestudy import cli
from tradestudy.calibration.measured_fits import MEAN_OF_NORMAL
from tradestudy.errors import StudyError
from tradestudy.figures.gallery import all_drawings
from tradestudy.results.views.headline import headline
from tradestudy.results.views.measured import implied_values, locking_words, measured_tables

NOISE, YAW, BASELINE = 0.2, 1e-3, 0.4e-3  # px, rad, m
STUDY = """
format: 2
study: wall
title: A rig before a wall
question: Does it measure as predicted?
cameras:
  rig:
    kind: stereo
    lenses: {{focal_length: 800 px}}
    sensor: {{pixels: [1280, 800], pixel_pitch: 3 um}}
    baseline: 75 mm
    depth: {{disparity_error: {noise} px}}
scene:
  distances: {{from: 0.5 m, to: 8 m, points: 40, spacing: log}}
  wavelength: 550 nm
measurements:
  wall: {{camera: rig, file: wall.csv, source: invented, zero: {zero}}}
"""
DISTANCES = np.geomspace(0.6, 6.0, 15)


def measured_by_rotated_camera(distance: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Depths on the axis of the left camera of a pair whose right one is turned about y, by explicit projection.

    The pair converts disparity with the declared 800 px and 75 mm; its true baseline is longer.
    """
    half = (0.075 + BASELINE) / 2.0  # the point lies midway between the cameras, as on the axis of a study
    right = np.arctan(-half / distance) + YAW  # the right camera turned to the left: the point moves right
    disparity = 800.0 * (half / distance - np.tan(right))
    return 800.0 * 0.075 / disparity


def _write(folder: Path, *, noise: float = 0.2, zero: str = "known", table: str = "") -> Path:
    (folder / "wall.yaml").write_text(STUDY.format(noise=noise, zero=zero), encoding="utf-8")
    (folder / "wall.csv").write_text(table, encoding="utf-8")
    return folder / "wall.yaml"


def _table(**columns: np.ndarray[Any, Any]) -> str:
    units = {"valid": "%"}
    head = ",".join(f"{name} [{units.get(name, 'm')}]" for name in columns)
    return "\n".join([head, *(",".join(map(repr, map(float, row))) for row in zip(*columns.values(), strict=True))])


def _run(path: Path) -> tuple[Any, xr.Dataset]:
    result = tradestudy.load(path).run()
    return result, result.data["measurements"].to_dataset().sel(table="wall")


def test_a_yaw_and_a_longer_baseline_are_found_with_their_signs(tmp_path: Path) -> None:
    slope = 60.0 / DISTANCES**2
    bias = measured_by_rotated_camera(DISTANCES) - DISTANCES
    sigma = NOISE / slope * (1.0 + 0.01 * np.random.default_rng(3).normal(size=DISTANCES.size))
    table = _table(distance=DISTANCES, sigma=sigma, bias=bias + sigma**2 / DISTANCES, valid=99.0 + 0.0 * DISTANCES)
    result, data = _run(_write(tmp_path, table=table))
    assert data["noise_px"].item() == pytest.approx(NOISE, rel=0.02)
    assert data["floor_interval"].values[0] == 0.0
    assert data["exponent"].item() == pytest.approx(2.0, abs=0.02)
    assert abs(data["offset_px"].item()) == pytest.approx(800.0 * YAW, rel=0.01)
    assert data["scale"].item() == pytest.approx(BASELINE / 0.075, rel=0.05)
    assert data["baseline_shift"].item() == pytest.approx(-BASELINE, rel=0.05)  # declared minus true
    assert data["ratio"].sel(quantity="sigma", statistic="median").item() == pytest.approx(1.0, rel=1e-2)
    assert data["noise_verdict"].item() == "consistent"
    assert data["calibration_verdict"].item() == "inconsistent"
    assert "the points contradict the declared calibration errors" in headline(result.data)


def test_a_camera_from_the_fitted_file_measures_with_the_measured_bias(tmp_path: Path) -> None:
    bias = measured_by_rotated_camera(DISTANCES) - DISTANCES
    sigma = 0.4 * DISTANCES**2 / 60.0
    table = _table(distance=DISTANCES, sigma=sigma, bias=bias + sigma**2 / DISTANCES)
    result, data = _run(_write(tmp_path, table=table))
    assert data["noise_verdict"].item() == "inconsistent"
    result.write(tmp_path / "out", pdf=False)
    text = (tmp_path / "out" / "fitted" / "wall.yaml").read_text(encoding="utf-8")
    assert "fitted to wall.csv" in text
    fitted = tmp_path / "fitted.yaml"
    fitted.write_text(text, encoding="utf-8")
    camera = STUDY.format(noise=0.2, zero="known").split("measurements:")[0]
    head, _, scene = camera.partition("  rig:")
    (tmp_path / "again.yaml").write_text(
        f"{head}  rig:\n    from: fitted.yaml\nscene:{scene.partition('scene:')[2]}", encoding="utf-8"
    )
    again = tradestudy.load(tmp_path / "again.yaml").prepared.case.cameras["rig"]
    assert again.disparity_error_px == pytest.approx(0.4, rel=1e-3)
    read = again.measured_depth(
        DISTANCES, 0.0, {name: np.full((1, 1), mean) for name, mean in again.calibration.means.items()}
    )
    # The point on the axis of a study lies midway between both cameras, as in the table.
    assert 1.0 / read.inverse_depth[0] - DISTANCES == pytest.approx(bias, rel=0.02)


def test_the_zero_of_the_tape_can_be_fitted(tmp_path: Path) -> None:
    shift = 0.004
    sigma = NOISE * DISTANCES**2 / 60.0
    scatter = 0.01 * DISTANCES**2 / 60.0 * np.random.default_rng(1).normal(size=DISTANCES.size)
    bias = shift + sigma**2 / DISTANCES + scatter
    _, data = _run(_write(tmp_path, zero="fitted", table=_table(distance=DISTANCES, sigma=sigma, bias=bias)))
    assert data["zero_shift"].item() == pytest.approx(shift, rel=0.1)
    assert data["offset_px"].item() == pytest.approx(0.0, abs=0.02)
    assert data["calibration_verdict"].item() == "consistent"


def test_biases_that_are_all_zero_contradict_no_perfect_calibration(tmp_path: Path) -> None:
    table = _table(distance=DISTANCES, sigma=NOISE * DISTANCES**2 / 60.0, bias=0.0 * DISTANCES)
    _, data = _run(_write(tmp_path, table=table))
    assert data["calibration_verdict"].item() == "consistent"


def test_rows_where_the_camera_measures_nothing_are_named_and_left_out(tmp_path: Path) -> None:
    distance = np.array([0.02, *DISTANCES])  # nearer than both views overlap
    sigma = NOISE * distance**2 / 60.0
    result, data = _run(_write(tmp_path, table=_table(distance=distance, sigma=sigma)))
    assert data["used"].values.tolist() == [0.0] + [1.0] * 15
    assert data["exponent"].item() == pytest.approx(2.0, abs=1e-6)
    folder = tmp_path / "out"
    result.write(folder, pdf=False)
    assert "(line 2 of the file), the camera as declared measures nothing" in (folder / "report.html").read_text(
        "utf-8"
    )


def test_absolute_errors_are_judged_as_normal_and_locking_is_named(tmp_path: Path) -> None:
    z = np.arange(3.0, 10.0, 0.05)
    d = 0.9 * 60.0 / z
    errors = np.abs(0.25 + 0.15 * np.sin(2.0 * np.pi * d + 1.0)) * z**2 / 60.0
    _, data = _run(path := _write(tmp_path, noise=0.3, table=_table(distance=z, absolute_error=errors)))
    assert data["ripple_scale"].item() == pytest.approx(0.9, abs=1e-4)
    assert data["ripple_product"].item() == pytest.approx(54.0, rel=1e-3)
    assert data["scale_verdict"].item() == "inconsistent"
    assert data["fitted_camera"].item().find("baseline: {value: 0.0675 m") > 0
    ratio = data["ratio"].sel(quantity="absolute_error", statistic="largest").item()
    assert ratio == pytest.approx(0.4 / (0.3 * MEAN_OF_NORMAL), rel=0.01)
    one = measured_tables(tradestudy.load(path).run().data)[0]
    assert "explains 100 %" in locking_words(one)
    assert any(row.verdict == "inconsistent" for row in implied_values(one))


def test_a_wrong_table_is_a_mistake_of_the_study(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"measurements\.wall\.file: .*too few rows"):
        tradestudy.load(_write(tmp_path, table="distance [m],sigma [mm]\n1,1\n2,4\n"))
    path = _write(tmp_path, table="")
    path.write_text(path.read_text("utf-8").replace("camera: rig", "camera: rigg"), encoding="utf-8")
    with pytest.raises(StudyError, match="no camera is called 'rigg'"):
        tradestudy.load(path)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (
            "distance [m],valid [%]\n1,99\n2,98\n3,97\n",
            "0.98 times the predicted one in the median (0.97 to 0.99) at 3",
        ),
        # Of the spread, only one row; the noise alone makes 0.2 px · (1 m)²/(60 px m) = 3.33 mm.
        (
            "distance [m],sigma [mm]\n1,10\n2,\n3,\n",
            "standard deviation of the rig is 3 times the predicted one at 1 m",
        ),
        (
            "distance [m],sigma [mm]\n1,10\n1,10\n2,40\n3,90\n",
            "is 3 times the predicted one at 3 distances from 1 to 3 m",
        ),
    ],
)
@pytest.mark.usefixtures("empty_figures")
def test_tables_without_a_law_get_a_report_of_what_they_tell(tmp_path: Path, table: str, said: str) -> None:
    result, _ = _run(_write(tmp_path, table=table))
    assert said in headline(result.data)
    result.write(tmp_path / "out", pdf=False)


@pytest.mark.parametrize(
    ("table", "drawn"),
    [
        ("distance [m],valid [%]\n1,99\n2,98\n3,97\n", False),
        ("distance [m],bias [mm]\n1,0\n2,0\n3,0\n", False),
        ("distance [m],bias [mm],valid [%]\n1,1,90\n2,0,0\n3,-2,0\n", True),
    ],
)
def test_a_table_gets_a_figure_if_it_has_an_error_to_mark(tmp_path: Path, table: str, drawn: bool) -> None:
    result, _ = _run(_write(tmp_path, table=table))
    drawings = all_drawings(result.data)
    assert (next(iter(drawings)) == "measured_wall") == drawn
    assert ("measured_wall" in drawings) == drawn
    if drawn:
        assert drawings["measured_wall"].draw().axes


def test_new_starts_a_study_from_a_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    sigma = NOISE * DISTANCES**2 / 60.0
    Path("wall 1's.csv").write_text(_table(distance=DISTANCES, sigma=sigma), encoding="utf-8")
    made = CliRunner().invoke(cli.app, ["new", "mine", "--from-measurements", "wall 1's.csv"])
    assert made.exit_code == 0, made.output
    study = tradestudy.load("mine.yaml").prepared
    assert study.file.measurements["wall"].file == "wall 1's.csv"
    assert study.case.distance[[0, -1]] == pytest.approx([0.54, 6.6])
    refused = CliRunner().invoke(cli.app, ["new", "two", "--stereo", "--from-measurements", "wall 1's.csv"])
    assert refused.exit_code == 2
    assert not Path("two.yaml").exists()


def test_errors_as_predicted_are_consistent_however_exact(tmp_path: Path) -> None:
    sigma = NOISE * DISTANCES**2 / 60.0
    for factor, verdict in ((1.0, "consistent"), (1.01, "inconsistent")):
        _, data = _run(_write(tmp_path, table=_table(distance=DISTANCES, sigma=factor * sigma)))
        assert data["noise_verdict"].item() == verdict


@pytest.mark.usefixtures("empty_figures")
def test_compare_says_that_other_measurements_change_the_answer(tmp_path: Path) -> None:
    sigma = NOISE * DISTANCES**2 / 60.0
    one, other = (
        _run(_write(tmp_path, table=_table(distance=DISTANCES, sigma=factor * sigma)))[0] for factor in (1.0, 2.0)
    )
    found = str(tradestudy.compare([one, other]))
    assert "answer changes" in found
    assert "is 2 times the predicted one" in found
    assert "1 measured table" in str(tradestudy.compare([one, one]))
