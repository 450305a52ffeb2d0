"""Depth maps of rendered pictures, for each kind of camera, against the true depth of the scene."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from tests.scene_studies import PAIR, PLENOPTIC, scene_study
from tradestudy import api, cli
from tradestudy.cameras.depth_map import DepthSearch, FlatPicture
from tradestudy.imaging.estimation import DepthScore
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.window_matching import Reason

pytestmark = pytest.mark.usefixtures("only_rays")

OTHERS = """
  views:
    kind: unfocused-plenoptic
    title: Views
    main_lens: {focal_length: 12.5 mm, f_number: 3.8}
    sensor: {pixels: [1000, 1000], pixel_pitch: 5.5 um}
    microlenses: {layout: hexagonal, pitch: 126.5 um, focal_length: 0.432 mm, f_number: 3.8}
    focus: {distance: 150 mm}
    depth: {estimator: outermost-views, disparity_error: 0.1 px, discrimination_step: 0.1 px}
  stack:
    kind: conventional
    title: Stack
    lens: {focal_length: 25 mm, f_number: 4}
    sensor: {pixels: [160, 120], pixel_pitch: 7.4 um}
    focus: {distance: 150 mm, stack: {from: 130 mm, to: 180 mm, images: 12}}
"""
PLANE = "{{shape: plane, distance: {} mm}}"
SMALL = ["plenoptic.sensor.pixels=[190, 190]", "views.sensor.pixels=[400, 400]"]


def study_text(
    camera: str,
    surface: str,
    *,
    contrast: str = "15 %",
    length: str = "1 mm",
    estimator: str = "same-type-pair",
    lenses: str = "",
    pixels: str = "[400, 400]",
    more: str = "",
) -> str:
    """A study of one camera that takes a surface."""
    cameras = (
        "".join(
            PAIR.format(
                name=name, title=name, pixels="[300, 160]", baseline="10 mm", convergence=convergence, error="0.05 px"
            )
            for name, convergence in (("pair", "infinity"), ("converging", "150 mm"))
        )
        + PLENOPTIC.format(pixels=pixels, estimator=estimator, lenses=lenses)
        + OTHERS
    )
    return scene_study(
        cameras,
        surface,
        distances="from: 120 mm, to: 200 mm, points: 9",
        window="9 px",
        light="at_f_number: 4, at_pixel_pitch: 5.5 um",
        contrast=contrast,
        length=length,
        more=f"cameras: [{camera}]\n    depth_format: npy\n    {more}",
    )


def mapped(
    folder: Path, camera: str, surface: str, overrides: Sequence[str] = (), **said: str
) -> tuple[DepthScore, dict[str, FloatArray]]:
    """Score and maps of one camera."""
    path = folder / "maps.yaml"
    path.write_text(study_text(camera, surface, **said), encoding="utf-8")
    scene = api.render(api.load(path, overrides), folder, depth=True)
    score, written = scene.depths[camera], folder / "pictures" / camera
    maps = {name: np.load(written / f"depth_map{name}.npy") for name in ("", "_deviation", "_true")}
    for name, values in maps.items():
        np.testing.assert_array_equal(scene.arrays[camera][f"depth_map{name}"], values)
    for name in ("_reason", "_measurable"):
        with Image.open(written / f"depth_map{name}.png") as file:
            maps[name] = np.asarray(file)
    return score, maps


@pytest.mark.parametrize("distance", [140, 150, 170])
@pytest.mark.parametrize(
    ("camera", "length"), [("pair", "1 mm"), ("converging", "1 mm"), ("plenoptic", "1 mm"), ("views", "3 mm")]
)
@pytest.mark.slow
def test_planes_are_measured_within_the_predicted_errors(
    tmp_path: Path, camera: str, length: str, distance: int
) -> None:
    if camera in ("pair", "converging"):
        pytest.importorskip("cv2")
    score, maps = mapped(tmp_path, camera, PLANE.format(distance), length=length)
    assert score.seen > 500
    assert score.measured > 0.7 * score.seen
    # 0.1 px (pair: 0.05 px) is predicted: half of that in the mean, nearly all within three times it.
    assert abs(score.relative_bias) < 0.5
    assert score.within > 0.9
    good = np.isfinite(maps[""])
    assert np.array_equal(good, maps["_reason"] == Reason.MEASURED)
    assert np.array_equal(good, np.isfinite(maps["_deviation"]))
    both = good & (maps["_measurable"] > 0)
    assert np.median(maps["_true"][both]) == pytest.approx(distance * 1e-3, rel=1e-3)
    if camera in ("pair", "plenoptic"):  # views alias their texture, which the noise does not tell
        relative = ((maps[""] - maps["_true"]) / maps["_deviation"])[both]
        low, high = np.percentile(relative, [15.87, 84.13])
        assert 0.8 < (high - low) / 2.0 < 1.4


@pytest.mark.parametrize("pupil", ["entrance_pupil=9 mm", "exit_pupil=-6 mm", "exit_pupil=infinity"])
@pytest.mark.parametrize(
    ("camera", "length"), [("pair", "1 mm"), ("plenoptic", "1 mm"), ("views", "3 mm"), ("stack", "1 mm")]
)
@pytest.mark.slow
def test_planes_are_measured_through_lenses_with_distant_pupils(
    tmp_path: Path, camera: str, length: str, pupil: str
) -> None:
    if camera == "pair":
        pytest.importorskip("cv2")
    part = {"pair": "lenses", "stack": "lens"}.get(camera, "main_lens")
    overrides = [f"cameras.{camera}.{part}.{pupil}", f"cameras.{camera}.{part}.principal_separation=-3 mm"]
    if camera == "views":
        overrides += [f"cameras.views.microlenses.{key}" for key in ("focal_length=f-number-matching", "f_number=null")]
    # A pupil at infinity lights fewer microlenses, of which pairs of one type see enough only of farther planes.
    distance = 190 if camera == "plenoptic" else 145
    score, maps = mapped(tmp_path, camera, PLANE.format(distance), overrides, length=length)
    assert score.measured > 0.6 * score.seen > 300
    both = np.isfinite(maps[""]) & (maps["_measurable"] > 0)
    assert np.median(maps[""][both]) == pytest.approx(distance * 1e-3, rel=4e-3)
    assert abs(score.relative_bias) < 0.5 or camera == "stack"


@pytest.mark.parametrize("camera", ["pair", "converging", "plenoptic", "views"])
def test_a_plane_at_the_end_of_the_distances_is_measured(tmp_path: Path, camera: str) -> None:
    """In single precision, 150 mm lies beyond the search range that ends there."""
    assert float(np.float32(0.15)) > 0.15
    ends = ["scene.distances.to=150 mm"]
    beyond = ["scene.distances.to=160 mm"]
    (at_end, _), (inside, _) = (mapped(tmp_path, camera, PLANE.format(150), SMALL + one) for one in (ends, beyond))
    assert inside.seen > 0
    assert at_end.seen == pytest.approx(inside.seen, rel=0.02)
    assert at_end.filled == pytest.approx(inside.filled, abs=0.02)


@pytest.mark.parametrize(
    ("camera", "values"),
    [
        ("plenoptic", {"array_tilt_x": "0.3 deg", "principal_point_y": "0.2 mm", "array_offset_x": "50 um"}),
        ("plenoptic", {"depth_distortion_d1": "40 um", "array_rotation": "3 deg", "distortion_k1": "-3"}),
        pytest.param(
            "views",
            {"array_tilt_y": "0.3 deg", "depth_distortion_d1": "-40 um", "array_offset_y": "30 um"},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_known_values_act_in_the_picture_and_in_depth_read_from_it(
    tmp_path: Path, camera: str, values: dict[str, str]
) -> None:
    """They would make a plane slope by 3.5 mm or more over the picture; at most a fifth of that remains, with noise."""
    said = {"length": "1 mm" if camera == "plenoptic" else "1.5 mm", "contrast": "30 %"}
    near = ["scene.distances.from=140 mm", "scene.distances.to=160 mm"]
    smaller = ["plenoptic.sensor.pixels=[260, 260]", "views.sensor.pixels=[780, 780]"]
    precise = [*smaller, f"cameras.{camera}.depth.estimator=least-squares", *near]
    overrides = [f"cameras.{camera}.calibration.known.{name}={value}" for name, value in values.items()]
    plain, _ = mapped(tmp_path, camera, PLANE.format(150), precise, **said)
    score, maps = mapped(tmp_path, camera, PLANE.format(150), [*precise, *overrides], **said)
    assert score.measured > 0.9 * plain.measured
    assert score.within > plain.within - 0.05
    both = np.isfinite(maps[""]) & (maps["_measurable"] > 0)
    row, column = np.nonzero(both)
    base = np.stack([np.ones(row.size), column / both.shape[1] - 0.5, row / both.shape[0] - 0.5], axis=-1)
    error = (maps[""] - maps["_true"])[both]
    coefficients = np.linalg.lstsq(base, error, rcond=None)[0]
    assert np.abs(coefficients).max() < 0.7e-3, coefficients


@pytest.mark.parametrize("distance", [0.7, 1.03, 1.4])
def test_a_plane_at_the_nearest_distance_is_measured(tmp_path: Path, distance: float) -> None:
    pytest.importorskip("cv2")
    values = {"scene.distances.from": f"{distance} m", "scene.image.surfaces.0.distance": f"{distance} m"}
    study = api.load(Path(__file__).parent / "data" / "plane-at-the-end" / "near.yaml").with_values(values)
    score = api.render(study, tmp_path, depth=True).depths["c"]
    assert score.filled > 0.98
    assert score.available > 0.85


@pytest.mark.parametrize("distance", [138, 150, 168])
def test_the_sharpest_of_a_stack_lies_within_a_sixth_of_a_step(tmp_path: Path, distance: int) -> None:
    score, _ = mapped(tmp_path, "stack", PLANE.format(distance), length="0.3 mm")
    assert score.measured > 0.9 * score.seen
    step = 46e-3 / 11
    assert abs(score.bias) < step / 6
    assert score.spread < step / 6
    assert np.isnan(score.predicted)


@pytest.mark.parametrize(
    "across",
    [lambda columns: np.linspace(1.0, 4.0, columns), lambda columns: np.where(np.arange(columns) % 12 < 2, 3.0, 1.0)],
    ids=["to one side", "in some columns"],
)
def test_a_stack_measures_nothing_in_noise_that_differs_over_the_picture(
    tmp_path: Path, across: Callable[[int], np.ndarray]
) -> None:
    """Noise of four times the standard deviation has sixteen times the energy, and no more texture."""
    path = tmp_path / "maps.yaml"
    path.write_text(study_text("stack", PLANE.format(150)), encoding="utf-8")
    study = api.load(path).prepared
    camera, reader = study.case.all_cameras["stack"], study.file.cameras["stack"].reader
    assert reader is not None
    sensor = camera.sensor
    noise = np.broadcast_to(np.float32(0.01 * across(sensor.columns)), (sensor.rows, sensor.columns))
    rng = np.random.default_rng(4)
    pictures = {
        one.name: FlatPicture(
            values=np.asarray(1.0 + noise * rng.standard_normal(noise.shape), np.float32),
            variance=np.square(noise),
            pure=np.ones(noise.shape, bool),
        )
        for one in camera.exposures(0.15, {}, None, 0.0)
    }
    found = reader(camera=camera, search=DepthSearch(near=0.12, far=0.2, window_px=9.0)).read(pictures)
    for half in np.array_split(found.reason, 2, axis=1):
        assert np.mean(half == Reason.MEASURED) < 0.01


@pytest.mark.parametrize(
    ("estimator", "lenses"),
    [("adjacent-pair", ""), ("widest-pair", "microlenses: sharpest-type, "), ("least-squares", "microlenses: all, ")],
)
def test_every_estimator_measures_a_plane(tmp_path: Path, estimator: str, lenses: str) -> None:
    score, maps = mapped(
        tmp_path, "plenoptic", PLANE.format(150), estimator=estimator, lenses=lenses, pixels="[130, 130]"
    )
    assert score.measured > 0.5 * score.seen
    assert abs(score.bias) < 0.5e-3
    both = np.isfinite(maps[""]) & (maps["_measurable"] > 0)
    assert np.mean(np.abs(maps[""] - maps["_true"])[both] < 4.0 * maps["_deviation"][both]) > 0.9


@pytest.mark.parametrize(("camera", "length"), [("pair", "1 mm"), ("plenoptic", "1 mm"), ("stack", "0.3 mm")])
def test_the_map_has_the_orientation_of_the_scene(tmp_path: Path, camera: str, length: str) -> None:
    """A plane that recedes to the right, and half as much downwards."""
    if camera == "pair":
        pytest.importorskip("cv2")
    surface = "{shape: plane, distance: 150 mm, tilt_x: 50 deg, tilt_y: 30 deg}"
    _, maps = mapped(tmp_path, camera, surface, SMALL, length=length)
    both = np.isfinite(maps[""]) & (maps["_measurable"] > 0)
    row, column = np.nonzero(both)
    base = np.stack([np.ones(row.size), column - column.mean(), row - row.mean()], axis=-1)
    found, true = (np.linalg.lstsq(base, maps[name][both], rcond=None)[0] for name in ("", "_true"))
    assert true[1] > 0 < true[2]
    assert found[1:] == pytest.approx(true[1:], rel=0.15)


@pytest.mark.parametrize(
    ("camera", "pixels"),
    [("pair", "[300, 160]"), ("plenoptic", "[170, 170]"), ("views", "[440, 440]"), ("stack", "[100, 80]")],
)
def test_nothing_is_measured_without_texture(tmp_path: Path, camera: str, pixels: str) -> None:
    if camera == "pair":
        pytest.importorskip("cv2")
    score, maps = mapped(tmp_path, camera, PLANE.format(150), [f"{camera}.sensor.pixels={pixels}"], contrast="0.05 %")
    assert score.seen > 300
    assert score.measured < 0.01 * score.seen
    assert np.mean(np.isfinite(maps[""])) < 0.01


def test_a_range_of_disparities_wider_than_the_picture_costs_no_more_than_the_picture(tmp_path: Path) -> None:
    """From 10 um on, a pair with a base of 10 mm has disparities of more than a million pixels."""
    pytest.importorskip("cv2")
    path = tmp_path / "maps.yaml"
    path.write_text(study_text("pair", PLANE.format(150)), encoding="utf-8")
    study = api.load(path)
    near = study.with_values({"scene.distances": "[10 um, 150 mm, 200 mm]"})
    score = api.render(near, tmp_path / "near", depth=True).depths["pair"]
    declared = api.render(study, tmp_path / "declared", depth=True).depths["pair"]
    assert score.measured > 0.7 * score.seen
    assert score.bias == pytest.approx(declared.bias, abs=0.1 * declared.spread)


@pytest.mark.parametrize("camera", ["pair", "plenoptic"])
def test_a_plane_beyond_the_search_range_has_no_depth(tmp_path: Path, camera: str) -> None:
    if camera == "pair":
        pytest.importorskip("cv2")
    score, maps = mapped(tmp_path, camera, "{shape: plane, distance: 50 m}", pixels="[170, 170]")
    assert (maps["_true"][np.isfinite(maps["_true"])] > 49.0).all()
    # A pair of windows that look alike by chance is all that may be found.
    assert np.isfinite(maps[""]).mean() < 0.05
    assert score.seen == 0


def test_points_seen_by_one_of_two_cameras_are_hardly_ever_measured(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    score, maps = mapped(tmp_path, "pair", "{shape: step, near: 130 mm, far: 180 mm}")
    assert score.measured > 0.85 * score.seen
    hidden = (maps["_measurable"] == 0) & np.isfinite(maps["_true"])
    assert np.count_nonzero(hidden) > 500
    assert score.measured_unseen < 0.1 * np.count_nonzero(hidden)


def test_a_rig_off_its_design_measures_as_much_as_one_as_designed(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    errors = "{pitch: {standard_deviation: 0.5 deg}, roll: {standard_deviation: 0.5 deg}}"
    text = study_text("pair", PLANE.format(150), more="rig: drawn").replace(
        "baseline: 10 mm", f"baseline: 10 mm\n    calibration: {{errors: {errors}}}", 1
    )
    path = tmp_path / "maps.yaml"
    path.write_text(text, encoding="utf-8")
    score = api.render(api.load(path), tmp_path, depth=True).depths["pair"]
    camera = json.loads((tmp_path / "pictures" / "pair" / "camera.json").read_text(encoding="utf-8"))
    assert max(abs(error) for error in camera["errors"].values()) > 2e-3  # 1.7 px
    assert score.filled > 0.95
    assert score.within > 0.95
    assert "factor:" not in score.matcher  # calibration errors are none of the matcher's
    assert "scene.image.rig" in score.matcher


def test_the_command_says_how_well_each_camera_measured(tmp_path: Path) -> None:
    path = tmp_path / "maps.yaml"
    path.write_text(study_text("plenoptic", PLANE.format(150), pixels="[240, 240]"), encoding="utf-8")
    answer = CliRunner().invoke(cli.app, ["render", str(path), "--depth", "--out", str(tmp_path / "out")])
    assert "plenoptic: " in answer.output
    assert "unoccluded points measured" in answer.output
    assert "matcher: {factor: 1" in answer.output
    facts = json.loads((tmp_path / "out" / "pictures" / "plenoptic" / "depth_map.json").read_text(encoding="utf-8"))
    assert facts["unit"] == "m"
    assert facts["score"]["within"] > 0.9
    assert set(facts["reasons"]) == {str(int(reason)) for reason in Reason}


def test_stereo_without_the_library_says_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ValueError, match=r"pip install '\.\[images\]'"):
        mapped(tmp_path, "pair", PLANE.format(150))
    path = tmp_path / "maps.yaml"
    path.write_text(study_text("pair", PLANE.format(150), more="depth_maps: true"), encoding="utf-8")
    for command in ("check", "plan"):
        said = CliRunner().invoke(cli.app, [command, str(path)])
        assert said.exit_code == 2
        assert "scene.image.depth_maps: depth from stereo pictures needs OpenCV" in said.output


@pytest.mark.parametrize("command", ["check", "plan"])
def test_depth_in_saturated_pictures_is_refused_first(tmp_path: Path, command: str) -> None:
    """80 000 electrons at f/4 and 5.5 µm are 80 000 (4 · 10/(8.451 · 5.5))² in pixels of 10 µm at f/8.451."""
    pytest.importorskip("cv2")
    path = tmp_path / "maps.yaml"
    text = study_text("pair", PLANE.format(150), more="depth_maps: true")
    path.write_text(text.replace("8000 electrons", "80000 electrons"), encoding="utf-8")
    said = CliRunner().invoke(cli.app, [command, str(path)])
    assert said.exit_code == 2
    assert re.search(r"scene\.picture\.light: the pictures of pair would be saturated: 59300 e", said.output)


def test_a_plane_is_sharpest_refocused_where_it_is_and_views_shift_by_parallax(tmp_path: Path) -> None:
    """Between views ±u of a plane at a, the picture on the array moves by 2u b_L/z / (1/v − b_L/z)."""
    path = tmp_path / "maps.yaml"
    mapped(tmp_path, "plenoptic", PLANE.format(150), pixels="[260, 260]")
    written = tmp_path / "pictures" / "plenoptic"
    left, right, sharp = (np.load(written / f"{name}.npy") for name in ("view_left", "view_right", "all_in_focus"))
    assert left.shape == right.shape == sharp.shape == (130, 130)
    # On the object: u a part of the pupil; a/(…) by similar triangles through the array, half a pixel of which is one
    # sample. The plane of zero parallax is where the main lens images on the array.
    camera = api.load(path).prepared.case.all_cameras["plenoptic"]
    z, f, aside = camera.mla_distance, 12.5e-3, 0.25 * 12.5e-3 / 3.8
    image = 1.0 / (1.0 / f - 1.0 / 0.15)
    expected = 2.0 * aside * (z - image) / image / 11e-6  # lines from ±u through the image point, on to the array
    inner = np.s_[20:-20, 20:-20]
    a, b = (np.fft.fft2(one[inner] - np.mean(one[inner])) for one in (left, right))
    row, column = np.unravel_index(np.argmax(np.fft.ifft2(b * np.conj(a)).real), (90, 90))
    assert (int(row), int(column)) == pytest.approx((0, expected), abs=1.0)
