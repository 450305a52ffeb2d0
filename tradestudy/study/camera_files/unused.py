"""Keys of calibration files that are not used: refused if they would change where points appear, else listed."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final

from tradestudy.cameras.imported import Convention
from tradestudy.study.camera_files.located import CameraFile
from tradestudy.study.camera_files.request import UNUSED, Request
from tradestudy.study.document import Entry, ListEntry, MappingEntry, dotted

_LENS: Final = re.compile(
    r"distor|dist_?coef|^dist(_?[0-9lr]|_left|_right)?$|^d_?([0-9lr]|left|right)?$|radial|tangential|^xi_?[0-9lr]?$"
    r"|^tau|prism|fisheye|skew|(?-i:^[kp][1-6]$)",
    re.IGNORECASE,
)
_OTHER_MATRIX: Final = re.compile(r"^(new|optimal)|[_0-9]new$", re.IGNORECASE)
_SCALE: Final = re.compile(
    r"^(image|img|picture)?_?(scale|scaling)(_?factor)?(_?[xy])?$|^(re|down)_?(scal|sampl|siz)(e|ed|ing)|^binning|^zoom",
    re.IGNORECASE,
)
_PART: Final = re.compile(
    r"^(valid)?_?(pix)?_?roi_?([0-9lr]|left|right)?$|^crop|_crop$|^[xy]_?offset$|^offset_?[xy]$", re.IGNORECASE
)


def unused_keys(files: Sequence[CameraFile], request: Request, pixels: tuple[int, int] | None) -> Iterator[Convention]:
    """The keys that are not used, in words; none if all are.

    Parameters
    ----------
    files
        Files whose values have been read.
    request
        How they were read: rectified pictures have no distortion, and no other camera matrix than that of their file.
    pixels
        Columns and rows of the pictures; None if unknown.

    Raises
    ------
    CameraFileError
        Nothing in a file is used; or a key with numbers looks like a part of the lens model, another camera matrix, a
        scale other than 1, or a part of the picture.
    """
    unused = [value for file in files for value in file.unused()]
    for value in unused:
        if not value.path:
            raise value.fail("nothing in this file is needed beside the other files; remove it from from:")
        if problem := _problem(value.last, {*_numbers_in(value.entry)}, request, pixels):
            raise value.fail(problem)
    if unused:
        names = dict.fromkeys(dotted(value.path) for value in unused)
        yield Convention(name=UNUSED, says=", ".join(names), key=unused[0].key)


def _problem(key: str, numbers: set[float], request: Request, pixels: tuple[int, int] | None) -> str:
    """Why a key that is not used would change where points appear; empty if it would not."""
    sides = {0.0, *map(float, pixels or ())}
    corner = {float(side - 1) for side in pixels or ()}
    if request.pictures == "raw" and _LENS.search(key) and any(numbers):
        return (
            "this key looks like a part of the lens model, but no such key is known here; rename it as the format "
            "names it, or remove it if it does not belong to these pictures"
        )
    if request.pictures == "raw" and _OTHER_MATRIX.search(key) and any(numbers):
        return (
            "this key looks like the camera matrix of undistorted pictures, but is not used; remove it or, if depth is "
            "measured in undistorted pictures, write it as the camera matrix, and zeros as distortion"
        )
    if _SCALE.search(key) and not numbers <= {1.0, *sides}:
        return (
            "this key looks like a scale of the pictures, but is not used; remove it if the camera matrix holds for "
            "the pictures in which depth is measured; if not, first multiply fx, fy, cx, cy and the size by the scale"
        )
    if _PART.search(key) and not numbers <= sides | corner:
        return (
            "this key looks like a part of the picture, but is not used; remove it if the pictures in which depth is "
            "measured are not cropped to it; if they are, first subtract its corner from cx and cy, and write its size "
            "as that of the pictures"
        )
    return ""


def _numbers_in(entry: Entry) -> Iterator[float]:
    if isinstance(entry, MappingEntry):
        below = [member.entry for key, member in entry.members.items() if key not in ("rows", "cols", "sizes")]
    elif isinstance(entry, ListEntry):
        below = [*entry.items]
    else:
        try:
            yield 0.0 if entry.value is None or isinstance(entry.value, bool) else float(entry.value)
        except (ValueError, OverflowError):  # a text
            return
        return
    for one in below:
        yield from _numbers_in(one)
