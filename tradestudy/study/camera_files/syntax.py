"""Parsers of calibration files, one for each syntax; trees contain the place of every value. Nothing is executed."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, Final
from xml.parsers import expat

from tradestudy.study.camera_files.located import CameraFile, CameraFileError
from tradestudy.study.document import Entry, ListEntry, MappingEntry, Member, Place, ScalarEntry
from tradestudy.study.source import DEEPEST, MOST_VALUES, UnreadableError, compose

_CORNER_LINE: Final = re.compile(
    r'\A[^\n:]*\bboard_x|^(?:"?\w*"? ?[,;\t] ?)*"?board_x\w*"? ?[,;\t]|\A\d+[,;][^\n:]*$', re.MULTILINE
)
"""Names of columns, possibly below a title, or numbers below names that are commented out."""
_OPENCV_HEAD: Final = re.compile(r"%YAML[: ]1\.[0-2][^\n]*")
_STORAGE_ATTRIBUTES: Final = ("type_id",)
"""Attributes of OpenCV's XML that only say how a value is stored."""
_NUMBER: Final = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_ASSIGNMENTS: Final = re.compile(
    r"(%(?!YAML)[^\n]*\n\s*)*(\[\w{1,99}\]\s*\w+ ?=|[A-Za-z]\w{0,99} ?= ?\S|calib_time:"
    r"|\w{1,99}:( [-+]?\d[-+.\deE]*){2,999}\s*$)",
    re.MULTILINE,
)
"""The beginning of lines such as ``fx=700``, ``fc_left = [ 700 701 ];`` or ``P0: 700 0 …``, below comments."""
_SAVED_INPUTS: Final = re.compile(r"""(['"]optimization_inputs['"]\s*:\s*)b(?:'[^']*'|"[^"]*")""")
_NAME: Final = re.compile(r"([A-Za-z][\w.]*)\s*[=:]\s*")


def syntax_of(text: str) -> str:
    """The syntax of a text, recognised by its beginning."""
    lines = (line for line in text.lstrip("\ufeff \t\r\n").split("\n") if not line.startswith("#"))
    body = "\n".join(islice(lines, 20)).lstrip()
    if _CORNER_LINE.search(body):
        return "corners"
    if body.startswith("<"):
        return "opencv-xml"
    if _OPENCV_HEAD.match(body):
        return "opencv-yaml"
    if _ASSIGNMENTS.match(body):
        return "assignments"
    if body.startswith("{"):
        return "python" if re.search(r"""['"]lensmodel['"]""", text) else "json"
    return "yaml"


def parsed(path: Path, text: str, syntax: str, label: str) -> CameraFile:
    """A file with its tree.

    Raises
    ------
    CameraFileError
        The text violates its syntax.
    """
    root = _PARSERS[syntax](path, text)
    return CameraFile(path=path, label=label, syntax=syntax, text=text, root=root)


def _opencv_yaml(path: Path, text: str) -> Entry:
    """YAML with tags, a header that other parsers refuse, and no space after keys; ``Camera.fx`` is fx in Camera."""
    text = _OPENCV_HEAD.sub(lambda head: "#" + head.group()[1:], text, count=1)
    root = _yaml(path, re.sub(r"^(\s*data:)\[", r"\1 [", text, flags=re.MULTILINE), tags=True)
    if not isinstance(root, MappingEntry):
        return root
    top: dict[str, Member] = {}
    groups: dict[str, dict[str, Member]] = {}
    for name, member in root.members.items():
        outer, _, inner = name.partition(".")
        if inner and outer not in groups:
            groups[outer] = {}
            _add(top, outer, MappingEntry(place=member.key_place, members=groups[outer]), member.key_place)
        _add(groups[outer] if inner else top, inner or name, member.entry, member.key_place)
    return replace(root, members=top)


def _assignments(path: Path, text: str) -> Entry:
    """Lines that give names values: numbers in brackets or without, and text; below sections in square brackets."""
    top: dict[str, Member] = {}
    section, count = top, 0
    for number, line in enumerate(text.split("\n"), 1):
        place, words = Place(str(path), number, 1), line.partition("#")[0].partition("%")[0].strip()
        if header := re.fullmatch(r"\[(\w+)\]", words):
            section = {}
            _add(top, header[1], MappingEntry(place=place, members=section), place)
        elif words:
            match = _NAME.match(words)
            if match is None:
                raise CameraFileError(place.problem((), f"'{words[:40]}' does not give a name a value"))
            value = _value(place, re.sub(r"[\[\],;]", " ", words[match.end() :]).strip())
            count += len(value.items) if isinstance(value, ListEntry) else 1
            if count > MOST_VALUES:
                raise CameraFileError(place.problem((), f"the file contains more than {MOST_VALUES} values"))
            _add(section, match[1], value, place)
    return MappingEntry(place=Place(str(path), 1, 1), members=top)


def _add(members: dict[str, Member], key: str, entry: Entry, place: Place) -> None:
    if key in members:
        raise CameraFileError(place.problem((key,), "duplicate key; remove one of them"))
    members[key] = Member(place, entry)


def _value(place: Place, text: str) -> Entry:
    """A list if the text contains several numbers, else one value."""
    words = text.split()
    if len(words) > 1 and all(map(_NUMBER.fullmatch, words)):
        return ListEntry(place=place, items=tuple(_scalar(place, float(word), word) for word in words))
    text = text.strip("\"'")
    is_number = _NUMBER.fullmatch(text) is not None
    return _scalar(place, float(text) if is_number else text or None, text)


def _yaml(path: Path, text: str, *, tags: bool = False) -> Entry:
    try:
        entry, problems = compose(text, Place(str(path), 1, 1), tags=tags)
    except UnreadableError as error:
        raise CameraFileError(error.problems[-1]) from None
    if problems:
        raise CameraFileError(problems[0])
    return entry


def _xml(path: Path, text: str) -> Entry:
    """OpenCV's XML: elements as keys, text as values; document type definitions are refused.

    An attribute ``unit`` of an element ``T`` becomes the key ``T_unit`` beside it, but for attributes of storage; an
    element ``T`` with the attribute ``id="0"`` becomes ``T_0``.
    """
    builder = _XmlBuilder(path)
    try:
        builder.parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        place = Place(str(path), error.lineno, error.offset + 1)
        raise CameraFileError(place.problem((), f"this is not valid XML: {expat.ErrorString(error.code)}")) from None
    if builder.root is None:
        raise CameraFileError(Place(str(path), 1, 1).problem((), "this XML is empty; a calibration is expected"))
    return builder.root


class _XmlBuilder:
    """Collects elements into entries."""

    def __init__(self, path: Path) -> None:
        self.path, self.root = str(path), None
        self.open: list[tuple[Place, str, dict[str, Member], list[Entry], list[str]]] = []
        self.count = 0
        self.parser = expat.ParserCreate("utf-8")
        self.parser.StartElementHandler = self.start
        self.parser.EndElementHandler = self.end
        self.parser.CharacterDataHandler = self.characters
        self.parser.StartDoctypeDeclHandler = self.refuse
        self.parser.EntityDeclHandler = self.refuse

    root: Entry | None

    @property
    def place(self) -> Place:
        """Current place of the parser."""
        return Place(self.path, self.parser.CurrentLineNumber, self.parser.CurrentColumnNumber + 1)

    def fail(self, what: str) -> CameraFileError:
        """A mistake at the current place."""
        return CameraFileError(self.place.problem((), what))

    def refuse(self, *_arguments: Any) -> None:
        """Refuse definitions, which could expand without end or read other files."""
        raise self.fail("definitions of document types and entities are not allowed; remove them")

    def start(self, name: str, attributes: Mapping[str, str]) -> None:
        """Open an element."""
        self.count += 1
        if self.count > MOST_VALUES:
            raise self.fail(f"the file contains more than {MOST_VALUES} values")
        if len(self.open) >= DEEPEST:
            raise self.fail(f"values are nested more than {DEEPEST} levels deep")
        stated = {key: value for key, value in attributes.items() if key not in _STORAGE_ATTRIBUTES}
        if self.open and (number := stated.pop("id", None)) is not None:
            name = f"{name}_{number}"
        members: dict[str, Member] = {}
        if self.open and name == "_" and stated:
            raise self.fail(f"the attribute {next(iter(stated))} of a list's element is not supported; remove it")
        beside, prefix = (self.open[-1][2], f"{name}_") if self.open else (members, "")
        for key, value in stated.items():
            if prefix + key in beside:
                raise self.fail(f"the attribute {key} and another value are both called {prefix}{key}; remove one")
            beside[prefix + key] = Member(self.place, self.value(self.place, value.strip()))
        self.open.append((self.place, name, members, [], []))

    def characters(self, text: str) -> None:
        """Collect the text of an element."""
        if self.open:
            self.open[-1][4].append(text)

    def end(self, _name: str) -> None:
        """Close an element: a mapping if it has elements, a list if these are ``_`` or its text has spaces."""
        place, name, members, items, texts = self.open.pop()
        entry: Entry
        if (items and members) or ((items or members) and "".join(texts).strip()):
            raise CameraFileError(
                place.problem((name,), "elements, list elements (_) and text are mixed; separate them")
            )
        if items:
            entry = ListEntry(place=place, items=tuple(items))
        elif members:
            entry = MappingEntry(place=place, members=members)
        else:
            entry = self.value(place, "".join(texts).strip())
        if not self.open:
            self.root = entry
        elif name == "_":
            self.open[-1][3].append(entry)
        elif name in self.open[-1][2]:
            raise CameraFileError(place.problem((name,), "duplicate key; remove one of them"))
        else:
            self.open[-1][2][name] = Member(place, entry)

    def value(self, place: Place, text: str) -> Entry:
        """See `_value`; counted."""
        self.count += len(text.split())
        if self.count > MOST_VALUES:
            raise self.fail(f"the file contains more than {MOST_VALUES} values")
        return _value(place, text)


def _scalar(place: Place, value: Any, text: str) -> ScalarEntry:
    return ScalarEntry(place=place, value=value, text=text)


_PARSERS: Final[Mapping[str, Callable[[Path, str], Entry]]] = {
    "corners": lambda path, _text: MappingEntry(place=Place(str(path), 1, 1), members={}),
    "opencv-xml": _xml,
    "opencv-yaml": _opencv_yaml,
    "assignments": _assignments,
    # YAML, but for tabs between values, escaped slashes in JSON, and the bytes in which mrcal saves its inputs.
    "python": lambda path, text: _yaml(path, _SAVED_INPUTS.sub(r"\1''", text.replace("\t", " "))),
    "json": lambda path, text: _yaml(path, text.replace("\t", " ").replace("\\/", "/")),
    "yaml": _yaml,
}
