"""Cameras in Python: the same numbers as a run, at any distance, and copies with other values."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pint
import pytest
import xarray as xr
from scipy.optimize import brentq, minimize

import tradestudy
from tests.study.test_python_studies import RIG, ROOT, STUDY
from tradestudy.errors import ImplausibleValueWarning, OutOfRangeError, StudyError, UnknownNameError

PLENOPTIC = {
    "kind": "focused-plenoptic",
    "main_lens": {"focal_length": 0.0125, "f_number": 3.8},
    "sensor": {"pixels": [2048, 2048], "pixel_pitch": 5.5e-6},
    "microlenses": {"layout": "hexagonal", "pitch": 126.5e-6, "types": 3, "gap": "f-number-matching"},
    "focus": {"total_covering_plane": 0.15, "relay": "keplerian"},
    "depth": {"estimator": "same-type-pair", "disparity_error": 0.1, "discrimination_step": 0.1},
    "calibration": {"errors": {"mla_distance": {"standard_deviation": 1e-6}}},
}
VALUES = {key: value for key, value in RIG.items() if key != "kind"}
UNIFORM = {**RIG, "calibration": {"errors": {"yaw": {"half_width": 1e-3}}}}
SCENE = {"distances": {"from": 0.2, "to": 5.0, "points": 12}, "wavelength": 550e-9}
LIMITS = {"relative_uncertainty": 0.05, "overlap": 0.5}
SMALL = {
    **STUDY,
    "cameras": {"rig": RIG, "drawn": UNIFORM, "plenoptic": PLENOPTIC},
    "scene": SCENE,
    "usable_range": LIMITS,
}


@pytest.fixture(scope="module")
def study() -> tradestudy.Study:
    return tradestudy.load(SMALL)


@pytest.fixture(scope="module")
def data(study: tradestudy.Study) -> xr.DataTree:
    return study.run().data


@pytest.mark.parametrize("name", ["rig", "drawn", "plenoptic"])
def test_depth_is_that_of_a_run(study: tradestudy.Study, data: xr.DataTree, name: str) -> None:
    depth, camera = data["depth"].to_dataset().sel(camera=name), study.cameras[name]
    assert camera.models["calibration"] == {"rig": "linear", "drawn": "exact", "plenoptic": "off"}[name]
    distance = depth["distance"].to_numpy()
    for errors in ("noise", "calibration", "both"):
        of_errors = depth.sel(error_source=errors)
        for found, variable in (
            (camera.depth_uncertainty(distance, errors), "depth_uncertainty_by_error_source"),
            (camera.depth_error_radius(distance, errors), "depth_error_radius_by_error_source"),
            (camera.failed_fraction(distance, errors), "failed_fraction"),
            (camera.quantiles(distance, errors), "depth_quantile"),
        ):
            xr.testing.assert_allclose(found.variable, of_errors[variable].variable, rtol=1e-12, atol=0.0)
    parts = camera.parts(distance)
    for part in parts["part"].to_numpy():
        expected = depth["variance_share"].sel(part=part).to_numpy()
        np.testing.assert_allclose(parts.sel(part=part), expected, rtol=1e-12)
    ranges = camera.usable_range()
    for variable in ("usable_near", "usable_far", "near_limit", "far_limit"):
        assert list(ranges[variable].to_numpy()) == list(depth[variable].to_numpy()[: ranges.sizes["interval"]])
    assert not depth["usable_near"][ranges.sizes["interval"] :].notnull().any()


@pytest.mark.parametrize("name", ["rig", "plenoptic"])
def test_properties_are_those_of_a_run(study: tradestudy.Study, data: xr.DataTree, name: str) -> None:
    row, camera = data["cameras"].to_dataset().sel(camera=name), study.cameras[name]
    assert float(row["field_of_view"]) == camera.field_of_view[0]
    assert (float(row["pixels_across"]), float(row["pixels_down"])) == camera.pixels
    for variable in ("focal_length", "f_number", "baseline", "pixel_pitch"):
        assert float(row[variable]) == getattr(camera, variable)
    assert camera.pupil_diameter == camera.focal_length / camera.f_number
    assert (camera.kind, camera.title) == (str(row["kind"].item()), str(row["title"].item()))


def test_a_changed_camera_has_the_depth_of_a_run_of_the_changed_study() -> None:
    """The first copy is validated with its study, the second by itself."""
    alone = {**SMALL, "cameras": {"rig": RIG}}
    rig = tradestudy.load(alone).cameras["rig"]
    run = tradestudy.load({**alone, "cameras": {"rig": {**RIG, "baseline": 0.07}}}).run().data["depth"].to_dataset()
    for changed in (rig.replace(baseline=0.07), rig.replace(baseline=0.05).replace({"baseline": 0.07})):
        found = changed.depth_uncertainty(run["distance"].to_numpy())
        np.testing.assert_allclose(found, run["depth_uncertainty"].sel(camera="rig"), rtol=1e-12)
    assert rig.baseline == 0.1


def test_results_have_the_shape_of_the_distances(study: tradestudy.Study) -> None:
    rig = study.cameras["rig"]
    alone = rig.depth_uncertainty(1.0)
    assert alone.shape == ()
    assert alone.attrs["units"] == "m"
    assert rig.quantiles(1.0).dims == ("quantile",)
    grid = np.geomspace(0.5, 4.0, 6).reshape(2, 3)
    found = rig.depth_uncertainty(grid)
    assert found.shape == (2, 3)
    assert np.array_equal(found["distance"], grid)
    np.testing.assert_allclose(found[1, 2], rig.depth_uncertainty(4.0), rtol=1e-12)
    assert rig.parts(grid).shape == (2, 3, rig.parts(1.0).sizes["part"])
    assert rig.depth_uncertainty([]).shape == (0,)
    in_mm = xr.DataArray([500.0, 1000.0], dims="place", coords={"place": ["a", "b"]}, attrs={"units": "mm"})
    assert float(rig.depth_uncertainty(in_mm).sel(place="b")) == pytest.approx(float(alone), rel=1e-12)
    units = pint.UnitRegistry()
    assert float(rig.depth_uncertainty(units.Quantity(100.0, "cm"))) == float(alone) == rig.depth_uncertainty("1 m")
    for each_with_its_unit in (["50 cm", "1 m"], [units.Quantity(50, "cm"), units.Quantity(1.0, "m")]):
        np.testing.assert_array_equal(rig.depth_uncertainty(each_with_its_unit)["distance"], [0.5, 1.0])
    held = xr.DataArray(units.Quantity(np.array([50.0, 100.0]), "cm"), dims="z")
    np.testing.assert_array_equal(rig.depth_uncertainty(held)["distance"], [0.5, 1.0])


@pytest.mark.parametrize(
    "distance", [0.0, -1.0, np.nan, np.inf, "1", "1 px", [0.5, -0.5], ["1 m", 2.0], [1.0, None], None]
)
def test_refuses_what_is_no_distance(study: tradestudy.Study, distance: Any) -> None:
    with pytest.raises(
        OutOfRangeError, match="^distance: None .allowed: positive and finite" if distance is None else "distance"
    ):
        study.cameras["rig"].depth_uncertainty(distance)


def test_names_the_cameras_where_one_is_not_known(study: tradestudy.Study) -> None:
    with pytest.raises(UnknownNameError, match=r"'rigg' \(allowed: 'rig', 'drawn', 'plenoptic'\); nearest: 'rig'"):
        study.cameras["rigg"]
    assert study.cameras.get("rigg") is None
    assert list(study.cameras) == ["rig", "drawn", "plenoptic"]
    assert study.cameras["rig"] is study.cameras["rig"]


def test_replaces_values_by_path_keyword_and_nested_dictionary(study: tradestudy.Study) -> None:
    rig = study.cameras["rig"]
    units = pint.UnitRegistry()
    forms = (
        rig.replace({"lenses.f_number": 4.0}),
        rig.replace(lenses={"f_number": 4.0}),
        rig.replace(lenses={"f_number": np.float64(4.0)}).replace(baseline=units.Quantity(10, "cm")),
        rig.replace({"lenses.f_number": 5.0}).replace({"lenses.f_number": 4.0}),
    )
    for changed in forms:
        assert (changed.f_number, changed.focal_length, changed.baseline) == (4.0, 0.008, 0.1)
        assert changed.values["lenses"]["f_number"] == 4.0
    view = rig.replace({"lenses.focal_length": None, "lenses.field_of_view": 1.0, "lenses.across": "width"})
    assert view.field_of_view[0] == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(
    "value", [np.array([0.2]), np.array(0.2), np.array([[0.2]]), xr.DataArray([20.0], attrs={"units": "cm"})]
)
def test_arrays_with_one_element_are_single_values_as_solvers_pass_them(study: tradestudy.Study, value: Any) -> None:
    rig = study.cameras["rig"]
    for _ in range(2):  # validated with its study, then by itself
        assert (
            rig.replace(baseline=value).baseline
            == rig.replace({"baseline": value, "focus_distance": value}).baseline
            == 0.2
        )
    assert study.with_values({"rig.baseline": value}).cameras["rig"].baseline == 0.2
    assert study.with_values({"rig.depth.disparity_error": 0.2, "rig.baseline": value}) == study.with_values(
        {"rig.depth.disparity_error": np.array([0.2]), "rig.baseline": 0.2}
    )


def test_implausible_values_from_python_are_warned_about_once_at_the_line_of_the_user() -> None:
    unusual = {**RIG, "baseline": 75.0}
    message = "cameras.{}.baseline: 75 m is unusual .*did you mean 75"
    for name, make in (
        ("rig", lambda: tradestudy.load({**STUDY, "cameras": {"rig": unusual}})),
        ("rig", lambda: tradestudy.Study.from_dict({**STUDY, "cameras": {"rig": unusual}})),
        ("stereo", lambda: tradestudy.camera("stereo", **{**VALUES, "baseline": 75.0})),
        ("rig", lambda: tradestudy.load(STUDY).with_values({"rig.baseline": 75.0})),
        ("rig", lambda: tradestudy.load(STUDY).cameras["rig"].replace(baseline=75.0)),
        ("rig", lambda: tradestudy.load(STUDY).cameras["rig"].replace(baseline=0.2).replace(baseline=75.0)),
    ):
        with pytest.warns(ImplausibleValueWarning, match=message.format(name)) as warned:
            made = make()
        assert [one.filename for one in warned] == [__file__]
    with pytest.warns(ImplausibleValueWarning, match="f_number: 0.5 is unusual") as warned:
        made.replace(baseline=76.0).replace({"lenses.f_number": 0.5}).replace({"lenses.f_number": 0.6})
    assert len(warned) == 1
    measured = {"value": 75.0, "basis": "measured"}
    assert not tradestudy.load({**STUDY, "cameras": {"rig": {**RIG, "baseline": measured}}}).warnings


def test_arrays_with_more_elements_are_pointed_to_sweeps(study: tradestudy.Study) -> None:
    message = r"^baseline: \[0.1, 0.2\] \(allowed: one value\); Study.sweep computes depth for several values"
    with pytest.raises(OutOfRangeError, match=message):
        study.cameras["rig"].replace(baseline=np.array([0.1, 0.2]))
    with pytest.raises(OutOfRangeError, match=r"^rig\.baseline: .*Study\.sweep"):
        study.with_values({"rig.baseline": np.array([0.1, 0.2])})
    assert study.cameras["rig"].replace({"sensor.pixels": np.array([640, 480])}).pixels == (640, 480)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"baseline": -0.1}, "^cameras.rig.baseline: '-0.1 m' is out of range; a length above 0 m is expected"),
        ({"basline": 0.1}, "^cameras.rig.basline: unknown key; nearest: 'baseline'"),
        ({"f_number": 4.0}, "^cameras.rig.f_number: unknown key here; nearest: 'lenses.f_number'$"),
        ({"pixelpitch": 3e-6}, "^cameras.rig.pixelpitch: unknown key here; nearest: 'sensor.pixel_pitch'$"),
        ({"texture": 3e-6}, "^cameras.rig.texture: unknown key$"),
        ({"baseline": "5 px"}, "^cameras.rig.baseline: '5 px' is a number of pixels; a length is expected"),
        ({"lenses.f_number": "wide"}, "^cameras.rig.lenses.f_number: 'wide' is not a quantity"),
        ({"focus_distance": 0.001}, "^cameras.rig: the lenses cannot focus that close: 1 mm"),
        ({"calibration.errors.baseline.standard_deviation": 0.5}, "cameras.rig.*deviation of baseline by one"),
    ],
)
def test_mistakes_speak_of_the_path_the_first_and_the_second_time(
    study: tradestudy.Study, changes: dict[str, Any], message: str
) -> None:
    for _ in range(2):
        rig = study.cameras["rig"].replace({"baseline": 0.1, "focus_distance": 1.0})
        rig.replace({"lenses.f_number": 4.0, "calibration.errors.baseline.standard_deviation": 1e-4})
        with pytest.raises(StudyError, match=message):
            rig.replace(changes).depth_uncertainty(1.0)


def test_a_single_camera_needs_no_study() -> None:
    rig = tradestudy.camera("stereo", **VALUES)
    assert float(rig.depth_uncertainty(1.0)) == pytest.approx(
        float(tradestudy.load(STUDY).cameras["rig"].depth_uncertainty(1.0)), rel=1e-12
    )
    with pytest.raises(StudyError, match=r"^cameras.stereo.baseline: "):
        tradestudy.camera("stereo", **{**VALUES, "baseline": "1 px"})
    with pytest.raises(StudyError, match=r"kind: 'sterio' is unknown.*nearest: 'stereo'"):
        tradestudy.camera("sterio", **VALUES)
    limited = tradestudy.camera("stereo", scene=SCENE, usable_range=LIMITS, **VALUES)
    expected = tradestudy.load(SMALL).cameras["rig"].usable_range()
    xr.testing.assert_identical(limited.usable_range(), expected)


def test_a_dictionary_with_its_kind_makes_a_camera() -> None:
    named, placed = tradestudy.camera(**RIG), tradestudy.camera("stereo", **VALUES)
    assert float(named.depth_uncertainty(1.0)) == float(placed.depth_uncertainty(1.0))
    with pytest.raises(TypeError, match=r"text, not a dict; write camera\(\*\*values\)"):
        tradestudy.camera(RIG)  # type: ignore[arg-type]


def test_cameras_of_all_kinds_can_be_made_alone() -> None:
    """With the scene of a study that asks no more of them, they choose the same models."""
    study = tradestudy.load(ROOT / "studies" / "rock_scene.yaml")
    scene = {key: value for key, value in study.definition.document.tree["scene"].items() if key != "image"}
    for declared in study.cameras.values():
        values = {key: value for key, value in declared.values.items() if key != "kind"}
        camera = tradestudy.camera(declared.kind, scene=scene, **values)
        assert camera.focal_length == declared.focal_length
        if camera.kind != "conventional":
            assert float(camera.depth_uncertainty(0.1)) == float(declared.depth_uncertainty(0.1))
    assert {one.kind for one in study.cameras.values()} == {
        "stereo",
        "focused-plenoptic",
        "unfocused-plenoptic",
        "conventional",
    }


def test_a_camera_without_depth_says_so() -> None:
    lens = {"lens": {"focal_length": 0.05, "f_number": 4.0}, "focus": {"distance": 1.0}}
    sensor = {"pixels": [1000, 1000], "pixel_pitch": 5e-6}
    camera = tradestudy.camera("conventional", sensor=sensor, **lens)
    assert camera.focal_length == 0.05
    assert np.isnan(camera.baseline)
    with pytest.raises(OutOfRangeError, match="conventional camera 'conventional' measures no depth"):
        camera.depth_uncertainty(1.0)


def test_a_solver_of_scipy_finds_the_baseline() -> None:
    """For noise alone, the half width of a pair of parallel axes falls as 1/B; the solver finds where it is 1 %."""
    rig = tradestudy.load(STUDY).cameras["rig"]

    def excess(baseline: float) -> float:
        return float(rig.replace(baseline=baseline).depth_uncertainty(2.0)) - 0.02

    found = brentq(excess, 0.02, 0.5, xtol=1e-9)
    assert excess(found) == pytest.approx(0.0, abs=1e-9)
    assert excess(0.9 * found) > 0.0


def test_scipy_minimises_with_its_default_steps() -> None:
    """Noise in the uncertainty would end the search early: gradients come from steps of 1e-8 in the baseline."""
    rig = tradestudy.load(STUDY).cameras["rig"]

    def cost(baseline: Any) -> float:
        return 1e3 * float(rig.replace(baseline=baseline).depth_uncertainty(2.0)) + 100.0 * float(baseline[0])

    found = minimize(cost, [0.05], bounds=[(0.02, 0.5)])
    assert found.success
    assert found.nfev < 100
    # Without other terms, a/B + 100 B is least at √(a/100), and a = 1e3 B × uncertainty hardly changes.
    at_best = 1e3 * 0.1 * float(rig.replace(baseline=0.1).depth_uncertainty(2.0))
    assert found.x[0] == pytest.approx(np.sqrt(at_best / 100.0), rel=1e-3)
    near = [cost(np.array([0.1 * (1.0 + 1e-9 * step)])) for step in range(40)]
    line = np.polyval(np.polyfit(np.arange(40), near, 1), np.arange(40))
    assert np.std(near - line) < 1e-11 * near[0]


def test_one_distance_has_the_draws_of_many(tmp_path: Path) -> None:
    """Rows of a posterior move depth at all distances nearly alike, so that rounding decides in careless fits."""
    names = ["yaw", "baseline", "focal_length", "principal_point"]
    rows = 1e-4 * np.random.default_rng(3).exponential(size=(2000, 4)) - 1e-4
    text = {"header": ",".join(names), "delimiter": ",", "comments": ""}
    np.savetxt(tmp_path / "draws.csv", rows * [1.0, 1.0, 1.0, 0.1], **text)
    study = {**STUDY, "cameras": {"rig": {**RIG, "calibration": {"posterior": {"file": str(tmp_path / "draws.csv")}}}}}
    rig = tradestudy.load({**study, "scene": SCENE, "effects": {"calibration": "exact"}}).cameras["rig"]
    distance = np.geomspace(0.3, 4.0, 23)
    together, alone = rig.depth_uncertainty(distance), [float(rig.depth_uncertainty(one)) for one in distance]
    assert rig.models["calibration"] == "exact"
    np.testing.assert_allclose(alone, together, rtol=1e-12)


def test_twenty_evaluations_with_a_changed_value_are_fast() -> None:
    """About 0.02 s of processor time, some times as much on a busy machine; a study of its own would take 0.2 s."""
    rig = tradestudy.load(ROOT / "studies" / "plenoptic_vs_stereo.yaml").cameras["stereo-short"]
    rig.replace(baseline=0.02).depth_uncertainty(0.5)
    seconds = []
    for number in range(5):
        begin = time.process_time()
        for step in range(20):
            rig.replace(baseline=0.02 + 1e-4 * step + 1e-6 * number).depth_uncertainty(0.5)
        seconds.append(time.process_time() - begin)
    assert min(seconds) < 0.1


def test_an_empty_scene_is_not_the_default_one() -> None:
    with pytest.raises(StudyError, match="scene"):
        tradestudy.camera("stereo", scene={})
