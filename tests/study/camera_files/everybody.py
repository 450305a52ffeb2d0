"""The rig of `written`, with tangential distortion, in the files of many programs, by their definitions."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from tests.study.camera_files import written
from tests.study.camera_files.written import K1, K2, SIZE, R, T

L1, L2 = np.array([-0.25, 0.125, 0.001, -0.002, 0.01]), np.array([-0.24, 0.09, -0.0005, 0.0015, 0.02])
RADTAN = ("k1", "k2", "p1", "p2", "k3")
_BODY = np.eye(4)
_BODY[:3, :3], _BODY[:3, 3] = cv2.Rodrigues(np.array([0.3, -0.2, 1.1]))[0], [0.5, -1.2, 2.0]
STEP = np.eye(4)
STEP[:3, :3], STEP[:3, 3] = R, T
"""From the left to the right camera."""
CAMERAS = ((K1, L1), (K2, L2))


def on_body(side: int) -> np.ndarray:
    """From a camera to some body."""
    return _BODY @ (np.eye(4) if side == 0 else np.linalg.inv(STEP))


def pinhole(k: np.ndarray, names: Sequence[str] = ("fx", "fy", "cx", "cy")) -> dict[str, float]:
    return dict(zip(names, k[[0, 1, 0, 1], [0, 1, 2, 2]].tolist(), strict=True))


def matrix(value: np.ndarray) -> str:
    rows, columns = np.atleast_2d(value).shape
    return f"!!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: {value.ravel().tolist()}"


def numbers(value: np.ndarray) -> str:
    return " ".join(map(repr, np.ravel(value).tolist()))


def lists_(folder: Path, write: Callable[[Path, Mapping[str, np.ndarray]], None], name: str) -> str:
    values = {"K1": K1, "D1": L1, "K2": K2, "D2": L2, "R": R, "T": 1e3 * T, "image_size": np.array(SIZE)}
    write(folder / name, values)
    return f"from: {name}, length_unit: mm"


def _json(path: Path, values: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(values, default=lambda value: value.tolist(), indent=1))


def json_lists(folder: Path) -> str:
    return lists_(folder, _json, "lists.json")


def yaml_lists(folder: Path) -> str:
    def write(path: Path, values: Mapping[str, np.ndarray]) -> None:
        path.write_text("".join(f"{key}: {value.tolist()}\n" for key, value in values.items()))

    return lists_(folder, write, "lists.yaml")


def nested_lists(folder: Path) -> str:
    """One mapping for each camera."""
    cameras = {
        side: {"mtx": k, "dist": d, "image_size": SIZE} for side, (k, d) in zip(("left", "right"), CAMERAS, strict=True)
    }
    _json(folder / "nested.json", {**cameras, "rot": R, "trans": T[:, None]})
    return "from: nested.json, length_unit: m"


def npz(folder: Path) -> str:
    return lists_(folder, lambda path, values: np.savez(path, **values), "rig.npz")


def zed(folder: Path) -> str:
    def section(name: str, values: Mapping[str, float]) -> str:
        return f"[{name}]\n" + "".join(f"{key}={value!r}\n" for key, value in values.items()) + "\n"

    text = ""
    for resolution, scale in (("HD", 2.0), ("VGA", 1.05)):  # the rig has neither size; `written_zed` gives VGA
        for side, (k, d) in zip(("LEFT", "RIGHT"), CAMERAS, strict=True):
            values = {key: value * scale for key, value in pinhole(k).items()}
            text += section(f"{side}_CAM_{resolution}", {**values, **dict(zip(RADTAN, d.tolist(), strict=True))})
    turn = dict(zip(("RX", "CV", "RZ"), cv2.Rodrigues(R)[0].ravel().tolist(), strict=True))
    by_resolution = {f"{key}_{end}": value for end in ("HD", "VGA") for key, value in turn.items()}
    moved = dict(zip(("Baseline", "TY", "TZ"), (-1e3 * T).tolist(), strict=True))
    (folder / "SN1.conf").write_text(text + section("STEREO", {**moved, **by_resolution}))
    return "from: SN1.conf, sensor: {pixels: [672, 376]}"


def zed_opencv(folder: Path) -> str:
    storage = cv2.FileStorage(str(folder / "zed.yml"), cv2.FILE_STORAGE_WRITE)
    storage.write("Size", np.array(SIZE))
    for side, (k, d) in zip(("LEFT", "RIGHT"), CAMERAS, strict=True):
        storage.write(f"K_{side}", k)
        storage.write(f"D_{side}", d[None])
    storage.write("R", cv2.Rodrigues(R)[0])
    storage.write("T", 1e3 * T[:, None])
    storage.release()
    return "from: zed.yml, length_unit: mm"


def kitti_raw(folder: Path) -> str:
    """The left camera is not the reference, and the rectified one is there too."""
    lines = ["calib_time: 01-Jan-2020 10:00:00", "corner_dist: 9.95e-02"]
    _, _, p1, p2 = written.rectified()
    for side, (name, (k, d), p) in enumerate(zip(("02", "03"), CAMERAS, (p1, p2), strict=True)):
        pose = np.linalg.inv(on_body(side))
        said = {"S": np.array(SIZE, float), "K": k, "D": d, "R": pose[:3, :3], "T": pose[:3, 3]}
        said |= {"S_rect": np.array(SIZE, float), "R_rect": np.eye(3), "P_rect": p}
        lines += [f"{key}_{name}: {numbers(value)}" for key, value in said.items()]
    (folder / "calib_cam_to_cam.txt").write_text("\n".join(lines) + "\n")
    return "from: calib_cam_to_cam.txt"


def kitti_rectified(folder: Path) -> str:
    return f"{kitti_raw(folder)}, pictures: rectified"


def kitti_odometry(folder: Path) -> str:
    projections = written.rectified()[2:]
    text = "".join(f"P{number}: {numbers(p)}\n" for number, p in enumerate(projections))
    (folder / "calib.txt").write_text(text)
    return "from: calib.txt, sensor: {pixels: [640, 480]}"


def middlebury(folder: Path) -> str:
    """Focal length 900 px, baseline 193 mm; the principal points of the cameras are 20.5 px apart."""
    text = "cam0=[900 0 310.25; 0 900 240; 0 0 1]\ncam1=[900 0 330.75; 0 900 240; 0 0 1]\ndoffs=20.5\nbaseline=193\n"
    (folder / "middlebury.txt").write_text(f"{text}width=640\nheight=480\nndisp=280\nisint=0\nvmin=30\nvmax=260\n")
    return "from: middlebury.txt"


def euroc(folder: Path) -> str:
    for side, (k, d) in enumerate(CAMERAS):
        says = f"sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: {on_body(side).ravel().tolist()}\n"
        says += f"rate_hz: 20\nresolution: {list(SIZE)}\ncamera_model: pinhole\nintrinsics: {[*pinhole(k).values()]}\n"
        says += f"distortion_model: radial-tangential\ndistortion_coefficients: {d[:4].tolist()}\n"
        (folder / f"sensor{side}.yaml").write_text(says)
    return "from: [sensor0.yaml, sensor1.yaml]"


def orbslam3(folder: Path) -> str:
    lines = [
        "%YAML:1.0",
        "",
        'File.version: "1.0"',
        'Camera.type: "PinHole"',
        "Camera.width: 640",
        "Camera.height: 480",
    ]
    for number, (k, d) in enumerate(CAMERAS, 1):
        values = {**pinhole(k), **dict(zip(RADTAN, d.tolist(), strict=True))}
        lines += [f"Camera{number}.{key}: {value!r}" for key, value in values.items()]
    lines += [
        f"Stereo.T_c1_c2: {matrix(np.linalg.inv(STEP))}",
        "ORBextractor.scaleFactor: 1.2",
        "Viewer.PointSize: 2.0",
    ]
    (folder / "orbslam3.yaml").write_text("\n".join(lines) + "\n")
    return "from: orbslam3.yaml"


def orbslam2(folder: Path) -> str:
    """Raw cameras with the matrices of stereoRectify, without a space before the numbers."""
    r1, r2, p1, p2 = written.rectified()
    lines = ["%YAML:1.0", *(f"Camera.{key}: {value!r}" for key, value in pinhole(p1[:, :3]).items())]
    lines += ["Camera.width: 640", "Camera.height: 480", f"Camera.bf: {-p2[0, 3]}", "ORBextractor.scaleFactor: 1.2"]
    for side, (k, d), r, p in zip(("LEFT", "RIGHT"), CAMERAS, (r1, r2), (p1, p2), strict=True):
        lines += [f"{side}.height: 480", f"{side}.width: 640"]
        lines += [f"{side}.{key}: {matrix(value)}" for key, value in zip("DKRP", (d, k, r, p), strict=True)]
    (folder / "orbslam2.yaml").write_text("\n".join(lines).replace("data: [", "data:[") + "\n")
    return "from: orbslam2.yaml"


def orbslam2_rectified(folder: Path) -> str:
    return f"{orbslam2(folder)}, pictures: rectified"


def vins(folder: Path) -> str:
    for side, (k, d) in enumerate(CAMERAS):
        lines = ["%YAML:1.0", "---", "model_type: PINHOLE_FULL", "camera_name: camera", "image_width: 640"]
        lines += ["image_height: 480", "distortion_parameters:"]
        lines += [f"   {key}: {value!r}" for key, value in zip(RADTAN, d.tolist(), strict=True)]
        lines += ["projection_parameters:", *(f"   {key}: {value!r}" for key, value in pinhole(k).items())]
        (folder / f"cam{side}.yaml").write_text("\n".join(lines) + "\n")
    lines = ["%YAML:1.0", "imu: 1", "num_of_cam: 2", 'cam0_calib: "cam0.yaml"', 'cam1_calib: "cam1.yaml"', "freq: 10"]
    lines += [f"body_T_cam{side}: {matrix(on_body(side))}" for side in (0, 1)]
    (folder / "vins.yaml").write_text("\n".join([*lines, "image_width: 640", "image_height: 480"]) + "\n")
    return "from: [vins.yaml, cam1.yaml, cam0.yaml]"


def realsense(folder: Path) -> str:
    names = ("infrared1", "infrared2")
    says: dict[str, Any] = {
        name: {
            **pinhole(k, ("fx", "fy", "ppx", "ppy")),
            "width": 640,
            "height": 480,
            "model": "Brown Conrady",
            "coeffs": d,
        }
        for name, (k, d) in zip(names, CAMERAS, strict=True)
    }
    back = np.linalg.inv(STEP)
    says["extrinsics_infrared2_to_infrared1"] = {"rotation": back[:3, :3].T.ravel(), "translation": back[:3, 3]}
    _json(folder / "realsense.json", says)
    return "from: realsense.json"


def basalt(folder: Path) -> str:
    poses = [on_body(side) for side in (0, 1)]
    turns = [Rotation.from_matrix(pose[:3, :3]).as_quat().tolist() for pose in poses]
    names = ("px", "py", "pz", "qx", "qy", "qz", "qw")
    places = [dict(zip(names, (*p[:3, 3].tolist(), *turn), strict=True)) for p, turn in zip(poses, turns, strict=True)]
    lenses = [
        dict(zip((*RADTAN, "k4", "k5", "k6", "rpmax"), (*d.tolist(), 0, 0, 0, 2.7), strict=True)) for _, d in CAMERAS
    ]
    cameras = [
        {"camera_type": "pinhole-radtan8", "intrinsics": {**pinhole(k), **lens}}
        for (k, _), lens in zip(CAMERAS, lenses, strict=True)
    ]
    said = {"T_imu_cam": places, "intrinsics": cameras, "resolution": [list(SIZE)] * 2, "cam_time_offset_ns": 0}
    _json(folder / "basalt.json", {"value0": said})
    return "from: basalt.json"


def parameters(k: np.ndarray, d: np.ndarray) -> Mapping[str, object]:
    """One camera of `toStruct`: the matrix of row vectors, pixels from 1, rows before columns."""
    return {
        "RadialDistortion": d[[0, 1, 4]],
        "TangentialDistortion": d[2:4],
        "ImageSize": np.array(SIZE[::-1], float),
        "IntrinsicMatrix": (k + np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]])).T,
        "WorldUnits": "millimeters",
        "EstimateSkew": False,
    }


def stereo_parameters(**changed: object) -> Mapping[str, object]:
    cameras = {f"CameraParameters{side}": parameters(k, d) for side, (k, d) in enumerate(CAMERAS, 1)}
    return {**cameras, "RotationOfCamera2": R.T, "TranslationOfCamera2": 1e3 * T[None], **changed}


def matlab(folder: Path) -> str:
    savemat(folder / "stereo.mat", {"s": stereo_parameters()}, do_compression=True)
    return "from: stereo.mat"


def _toolbox() -> Mapping[str, np.ndarray]:
    values: dict[str, np.ndarray] = {}
    for side, (k, d) in zip(("left", "right"), CAMERAS, strict=True):
        values |= {
            f"fc_{side}": np.diag(k)[:2],
            f"cc_{side}": k[:2, 2],
            f"alpha_c_{side}": np.zeros(1),
            f"kc_{side}": d,
        }
        values |= {f"fc_{side}_error": np.ones(2), f"kc_{side}_error": np.ones(5)}
    return {**values, "om": cv2.Rodrigues(R)[0], "T": 1e3 * T, "om_error": np.ones(3), "T_error": np.ones(3)}


def toolbox_mat(folder: Path) -> str:
    columns = {key: value.reshape(-1, 1) for key, value in _toolbox().items()}
    savemat(folder / "Calib_Results_stereo.mat", {**columns, "nx": SIZE[0], "ny": SIZE[1]})
    return "from: Calib_Results_stereo.mat, length_unit: mm"


def toolbox_script(folder: Path) -> str:
    lines = ["%  Intrinsic and Extrinsic Camera Parameters", "% -- left"]
    lines += [f"{key} = [ {' ; '.join(map(repr, np.ravel(value).tolist()))} ];" for key, value in _toolbox().items()]
    (folder / "Calib_Results_stereo.m").write_text("\n".join(lines) + "\n")
    return "from: Calib_Results_stereo.m, length_unit: mm, sensor: {pixels: [640, 480]}"


RAW: Mapping[str, Callable[[Path], str]] = {
    one.__name__: one
    for one in (
        json_lists, yaml_lists, nested_lists, npz, zed_opencv, kitti_raw, orbslam3, orbslam2, vins, realsense, basalt,
        matlab, toolbox_mat, toolbox_script,
    )
}  # fmt: skip
"""Writers of the whole rig; each writes its files and returns what a camera says to read them."""
RECTIFIED: Mapping[str, Callable[[Path], str]] = {
    one.__name__: one for one in (kitti_rectified, kitti_odometry, orbslam2_rectified)
}
