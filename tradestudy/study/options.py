"""What was set from outside, as options of the command line that set it again."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from tradestudy.accuracy import QUANTITIES
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import Document, Entry, ListEntry, Path, ScalarEntry, dotted
from tradestudy.study.source import UnreadableError, compose

_OF_ALL: Final = "accuracy.relative"
_OF_PICTURES: Final = "light_spot.tolerance"


def options(definition: StudyDefinition) -> tuple[str, ...]:
    """Options and their values, in order: ``("--set", "scene.distances.to=4 m", "--tolerance", "1 %")``.

    They give a study that says the same, so that its hash is the same.
    """
    return tuple(_options(definition))


def _options(definition: StudyDefinition) -> Iterator[str]:
    document = definition.document
    covered = _by_tolerance(definition)
    for one in document.overrides:
        if one.path not in covered:
            yield from ("--set", f"{dotted(one.path)}={_value(document.entry(one.path))}")
    if covered:
        yield from ("--tolerance", _value(document.entry(_OF_ALL)))


def _by_tolerance(definition: StudyDefinition) -> frozenset[Path]:
    """Values that one tolerance sets: that of all, none of a quantity alone, and a looser one of pictures.

    Nothing where one would set others, or no tolerance of all was given.
    """
    document = definition.document
    of_all, of_pictures = (document.path_of(path) for path in (_OF_ALL, _OF_PICTURES))
    alone = {of_all, *(document.path_of(f"accuracy.{name}") for name in QUANTITIES)}
    given = {one.path: one for one in document.overrides}
    if of_all not in given or any(document.entry(path) for path in alone - {of_all}):
        return frozenset()
    if _loosened(definition, document) != _value(document.entry(of_pictures)):
        return frozenset()
    if of_pictures not in given:
        return frozenset(alone)
    before = definition.with_values({_OF_PICTURES: given[of_pictures].before.partition(" (")[0] or None})
    implied = _loosened(before, document) == _value(document.entry(of_pictures))
    return frozenset(alone | {of_pictures} if implied else alone)


def _loosened(definition: StudyDefinition, document: Document) -> str:
    """The tolerance of pictures under the tolerance of all that a document has."""
    return _value(definition.with_tolerance(_value(document.entry(_OF_ALL))).document.entry(_OF_PICTURES))


def _value(entry: Entry | None) -> str:
    """A value in YAML, with its basis; text for text as it was given, for its text is hashed."""
    if entry is None:
        return "null"
    if isinstance(entry, ScalarEntry) and not _has_basis(entry) and _reads_the_same(entry):
        return entry.text
    return _within_brackets(entry)


def _has_basis(entry: Entry) -> bool:
    return entry.annotation is not None and bool(entry.annotation.basis or entry.annotation.note)


def _reads_the_same(entry: ScalarEntry) -> bool:
    """Whether its text needs no quotes to be what it is."""
    try:
        read, problems = compose(entry.text, entry.place)
    except UnreadableError:
        return False
    return read == entry and not problems


def _within_brackets(entry: Entry) -> str:
    if isinstance(entry, ScalarEntry):
        bare = _quoted(entry.text) if isinstance(entry.value, str) else entry.text
    elif isinstance(entry, ListEntry):
        bare = f"[{', '.join(map(_within_brackets, entry.items))}]"
    else:
        members = (f"{_quoted(key)}: {_within_brackets(member.entry)}" for key, member in entry.members.items())
        bare = "{" + ", ".join(members) + "}"
    if not _has_basis(entry) or entry.annotation is None:
        return bare
    parts = {"basis": entry.annotation.basis or "", "note": entry.annotation.note}
    return f"{{value: {bare}" + "".join(f", {key}: {_quoted(text)}" for key, text in parts.items() if text) + "}"


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"
