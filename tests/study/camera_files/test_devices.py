"""Cameras of mrcal, DepthAI and libpleno."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import tradestudy
from tests.study.camera_files import devices, written
from tests.study.camera_files.test_import import expected, refusal, shared
from tests.study.camera_files.written import study
from tradestudy.cameras.focused_plenoptic.declaration import FocusedPlenopticDeclaration
from tradestudy.cameras.focused_plenoptic.design import FocusedPlenoptic
from tradestudy.optics.lens_model import LensModel

PLENOPTIC = "depth: {estimator: adjacent-pair, disparity_error: 0.1 px, discrimination_step: 0.1 px}"


def said_by(path: Path, name: str = "rig") -> dict[str, str]:
    return dict(tradestudy.load(path).file.cameras[name].read_as)


def test_two_cameramodels_in_one_frame_of_reference_make_the_pair(tmp_path: Path) -> None:
    devices.cameramodels(tmp_path)
    found = shared(study(tmp_path, rig="from: [left.cameramodel, right.cameramodel]"))
    np.testing.assert_allclose(found, expected(), rtol=1e-12, atol=1e-14)


def test_the_former_name_of_the_pose_and_inputs_of_the_optimisation(tmp_path: Path) -> None:
    for file in devices.cameramodels(tmp_path, optimization_inputs=b"not read" * 300_000):
        file.write_text(file.read_text().replace("rt_cam_ref", "extrinsics"))
    path = study(tmp_path, rig="from: [left.cameramodel, right.cameramodel]")
    np.testing.assert_allclose(shared(path), expected(), rtol=1e-12, atol=1e-14)
    assert said_by(path)["uncertainty"].startswith("optimization_inputs are ignored")
    assert said_by(path)["direction of transforms"] == "extrinsics maps the reference into the camera"


@pytest.mark.parametrize(
    ("model", "why"),
    [
        ("LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=20_fov_x_deg=150", "is a splined model"),
        ("LENSMODEL_CAHVORE_linearity=0.34", "is a non-central model"),
        (
            "LENSMODEL_CAHVOR",
            "mrcal's own command: mrcal-convert-lensmodel LENSMODEL_OPENCV8 left.cameramodel",
        ),
        ("LENSMODEL_FANCY", "is unknown"),
    ],
)
def test_models_that_are_not_central_are_refused_by_name(tmp_path: Path, model: str, why: str) -> None:
    devices.cameramodels(tmp_path, lensmodel=model)
    assert why in refusal(study(tmp_path, rig="from: [left.cameramodel, right.cameramodel]"))


def test_nothing_in_a_cameramodel_is_executed(tmp_path: Path) -> None:
    sign = tmp_path / "executed"
    path = devices.cameramodels(tmp_path)[0]
    path.write_text(path.read_text().replace("[640, 480]", f"[open({str(sign)!r}, 'w').write('x'), 480]"))
    message = refusal(study(tmp_path, rig="from: [left.cameramodel, right.cameramodel]"))
    assert message.startswith(f"{path}:")
    assert not sign.exists()


def test_a_device_gives_its_stereo_pair_in_centimetres(tmp_path: Path) -> None:
    devices.device(tmp_path / "oak.json")
    path = study(tmp_path, rig="from: oak.json")
    np.testing.assert_allclose(shared(path), expected(), rtol=1e-12, atol=1e-14)
    assert said_by(path)["translation"] == "measured (translation)"
    assert said_by(path)["length unit"] == "cm, by the definition of DepthAI calibrations"


def test_a_device_without_a_measured_translation_gives_the_specified_one(tmp_path: Path) -> None:
    devices.device(tmp_path / "oak.json", measured=False)
    path = study(tmp_path, rig="from: oak.json")
    np.testing.assert_allclose(shared(path)[15:], [-0.06, 0.0, 0.0])
    assert said_by(path)["translation"].startswith("specified (specTranslation)")


@pytest.mark.parametrize(("flag", "moved"), [(1, -0.06), ("yes", -0.06), (0, written.T[0]), ("no", written.T[0])])
def test_a_device_says_in_every_spelling_which_translation_it_uses(tmp_path: Path, flag: object, moved: float) -> None:
    file = devices.device(tmp_path / "oak.json")
    path, says = study(tmp_path, rig="from: oak.json"), json.loads(file.read_text())
    file.write_text(json.dumps(says | {"stereoUseSpecTranslation": flag}))
    assert shared(path)[15] == pytest.approx(moved, rel=1e-12)
    file.write_text(json.dumps(says | {"stereoUseSpecTranslation": "measured"}))
    assert "stereoUseSpecTranslation: 'measured' is unknown; one of 1, true, yes" in refusal(path)


def test_a_chain_of_extrinsics_joins_any_two_cameras_of_a_device(tmp_path: Path) -> None:
    devices.device(tmp_path / "oak.json")
    found = shared(study(tmp_path, rig="from: oak.json, pair: ['1', '0']"))
    np.testing.assert_allclose(found[15:], written.T + np.array([0.03, 0.0, 0.0]), rtol=1e-12)


def test_the_relay_follows_from_the_microlenses_and_not_from_the_main_lens(tmp_path: Path) -> None:
    devices.plenoptic(tmp_path / "r12.js")
    loaded = tradestudy.load(study(tmp_path, r12=f"from: r12.js, {PLENOPTIC}"))
    camera = loaded.definition.designs["r12"]
    assert isinstance(camera, FocusedPlenoptic)
    assert camera.main_lens.focal_length == pytest.approx(0.04989)
    assert camera.mla_distance == pytest.approx(0.05686)
    assert camera.microlenses.gap == pytest.approx(0.32e-3)
    relay = loaded.file.cameras["r12"].read_as["relay"]
    assert relay.startswith("galilean: ")
    assert all(word in relay for word in ("578 µm", "320 µm", "keplerian"))


def test_depth_is_corrected_as_by_libpleno_whose_lengths_are_millimetres(tmp_path: Path) -> None:
    a, b, c = 1.1e-4, 0.9, 12.0
    devices.plenoptic(tmp_path / "r12.js", scaling={"a": f"{a}", "b": f"{b}", "c": f"{c}"})
    path = study(tmp_path, r12=f"from: r12.js, {PLENOPTIC}")
    loaded = tradestudy.load(path)
    part = loaded.file.cameras["r12"]
    assert isinstance(part, FocusedPlenopticDeclaration)
    scaling = part.depth.scaling
    assert (scaling.quadratic, scaling.linear, scaling.offset) == pytest.approx((0.11, 0.9, 0.012), rel=1e-15)
    note = loaded.definition.document.annotations["cameras", "r12", "depth", "scaling", "quadratic"]
    assert note.basis == "measured"
    assert "r12.js: scaling" in note.note
    camera = loaded.definition.designs["r12"]
    assert isinstance(camera, FocusedPlenoptic)
    # From virtual depth to metric depth in millimetres, as PlenopticCamera::mla2obj computes it: f, D, d of the file.
    image = 56.86 - camera.virtual_depth(np.array([0.5, 0.9])) * 0.32
    modelled = 49.89 * image / (image - 49.89)
    np.testing.assert_allclose(a * modelled**2 + b * modelled + c, [500.0, 900.0], rtol=1e-9)
    devices.plenoptic(tmp_path / "r12.js")
    declared = PLENOPTIC.replace("{", "{scaling: {quadratic: 1.1e-4 1/mm, linear: 0.9, offset: 12 mm}, ")
    same = tradestudy.load(study(tmp_path, r12=f"from: r12.js, {declared}")).definition.designs["r12"]
    assert same == camera


def test_a_correction_that_does_not_grow_with_depth_is_refused(tmp_path: Path) -> None:
    path = study(tmp_path, r12=f"from: r12.js, {PLENOPTIC}")
    devices.plenoptic(tmp_path / "r12.js", scaling={"a": "0", "b": "-1", "c": "0"})
    assert "a number above 0 is expected" in refusal(path)
    devices.plenoptic(tmp_path / "r12.js", scaling={"a": "-4e-4", "b": "1", "c": "0"})
    message = refusal(path)
    assert "below 0.625 m, where 2 a Z + b is zero" in message
    assert "reduce the distances" in message


def test_distances_beside_the_poses_of_libpleno_are_compared_with_them(tmp_path: Path) -> None:
    path = study(tmp_path, r12=f"from: r12.js, {PLENOPTIC}")
    devices.plenoptic(tmp_path / "r12.js", D="56.8599", d="0.32002")
    camera = tradestudy.load(path).definition.designs["r12"]
    assert isinstance(camera, FocusedPlenoptic)
    assert (camera.mla_distance, camera.microlenses.gap) == pytest.approx((0.05686, 0.32e-3), rel=1e-12)
    devices.plenoptic(tmp_path / "r12.js", d="0.33")
    assert "d: 0.33 contradicts the distance by the poses of mla and sensor, 0.32; correct one" in refusal(path)
    devices.plenoptic(tmp_path / "r12.js", D="57")
    assert "D: 57 contradicts the distance by the poses of mla and sensor, 56.86; correct one" in refusal(path)


def test_microlenses_shorter_than_the_gap_are_keplerian(tmp_path: Path) -> None:
    array = {"focal_lengths": ["0.2", "0.25", "0.3"], "mesh": {"geometry": "1", "pitch": ["0.12745"]}}
    array["mesh"]["pose"] = devices._pose("-56.86")  # type: ignore[call-overload]
    devices.plenoptic(tmp_path / "r12.js", mla=array)
    assert said_by(study(tmp_path, r12=f"from: r12.js, {PLENOPTIC}"), "r12")["relay"].startswith("keplerian")


def test_a_single_camera_is_a_conventional_one(tmp_path: Path) -> None:
    devices.cameramodels(tmp_path)
    path = study(tmp_path, eye="from: left.cameramodel, sensor: {pixel_pitch: 3 um}, focus: {distance: 1 m}")
    camera = tradestudy.load(path).definition.designs["eye"]
    assert camera.gathering_lens.focal_length == pytest.approx((882.5 + 881.75) / 2 * 3e-6)


def turned(x: float, y: float, z: float) -> np.ndarray:
    return cv2.Rodrigues(np.array([x, y, z]))[0]


def posed(rotation: np.ndarray, moved: list[float]) -> dict[str, object]:
    """A pose as libpleno writes it: matrices and vectors by columns."""
    return {"rotation": [[f"{one!r}" for one in column.tolist()] for column in rotation.T], "translation": [moved]}


ARRAY, SENSOR = turned(8e-4, -6e-4, 2e-3), turned(0.0, 0.0, 1e-3)
MOVED, CORNER = [-10.97, -7.89, -56.70], [-11.04, -8.01, -57.03]


def posed_file(path: Path, **changed: object) -> None:
    mesh = {"geometry": "1", "pitch": [["0.12745", "0.12745"]], "pose": posed(ARRAY, MOVED)}
    sensor = {"scale": "0.0055", "width": "4080", "height": "3068", "pose": posed(SENSOR, CORNER)}
    devices.plenoptic(path, sensor=sensor, mla={"focal_lengths": ["0.578", "0.504", "0.551"], "mesh": mesh}, **changed)


def projected(image: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Positions from the middle of the upright picture [mm] of an image by microlenses, as libpleno's poses say."""
    centres = ARRAY @ nodes + np.array(MOVED)[:, np.newaxis]
    ray = centres - image[:, np.newaxis]
    on_sensor = centres + ray * ((CORNER[2] - centres[2]) / ray[2])
    x, y = (SENSOR.T @ (on_sensor - np.array(CORNER)[:, np.newaxis]))[:2] / 0.0055
    return np.asarray(np.stack([4079 - x - 2039.5, 3067 - y - 1533.5]) * 0.0055)


def nodes_near(image: np.ndarray) -> np.ndarray:
    """Centres of six microlenses of the mesh [mm] about the line from the centre of the lens through an image."""
    away = ARRAY.T @ (image * (-56.70 / image[2]) - np.array(MOVED))
    row = round(float(away[1]) / (0.12745 * np.sin(np.pi / 3)))
    found = []
    for j in (row, row + 1):
        shift = 0.5 if j % 2 == 0 else 0.0
        column = round(float(away[0]) / 0.12745 - shift)
        found += [
            (0.12745 * (i + shift), 0.12745 * j * np.sin(np.pi / 3), 0.0) for i in (column - 1, column, column + 1)
        ]
    return np.array(found).T


@pytest.mark.parametrize("point", [(0.0, 0.0, 300.0), (60.0, -40.0, 300.0), (-50.0, -45.0, 360.0)])
def test_pictures_show_points_where_the_poses_of_libpleno_do(tmp_path: Path, point: tuple[float, ...]) -> None:
    posed_file(tmp_path / "r12.js")
    camera = tradestudy.load(study(tmp_path, r12=f"from: r12.js, {PLENOPTIC}")).definition.designs["r12"]
    assert isinstance(camera, FocusedPlenoptic)
    world = np.array(point)
    image = -49.89 / (world[2] - 49.89) * world
    nodes = nodes_near(image)
    centres = ARRAY @ nodes + np.array(MOVED)[:, np.newaxis]
    ray = centres - image[:, np.newaxis]
    lit = np.hypot(*(centres - ray * (centres[2] / ray[2]))[:2]) < 49.89 / 8.0  # from the pupil
    lands = projected(image, nodes[:, lit]) * 1e-3
    cones = camera.exposures(point[2] * 1e-3, {}, None, 0.0)[0].cones(lands[0], lands[1])
    aligned = SENSOR[:2, :2].T @ world[:2, np.newaxis] * 1e-3  # with the rows of pixels
    miss = np.hypot(*(cones.start + world[2] * 1e-3 * cones.slope - aligned))
    assert lit.sum() >= 2
    assert max(miss[cones.pixel == pixel].min() for pixel in range(lit.sum())) < 2e-6


def test_field_of_a_known_distortion_is_searched_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    searched, search = [], LensModel._end_of_field
    monkeypatch.setattr(LensModel, "_end_of_field", lambda *given: searched.append(given[0]) or search(*given))
    devices.plenoptic(tmp_path / "r12.js", distortions={"radial": ["1.7e-4"], "tangential": ["-1e-4", "-4e-5"]})
    camera = tradestudy.load(study(tmp_path, r12=f"from: r12.js, {PLENOPTIC}")).cameras["r12"]
    camera.depth_uncertainty([0.6, 0.8])
    once = len(searched)
    camera.depth_uncertainty(1.0)
    assert 0 < once == len(searched)


def test_depth_distortion_and_lateral_distortion_are_those_of_libpleno(tmp_path: Path) -> None:
    """Of an image near the array, where the coefficients apply: displaced along the axis, and across it."""
    a, b = (1e-4, -2e-7, 3e-10), (-6e-5, 4e-5)
    d = (-0.011, 4e-4, -5e-7)
    bent = {"radial": [[*map(str, a)]], "tangential": [[*map(str, b)]], "depth": [[*map(str, d)]], "model": "1"}
    posed_file(tmp_path / "r12.js", distortions=bent)
    camera = tradestudy.load(study(tmp_path, r12=f"from: r12.js, {PLENOPTIC}")).definition.designs["r12"]
    assert isinstance(camera, FocusedPlenoptic)
    plain = replace(camera, known=tuple(one for one in camera.known if "distortion" not in one[0]))
    world = np.array([60.0, -40.0, 395.0])
    x, y, z = -49.89 / (world[2] - 49.89) * world
    r2 = x * x + y * y
    grown = a[0] * r2 + a[1] * r2**2 + a[2] * r2**3
    across = (
        x * grown + b[0] * (r2 + 2 * x * x) + 2 * b[1] * x * y,
        y * grown + b[1] * (r2 + 2 * y * y) + 2 * b[0] * x * y,
    )
    along = (1 + d[0] * z) * (d[1] * r2 + d[2] * r2**2)
    (far, *at), (near, *before) = ([float(v) for v in one.observe({}, *(world * 1e-3))] for one in (camera, plain))
    # Upright, in the frame of the sensor.
    moved = -SENSOR[:2, :2].T @ across * 1e-3
    np.testing.assert_allclose(np.array(at) - np.array(before), moved, rtol=0.02, atol=2e-7)
    spacing = float(camera.estimator_baseline(np.array([world[2] * 1e-3]))[0])
    gap = camera.microlenses.gap
    moved_along = gap / (far / spacing - 1.0) - gap / (near / spacing - 1.0)  # a_L by the gap of the axis
    assert moved_along == pytest.approx(along * 1e-3, rel=0.05)


def test_a_sensor_that_is_tilted_and_an_inverse_distortion_alone_are_warned_of(tmp_path: Path) -> None:
    path = study(tmp_path, r12=f"from: r12.js, {PLENOPTIC}")
    posed_file(tmp_path / "r12.js")
    assert not [one for one in tradestudy.load(path).warnings if "are computed without" in one]
    sensor = {"scale": "0.0055", "width": "4080", "height": "3068", "pose": posed(turned(0.01, 0.0, 0.0), CORNER)}
    devices.plenoptic(tmp_path / "r12.js", sensor=sensor, distortions_inverse={"radial": ["-0.0002", "0", "0"]})
    (warned,) = [one for one in tradestudy.load(path).warnings if "are computed without" in one]
    assert "the tilt of the sensor by 0.573" in warned
    assert "distortion of the main lens, given only by its inverse, distortions_inverse" in warned


def test_microlenses_on_both_sides_and_pinholes_are_read(tmp_path: Path) -> None:
    array = {"focal_lengths": ["0.2", "0.35", "0.5"], "mesh": {"geometry": "2", "pitch": ["0.12745"]}}
    array["mesh"]["pose"] = devices._pose("-56.86")  # type: ignore[call-overload]
    path = study(tmp_path, r12=f"from: r12.js, {PLENOPTIC}")
    devices.plenoptic(tmp_path / "r12.js", mla=array)
    assert said_by(path, "r12")["relay"].startswith("type 1 keplerian, type 2 galilean, type 3 galilean")
    camera = tradestudy.load(path).definition.designs["r12"]
    assert isinstance(camera, FocusedPlenoptic)
    assert camera.focus.keplerian == (True, False, False)
    assert abs(dict(camera.known)["array_rotation"]) == pytest.approx(np.pi / 6)  # neighbours along columns
    for lengths in ([], None):
        array = {**array, "focal_lengths": lengths} if lengths is not None else {"mesh": array["mesh"]}
        devices.plenoptic(tmp_path / "r12.js", mla=array)
        assert said_by(path, "r12")["relay"] == "microlenses without focal lengths are pinholes"
        camera = tradestudy.load(path).definition.designs["r12"]
        assert camera.microlenses.focal_lengths == (np.inf,)


def test_the_main_lens_of_a_plenoptic_file_is_at_the_origin(tmp_path: Path) -> None:
    path = study(tmp_path, r12=f"from: r12.js, {PLENOPTIC}")
    pose = devices._pose("0")
    lens = {"f": "49.89", "aperture": "4"}
    devices.plenoptic(tmp_path / "r12.js", main_lens={**lens, "pose": {**pose, "translation": [["0"], ["0"], ["0"]]}})
    assert "main_lens" not in tradestudy.load(path).imported[0]
    devices.plenoptic(tmp_path / "r12.js", main_lens={**lens, "pose": {**pose, "translation": [["0", "0", "1.5"]]}})
    assert "main_lens.pose.translation: the main lens must be at the origin; subtract" in refusal(path)
    turned = {"translation": [["0", "0", "0"]], "rotation": [["0", "-1", "0"], ["1", "0", "0"], ["0", "0", "1"]]}
    devices.plenoptic(tmp_path / "r12.js", main_lens={**lens, "pose": turned})
    assert "main_lens.pose.rotation: a rotated main lens is not supported" in refusal(path)


@pytest.mark.parametrize(("array", "sensor"), [("56.86", "-57.18"), ("-56.86", "57.18")])
def test_array_and_sensor_of_a_plenoptic_file_lie_on_one_side(tmp_path: Path, array: str, sensor: str) -> None:
    file, path = tmp_path / "r12.js", study(tmp_path, r12=f"from: r12.js, {PLENOPTIC}")
    text = devices.plenoptic(file).read_text()
    file.write_text(text.replace("-56.86", array).replace("-57.18", sensor))
    assert f"{sensor} and the z of the microlens array, {array}, have different signs" in refusal(path)
    file.write_text(text.replace("-56.86", "56.86").replace("-57.18", "57.18"))
    assert tradestudy.load(path).definition.designs["r12"].mla_distance == pytest.approx(0.05686)


def test_what_a_plenoptic_file_states_and_is_not_used_is_printed(tmp_path: Path) -> None:
    path = study(tmp_path, r12=f"from: r12.js, {PLENOPTIC}")
    turned = {**devices._pose("-57.18"), "rotation": [["0", "-1", "0"], ["1", "0", "0"], ["0", "0", "1"]]}
    sensor = {"scale": "0.0055", "width": "4080", "height": "3068", "pose": turned}
    devices.plenoptic(tmp_path / "r12.js", sensor=sensor)
    loaded = tradestudy.load(path)
    assert "the file's mode, keplerian, is not used" in loaded.imported[0]
    assert "poses are those of the upright picture, in which x and y of the file are reversed" in loaded.imported[0]
