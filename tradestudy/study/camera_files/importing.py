"""Read a camera from a calibration file: recognise its format, build the camera, and say what was read."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np

from tradestudy.cameras.imported import (
    FITTED_LENS,
    PICTURE_SIZE,
    RIGHT_SIZE,
    Convention,
    Imported,
    ImportedCamera,
    ImportedCorners,
    ImportedParts,
    ImportedPlenoptic,
    ImportedRig,
    Stated,
    Value,
    conventions_stated,
)
from tradestudy.cameras.kinds import KINDS
from tradestudy.optics.lens_families import FAMILIES
from tradestudy.study.camera_files import (
    basalt,
    binary,
    corners,
    depthai,
    euroc,
    kalibr,
    kitti,
    libpleno,
    lytro,
    matlab,
    middlebury,
    mrcal,
    opencv,
    orbslam,
    plenoptisign,
    raytrix,
    realsense,
    ros,
    vins,
    zed,
)
from tradestudy.study.camera_files.located import OTHER_CAMERAS, UNUSED, CameraFile, CameraFileError, Format, Request
from tradestudy.study.camera_files.pairs import (
    INEXACT_ROTATION,
    OFF_CENTRE,
    UNUSUAL_MATRIX,
    off_centre,
    size_convention,
    unusual_matrix,
)
from tradestudy.study.camera_files.refused import refused
from tradestudy.study.camera_files.syntax import parsed, syntax_of
from tradestudy.study.camera_files.unused import unused_keys
from tradestudy.study.document import (
    Annotation,
    AskedEntry,
    Entry,
    ListEntry,
    MappingEntry,
    Member,
    Place,
    ScalarEntry,
    dotted,
    scalar_text,
    walk,
)
from tradestudy.units import ANGLE, LENGTH, pretty

ONE_CAMERA: Final = "a single camera; a stereo rig needs two, from: [LEFT, RIGHT]"
_LAST_SEPARATOR: Final = re.compile(r"\n---\s*\Z")
"""The line that ``rostopic echo`` and ``ros2 topic echo`` write after every message."""
_MOST_KEYS: Final = 2000
FORMATS: Final[tuple[Format, ...]] = (
    corners.FORMAT, mrcal.FORMAT, depthai.FORMAT, libpleno.FORMAT, kalibr.FORMAT, ros.FORMAT, zed.FORMAT,
    kitti.FORMAT, middlebury.FORMAT, euroc.FORMAT, orbslam.FORMAT, vins.FORMAT, realsense.FORMAT, basalt.FORMAT,
    matlab.PARAMETERS, matlab.RESULTS, plenoptisign.FORMAT, lytro.FORMAT, raytrix.FORMAT, opencv.FORMAT, opencv.LISTS,
)  # fmt: skip
"""All formats; a new one needs a file beside these and an entry here."""


def recognised(path: Path, content: str | bytes, label: str) -> CameraFile | None:
    """A calibration file, recognised by its content; None for any other file, such as a camera of a study.

    Parameters
    ----------
    path, label
        The file, and its name in the study.
    content
        Its text, or the bytes of a binary file.

    Raises
    ------
    CameraFileError
        The text begins like a calibration file but is not one.
    """
    if isinstance(content, bytes):
        file = binary.parsed(path, content, label)
    else:
        text = _LAST_SEPARATOR.sub("", content)
        if why := refused(text):
            raise CameraFileError(Place(str(path), 1, 1).problem((), why))
        syntax = syntax_of(text)
        try:
            file = parsed(path, text, syntax, label)
        except CameraFileError:
            if syntax != "yaml":
                raise
            return None  # studies and their cameras are YAML too; their reader reports mistakes in them
    fitting = _fitting(file)
    if len(fitting) > 1:
        names = " and ".join(f"{one.name} (by {', '.join(_signs_in(file, one)) or 'its form'})" for one in fitting)
        raise file.top.fail(f"the file fits several formats, {names}; remove the keys of all but one")
    if not fitting and file.syntax != "yaml":
        raise file.top.fail(f"this is not a calibration file of a known format ({known_formats()}){nearest(file.root)}")
    return file if fitting else None


def nearest(root: Entry) -> str:
    """For messages: the first keys of a file that has no known format, and the formats that come nearest."""
    names = [*root.members] if isinstance(root, MappingEntry) else []
    if not names:
        return ""
    keys = {dotted(path) for path, _ in islice(walk(root, ()), _MOST_KEYS)} | {*names}
    shared = {one: [sign for sign in one.signs if sign in keys] for one in FORMATS}
    near = sorted((one for one in FORMATS if shared[one]), key=lambda one: -len(shared[one]))[:2]
    given = f"; it has the keys {', '.join(names[:8])}{', …' if len(names) > 8 else ''}"
    lacking = (
        f"{one.name} (has {', '.join(shared[one])}; lacks {', '.join(s for s in one.signs if s not in keys)})"
        for one in near
    )
    return given + (f"; nearest: {' and '.join(lacking)}" if near else "")


def known_formats() -> str:
    """Names of all formats, for messages."""
    return ", ".join(one.name for one in FORMATS)


_SHOWN: Final = {
    PICTURE_SIZE: ("cameras", ""),
    RIGHT_SIZE: ("cameras", "right pictures "),
    "length unit": ("lengths", "length unit "),
    FITTED_LENS: ("lens model", "lens model "),
    "order of cameras": ("cameras", ""),
    "distortion": ("lens model", "distortion: "),
    "translation": ("lengths", "translation "),
    "rectification": ("cameras", "rectification "),
    libpleno.RELAY: ("lens model", ""),
    libpleno.ARRAY_POSE: ("lens model", ""),
    plenoptisign.FOCUS: ("lens model", ""),
    plenoptisign.PUPIL: ("lens model", ""),
    "scaling of depth": ("lengths", ""),
    "uncertainty": ("lengths", ""),
    "pictures": ("cameras", "pictures "),
    OTHER_CAMERAS: ("not used", "not used: camera "),
    UNUSED: ("not used", "not used: "),
}
"""The conventions that are shown when a file is read: their topic, and what introduces them."""


def imported(files: Sequence[CameraFile], request: Request) -> tuple[MappingEntry, tuple[tuple[str, str], ...]]:
    """The camera from calibration files, and what was read, by topic (see `Reading`).

    Raises
    ------
    CameraFileError
        The files have different formats, or invalid content.
    """
    formats = [_format_of(file) for file in files]
    first = formats[0]
    assert first is not None  # they were recognised
    for one, file in zip(formats, files, strict=True):
        if one is not first:
            assert one is not None
            raise file.top.fail(
                f"the files have different formats, {first.name} and {one.name}; one format is expected"
            )
    if first.whole and len(files) > 1:
        raise files[1].top.fail(f"{first.whole}; give one file")
    for option in fields(request):
        allowed = (*first.options, "fitted_lens", "pixels")
        if option.name not in allowed and getattr(request, option.name) != option.default:
            raise files[0].top.fail(f"{option.name} does not apply to the format {first.name}; remove it")
    found = first.read(files, request)
    kind = next(kind for kind in KINDS if isinstance(found, kind.imports))
    stated = [*kind.stated_by(found), *conventions_stated(tuple(_further(found, files, request)))]
    names = " and ".join(dict.fromkeys(file.label for file in files))
    read_as = {one.path[1]: str(one.value) for one in stated if one.path[0] == "read_as"}
    said = (
        ("format", f"{names}: {first.name}"),
        *_lens_and_baseline(found),
        *((topic, label + read_as[name]) for name, (topic, label) in _SHOWN.items() if name in read_as),
        *((("cameras", ONE_CAMERA),) if isinstance(found, ImportedCamera) else ()),
    )
    return _tree(stated, {key: place for file in files for key, place in file.places.items()}, files[0]), said


def _further(found: Imported, files: Sequence[CameraFile], request: Request) -> Iterator[Convention]:
    """The size of the pictures, inexact rotations, doubts about a single camera, and the keys that are not used."""
    if isinstance(found, ImportedPlenoptic | ImportedCamera | ImportedParts) and found.pixels is not None:
        yield size_convention(found)
    if inexact := {key: says for file in files for key, says in file.inexact.items()}:
        yield Convention(name=INEXACT_ROTATION, says="; ".join(inexact.values()), key=next(iter(inexact)))
    if isinstance(found, ImportedCamera):
        doubts = {
            UNUSUAL_MATRIX: unusual_matrix(found),
            OFF_CENTRE: off_centre({found.name: (found.centre, found.pixels)}),
        }
        for name, says in doubts.items():
            if says:
                yield Convention(name=name, says=says, key=found.keys["centre"])
    yield from unused_keys(files, request, found)


def _lens_and_baseline(found: Imported) -> Iterator[tuple[str, str]]:
    """Lens models, field of view and baseline in words."""
    cameras = [found] if isinstance(found, ImportedCamera) else []
    if isinstance(found, ImportedRig):
        cameras = [found.left, found.right]
    words = [_lens_words(camera) for camera in cameras]
    if len({*words}) == 1:
        yield "lens model", f"lens model {words[0]}"
    elif words:
        yield "lens model", f"lens models {words[0]} (left) and {words[1]} (right)"
    if angle := _field_of_view(cameras[0]) if cameras else "":
        yield "lens model", f"field of view {angle}"
    if isinstance(found, ImportedRig | ImportedCorners):
        baseline = found.baseline if isinstance(found, ImportedCorners) else math.hypot(*found.translation)
        yield "lengths", f"baseline {pretty(baseline, LENGTH)}"


def _lens_words(camera: ImportedCamera) -> str:
    names = {"rational": "pinhole", "kannala-brandt": "fisheye (Kannala–Brandt)"}
    name = names.get(camera.lens_model, camera.lens_model)
    given = " ".join(key for key, value in camera.coefficients.items() if value)
    return f"{name} with {given}" if given else f"{name} without distortion"


def _field_of_view(camera: ImportedCamera) -> str:
    """Angles across and down between the edges of the picture, through the principal point, by the lens model."""
    family = FAMILIES.get(camera.lens_model)
    if family is None or camera.pixels is None:
        return ""
    lens, angles = family(**camera.coefficients), []
    for axis, (focal_length, centre, count) in enumerate(
        zip(camera.focal_lengths, camera.centre, camera.pixels, strict=True)
    ):
        edges = np.zeros((2, 2))
        edges[:, axis] = (np.array([-0.5, count - 0.5]) - centre) / focal_length
        directions = lens.unproject(edges)
        off_axis = np.arctan2(directions[:, axis], directions[:, 2])
        angles.append(float(off_axis[1] - off_axis[0]))
    return " × ".join("beyond the lens model" if math.isnan(one) else pretty(one, ANGLE) for one in angles)


def _fitting(file: CameraFile) -> list[Format]:
    """The formats that a file fits; the first general one if it fits no other."""
    fitting = [one for one in FORMATS if one.recognises(file)]
    return [one for one in fitting if not one.is_general] or fitting[:1]


def _format_of(file: CameraFile) -> Format | None:
    return next(iter(_fitting(file)), None)


def _signs_in(file: CameraFile, one: Format) -> list[str]:
    return [sign for sign in one.signs if file.top.has(sign)]


def _tree(stated: Sequence[Stated], places: Mapping[str, Place], file: CameraFile) -> MappingEntry:
    """A tree of entries from values with paths."""
    top = file.root.place
    members: dict[str, Member] = {}
    for one in stated:
        place = places.get(one.key, top)
        note = f"{one.key}; {one.note}" if one.note else one.key
        if one.value is None:
            _put(members, one.path, Member(place, AskedEntry(place=place, instead=one.instead)))
            continue
        entry = _entry(one.value, place, Annotation(basis=one.basis, note=note))
        _put(members, one.path, Member(place, entry))
    return MappingEntry(place=top, members=members)


def _put(members: dict[str, Member], path: tuple[str, ...], new: Member) -> None:
    if len(path) == 1:
        members[path[0]] = new
        return
    below = members.get(path[0])
    inner = dict(below.entry.members) if below is not None and isinstance(below.entry, MappingEntry) else {}
    _put(inner, path[1:], new)
    members[path[0]] = Member(new.key_place, MappingEntry(place=new.key_place, members=inner))


def _entry(value: Value, place: Place, annotation: Annotation | None) -> Entry:
    if isinstance(value, str | float | int):
        return ScalarEntry(place=place, value=value, text=scalar_text(value), annotation=annotation)
    items = tuple(_entry(item, place, None) for item in value)
    return ListEntry(place=place, items=items, annotation=annotation)
