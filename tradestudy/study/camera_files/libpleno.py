"""The camera of libpleno and COMPOTE as JSON: a focused plenoptic camera in millimetres, with numbers as text."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, Literal

import numpy as np

from tradestudy.cameras.imported import Convention, Imported, ImportedPlenoptic
from tradestudy.study.camera_files.located import CameraFile, Format, Located, Request
from tradestudy.study.camera_files.pairs import rotation_of
from tradestudy.units import ANGLE, LENGTH, pretty

_DISTORTIONS: Final = ("distortions", "distortions_inverse", "invdistortions")
_LAYOUTS: Final[dict[str, Literal["square", "hexagonal"]]] = {"0": "square", "1": "hexagonal", "2": "hexagonal"}
_MODES: Final = {"0": "unfocused", "1": "keplerian", "2": "galilean"}
IGNORED: Final = "values that pictures ignore"
"""Name of the convention that lists values that change pictures and are not used."""
ARRAY_POSE: Final = "pose of the array"
"""Name of the convention that states that the pose of the microlens array is not used, but for its distance."""
RELAY: Final = "relay"
"""Name of the convention that states the relay, and a mode of the file that contradicts it."""
_SAME: Final = 1e-3  # of a microlens pitch, across and down


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """Read the camera; d is the distance from array to sensor (the gap), D that from main lens to array.

    The relay is Keplerian if the focal lengths of the microlenses are below d, else Galilean. It does not follow from D
    and the focal length of the main lens, which may be focused closer.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, or the parts do not form a camera.
    """
    top = files[0].top
    lens, sensor, array = top.need("main_lens"), top.need("sensor"), top.need("mla")
    mesh, focal_lengths = array.need("mesh"), array.need("focal_lengths")
    behind, plane = _depth(mesh), _depth(sensor)
    metre, unit = request.metres(behind, stated="mm", why="the convention of libpleno")
    if behind.number() * plane.number() < 0.0:
        raise plane.fail(
            f"{plane.number():g} and the z of the microlens array, {behind.number():g}, have different signs: the main "
            "lens would lie between array and sensor; give both the same sign"
        )
    mla_distance, gap = abs(behind.number()) * metre, (abs(plane.number()) - abs(behind.number())) * metre
    if not gap > 0.0:
        raise plane.fail("the sensor lies in front of the microlens array; it must lie behind the array")
    lengths = tuple(length * metre for length in focal_lengths.numbers())
    relay, mode = _relay(focal_lengths, lengths, gap), top.find("mode")
    mode_text = "" if mode is None else _MODES.get(mode.text(), mode.text()[:20].lower())
    pitch, geometry = mesh.need("pitch"), mesh.need("geometry")
    pitches = pitch.numbers(1, 2)
    if abs(pitches[0] - pitches[-1]) > _SAME * pitches[0]:
        raise pitch.fail("different horizontal and vertical pitches of microlenses are not supported")
    if geometry.text() not in _LAYOUTS:
        raise geometry.fail(f"the geometry {geometry.text()[:20]} is unknown; one of {', '.join(_LAYOUTS)} is expected")
    scale, width, height = sensor.need("scale"), sensor.need("width"), sensor.need("height")
    focal_length, aperture = lens.need("f"), lens.need("aperture")
    _refuse_distortion_along_axis(top)
    _refuse_moved_lens(lens)
    scaling = top.find("scaling")
    disagrees = mode is not None and mode_text != relay
    conventions = (
        Convention(name="format", says="libpleno camera", key=top.key),
        Convention(
            name=RELAY,
            says=f"{relay}: microlens focal length {pretty(lengths[0], LENGTH)}, gap {pretty(gap, LENGTH)}"
            + (f"; the file's mode, {mode_text}, is not used" if disagrees else ""),
            key=focal_lengths.key,
        ),
        Convention(
            name=ARRAY_POSE,
            says="tilt and shift of array and sensor relative to the main lens are not used",
            key=mesh.key,
        ),
        *_ignored(top, {"microlens array": mesh, "sensor": sensor}),
        unit,
    )
    return ImportedPlenoptic(
        focal_length=focal_length.number() * metre,
        f_number=aperture.number(),
        pixels=(width.count(), height.count()),
        pixel_pitch=scale.number() * metre,
        layout=_LAYOUTS[geometry.text()],
        pitch=float(np.mean(pitches)) * metre,
        focal_lengths=lengths,
        gap=gap,
        mla_distance=mla_distance,
        scaling=None if scaling is None else _scaling(scaling, metre),
        conventions=conventions,
        keys={
            "focal_length": focal_length.key,
            "f_number": aperture.key,
            "pixels": width.key,
            "pixel_pitch": scale.key,
            "layout": geometry.key,
            "pitch": pitch.key,
            "focal_lengths": focal_lengths.key,
            "gap": plane.key,
            "mla_distance": behind.key,
            "scaling": top.key if scaling is None else scaling.key,
        },
    )


def _scaling(value: Located, metre: float) -> tuple[float, float, float]:
    """Coefficients a, b, c of metric depth ``a Z² + b Z + c`` [1/m, 1, m]; the file's Z is in its unit of length."""
    a, b, c = (value.need(name) for name in ("a", "b", "c"))
    if not b.number() > 0.0:
        raise b.fail("metric depth must grow with the depth by the camera's design; a number above 0 is expected")
    return a.number() / metre, b.number(), c.number() * metre


def _refuse_distortion_along_axis(top: Located) -> None:
    """Refuse a distortion along the axis; note that lateral distortion has been seen."""
    for name in _DISTORTIONS:
        if (distortion := top.find(name)) is None:
            continue
        along = distortion.find("depth")
        if along is not None and any(along.numbers()):
            raise along.fail(
                "distortion along the axis of the main lens changes depth, and is not supported. For the camera "
                "without it, write zeros"
            )
        distortion.use()  # `_ignored` names the rest


def _refuse_moved_lens(lens: Located) -> None:
    """Refuse a main lens elsewhere than at the origin, from which the poses of array and sensor are measured."""
    if (pose := lens.find("pose")) is None:
        return
    moved, turned = pose.find("translation"), pose.find("rotation")
    if moved is not None and any(moved.numbers(3)):
        raise moved.fail(
            "the main lens must be at the origin; subtract its translation from those of mla and sensor, and write 0"
        )
    if turned is not None and not np.array_equal(np.reshape(turned.numbers(9), (3, 3)), np.eye(3)):
        raise turned.fail(
            "a rotated main lens is not supported; express the poses of mla and sensor in its frame, and write the "
            "identity matrix"
        )


def _ignored(top: Located, posed: Mapping[str, Located]) -> Iterator[Convention]:
    """The values of this camera that would change its pictures and are not used: distortion, and rotated parts."""
    found: list[str] = []
    for distortion in [top.need(name) for name in _DISTORTIONS if top.find(name) is not None]:
        parts = [(name, distortion.find(name)) for name in ("radial", "tangential")]
        given = [f"{name} {part.numbers()}" for name, part in parts if part is not None and any(part.numbers())]
        if given and not found:  # its inverse says the same
            found.append(f"the distortion of the main lens ({', '.join(given)})")
    for part, value in posed.items():
        if (rotation := value.need("pose").find("rotation")) is not None:
            cosine = (np.trace(rotation_of(rotation, rotation.numbers(9))) - 1.0) / 2.0
            if cosine < 1.0:
                found.append(f"the rotation of the {part} by {pretty(math.acos(max(cosine, -1.0)), ANGLE)}")
    if found:
        yield Convention(name=IGNORED, says=" and ".join(found), key=top.key)


def _depth(value: Located) -> Located:
    """The third component of the translation of a pose."""
    translation = value.need("pose").need("translation")
    rows = tuple(translation.items())
    components = tuple(rows[0].items()) if len(rows) == 1 else rows
    if len(components) != 3:
        raise translation.fail("three components are expected")
    return components[2]


def _relay(value: Located, lengths: tuple[float, ...], gap: float) -> str:
    """Galilean if every f_i exceeds d, Keplerian if d exceeds every f_i."""
    if not lengths or min(lengths) <= 0.0:
        raise value.fail("one positive focal length for each microlens type is expected")
    if min(lengths) > gap:
        return "galilean"
    if max(lengths) < gap:
        return "keplerian"
    raise value.fail(
        f"some focal lengths are below the gap of {pretty(gap, LENGTH)} and some above; all on one side are expected"
    )


FORMAT: Final = Format(
    name="libpleno camera",
    options=("length_unit",),
    whole="a libpleno file contains one camera",
    recognises=lambda file: file.top.has("main_lens", "sensor", "mla"),
    read=read,
)
