"""The basis of an uncertain input's value, in words."""

from __future__ import annotations

import re
from typing import Final

from tradestudy.cameras.declaration import DepthCameraDeclaration
from tradestudy.imaging.derived_error import PictureDisparityError
from tradestudy.imaging.matcher import AT_BOUND
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import Entry, MappingEntry, ScalarEntry
from tradestudy.units import significant

_SESSION: Final = ("temperature", "pressure", "colour")
Path = tuple[str | int, ...]

_COMPUTED = re.compile(r"\d+\.\d{6,}")  # a number that nobody has written


def input_words(definition: StudyDefinition, camera: str, parameter: str) -> str:
    """An uncertain parameter of a camera with its spread and its basis: "yaw of Head A, assumed 0.01 deg".

    Parameters
    ----------
    definition
        The study.
    camera
        Key of the camera.
    parameter
        Name of one of the camera's error sources, or ``noise``.
    """
    title = definition.file.cameras[camera].title
    if parameter == "noise":
        path: Path = ("cameras", camera, "depth", "disparity_error")
        part, declared = definition.file.cameras[camera], definition.document.entry(path)
        if isinstance(part, DepthCameraDeclaration) and part.depth.declared_error_px is None:
            law = definition.case.cameras[camera].disparity_error_px
            real = isinstance(law, PictureDisparityError) and law.matcher != AT_BOUND
            return f"matching noise of {title}, derived from the picture" + (
                " and the declared matcher" if real else ""
            )
        if not isinstance(declared, ScalarEntry):
            default = next(text for where, text in part.assumed() if where == ("depth", "disparity_error"))
            return f"matching noise of {title}, assumed {default}"
        return f"matching noise of {title}{_rests(definition, path, declared.text)}"
    name = parameter.replace("_", " ")
    for path in (
        ("cameras", camera, "calibration", "errors", parameter),
        ("cameras", camera, "calibration", "stability", parameter.removesuffix("_change")),
    ):
        entry = definition.document.entry(path)
        if entry is not None and (spread := _spread(path, entry)) is not None:
            return f"{name} of {title}{_rests(definition, spread[0], spread[1].text)}"
    return f"{name} of {title}, as calibrated"


def _spread(path: Path, entry: Entry) -> tuple[Path, ScalarEntry] | None:
    """The first number of a declared error, and its path."""
    if isinstance(entry, ScalarEntry):
        return (path, entry) if entry.value is not None else None
    if isinstance(entry, MappingEntry):
        for key, member in entry.members.items():
            if isinstance(member.entry, ScalarEntry) and member.entry.value is not None:
                return (*path, key), member.entry
    return None


def _rests(definition: StudyDefinition, path: Path, text: str) -> str:
    note = definition.document.annotations.get(path)
    basis = note.basis if note is not None and note.basis is not None else "declared"
    text = _COMPUTED.sub(lambda number: significant(float(number[0])), text)
    words = {"paper": "from the paper", "datasheet": "from the data sheet"}.get(basis, basis)
    return f", {words}: {text}" if " " in words else f", {words} {text}"
