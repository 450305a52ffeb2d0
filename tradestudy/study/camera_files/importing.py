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
        names = [f"{format_.name} (by {', '.join(_signs_in(file, format_)) or 'its form'})" for format_ in fitting]
        raise file.top.fail(f"the file fits several formats, {' and '.join(names)}; remove the keys of all but one")
    if not fitting and file.syntax != "yaml":
        raise file.top.fail(f"this is not a calibration file of a known format ({known_formats()}){nearest(file.root)}")
    return file if fitting else None


def nearest(root: Entry) -> str:
    """For messages: the first keys of a file that has no known format, and the formats that come nearest."""
    names = [*root.members] if isinstance(root, MappingEntry) else []
    if not names:
        return ""
    keys = {dotted(path) for path, _ in islice(walk(root, ()), _MOST_KEYS)} | {*names}
    shared = {format_: [sign for sign in format_.signs if sign in keys] for format_ in FORMATS}
    near = sorted((format_ for format_ in FORMATS if shared[format_]), key=lambda format_: -len(shared[format_]))[:2]
    missing = {format_: [sign for sign in format_.signs if sign not in keys] for format_ in near}
    first_keys = f"; it has the keys {', '.join(names[:8])}{', …' if len(names) > 8 else ''}"
    lacking = (
        f"{format_.name} (has {', '.join(shared[format_])}; lacks {', '.join(missing[format_])})" for format_ in near
    )
    return first_keys + (f"; nearest: {' and '.join(lacking)}" if near else "")


def known_formats() -> str:
    """Names of all formats, for messages."""
    return ", ".join(format_.name for format_ in FORMATS)


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
    formats = [_fitting(file)[0] for file in files]  # each file fits exactly one, or it would have been refused
    first = formats[0]
    for format_, file in zip(formats, files, strict=True):
        if format_ is not first:
            raise file.top.fail(
                f"the files have different formats, {first.name} and {format_.name}; one format is expected"
            )
    if first.whole and len(files) > 1:
        raise files[1].top.fail(f"{first.whole}; give one file")
    for option in fields(request):
        allowed = (*first.options, "fitted_lens", "pixels")
        if option.name not in allowed and getattr(request, option.name) != option.default:
            raise files[0].top.fail(f"{option.name} does not apply to the format {first.name}; remove it")
    camera = first.read(files, request)
    kind = next(kind for kind in KINDS if isinstance(camera, kind.imports))
    stated = [*kind.stated_by(camera), *conventions_stated(tuple(_further(camera, files, request)))]
    names = " and ".join(dict.fromkeys(file.label for file in files))
    read_as = {statement.path[1]: str(statement.value) for statement in stated if statement.path[0] == "read_as"}
    said = (
        ("format", f"{names}: {first.name}"),
        *_lens_and_baseline(camera),
        *((topic, label + read_as[name]) for name, (topic, label) in _SHOWN.items() if name in read_as),
        *((("cameras", ONE_CAMERA),) if isinstance(camera, ImportedCamera) else ()),
    )
    return _tree(stated, {key: place for file in files for key, place in file.places.items()}, files[0]), said


def _further(camera: Imported, files: Sequence[CameraFile], request: Request) -> Iterator[Convention]:
    """The size of the pictures, inexact rotations, doubts about a single camera, and the keys that are not used."""
    if isinstance(camera, ImportedPlenoptic | ImportedCamera | ImportedParts) and camera.pixels is not None:
        yield size_convention(camera)
    if inexact := {key: says for file in files for key, says in file.inexact.items()}:
        yield Convention(name=INEXACT_ROTATION, says="; ".join(inexact.values()), key=next(iter(inexact)))
    if isinstance(camera, ImportedCamera):
        doubts = {
            UNUSUAL_MATRIX: unusual_matrix(camera),
            OFF_CENTRE: off_centre({camera.name: (camera.centre, camera.pixels)}),
        }
        for name, says in doubts.items():
            if says:
                yield Convention(name=name, says=says, key=camera.keys["centre"])
    yield from unused_keys(files, request, camera)


def _lens_and_baseline(camera: Imported) -> Iterator[tuple[str, str]]:
    """Lens models, field of view and baseline in words."""
    cameras = [camera] if isinstance(camera, ImportedCamera) else []
    if isinstance(camera, ImportedRig):
        cameras = [camera.left, camera.right]
    words = [_lens_words(camera) for camera in cameras]
    if len({*words}) == 1:
        yield "lens model", f"lens model {words[0]}"
    elif words:
        yield "lens model", f"lens models {words[0]} (left) and {words[1]} (right)"
    if angle := _field_of_view(cameras[0]) if cameras else "":
        yield "lens model", f"field of view {angle}"
    if isinstance(camera, ImportedRig | ImportedCorners):
        baseline = camera.baseline if isinstance(camera, ImportedCorners) else math.hypot(*camera.translation)
        yield "lengths", f"baseline {pretty(baseline, LENGTH)}"


def _lens_words(camera: ImportedCamera) -> str:
    names = {"rational": "pinhole", "kannala-brandt": "fisheye (Kannala–Brandt)"}
    model = names.get(camera.lens_model, camera.lens_model)
    coefficients = " ".join(key for key, value in camera.coefficients.items() if value)
    return f"{model} with {coefficients}" if coefficients else f"{model} without distortion"


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
    return " × ".join("beyond the lens model" if math.isnan(angle) else pretty(angle, ANGLE) for angle in angles)


def _fitting(file: CameraFile) -> list[Format]:
    """The formats that a file fits; the first general one if it fits no other."""
    fitting = [format_ for format_ in FORMATS if format_.recognises(file)]
    return [format_ for format_ in fitting if not format_.is_general] or fitting[:1]


def _signs_in(file: CameraFile, format_: Format) -> list[str]:
    return [sign for sign in format_.signs if file.top.has(sign)]


def _tree(stated: Sequence[Stated], places: Mapping[str, Place], file: CameraFile) -> MappingEntry:
    """A tree of entries from values with paths."""
    top = file.root.place
    members: dict[str, Member] = {}
    for statement in stated:
        place = places.get(statement.key, top)
        note = f"{statement.key}; {statement.note}" if statement.note else statement.key
        if statement.value is None:
            _put(members, statement.path, Member(place, AskedEntry(place=place, instead=statement.instead)))
            continue
        entry = _entry(statement.value, place, Annotation(basis=statement.basis, note=note))
        _put(members, statement.path, Member(place, entry))
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
