"""The value and basis of an uncertain input, in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from tradestudy.cameras.declaration import DepthCameraDeclaration
from tradestudy.imaging.models import AT_BOUND
from tradestudy.imaging.picture import PictureDisparityError
from tradestudy.study.document import Entry, MappingEntry, ScalarEntry
from tradestudy.study.prepared import PreparedStudy
from tradestudy.wording import listed, with_article

_OF_BLUR: Final = ("f_number", "entrance_pupil_diameter", "focus_distance")  # and all of the part `focus`
_ASSUMED: Final = "assumed"
Path = tuple[str | int, ...]


@dataclass(frozen=True, kw_only=True)
class NamedInput:
    """What an answer rests on, in words with its value and basis, and that basis alone; empty where it has none."""

    words: str = ""
    basis: str = ""


def uncertain_input(study: PreparedStudy, camera: str, parameter: str) -> NamedInput:
    """An uncertain parameter of a camera with its spread and basis, such as "yaw of Head A, assumed 0.01 deg".

    Parameters
    ----------
    study
        The study.
    camera
        Key of the camera.
    parameter
        One of the camera's error sources, or ``noise``.
    """
    title = with_article(study.file.cameras[camera].title)
    if parameter == "noise":
        path: Path = ("cameras", camera, "depth", "disparity_error")
        part, declared = study.file.cameras[camera], study.document.entry(path)
        if isinstance(part, DepthCameraDeclaration) and part.depth.declared_error_px is None:
            law = study.case.cameras[camera].disparity_error_px
            real = isinstance(law, PictureDisparityError) and law.matcher != AT_BOUND
            matcher = " and the declared matcher" if real else ""
            return NamedInput(words=f"matching noise of {title}, derived from the picture{matcher}", basis="derived")
        if not isinstance(declared, ScalarEntry):
            default = next(text for where, text in part.assumed() if where == ("depth", "disparity_error"))
            return NamedInput(words=f"matching noise of {title}, assumed {default}", basis=_ASSUMED)
        return declared_input(study, f"matching noise of {title}", path)
    name = parameter.replace("_", " ")
    for path in (
        ("cameras", camera, "calibration", "errors", parameter),
        ("cameras", camera, "calibration", "stability", parameter.removesuffix("_change")),
    ):
        entry = study.document.entry(path)
        if entry is not None and (spread := _spread(path, entry)) is not None:
            return declared_input(study, f"{name} of {title}", spread)
    return NamedInput(words=f"{name} of {title}, as calibrated", basis="calibrated")


def _spread(path: Path, entry: Entry) -> Path | None:
    """The path of the first number of a declared error."""
    if isinstance(entry, ScalarEntry):
        return path if entry.value is not None else None
    if isinstance(entry, MappingEntry):
        for key, member in entry.members.items():
            if isinstance(member.entry, ScalarEntry) and member.entry.value is not None:
                return (*path, key)
    return None


def assumed_blur(study: PreparedStudy, camera: str) -> str:
    """The assumed inputs of a camera's blur, such as "assumed f-number of 2 and focus distance of 1 m"; or empty."""
    values = [
        f"{path[-1].replace('f_number', 'f-number').replace('_', ' ')} of {text}"
        for path, text in _assumed_of_blur(study, camera)
    ]
    return f"{_ASSUMED} {listed(values)}" if values else ""


def _assumed_of_blur(study: PreparedStudy, camera: str) -> Iterator[tuple[tuple[str, ...], str]]:
    inside = ("cameras", camera)
    declared = [
        (tuple(map(str, path[len(inside) :])), study.document.text_of(path))
        for path, note in study.document.annotations.items()
        if path[: len(inside)] == inside and note.basis == _ASSUMED
    ]
    for path, text in (*declared, *study.file.cameras[camera].assumed()):
        if path[-1] in _OF_BLUR or path[0] == "focus":
            yield path, text


def declared_input(study: PreparedStudy, name: str, path: Path) -> NamedInput:
    """An input of a given name with its declared value and basis: "corner noise of Head A, assumed 0.2 px"."""
    note = study.document.annotations.get(path)
    basis = note.basis if note is not None and note.basis is not None else "declared"
    text = study.document.text_of(path)
    sources = {"paper": "from the paper", "datasheet": "from the data sheet"}
    rests = f"{text} {sources[basis]}" if basis in sources else f"{basis} {text}"
    return NamedInput(words=f"{name}, {rests}", basis=basis)
