"""The document of a study with other values: set from outside, or with the units of numbers from Python."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import cast

from tradestudy.errors import Problem
from tradestudy.study import document as tree
from tradestudy.study.document import (
    OUTSIDE,
    Document,
    Entry,
    ListEntry,
    MappingEntry,
    Member,
    Place,
    ScalarEntry,
    Value,
    dotted,
    is_null,
    merged,
    text_of,
)
from tradestudy.study.schema.root import StudyFile
from tradestudy.study.schema.validation import is_of_python, units_missing
from tradestudy.study.shared_cameras import (
    OF_IMPORTS,
    SHARING,
    nothing_to_remove,
    problems_of_removals,
    refused,
)
from tradestudy.study.source import UnreadableError, comment_after, compose, entry_of_value


def overridden(document: Document, overrides: Sequence[str]) -> Document:
    """The document with ``path=value`` texts applied, as `read` applies them."""
    for number, override in enumerate(overrides, start=1):
        document = _overridden(document, override, number)
    return document


def in_si(document: Document, given_as_text: Sequence[tree.Path] = ()) -> Document:
    """The document with the SI unit beside every number from Python that lacks its unit; text is left as it is."""
    document = _with_units(document, given_as_text)
    units: dict[str, str] = {}
    texts: dict[tree.Path, str] = {}
    for path, varied, entry in _varied(document):
        if is_of_python(entry) and not _is_below(path, given_as_text):
            if varied not in units:
                units[varied] = _unit_at(document, varied, entry)
            texts[path] = f"{entry.text} {units[varied]}".strip()
    # A text without a space was given no unit, so its entry stays as it is.
    return document.with_texts({path: text for path, text in texts.items() if " " in text})


def _with_units(document: Document, given_as_text: Sequence[tree.Path] = ()) -> Document:
    """The document with units beside the numbers for which the schema expects them."""
    while units := units_missing(document, StudyFile):  # those of a part may show only when another is valid
        units = {path: unit for path, unit in units.items() if not _is_below(path, given_as_text)}
        if not units:
            break
        entries = {path: document.entry(path) for path in units}
        texts = {path: f"{text_of(entry)} {units[path]}" for path, entry in entries.items() if entry is not None}
        document = document.with_texts(texts)
    return document


def _is_below(path: tree.Path, others: Sequence[tree.Path]) -> bool:
    return any(path[: len(other)] == other for other in others)


def _varied(document: Document) -> Iterator[tuple[tree.Path, str, ScalarEntry]]:
    """The values that sweeps, readings and questions give to others, each with its path and the path of the other."""
    for key in document.root.members.keys() & {"sweep", "readings", "solve", "value_of_information"}:
        for path, entry in tree.walk(document.root.members[key].entry, (key,)):
            match path:
                case ("sweep", str(varied), int() | "from" | "to") | ("readings", _, "set", str(varied)):
                    pass
                case (*above, "low" | "high"):
                    vary = document.entry((*above, "vary"))
                    varied = text_of(vary.items[0] if isinstance(vary, ListEntry) else vary) if vary else ""
                case _:
                    continue
            if isinstance(entry, ScalarEntry):
                yield path, varied, entry


def _unit_at(document: Document, path: str, number: ScalarEntry) -> str:
    """The SI unit that the value at a dotted path needs; empty if it needs none or there is no such value."""
    changed = _with_units(_with_value(document, path, number.value, OUTSIDE, OUTSIDE))
    entry = changed.entry(path)
    return entry.text.partition(" ")[2] if isinstance(entry, ScalarEntry) else ""


def with_values(
    document: Document, values: Mapping[str, Value | Entry], *, written_at: Mapping[str, str | tree.Path] | None = None
) -> Document:
    """Set values in a document, as a sweep or another reading of the same study does.

    Parameters
    ----------
    document
        The document, which is not modified.
    values
        By dotted path: YAML text as in a file, an entry, or a Python value. A null removes a value.
    written_at
        For a path, where in the document its value is written; mistakes are then reported there, else at ``--set``.

    Returns
    -------
    Document
        It contains the mistakes in the values, which `validate` reports; among them are values of which one would
        replace another or a part of it.
    """
    earlier: list[tree.Path] = []
    for number, (path, value) in enumerate(values.items(), start=1):
        source = (written_at or {}).get(path)
        place = Place(OUTSIDE.file, number, 1) if source is None else document.locate(source)
        steps = document.path_of(path)
        if what := tree.overlap(steps, earlier):
            document = document.with_problems(place.problem(steps, what))
            continue
        earlier.append(steps)
        document = _with_value(document, path, value, place, place)
    return document


def _overridden(document: Document, override: str, number: int) -> Document:
    """Apply one ``path=value`` of the command line."""
    path, sign, text = override.partition("=")
    place = Place(OUTSIDE.file, number, 1)
    if not sign or not path.strip():
        return document.with_problems(
            place.problem((), f"'{override}' is not of the form path=value, such as scene.wavelength=550 nm")
        )
    steps = document.path_of(path.strip())
    if what := tree.overlap(steps, (other.path for other in document.overrides)):
        return document.with_problems(place.problem(steps, what))
    written = text.lstrip()
    value_place = Place(OUTSIDE.file, number, len(override) - len(written) + 1)
    return _with_value(document, path.strip(), written, place, value_place)


def _with_value(document: Document, path: str, value: Value | Entry, place: Place, value_place: Place) -> Document:
    """Set the value at a dotted path."""
    steps = document.path_of(path)
    try:
        entry, problems = _read_value(value, value_place)
    except UnreadableError as error:
        return document.with_problems(*(replace(problem, path=dotted(steps)) for problem in error.problems))
    if (sharing := next(_shared(steps, entry), None)) is not None:
        why = "is read with the calibration file" if sharing[-1] in OF_IMPORTS else "composes the camera"
        what = f"{sharing[-1]}: {why} and cannot be set; edit the file, or set single values"
        return document.with_problems(place.problem(sharing, what))
    below = document.entry(steps)
    if below is not None:
        problems += problems_of_removals(below, entry, steps)
    try:
        root = cast(MappingEntry, _placed(document.root, steps, (), Member(place, entry)))
    except _NoSuchPlaceError as error:
        problems.append(place.problem(steps, str(error)))
        return document.with_problems(*problems)
    # Values of a reading belong to the study and are not overrides.
    changed = document.with_root(root, steps) if place.file == OUTSIDE.file else replace(document, root=root)
    return changed.with_problems(*problems)


def _read_value(value: Value | Entry, place: Place) -> tuple[Entry, list[Problem]]:
    """The entry of a value, and mistakes that still leave one."""
    if isinstance(value, Entry):
        return value, []
    if not isinstance(value, str):
        return entry_of_value(value, place)
    if comment := comment_after(value):
        raise refused(
            place, f"{comment!r} is a YAML comment; quote it and any text before it if '#' is part of the value"
        )
    return compose(value, place) if value.strip() else (ScalarEntry(place=place, value=None, text=""), [])


def _shared(steps: tree.Path, entry: Entry) -> Iterator[tree.Path]:
    """Paths in a value of keys that say from what a camera is assembled."""
    if steps[0] != "cameras":
        return
    if len(steps) == 3 and steps[2] in (*SHARING, "mode", *OF_IMPORTS):
        yield steps
    elif len(steps) < 3 and isinstance(entry, MappingEntry):
        for key, member in entry.members.items():
            yield from _shared((*steps, key), member.entry)


class _NoSuchPlaceError(Exception):
    """A path leads through a value that has no parts."""


def _placed(entry: Entry | None, steps: tree.Path, above: tree.Path, new: Member) -> Entry:
    """The entry with a member set at the end of the steps; missing mappings on the way are created."""
    if not steps:
        return merged(entry, new.entry) if entry is not None else new.entry
    step, rest = steps[0], steps[1:]
    if isinstance(entry, ListEntry):
        if not isinstance(step, int) or step >= len(entry.items):
            raise _NoSuchPlaceError(
                f"'{dotted(above)}' is a list; one of the positions 0 to {len(entry.items) - 1} is expected"
            )
        changed = _placed(entry.items[step], rest, (*above, step), new)
        return replace(entry, items=(*entry.items[:step], changed, *entry.items[step + 1 :]))
    if isinstance(entry, ScalarEntry):
        raise _NoSuchPlaceError(f"'{dotted(above)}' is a single value and has no '{step}'")
    if entry is None:
        entry = MappingEntry(place=new.key_place, members={}, implied=True)
    members, key = dict(entry.members), str(step)
    if not rest and is_null(new.entry):
        if key not in members:
            raise _NoSuchPlaceError(nothing_to_remove(key, members))
        del members[key]
        return replace(entry, members=members)
    old = members.get(key)
    changed = _placed(old.entry if old else None, rest, (*above, key), new)
    members[key] = Member(new.key_place if old is None or not rest else old.key_place, changed)
    return replace(entry, members=tree.unanswered(members))
