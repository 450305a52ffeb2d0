"""Refocusing as a question of a study: results, requirements, sweeps, thick lenses, refusals, and cameras in Python."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import tradestudy
from tradestudy.errors import OutOfRangeError, StudyError

CAMERAS = Path(__file__).parents[2] / "studies" / "cameras"
F, A0, PIXEL, F_L, PITCH = 12.5e-3, 0.15, 5.5e-6, 0.432e-3, 126.5e-6


def study(refocusing: Any = None, camera: Any = None, **others: Any) -> tradestudy.Study:
    """The unfocused R5, and its focused sister."""
    return tradestudy.Study.from_dict(
        {
            "cameras": {
                "r5": {"from": str(CAMERAS / "r5-unfocused.yaml"), **(camera or {})},
                "focused": {"from": str(CAMERAS / "raytrix-r5.yaml")},
            },
            "scene": {"distances": [0.02, 0.1, 0.25], "wavelength": 550e-9},
            **({} if refocusing is None else {"refocusing": refocusing}),
            **others,
        }
    )


def ran(*what: Any, **others: Any) -> xr.Dataset:
    return study(*what, **others).run().data["refocusing"].to_dataset()


def seen_apart(distance: float, width: float, f: float = F, a0: float = A0) -> float:
    """How far apart on the array rays through points of a thin lens ``width`` apart land, in microlenses."""
    z = 1.0 / (1.0 / f - 1.0 / a0)
    return width * z * (1.0 / distance - 1.0 / a0) / PITCH


def test_an_empty_section_asks_for_every_plane_of_every_unfocused_camera() -> None:
    found = ran({})
    assert found["camera"].values.tolist() == ["r5"]
    one = found.isel(camera=0)
    width = PIXEL / F_L / (1.0 / F - 1.0 / A0)  # of the pupil of a view
    assert int(one["planes"]) == found.sizes["plane"] == 21
    for k, distance in enumerate(one["refocused_distance"].values):
        assert seen_apart(distance, 18.0 * width) == pytest.approx(18 - k, abs=1e-9)
    assert float(one["near"]) == pytest.approx(float(one["refocused_distance"][0]), rel=1e-12)
    assert float(one["far"]) == math.inf
    np.testing.assert_allclose(one["pair_baseline"], [width, 18.0 * width], rtol=1e-12)
    np.testing.assert_allclose(one["pair_disparity_px"].isel(pair=1), np.arange(18.0, -3.0, -1.0), atol=1e-12)
    # Blurred by one microlens through the part of the pupil that the views use: f/3.8, measured on the array.
    pupil = F / 3.8
    for plane in range(18):
        at, near, far = (float(one[name][plane]) for name in ("refocused_distance", "blur_near", "blur_far"))
        if near > 0.05:
            assert seen_apart(near, pupil) - seen_apart(at, pupil) == pytest.approx(1.0, rel=1e-9)
        assert seen_apart(at, pupil) - seen_apart(far, pupil) == pytest.approx(1.0, rel=1e-9)


def test_listed_shifts_pairs_and_blur() -> None:
    found = ran({"shifts": [0.5, 1 / 3, -0.2], "pairs": [6], "blur": "0.25 px"}).isel(camera=0)
    assert found["shift"].values.tolist() == pytest.approx([0.5, 1 / 3, -0.2])
    assert found["refocused_distance"].values[2] == math.inf  # beyond infinity
    assert np.isnan(found["blur_far"].values[2])
    assert found["pair_disparity_px"].values[0] == pytest.approx([3.0, 2.0, -1.2])
    assert int(found["planes"]) == 7
    assert found.attrs["blur_px"] == 0.25


def test_a_thick_lens_counts_from_three_points() -> None:
    lens = {"principal_separation": -2e-3, "exit_pupil": -30e-3}
    found = ran({"shifts": [0, 0.5]}, {"main_lens": lens}).isel(camera=0)
    z, pupil = 1.0 / (1.0 / F - 1.0 / A0), 1.0 / (1.0 / -30e-3 - 1.0 / F)
    behind = 0.5 * PITCH / (PIXEL / F_L - 0.5 * PITCH / (z + 30e-3))  # where the views meet, behind the array
    expected = np.array([A0, 1.0 / (1.0 / F - 1.0 / (z + behind))])
    np.testing.assert_allclose(found["refocused_distance"], expected, rtol=1e-12)
    np.testing.assert_allclose(found["from_pupil"], expected + pupil, rtol=1e-12)
    np.testing.assert_allclose(found["from_array"], expected + z - 2e-3, rtol=1e-12)


def test_a_sweep_has_range_and_planes_of_every_design() -> None:
    found = ran({}, sweep={"r5.main_lens.f_number": [3.0, 3.8, 6.0]})
    for k, f_number in enumerate((3.0, 3.8, 6.0)):
        alone = ran({}, {"main_lens": {"f_number": f_number}})
        for name in ("planes", "near", "far"):
            assert found[f"design_{name}"].values[k] == pytest.approx(alone[name].values)
    assert found["design_planes"].values[:, 0].tolist() == [25, 21, 14]


def test_a_sweep_of_the_largest_blur_changes_range_and_planes() -> None:
    found = ran({}, sweep={"refocusing.blur": [0.25, 1.0]})
    for k, blur in enumerate((0.25, 1.0)):
        near = 1.0 / (1.0 / A0 + blur * PITCH / (PIXEL / F_L / (1.0 / F - 1.0 / A0)) * (1.0 / F - 1.0 / A0))
        assert float(found["design_near"][k, 0]) == pytest.approx(near, rel=1e-9)
    assert found["design_planes"].values[:, 0].tolist() == [7, 21]


def test_a_sensor_smaller_than_a_microlens_is_refused() -> None:
    with pytest.raises(StudyError, match=r"sensor is smaller than one microlens.*126\.5 um.*27\.5 um"):
        study({}, {"sensor": {"pixels": [5, 5]}})


@pytest.mark.parametrize(
    ("requirement", "met", "words"),
    [
        ({"camera": "any", "refocusing": {"over": [0.14, 0.16]}}, 1, "refocusable from 16.7 mm to ∞"),
        ({"camera": "r5", "refocusing": {"over": [0.01, 0.16]}}, 0, "not refocusable from 10 mm to 16.7 mm"),
        ({"camera": "all", "refocusing": {"planes": 21}}, 1, "21 distinct planes"),
        ({"camera": "all", "refocusing": {"planes": 22}}, 0, "21 distinct planes"),
        ({"camera": "r5", "refocused_depth_of_field": {"at": 0.15, "above": 0.1, "limits": "rays"}}, 1, "rays 164 mm"),
        ({"camera": "r5", "refocused_depth_of_field": {"at": 0.15, "below": 0.16}}, 1, "by blur 155 mm"),
        ({"camera": "r5", "refocused_depth_of_field": {"at": 0.15, "below": 0.15}}, 0, "by blur 155 mm"),
        ({"camera": "r5", "refocused_depth_of_field": {"at": 0.016, "below": 0.15}}, -1, "cannot refocus at 16 mm"),
    ],
)  # fmt: skip
def test_requirements(requirement: Any, met: int, words: str) -> None:
    data = study({}, requirements={"one": {"says": "it must", **requirement}}).run().data["requirements"].to_dataset()
    assert int(data["met"][0]) == met
    assert words in str(data["reason"].values[0])


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ({"refocusing": {"cameras": ["focused"]}}, "'focused' is a focused-plenoptic camera; only pictures of"),
        ({"refocusing": {"cameras": ["other"]}}, "no camera is called 'other'"),
        ({"refocusing": {"shifts": [0, 19]}}, "refocusing.shifts: r5: shift .*: 19 .*number of views.*shift less"),
        ({"refocusing": {"shifts": [1.4]}}, "1.4 .*below 1.372, which refocuses on the front focal point"),
        ({"refocusing": {"shifts": [math.inf]}}, "refocusing.shifts"),
        ({"refocusing": {"pairs": [19]}}, "refocusing.pairs: r5: pixels between two views: 19 .*1 to 18"),
        ({"refocusing": {"blur": 19}}, "refocusing.blur: r5: .*: 19 .*below 19"),
        (
            {"requirements": {"one": {"says": "x", "camera": "any", "refocusing": {"at": 0.1}}}},
            "needs the section refocusing",
        ),
        (
            {"refocusing": {}, "requirements": {"one": {"says": "x", "camera": "focused", "refocusing": {"at": 0.1}}}},
            "requirements.one.camera: 'focused' is a focused-plenoptic camera",
        ),
    ],
)  # fmt: skip
def test_wrong_uses_are_refused_at_their_place(what: Any, words: str) -> None:
    with pytest.raises(StudyError, match=words):
        study(**what)


def test_a_study_without_an_unfocused_camera_has_nothing_to_refocus() -> None:
    with pytest.raises(StudyError, match="refocusing: needs an unfocused plenoptic camera"):
        tradestudy.Study.from_dict(
            {
                "cameras": {"focused": {"from": str(CAMERAS / "raytrix-r5.yaml")}},
                "scene": {"distances": [0.02, 0.1], "wavelength": 550e-9},
                "refocusing": {},
            }
        )


def test_cameras_in_python_have_the_planes_of_a_run() -> None:
    one = study({})
    camera, run = one.cameras["r5"], one.run().data["refocusing"].to_dataset().isel(camera=0)
    found = camera.refocusing()
    for name in found:
        np.testing.assert_array_equal(found[name].values, run[name].values)
    assert found.attrs["planes"] == int(run["planes"])
    pair = camera.triangulation(6, [1.0, 0.0, -0.5])
    assert pair["distance"].values[1] == pytest.approx(A0, rel=1e-12)
    assert seen_apart(float(pair["distance"][0]), pair.attrs["baseline"]) == pytest.approx(1.0, rel=1e-9)
    assert camera.replace({"main_lens.f_number": 6.0}).refocusing().attrs["planes"] == 14


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda one: one["focused"].refocusing(), "plenoptic.*unfocused plenoptic cameras.*leave it out"),
        (lambda one: one["r5"].refocusing(math.inf), "inf .*number of views"),
        (lambda one: one["r5"].refocusing([0.0, -19.0]), "-19 .*number of views"),
        (lambda one: one["r5"].triangulation(19, 1.0), "19 .*1 to 18"),
        (lambda one: one["r5"].triangulation(1, 1.5), "1.5 .*front focal point"),
    ],
)
def test_wrong_uses_in_python_are_refused(call: Any, words: str) -> None:
    with pytest.raises(OutOfRangeError, match=words):
        call(study().cameras)
