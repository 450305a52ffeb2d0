"""The registers of a study: cameras, assumptions, contradictions."""

from __future__ import annotations

import xarray as xr

from tradestudy.results import dataset
from tradestudy.study.contradictions import find_contradictions
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import Annotation, Place
from tradestudy.study.properties import camera_properties


def cameras_group(definition: StudyDefinition) -> xr.Dataset:
    """/cameras: titles, kinds, notes, and what follows from the inputs."""
    parts, cameras = definition.file.cameras, definition.case.all_cameras
    properties = [(name, *item) for name, camera in cameras.items() for item in camera_properties(camera)]
    return dataset(
        "cameras",
        {
            "title": [part.title for part in parts.values()],
            "kind": [part.kind for part in parts.values()],
            "family": [camera.family for camera in cameras.values()],
            "note": [part.note or "" for part in parts.values()],
            "property_camera": [item[0] for item in properties],
            "property_name": [item[1] for item in properties],
            "property_value": [item[2] for item in properties],
        },
        {"camera": list(cameras)},
    )


def assumptions_group(definition: StudyDefinition) -> xr.Dataset:
    """/assumptions: every value with its basis, once for all cameras that inherit it from one place."""
    document = definition.document
    written: dict[tuple[Place, tuple[str | int, ...]], list[tuple[str | int, ...]]] = {}
    for path in document.annotations:
        _, tail = _camera_and_tail(path)
        written.setdefault((document.locate(path), tail), []).append(path)
    annotations: list[Annotation] = [document.annotations[paths[0]] for paths in written.values()]
    return dataset(
        "assumptions",
        {
            "value": [document.text_of(paths[0]) for paths in written.values()],
            "basis": [annotation.basis for annotation in annotations],
            "note": [annotation.note or "" for annotation in annotations],
            "cameras": [
                ", ".join(camera for path in paths if (camera := _camera_and_tail(path)[0]))
                for paths in written.values()
            ],
        },
        {"path": [".".join(str(key) for key in tail) for _, tail in written]},
    )


def _camera_and_tail(path: tuple[str | int, ...]) -> tuple[str, tuple[str | int, ...]]:
    """The camera that a value belongs to, "" for none, and the path without it; for its calibration errors likewise."""
    for head in (("cameras",), ("calibration", "cameras")):
        if path[: len(head)] == head:
            return str(path[len(head)]), path[len(head) + 1 :]
    return "", path


def contradictions_group(definition: StudyDefinition) -> xr.Dataset:
    """/contradictions: inputs that cannot all be right."""
    found = find_contradictions(definition)
    fields = ("camera", "what", "stated", "implied", "used")
    return dataset("contradictions", {name: [getattr(row, name) for row in found] for name in fields}, {})
