"""Studies made, changed, written and sent from Python."""

from __future__ import annotations

import io
import pickle
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pint
import pytest
import xarray as xr

import tradestudy
from tradestudy.errors import OutOfRangeError, StudyError, TradestudyError, UnknownNameError
from tradestudy.study.varying import question_ends, sweep_axes

ROOT = Path(__file__).parents[2]
STUDIES = sorted((ROOT / "studies").glob("*.yaml"))
RIG: dict[str, Any] = {
    "kind": "stereo",
    "baseline": 0.1,
    "focus_distance": "autofocus",
    "principal_distance": "focal_length",  # at every focus
    "lenses": {"focal_length": 0.008, "f_number": 8},
    "sensor": {"pixels": [1024, 1024], "pixel_pitch": 1e-5},
    "depth": {"disparity_error": 0.1, "discrimination_step": 0.1},
    "calibration": {"errors": {"yaw": {"standard_deviation": 1e-4}}},
}
STUDY: dict[str, Any] = {
    "format": 2,
    "study": "small",
    "title": "A rig",
    "question": "How well does it measure?",
    "cameras": {"rig": RIG},
    "scene": {"distances": [0.5, 1.0, 2.0], "wavelength": 550e-9},
}
TEXT = """
format: 2
study: small
title: A rig
question: How well does it measure?
cameras:
  rig:
    kind: stereo
    baseline: 10 cm
    focus_distance: autofocus
    lenses: {focal_length: 8 mm, f_number: 8}
    sensor: {pixels: [1024, 1024], pixel_pitch: 10 um}
    depth: {disparity_error: 0.1 px, discrimination_step: 0.1 px}
    calibration: {errors: {yaw: {standard_deviation: 0.1 mrad}}}
scene: {distances: [0.5 m, 1 m, 200 cm], wavelength: 550 nm}
"""


def with_rig(**changes: Any) -> dict[str, Any]:
    return {**STUDY, "cameras": {"rig": {**RIG, **changes}}}


def test_numbers_of_a_dictionary_are_in_si() -> None:
    study = tradestudy.Study.from_dict(STUDY)
    assert study == tradestudy.load(io.StringIO(TEXT)) == tradestudy.load(STUDY)
    assert hash(study) == hash(tradestudy.load(io.StringIO(TEXT)))
    with pytest.raises(OutOfRangeError, match=r"a text of several lines .*; load\(io.StringIO\(text\)\) reads text"):
        tradestudy.load(TEXT)
    assert study.cameras["rig"].baseline == 0.1


def test_a_number_is_in_metres_where_pixels_are_possible_too() -> None:
    rig = tradestudy.Study.from_dict(with_rig(lenses={"focal_length": 0.012, "f_number": 8.0})).cameras["rig"]
    assert rig.focal_length == 0.012


def test_arrays_and_quantities_of_pint_are_values() -> None:
    units = pint.UnitRegistry()
    scene = {"distances": np.array([0.5, 1.0, 2.0]), "wavelength": units.Quantity(0.55, "um")}
    lenses = {"focal_length": units.Quantity(8, "mm"), "f_number": np.float64(8.0)}
    errors = {"yaw": {"standard_deviation": units.Quantity(0.1, "millirad")}}
    rig = with_rig(baseline=units.Quantity(10.0, "cm"), lenses=lenses, calibration={"errors": errors})
    study = tradestudy.Study.from_dict({**rig, "scene": scene})
    assert study == tradestudy.load(STUDY)
    in_array = {**scene, "distances": units.Quantity(np.array([50.0, 100.0, 200.0]), "cm")}
    assert tradestudy.Study.from_dict({**STUDY, "scene": in_array}) == study


def test_many_distances_are_read_in_time_that_grows_with_their_number() -> None:
    study = tradestudy.load({**STUDY, "scene": {"distances": np.linspace(0.5, 5.0, 5_000), "wavelength": 550e-9}})
    assert study.prepared.case.distance.size == 5_000


def test_with_values_takes_numbers_in_si_and_the_record_has_their_unit() -> None:
    study = tradestudy.load(STUDY)
    changed = study.with_values({"rig.baseline": 0.05, "scene.distances": np.array([0.25, 0.5])})
    assert changed == study.with_values({"rig.baseline": "50 mm", "scene.distances": "[25 cm, 0.5 m]"})
    assert "cameras.rig.baseline=0.05m" in changed.folder_name
    assert study.cameras["rig"].baseline == 0.1


def test_values_without_paths_are_refused() -> None:
    with pytest.raises(TypeError, match="values by their paths are expected"):
        tradestudy.load(STUDY).with_values("stereo-50mm.baseline=60 mm")  # type: ignore[arg-type]


def test_changed_cameras_keep_their_titles() -> None:
    titled = {**RIG, "title": "Rig"}
    study = tradestudy.load({**STUDY, "cameras": {"a": RIG, "b": titled, "c": titled}})
    moved = study.with_values({"a.baseline": 0.3, "b.baseline": 0.3})
    assert [camera.title for camera in moved.cameras.values()] == ["a", "Rig (b)", "Rig (c)"]
    assert moved != study == moved.with_values({f"{name}.baseline": RIG["baseline"] for name in "ab"})
    renamed = study.with_values({"b.title": "a"})
    assert [camera.title for camera in renamed.cameras.values()] == ["a (a)", "a (b)", "Rig"]
    assert study.cameras["a"].replace({"sensor.pixels": [640, 480]}).title == "a"


def test_the_record_of_a_run_says_where_the_study_came_from() -> None:
    record = tradestudy.load(STUDY).with_values({"rig.baseline": 0.05}).run().run_record
    assert record["file"] == "a dictionary"
    assert record["options"] == ["--set", "cameras.rig.baseline=0.05 m"]


def test_varied_values_are_in_si_too() -> None:
    varied: dict[str, Any] = {
        "requirements": {
            "fine": {"says": "fine", "camera": "rig", "depth_uncertainty": {"below_relative": 0.01, "at": 1}}
        },
        "sweep": {"rig.baseline": np.array([0.05, 0.2]), "rig.lenses.f_number": {"from": 4, "to": 8, "points": 2}},
        "readings": {"far": {"says": "far", "set": {"rig.baseline": 0.3}}},
        "solve": {"base": {"says": "base", "vary": "rig.baseline", "low": 0.02, "high": 0.3, "requirement": "fine"}},
    }
    for same in (tradestudy.load({**STUDY, **varied}), tradestudy.load(STUDY).with_values(varied)):
        assert [axis.labels for axis in sweep_axes(same.prepared)] == [(0.05, 0.1, 0.2), (4.0, 8.0)]
        assert same.prepared.readings["far"].case.cameras["rig"].baseline == 0.3
        assert question_ends(same.file.solve["base"])[1:] == (0.02, 0.3)
    with pytest.raises(StudyError, match=r"sweep.rig.baseline: .*'0.05' has no unit"):
        tradestudy.load(STUDY, ["sweep={rig.baseline: [0.05]}"])


def test_a_dictionary_needs_no_name_title_or_question_but_a_file_does() -> None:
    study = tradestudy.load({"cameras": {"rig": RIG}, "scene": STUDY["scene"]})
    assert study.name == "study"
    assert (study.file.title, study.file.question) == ("A study from Python", "Which results do these values give?")
    assert tradestudy.load(io.StringIO(study.to_yaml())) == study
    for key in ("format", "study", "title", "question"):
        with pytest.raises(StudyError, match=rf"{key}: this key is missing"):
            tradestudy.load(
                io.StringIO("\n".join(line for line in TEXT.splitlines() if not line.startswith(f"{key}:")))
            )


def test_the_command_line_still_needs_units() -> None:
    with pytest.raises(StudyError, match=r"rig.baseline: '0.05' has no unit; a length is expected"):
        tradestudy.load(STUDY, ["rig.baseline=0.05"])


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"sweep": {"rig.baseline": [0.1, 0.1]}}, "sweep: rig.baseline: 0.1 m is given twice; give each value once"),
        ({"sweep": {"rig.baseline": ["5 cm", "50 mm"]}}, "sweep: rig.baseline: 50 mm is given twice"),
        ({"sweep": {"rigg.baseline": ["0.1 m"]}}, "sweep.rigg.baseline: "),
        (
            {"readings": {"far": {"says": "far", "set": {"rig.baseline": "-1 m"}}}},
            "cameras.rig.baseline: in reading 'far': '-1 m'",
        ),
    ],
)
def test_with_values_refuses_what_load_refuses(values: dict[str, Any], message: str) -> None:
    for refused in (lambda: tradestudy.load({**STUDY, **values}), lambda: tradestudy.load(STUDY).with_values(values)):
        with pytest.raises(StudyError) as refusal:
            refused()
        assert str(refusal.value).startswith(message)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"baseline": -0.1}, "cameras.rig.baseline: '-0.1 m' is out of range; a length above 0 m is expected"),
        ({"basline": 0.1}, "cameras.rig.basline: unknown key; nearest: 'baseline'"),
        ({"sensor": {"pixels": "1024", "pixel_pitch": 1e-5}}, "cameras.rig.sensor.pixels: '1024' is given; a list"),
        ({"lenses": {"focal_length": "1 px/m", "f_number": 8}}, "cameras.rig.lenses.focal_length: '1 px/m' is"),
    ],
)
def test_mistakes_speak_of_the_path_alone(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(StudyError) as refusal:
        tradestudy.load(with_rig(**changes))
    assert str(refusal.value).startswith(message)


def test_a_dictionary_makes_a_study_by_from_dict_alone() -> None:
    with pytest.raises(TypeError, match=r"Study.from_dict and tradestudy.load make a study from a dictionary"):
        tradestudy.Study(STUDY)  # type: ignore[arg-type]


def test_a_text_is_no_list() -> None:
    with pytest.raises(StudyError, match=r"^scene.distances: '0.5 m' is given; a (list|mapping)"):
        tradestudy.load({**STUDY, "scene": {"distances": "0.5 m", "wavelength": 550e-9}})
    with pytest.raises(OutOfRangeError, match=r"overrides: 'rig.baseline=5 cm' \(allowed: a list of texts\)"):
        tradestudy.load(STUDY, "rig.baseline=5 cm")
    with pytest.raises(OutOfRangeError, match="a study: list"):
        tradestudy.load([STUDY])  # type: ignore[arg-type]


def test_places_in_a_stream_are_those_of_its_text() -> None:
    with pytest.raises(StudyError, match=r"^text:9:15: cameras.rig.baseline: '10 px' is a number of pixels"):
        tradestudy.load(io.StringIO(TEXT.replace("10 cm", "10 px")))


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_yaml_reads_back_as_an_equal_study(path: Path) -> None:
    study = tradestudy.load(path)
    again = tradestudy.load(io.StringIO(study.to_yaml()))
    assert again == study
    assert hash(again) == hash(study)
    assert again.definition.document.annotations == study.definition.document.annotations


def test_yaml_keeps_text_that_looks_like_something_else() -> None:
    odd = [
        "null",
        "1e3",
        "yes: no",
        "a # b",
        " x ",
        "it's",
        'say "no"',
        "two\nlines",
        "µ",
        "\U0001f600\u2028",
        "- a",
        "*a",
    ]
    for text in odd:
        study = tradestudy.load({**STUDY, "title": text, "cameras": {"rig": {**RIG, "note": text}}})
        assert tradestudy.load(io.StringIO(study.to_yaml())) == study, text


def test_yaml_has_the_values_set_and_the_tolerance() -> None:
    study = tradestudy.load(STUDY, ["rig.baseline=5 cm"], tolerance="2 %")
    again = tradestudy.load(io.StringIO(study.to_yaml()))
    assert again == study != tradestudy.load(STUDY)
    assert again.cameras["rig"].baseline == 0.05


def test_studies_differ_by_values_bases_and_order() -> None:
    study = tradestudy.load(STUDY)
    basis = {"value": 0.1, "basis": "measured", "note": "by us"}
    others = [with_rig(baseline=0.2), with_rig(baseline=basis), {**STUDY, "study": "other"}]
    assert all(tradestudy.load(one) != study for one in others)
    assert study != STUDY
    assert len({study, tradestudy.load(STUDY), *map(tradestudy.load, others)}) == 4


def _uncertainty(study: tradestudy.Study) -> float:
    return float(study.cameras["rig"].depth_uncertainty(1.0))


def test_studies_and_cameras_pickle() -> None:
    study = tradestudy.load(STUDY, tolerance="2 %")
    copy = pickle.loads(pickle.dumps(study))
    assert copy == study
    assert copy.folder_name == study.folder_name
    rig = study.cameras["rig"].replace(baseline=0.2).replace(baseline=0.3)
    again = pickle.loads(pickle.dumps(rig))
    assert again.baseline == 0.3
    assert float(again.depth_uncertainty(1.0)) == float(rig.depth_uncertainty(1.0))


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_every_study_pickles(path: Path) -> None:
    study = tradestudy.load(path)
    assert pickle.loads(pickle.dumps(study)) == study


def test_processes_map_over_studies() -> None:
    studies = [tradestudy.load(with_rig(baseline=baseline)) for baseline in (0.05, 0.1, 0.2)]
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        found = list(pool.map(_uncertainty, studies))
    assert found == [_uncertainty(study) for study in studies]


@pytest.fixture(scope="module")
def two_rigs() -> dict[str, Any]:
    return {**STUDY, "cameras": {"rig": RIG, "other": {**RIG, "baseline": 0.2}}}


VARIABLES = ("depth_uncertainty", "depth_quantile", "depth_error_radius", "failed_fraction", "usable")


def test_a_sweep_has_the_depth_of_a_run(two_rigs: dict[str, Any]) -> None:
    baselines, wide = [0.08, 0.05, 0.15], [4.0, 8.0]
    swept = {"rig.baseline": baselines, "rig.lenses.f_number": wide}
    found = tradestudy.load(two_rigs).sweep(swept, VARIABLES)
    assert found["depth_uncertainty"].dims == ("baseline", "f_number", "camera", "distance")
    assert list(found["baseline"].to_numpy()) == baselines
    assert found["baseline"].attrs == {"units": "m", "long_name": "baseline", "path": "rig.baseline"}
    run = tradestudy.load(
        {**two_rigs, "sweep": {"rig.baseline": ["8 cm", "50 mm", "0.15 m"], "rig.lenses.f_number": wide}}
    )
    depth = run.run().data["depth"].to_dataset()
    for name in VARIABLES:
        expected = depth[name].sel(baseline=baselines, f_number=wide)
        if "error_source" in expected.dims:
            expected = expected.sel(error_source="both")
        np.testing.assert_allclose(found[name].astype(float), expected.astype(float), rtol=1e-12, err_msg=name)
    assert set(tradestudy.load(two_rigs).sweep(swept).data_vars) == {"depth_uncertainty", "depth_quantile"}


def test_a_sweep_takes_plain_numbers_with_all_their_digits(two_rigs: dict[str, Any]) -> None:
    """Of 15 digits, as a message shows, the second and others would be the number next to it."""
    wide = np.linspace(2.4, 4.0, 20)
    study = tradestudy.load(two_rigs)
    found = study.sweep({"rig.lenses.f_number": wide})
    np.testing.assert_array_equal(found["f_number"], wide)
    alone = study.with_values({"rig.lenses.f_number": wide[1]}).cameras["rig"]
    assert alone.f_number == wide[1]
    at = found["depth_uncertainty"].isel(f_number=1).sel(camera="rig")
    np.testing.assert_allclose(at, alone.depth_uncertainty(at["distance"]), rtol=1e-12)


def test_a_sweep_takes_quantities_words_and_parameters_of_the_same_name(two_rigs: dict[str, Any]) -> None:
    study = tradestudy.load({**two_rigs, "sweep": {"rig.baseline": ["7 cm"]}})
    quantities = pint.UnitRegistry().Quantity(np.array([5.0, 10.0]), "cm")
    found = study.sweep({"rig.baseline": quantities, "other.baseline": ["0.2 m", 0.3]})
    assert found["depth_uncertainty"].dims[:2] == ("rig_baseline", "other_baseline")
    assert list(found["other_baseline"].to_numpy()) == [0.2, 0.3]
    alone = study.cameras["rig"].replace(baseline=0.05).depth_uncertainty(2.0)
    at = found["depth_uncertainty"].isel(rig_baseline=0, other_baseline=1).sel(camera="rig", distance=2.0)
    assert float(at) == pytest.approx(float(alone), rel=1e-12)
    words = study.sweep({"rig.depth.estimator": ["midpoint", "disparity"]})
    assert list(words["estimator"].to_numpy()) == ["midpoint", "disparity"]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"rig.baseline": "5 cm"}, r"^rig.baseline: the swept values: '5 cm' \(allowed: a list or an array"),
        ({"rig.baseline": []}, r"^rig.baseline: the swept values: \[\] \(allowed"),
        ({"rig.baseline": [0.1, -0.1]}, r"^cameras.rig.baseline: '-0.1 m' is out of range"),
        ({"rig.basline": [0.1]}, r"^cameras.rig.basline: unknown key; nearest: 'baseline'"),
        ({"scene.wavelength": [5e-7]}, r"scene.wavelength cannot be swept"),
        ({"rig.baseline": [0.1, None]}, r"rig.baseline: null removes a value, but a sweep sets values"),
        ({"rig": [0.1]}, r"^cameras.rig: '0.1' is given; a mapping"),
        ({"rig.baseline": [0.1, 0.2, 0.1]}, r"^rig.baseline: 0.1 m is given twice; give each value once"),
        ("rig.baseline", r"^the swept values: 'rig.baseline' \(allowed: a dictionary .*write \{'camera.baseline': \["),
    ],
)
def test_refuses_impossible_sweeps(two_rigs: dict[str, Any], values: Any, message: str) -> None:
    with pytest.raises(TradestudyError, match=message):
        tradestudy.load(two_rigs).sweep(values)


@pytest.mark.parametrize(
    ("what", "variables"),
    [
        ("relative_uncertainty", ["relative_uncertainty"]),
        ("relative uncertainty", ["relative_uncertainty"]),
        ("uncertainty", ["depth_uncertainty"]),
        ("error radius", ["depth_error_radius"]),
        ("usable range", ["usable_near", "usable_far"]),
        (["variance_share", "near_limit", "disparity_px", "usable"], None),
        (["depth_uncertainty_by_error_source", "limit_value", "depth_discrimination"], None),
    ],
)
def test_a_sweep_computes_any_variable_of_depth(
    two_rigs: dict[str, Any], what: str | list[str], variables: list[str] | None
) -> None:
    limited = {**two_rigs, "usable_range": {"relative_uncertainty": 0.004}}
    found = tradestudy.load(limited).sweep({"rig.baseline": [0.2, 0.05]}, what)
    assert list(found.data_vars) == (variables or what)
    run = tradestudy.load({**limited, "sweep": {"rig.baseline": [0.2, 0.05]}}).run().data["depth"].to_dataset()
    for name, array in found.data_vars.items():
        xr.testing.assert_allclose(array.drop_attrs(), run[name].sel(baseline=[0.2, 0.05]).drop_attrs(), rtol=1e-12)


def test_refuses_what_a_sweep_does_not_compute(two_rigs: dict[str, Any]) -> None:
    with pytest.raises(UnknownNameError, match=r"'depths' \(allowed: 'depth', 'uncertainty', .*; nearest: 'depth'"):
        tradestudy.load(two_rigs).sweep({"rig.baseline": [0.1]}, "depths")
    with pytest.raises(OutOfRangeError, match=r"what a sweep computes: \[\] \(allowed: at least one variable"):
        tradestudy.load(two_rigs).sweep({"rig.baseline": [0.1]}, [])
