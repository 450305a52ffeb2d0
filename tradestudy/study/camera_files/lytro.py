"""The metadata of Lytro pictures as JSON, and the containers (lfp, lfr) around them: an unfocused plenoptic camera."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import BinaryIO, Final

import numpy as np

from tradestudy.cameras.imported import Convention, Imported, ImportedUnfocused
from tradestudy.cameras.parts import Layout
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.libpleno import ARRAY_POSE, IGNORED
from tradestudy.study.camera_files.located import CameraFile, Format, Located, Request
from tradestudy.study.camera_files.parts import SAME_PITCH, Parts, lattice_rotation, nearest_node
from tradestudy.study.camera_files.plenoptisign import FOCUS
from tradestudy.study.document import child
from tradestudy.units import LENGTH, pretty

CONTAINER: Final = b"\x89LFP\r\n\x1a\n"
"""The first bytes of a container."""
_SECTIONS: Final = (CONTAINER, b"\x89LFM\r\n\x1a\n", b"\x89LFC\r\n\x1a\n")
_HEADER, _HASH, _DIGEST, _LONGEST, _MOST = 16, 80, 45, 1_000_000, 10_000
_PATHS: Final = (
    (),
    ("frames", 0, "frame", "metadata"),
    ("picture", "frameArray", 0, "frame", "metadata"),
    ("master", "picture", "frameArray", 0, "frame", "metadata"),
)
"""Where the metadata of the first frame stand."""
_LAYOUTS: Final[dict[str, Layout]] = {"hexUniformRowMajor": "hexagonal", "squareUniform": "square"}


class ContainerError(Exception):
    """A container is damaged, or has no metadata of a camera; says why."""


def frame_metadata(file: BinaryIO, size: int) -> bytes:
    """The JSON metadata of the only frame of a container of so many bytes; its pixels are not read.

    A section has a header of 16 bytes: 8 that name its type, 4 of its version and its length in 4 (big-endian). If it
    has content, ``sha1-…`` and zeros fill 80 bytes before it, and zeros follow up to a multiple of 16.

    Raises
    ------
    ContainerError
        A section is damaged or ends beyond the end of the file, or not exactly one contains the metadata of a frame.
    """
    contents, position = [], 0
    for _ in range(_MOST):
        file.seek(position)
        header = file.read(_HEADER)
        if not header.strip(b"\0") and size - position <= _HEADER:
            break
        if header[:8] not in _SECTIONS or len(header) < _HEADER:
            raise ContainerError(f"it is damaged: no section begins at byte {position}; copy the file again")
        length = int.from_bytes(header[12:], "big")
        begin = position + _HEADER + (_HASH if length else 0)
        if begin + length > size:
            raise ContainerError(
                f"it is cut off: the section at byte {position} ends at byte {begin + length} of {size}; copy the file "
                "again"
            )
        position = begin + length
        # The pixels are in longer sections.
        if 0 < length <= _LONGEST and (content := _json(file, length)):
            contents.append(content)
        file.seek(position)
        padding = file.read(_HEADER)
        position += len(padding) - len(padding.lstrip(b"\0"))
    else:
        raise ContainerError(f"it has more than {_MOST} sections, so it is not a raw picture from the camera")
    if len(contents) != 1:
        raise ContainerError(
            f"it contains metadata of {len(contents)} frames; one is expected, as in a raw picture from the camera"
        )
    return contents[0]


def _json(file: BinaryIO, length: int) -> bytes:
    """The content of a section if it is that of a frame, checked by its SHA-1; else empty."""
    digest, content = file.read(_HASH)[:_DIGEST], file.read(length)
    if not (content.lstrip().startswith(b"{") and b'"infinityLambda"' in content and b'"mla"' in content):
        return b""
    if digest.strip(b"\0") != b"sha1-" + hashlib.sha1(content, usedforsecurity=False).hexdigest().encode():
        raise ContainerError("it is damaged: the SHA-1 of the metadata differs from their content; copy the file again")
    return content


def read(files: Sequence[CameraFile], request: Request) -> Imported:  # noqa: ARG001 - lengths are in metres
    """Read the camera; the sensor lies in the focal plane of the microlenses, and all lengths are in metres.

    The array lies ``b = f + λ N p`` behind the main lens, with infinityLambda λ, f-number N and microlens pitch p, so
    that the camera is focused at ``a = f + f²/(λ N p)``. The exit pupil lies ``exitPupilOffset.z`` in front of the
    array.

    Raises
    ------
    CameraFileError
        A value is invalid, or the tiling of the array is unknown.
    """
    top = files[0].top
    frame = next(value for path in _PATHS if (value := _below(top, path)) is not None and _is_frame(value))
    for level in _levels(top, frame):
        level.set_aside()
    image, devices = frame.need("image"), frame.need("devices")
    lens, array, sensor = (devices.need(key) for key in ("lens", "mla", "sensor"))
    for part in (image, devices, lens, array, sensor):
        part.set_aside()
    parts = Parts(top)
    focal_length, number = lens.find("focalLength"), lens.find("fNumber")
    f, n = (None if value is None else _positive(value) for value in (focal_length, number))
    parts.length("main_lens.focal_length", f, focal_length)
    parts.give("main_lens.f_number", n, number)
    pixel_pitch = sensor.find("pixelPitch")
    parts.length("sensor.pixel_pitch", None if pixel_pitch is None else _positive(pixel_pitch), pixel_pitch)
    width, height = image.need("width"), image.need("height")
    pixels = width.count(), height.count()
    parts.give("sensor.pixels", [*pixels], width)
    tiling = array.need("tiling")
    if tiling.text() not in _LAYOUTS:
        raise tiling.fail(f"the tiling {tiling.text()[:40]} is unknown; one of {', '.join(_LAYOUTS)} is expected")
    layout = _LAYOUTS[tiling.text()]
    parts.give("microlenses.layout", layout, tiling)
    pitch = _pitch(array)
    parts.length("microlenses.pitch", pitch, array.need("lensPitch"))
    gap = None if (offset := array.find("sensorOffset")) is None else offset.find("z")
    parts.length("microlenses.focal_length", None if gap is None else _positive(gap), gap)
    behind = _behind_focus(lens, n, pitch)
    conventions = [Convention(name="format", says="Lytro metadata, in metres", key=top.key)]
    if f is None or behind is None:
        parts.give("focus.distance", None, lens)
    else:
        a = f + f**2 / behind if behind else math.inf
        parts.give("focus.distance", f"{a!r} m" if behind else "infinity", lens.need("infinityLambda"), derived=True)
        pupil = None if (exit_pupil := lens.find("exitPupilOffset")) is None else exit_pupil.find("z")
        if pupil is not None:
            parts.length("main_lens.exit_pupil", f + behind - _positive(pupil), pupil, derived=True)
        conventions.append(_focus(a, behind, lens))
    if offset is not None and pixel_pitch is not None and offset.has("x", "y"):
        conventions += _pose(parts, array, _shift(image, sensor, pixels, _positive(pixel_pitch)), pitch, layout)
    conventions += _ignored(lens)
    return parts.camera(ImportedUnfocused, pixels, conventions)


def _below(top: Located, path: Sequence[str | int]) -> Located | None:
    """The value below others, if there is one."""
    value = top
    for step in path:
        entry = child(value.entry, step)
        if entry is None:
            return None
        value = replace(value, entry=entry, path=(*value.path, step))
    return value


def _is_frame(value: Located) -> bool:
    devices = _below(value, ("devices",))
    return devices is not None and value.has("image") and devices.has("lens", "mla", "sensor")


def _levels(top: Located, frame: Located) -> Iterator[Located]:
    """The mappings that lead from the whole file to the metadata of its frame."""
    for count in range(len(frame.path) + 1):
        if (level := _below(top, frame.path[:count])) is not None and level.names():
            yield level


def _positive(value: Located) -> float:
    if not value.number() > 0.0:
        raise value.fail(f"{value.number():g} is not above 0")
    return value.number()


def _pitch(array: Located) -> float:
    """Pitch of the microlenses [m]: the nominal one times the measured factors across and down, which must agree."""
    nominal, scale = array.need("lensPitch"), array.find("scaleFactor")
    factors = [1.0] if scale is None else [_positive(scale.need(axis)) for axis in "xy"]
    if scale is not None and abs(factors[0] - factors[-1]) > SAME_PITCH * factors[0]:
        raise scale.fail("different horizontal and vertical pitches of microlenses are not supported")
    return _positive(nominal) * sum(factors) / len(factors)


def _behind_focus(lens: Located, n: float | None, pitch: float) -> float | None:
    """Distance λ N p of the array behind the focal plane of the main lens [m]; None if it is not given or negative."""
    value = lens.find("infinityLambda")
    return None if value is None or n is None or value.number() < 0.0 else value.number() * n * pitch


def _focus(distance: float, behind: float, lens: Located) -> Convention:
    far = pretty(distance, LENGTH) if math.isfinite(distance) else "infinity"
    return Convention(
        name=FOCUS,
        says=f"focused at {far}: the array is infinityLambda × f-number × microlens pitch = {pretty(behind, LENGTH)} "
        "behind the focal plane of the main lens, as public readers take it; focusStep and zoomStep are not used",
        key=lens.need("infinityLambda").key,
        is_assumed=True,
    )


def _shift(image: Located, sensor: Located, pixels: tuple[int, int], pixel_pitch: float) -> FloatArray:
    """The middle of the whole sensor from the middle of the picture [m], which may be a crop."""
    origin = image.find("originOnSensor")
    full = [sensor.find(key) for key in ("pixelWidth", "pixelHeight")]
    if origin is None or None in full:
        return np.zeros(2)
    first = [origin.need(axis).number() for axis in "xy"]
    whole = [extent.count() for extent in full if extent is not None]
    return np.array([w / 2.0 - x - n / 2.0 for w, x, n in zip(whole, first, pixels, strict=True)]) * pixel_pitch


def _pose(parts: Parts, array: Located, shift: FloatArray, pitch: float, layout: Layout) -> Iterator[Convention]:
    """Rotation and offset of the array in the picture, with x to the right and y down."""
    offset, turned = array.need("sensorOffset"), array.find("rotation")
    rotation = 0.0 if turned is None else lattice_rotation(turned.number(), layout)
    if turned is not None:
        parts.known({"array_rotation": rotation}, "rad", turned)
    node = shift + [offset.need(axis).number() for axis in "xy"]
    centre = node - nearest_node(node, pitch, layout, rotation)
    for index, axis in enumerate("xy"):
        at = offset.need(axis)
        parts.known({f"array_offset_{axis}": centre[index]}, "m", at)
        parts.known({f"principal_point_{axis}": (shift - centre)[index]}, "m", at)
    yield Convention(
        name=ARRAY_POSE,
        says="rotation is clockwise in the picture; sensorOffset leads from the middle of the sensor to a microlens, "
        "x to the right and y down, as public readers take it",
        key=array.key,
        is_assumed=True,
    )


def _ignored(lens: Located) -> Iterator[Convention]:
    """What would move the axis of the main lens, and is not used."""
    value = lens.find("opticalCenterOffset")
    if value is not None and any(value.need(axis).number() for axis in "xy"):
        yield Convention(name=IGNORED, says="the optical centre, opticalCenterOffset,", key=value.key)


FORMAT: Final = Format(
    name="Lytro metadata",
    whole="the file of a picture contains the whole camera",
    signs=("devices", "image", "frames", "picture", "master"),
    recognises=lambda file: any((value := _below(file.top, path)) is not None and _is_frame(value) for path in _PATHS),
    read=read,
)
