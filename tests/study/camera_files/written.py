"""One made-up rig in the files of other programs: written by OpenCV itself, or by hand from their definitions."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

SIZE = (640, 480)
K1 = np.array([[882.5, 0.0, 320.125], [0.0, 881.75, 239.5], [0.0, 0.0, 1.0]])
K2 = np.array([[880.25, 0.0, 318.5], [0.0, 879.5, 241.25], [0.0, 0.0, 1.0]])
D1, D2 = np.array([-0.25, 0.125, 0.0, 0.0, 0.0]), np.array([-0.24, 0.09, 0.0, 0.0, 0.0])
R = cv2.Rodrigues(np.array([0.004, -0.013, 0.0021]))[0]
T = np.array([-0.0601, 0.0002, 0.0011])  # m

STUDY = """\
format: 2
study: rigs
title: Rigs
question: How well does it measure?
cameras:
{cameras}
scene:
  distances: {{from: 0.3 m, to: 5 m, points: 9}}
  wavelength: 550 nm
"""


def opencv(path: Path, *, lengths: float = 1e3, size: tuple[int, int] | None = SIZE, **matrices: np.ndarray) -> Path:
    """As stereoCalibrate's results are stored; by the suffix as YAML, XML or JSON, in millimetres."""
    values = {"M1": K1, "D1": D1[None], "M2": K2, "D2": D2[None], "R": R, "T": T[:, None] * lengths, **matrices}
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    if size is not None:
        storage.write("image_width", size[0])
        storage.write("image_height", size[1])
    for name, value in values.items():
        storage.write(name, value)
    storage.release()
    return path


def rectified() -> tuple[np.ndarray, ...]:
    """R1, R2, P1, P2 by OpenCV."""
    return cv2.stereoRectify(K1, D1, K2, D2, SIZE, R, T[:, None], flags=cv2.CALIB_ZERO_DISPARITY)[:4]


def camera_info(path: Path, k: np.ndarray, d: np.ndarray, r: np.ndarray, p: np.ndarray, **changed: object) -> Path:
    """One camera as camera_calibration writes it."""
    names = ("camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix")
    matrices = {
        name: {"rows": len(np.atleast_2d(one)), "cols": np.atleast_2d(one).shape[1], "data": one.ravel().tolist()}
        for name, one in zip(names, (k, d, r, p), strict=True)
    }
    says = {"image_width": SIZE[0], "image_height": SIZE[1], "camera_name": path.stem, "distortion_model": "plumb_bob"}
    lines = [f"{key}: {json.dumps(value)}" for key, value in {**says, **matrices, **changed}.items()]
    path.write_text("\n".join(lines))
    return path


def camera_info_pair(folder: Path) -> tuple[Path, Path]:
    r1, r2, p1, p2 = rectified()
    return camera_info(folder / "left.yaml", K1, D1, r1, p1), camera_info(folder / "right.yaml", K2, D2, r2, p2)


def camchain(
    path: Path, *, translation: np.ndarray = T, lenses: Sequence[np.ndarray] = (D1, D2), **changed: object
) -> Path:
    """Two cameras in a chain, as Kalibr writes it."""
    transform = [[*row, moved] for row, moved in zip(R.tolist(), translation.tolist(), strict=True)]
    cameras = [
        {
            "camera_model": "pinhole",
            "intrinsics": [k[0, 0], k[1, 1], k[0, 2], k[1, 2]],
            "distortion_model": "radtan",
            "distortion_coeffs": d[:4].tolist(),
            "resolution": list(SIZE),
            "rostopic": f"/cam{number}/image_raw",
        }
        for number, (k, d) in enumerate(zip((K1, K2), lenses, strict=True))
    ]
    cameras[1]["T_cn_cnm1"] = [*transform, [0.0, 0.0, 0.0, 1.0]]
    for camera in cameras:
        camera.update(changed)
    path.write_text("\n".join(f"cam{number}: {json.dumps(camera)}" for number, camera in enumerate(cameras)))
    return path


def study(folder: Path, **cameras: str) -> Path:
    """A study of cameras, each given by what stands between its braces."""
    path = folder / "study.yaml"
    lines = "\n".join(f"  {name}: {{{said}}}" for name, said in cameras.items())
    path.write_text(STUDY.format(cameras=lines))
    return path
