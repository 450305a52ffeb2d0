"""Read YAML 1.2 into entries that know their places; report all duplicate keys and refuse hostile input early."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import chain, takewhile
from typing import Any, NoReturn, TypeVar, cast

from ruamel.yaml import YAML
from ruamel.yaml import events as yaml_events
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.reader import ReaderError

from tradestudy.declarations.part import nearest_name
from tradestudy.errors import Problem, nearest
from tradestudy.study.document import (
    BASES,
    OF_SOURCE,
    Annotation,
    Basis,
    Entry,
    ListEntry,
    MappingEntry,
    Member,
    Path,
    Place,
    Scalar,
    ScalarEntry,
    Source,
    Value,
    child,
    count_values,
    scalar_text,
    walk,
)

# Enough for 100 cameras and a list of 100 000 distances, but not for a file made to exhaust the machine.
MOST_VALUES = 120_000
MOST_MISTAKES = 500
DEEPEST = 32

# The parser would take seconds for a tag of this length, and tags are refused anyway.
_ENDLESS_TAG = re.compile(r"!\S{1000}")
# The parser's time grows with the square of the number of brackets open at once.
_ENDLESS_NESTING = re.compile(r"(?:[\[{]\s*){200}")
_TOO_DEEP = f"values are nested more than {DEEPEST} levels deep"
_BESIDE = ("basis", "note", "source")
_DAY = re.compile(r"\d{4}-(0[1-9]|1[0-2])-(0[1-9]|[12]\d|3[01])")
_NO_TAGS = "tags ('!…') have no meaning in a study; remove the tag"
# The scalars of the core schema of YAML 1.2; everything else is text.
_NULL = re.compile(r"|~|null|Null|NULL")
_BOOLEAN = re.compile(r"true|True|TRUE|false|False|FALSE")
_INTEGER = re.compile(r"[-+]?[0-9]{1,30}|0o[0-7]{1,30}|0x[0-9a-fA-F]{1,30}")
_FLOAT = re.compile(
    r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)"
)


# The parser raises others than its own on some malformed escapes and directives.
_PARSER_ERRORS = (YAMLError, ValueError, OverflowError, TypeError, AttributeError, IndexError)


class UnreadableError(Exception):
    """The text gives no tree; ``problems`` are the mistakes found before reading stopped."""

    def __init__(self, problems: list[Problem]) -> None:
        super().__init__(problems)
        self.problems = problems


def compose(text: str, start: Place, *, tags: bool = False) -> tuple[Entry, list[Problem]]:
    """Turn YAML text into entries.

    Parameters
    ----------
    text
        One YAML document.
    start
        The place of its first character.
    tags
        Whether to ignore tags instead of refusing them.

    Returns
    -------
    tuple
        The entry, and mistakes that still leave a tree: duplicate keys, keys that are not text, tags, invalid bases.

    Raises
    ------
    UnreadableError
        If there is no tree: empty text, broken syntax, too many or too deeply nested values.
    """
    entry, problems = _composed(text, start, tags)
    return entry, [*problems]


@lru_cache(maxsize=64)  # a camera's file is also tried as a calibration file, and notebooks load the same study often
def _composed(text: str, start: Place, tags: bool) -> tuple[Entry, tuple[Problem, ...]]:
    composer = _Composer(start=start, last=start, may_have_tags=tags)
    if tag := _ENDLESS_TAG.search(text):
        composer.fail(composer.place_in(text, tag.start()), _NO_TAGS)
    if nesting := _ENDLESS_NESTING.search(text):
        composer.fail(composer.place_in(text, nesting.start()), _TOO_DEEP)
    try:
        root = composer.document(YAML(typ="safe", pure=True).parse(text))
    except UnreadableError:
        raise
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        composer.fail(start if mark is None else composer.place_at(mark.line, mark.column), _syntax(error))
    except ReaderError as error:
        place = composer.place_in(text, error.position)
        composer.fail(
            place, f"the character U+{ord(text[error.position]):04X} is not allowed in YAML; the file may not be text"
        )
    except _PARSER_ERRORS as error:
        composer.fail(composer.last, f"this is not valid YAML ({error})")
    if root is None:
        composer.fail(start, "it is empty; `tradestudy new NAME` writes a starter study")
    return root, (*composer.problems,)


def comment_after(text: str) -> str:
    """The comment that ends the YAML of a single value, with its '#'; empty if there is none or the text is no YAML."""
    if "#" not in text:
        return ""
    try:
        tokens = [*YAML(typ="safe", pure=True).scan(text)]
    except _PARSER_ERRORS:
        return ""
    # Tokens without text, such as the end of a block, stand after the comment.
    return text[max((t.end_mark.index for t in tokens if t.end_mark.index > t.start_mark.index), default=0) :].strip()


def entry_of_value(value: Value, place: Place) -> tuple[Entry, list[Problem]]:
    """Turn a Python value into entries by the rules of `compose`; its text is literal, not YAML.

    Raises
    ------
    UnreadableError
        If it contains too many or too deeply nested values.
    """
    composer = _Composer(start=place, last=place)
    return composer.of_value(value, ()), composer.problems


_Part = TypeVar("_Part")


@dataclass(kw_only=True)
class _Composer:
    """Builds entries from events; an alias shares the entry of its anchor but counts at each use.

    A path has one step for each open mapping or list, so that its length limits the recursion; the step into a key, or
    below one that is no text, is empty.
    """

    start: Place
    last: Place
    may_have_tags: bool = False
    problems: list[Problem] = field(default_factory=list)
    anchors: dict[str, Entry | None] = field(default_factory=dict)  # None while the value is open
    count: int = 0

    def place_at(self, line: int, column: int) -> Place:
        """Place in the file of a line and column of the text, counted from 0."""
        return Place(self.start.file, self.start.line + line, column + (self.start.column if line == 0 else 1))

    def place_in(self, text: str, position: int) -> Place:
        """Place in the file of a character of the text."""
        before = text[:position]
        return self.place_at(before.count("\n"), len(before) - before.rfind("\n") - 1)

    def note(self, place: Place, what: str, path: Path) -> None:
        """Record a mistake."""
        self.problems.append(place.problem(tuple(step for step in path if step != ""), what))
        if len(self.problems) >= MOST_MISTAKES:
            self.fail(place, "reading stopped here, after too many mistakes")

    def fail(self, place: Place, what: str) -> NoReturn:
        """Record a mistake and stop reading."""
        self.problems.append(place.problem((), what))
        raise UnreadableError(self.problems)

    def document(self, events: Iterator[Any]) -> Entry | None:
        """The only document of a stream; None if it is empty."""
        root: Entry | None = None
        documents = 0
        for event in events:
            self.last = self.place_at(event.start_mark.line, event.start_mark.column)
            if isinstance(event, yaml_events.NodeEvent):
                root = self.of_event(event, events, ())
            documents += isinstance(event, yaml_events.DocumentStartEvent)
            if documents > 1:
                self.fail(self.last, "a second document begins here; a study is one document")
        return root

    def of_event(self, event: Any, events: Iterator[Any], path: Path) -> Entry:
        """The entry that begins with an event of the parser, and ends before the next event."""
        self.last = place = self.place_at(event.start_mark.line, event.start_mark.column)
        if isinstance(event, yaml_events.AliasEvent):
            return self.alias(event.anchor, place, path)
        if event.tag is not None and not self.may_have_tags:  # the schema defines the type of each value
            self.note(place, _NO_TAGS, path)
        if event.anchor:
            self.anchors[event.anchor] = None
        if isinstance(event, yaml_events.ScalarEvent):
            entry: Entry = self.scalar(event.value, place, path, is_plain=event.implicit[0] and not event.style)
        else:
            parts = takewhile(lambda part: not isinstance(part, yaml_events.CollectionEndEvent), events)
            build = self.mapping if isinstance(event, yaml_events.MappingStartEvent) else self.sequence
            entry = build(place, parts, lambda part, at: self.of_event(part, events, at), path)
        if event.anchor:
            self.anchors[event.anchor] = entry
        return entry

    def of_value(self, value: Value, path: Path) -> Entry:
        """The entry of a Python value; all of it has the place where reading began."""
        if isinstance(value, Mapping):
            return self.mapping(self.start, chain.from_iterable(value.items()), self.of_value, path)
        if isinstance(value, list | tuple):
            return self.sequence(self.start, iter(value), self.of_value, path)
        # Numbers of other libraries, too, are read as they print themselves.
        text = value if isinstance(value, str) else scalar_text(cast(Scalar, value))
        return self.scalar(text, self.start, path, is_plain=not isinstance(value, str))

    def scalar(self, written: str, place: Place, path: Path, *, is_plain: bool) -> ScalarEntry:
        """A single value; unless it is plain, quotes make it text."""
        self.count_values(place, 1)
        if "\0" in written:
            self.note(place, "an escape gives the null character, which no text may contain", path)
        if any("\ud800" <= letter <= "\udfff" for letter in written):
            self.note(place, "an escape gives half a character (a lone surrogate)", path)
        text = re.sub("[\0\ud800-\udfff]", "\ufffd", written)
        return ScalarEntry(place=place, value=scalar_of(text) if is_plain else text, text=text)

    def sequence(
        self, place: Place, parts: Iterator[_Part], entry_of: Callable[[_Part, Path], Entry], path: Path
    ) -> ListEntry:
        """A list of parts, each an event or a Python value."""
        self.count_values(place, 1)
        self.check_depth(place, len(path))
        items = tuple(entry_of(part, (*path, index)) for index, part in enumerate(parts))
        return ListEntry(place=place, items=items)

    def mapping(
        self, place: Place, parts: Iterator[_Part], entry_of: Callable[[_Part, Path], Entry], path: Path
    ) -> Entry:
        """A mapping of parts, keys and values in turn."""
        self.count_values(place, 1)
        self.check_depth(place, len(path))
        members: dict[str, Member] = {}
        for part in parts:
            key, key_place = self.key(entry_of(part, (*path, "")), path)
            here = (*path, key)
            entry = entry_of(next(parts), here)
            if key == "<<":
                self.note(key_place, "YAML 1.2 has no merge key; cameras share values by from: and like:", here)
            elif key in members:
                first = members[key].key_place.line
                self.note(key_place, f"duplicate key, first on line {first}; remove one of them", here)
            elif key:  # else the mistake in the key is already recorded
                members[key] = Member(key_place, entry)
        return self.unwrapped(MappingEntry(place=place, members=members), path)

    def alias(self, name: str, place: Place, path: Path) -> Entry:
        """An anchored entry again."""
        entry = self.anchors.get(name)
        if entry is not None:
            self.count_values(place, count_values(entry))
            self.check_depth(place, len(path) + max(len(below) for below, _ in walk(entry, ())))
            return entry
        if name in self.anchors:
            self.note(place, f"'*{name}' is inside '&{name}' and would refer to itself without end", path)
        else:
            self.note(place, f"there is no anchor '&{name}'{nearest_name(name, self.anchors)}", path)
        return ScalarEntry(place=place, value=None, text="")

    def key(self, entry: Entry, path: Path) -> tuple[str, Place]:
        """Read an entry as a key; one that is not text is a mistake, and its text as written stands for it."""
        if isinstance(entry, ScalarEntry) and isinstance(entry.value, str) and entry.value:
            return entry.value, entry.place
        text = entry.text if isinstance(entry, ScalarEntry) else ""
        what = f"a key is text; write '{text}' in quotes" if text else "a name is expected as the key"
        self.note(entry.place, what, path)
        return text, entry.place

    def count_values(self, place: Place, count: int) -> None:
        """Refuse more values, after expansion, than any study needs."""
        self.count += count
        if self.count > MOST_VALUES:
            self.fail(place, f"the file contains more than {MOST_VALUES} values, repetitions by '*' included")

    def check_depth(self, place: Place, depth: int) -> None:
        """Refuse deeper nesting than any study needs."""
        if depth >= DEEPEST:
            self.fail(place, _TOO_DEEP)

    def unwrapped(self, entry: MappingEntry, here: Path) -> Entry:
        """The value of ``{value: …, basis: …, note: …, source: …}`` with its annotation; other mappings as they are."""
        others = [key for key in entry.members if key != "value"]
        if "value" not in entry.members or not others or any(nearest(key, _BESIDE) is None for key in others):
            return entry
        value = entry.members["value"].entry
        for key in others:
            if key not in _BESIDE:
                what = f"unknown key beside a value{nearest_name(key, _BESIDE)}"
                self.note(entry.members[key].key_place, what, (*here, key))
        if isinstance(value, MappingEntry) or value.annotation is not None:
            self.note(value.place, "a basis belongs to a single value or to a list", (*here, "value"))
            return entry
        basis, note = child(entry, "basis"), child(entry, "note")
        stated = basis.value if isinstance(basis, ScalarEntry) else None
        if basis is not None and stated not in BASES:
            text = basis.text if isinstance(basis, ScalarEntry) else ""
            close = nearest(text, BASES)
            shown = f"'{text}'" if isinstance(basis, ScalarEntry) else "this"
            what = f"{shown} is not a basis; one of {', '.join(BASES)} is expected"
            self.note(basis.place, what + (f"; nearest: {close!r}" if close else ""), (*here, "basis"))
            stated = None
        remark = note.value if isinstance(note, ScalarEntry) else None
        if note is not None and not isinstance(remark, str):
            self.note(note.place, "a note is text; write it in quotes", (*here, "note"))
        said = Annotation(
            basis=cast(Basis | None, stated),
            note=remark if isinstance(remark, str) else "",
            source=None if (source := child(entry, "source")) is None else self.source(source, (*here, "source")),
        )
        return replace(value, annotation=said)

    def source(self, entry: Entry, here: Path) -> Source | None:
        """Where a value was read; None after noting that this is incomplete."""
        members = entry.members if isinstance(entry, MappingEntry) else {}
        said = {key: member.entry.text for key, member in members.items() if isinstance(member.entry, ScalarEntry)}
        missing = [key for key in OF_SOURCE if key != "revision" and not said.get(key)]
        unknown = [key for key in members if key not in OF_SOURCE]
        if missing or unknown or len(said) < len(members):
            wrong = f"unknown key {unknown[0]!r}; " if unknown else f"no {missing[0]}; " if missing else ""
            self.note(
                entry.place, f"{wrong}a source has the texts {', '.join(OF_SOURCE)} (revision may be left out)", here
            )
            return None
        if not _DAY.fullmatch(said["read_on"]):
            self.note(members["read_on"].entry.place, "a day such as 2026-11-29 is expected", (*here, "read_on"))
            return None
        return Source(**said)


def scalar_of(text: str) -> Scalar:
    """Read a plain scalar by the core schema."""
    if _NULL.fullmatch(text):
        return None
    if _BOOLEAN.fullmatch(text):
        return text[0] in "tT"
    if _INTEGER.fullmatch(text):
        return int(text, 0) if text[:2] in ("0o", "0x") else int(text)
    if _FLOAT.fullmatch(text):
        return float(
            text.replace(".inf", "inf").replace(".Inf", "inf").replace(".INF", "inf").lower().replace(".nan", "nan")
        )
    return text


def _syntax(error: MarkedYAMLError) -> str:
    """Describe a syntax error, with a remedy for common mistakes."""
    problem = str(error.problem or error.context or "this is not valid YAML")
    if "\\t" in problem:
        return "YAML does not allow a tab here; indent with spaces"
    hint = "; text that contains ': ' needs quotes" if "mapping values" in problem else ""
    context = f" {error.context}" if error.context and error.problem else ""
    return f"this is not valid YAML: {problem}{context}{hint}"
