"""Settings of ORB-SLAM2 and ORB-SLAM3: raw pinhole or fisheye cameras, or a rectified pair."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from tradestudy.cameras.imported import Imported, ImportedCamera, LensModelName
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.located import CameraFile, Format, Located, Request
from tradestudy.study.camera_files.opencv import matrix_of, translation_of_projection
from tradestudy.study.camera_files.pairs import checked_camera, inverse, pinhole_of, rigid_of, rotation_of
from tradestudy.study.camera_files.rigs import (
    FISHEYE,
    RADTAN,
    RAW,
    Definition,
    given,
    keyed,
    only,
    rig,
    transform_of,
    unknown,
)

_MODELS: Final[Mapping[str, tuple[LensModelName, tuple[str, ...]]]] = {
    "PinHole": ("rational", RADTAN),
    "KannalaBrandt8": ("kannala-brandt", FISHEYE),
    "Rectified": ("rational", ()),
}
_EXCHANGED: Final = "the transform or the baseline has the wrong sign, or camera 1 is the right one; correct the file"
_STEREO: Final = tuple((side, key) for side in ("LEFT", "RIGHT") for key in "KDRP")


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """One camera, or a pair: raw with a transform or rectifying matrices, else rectified with a baseline.

    ``T_c1_c2`` (formerly ``Tlr``) maps camera 2 into camera 1. ``Camera.bf`` is the baseline times ``Camera.fx``.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, or the camera type is unknown.
    """
    top = files[0].top
    camera = top.need("Camera")
    first = top.find("Camera1") or camera
    top.set_aside(*({*top.names()} - {"Camera", "Camera1", "Camera2", "Stereo", "LEFT", "RIGHT"}))
    camera.set_aside("fps", "RGB", "newWidth", "newHeight")
    named = camera.find("type")
    kind = "PinHole" if named is None else named.text()
    if named is not None and kind not in _MODELS:
        raise unknown(named, tuple(_MODELS))
    stereo = top.find("Stereo")
    where = top.find("Tlr") or (None if stereo is None else stereo.find("T_c1_c2"))
    if top.find("Camera2") is not None and where is not None and kind != "Rectified":
        return _raw(top, first, kind, where, request)
    lacking = [f"{side}.{key}" for side, key in _STEREO if not top.has(side) or not top.need(side).has(key)]
    if request.pictures == "raw" and not lacking:
        return _rectifying(top, request)
    baseline = stereo.find("b") if stereo is not None and kind == "Rectified" else camera.find("bf")
    if baseline is None or top.has("DepthMapFactor"):  # else of a depth camera, whose baseline is a parameter
        return _camera(first, "camera 1", kind, camera, request)
    left = _camera(first, "camera 1", kind, camera, request)
    if any(left.coefficients.values()):
        raise first.fail("a rectified pair has no distortion, but the file gives coefficients; remove the wrong ones")
    length = baseline.number() / (left.focal_lengths[0] if baseline.last == "bf" else 1.0)
    partly = f"; for raw ones, the file lacks {', '.join(lacking)}" if 0 < len(lacking) < len(_STEREO) else ""
    return rig(
        left,
        _camera(first, "camera 2", kind, camera, request),
        transform_of(np.eye(3), [-length, 0.0, 0.0]),
        defined=_defined(
            "the second camera lies to the right by the baseline", f"rectified, by {baseline.last}{partly}"
        ),
        where=baseline,
        request=request,
        exchanged=_EXCHANGED,
    )


def _defined(direction: str, pictures: str = RAW) -> Definition:
    return Definition(format="ORB-SLAM settings", direction=direction, unit="m", pictures=pictures)


def _raw(top: Located, first: Located, kind: str, where: Located, request: Request) -> Imported:
    camera, numbers = top.need("Camera"), matrix_of(where, 12, 16)
    cameras = [_camera(first, "camera 1", kind, camera, request)]
    cameras.append(_camera(top.need("Camera2"), "camera 2", kind, camera, request))
    whole = (*numbers, 0.0, 0.0, 0.0, 1.0)[:16]
    return rig(
        cameras[0],
        cameras[1],
        inverse(transform_of(*rigid_of(where, whole))),
        defined=_defined(f"{where.last} maps camera 2 into camera 1"),
        where=where,
        request=request,
        exchanged=_EXCHANGED,
    )


def _camera(value: Located, name: str, kind: str, common: Located, request: Request) -> ImportedCamera:
    model, names = _MODELS[kind]
    size = (common.need("width"), common.need("height")) if common.has("width", "height") else None
    return keyed(name, value, model, given(value, names), size=size, request=request, says=f"{kind}, {' '.join(names)}")


def _rectifying(top: Located, request: Request) -> Imported:
    """Raw cameras with the matrices of stereoRectify: ``x₂ = R₂ᵀ (R₁ x₁ + t₂ − t₁)`` with ``P = K′ [1, t]``."""
    cameras, steps = [], list[FloatArray]()
    for side in ("LEFT", "RIGHT"):
        value = top.need(side)
        matrix, lens, turn, projection = (value.need(key) for key in ("K", "D", "R", "P"))
        numbers = matrix_of(lens, 4, 5, 8)
        names = (*RADTAN, "k4", "k5", "k6")[: len(numbers)]
        cameras.append(
            checked_camera(
                side,
                pinhole_of(matrix, matrix_of(matrix, 9)),
                "rational",
                only(names, numbers, lens),
                matrix=matrix,
                lens=lens,
                size=(value.need("width"), value.need("height")),
                says="pinhole, k1 k2 p1 p2 k3",
            )
        )
        placed = translation_of_projection(projection, matrix_of(projection, 12))
        steps.append(
            transform_of(np.eye(3), -placed) @ transform_of(rotation_of(turn, matrix_of(turn, 9)), np.zeros(3))
        )
    top.set_aside("Camera")
    return rig(
        cameras[0],
        cameras[1],
        inverse(steps[1]) @ steps[0],
        defined=_defined("from P = K′ [1, t], rectified to raw by R"),
        where=top.need("RIGHT").need("P"),
        request=request,
        exchanged=_EXCHANGED,
    )


FORMAT: Final = Format(
    name="ORB-SLAM settings",
    options=("length_unit", "pictures", "pixels"),
    whole="the settings contain both cameras",
    signs=("Camera.type", "Camera.fx", "Camera1.fx", "Camera.bf", "Stereo.T_c1_c2"),
    recognises=lambda file: any(
        (value := file.top.find(key)) is not None and value.has("fx", "fy") for key in ("Camera", "Camera1")
    ),
    read=read,
)
