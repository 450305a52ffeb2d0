"""Candidates of cameras and of a light spot against what is known of them otherwise."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.special import ndtri
from typer.testing import CliRunner

from tradestudy import api
from tradestudy.answers import cost as candidates
from tradestudy.api import Study
from tradestudy.cli import app
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.picture import PictureDisparityError
from tradestudy.results import GROUPS

pytestmark = pytest.mark.usefixtures("empty_figures")

ROOT = Path(__file__).parents[2]
LAWS = ("no diffraction", "Airy diffraction", "Fresnel diffraction", "Kirchhoff diffraction")
F, B, PIXEL, ERROR_PX = 8e-3, 0.1, 10e-6, 0.1
YAW = np.deg2rad(0.2)
PAIR = f"""
format: 2
study: pair
title: One pair
question: What does its depth cost?
cameras:
  pair:
    kind: stereo
    title: Pair
    sensor: {{pixels: [1000, 1000], pixel_pitch: {PIXEL} m}}
    lenses: {{focal_length: {F} m, f_number: 4}}
    baseline: {B} m
    convergence_distance: inf
    focus_distance: inf
    depth: {{estimator: disparity, disparity_error: {ERROR_PX} px, discrimination_step: 0.1 px}}
    calibration: {{errors: {{yaw: {{standard_deviation: 0.2 deg}}}}}}
scene:
  distances: {{from: 0.5 m, to: 2 m, points: 5, spacing: log}}
  wavelength: 550 nm
usable_range: {{relative_uncertainty: 20 %}}
accuracy: {{tolerance: 5 %}}
"""


@pytest.fixture(scope="module", autouse=True)
def coarse_references() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(candidates, "_DRAWS", candidates._DRAWS[:2])  # the finest takes seconds
        yield


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Study:
    path = tmp_path_factory.mktemp("study") / "pair.yaml"
    path.write_text(PAIR, encoding="utf-8")
    return api.load(path)


@pytest.fixture(scope="module")
def cost(pair: Study) -> xr.Dataset:
    return pair.cost(budget=8.0)


def rows(cost: xr.Dataset) -> dict[str, dict[str, Any]]:
    return cost.drop_dims("problem").to_dataframe().set_index("models").to_dict("index")


def test_the_error_of_noise_alone_is_that_of_the_closed_forms(cost: xr.Dataset) -> None:
    """On the axis 1/Z changes by σ/(fB) with the disparity and by ψ/B with the yaw, up to ψ (x/f)² at x = fB/2Z."""
    distance = np.geomspace(0.5, 2.0, 5)
    noise = ERROR_PX * PIXEL / (F * B)
    yaw = YAW / B * (1.0 + (B / (2.0 * distance)) ** 2)

    def half_width(deviation: np.ndarray) -> np.ndarray:
        ends = [1.0 / (1.0 / distance + score * deviation) for score in ndtri([0.15865525, 0.84134475])]
        return (ends[0] - ends[1]) / 2.0

    expected = np.max(1.0 - half_width(np.full(5, noise)) / half_width(np.hypot(noise, yaw)))
    assert rows(cost)["noise alone"]["relative_error"] == pytest.approx(expected, rel=1e-3)


def test_every_propagation_model_is_listed_and_one_is_chosen(cost: xr.Dataset) -> None:
    found = rows(cost)
    assert set(found) == {
        "noise alone", "linear calibration",
        *(f"exact calibration, sampled to {to} %" for to in ("5", "1.5", "0.5", "0.15")),
    }  # fmt: skip
    assert [models for models, row in found.items() if row["chosen"]] == ["linear calibration"]
    assert float(cost["reference_error"][0]) < 1e-3
    for row in found.values():
        assert row["relative_error"] >= float(cost["reference_error"][0])
    assert found["exact calibration, sampled to 5 %"]["relative_error"] < 0.05
    assert {str(name): one.attrs["units"] for name, one in cost.data_vars.items()} == {
        name: variable.units for name, variable in GROUPS["cost"].items()
    }


def test_the_cost_of_a_forced_choice_and_of_the_next_digit_is_measured(pair: Study) -> None:
    forced = pair.with_values({"effects.calibration": "off"}).cost(budget=8.0)
    found = rows(forced)
    assert [models for models, row in found.items() if row["chosen"]] == ["noise alone"]
    assert [models for models, row in found.items() if row["next_digit"]] == ["linear calibration"]


def test_diffraction_models_are_measured_where_the_disparity_error_is_derived(pair: Study) -> None:
    """Without calibration errors depth is as uncertain as disparity, but for the curvature of 1/Z."""
    picture = {
        "texture": {"contrast": "15 %", "correlation_length": "2 mm"},
        "matching_window": "15 px",
        "light": {"electrons": "4000 electrons", "at_f_number": 11},
        "read_noise": "10 electrons",
        "full_well": "20000 electrons",
        "bit_depth": 12,
    }
    study = pair.with_values(
        {
            "cameras.pair.depth.disparity_error": "derived",
            "cameras.pair.lenses.f_number": 11,
            "cameras.pair.calibration": None,
            "scene.picture": picture,
        }
    )
    found = rows(study.cost(budget=4.0))
    assert set(found) == {f"{law}, noise alone" for law in (*LAWS[:-1], "every effect")}
    assert sum(row["chosen"] for row in found.values()) == 1
    camera = study.prepared.case.cameras["pair"]
    law = camera.disparity_error_px
    assert isinstance(law, PictureDisparityError)
    distance = np.geomspace(0.5, 2.0, 5)
    complete = replace(law, models=replace(law.models, main_lens_diffraction="kirchhoff")).error_px(camera, distance)
    plain = replace(law, models=replace(law.models, main_lens_diffraction="off")).error_px(camera, distance)
    expected = np.max(np.abs(plain / complete - 1.0))
    assert expected > 0.01
    assert found["no diffraction, noise alone"]["relative_error"] == pytest.approx(expected, rel=0.05)
    assert found["every effect, noise alone"]["relative_error"] < 0.2 * expected


def test_models_and_tolerances_of_a_light_spot_are_measured() -> None:
    small = (
        "light_spot.spot.diameter=20 um", "light_spot.methods=[geometric, fresnel]", "light_spot.tolerance=10 %",
        "light_spot.benchmarks=false", "light_spot.published_times=null", "light_spot.microlenses.lenses_across=1",
        "light_spot.detector.pixels=23", "accuracy.tolerance=10 %", "readings=null", "claims=null", "point_spread=null",
    )  # fmt: skip
    study = api.load(ROOT / "studies" / "light_spot.yaml", small)
    found = study.cost(budget=4.0)
    errors = {models: row["relative_error"] for models, row in rows(found).items()}
    assert any(models.startswith("Kirchhoff to") for models in errors)
    assert max(errors, key=lambda models: errors[models]).startswith("Paraxial rays")
    assert found["chosen"].values.sum() == 1


def test_a_camera_that_is_nowhere_usable_is_reported(pair: Study, tmp_path: Path) -> None:
    strict = pair.with_values({"usable_range.relative_uncertainty": "0.00001 %"})
    reported = api.cost(strict, tmp_path, budget=1.0)
    assert reported == ["Pair: usable at no distance of the study.", str(tmp_path / "cost.json")]


@pytest.mark.parametrize("budget", [0.0, float("inf")])
def test_a_budget_that_is_not_a_time_is_refused(pair: Study, budget: float) -> None:
    with pytest.raises(OutOfRangeError, match="such as 120"):
        pair.cost(budget=budget)


def test_too_little_time_is_named(pair: Study) -> None:
    found = pair.cost(budget=1e-9)
    assert found.sizes["entry"] == 0
    assert "the reference needs about" in str(found["left_out"].values[0])


def test_a_study_without_anything_to_measure_is_refused_before_it_is_computed(tmp_path: Path) -> None:
    study = api.load(ROOT / "studies" / "hard_cases.yaml")
    with pytest.raises(OutOfRangeError, match="hard-cases"):
        api.run(study, tmp_path, with_cost=True)
    assert not list(tmp_path.iterdir())


def test_the_command_reports_each_camera_and_leaves_a_run_alone(pair: Study, tmp_path: Path) -> None:
    file, out = tmp_path / "pair.yaml", tmp_path / "out"
    file.write_text(PAIR, encoding="utf-8")

    def invoke(*given: str) -> str:
        done = CliRunner().invoke(app, [*given, str(file), "--out", str(out)])
        assert done.exit_code == 0, done.output
        return done.stdout

    invoke("run", "--no-pdf")
    before = {path: path.read_bytes() for path in out.rglob("*.*") if path.name != ".tradestudy"}  # lists all files
    assert "What accuracy costs" not in (out / "report.html").read_text(encoding="utf-8")
    reported, figure = invoke("cost", "--budget", "2").splitlines()
    assert re.match(r"Pair: \d+(\.\d+)?\s[µm]?s for linear calibration", reported)
    assert figure == str(out / "cost.svg")
    assert {path: path.read_bytes() for path in before} == before
    assert {path.name for path in set(out.rglob("*.*")) - set(before)} == {"cost.json", "cost.svg", ".tradestudy"}
    summary = json.loads((out / "cost.json").read_text(encoding="utf-8"))
    assert sum(entry["chosen"] for entry in summary["entries"]) == 1
    assert summary["problems"][0]["title"] == "Pair"


def test_a_run_measures_it_on_request_and_a_later_report_shows_it(
    pair: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tradestudy.answers.cost.study_cost.__kwdefaults__", {"budget": 2.0})
    result = api.run(pair, tmp_path, pdf=False, with_cost=True)
    assert "cost" in result.data.children
    written = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "What accuracy costs" in written
    assert re.search(r"\d\s[µm]?s for linear calibration", written)
    assert (tmp_path / "figures" / "cost.svg").is_file()
    (tmp_path / "report.html").unlink()
    api.report(tmp_path, pdf=False)
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == written
