"""EuRoC ``sensor.yaml``: one camera and its pose on the body; a pair is two files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from tradestudy.cameras.imported import Imported, ImportedCamera, LensModelName
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.located import CameraFile, Format, Located, Request
from tradestudy.study.camera_files.pairs import checked_camera, inverse, pinhole, rigid_of
from tradestudy.study.camera_files.rigs import Definition, only, rig, transform_of, unknown

_DEFINED: Final = Definition(
    format="EuRoC sensor", direction="T_BS leads from the camera to the body, x_B = T_BS x_S", unit="m"
)
_MODELS: Final[Mapping[str, tuple[LensModelName, tuple[str, ...]]]] = {
    "radial-tangential": ("rational", ("k1", "k2", "p1", "p2")),
    "equidistant": ("kannala-brandt", ("k1", "k2", "k3", "k4")),
}


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """One camera, or two on one body, the left one first.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, or a model is unknown.
    """
    tops = [file.top for file in files]
    cameras = [_camera(top, top.file.path.stem) for top in tops]
    if len(cameras) == 1:
        return cameras[0]
    if len(cameras) != 2:
        raise tops[-1].fail(f"{len(tops)} files are given; one or two camera files are expected")
    first, second = (_pose(top) for top in tops)
    return rig(
        cameras[0],
        cameras[1],
        inverse(second) @ first,
        defined=_DEFINED,
        where=tops[1].need("T_BS"),
        request=request,
        exchanged="left and right are exchanged; swap the files of from:",
    )


def _pose(top: Located) -> FloatArray:
    value = top.need("T_BS")
    numbers = value.need("data").numbers(16)
    value.use_matrix()
    return transform_of(*rigid_of(value, numbers))


def _camera(top: Located, name: str) -> ImportedCamera:
    camera, named, values = (top.need(key) for key in ("camera_model", "distortion_model", "intrinsics"))
    if camera.text() != "pinhole":
        raise unknown(camera, ("pinhole",))
    if named.text() not in _MODELS:
        raise unknown(named, tuple(_MODELS))
    model, names = _MODELS[named.text()]
    lens = top.need("distortion_coefficients")
    top.set_aside("sensor_type", "comment", "rate_hz")
    return checked_camera(
        name,
        pinhole(values, *values.numbers(4)),
        model,
        only(names, lens.numbers(), lens),
        matrix=values,
        lens=lens,
        size=top.need("resolution"),
        says=named.text(),
        named=named,
    )


FORMAT: Final = Format(
    name="EuRoC sensor",
    options=("length_unit",),
    signs=("T_BS", "camera_model", "distortion_coefficients"),
    recognises=lambda file: file.top.has("T_BS", "camera_model"),
    read=read,
)
