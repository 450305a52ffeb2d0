"""Entries of the catalogue: whether each is complete and consistent, its modes, and the index that lists them all."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tradestudy.cameras.camera import Camera, Contradiction
from tradestudy.cameras.declaration import DepthCameraDeclaration
from tradestudy.cameras.stated_declaration import StatedAccuracyPart
from tradestudy.catalogue import PREFIX, Listed, entry_names, entry_path, revision
from tradestudy.errors import OutOfRangeError, Problem, StudyError, nearest
from tradestudy.study import document as tree
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import MappingEntry, ScalarEntry, child, walk
from tradestudy.study.loading import read_text
from tradestudy.study.plausibility import contradictions
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.shared_cameras import load_entries
from tradestudy.study.source import UnreadableError
from tradestudy.units import ANGLE, PIXELS, pretty
from tradestudy.wording import counted

_NEEDS_SOURCE: Final = ("datasheet", "paper", "measured")
_NEEDS_NOTE: Final = ("assumed", "derived")
_WORDS: Final = ("kind", "title", "note", "read_as")
_OF_ACCURACY: Final = ("says", "metric", "share", "up_to", "mode", "target", "gives")
"""Keys of a stated accuracy that its number's source covers."""
_ROUNDING: Final = 0.02  # of a disparity error derived from a stated accuracy


@dataclass(frozen=True, kw_only=True)
class Claim:
    """An accuracy that a maker states, and what it means for the camera as its entry declares it.

    Parameters
    ----------
    mode, name, part
        The mode of the camera, the name of the statement, and its content.
    implied_px, declared_px
        The disparity error [px] that alone would cause the stated accuracy, ``σ_d = σ_Z c B / Z²``, and that of the
        entry.
    """

    mode: str
    name: str
    part: StatedAccuracyPart
    implied_px: float
    declared_px: float

    @property
    def verdict(self) -> str:
        """Whether matching noise alone is within the claim; a claim that gave the disparity error checks nothing."""
        if self.part.gives == "disparity_error":
            return "gave the disparity error, so it checks nothing"
        within = self.declared_px <= self.implied_px
        kept = "within the claim" if within else "beyond the claim"
        return f"the declared disparity error of {pretty(self.declared_px, PIXELS, 2)} is {kept}"


@dataclass(frozen=True, kw_only=True)
class Entry:
    """An entry in all its modes; their names are "" for an entry without modes."""

    definition: StudyDefinition
    modes: tuple[str, ...]

    @property
    def cameras(self) -> Iterator[tuple[str, Camera]]:
        """The camera in each mode."""
        yield from zip(self.modes, self.definition.designs.values(), strict=True)

    def claims(self) -> Iterator[Claim]:
        """Every stated accuracy of a stereo rig, in every mode to which it belongs."""
        for (mode, camera), part in zip(self.cameras, self.definition.file.cameras.values(), strict=True):
            reach = camera.one_pixel_distance
            if part.stated is None or math.isnan(reach) or not isinstance(part, DepthCameraDeclaration):
                continue
            for name, accuracy in part.stated.accuracy.items():
                if accuracy.mode in (mode, "not stated"):
                    implied = accuracy.standard_deviation * reach / accuracy.up_to**2
                    declared = part.depth.declared_error_px or math.nan
                    yield Claim(mode=mode, name=name, part=accuracy, implied_px=implied, declared_px=declared)

    def contradictions(self) -> list[tuple[str, Contradiction]]:
        """Inputs that contradict each other, each with its mode."""
        modes = dict(zip(self.definition.file.cameras, self.modes, strict=True))
        of_cameras = contradictions(PreparedStudy(self.definition))
        return [(modes[camera], contradiction) for camera, contradiction in of_cameras]


def entry_of(source: str) -> Entry:
    """The camera file that the key ``from`` names, in all its modes.

    Raises
    ------
    OutOfRangeError
        There is no such file.
    StudyError
        The file is no camera, or one of its modes is none.
    """
    entry_name = source.removeprefix(PREFIX)
    if entry_name == source and not Path(source).is_file():
        close = nearest(source, entry_names()) or "ENTRY"
        raise OutOfRangeError(
            "there is no such camera file", value=source, remedy=f"catalogue/{close} names a camera of the catalogue"
        )
    modes = _modes(Path(source) if entry_name == source else entry_path(entry_name))
    quoted = source.replace("'", "''")
    cameras = [
        f"  m{number}: {{from: '{quoted}'{f', mode: {tree.scalar_text(mode)!r}' if mode else ''}}}"
        for number, mode in enumerate(modes)
    ]
    text = "\n".join((_STUDY, *cameras))
    return Entry(definition=StudyDefinition.of(read_text(text, "entry.yaml")), modes=modes)


_STUDY: Final = """\
format: 2
study: entry
title: Entry of the catalogue
question: Is it complete?
scene: {distances: {from: 0.5 m, to: 5 m, points: 3, spacing: log}, wavelength: 550 nm}
cameras:"""


def _modes(path: Path) -> tuple[str, ...]:
    """Names of the modes of a file; "" alone if it has none, or if it cannot be read, which is reported elsewhere."""
    try:
        entry, _ = load_entries(path)
    except UnreadableError:
        return ("",)
    written = child(entry, "modes")
    return tuple(written.members) or ("",) if isinstance(written, MappingEntry) else ("",)


def incomplete(entry: Entry) -> list[Problem]:
    """What an entry of the catalogue lacks: bases, sources and reasons of its values, and whether a projector is on."""
    problems: list[Problem] = []
    document = entry.definition.document
    for camera, part in entry.definition.file.cameras.items():
        above = ("cameras", camera)
        written = document.entry(above)
        assert written is not None
        for path, value in walk(written, above):
            if what := _lack(path[2:], value):
                place = document.locate(path)
                problems.append(place.problem(path[2:], what))
        if isinstance(part, DepthCameraDeclaration) and (part.stated is None or part.stated.projector is None):
            place = document.locate((*above, "kind"))
            problems.append(place.problem(("stated", "projector"), "this key is missing; on, off or none is expected"))
    for claim in entry.claims():
        if claim.part.gives == "disparity_error" and abs(claim.implied_px / claim.declared_px - 1.0) > _ROUNDING:
            where = ("depth", "disparity_error")
            place = document.locate(("cameras", f"m{entry.modes.index(claim.mode)}", *where))
            gives = pretty(claim.implied_px, PIXELS, 3)
            what = f"stated.accuracy.{claim.name}, from which it is derived, gives {gives}"
            problems.append(place.problem(where, what))
    return list(dict.fromkeys(problems))


def _lack(path: tree.Path, entry: tree.Entry) -> str:
    """What a value lacks that stands at a path below its camera; empty if it needs nothing more."""
    in_list = any(isinstance(step, int) for step in path)
    # A list has one basis for all of its items.
    if isinstance(entry, MappingEntry) or in_list or not path or path[0] in _WORDS:
        return ""
    if path[:2] == ("stated", "accuracy") and path[-1] in _OF_ACCURACY:
        return ""
    said = entry.annotation
    if said is None or said.basis is None:
        return "this value has no basis; write {value: …, basis: …}"
    if said.basis in _NEEDS_SOURCE and said.source is None:
        return f"a value from a {said.basis} source needs its source: title, url, read_on and quote"
    if said.basis in _NEEDS_NOTE and not said.note:
        return f"a value that is {said.basis} needs a note that says why, or from what"
    if said.basis == "assumed" and said.source is not None and isinstance(entry, ScalarEntry):
        return "a value that a source states is not assumed; state the other basis"
    return ""


def lines(source: str) -> Iterator[str]:
    """What `tradestudy cameras --check` says about a camera file that is complete.

    Raises
    ------
    StudyError
        With everything that it lacks.
    """
    entry = entry_of(source)
    if lacking := incomplete(entry):
        raise StudyError(lacking)
    for mode, camera in entry.cameras:
        row = index_row(source, mode, camera, entry)
        near = "unknown nearest distance" if row.nearest is None else f"nearest {row.nearest:.3g} m"
        yield f"{row.title}: {row.focal_length_px:.0f} px, {pretty(row.field_of_view, ANGLE, 3)}, {near}"
    for mode, contradiction in entry.contradictions():
        head = f"contradiction{f' in mode {mode}' if mode else ''}: {contradiction.what}"
        yield f"{head}: {contradiction.stated}, but {contradiction.implied}"
    for claim in entry.claims():
        of_mode = f" in mode {claim.mode}" if claim.mode else ""
        yield (
            f"claim {claim.name}{of_mode}: “{claim.part.says}” means a disparity error of "
            f"{pretty(claim.implied_px, PIXELS, 2)}; {claim.verdict}"
        )
    yield f"complete: {counted(len(entry.modes), 'mode')}, every value with its basis"


def index_row(name: str, mode: str, camera: Camera, entry: Entry) -> Listed:
    """The row of a camera of an entry, as the index of the catalogue has it; without a revision if it is not there."""
    part = entry.definition.file.cameras[f"m{entry.modes.index(mode)}"]
    in_catalogue = name in entry_names()
    return Listed(
        entry=name,
        mode=mode,
        title=part.title,
        kind=part.kind,
        revision=revision(name) if in_catalogue else "",
        projector=(part.stated.projector if part.stated else None) or "",
        pixels=(camera.sensor.columns, camera.sensor.rows),
        focal_length_px=_round(camera.gathering_lens.focal_length / camera.sensor.pixel_pitch),
        field_of_view=_round(sum(camera.edge_angles(math.inf)[:2])),
        baseline=_round(camera.view_baseline) if camera.view_baseline else None,
        nearest=None if math.isnan(camera.nearest_distance) else _round(camera.nearest_distance),
        one_pixel=None if math.isnan(camera.one_pixel_distance) else _round(camera.one_pixel_distance),
    )


def _round(value: float) -> float:
    """Six digits, which no machine changes."""
    return float(f"{value:.6g}")
