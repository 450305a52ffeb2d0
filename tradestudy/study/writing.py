"""Write a study as the text of a study file."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Final

from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import Entry, ListEntry, MappingEntry, ScalarEntry, walk
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
    if entry.annotation is None:
        return bare
    return f"{{value: {bare}{_beside(entry.annotation.given())}}}"


def _beside(said: Mapping[str, str | dict[str, str]]) -> str:
    """The keys beside a value, each after a comma."""
    return "".join(
        f", {key}: {_text(one) if isinstance(one, str) else '{' + _beside(one)[2:] + '}'}" for key, one in said.items()
    )


def _text(text: str) -> str:
    """Text in quotes if YAML would read it as something else without them."""
    if _PLAIN.fullmatch(text) and isinstance(scalar_of(text), str):
        return text
    return "".join(one if one.isprintable() else f"\\U{ord(one):08x}" for one in json.dumps(text, ensure_ascii=False))
