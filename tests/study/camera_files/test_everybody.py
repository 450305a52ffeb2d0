"""Calibrations in the files of many programs: points where OpenCV projects them, or a refusal with the true reason."""

from __future__ import annotations

import json
import pickle
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.io import savemat
from typer.testing import CliRunner

import tradestudy
from tests.study.camera_files import everybody, written
from tests.study.camera_files.everybody import L1, L2
from tests.study.camera_files.test_brought import DATA, new
from tests.study.camera_files.test_import import calibrated, refusal
from tests.study.camera_files.written import K1, K2, R, T, study
from tradestudy.calibration.corners.real_rig import observe_pair
from tradestudy.cli import app

POINTS = np.array([[0.1, -0.05, 1.3], [-0.2, 0.15, 0.9], [0.3, 0.2, 2.0], [0.0, 0.0, 0.5], [-0.1, -0.12, 0.7]])
OTHERS = "other-formats"


def seen(path: Path) -> np.ndarray:
    """Where the imported rig sees the points: left x, left y, right x, right y [px]."""
    pair = calibrated(path)
    return observe_pair(np.array(pair.parameters), POINTS, pair.lenses)


def by_opencv(k: np.ndarray, lens: np.ndarray, turn: np.ndarray, moved: np.ndarray) -> np.ndarray:
    return cv2.projectPoints(POINTS, cv2.Rodrigues(turn)[0], moved, k, lens)[0][:, 0]


def expected(left: np.ndarray = L1, right: np.ndarray = L2) -> np.ndarray:
    return np.hstack([by_opencv(K1, left, np.eye(3), np.zeros(3)), by_opencv(K2, right, R, T)])


@pytest.mark.parametrize("name", everybody.RAW)
def test_points_are_seen_where_opencv_projects_them(name: str, tmp_path: Path) -> None:
    path = study(tmp_path, rig=everybody.RAW[name](tmp_path))
    np.testing.assert_allclose(seen(path), expected(), atol=1e-9)
    (line,) = tradestudy.load(path).imported
    assert "baseline 60.1 mm; " in line
    assert "640 × 480 px" in line
    assert "pictures raw" in line


@pytest.mark.parametrize("name", everybody.RECTIFIED)
def test_rectified_points_are_where_the_projections_have_them(name: str, tmp_path: Path) -> None:
    """In the rectified frame of the left camera, by P₁ and P₂ of OpenCV."""
    path = study(tmp_path, rig=everybody.RECTIFIED[name](tmp_path))
    whole = np.hstack([POINTS, np.ones((len(POINTS), 1))])
    pixels = [(rows := whole @ p.T)[:, :2] / rows[:, 2:] for p in written.rectified()[2:]]
    np.testing.assert_allclose(seen(path), np.hstack(pixels), atol=1e-9)
    assert "; pictures rectified" in tradestudy.load(path).imported[0]


@pytest.mark.parametrize("name", {**everybody.RAW, **everybody.RECTIFIED})
def test_five_lines_say_what_was_read(name: str, tmp_path: Path) -> None:
    path = study(tmp_path, rig={**everybody.RAW, **everybody.RECTIFIED}[name](tmp_path))
    (line,) = tradestudy.load(path).imported
    said = CliRunner().invoke(app, ["check", str(path)]).stderr.splitlines()
    first, cameras, lens, lengths, unused = said[: said.index(next(one for one in said if "not used: " in one)) + 1]
    assert re.fullmatch(r"read: rig: .+: \w.*", first)
    assert re.match(r"  640 × 480 px; .+ is left, .+ right", cameras)
    assert re.match(r"  lens models? pinhole with(out)? ", lens)
    assert re.match(r"  baseline 60.[0-9] mm; length unit m", lengths)
    assert unused == f"  not used: {line.partition('; not used: ')[2] or 'none'}"


def test_cameras_on_a_body_may_have_four_coefficients(tmp_path: Path) -> None:
    path = study(tmp_path, rig=everybody.euroc(tmp_path))
    np.testing.assert_allclose(seen(path), expected(L1[:4], L2[:4]), atol=1e-9)


def test_middlebury_cameras_have_principal_points_apart(tmp_path: Path) -> None:
    """Of the format: Z = f B / (d + doffs), where d is the disparity in the pictures."""
    x_left, y_left, x_right, y_right = seen(study(tmp_path, rig=everybody.middlebury(tmp_path))).T
    np.testing.assert_allclose(y_left, y_right, atol=1e-9)
    np.testing.assert_allclose(900 * 0.193 / (x_left - x_right + 20.5), POINTS[:, 2], rtol=1e-12)
    file = tmp_path / "middlebury.txt"
    file.write_text(file.read_text().replace("doffs=20.5", "doffs=0"))
    said = refusal(tmp_path / "study.yaml")
    assert "doffs: the principal points are 20.5 px apart, but doffs is 0; correct one" in said


def test_zed_cameras_are_read_at_the_resolution_of_the_study(tmp_path: Path) -> None:
    """Stereolabs hands (Baseline, TY, TZ) and the rotation to stereoRectify, whose rotations ignore the sign of T."""
    path = study(tmp_path, rig=everybody.zed(tmp_path))
    scale = np.diag([1.05, 1.05, 1.0])
    left = by_opencv(scale @ K1, L1, np.eye(3), np.zeros(3))
    np.testing.assert_allclose(seen(path), np.hstack([left, by_opencv(scale @ K2, L2, R, T)]), atol=1e-9)
    opposite = [cv2.stereoRectify(K1, L1, K2, L2, (672, 376), R, sign * T[:, None])[:2] for sign in (1.0, -1.0)]
    np.testing.assert_allclose(opposite[0], opposite[1], atol=1e-12)
    said = refusal(study(tmp_path, rig="from: SN1.conf"))
    assert "give sensor: {pixels: …}, one of [1280, 720], [672, 376]" in said


@pytest.mark.parametrize("name", ["orbslam3", "vins", "basalt", "realsense", "euroc"])
def test_fisheye_lenses_are_those_of_opencv(name: str, tmp_path: Path) -> None:
    lens = np.array([0.02, -0.01, 0.004, -0.001])
    says = getattr(everybody, name)(tmp_path)
    for file in tmp_path.iterdir():
        file.write_text(_with_fisheye(name, file.read_text(), lens))
    path = study(tmp_path, rig=says)
    poses = ((K1, np.zeros(3), np.zeros(3)), (K2, cv2.Rodrigues(R)[0], T))
    pixels = [cv2.fisheye.projectPoints(POINTS[:, None], turn, moved, k, lens)[0][:, 0] for k, turn, moved in poses]
    np.testing.assert_allclose(seen(path), np.hstack(pixels), atol=1e-6)


def _with_fisheye(name: str, text: str, lens: np.ndarray) -> str:
    k = dict(zip(("k1", "k2", "k3", "k4"), lens.tolist(), strict=True))
    if name == "orbslam3":
        text = re.sub(r"(Camera\d)\.(k1|k2|p1|p2|k3): .*\n", "", text).replace("PinHole", "KannalaBrandt8")
        return text + "".join(f"Camera{side}.{key}: {value}\n" for side in (1, 2) for key, value in k.items())
    if name == "vins" and "projection_parameters" in text:
        values = dict(re.findall(r"   (f.|c.): (\S+)", text))
        keys = {**dict(zip(("k2", "k3", "k4", "k5"), k.values(), strict=True)), "mu": values["fx"], "mv": values["fy"]}
        keys |= {"u0": values["cx"], "v0": values["cy"]}
        head = text.partition("distortion_parameters")[0].replace("PINHOLE_FULL", "KANNALA_BRANDT")
        return head + "projection_parameters:\n" + "".join(f"   {key}: {value}\n" for key, value in keys.items())
    if name == "euroc":
        text = re.sub(r"coefficients: .*", f"coefficients: {lens.tolist()}", text)
        return text.replace("radial-tangential", "equidistant")
    if name == "vins":
        return text
    says: dict[str, Any] = json.loads(text)
    for camera in says["value0"]["intrinsics"] if name == "basalt" else (says["infrared1"], says["infrared2"]):
        if name == "basalt":
            camera["camera_type"] = "kb4"
            camera["intrinsics"] = {key: camera["intrinsics"][key] for key in ("fx", "fy", "cx", "cy")} | k
        else:
            camera |= {"model": "Kannala Brandt4", "coeffs": [*lens.tolist(), 0.0]}
    return json.dumps(says)


def changed(name: str, **values: Any) -> Any:
    """A writer whose JSON file has other values at the top, or below value0."""

    def write(folder: Path) -> str:
        says = getattr(everybody, name)(folder)
        file = next(folder.glob("*.json"))
        content = json.loads(file.read_text())
        (content.get("value0") or content).update(values)
        file.write_text(json.dumps(content))
        return str(says)

    return write


def replaced(name: str, old: str, by: str) -> Any:
    """A writer in whose files one text stands for another."""

    def write(folder: Path) -> str:
        says = getattr(everybody, name)(folder)
        for file in folder.iterdir():
            file.write_text(re.sub(old, by, file.read_text()))
        return str(says)

    return write


def wrong_unit(name: str, unit: str) -> Any:
    return lambda folder: f"{getattr(everybody, name)(folder)}, length_unit: {unit}"


def with_pair(name: str, pair: str) -> Any:
    return lambda folder: f"{getattr(everybody, name)(folder)}, pair: {pair}"


def _saved(folder: Path, **values: Any) -> str:
    savemat(folder / "stereo.mat", {"s": everybody.stereo_parameters(**values)})
    return "from: stereo.mat"


def _in_inches(folder: Path) -> str:
    return _saved(folder, CameraParameters2={**everybody.parameters(K2, L2), "WorldUnits": "inches"})


def _bytes(name: str, content: bytes) -> Any:
    def write(folder: Path) -> str:
        (folder / name).write_bytes(content)
        return f"from: {name}, length_unit: mm"

    return write


def _objects(folder: Path) -> str:
    np.savez(folder / "rig.npz", K1=np.array([print, {}], dtype=object), allow_pickle=True)
    return "from: rig.npz"


REFUSED: Mapping[str, tuple[Any, str]] = {
    "lists without unit": (lambda folder: everybody.nested_lists(folder).partition(",")[0], "give length_unit: mm"),
    "lists in a wrong unit": (wrong_unit("euroc", "mm"), "the baseline would be 60.1 µm"),
    "KITTI in mm": (wrong_unit("kitti_raw", "mm"), "the baseline would be 60.1 µm"),
    "ZED in m": (wrong_unit("zed", "m"), "the baseline would be 60.1 m"),
    "MATLAB in m": (wrong_unit("matlab", "m"), "the baseline would be 60.1 m"),
    "KITTI exchanged": (with_pair("kitti_raw", "['03', '02']"), "give pair: ['02', '03'] beside from:"),
    "RealSense exchanged": (with_pair("realsense", "[infrared2, infrared1]"), "pair: [infrared1, infrared2]"),
    "Basalt exchanged": (with_pair("basalt", "[cam1, cam0]"), "give pair: [cam0, cam1] beside from:"),
    "EuRoC exchanged": (
        lambda folder: everybody.euroc(folder) and "from: [sensor1.yaml, sensor0.yaml]",
        "swap the files",
    ),
    "another camera": (with_pair("basalt", "[cam0, cam7]"), "no camera is called 'cam7'; known: cam0, cam1"),
    "camera twice": (with_pair("realsense", "[infrared1, infrared1]"), "infrared1 occurs twice"),
    "camodocal alone": (lambda folder: everybody.vins(folder) and "from: vins.yaml", "needs the files of both cameras"),
    "Scaramuzza": (replaced("vins", "PINHOLE_FULL", "SCARAMUZZA"), "'SCARAMUZZA' is unknown; one of PINHOLE"),
    "inverse coefficients": (replaced("realsense", "Brown Conrady", "Inverse Brown Conrady"), "coefficients undistort"),
    "tangential after radial": (
        replaced("realsense", "Brown Conrady", "Modified Brown Conrady"),
        "only zeros are read",
    ),
    "rotation in rows": (
        changed("realsense", extrinsics_infrared1_to_infrared2={"rotation": R.tolist(), "translation": T.tolist()}),
        "one list of 9 numbers, by columns, is expected",
    ),
    "no extrinsics": (replaced("realsense", "infrared2_to", "color_to"), "extrinsics_infrared1_to_infrared2 is"),
    "quaternion": (replaced("basalt", '"qw": [-.0-9]+', '"qw": 0.5'), "their squares must add to 1"),
    "Basalt model": (replaced("basalt", "pinhole-radtan8", "dsplus"), "the camera model 'dsplus' is unknown"),
    "skew": (replaced("toolbox_script", r"alpha_c_left = \[ 0.0 \]", "alpha_c_left = 0.001"), "a skew of 0.001"),
    "MATLAB units": (
        _in_inches,
        "'inches' is not the unit of the first camera",
    ),
    "MATLAB 7.3": (
        _bytes("new.mat", b"MATLAB 7.3 MAT-file" + bytes(200)),
        "toStruct(stereoParams); save('stereo.mat', 's', '-v7')",
    ),
    "HDF5": (_bytes("new.mat", b"\x89HDF\r\n\x1a\n" + bytes(200)), "version 7.3 is not read"),
    "pickle": (
        _bytes("rig.pkl", pickle.dumps({"K1": K1})),
        "a pickle can run code and is never loaded; save the matrices by np.savez",
    ),
    "old pickle": (_bytes("rig.pkl", pickle.dumps({"K1": 1}, protocol=0)), "a pickle can run code"),
    "objects in npz": (_objects, "an array of objects is a pickle"),
    "broken npz": (_bytes("rig.npz", b"PK\x03\x04" + bytes(90)), "this npz file cannot be read"),
    "broken mat": (
        _bytes("rig.mat", b"MATLAB 5.0 MAT-file" + bytes(105) + b"\x00\x01IM" + bytes(90)),
        "this mat file cannot",
    ),
    "several formats": (
        changed("realsense", value0={"T_imu_cam": [], "intrinsics": []}),
        "the file fits several formats, RealSense intrinsics (by its form) and Basalt calibration (by value0); remove",
    ),
    "none": (
        _bytes("x.json", b'{"T_imu_cam": [], "camera_type": "ds", "resolution": [1, 2]}'),
        "it has the keys T_imu_cam, camera_type, resolution; nearest: Basalt calibration (has T_imu_cam, camera_type; "
        "lacks value0)",
    ),
    "none in YAML": (_bytes("x.yaml", b"T_BS: 1\nrate_hz: 20\n"), "EuRoC sensor (has T_BS; lacks camera_model"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_other_files_are_refused_with_the_true_reason(name: str, tmp_path: Path) -> None:
    write, says = REFUSED[name]
    assert says in refusal(study(tmp_path, rig=write(tmp_path)))


UNIT = {"length_unit": "mm"}
CASES: Mapping[str, tuple[Sequence[str], Mapping[str, str], Sequence[str]]] = {
    "lists in JSON": (
        ["python_lists.json"],
        UNIT,
        ["lists of matrices", "baseline 120 mm", "1280 × 720", "not used: rms"],
    ),
    "lists in YAML": (["python_lists.yaml"], UNIT, ["lists of matrices", "baseline 120 mm", "1280 × 720"]),
    "npz": (["stereo_calib.npz"], UNIT, ["lists of matrices", "baseline 81.4 mm", "k1 k2 p1 p2 k3", "not used: rms"]),
    "ZED": (["zed_SN1.conf"], {}, ["ZED calibration", "baseline 120 mm", "1280 × 720 px"]),
    "MATLAB": (
        ["stereoParams.mat"],
        {},
        ["MATLAB stereoParameters", "baseline 81.4 mm", "unit millimeters, by WorldUnits"],
    ),
    "Bouguet": (
        ["Calib_Results_stereo.m"],
        {**UNIT, "sensor__pixels": "[640, 400]"},
        ["baseline 119 mm", "k1 k2 p1 p2"],
    ),
    "KITTI": (["kitti_calib_cam_to_cam.txt"], {}, ["baseline 532 mm", "1242 × 375 px", "the file has no S_03, K_03"]),
    "odometry": (
        ["kitti_odometry_calib.txt"],
        {"sensor__pixels": "[1241, 376]"},
        ["baseline 538 mm", "pictures rectified, by P0 and P1"],
    ),
    "Middlebury": (["middlebury_calib.txt"], {}, ["baseline 193 mm", "2960 × 2000 px", "not used: ndisp"]),
    "EuRoC": (["euroc_cam0.yaml", "euroc_cam1.yaml"], {}, ["EuRoC sensor", "baseline 110 mm", "752 × 480 px"]),
    "ORB-SLAM2": (
        ["orbslam2.yaml"],
        {},
        ["baseline 110 mm", "pictures rectified, by bf; for raw ones, the file lacks LEFT.R"],
    ),
    "ORB-SLAM3": (["orbslam3.yaml"], {}, ["baseline 110 mm", "lens model pinhole with k1 k2 p1 p2", "752 × 480 px"]),
    "camodocal": (["vins_cam0.yaml"], {}, ["gives a single camera; a stereo rig needs two, from: [LEFT, RIGHT]"]),
    "VINS": (["vins_stereo.yaml"], {}, ["list them: from: [cam0.yaml, cam1.yaml, vins.yaml]"]),
    "RealSense": (["realsense_intrinsics.json"], {}, ["baseline 81.4 mm", "infrared1 is left, infrared2 right"]),
    "Basalt": (["basalt.json"], {}, ["baseline 110 mm", "lens model double-sphere with xi alpha", "512 × 512 px"]),
    "COLMAP": (["colmap_cameras.txt"], {}, ["a file of COLMAP, which is not read", "no unit of length", "0.5 px"]),
    "COLMAP rig": (["colmap_rig.json"], {}, ["a file of COLMAP, which is not read"]),
    "Metashape": (
        ["metashape.xml"],
        {},
        ["a file of Metashape, which is not read", "OpenCV Camera Calibration (*.xml)"],
    ),
    "nerfstudio": (
        ["nerfstudio_transforms.json"],
        {},
        ["a file of nerfstudio, which is not read", "no unit of length"],
    ),
    "OpenMVG": (["openmvg_sfm_data.json"], {}, ["a file of OpenMVG, which is not read", "no unit of length"]),
}


@pytest.mark.parametrize("name", CASES)
def test_small_files_are_read_or_refused(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files, said, expected = CASES[name]
    status, output = new(tmp_path, monkeypatch, *(f"other-formats/{file}" for file in files), **said)
    assert [words for words in expected if words not in output] == []
    assert (status == 0) == any("baseline" in words for words in expected), output


def test_the_same_rig_by_numpy_matlab_and_realsense(tmp_path: Path) -> None:
    """By hand: three files of one made-up rig, with three conventions for its rotation and its principal points."""
    folder = DATA / "other-formats"
    files = {"npz": "stereo_calib.npz, length_unit: mm", "mat": "stereoParams.mat", "json": "realsense_intrinsics.json"}
    found = [seen(study(tmp_path, rig=f"from: {folder / file}")) for file in files.values()]
    with np.load(folder / "stereo_calib.npz") as rig:
        left = by_opencv(rig["K1"], rig["D1"], np.eye(3), np.zeros(3))
        right = by_opencv(rig["K2"], rig["D2"], rig["R"], 1e-3 * rig["T"])
    for one in found:
        np.testing.assert_allclose(one, np.hstack([left, right]), atol=1e-5)  # the rotation has nine digits
