"""The XML calibration of a Raytrix camera: the lattice of the micro-images, in pixels, and the types of microlenses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from tradestudy.cameras.imported import Convention, Imported, ImportedFocused
from tradestudy.cameras.parts import Layout
from tradestudy.study.camera_files.libpleno import ARRAY_POSE, IGNORED
from tradestudy.study.camera_files.located import CameraFile, Format, Located, Request
from tradestudy.study.camera_files.parts import SAME_PITCH, Parts, lattice_rotation
from tradestudy.wording import listed

_UNITS: Final = {"diameter": "pix", "offset": "pix", "rotation": "rad", "lens_base_x": "lens", "lens_base_y": "lens"}
_LAYOUTS: Final[dict[int, Layout]] = {60: "hexagonal", 120: "hexagonal", 90: "square"}
"""Layout of an array by the angle between its base vectors [deg]."""
_TYPE: Final = "lens_type_"
_ASKED: Final = (
    *("main_lens.focal_length", "main_lens.f_number", "sensor.pixel_pitch"),
    *("microlenses.gap", "microlenses.focal_lengths", "focus.mla_distance"),
)


def read(files: Sequence[CameraFile], request: Request) -> Imported:  # noqa: ARG001 - the file contains no lengths
    """Read the lattice; the optics and the size of the sensor are asked for.

    The file counts y upwards and angles counter-clockwise. Its diameter is the distance between neighbouring
    micro-images, which is that of the microlenses as seen from the exit pupil.

    Raises
    ------
    CameraFileError
        A value is invalid or has another unit, or the lattice or the number of types is none that cameras have.
    """
    top = files[0].top
    for name, unit in _UNITS.items():
        stated = top.find(f"{name}_units")
        if stated is not None and stated.text() != unit:
            raise stated.fail(f"the unit {stated.text()[:20]} is not supported; {unit} is expected")
    diameter, turned = top.need("diameter"), top.need("rotation")
    base = _vector(top.need("lens_base_x"))
    layout = _layout(top, base)
    rotation = -lattice_rotation(turned.number() + math.atan2(base[1], base[0]), layout)
    types = [key for key in top.names() if key.startswith(_TYPE)]
    if len(types) not in (1, 3):
        raise top.fail(f"{len(types)} types of microlenses (lens_type) are given; 1 or 3 are expected")
    top.set_aside("version", "lens_border", "lens_border_units", "tcp", "tcp_units", "sub_grid_base")
    top.set_aside("sub_grid_base_units", *types)
    parts = Parts(top)
    parts.give("microlenses.layout", layout, top.need("lens_base_y"))
    parts.give("microlenses.pitch", f"{diameter.number()!r} px", diameter)
    parts.give("microlenses.types", len(types), top.need(types[0]))
    parts.known({"array_rotation": rotation}, "rad", turned)
    for name in _ASKED:
        parts.give(name, None, None)
    conventions = (
        Convention(name="format", says="Raytrix calibration", key=top.key),
        Convention(
            name=ARRAY_POSE,
            says="rotation is counter-clockwise in the picture, as public readers take it; diameter is the distance "
            "between micro-images",
            key=turned.key,
            is_assumed=True,
        ),
        *_ignored(top),
    )
    return parts.camera(ImportedFocused, None, conventions)


def _vector(value: Located) -> tuple[float, float]:
    return value.need("x").number(), value.need("y").number()


def _layout(top: Located, base: tuple[float, float]) -> Layout:
    """The layout that two base vectors of length 1 span."""
    second = top.need("lens_base_y")
    other = _vector(second)
    angle = math.degrees(
        abs(math.atan2(base[0] * other[1] - base[1] * other[0], base[0] * other[0] + base[1] * other[1]))
    )
    layout = _LAYOUTS.get(round(angle))
    is_even = all(abs(math.hypot(*vector) - 1.0) < SAME_PITCH for vector in (base, other))
    if layout is None or not is_even or abs(angle - round(angle)) > math.degrees(SAME_PITCH):
        raise second.fail(
            "lens_base_x and lens_base_y are not the sides of a regular lattice; lengths of 1 and an angle of 60°, 90° "
            "or 120° between them are expected"
        )
    return layout


def _ignored(top: Located) -> Iterator[Convention]:
    """What would change pictures, and is not used: where the lattice lies under the pixels, and distortion."""
    ignored = []
    if (offset := top.find("offset")) is not None and any(_vector(offset)):
        ignored.append("the offset of the lattice")
    if (distortion := top.find("distortion")) is not None:
        top.set_aside("distortion", "distortion_type")
        distortion.set_aside()
        if distortion.has("function") and (function := distortion.need("function").text()) != "constant":
            ignored.append(f"the distortion ({function[:20]})")
    if ignored:
        yield Convention(name=IGNORED, says=listed(ignored), key=top.key)


FORMAT: Final = Format(
    name="Raytrix calibration",
    whole="the file contains the whole lattice",
    signs=("diameter", "lens_base_x", "lens_base_y"),
    recognises=lambda file: file.top.has("diameter", "lens_base_x", "lens_base_y"),
    read=read,
)
