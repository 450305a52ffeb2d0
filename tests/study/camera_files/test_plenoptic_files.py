"""Cameras of Lytro, Raytrix and PlenoptiSign, whose files lack some of the optics; numbers worked out by hand."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import tradestudy
from tests.study.camera_files import devices, plenoptic_files
from tests.study.camera_files.plenoptic_files import DEPTH, OPTICS, container, lytro, plenoptisign, raytrix, section
from tests.study.camera_files.test_import import refusal
from tests.study.camera_files.written import study
from tradestudy.cameras.focused_plenoptic.design import FocusedPlenoptic
from tradestudy.cameras.unfocused_plenoptic.design import UnfocusedPlenoptic
from tradestudy.cli import app

SQUARE = f"microlenses: {{layout: square}}, {DEPTH}"
ARRAY = "microlenses: {gap: 0.9 mm, focal_lengths: [0.8 mm, 0.9 mm, 1 mm]}"


def unfocused(path: Path) -> UnfocusedPlenoptic:
    camera = tradestudy.load(path).definition.designs["rig"]
    assert isinstance(camera, UnfocusedPlenoptic)
    return camera


def focused(path: Path) -> FocusedPlenoptic:
    camera = tradestudy.load(path).definition.designs["rig"]
    assert isinstance(camera, FocusedPlenoptic)
    return camera


@pytest.mark.parametrize("write", [lytro, container])
def test_a_lytro_is_focused_where_its_infinity_lambda_says(tmp_path: Path, write: Any) -> None:
    """λ N p = 16 · 2.5 · 20 µm = 0.8 mm behind the focal plane, and f + f²/(0.8 mm) = 520 mm."""
    write(tmp_path / "lytro.file")
    camera = unfocused(study(tmp_path, rig=f"from: lytro.file, {DEPTH}"))
    assert camera.focus_distance == pytest.approx(0.52, rel=1e-12)
    assert camera.mla_distance == pytest.approx(20.8e-3, rel=1e-12)
    assert camera.main_lens.focal_length == 0.02
    assert camera.main_lens.f_number == 2.5
    assert (camera.sensor.columns, camera.sensor.rows, camera.sensor.pixel_pitch) == (4000, 3000, 1.5e-6)
    assert camera.microlenses.layout == "hexagonal"
    assert (camera.microlenses.pitch, camera.microlenses.gap) == pytest.approx((2e-5, 4e-5), rel=1e-15)
    assert camera.main_lens.exit_pupil == pytest.approx(20.8e-3 - 80e-3, rel=1e-12)  # 80 mm in front of the array
    # An image-side cone of the pupil: A f/(e' − f) wide, seen from 80 mm.
    exit_diameter = 8e-3 * (59.2e-3 + 20e-3) / 20e-3
    assert camera.micro_image_diameter == pytest.approx(exit_diameter * 40e-6 / 80e-3, rel=1e-12)


def test_micro_images_of_a_lytro_lie_where_its_readers_put_them(tmp_path: Path) -> None:
    """From the middle: sensorOffset, then steps of pitch · (1 + z/exitPupilOffset), turned clockwise by rotation."""
    lytro(tmp_path / "lytro.json")
    camera = unfocused(study(tmp_path, rig=f"from: lytro.json, {DEPTH}"))
    step, angle = 2e-5 * (1.0 + 40e-6 / 80e-3), 2e-3
    cones = camera.exposures(0.52, {}, None, 0.0)[0]
    entrance = camera.main_lens.entrance_pupil
    for i, j in ((0, 0), (40, 30), (-55, 20), (30, -64)):
        x, y = step * (i + j / 2.0), step * j * math.sqrt(0.75)
        at = (
            8e-6 + x * math.cos(angle) - y * math.sin(angle),
            -1e-6 + x * math.sin(angle) + y * math.cos(angle),
        )
        seen = cones.cones(np.array([at[0]]), np.array([at[1]]))
        in_pupil = seen.start - entrance * seen.slope  # the chief ray passes the centre of the pupil
        assert np.hypot(*in_pupil).min() < 30e-6  # a wrong sign of the rotation misses it by 3 mm


def test_a_crop_moves_the_array_and_the_axis_of_a_lytro(tmp_path: Path) -> None:
    """Picture 990 to 2990 of 4000 pixels: the middle of the sensor lies 10 px = 15 µm to the right of its middle."""
    lytro(tmp_path / "lytro.json", image={"width": 2000, "originOnSensor": {"x": 990, "y": 0}}, mla={"rotation": 0})
    known = dict(unfocused(study(tmp_path, rig=f"from: lytro.json, {DEPTH}")).known)
    # A microlens lies at 15 + 8 µm, its neighbour at 3 µm; the axis stays in the middle of the sensor.
    assert known["array_offset_x"] == pytest.approx(3e-6, rel=1e-9)
    assert known["array_offset_y"] == pytest.approx(-1e-6, rel=1e-9)
    assert known["principal_point_x"] == pytest.approx(12e-6, rel=1e-9)
    assert known["principal_point_y"] == pytest.approx(1e-6, rel=1e-9)


def test_values_that_a_lytro_lacks_are_asked_for_and_unknown_ones_are_named(tmp_path: Path) -> None:
    lytro(tmp_path / "lytro.json", lens={"infinityLambda": 0})
    assert math.isinf(unfocused(study(tmp_path, rig=f"from: lytro.json, {DEPTH}")).focus_distance)
    lytro(tmp_path / "lytro.json", lens={"infinityLambda": -1, "fNumber": None}, mla={"sensorOffset": None})
    said = refusal(study(tmp_path, rig=f"from: lytro.json, {DEPTH}"))
    for key in ("focus.distance", "main_lens.f_number", "microlenses.focal_length"):
        assert f"cameras.rig.{key}: not in lytro.json; " in said
    lytro(tmp_path / "lytro.json", mla={"tiling": "spiral"})
    assert "the tiling spiral is unknown" in refusal(study(tmp_path, rig=f"from: lytro.json, {DEPTH}"))
    lytro(tmp_path / "lytro.json", mla={"scaleFactor": {"x": 1.0, "y": 1.0004}})
    path = study(tmp_path, rig=f"from: lytro.json, {DEPTH}")
    assert unfocused(path).microlenses.pitch == pytest.approx(20.004e-6, rel=1e-12)
    assert "not used: image.orientation, devices.clock, devices.lens.zoomStep, devices.lens.focusStep" in str(
        tradestudy.load(path).imported[0]
    )
    lytro(tmp_path / "lytro.json", mla={"scaleFactor": {"x": 1.0, "y": 1.01}})
    assert "different horizontal and vertical pitches" in refusal(study(tmp_path, rig=f"from: lytro.json, {DEPTH}"))
    lytro(tmp_path / "lytro.json", lens={"opticalCenterOffset": {"x": 1e-5, "y": 0}})
    (warning,) = tradestudy.load(study(tmp_path, rig=f"from: lytro.json, {DEPTH}")).warnings
    assert "opticalCenterOffset" in warning


def test_the_metadata_of_a_lytro_may_stand_below_its_pictures(tmp_path: Path) -> None:
    frame = {"frame": {"metadata": plenoptic_files.lytro_metadata()}}
    expected = unfocused(study(tmp_path, rig=f"from: {lytro(tmp_path / 'lytro.json').name}, {DEPTH}"))
    for whole in ({"frames": [frame]}, {"master": {"picture": {"frameArray": [frame], "viewArray": []}}}):
        (tmp_path / "lytro.json").write_text(json.dumps(whole))
        assert unfocused(study(tmp_path, rig=f"from: lytro.json, {DEPTH}")) == expected


def test_damaged_containers_are_refused_in_words(tmp_path: Path) -> None:
    file = container(tmp_path / "a.lfr")
    path = study(tmp_path, rig=f"from: a.lfr, {DEPTH}")
    whole, frame = file.read_bytes(), json.dumps(plenoptic_files.lytro_metadata()).encode()
    for count in (8, 15, 16, 20, 100, 300, 5000, len(whole) - len(frame) - 40, len(whole) - 20):
        file.write_bytes(whole[:count])
        assert re.search("it is (cut off|damaged): |metadata of 0 frames", refusal(path)), count
    file.write_bytes(whole[:28] + b"\xff\xff\xff\xff" + whole[32:])  # a section of 4 GB
    assert "it is cut off: the section at byte 16 ends at byte 4294967407" in refusal(path)
    file.write_bytes(whole.replace(b'"fNumber": 2.5', b'"fNumber": 3.5'))
    assert "the SHA-1 of the metadata differs" in refusal(path)
    container(file, frame, frame)
    assert "metadata of 2 frames; one is expected" in refusal(path)
    container(file, b'{"picture": {}}')
    assert "metadata of 0 frames; one is expected, as in a raw picture" in refusal(path)
    file.write_bytes(section(b"P", b"") * 20_000)
    assert "more than 10000 sections, so it is not a raw picture" in refusal(path)
    container(file, frame[:-30] + b"\xff" + frame[-29:])
    assert "is not UTF-8" in refusal(path)


def test_pixels_of_a_container_of_any_size_are_not_read(tmp_path: Path) -> None:
    frame = json.dumps(plenoptic_files.lytro_metadata()).encode()
    pixels = 200_000_000
    with (tmp_path / "a.lfr").open("wb") as file:
        file.write(section(b"P", b"") + section(b"C", b"x")[:12] + pixels.to_bytes(4, "big") + b"\0" * 80)
        file.seek(pixels, 1)
        file.write(section(b"C", frame))
    assert unfocused(study(tmp_path, rig=f"from: a.lfr, {DEPTH}")).focus_distance == pytest.approx(0.52)


def test_plenoptisign_counts_its_focus_from_the_image(tmp_path: Path) -> None:
    """The image of an object at 1 m lies 52.63 mm behind the lens; the pupil 80 mm in front of it, 27.37 mm before."""
    plenoptisign(tmp_path / "sign.json")
    camera = unfocused(study(tmp_path, rig=f"from: sign.json, {SQUARE}"))
    image = 50e-3 / 0.95
    assert camera.focus_distance == pytest.approx(1.0, rel=1e-12)
    assert camera.mla_distance == pytest.approx(image, rel=1e-12)
    assert camera.main_lens.exit_pupil == pytest.approx(image - 80e-3, rel=1e-12)
    assert camera.main_lens.principal_separation == pytest.approx(-10e-3)
    assert camera.main_lens.pupil_diameter == pytest.approx(5e-3)
    assert (camera.sensor.columns, camera.sensor.rows) == (3000, 2000)  # sd: rows first
    assert (camera.microlenses.pitch, camera.microlenses.gap) == pytest.approx((1e-4, 1e-3))
    # A pixel sees a point of the exit pupil, 80 mm · pp/fs from that of its neighbour. From there, light goes to the
    # image at b(Z) and meets the array, 80 mm away, at different places.
    for distance in (0.6, 2.0, 7.0):
        of_point = 50e-3 * distance / (distance - 50e-3)
        pixels = np.ptp(camera.view_positions[:, 0]) / camera.view_pupil_diameter
        behind = of_point - image
        shift = pixels * 80e-3 * 5e-3 * abs(behind) / (80e-3 + behind)
        assert abs(float(camera.disparity(distance))) == pytest.approx(shift, rel=1e-9)


def test_plenoptisign_focused_at_infinity_without_a_sensor_size(tmp_path: Path) -> None:
    for infinite in (math.inf, "Inf"):
        plenoptisign(tmp_path / "sign.json", df=infinite)
        camera = unfocused(study(tmp_path, rig=f"from: sign.json, {SQUARE}"))
        assert math.isinf(camera.focus_distance)
        assert camera.main_lens.exit_pupil == pytest.approx(-30e-3, rel=1e-12)
    plenoptisign(tmp_path / "sign.json", sd=None)
    assert "cameras.rig.sensor.pixels: not in sign.json; " in refusal(study(tmp_path, rig=f"from: sign.json, {SQUARE}"))
    plenoptisign(tmp_path / "sign.json", pp=5e-5, sd=[0.1, 0.1])
    assert "pixels across a microlens" in refusal(study(tmp_path, rig=f"from: sign.json, {SQUARE}"))
    plenoptisign(tmp_path / "sign.json", pp=1e-320)
    assert "is not a side of a sensor" in refusal(study(tmp_path, rig=f"from: sign.json, {SQUARE}"))
    plenoptisign(tmp_path / "sign.json", df=150.0)
    said = refusal(study(tmp_path, rig=f"from: sign.json, {SQUARE}"))
    assert "df: object and image would be 160 mm apart, df − HH; at least four focal lengths, 200 mm" in said


def test_a_raytrix_gives_the_pitch_of_micro_images(tmp_path: Path) -> None:
    """Its 24 px of 5.5 µm are those of microlenses, seen from 110 mm, on a sensor 0.9 mm behind them."""
    raytrix(tmp_path / "array.xml")
    camera = focused(study(tmp_path, rig=f"from: array.xml, {ARRAY}, {OPTICS}"))
    assert camera.microlenses.pitch == pytest.approx(132e-6 * 110.0 / 110.9, rel=1e-12)
    assert camera.microlenses.aperture_diameter == camera.microlenses.pitch
    assert (camera.microlenses.layout, camera.microlenses.types) == ("hexagonal", 3)
    assert dict(camera.known)["array_rotation"] == pytest.approx(-2e-3)  # counter-clockwise in the file
    assert tradestudy.load(tmp_path / "study.yaml").warnings == ()


@pytest.mark.parametrize("pupil", ["", ", exit_pupil: -40 mm", ", exit_pupil: infinity"])
@pytest.mark.parametrize("focus", ["mla_distance: 110 mm", "total_covering_plane: 1.1 m, relay: galilean"])
def test_micro_images_are_as_far_apart_as_said_with_matching_f_numbers(tmp_path: Path, pupil: str, focus: str) -> None:
    raytrix(tmp_path / "array.xml")
    said = OPTICS.replace("6.25", f"6.25{pupil}").replace("mla_distance: 110 mm", focus)
    for gap in ("f-number-matching", "0.9 mm"):
        array = f"microlenses: {{gap: {gap}, focal_lengths: null}}"
        camera = focused(study(tmp_path, rig=f"from: array.xml, {array}, {said}"))
        away = camera.mla_distance - camera.main_lens.exit_pupil
        magnified = 1.0 if math.isinf(away) else 1.0 + camera.microlenses.gap / away
        assert camera.microlenses.pitch * magnified == pytest.approx(24 * 5.5e-6, rel=1e-12)
        if gap == "f-number-matching":
            f_number = camera.principal_distance / camera.main_lens.pupil_diameter
            assert camera.microlenses.gap / camera.microlenses.pitch == pytest.approx(f_number, rel=1e-12)


@pytest.mark.parametrize(
    ("base_x", "base_y", "angle", "layout", "rotation"),
    [
        ((1, 0), (0.5, -0.8660254), 0.0, "hexagonal", 0.0),
        ((0, 1), (0.8660254, 0.5), 0.0, "hexagonal", -math.pi / 2 + math.pi / 3),  # neighbours along columns
        ((1, 0), (0.5, 0.8660254), 1.5708, "hexagonal", math.pi / 2 - 1.5708 + math.pi / 6),
        ((0, -1), (1, 0), 0.002, "square", -0.002),
    ],
)
def test_base_vectors_and_rotation_of_a_raytrix_turn_the_lattice(
    tmp_path: Path, base_x: Any, base_y: Any, angle: float, layout: str, rotation: float
) -> None:
    raytrix(
        tmp_path / "array.xml",
        ('<lens_base_x units="lens"><x>1</x><y>0</y>', f"<lens_base_x><x>{base_x[0]}</x><y>{base_x[1]}</y>"),
        ("<x>0.5</x><y>0.8660254</y>", f"<x>{base_y[0]}</x><y>{base_y[1]}</y>"),
        ("2e-003", f"{angle}"),
        types=1,
    )
    array = "microlenses: {gap: 0.9 mm, focal_lengths: [0.9 mm]}"
    camera = focused(study(tmp_path, rig=f"from: array.xml, {array}, {OPTICS}"))
    assert camera.microlenses.layout == layout
    period = math.pi / (3.0 if layout == "hexagonal" else 2.0)
    difference = dict(camera.known).get("array_rotation", 0.0) - rotation
    assert difference - period * round(difference / period) == pytest.approx(0.0, abs=1e-9)
    assert abs(dict(camera.known).get("array_rotation", 0.0)) <= period / 2.0 + 1e-9


@pytest.mark.usefixtures("empty_figures")
def test_what_a_raytrix_file_says_beyond_the_lattice_is_named_or_refused(tmp_path: Path) -> None:
    def said(*changes: tuple[str, str], types: int = 3) -> str:
        raytrix(tmp_path / "array.xml", *changes, types=types)
        return refusal(study(tmp_path, rig=f"from: array.xml, {ARRAY}, {OPTICS}"))

    assert "2 types of microlenses (lens_type) are given; 1 or 3 are expected" in said(types=2)
    assert "the unit deg is not supported; rad is expected" in said(('rotation units="rad"', 'rotation units="deg"'))
    assert "not the sides of a regular lattice" in said(("0.8660254", "0.7"))
    raytrix(
        tmp_path / "array.xml",
        ("<x>0</x><y>0</y></offset>\n\t<dia", "<x>3</x><y>0</y></offset>\n\t<dia"),
        ("constant", "Brown"),
    )
    (warning,) = tradestudy.load(study(tmp_path, rig=f"from: array.xml, {ARRAY}, {OPTICS}")).warnings
    ignored = "the offset of the lattice and the distortion (Brown)"
    assert ignored in warning
    tradestudy.load(tmp_path / "study.yaml").run().write(tmp_path / "out", pdf=False)
    page = (tmp_path / "out" / "report.html").read_text()
    on_page_one = page.index(f"neither depth nor pictures use {ignored} of its file")
    assert on_page_one < re.search(r"<h2[^>]*>.*Camera by distance", page).start()  # type: ignore[union-attr]


FILES = {
    **{name: (write, file) for name, (write, file, _) in plenoptic_files.WRITERS.items()},
    "libpleno camera": (devices.plenoptic, "r12.js"),
}
DEPTHS = {"depth.estimator": "outermost-views", "depth.disparity_error": "0.1 px"}
GIVEN = {
    "Lytro metadata": DEPTHS,
    "Lytro container": DEPTHS,
    "PlenoptiSign parameters": {"microlenses.layout": "square", **DEPTHS},
    "libpleno camera": {**DEPTHS, "depth.estimator": "adjacent-pair"},
    "Raytrix calibration": {
        **{"main_lens.focal_length": "100 mm", "main_lens.f_number": "7"},
        **{"sensor.pixels": "[4000, 3000]", "sensor.pixel_pitch": "5.5 um"},
        **{"microlenses.gap": "0.9 mm", "microlenses.focal_lengths": "[0.8 mm, 0.9 mm, 1 mm]"},
        **{"focus.mla_distance": "110 mm", **DEPTHS, "depth.estimator": "widest-pair"},
    },
}


@pytest.mark.usefixtures("empty_figures")
@pytest.mark.parametrize("name", FILES)
def test_two_commands_and_the_missing_values_lead_to_a_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    write, file = FILES[name]
    write(tmp_path / file)
    monkeypatch.chdir(tmp_path)
    runner, given = CliRunner(), GIVEN[name]
    made = runner.invoke(app, ["new", "mine", "--from", file])
    assert made.exit_code == 0, made.output
    written = (tmp_path / "mine.yaml").read_text()
    for key in given:
        assert re.search(rf"^  {key}: .* is expected \(\w.*\)$", made.output, re.MULTILINE), key
        assert re.search(rf"^    #   {key}: .* is expected \(\w.*\)$", written, re.MULTILINE), key
    refused = runner.invoke(app, ["run", "mine.yaml"])
    assert refused.exit_code == 2
    lines = refused.output.strip().splitlines()
    assert sorted(re.search(r"cameras\.rig\.([\w.]+): not in ", line)[1] for line in lines) == sorted(given)  # type: ignore[index]
    values = [part for key, value in given.items() for part in ("--set", f"rig.{key}={value}")]
    ran = runner.invoke(
        app, ["run", "mine.yaml", "--no-pdf", "--out", "out", "--set", "scene.distances.points=9", *values]
    )
    assert ran.exit_code == 0, ran.output
    assert (tmp_path / "out" / "report.html").is_file()
    # The same values, given to `new`, adapt the distances of the study to the camera.
    more = [part for key, value in given.items() for part in ("--set", f"{key}={value}")]
    again = runner.invoke(app, ["new", "other", "--from", file, *more])
    assert again.exit_code == 0, again.output
    assert "other.yaml" in again.output.splitlines()
    assert tradestudy.load("other.yaml").cameras["rig"].kind in ("focused-plenoptic", "unfocused-plenoptic")


@pytest.mark.parametrize("given_to_new", [False, True])
def test_new_study_of_an_unfocused_camera_counts_what_it_can_refocus(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given_to_new: bool
) -> None:
    """One microlens from view to view: images meet α p / (q − α p / d_A) behind the array, α = ±1 at the ends."""
    lytro(tmp_path / "lytro.json")
    monkeypatch.chdir(tmp_path)
    more = [f"--set={key}={value}" for key, value in DEPTHS.items()] if given_to_new else []
    made = CliRunner().invoke(app, ["new", "mine", "--from", "lytro.json", *more])
    assert made.exit_code == 0, made.output
    given = [f"rig.{key}={value}" for key, value in DEPTHS.items()]
    overrides = ["scene.distances={from: 0.25 m, to: 5 m, points: 61, spacing: log}", *([] if given_to_new else given)]
    found = tradestudy.load("mine.yaml", overrides).cameras["rig"].usable_range()
    pitch, slope, from_pupil, f = 20e-6, 1.5e-6 / 40e-6, 80e-3, 20e-3
    images = [20.8e-3 + alpha * pitch / (slope - alpha * pitch / from_pupil) for alpha in (1.0, -1.0)]
    near, far = (f * image / (image - f) for image in images)
    assert found["usable_near"].item() == pytest.approx(near, rel=1e-3)
    assert found["usable_far"].item() == pytest.approx(far, rel=1e-3)


def test_another_key_may_answer_what_is_asked(tmp_path: Path) -> None:
    raytrix(tmp_path / "array.xml")
    path = study(tmp_path, rig=f"from: array.xml, {ARRAY}, sensor: {{pixels: [4000, 3000]}}")
    given = {
        "sensor.pixel_pitch": "5.5 um",
        "main_lens.field_of_view": "12 deg",
        "main_lens.entrance_pupil_diameter": "14 mm",
        "focus.total_covering_plane": "1 m",
        "focus.relay": "galilean",
        "depth": "{estimator: widest-pair, disparity_error: 0.2 px}",
        "microlenses.focal_lengths": "null",
    }
    overrides = [f"rig.{key}={value}" for key, value in given.items()]
    camera = tradestudy.load(path, overrides).definition.designs["rig"]
    assert isinstance(camera, FocusedPlenoptic)
    assert camera.main_lens.focal_length == pytest.approx(11e-3 / math.tan(math.radians(6.0)))
    said = ", ".join(
        f"{key.partition('.')[0]}: {{{key.partition('.')[2]}: {value}}}" for key, value in [("focus.relay", "galilean")]
    )
    assert "cameras.rig.focus.mla_distance" not in refusal(study(tmp_path, rig=f"from: array.xml, {said}"))
