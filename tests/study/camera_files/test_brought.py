"""Calibration files as people bring them: read with the right values, or refused with the true reason."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

import tradestudy
from tests.study.camera_files import devices, written
from tests.study.camera_files.test_import import calibrated, refusal
from tests.study.camera_files.written import study
from tradestudy.calibration.corners import rig_measurement
from tradestudy.cli import app
from tradestudy.errors import StudyError
from tradestudy.optics.lens_families import KannalaBrandt
from tradestudy.optics.lens_model import Rational

DATA = Path(__file__).parents[2] / "data"
R_OF_SIX_DIGITS = np.round(written.R, 6)


def new(folder: Path, monkeypatch: pytest.MonkeyPatch, *files: str, **said: str) -> tuple[int, str]:
    """Exit status and output of ``new --from``, keys of several parts joined by two underscores."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(rig_measurement, "_NODES", (9, 7))  # the overlap need not be accurate here
    (folder / "x.yaml").unlink(missing_ok=True)
    asked = ["new", "x", *(word for file in files for word in ("--from", str(DATA / file)))]
    for key, value in said.items():
        asked += ["--set", f"{key.replace('__', '.')}={value}"]
    made = CliRunner().invoke(app, asked)
    return made.exit_code, made.output


def sigma_at_1m(path: Path) -> float:
    """Depth uncertainty at 1 m of the camera in a study that ``new`` wrote [m]."""
    near = "scene.distances={from: 0.9 m, to: 1 m, points: 2, spacing: log}"
    depth = tradestudy.load(path, [near, "solve=null", "requirements=null"]).run().data["depth"]
    return float(depth["depth_uncertainty"].values.ravel()[-1])


@pytest.mark.parametrize("file", ["t265.yml", "mid.yml"])
def test_four_coefficients_in_a_wide_picture_are_asked_about(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str
) -> None:
    name = f"fisheye-unlabelled/{file}"
    status, said = new(tmp_path, monkeypatch, name, length_unit="m")
    assert status == 2
    assert "lens_model: fisheye or lens_model: pinhole" in said
    assert "--set length_unit" not in said  # it was given
    for kind, words, lens in (("fisheye", "fisheye (Kannala–Brandt)", KannalaBrandt), ("pinhole", "pinhole", Rational)):
        status, said = new(tmp_path, monkeypatch, name, length_unit="m", lens_model=kind)
        assert status == 0, said
        assert f"lens model {words} with k1 k2" in said
        assert isinstance(calibrated(tmp_path / "x.yaml").lenses[0], lens)


def test_the_field_of_view_of_a_fisheye_lens_is_that_of_its_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By OpenCV's own inverse; a pinhole of this focal length would see 112° across."""
    _, said = new(tmp_path, monkeypatch, "fisheye-unlabelled/t265.yml", length_unit="m", lens_model="fisheye")
    k, d = np.array([[285.0, 0, 427], [0, 285, 401], [0, 0, 1]]), np.array([-0.002, 0.04, -0.037, 0.0062])

    def angle(x: float, y: float) -> float:
        """Newton's method for the angle that OpenCV's polynomial maps to a radius."""
        radius = math.hypot((x - 427) / 285, (y - 401) / 285)
        roots = np.roots([d[3], 0, d[2], 0, d[1], 0, d[0], 0, 1, -radius])
        return float(min(one.real for one in roots if abs(one.imag) < 1e-9 and one.real > 0))

    across, down = (
        math.degrees(angle(*a) + angle(*b)) for a, b in (((-0.5, 401), (847.5, 401)), ((427, -0.5), (427, 799.5)))
    )
    assert cv2.fisheye.undistortPoints(np.array([[[527.0, 401.0]]]), k, d)[0, 0, 0] == pytest.approx(
        math.tan(angle(527, 401)), rel=1e-6
    )
    assert f"field of view {across:.0f}° × {down:.0f}°" in said


def test_another_size_than_that_of_the_calibrated_pictures_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = "other-resolution/cal1280.yml"
    status, said = new(tmp_path, monkeypatch, file, length_unit="mm", sensor__pixels="[960, 540]")
    assert status == 2
    assert all(
        words in said for words in ("sensor.pixels: 960 × 540 px", "1280 × 720 px", "multiply fx, fy, cx and cy")
    )
    status, said = new(tmp_path, monkeypatch, file, length_unit="mm")
    assert status == 0
    assert "1280 × 720 px" in said
    text = (DATA / file).read_text()
    for full, scaled in (("900.0", "675.0"), ("640.0", "480.0"), ("360.0", "270.0"), ("1280", "960"), ("720", "540")):
        text = text.replace(full, scaled)
    (tmp_path / "cal960.yml").write_text(text)  # as the message says
    status, said = new(tmp_path, monkeypatch, str(tmp_path / "cal960.yml"), length_unit="mm")
    assert status == 0
    # σ = Z² σ_d / (f B), with 0.1 px at 1 m
    assert sigma_at_1m(tmp_path / "x.yaml") == pytest.approx(0.1 / (675.0 * 0.12), rel=2e-3)


def test_the_size_holds_in_every_way_to_change_it(tmp_path: Path) -> None:
    written.opencv(tmp_path / "rig.yml")
    devices.plenoptic(tmp_path / "r12.js")
    depth = "depth: {estimator: adjacent-pair, disparity_error: 0.1 px, discrimination_step: 0.1 px}"
    path = study(tmp_path, rig="from: rig.yml, length_unit: mm", half="like: rig, sensor: {pixels: [320, 240]}")
    assert "cameras.half.sensor.pixels: 320 × 240 px is not the size" in refusal(path)
    path = study(tmp_path, r12=f"from: r12.js, {depth}, sensor: {{pixels: [2040, 1534]}}")
    assert "4080 × 3068 px" in refusal(path)
    path = study(tmp_path, rig="from: rig.yml, length_unit: mm")
    with pytest.raises(StudyError, match="320 × 240 px is not the size"):
        tradestudy.load(path, ["cameras.rig.sensor.pixels=[320, 240]"])


def test_extrinsics_that_lead_to_the_left_can_be_read_from_the_other_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = [f"opencv-positive-t/{name}.yml" for name in ("intrinsics", "extrinsics")]
    for order in (files, files[::-1]):
        status, said = new(tmp_path, monkeypatch, *order, length_unit="mm")
        assert status == 2
        assert "swap" not in said
        assert all(words in said for words in ("x₂ = R x₁ + T", "pair: [2, 1]", "Rᵀ and −Rᵀ T"))
        status, said = new(tmp_path, monkeypatch, *order, length_unit="mm", pair="[2, 1]", sensor__pixels="[1280, 720]")
        assert status == 0, said
        assert "camera 2 is left, camera 1 right" in said
        parameters = np.array(calibrated(tmp_path / "x.yaml").parameters)
        storage = cv2.FileStorage(str(DATA / files[1]), cv2.FILE_STORAGE_READ)
        rotation, moved = storage.getNode("R").mat(), storage.getNode("T").mat()
        np.testing.assert_allclose(parameters[-3:], (-rotation.T @ moved).ravel() / 1e3, rtol=1e-6)
        np.testing.assert_allclose(cv2.Rodrigues(parameters[-6:-3])[0], rotation.T, atol=1e-6)
        assert parameters[2] == pytest.approx(660.0)  # the principal point of M2


def test_a_pair_that_contradicts_the_extrinsics_is_refused(tmp_path: Path) -> None:
    written.opencv(tmp_path / "rig.yml")
    said = refusal(study(tmp_path, rig="from: rig.yml, length_unit: mm, pair: [2, 1]"))
    assert "pair: [2, 1] contradicts R and T; remove it" in said


def test_equal_projections_are_one_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = ["ros-equal-tx/left.yaml", "ros-equal-tx/right.yaml"]
    for order in (files, files[::-1]):
        status, said = new(tmp_path, monkeypatch, *order)
        assert status == 2
        assert "P[3] is -152 in both files" in said
        assert "exchanged" not in said
        assert "swap" not in said


def test_a_projection_of_the_wrong_sign_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = ["ros-wrong-sign/infra1.yaml", "ros-wrong-sign/infra2.yaml"]
    status, said = new(tmp_path, monkeypatch, *files)
    assert status == 2
    assert "the sign is wrong: write -19.16" in said
    status, said = new(tmp_path, monkeypatch, *files[::-1])
    assert status == 0
    assert "warning" in said
    assert "check the sign" in said


def test_projections_of_a_common_origin_differ_by_the_baseline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = ["ros-common-origin/cam2.yaml", "ros-common-origin/cam3.yaml"]
    status, said = new(tmp_path, monkeypatch, *files)
    assert status == 0
    assert "baseline 533 mm" in said
    moved = np.array(calibrated(tmp_path / "x.yaml").parameters)[-3:]
    np.testing.assert_allclose(moved, [-(44.8 + 338.8) / 720.0, (2.1 - 0.2) / 720.0, 0.0], rtol=1e-12)
    status, said = new(tmp_path, monkeypatch, *files[::-1])
    assert status == 2
    assert "list cam2 first in from:" in said


def test_distortion_under_another_name_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    status, said = new(tmp_path, monkeypatch, "opencv-unknown-keys/distortion_coeffs_left.yml", length_unit="mm")
    assert status == 0
    assert "lens model pinhole with k1 k2" in said
    assert [lens.coefficients()["k1"] for lens in calibrated(tmp_path / "x.yaml").lenses] == [-0.25, -0.25]


def test_a_translation_in_squares_of_a_board_is_warned_about(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for unit, baseline in (("mm", "3.3 mm"), ("m", "3.3 m")):
        status, said = new(tmp_path, monkeypatch, "opencv-unknown-keys/squares1.yml", length_unit=unit)
        assert status == 0
        assert f"warning: x.yaml:10:3: cameras.rig.from: the baseline is {baseline}, but " in said
        assert "if T counts squares of the board" in said


@pytest.mark.parametrize("key", ["DIST1", "D3", "radial_distortion", "k3", "xi", "skew"])
def test_keys_that_look_like_distortion_are_refused_and_others_named(tmp_path: Path, key: str) -> None:
    file = written.opencv(tmp_path / "rig.yml", rms=np.array([[0.3]]), Q=np.eye(4))
    assert (
        tradestudy.load(study(tmp_path, rig="from: rig.yml, length_unit: mm")).imported[0].endswith("not used: rms, Q")
    )
    file.write_text(file.read_text() + f"{key}: 0.25\n")
    said = refusal(study(tmp_path, rig="from: rig.yml, length_unit: mm"))
    assert f"cameras.rig.{key}: this key looks like a part of the lens model" in said


@pytest.mark.parametrize(
    ("line", "remedy"),
    [
        ("K1_new: [800, 0, 320, 0, 800, 240, 0, 0, 1]", "write it as the camera matrix, and zeros as distortion"),
        ("newcameramtx: [800, 0, 320, 0, 800, 240, 0, 0, 1]", "camera matrix of undistorted pictures"),
        ("scale: 0.5", "multiply fx, fy, cx, cy and the size by the scale"),
        ("binning: 2", "scale of the pictures"),
        ("resize: [320, 240]", "scale of the pictures"),
        ("crop: [10, 0, 600, 480]", "subtract its corner from cx and cy"),
        ("crop: {x: 10, y: 0}", "part of the picture"),
        ("roi1: [12, 8, 610, 460]", "remove it if the pictures in which depth is measured are not cropped to it"),
        ("x_offset: 4", "part of the picture"),
        ("T_unit: m", "m is not the unit in which lengths are read, mm by length_unit of the study; correct"),
        ("unit: metres", "metres is not the unit"),
    ],
)
def test_keys_that_would_change_the_geometry_are_refused_with_a_remedy(tmp_path: Path, line: str, remedy: str) -> None:
    file = written.opencv(tmp_path / "rig.yml")
    file.write_text(file.read_text() + line + "\n")
    said = refusal(study(tmp_path, rig="from: rig.yml, length_unit: mm"))
    assert f"cameras.rig.{line.partition(':')[0]}: " in said
    assert remedy in said
    assert "\n" not in said


@pytest.mark.parametrize("key", ["scale", "image_scale", "crop", "K_new"])
def test_every_format_refuses_keys_that_would_change_the_geometry(tmp_path: Path, key: str) -> None:
    says = {key: [0.5, 12.0, 610.0, 460.0]}
    left, _ = written.camera_info_pair(tmp_path)
    r1, _, p1, _ = written.rectified()
    written.camera_info(left, written.K1, written.D1, r1, p1, **says)
    written.camchain(tmp_path / "chain.yaml", **says)
    devices.cameramodels(tmp_path, **says)
    device = devices.device(tmp_path / "oak.json")
    device.write_text(json.dumps({**json.loads(device.read_text()), **says}))
    devices.plenoptic(tmp_path / "r12.js", **says)
    for files in (
        "[left.yaml, right.yaml]",
        "chain.yaml",
        "[left.cameramodel, right.cameramodel]",
        "oak.json",
        "r12.js",
    ):
        assert re.search(
            rf"cameras\.rig\.(cam0\.)?{key}: this key looks like", refusal(study(tmp_path, rig=f"from: {files}"))
        )


def test_keys_of_the_whole_picture_and_of_the_unit_read_change_nothing(tmp_path: Path) -> None:
    file = written.opencv(tmp_path / "rig.yml")
    before = calibrated(study(tmp_path, rig="from: rig.yml, length_unit: mm"))
    more = "scale: 1\nbinning: 1\ncrop: [0, 0, 640, 480]\nroi1: [0, 0, 0, 0]\nsquare_size: 25\n"
    file.write_text(f"{file.read_text()}{more}calibration_time: '2020-01-01'\nT_unit: mm\n")
    for said in ("from: rig.yml, length_unit: mm", "from: rig.yml"):  # the file itself names the unit
        path = study(tmp_path, rig=said)
        assert calibrated(path) == before
        (line,) = tradestudy.load(path).imported
        assert line.endswith("not used: scale, binning, crop, roi1, square_size, calibration_time")
    assert "length unit mm, by T_unit of the file" in line


def test_a_unit_in_a_file_that_its_format_contradicts_is_asked_about(tmp_path: Path) -> None:
    path = written.camchain(tmp_path / "chain.yaml", translation=1e3 * written.T)
    path.write_text(path.read_text() + "\nlength_unit: mm\n")
    said = refusal(study(tmp_path, rig="from: chain.yaml"))
    assert "mm is not the unit in which lengths are read, m by the definition of Kalibr's camchain" in said
    assert "or give length_unit beside from:" in said
    tradestudy.load(study(tmp_path, rig="from: chain.yaml, length_unit: mm"))


def test_two_names_of_one_quantity_must_agree(tmp_path: Path) -> None:
    file = written.opencv(tmp_path / "rig.yml", camera_matrix_left=written.K1)
    before = calibrated(study(tmp_path, rig="from: rig.yml, length_unit: mm"))
    written.opencv(file)
    assert calibrated(study(tmp_path, rig="from: rig.yml, length_unit: mm")) == before
    for more, names in (
        ({"camera_matrix_left": written.K1 + np.diag([1.0, 0.0, 0.0])}, "camera_matrix_left and M1"),
        ({"distortion_coefficients_left": 2.0 * written.D1[None]}, "distortion_coefficients_left and D1"),
        ({"rotation": np.eye(3)}, "R and rotation"),
    ):
        written.opencv(file, **more)
        said = refusal(study(tmp_path, rig="from: rig.yml, length_unit: mm"))
        assert f"{names} mean the same, but their values differ; remove the wrong one" in said


def test_coefficients_without_a_model_and_a_model_without_coefficients_are_refused(tmp_path: Path) -> None:
    chain, rig = tmp_path / "chain.yaml", study(tmp_path, rig="from: chain.yaml")
    written.camchain(chain, distortion_model="none")
    said = refusal(rig)
    assert "cam0.distortion_coeffs: coefficients are given, but distortion_model is none; name their model" in said
    assert "radtan or equidistant or fov" in said
    written.camchain(chain, distortion_model="none", distortion_coeffs=[0.0] * 4)
    assert not any(calibrated(rig).lenses[0].coefficients().values())
    written.camchain(chain, distortion_model=None)
    assert "distortion_model is missing" in refusal(rig)
    written.camchain(chain, distortion_model="equidistant", distortion_coeffs=None)
    assert "the key distortion_coeffs is missing" in refusal(rig)
    for given in ("length_unit: mm, lens_model: fisheye", "length_unit: mm"):
        file = written.opencv(tmp_path / "rig.yml")
        text = re.sub(r"D\d: !!opencv-matrix\n(   .*\n)*", "", file.read_text())
        file.write_text(text + ("" if "fisheye" in given else "fisheye_model: 1\n"))
        said = refusal(study(tmp_path, rig=f"from: rig.yml, {given}"))
        assert "a fisheye lens is declared, but no distortion coefficients are given" in said
    for stated in ("type: fisheye", "calibration_model: KANNALA_BRANDT"):
        file.write_text(f"{text}{stated}\n")
        assert "a fisheye lens is declared" in refusal(study(tmp_path, rig="from: rig.yml, length_unit: mm"))
    text = written.opencv(file).read_text()
    file.write_text(f"{text}image_scale_percent: 50\n")
    scaled = study(tmp_path, rig="from: rig.yml, length_unit: mm")
    assert "this key looks like a scale of the pictures" in refusal(scaled)
    file.write_text(f"{text}image_scale_percent: 100\ntype: stereo\n")
    loaded = tradestudy.load(scaled)
    assert loaded.imported[0].endswith("not used: image_scale_percent, type")


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"D": [0.1] * 5}, "left.yaml:9:4: cameras.rig.D: distortion_coefficients and D mean the same, but"),
        ({"D2": [0.1] * 5}, "this key looks like a part of the lens model"),
        ({"distortion_model": "plumb_bob", "distortion_coefficients": {"data": [0.1] * 8}}, "8 coefficients are given"),
        ({"distortion_model": "", "distortion_coefficients": {"data": [0.1] * 5}}, "no distortion model is named"),
        ({"camera_matrix": {"data": [0.0] * 9}}, "was not calibrated"),
    ],
)
def test_files_of_ros_that_are_not_understood_are_refused(
    tmp_path: Path, changed: Mapping[str, object], said: str
) -> None:
    _, right = written.camera_info_pair(tmp_path)
    r1, _, p1, _ = written.rectified()
    left = written.camera_info(tmp_path / "left.yaml", written.K1, written.D1, r1, p1, **changed)
    assert said in refusal(study(tmp_path, rig=f"from: [{left.name}, {right.name}]"))


def test_a_vertical_pair_takes_the_size_that_the_study_states(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = "vertical-without-size/vertical.yml"
    status, said = new(tmp_path, monkeypatch, file, length_unit="mm")
    assert status == 2
    assert "give sensor: {pixels: [1280, 720]}" in said
    status, said = new(tmp_path, monkeypatch, file, length_unit="mm", sensor__pixels="[1280, 720]")
    assert status == 0, said
    assert "1280 × 720 px, rotated to 720 × 1280 px" in said
    assert calibrated(tmp_path / "x.yaml").parameters[2:4] == pytest.approx((360.0, 1279.0 - 640.0))


@pytest.mark.parametrize(
    ("name", "coefficients"),
    [
        ("ros1dash", {}),
        ("ros2", {}),
        ("emptymodel", {}),
        ("zeroR", {}),
        ("rp5", {"k1": 0.1, "k2": 0.01}),
        ("fisheye", {"k1": 0.01, "k2": 0.002, "k3": -0.005, "k4": 0.001}),
    ],
)
def test_variants_of_ros_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, coefficients: dict[str, float]
) -> None:
    status, said = new(tmp_path, monkeypatch, f"ros-variants/{name}-l.yaml", f"ros-variants/{name}-r.yaml")
    assert status == 0, said
    assert "baseline 120 mm" in said
    assert ("rectification all 0, which means unset" in said) == (name == "zeroR")
    pair = calibrated(tmp_path / "x.yaml")
    for lens in pair.lenses:
        assert isinstance(lens, KannalaBrandt if name == "fisheye" else Rational)
        assert {key: value for key, value in lens.coefficients().items() if value} == coefficients
    np.testing.assert_allclose(pair.parameters[-6:], [0, 0, 0, -0.12, 0, 0], atol=1e-15)


def test_a_vector_of_opencv_5_in_xml_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    status, said = new(tmp_path, monkeypatch, "opencv5-xml/cv5.xml", length_unit="mm")
    assert status == 0, said
    assert said.splitlines()[4] == "  not used: rms, E"
    pair = calibrated(tmp_path / "x.yaml")
    assert pair.parameters[-3:] == pytest.approx((-0.12, 0.0, 0.0))
    assert [lens.coefficients()["k1"] for lens in pair.lenses] == [-0.1, -0.1]


def test_two_cameras_related_to_a_third_one_make_a_pair(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    status, said = new(tmp_path, monkeypatch, "depthai-hub/hub.json")
    assert status == 0, said
    assert "baseline 75 mm" in said
    assert "not used: camera 0; not used: batchName" in said
    assert "specified (specTranslation), as stereoUseSpecTranslation says" in said
    hub = json.loads((DATA / "depthai-hub" / "hub.json").read_text())
    turns = [cv2.Rodrigues(np.array(one))[0] for one in ([0.01, -0.02, 0.005], [-0.004, 0.03, 0.002])]
    moves = [np.array([-3.7, 0.1, 0.2]), np.array([3.8, -0.05, 0.1])]
    hub["stereoUseSpecTranslation"] = False
    for (_, camera), turn, moved in zip(hub["cameraData"][1:], turns, moves, strict=True):
        camera["extrinsics"]["rotationMatrix"] = turn.tolist()
        camera["extrinsics"]["translation"] = dict(zip("xyz", moved.tolist(), strict=True))
    (tmp_path / "hub.json").write_text(json.dumps(hub))
    point = np.array([0.3, -0.2, 150.0])  # in the left camera, cm
    third = turns[0] @ point + moves[0]
    right = turns[1].T @ (third - moves[1])
    parameters = np.array(calibrated(study(tmp_path, rig="from: hub.json")).parameters)
    read = cv2.Rodrigues(parameters[-6:-3])[0] @ (point / 100.0) + parameters[-3:]
    np.testing.assert_allclose(read, right / 100.0, atol=1e-12)


def test_transforms_to_an_inertial_sensor_relate_two_cameras(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    status, said = new(tmp_path, monkeypatch, "openvins/openvins.yaml")
    assert status == 2  # the file gives both cameras the same transform
    assert "T_imu_cam is the same for cam0 and cam1" in said
    text = (DATA / "openvins" / "openvins.yaml").read_text()
    first, second = text.split("cam1:")
    # the y axis of the inertial sensor is antiparallel to the x axis of the cameras
    moved = second.replace("0.0086, -0.018]", "0.0086, -0.128]")
    for key in ("T_imu_cam", "T_cam_imu"):
        body = "cam1:".join((first, moved))
        if key == "T_cam_imu":
            body = "".join(_inverted(part) for part in (first, "cam1:" + moved))
        (tmp_path / "vins.yaml").write_text(body)
        status, said = new(tmp_path, monkeypatch, str(tmp_path / "vins.yaml"))
        assert status == 0, said
        assert "baseline 110 mm" in said
        assert "cam0 is left, cam1 right" in said
        assert "cam0.timeshift_cam_imu" in said


def _inverted(part: str) -> str:
    """The part of a file with the inverse transform, under the name of the inverse."""
    head, rest = part.split("  T_imu_cam:\n")
    lines = rest.split("\n")
    matrix = np.linalg.inv(np.array([json.loads(line.strip().removeprefix("- ")) for line in lines[:4]]))
    matrix[3] = [0.0, 0.0, 0.0, 1.0]
    rows = "\n".join(f"  - {row}" for row in matrix.tolist())
    return f"{head}  T_cam_imu:\n{rows}\n" + "\n".join(lines[4:])


def test_a_coefficient_too_large_for_mrcal_gets_advice_that_mrcal_can_follow(tmp_path: Path) -> None:
    lens = np.array([0.01, 0.0, -0.12, 0.0, 0.0])
    devices.cameramodels(tmp_path, lenses=(lens, lens))
    said = refusal(study(tmp_path, rig="from: [left.cameramodel, right.cameramodel]"))
    assert "another format" in said
    assert "lens_model" not in said


@pytest.mark.parametrize("order", [("left", "right"), ("right", "left")])
def test_every_format_with_exchanged_cameras_gives_advice_that_works(tmp_path: Path, order: tuple[str, str]) -> None:
    """Each piece of advice is followed; the next attempt is read."""
    written.camera_info_pair(tmp_path)
    written.camchain(tmp_path / "chain.yaml")
    devices.cameramodels(tmp_path)
    devices.device(tmp_path / "oak.json")
    written.opencv(tmp_path / "rig.yml", R=written.R.T, T=-1e3 * (written.R.T @ written.T)[:, None])
    first, second = order
    numbers = ("0", "1") if order == ("left", "right") else ("1", "0")
    sockets = ("1", "2") if order == ("left", "right") else ("2", "1")
    cases = {
        "ros": (f"from: [{first}.yaml, {second}.yaml]", f"from: [{second}.yaml, {first}.yaml]"),
        "mrcal": (f"from: [{first}.cameramodel, {second}.cameramodel]", "from: [left.cameramodel, right.cameramodel]"),
        "kalibr": (
            f"from: chain.yaml, pair: [cam{numbers[0]}, cam{numbers[1]}]",
            "from: chain.yaml, pair: [cam0, cam1]",
        ),
        "depthai": (f"from: oak.json, pair: ['{sockets[0]}', '{sockets[1]}']", "from: oak.json, pair: ['1', '2']"),
    }
    for name, (asked, advised) in cases.items():
        if order == ("left", "right"):
            tradestudy.load(study(tmp_path, rig=asked))
        else:
            message = refusal(study(tmp_path, rig=asked))
            assert "left of" in message, name
            tradestudy.load(study(tmp_path, rig=advised))
    assert "pair: [2, 1]" in refusal(study(tmp_path, rig="from: rig.yml, length_unit: mm"))
    tradestudy.load(study(tmp_path, rig="from: rig.yml, length_unit: mm, pair: [2, 1]"))


def test_distortion_along_the_axis_by_another_model_of_libpleno_is_refused(tmp_path: Path) -> None:
    depth = "depth: {estimator: adjacent-pair, disparity_error: 0.1 px, discrimination_step: 0.1 px}"
    path = study(tmp_path, r12=f"from: r12.js, {depth}")
    devices.plenoptic(tmp_path / "r12.js", distortions={"depth": [["0", "0"]]})
    assert "distortion" not in tradestudy.load(path).imported[0]  # there is none
    bent = {"radial": ["1e-5"], "depth": ["0", "1e-7"]}
    devices.plenoptic(tmp_path / "r12.js", distortions={**bent, "model": "2"})
    assert "model 2 of depth distortion is not supported; model 1 is" in refusal(path)
    for model, acts in ((None, True), ("1", True), ("0", False)):
        devices.plenoptic(tmp_path / "r12.js", distortions=bent if model is None else {**bent, "model": model})
        known = dict(tradestudy.load(path).definition.designs["r12"].known)
        assert ("depth_distortion_d2" in known or "depth_distortion_d1" in known) is acts


def test_the_study_of_every_format_asks_questions_and_is_without_mistakes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate_corners_file = DATA / "stereo_65_corners.csv"
    left, right = written.camera_info_pair(tmp_path)
    models = devices.cameramodels(tmp_path)
    plenoptic = {
        "depth": "{estimator: adjacent-pair, disparity_error: 0.1 px, discrimination_step: 0.1 px}",
    }
    formats: list[tuple[list[Path], dict[str, str]]] = [
        ([written.opencv(tmp_path / "rig.yml")], {"length_unit": "mm"}),
        ([left, right], {}),
        ([written.camchain(tmp_path / "chain.yaml")], {}),
        ([*models], {}),
        ([devices.device(tmp_path / "oak.json")], {}),
        ([devices.plenoptic(tmp_path / "r12.js")], plenoptic),
        ([simulate_corners_file], {"sensor__pixels": "[1024, 1024]"}),
    ]
    for files, keys in formats:
        status, said = new(tmp_path, monkeypatch, *map(str, files), **keys)
        assert status == 0, said
        assert "warning" not in said, said
        file = tradestudy.load(tmp_path / "x.yaml").prepared.file
        assert file.usable_range.relative_uncertainty == pytest.approx(0.1)
        assert file.usable_range.blur is None
        assert [*file.requirements] == ["working-range"]
        assert [*file.solve] == ["reach"]
    one = {"sensor__pixel_pitch": "3 um", "focus": "{distance: 1 m}"}
    status, said = new(tmp_path, monkeypatch, str(left), **one)  # a single camera measures no depth
    assert status == 0, said
    assert not tradestudy.load(tmp_path / "x.yaml").prepared.file.requirements


def test_a_matrix_that_is_not_exactly_a_rotation_is_warned_about(tmp_path: Path) -> None:
    """By hand: one small entry s off the diagonal is a rotation by s/2 and a shear, which turns directions by s/2."""
    skewed = np.eye(3)
    skewed[0, 2] = 4e-4
    written.opencv(tmp_path / "rig.yml", R=skewed)
    rig = study(tmp_path, rig="from: rig.yml, length_unit: mm")
    np.testing.assert_allclose(calibrated(rig).parameters[-6:-3], [0.0, 2e-4, 0.0], atol=1e-7)
    (said,) = tradestudy.load(rig).warnings
    assert "cameras.rig.from: rig.yml: R is not exactly a rotation: R Rᵀ differs from 1 by 0.0004" in said
    assert f"changes directions by up to {math.degrees(2e-4):.2g}°; give more digits" in said
    written.opencv(tmp_path / "rig.yml", R=R_OF_SIX_DIGITS)
    assert not tradestudy.load(rig).warnings


@pytest.mark.parametrize("write", [written.camera_info_pair, written.camchain, devices.device])
def test_every_format_with_matrices_warns_of_four_digits(tmp_path: Path, write: Callable[..., object]) -> None:
    """Matrices of rotations that the file contains, each rounded to four digits."""
    ros = write is written.camera_info_pair
    write(tmp_path if ros else tmp_path / "rig.json")
    for path in tmp_path.iterdir():
        path.write_text(re.sub(r"-?0\.\d{6,}", lambda one: f"{float(one[0]):.4f}", path.read_text()))
    path = study(tmp_path, rig="from: [left.yaml, right.yaml]" if ros else "from: rig.json")
    assert "is not exactly a rotation" in "".join(tradestudy.load(path).warnings)


def test_columns_of_corner_files_that_are_not_used_are_named(tmp_path: Path) -> None:
    head, *rows = (DATA / "stereo_65_corners.csv").read_text().splitlines()
    text = "\n".join(
        ["# two cameras", f"{head},image_width,detected", *(f"{row},1024,{int(row != rows[3])}" for row in rows)]
    )
    (tmp_path / "corners.csv").write_text(text)
    loaded = tradestudy.load(study(tmp_path, rig="from: corners.csv, sensor: {pixels: [1024, 1024]}"))
    left_out = f"1 of {len(rows)} rows: detected is false in 1"
    assert loaded.imported[0].endswith(f"; not used: columns image_width; {left_out}")
    assert not loaded.warnings
    rig = (
        "kind: stereo, title: Rig, lenses: {focal_length: 1000 px}, baseline: 65 mm, depth: {disparity_error: 0.1 px}, "
        "sensor: {pixels: [1024, 1024], pixel_pitch: 3 um}, calibration: {corners: {file: corners.csv}}"
    )
    columns, row = tradestudy.load(study(tmp_path, rig=rig)).warnings
    assert columns.endswith("calibration.corners.file: columns of this file are not used: image_width")
    assert row.endswith(f"calibration.corners.file: rows of this file are not used: {left_out}")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda text: text.replace("_mm", "_in"), "positions are read in mm or m on the board.* convert board_x_in"),
        (lambda text: "# one\n" * 30 + text.replace("_mm", "_in"), "positions are read in mm or m on the board"),
        (lambda text: text.replace(",", "\t"), "tabs separate the columns"),
        (lambda text: f"Corners of May\n{text}", r"lacks columns: view, corner, .* name the columns in the first line"),
        (lambda text: text.partition("\n")[2], r"lacks columns: view, corner, .* name the columns in the first line"),
        (
            lambda text: "# " + text.replace("\n0,1,", "\n0,1.x,", 1).replace("\n1,1,", "\n1,1.x,", 1),
            ": corner is not a",
        ),
    ],
)
def test_tables_of_corners_are_recognised_and_refused_for_the_true_reason(
    tmp_path: Path, change: Callable[[str], str], says: str
) -> None:
    (tmp_path / "corners.csv").write_text(change((DATA / "stereo_65_corners.csv").read_text()))
    said = refusal(study(tmp_path, rig="from: corners.csv, sensor: {pixels: [1024, 1024]}"))
    assert re.search(says, said), said
