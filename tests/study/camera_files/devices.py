"""Cameras in the files of mrcal, DepthAI and libpleno, written from the definitions of their formats."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tests.study.camera_files.written import D1, D2, K1, K2, SIZE, R, T

# Any frame of reference will do: x_camera = R x_reference + t.
_TURN = cv2.Rodrigues(np.array([0.3, -0.2, 0.1]))[0]
_MOVE = np.array([0.5, -1.2, 2.0])


def cameramodel(
    path: Path, rotation: np.ndarray, moved: np.ndarray, lenses: Sequence[np.ndarray] = (D1, D2), **changed: object
) -> Path:
    """One camera of mrcal."""
    k, d = (K1, lenses[0]) if path.stem == "left" else (K2, lenses[1])
    says: dict[str, object] = {
        "lensmodel": "LENSMODEL_OPENCV5",
        "intrinsics": [*k[[0, 1, 0, 1], [0, 1, 2, 2]].tolist(), *d.tolist()],
        "rt_cam_ref": [*cv2.Rodrigues(rotation)[0].ravel().tolist(), *moved.tolist()],
        "imagersize": list(SIZE),
        "valid_intrinsics_region": [[0, 0], [0, 479], [639, 479]],
    }
    body = "\n".join(f"    {key!r}: {value!r}," for key, value in {**says, **changed}.items())
    path.write_text(f"# made up\n{{\n{body}\n}}\n")
    return path


def cameramodels(folder: Path, **changed: Any) -> tuple[Path, Path]:
    """The rig of `written` by two cameras in a frame of reference."""
    return (
        cameramodel(folder / "left.cameramodel", _TURN, _MOVE, **changed),
        cameramodel(folder / "right.cameramodel", R @ _TURN, R @ _MOVE + T, **changed),
    )


def device(path: Path, *, measured: bool = True) -> Path:
    """The rig of `written` beside a color camera, as DepthAI stores them, in centimetres."""

    def vector(values: np.ndarray) -> Mapping[str, float]:
        return dict(zip("xyz", values.tolist(), strict=True))

    def camera(k: np.ndarray, d: np.ndarray, to: int, rotation: np.ndarray, moved: np.ndarray) -> Mapping[str, object]:
        return {
            "cameraType": 0,
            "intrinsicMatrix": k.tolist(),
            "distortionCoeff": [*d.tolist(), *[0.0] * (14 - len(d))],
            "width": SIZE[0],
            "height": SIZE[1],
            "extrinsics": {
                "rotationMatrix": rotation.tolist(),
                "toCameraSocket": to,
                "translation": vector(100.0 * moved * measured),
                "specTranslation": vector(np.array([-6.0, 0.0, 0.0])),
            },
        }

    says = {
        "boardName": "made up",
        "cameraData": [
            [0, camera(K1, D1, -1, np.zeros((3, 3)), np.zeros(3))],
            [1, camera(K1, D1, 2, R, T)],
            [2, camera(K2, D2, 0, np.eye(3), np.array([0.03, 0.0, 0.0]))],
        ],
        "stereoRectificationData": {"leftCameraSocket": 1, "rightCameraSocket": 2},
        "version": 7,
    }
    path.write_text(json.dumps(says, indent="\t"))
    return path


def plenoptic(path: Path, **changed: object) -> Path:
    """A camera like a published R12: its main lens is shorter than its distance to the array, and it is Galilean."""
    says: dict[str, object] = {
        "mode": "1",
        "main_lens": {"f": "49.89", "aperture": "4"},
        "sensor": {"scale": "0.0055", "width": "4080", "height": "3068", "pose": _pose("-57.18")},
        "mla": {
            "focal_lengths": ["0.578", "0.504", "0.551"],
            "mesh": {"geometry": "1", "pitch": [["0.12745", "0.12745"]], "pose": _pose("-56.86")},
        },
        **changed,
    }
    path.write_text(json.dumps(says))
    return path


def _pose(depth: str) -> Mapping[str, object]:
    return {"rotation": [["1", "0", "0"], ["0", "1", "0"], ["0", "0", "1"]], "translation": [["-11", "-8", depth]]}
