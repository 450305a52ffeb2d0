"""The parameters of PlenoptiSign as JSON: an unfocused plenoptic camera in millimetres."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from tradestudy.cameras.imported import Convention, Imported, ImportedUnfocused
from tradestudy.study.camera_files.located import CameraFile, Format, Located, Request
from tradestudy.study.camera_files.parts import Parts
from tradestudy.study.document import ScalarEntry
from tradestudy.units import LENGTH, pretty

FOCUS: Final = "focus"
"""Name of the convention that states the distance in focus, and how it follows from the file."""
PUPIL: Final = "exit pupil"
"""Name of the convention that states the position of the exit pupil."""
_SIGNS: Final = ("pp", "fs", "pm", "dA", "fU", "HH", "df", "f_num")
_INFINITE: Final = ("inf", "+inf", ".inf", "infinity", ".infinity")


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """Read the camera; the microlenses are focused at infinity.

    PlenoptiSign counts the distance df in focus from the image, so that object distance a and image distance b, both
    from the principal planes, satisfy ``a + b = df − HH`` and ``1/a + 1/b = 1/fU``. The exit pupil lies dA in front of
    the microlenses.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, or the main lens cannot focus as closely as df.
    """
    top = files[0].top
    pitch, focal_length, spacing, pupil = (top.need(key) for key in ("pp", "fU", "HH", "dA"))
    metre, unit = request.metres(pitch, stated="mm", why="the definition of PlenoptiSign")
    f, separation = focal_length.number() * metre, spacing.number() * metre
    if not f > 0.0:
        raise focal_length.fail("a focal length above 0 is expected")
    distance = top.need("df")
    a, b = _conjugates(distance, f, separation, metre)
    parts = Parts(top)
    parts.length("main_lens.focal_length", f, focal_length)
    parts.give("main_lens.f_number", (number := top.need("f_num")).number(), number)
    parts.length("main_lens.principal_separation", separation, spacing)
    parts.length("main_lens.exit_pupil", b - pupil.number() * metre, pupil, derived=True)
    parts.length("sensor.pixel_pitch", pitch.number() * metre, pitch)
    size, pixels = top.find("sd"), None
    if size is not None:
        rows, columns = (_count(size, length, pitch) for length in size.numbers(2))
        pixels = (columns, rows)
        parts.give("sensor.pixels", [columns, rows], size, derived=True)
    parts.length("microlenses.pitch", (lens := top.need("pm")).number() * metre, lens)
    parts.length("microlenses.focal_length", (lens := top.need("fs")).number() * metre, lens)
    parts.give("microlenses.layout", None, None)
    parts.give("focus.distance", "infinity" if math.isinf(a) else f"{a!r} m", distance, derived=True)
    top.set_aside()
    return parts.camera(ImportedUnfocused, pixels, _conventions(top, distance, pupil, unit, (a, b)))


def _conjugates(value: Located, f: float, separation: float, metre: float) -> tuple[float, float]:
    """Object and image distance [m] of the plane in focus: the roots of ``x² − s x + f s`` with ``s = df − HH``."""
    if isinstance(value.entry, ScalarEntry) and value.entry.text.strip().lower() in _INFINITE:
        value.use()
        return math.inf, f
    s = value.number() * metre - separation
    if not s >= 4.0 * f:
        raise value.fail(
            f"object and image would be {pretty(s, LENGTH)} apart, df − HH; at least four focal lengths, "
            f"{pretty(4.0 * f, LENGTH)}, are expected"
        )
    a = (s + math.sqrt(s * (s - 4.0 * f))) / 2.0
    # The other root from the product of both, without cancellation.
    return a, f * s / a


def _count(size: Located, length: float, pitch: Located) -> int:
    """The number of pixels along a side of the sensor."""
    count = length / pitch.number() if pitch.number() > 0.0 else 0.0
    if not 0.5 < count <= 1_000_000:
        raise size.fail(f"{length:g} is not a side of a sensor with a pixel pitch of {pitch.number():g}; rows first")
    return round(count)


def _conventions(
    top: Located, distance: Located, pupil: Located, unit: Convention, conjugates: tuple[float, float]
) -> Iterator[Convention]:
    yield Convention(name="format", says="PlenoptiSign parameters", key=top.key)
    far = "infinity" if math.isinf(conjugates[0]) else pretty(conjugates[0], LENGTH)
    yield Convention(
        name=FOCUS, says=f"focused at {far} from the first principal plane; df counts from the image", key=distance.key
    )
    yield Convention(
        name=PUPIL, says=f"exit pupil dA in front of the microlenses, which are {pretty(conjugates[1], LENGTH)} behind "
        "the second principal plane", key=pupil.key
    )  # fmt: skip
    yield unit


FORMAT: Final = Format(
    name="PlenoptiSign parameters",
    options=("length_unit",),
    whole="the file contains the whole camera",
    signs=_SIGNS,
    recognises=lambda file: file.top.has(*_SIGNS),
    read=read,
)
