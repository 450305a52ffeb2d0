"""Write a study as the text of a study file."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Final

from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import Document, Entry, ListEntry, MappingEntry, ScalarEntry, dotted, walk
from tradestudy.study.source import scalar_of

_PLAIN: Final = re.compile(r"[A-Za-z0-9_+.][\w µ°%./+^*-]*(?<! )")  # no character with a meaning in YAML


def standalone(definition: StudyDefinition) -> StudyDefinition:
    """The study with absolute names of data files, so that it means the same in every folder."""
    names = {path: str(file.resolve()) for path, file in definition.named_files().items()}
    for path, entry in walk(definition.document.root, ()):
        in_reading = path[:1] == ("readings",) and str(path[-1]).rpartition(".")[2] == "file"
        if in_reading and isinstance(entry, ScalarEntry) and isinstance(entry.value, str):
            names[path] = str((definition.document.folder_of(path) / entry.value).resolve())
    return definition.with_texts(names) if names else definition


def options(document: Document, tolerance: str | None) -> tuple[str, ...]:
    """The command-line options that reproduce the values set from outside the study file, with the same hash.

    They are in order, such as ``("--set", "scene.distances.to=4 m", "--tolerance", "1 %")``.
    """
    values = {dotted(changed.path): document.entry(changed.path) for changed in document.overrides}
    texts = (f"{path}={'null' if entry is None else _on_one_line(entry)}" for path, entry in values.items())
    settings = [part for text in texts for part in ("--set", text)]
    return (*settings, *(() if tolerance is None else ("--tolerance", tolerance)))


def yaml_of(entry: MappingEntry) -> str:
    """A mapping as YAML in block style; lists and values with a basis stand on one line."""
    return "\n".join(_lines(entry, "")) + "\n"


def _lines(entry: MappingEntry, indent: str) -> Iterator[str]:
    for key, member in entry.members.items():
        below = member.entry
        if isinstance(below, MappingEntry) and below.members:
            yield f"{indent}{_text(key)}:"
            yield from _lines(below, f"{indent}  ")
        else:
            yield f"{indent}{_text(key)}: {_on_one_line(below)}".rstrip()


def _on_one_line(entry: Entry) -> str:
    if isinstance(entry, ListEntry):
        bare = f"[{', '.join(map(_on_one_line, entry.items))}]"
    elif isinstance(entry, MappingEntry):
        members = (f"{_text(key)}: {_on_one_line(member.entry)}" for key, member in entry.members.items())
        bare = f"{{{', '.join(members)}}}"
    else:
        bare = _text(entry.text) if isinstance(entry.value, str) else entry.text
    said = {} if entry.annotation is None else entry.annotation.given()
    return f"{{value: {bare}{_beside(said)}}}" if said else bare


def _beside(said: Mapping[str, str | dict[str, str]]) -> str:
    """The keys beside a value, each after a comma."""
    shown = {key: _text(part) if isinstance(part, str) else f"{{{_beside(part)[2:]}}}" for key, part in said.items()}
    return "".join(f", {key}: {text}" for key, text in shown.items())


def _text(text: str) -> str:
    """Text in quotes if YAML would read it as something else without them."""
    if _PLAIN.fullmatch(text) and isinstance(scalar_of(text), str):
        return text
    quoted = json.dumps(text, ensure_ascii=False)
    return "".join(letter if letter.isprintable() else f"\\U{ord(letter):08x}" for letter in quoted)
