"""The command-line options that reproduce values set from outside the study file."""

from __future__ import annotations

from collections.abc import Iterator

from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import Entry, ListEntry, ScalarEntry, dotted
from tradestudy.study.source import UnreadableError, compose


def options(definition: StudyDefinition) -> tuple[str, ...]:
    """Options and their values, in order, such as ``("--set", "scene.distances.to=4 m", "--tolerance", "1 %")``.

    They reproduce the same study, with the same hash.
    """
    return tuple(_options(definition))


def _options(definition: StudyDefinition) -> Iterator[str]:
    for one in definition.document.overrides:
        yield from ("--set", f"{dotted(one.path)}={_value(definition.document.entry(one.path))}")
    if definition.tolerance is not None:
        yield from ("--tolerance", definition.tolerance)


def _value(entry: Entry | None) -> str:
    """A value in YAML, with its basis, exactly as given because its text is hashed."""
    if entry is None:
        return "null"
    if isinstance(entry, ScalarEntry) and not _has_basis(entry) and _reads_the_same(entry):
        return entry.text
    return _within_brackets(entry)


def _has_basis(entry: Entry) -> bool:
    return entry.annotation is not None and bool(entry.annotation.basis or entry.annotation.note)


def _reads_the_same(entry: ScalarEntry) -> bool:
    """Whether the text of a value, without quotes, parses as the same value."""
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
