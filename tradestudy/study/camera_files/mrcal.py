"""mrcal ``.cameramodel``: one camera, as YAML in the form of a Python literal; a pair is two files in one frame."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from tradestudy.cameras.imported import Convention, Imported, ImportedCamera, ImportedRig, LensModelName
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.located import (
    CameraFile,
    Format,
    Located,
    Request,
    UnsupportedLensError,
    coefficients_of,
    shortest_coefficients,
)
from tradestudy.study.camera_files.pairs import checked_camera, paired, pinhole

_OPENCV: Final = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")
_MODELS: Final[Mapping[str, tuple[LensModelName, tuple[str, ...]]]] = {
    "LENSMODEL_PINHOLE": ("rational", ()),
    **{f"LENSMODEL_OPENCV{count}": ("rational", _OPENCV[:count]) for count in (4, 5, 8, 12)},
    "LENSMODEL_STEREOGRAPHIC": ("stereographic", ()),
    "LENSMODEL_LONLAT": ("longitude-latitude", ()),
}
_REFUSED: Final = {
    "SPLINED": "a splined model",
    "NONCENTRAL": "a non-central model",
    "CAHVORE": "a non-central model",
    "CAHVOR": "a model of the direction of symmetry",
}
_CONVERT: Final = "fit one of these models to it by mrcal's own command: mrcal-convert-lensmodel LENSMODEL_OPENCV8"


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """One camera, or a pair of two files.

    ``rt_cam_ref`` (formerly ``extrinsics``) maps the reference into the camera: ``x₂ = R₂ R₁ᵀ (x₁ − t₁) + t₂``.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, or the lens model is splined or not central.
    """
    tops = [file.top for file in files]
    if len(tops) == 1:
        return _camera(tops[0])
    if len(tops) != 2:
        raise tops[-1].fail(f"{len(tops)} files are given; one or two camera files are expected")
    first, second = (_camera(top) for top in tops)
    (r1, t1, _), (r2, t2, where) = (_pose(top) for top in tops)
    metre, unit = request.metres(where, stated="m", why="mrcal's convention")
    rotation = r2 @ r1.T
    conventions = (
        Convention(name="format", says="mrcal cameramodel", key=where.key),
        Convention(
            name="direction of transforms", says=f"{where.last} maps the reference into the camera", key=where.key
        ),
        Convention(name="pictures", says="raw: as taken, before rectification", key=where.key),
        unit,
    )
    return paired(
        first,
        second,
        rotation,
        (t2 - rotation @ t1) * metre,
        metre=metre,
        where=(where, where),
        exchanged="left and right are exchanged; swap the files of from:",
        conventions=conventions,
    )


def _pose(top: Located) -> tuple[FloatArray, FloatArray, Located]:
    """Rotation and translation from the reference to the camera, and their location."""
    from scipy.spatial.transform import Rotation

    value = top.need("rt_cam_ref", "extrinsics")
    numbers = np.array(value.numbers(6))
    matrix: FloatArray = Rotation.from_rotvec(numbers[:3]).as_matrix()
    return matrix, numbers[3:], value


def _camera(top: Located) -> ImportedCamera:
    named, intrinsics = top.need("lensmodel"), top.need("intrinsics")
    model_name = named.text()
    if model_name not in _MODELS:
        why = next((words for part, words in _REFUSED.items() if part in model_name), "unknown")
        remedy = "" if why == "unknown" else f"; {_CONVERT} {top.file.path.name}"
        short = re.sub(r"[^A-Z0-9_].*", "", model_name)[:40]
        raise named.fail(f"the lens model '{short}' is {why}; one of {', '.join(_MODELS)} is expected{remedy}")
    model, names = _MODELS[model_name]
    numbers = intrinsics.numbers(4 + len(names))
    ignored: tuple[Convention, ...] = ()
    if top.has("optimization_inputs"):
        ignored = (
            Convention(
                name="uncertainty",
                says="optimization_inputs are ignored; declare errors, corners or a target for the uncertainty",
                key=top.key,
            ),
        )
    return checked_camera(
        top.file.path.stem,
        pinhole(intrinsics, *numbers[:4]),
        model,
        dict(zip(names, numbers[4:], strict=True)),
        matrix=intrinsics,
        lens=intrinsics,
        size=top.need("imagersize"),
        says=model_name,
        named=named,
        conventions=ignored,
        fisheye="mrcal has no such model; give the calibration in another format",
    )


def write(rig: ImportedRig, stem: str) -> Mapping[str, str]:
    """Two cameramodels, the left camera at the reference, in metres."""
    from scipy.spatial.transform import Rotation

    turned = [float(component) for component in Rotation.from_matrix(np.array(rig.rotation)).as_rotvec()]
    files = {}
    for side, camera, pose in (
        ("left", rig.left, [0.0] * 6),
        ("right", rig.right, [*turned, *rig.translation]),
    ):
        if camera.pixels is None:
            raise UnsupportedLensError(["a camera without the size of its pictures"])
        name, lens = _written_lens(camera)
        says = {
            "lensmodel": name,
            "intrinsics": [*camera.focal_lengths, *camera.centre, *lens],
            "rt_cam_ref": pose,
            "imagersize": [*camera.pixels],
        }
        body = "\n".join(f"    {key!r}: {value!r}," for key, value in says.items())
        files[f"{stem}-{side}.cameramodel"] = f"{{\n{body}\n}}\n"
    return files


def _written_lens(camera: ImportedCamera) -> tuple[str, tuple[float, ...]]:
    for name, (model, names) in _MODELS.items():
        if model == camera.lens_model != "rational":
            return name, coefficients_of(camera, names, model=model)
    lens = shortest_coefficients(camera, _OPENCV, (4, 5, 8, 12))
    return f"LENSMODEL_OPENCV{len(lens)}", lens


FORMAT: Final = Format(
    name="mrcal cameramodel",
    word="mrcal",
    options=("length_unit",),
    recognises=lambda file: file.syntax == "python",
    read=read,
    write=write,
)
