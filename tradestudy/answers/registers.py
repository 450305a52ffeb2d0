"""The registers of a study: cameras, assumptions, contradictions."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Final

import xarray as xr

from tradestudy.accuracy import QUANTITIES
from tradestudy.cameras.camera import Camera
from tradestudy.cameras.declaration import CameraDeclaration
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.imported import CATALOGUE
from tradestudy.effects import OFF
from tradestudy.models.plan import Plan, summary
from tradestudy.models.problem import Change, Changes
from tradestudy.results import dataset
from tradestudy.study.camera_files.libpleno import IGNORED
from tradestudy.study.document import Annotation, Document, ListEntry, Path, Place, ScalarEntry, walk
from tradestudy.study.plausibility import contradictions, implausible
from tradestudy.study.prepared import PreparedStudy

SET_FOR_THIS_RUN = "set for this run"
_NO_INPUTS: Final = ("kind", "title", "note", "from", "like", "read_as", "stated")
"""Keys of a camera that describe it and decide no result."""
_ASKED: Final = (("distances",), ("image",))
"""Keys of the scene that say what the study asks about."""


def cameras_group(study: PreparedStudy) -> xr.Dataset:
    """/cameras: titles, kinds, notes and derived properties."""
    parts, cameras = study.file.cameras, study.case.all_cameras
    properties = [(camera_name, *item) for camera_name, camera in cameras.items() for item in camera.properties()]
    is_off = study.file.effects.forced().get("calibration") == OFF
    return dataset(
        "cameras",
        {
            "title": [part.title for part in parts.values()],
            "kind": [part.kind for part in parts.values()],
            "family": [camera.family for camera in cameras.values()],
            # How a camera measures depth, for the report; empty if it measures none.
            "method": [
                json.dumps(asdict(camera.method), ensure_ascii=False) if isinstance(camera, DepthCamera) else ""
                for camera in cameras.values()
            ],
            "note": [_note(study, camera_name) for camera_name in parts],
            "catalogue": [part.read_as.get(CATALOGUE, "") for part in parts.values()],
            "perfect_calibration": [
                float(
                    isinstance(camera, DepthCamera)
                    and (is_off or (camera.calibration.inferred and not camera.calibration.groups))
                )
                for camera in cameras.values()
            ],
            "focal_length": [camera.gathering_lens.focal_length for camera in cameras.values()],
            "f_number": [camera.gathering_lens.f_number for camera in cameras.values()],
            "baseline": [camera.view_baseline or math.nan for camera in cameras.values()],
            "distance_origin": [camera.origin for camera in cameras.values()],
            "front": [camera.front for camera in cameras.values()],
            "pixels_across": [float(camera.sensor.columns) for camera in cameras.values()],
            "pixels_down": [float(camera.sensor.rows) for camera in cameras.values()],
            "pixel_pitch": [camera.sensor.pixel_pitch for camera in cameras.values()],
            "field_of_view": [sum(camera.edge_angles(math.inf)[:2]) for camera in cameras.values()],
            "left_out": [_left_out(part, cameras[camera_name]) for camera_name, part in parts.items()],
            "property_camera": [item[0] for item in properties],
            "property_name": [item[1] for item in properties],
            "property_value": [
                math.nan if isinstance(quantity, str) else float(quantity.value) for *_, quantity in properties
            ],
            "property_units": [
                "" if isinstance(quantity, str) else quantity.dimension.unit or "1" for *_, quantity in properties
            ],
            "property_words": [quantity if isinstance(quantity, str) else "" for *_, quantity in properties],
        },
        {"camera": list(cameras)},
    )


def _left_out(part: CameraDeclaration, camera: Camera) -> str:
    """What of a camera's declaration or of its calibration file acts only in part or not at all, in words."""
    ignored = part.read_as.get(IGNORED)
    file = f"neither depth nor pictures use {ignored} of its file" if ignored else ""
    return "; ".join(filter(None, (camera.left_out, file)))


def assumptions_group(study: PreparedStudy) -> xr.Dataset:
    """/assumptions: the values of cameras and scene, and every other one with a basis.

    Each is listed once for all cameras that inherit it from the same place. Values set for this run are marked, with
    the values that they replace.
    """
    document = study.definition.under_tolerance
    rows = [*_set_for_this_run(document), *_declared(document), *_defaults(study)]
    values: dict[str, Sequence[str | None]] = {
        column: [row[column] for row in rows] for column in ("value", "basis", "note", "cameras")
    }
    if warned := implausible(study):
        values["warning"] = [f"{warning.path}: {warning.what}" for warning in warned]
    return dataset("assumptions", values, {"path": [row["path"] for row in rows]})


def _set_for_this_run(document: Document) -> Iterator[dict[str, str | None]]:
    for override in document.overrides:
        camera, tail = _camera_and_tail(override.path)
        yield {
            "path": ".".join(map(str, tail)),
            "cameras": camera,
            "value": override.text or "none",
            "basis": SET_FOR_THIS_RUN,
            "note": f"replaces {override.before}" if override.before else "the study declares none",
        }


def _declared(document: Document) -> Iterator[dict[str, str | None]]:
    overridden = {override.path for override in document.overrides}
    written: dict[tuple[Place, Path], list[Path]] = {}
    for path in (*document.annotations, *_without_basis(document)):
        if path not in overridden:
            written.setdefault((document.locate(path), _camera_and_tail(path)[1]), []).append(path)
    for (_, tail), paths in written.items():
        annotation = document.annotations.get(paths[0], Annotation())
        yield {
            "path": ".".join(map(str, tail)),
            "cameras": ", ".join(filter(None, (_camera_and_tail(path)[0] for path in paths))),
            "value": document.text_of(paths[0]),
            "basis": annotation.basis or "",
            "note": annotation.remark,
        }


def _without_basis(document: Document) -> Iterator[Path]:
    """Values of cameras and scene that the study gives without a basis or note, and without a --set for this run."""
    overridden = [override.path for override in document.overrides]
    for path, entry in walk(document.root, ()):
        if not path or entry.annotation is not None or any(path[: len(prefix)] == prefix for prefix in overridden):
            continue
        camera, tail = _camera_and_tail(path)
        is_input = tail[0] not in _NO_INPUTS if camera and tail else tail[:1] == ("scene",) and tail[1:2] not in _ASKED
        is_value = isinstance(entry, ListEntry) or (isinstance(entry, ScalarEntry) and entry.value is not None)
        # Elements are shown with their list.
        in_list = any(isinstance(step, int) for step in path)
        if is_input and is_value and not in_list and tail[-1] != "file":
            yield path


def _defaults(study: PreparedStudy) -> Iterator[dict[str, str | None]]:
    """Defaults of values that the study does not declare, listed once for all cameras that rely on them."""
    left_out: dict[tuple[tuple[str, ...], str], list[str]] = {}
    for camera_name, part in study.file.cameras.items():
        for path, text in part.assumed():
            left_out.setdefault((path, text), []).append(camera_name)
    if study.file.scene is not None and study.file.scene.picture is not None:
        for path, text in study.file.scene.picture.assumed():
            left_out[("scene", "picture", *path), text] = []
    for (path, text), cameras in left_out.items():
        yield {
            "path": ".".join(path),
            "cameras": ", ".join(cameras),
            "value": text,
            "basis": "assumed",
            "note": "default; the study declares none",
        }


def _note(study: PreparedStudy, camera_name: str) -> str:
    """The note declared under a camera; it may no longer be true of values that this run sets."""
    note = study.file.cameras[camera_name].note or ""
    overridden = {
        tail
        for camera, tail in (_camera_and_tail(override.path) for override in study.document.overrides)
        if camera == camera_name
    }
    changed = overridden - {("note",), ("title",)}
    return (
        f"{note} (Values of this camera were set for this run after the note was written.)"
        if note and changed
        else note
    )


def _camera_and_tail(path: Path) -> tuple[str, Path]:
    """The camera that a value belongs to, "" if none, and the rest of the path."""
    return (str(path[1]), path[2:]) if path[0] == "cameras" and len(path) > 1 else ("", path)


def contradictions_group(study: PreparedStudy) -> xr.Dataset:
    """/contradictions: inputs that contradict each other."""
    entries = contradictions(study)
    values = {
        column: [getattr(row, column) for _, row in entries]
        for column in ("what", "stated", "implied", "used", "consequence")
    }
    return dataset("contradictions", {"camera": [camera for camera, _ in entries], **values}, {})


_NONE = Change(relative=math.nan, evidence="computed")


def effects_group(plan: Plan) -> xr.Dataset:
    """/effects over decisions, and over the problems of the study that they belong to."""
    decisions = [(choice, decision) for choice in plan.problems for decision in choice.decisions]
    changes = [_row(decision.changes) for _, decision in decisions]
    together = [_row(choice.changes) for choice in plan.problems]
    return dataset(
        "effects",
        {
            "problem_of": [choice.name for choice, _ in decisions],
            "slot": [decision.slot for _, decision in decisions],
            "model": [decision.model for _, decision in decisions],
            "chosen": [float(decision.chosen) for _, decision in decisions],
            "forced": [float(decision.forced) for _, decision in decisions],
            "reason": [choice.problem.reasons.get(decision.slot, "") for choice, decision in decisions],
            "change": [[change.relative for change in row] for row in changes],
            "evidence": [[_evidence(change) for change in row] for row in changes],
            "change_at": [[change.at for change in row] for row in changes],
            "joint_change": [[change.relative for change in row] for row in together],
            "joint_evidence": [[_evidence(change) for change in row] for row in together],
            "forced_change": [[change.relative for change in _row(choice.by_forcing)] for choice in plan.problems],
            "tolerance": [[choice.asked.get(q, math.nan) for q in QUANTITIES] for choice in plan.problems],
            "problem_title": [choice.problem.title for choice in plan.problems],
            "summary": [summary(choice) for choice in plan.problems],
        },
        {
            "decision": [f"{choice.name}: {decision.slot}: {decision.model}" for choice, decision in decisions],
            "quantity": list(QUANTITIES),
            "problem": [choice.name for choice in plan.problems],
        },
    )


def _row(changes: Changes) -> list[Change]:
    return [changes.get(q, _NONE) for q in QUANTITIES]


def _evidence(change: Change) -> str:
    return "" if math.isnan(change.relative) else change.evidence
