"""Implausible input causes a warning at its place, which a basis silences."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import tradestudy
from tradestudy.cli import app
from tradestudy.errors import StudyError
from tradestudy.results.views.terminal import terminal_lines

STUDIES = Path(__file__).parents[2] / "studies"
ROBOT = STUDIES / "robot.yaml"
UNUSUAL = {
    "stereo-75mm.baseline": ("50 m", "50 m is unusual (100 µm to 10 m is common); did you mean 50 mm?"),
    "raytrix-r5.microlenses.focal_lengths": (
        "[500 um, 550 mm, 600 um]",
        "550 mm is unusual (5 µm to 10 mm is common); did you mean 550 um?",
    ),
    "raytrix-r5.microlenses.gap": ("100 mm", "100 mm is unusual (10 µm to 10 mm is common)"),
    "stereo-75mm.sensor.pixel_pitch": ("3 mm", "3 mm is unusual (300 nm to 200 µm is common); did you mean 3 um?"),
    "scene.wavelength": ("30 um", "30 µm is unusual (200 nm to 20 µm is common)"),
    "usable_range.relative_uncertainty": ("100 %", "100 % is unusual"),
    "scene.picture.light.electrons": ("20000 electrons", "full well of"),
    "stereo-75mm.lenses.f_number": ("0.5", "0.5 is unusual (0.7 to 200 is common)"),
    "stereo-75mm.calibration.errors.yaw.standard_deviation": (
        "10 deg",
        "10° is unusual (0° to 2° is common); did you ",
    ),
    "stereo-75mm.depth.disparity_error": ("8 px", "8 px is unusual (0.002 px to 2 px is common)"),
    "stereo-75mm.depth.discrimination_step": ("10 px", "10 px is unusual"),
    "scene.picture.texture.correlation_length": ("20 m", "20 m"),
    "scene.picture.matching_window": ("900 px", "900 px is unusual"),
    "scene.picture.read_noise": ("5000 electrons", "is unusual"),
    "stereo-75mm.calibration.errors.baseline": (
        "{standard_deviation: 8 mm}",
        "8 mm is unusual (0 m to 5 mm is common)",
    ),
    "raytrix-r5.calibration.stability": (
        "{temperature: {standard_deviation: 3 K}, housing_expansion: 23e-3 1/K, array_expansion: 7 ppm/K, "
        "focal_length_expansion: 1 ppm/K, glass_index: 1.5}",
        "is unusual",
    ),
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


def test_cameras_with_one_title_are_told_apart_by_their_keys(tmp_path: Path) -> None:
    (tmp_path / "dup.yaml").write_text(
        "format: 2\nstudy: dup\ntitle: T\nquestion: Q?\ncameras:\n"
        "  near: {kind: stereo, title: Head, sensor: {pixels: [1280, 800], pixel_pitch: 3 um}, "
        "lenses: {focal_length: 2.65 mm}, baseline: 20 mm, depth: {disparity_error: 0.1 px}}\n"
        "  far: {like: near, baseline: 200 mm}\n  other: {like: near, title: Other}\n"
        "scene: {distances: {from: 0.05 m, to: 4 m, points: 9}, wavelength: 550 nm}\n",
        encoding="utf-8",
    )
    study = tradestudy.load(tmp_path / "dup.yaml")
    titles = {name: one.title for name, one in study.prepared.file.cameras.items()}
    assert titles == {"near": "Head (near)", "far": "Head (far)", "other": "Other"}
    assert any("far is called Head (far)" in str(one) for one in study.warnings)


def test_a_basis_of_a_list_silences_warnings_about_its_values() -> None:
    lengths, path = "[500 um, 550 mm, 600 um]", "raytrix-r5.microlenses.focal_lengths"
    assert len(tradestudy.load(ROBOT, [f"{path}={lengths}"]).warnings) == 1
    assert tradestudy.load(ROBOT, [f"{path}={{value: {lengths}, basis: datasheet}}"]).warnings == ()
    assert len(tradestudy.load(ROBOT, [f"{path}={{value: {lengths}, note: as drawn}}"]).warnings) == 1


def test_a_focal_length_in_the_wrong_unit_is_warned_about() -> None:
    (reported,) = tradestudy.load(
        ROBOT, ["stereo-75mm.lenses.focal_length=2.65 m", "stereo-75mm.focus_distance=autofocus"]
    ).warnings
    assert "cameras.stereo-75mm.lenses.focal_length: 2.65 m is unusual" in reported.replace("\N{NO-BREAK SPACE}", " ")


def test_a_contradiction_that_another_camera_inherits_is_reported_for_the_camera_that_states_it(tmp_path: Path) -> None:
    (tmp_path / "two.yaml").write_text(
        "format: 2\nstudy: two\ntitle: Two\nquestion: Which one?\ncameras:\n"
        "  near: {kind: stereo, lenses: {focal_length: 2 mm}, sensor: {pixels: [1280, 720], pixel_pitch: 3 um},\n"
        "    baseline: 50 mm, depth: {disparity_error: 0.1 px}, stated: {field_of_view: 70 deg}}\n"
        "  far: {like: near, baseline: 95 mm}\n"
        "scene: {distances: {from: 0.3 m, to: 4 m, points: 9}, wavelength: 550 nm}\n"
    )
    (reported,) = tradestudy.load(tmp_path / "two.yaml").warnings
    assert "cameras.near.stated.field_of_view: " in reported


def test_a_basis_silences_a_warning_and_each_place_is_reported_once() -> None:
    stated = "stereo-75mm.baseline={value: 50 m, basis: datasheet}"
    assert tradestudy.load(ROBOT, [stated]).warnings == ()
    values = ["stereo-50mm.sensor.pixel_pitch=3 mm", "stereo-75mm.sensor.pixel_pitch=3 um"]
    assert len(tradestudy.load(ROBOT, values).warnings) == 1
    both = tradestudy.load(ROBOT, values[:1]).warnings  # the other head, declared like it, keeps 3 um
    assert ["3 mm is unusual" in one for one in both] == [True, False]


def test_a_tolerance_without_a_percent_sign_is_warned_about() -> None:
    (reported,) = tradestudy.load(ROBOT, tolerance="0.1").warnings
    assert reported.startswith("accuracy.tolerance: 0.1 means 10")
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


FAST = Path(__file__).parents[1] / "data" / "fast-main-lens" / "spcf22.yaml"


def contradictory(*changes: str) -> tuple[str, str]:
    """The warning and the last lines of the terminal about one contradiction; both empty if there is none."""
    study = tradestudy.load(FAST, list(changes))
    warned = [one for one in study.warnings if "unusual" not in one]
    said = [one for one in terminal_lines(study.run().data) if one.startswith("Contradictory inputs")]
    assert len(warned) <= 1
    return "".join(warned), "".join(said)


def test_a_main_lens_faster_or_much_slower_than_its_microlenses_is_said_in_check_and_terminal() -> None:
    """f/22 microlenses: a pupil of f/4 is imaged 22/4 = 5.5 cells wide, one of f/44 half a cell wide."""
    assert contradictory() == ("", "")
    warned, said = contradictory("spc.main_lens.f_number=4")
    assert "main_lens.f_number: f-number matching" in warned
    assert "its micro-images overlap" in warned
    assert said.startswith("Contradictory inputs of spc: its micro-images overlap")
    assert all(one in said for one in ("f/4 ", "f/22"))
    warned, said = contradictory("spc.main_lens.f_number=44")
    assert all("fill only 25" in one and "slower" in one for one in (warned, said))
    # A few dark pixels are no consequence, only a contradiction; a basis says that the author knows.
    warned, said = contradictory("spc.main_lens.f_number=25")
    assert warned
    assert not said
    warned, said = contradictory("spc.main_lens.f_number={value: 4, basis: measured}")
    assert not warned
    assert said


@pytest.mark.usefixtures("empty_figures")
def test_the_first_page_says_that_micro_images_overlap(tmp_path: Path) -> None:
    tradestudy.load(FAST, ["spc.main_lens.f_number=4"]).run().write(tmp_path, pdf=False)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.index('id="answer"') < page.index("its micro-images overlap") < page.index('id="cameras"')


MINI = FAST.parents[1] / "coverage-of-other-relay" / "mini40.0.yaml"


@pytest.mark.parametrize(
    ("focal_length", "blurred"),  # b_L/f_L − 1 = 1/v in focus; 1/v of real objects lies from −40.09/136 = −0.295 to 0
    [("37 um", False), ("40.0 um", False), ("50 um", False), ("80 um", True), ("36 um", True), ("30 um", True)],
)
def test_a_gap_that_focuses_on_no_real_object_is_said(focal_length: str, blurred: bool) -> None:
    """Blur over aperture is the distance of 1/v: 0.083, 0.002, 0, 0.20, 0.114 and 0.34; a tenth is allowed."""
    warned = tradestudy.load(MINI, [f"c.microlenses.focal_lengths=[{focal_length}]"]).warnings
    assert any("gap against focal lengths" in one and "no real object" in one for one in warned) == blurred


@pytest.mark.parametrize(
    ("changes", "warns"),
    [
        ((), True),
        (("stereo-50mm.principal_distance=focused",), False),
        (("stereo-50mm.principal_distance=focal_length",), False),  # a choice that the study makes
        (("stereo-50mm.lenses.focal_length={value: 12 mm, basis: datasheet}",), True),
        (("stereo-50mm.lenses.focal_length=4000 px",), False),  # a principal distance, as calibrations give it
        (("stereo-50mm.focus_distance=3 m",), False),
        (("stereo-50mm.focus_distance=autofocus",), True),  # at 0.3 m, the nearest distance
        (("stereo-50mm.focus_distance=autofocus", "stereo-50mm.principal_distance=focal_length"), False),
        (("stereo-50mm.focus_distance=autofocus", "stereo-50mm.lenses.focal_length=4000 px"), False),
        (("stereo-50mm.focus_distance={value: autofocus, basis: assumed}",), False),
        (("stereo-50mm.focus_distance=null",), False),  # refocuses by default, which only leaves blur out
        (("stereo-50mm.focus_distance=autofocus", "scene.distances.from=0.7 m"), False),  # by 12/688, below 2 %
    ],
)
def test_a_lens_whose_focus_implies_another_focal_length_is_warned_about(changes: tuple[str, ...], warns: bool) -> None:
    """12 mm focused at 0.3 m: the sensor is 12 · 300/288 = 12.5 mm behind the lens."""
    near = ["stereo-50mm.lenses.focal_length=12 mm", "stereo-50mm.focus_distance=0.3 m", "stereo-75mm=null"]
    near += ["decision=null", "trade_off=null"]
    given = dict(one.split("=", 1) for one in (*near, *changes))  # a key is set only once
    settings = [f"{path}={value}" for path, value in given.items()]
    said = [one for one in tradestudy.load(ROBOT, settings).warnings if "principal distance" in one]
    assert bool(said) == warns
    assert all("12 mm" in one.replace("\N{NO-BREAK SPACE}", " ") for one in said)
    assert all("12.5 mm" in one.replace("\N{NO-BREAK SPACE}", " ") for one in said)


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
    assert warnings(IMPORTING, "rig.focus_distance=autofocus") == ()
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


EXCHANGED = "(320, 240) px lies far from the middle of the picture of 480 × 640 px, whose middle is (239.5, 319.5) px"
TWICE = "(320, 240) px lies far from the middle of the picture of 1280 × 960 px, whose middle is (639.5, 479.5) px"


def test_a_principal_point_far_from_the_middle_is_warned_about_with_its_likely_cause(tmp_path: Path) -> None:
    """Whether the file gives the size, or the study beside it or in an option; also for a single camera."""

    def warnings(text: str, sensor: str = "", *overrides: str, single: bool = False) -> list[str]:
        (tmp_path / "rig.yml").write_text(text, encoding="utf-8")
        study = IMPORTING.replace("    lenses:", f"    {sensor}\n    lenses:" if sensor else "    lenses:")
        if single:
            optics = "    lenses: {f_number: 4}\n    focus_distance: 0.6 m\n"
            study = study.replace(optics, "    kind: conventional\n    focus: {distance: 0.6 m}\n")
            study = study.replace("    length_unit: mm\n", "")
        (tmp_path / "importing.yaml").write_text(study, encoding="utf-8")
        found = tradestudy.load(tmp_path / "importing.yaml", ["rig.sensor.pixel_pitch=3 um", *overrides]).warnings
        return [one for one in found if "principal point" in one]

    size = "image_width: 640\nimage_height: 480\n"
    exchanged = STEREO.replace(size, "image_width: 480\nimage_height: 640\n")
    without = STEREO.replace(size, "")
    one = "\n".join(
        line.replace("M1", "camera_matrix") for line in exchanged.splitlines() if line[:2] not in NOT_OF_ONE
    )
    assert warnings(STEREO) == []
    for said in (
        warnings(exchanged),
        warnings(without, "sensor: {pixels: [480, 640]}"),
        warnings(without, "", "rig.sensor.pixels=[480, 640]"),
        warnings(one, single=True),
        warnings(
            one.replace("image_width: 480\nimage_height: 640\n", ""), "", "rig.sensor.pixels=[480, 640]", single=True
        ),
    ):
        assert EXCHANGED in said[0]
        assert said[0].endswith("width and height are probably exchanged; check the size and the camera matrix")
    for said in (
        warnings(without, "sensor: {pixels: [1280, 960]}"),
        warnings(without, "", "rig.sensor.pixels=[1280, 960]"),
    ):
        assert TWICE in said[0]
        assert "another resolution, or the picture be cropped" in said[0]
    alike = warnings(exchanged.replace("320., 0., 800., 240.", "322., 0., 800., 241.", 1))[0]
    assert "camera 1 and camera 2: the principal points (322, 241) and (320, 240) px lie far from the middle" in alike
    assert alike.count("probably exchanged") == 1
    for x, number in ((320.0 + 0.11 * 640, 0), (320.0 + 0.13 * 640, 1)):
        moved = STEREO.replace("320., 0., 800., 240.", f"{x}, 0., 800., 240.", 1)
        assert len(warnings(moved)) == number


@pytest.mark.parametrize(
    ("overrides", "named"),
    [
        (
            ["stereo-50mm.depth.disparity_range=64 px"],
            "cameras.stereo-50mm.depth.disparity_range: does not change stereo-75",
        ),
        (["stereo-50mm.depth.disparity_range=64 px", "stereo-75mm.depth.disparity_range=64 px"], ""),
        (["stereo-50mm.baseline=60 mm"], ""),  # the other rig has its own
        (["stereo-75mm.depth.disparity_range=64 px"], ""),
        (["stereo-50mm.sensor.pixel_pitch=3.1 um", "stereo-75mm=null", "decision=null", "trade_off=null"], ""),
    ],
)
def test_a_value_that_cameras_like_the_changed_one_keep_is_warned_about(overrides: list[str], named: str) -> None:
    said = [one for one in tradestudy.load(ROBOT, overrides).warnings if "declared like" in one]
    assert [one.startswith(named) for one in said] == [True] * bool(named)
    assert not any("--set" in one for one in said)


def test_a_mistake_of_a_part_names_the_values_in_it_that_were_set() -> None:
    given = ["scene.wavelength=600 nm", "stereo-75mm.baseline=70 mm", "stereo-75mm.focus_distance=1 mm"]
    with pytest.raises(StudyError) as caught:
        tradestudy.load(ROBOT, given)
    (said,) = str(caught.value).splitlines()
    set_here = "cameras.stereo-75mm.baseline=70 mm, cameras.stereo-75mm.focus_distance=1 mm"
    assert "cameras.stereo-75mm: the lenses cannot focus that close" in said
    assert said.endswith(f"; set for this run: {set_here}")


def test_advice_for_python_names_no_option() -> None:
    with pytest.raises(StudyError, match="readings, or compute a study for each value"):
        tradestudy.load(ROBOT, ["sweep={scene.wavelength: [500 nm, 600 nm]}"])


NOT_OF_ONE = ("M2", "D1", "D2", "R:", "T:")


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


def test_a_posterior_of_values_instead_of_errors_is_warned_about(tmp_path: Path) -> None:
    rows = 0.0751 + np.random.default_rng(0).normal(0.0, 1e-4, 5000)
    (tmp_path / "draws.csv").write_text("baseline\n" + "\n".join(f"{one!r}" for one in rows.tolist()))
    calibration = {"posterior": {"file": str(tmp_path / "draws.csv")}}
    study = tradestudy.load(ROBOT).with_values({"stereo-75mm.calibration": calibration})
    (said,) = [one for one in study.warnings if "values of the parameters, not errors" in one]
    assert "count as the declared values, which shifts baseline by −" in said


def test_equal_light_on_unequal_pixels_is_warned_about() -> None:
    """Pixels of 5.5 µm have 3.4 times the area of those of 3 µm."""
    (said,) = tradestudy.load(ROBOT).with_values({"scene.picture.light.at_pixel_pitch": None}).warnings
    assert "pixels of 3 µm and 5.5 µm are taken to collect equal light" in said
    alike = {"scene.picture.light.at_pixel_pitch": None, "raytrix-r5.sensor.pixel_pitch": "3 um"}
    assert tradestudy.load(ROBOT).with_values(alike).warnings == ()


def test_a_wavelength_outside_the_spectrum_is_warned_about() -> None:
    lines = [{"wavelength": f"{one} nm", "weight": 1} for one in (850, 940)]
    study = tradestudy.load(ROBOT).with_values({"scene.picture.spectrum": lines})
    (said,) = study.with_values({"scene.wavelength": "550 nm"}).warnings
    assert "scene.wavelength: 550 nm lies outside scene.picture.spectrum (850 nm to 940 nm)" in said
    assert study.with_values({"scene.wavelength": "850 nm"}).warnings == ()
    assert study.with_values({"scene.wavelength": "550 nm", "effects.spectrum": "off"}).warnings == ()


@pytest.mark.parametrize(("low", "key"), [("60 mm", ""), ("80 mm", "low"), ("10 mm", "high")])
def test_an_assumption_whose_range_excludes_the_declared_value_is_warned_about(low: str, key: str) -> None:
    """The baseline is 75 mm; the ranges end at 90 mm, or at 70 mm."""
    assumption = {"vary": "stereo-75mm.baseline", "low": low, "high": "70 mm" if key == "high" else "90 mm"}
    voi = {"assumptions": {"baseline": assumption}, "at": ["1 m"]}
    said = tradestudy.load(ROBOT).with_values({"value_of_information": voi}).warnings
    assert len(said) == (1 if key else 0)
    if key:
        assert f"value_of_information.assumptions.baseline.{key}: {low} to " in said[0]
        assert "does not include the declared value of stereo-75mm.baseline, 75 mm" in said[0]


def test_a_focal_length_usual_for_microlenses_is_not_doubted() -> None:
    """Those of the first Lytro camera are 25 µm long."""
    said = tradestudy.load(FAST.parents[1] / "lytro-like" / "lytro.yaml").warnings
    assert not [one for one in said if "unusual" in one]
