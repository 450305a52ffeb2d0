"""Import of calibration files as cameras of a study, every value with its place and origin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Final

from tradestudy.cameras.imported import FITTED_LENS, ImportedCamera, Stated, Value
from tradestudy.cameras.kinds import KINDS
from tradestudy.study.camera_files import corners, depthai, kalibr, libpleno, mrcal, opencv, ros
from tradestudy.study.camera_files.located import CameraFile, CameraFileError
from tradestudy.study.camera_files.request import Format, Request
from tradestudy.study.camera_files.syntax import parsed, syntax_of
from tradestudy.study.document import (
    Annotation,
    Entry,
    ListEntry,
    MappingEntry,
    Member,
    Place,
    ScalarEntry,
    scalar_text,
)

ONE_CAMERA: Final = "a single camera; a stereo rig needs two, from: [LEFT, RIGHT]"
FORMATS: Final[tuple[Format, ...]] = (
    corners.FORMAT, mrcal.FORMAT, depthai.FORMAT, libpleno.FORMAT, kalibr.FORMAT, ros.FORMAT, opencv.FORMAT,
)  # fmt: skip
"""All formats; a new one needs a file beside these and an entry here."""


def recognised(path: Path, text: str, label: str) -> CameraFile | None:
    """A calibration file, recognised by its content; None for any other file, such as a camera of a study.

    Parameters
    ----------
    path, label
        The file, and its name in the study.
    text
        Its content.

    Raises
    ------
    CameraFileError
        The text begins like a calibration file but is not one.
    """
    syntax = syntax_of(text)
    if syntax == "yaml":  # studies and their cameras are YAML too; their reader reports mistakes in them
        try:
            file = parsed(path, text, syntax, label)
        except CameraFileError:
            return None
        return file if _format_of(file) is not None else None
    file = parsed(path, text, syntax, label)
    if _format_of(file) is None:
        raise file.top.fail(f"this is not a calibration file of a known format ({known_formats()})")
    return file


def known_formats() -> str:
    """Names of all formats, for messages."""
    return ", ".join(one.name for one in FORMATS)


def imported(files: Sequence[CameraFile], request: Request) -> tuple[MappingEntry, str]:
    """The camera from calibration files, and a line that describes them.

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
    for option in fields(request):
        if option.name not in (*first.options, "fitted_lens") and getattr(request, option.name) != option.default:
            raise files[0].top.fail(f"{option.name} does not apply to the format {first.name}; remove it")
    found = first.read(files, request)
    kind = next(kind for kind in KINDS if isinstance(found, kind.imports))
    stated = [*kind.stated_by(found)]
    names = " and ".join(dict.fromkeys(file.label for file in files))
    read_as = {one.path[1]: str(one.value) for one in stated if one.path[0] == "read_as"}
    labels = {
        "length unit": "length unit ",
        FITTED_LENS: "lens model ",
        "order of cameras": "",
        "distortion": "distortion: ",
        "pictures": "pictures ",
    }
    shown = [label + read_as[name] for name, label in labels.items() if name in read_as]
    if isinstance(found, ImportedCamera):
        shown.append(ONE_CAMERA)
    line = f"{names}: {'; '.join([first.name, *shown])}"
    return _tree(stated, {key: place for file in files for key, place in file.places.items()}, files[0]), line


def _format_of(file: CameraFile) -> Format | None:
    return next((one for one in FORMATS if one.recognises(file)), None)


def _tree(stated: Sequence[Stated], places: Mapping[str, Place], file: CameraFile) -> MappingEntry:
    """A tree of entries from values with paths."""
    top = file.root.place
    members: dict[str, Member] = {}
    for one in stated:
        place = places.get(one.key, top)
        note = f"{one.key}; {one.note}" if one.note else one.key
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
