"""Read YAML 1.2 into entries that know their places; report all duplicate keys and refuse hostile input early."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, cast

from ruamel.yaml import YAML
from ruamel.yaml import events as yaml_events
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.reader import ReaderError

from tradestudy.declarations.part import nearest_name
from tradestudy.errors import Problem, nearest
from tradestudy.study.document import (
    BASES,
    Annotation,
    Entry,
    ListEntry,
    MappingEntry,
    Member,
    Path,
    Place,
    Scalar,
    ScalarEntry,
    Value,
    scalar_text,
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
_NO_TAGS = "tags ('!…') have no meaning in a study; remove the tag"
# The scalars of the core schema of YAML 1.2; everything else is text.
_NULL = re.compile(r"|~|null|Null|NULL")
_BOOLEAN = re.compile(r"true|True|TRUE|false|False|FALSE")
_INTEGER = re.compile(r"[-+]?[0-9]{1,30}|0o[0-7]{1,30}|0x[0-9a-fA-F]{1,30}")
_FLOAT = re.compile(
    r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)"
)


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
        for event in YAML(typ="safe", pure=True).parse(text):
            composer.take(event)
    except UnreadableError:
        raise
    except MarkedYAMLError as error:
        composer.fail(_marked(error, start), _syntax(error))
    except ReaderError as error:
        place = composer.place_in(text, error.position)
        composer.fail(
            place, f"the character U+{ord(text[error.position]):04X} is not allowed in YAML; the file may not be text"
        )
    except (YAMLError, ValueError, OverflowError, TypeError, AttributeError, IndexError) as error:
        # The parser raises these instead of its own errors on some malformed escapes and directives.
        composer.fail(composer.last, f"this is not valid YAML ({error})")
    if composer.root is None:
        composer.fail(start, "it is empty; `tradestudy new NAME` writes a starter study")
    return composer.root, (*composer.problems,)


def entry_of_value(value: Value, place: Place) -> tuple[Entry, list[Problem]]:
    """Turn a Python value into entries by the rules of `compose`; its text is literal, not YAML.

    Raises
    ------
    UnreadableError
        If it contains too many or too deeply nested values.
    """
    composer = _Composer(start=place, last=place)
    composer.take_value(value)
    return composer.root, composer.problems


@dataclass(kw_only=True)
class _Frame:
    """A mapping or a list that is still open."""

    place: Place
    anchor: str | None
    count_before: int
    members: dict[str, Member] | None  # None for a list
    items: list[Entry] = field(default_factory=list)
    key: tuple[str, Place] | None = None
    height: int = 0

    def step(self) -> str | int:
        """Index or key now being read."""
        if self.members is None:
            return len(self.items)
        return self.key[0] if self.key else ""


@dataclass(kw_only=True)
class _Composer:
    """Builds entries from events without recursion; an alias shares the entry of its anchor but counts at each use."""

    start: Place
    last: Place
    may_have_tags: bool = False
    root: Any = None
    problems: list[Problem] = field(default_factory=list)
    frames: list[_Frame] = field(default_factory=list)
    anchors: dict[str, tuple[Entry, int, int] | None] = field(default_factory=dict)  # entry, values, height; None: open
    count: int = 0
    documents: int = 0

    def place_at(self, line: int, column: int) -> Place:
        """Place in the file of a line and column of the text, counted from 0."""
        return Place(self.start.file, self.start.line + line, column + (self.start.column if line == 0 else 1))

    def place_in(self, text: str, position: int) -> Place:
        """Place in the file of a character of the text."""
        before = text[:position]
        return self.place_at(before.count("\n"), len(before) - before.rfind("\n") - 1)

    def path(self) -> Path:
        """Path of the value now being read."""
        return tuple(step for frame in self.frames if (step := frame.step()) != "")

    def note(self, place: Place, what: str, path: Path | None = None) -> None:
        """Record a mistake."""
        self.problems.append(place.problem(self.path() if path is None else path, what))
        if len(self.problems) >= MOST_MISTAKES:
            self.fail(place, "reading stopped here, after too many mistakes")

    def fail(self, place: Place, what: str) -> None:
        """Record a mistake and stop reading."""
        self.problems.append(place.problem((), what))
        raise UnreadableError(self.problems)

    def take(self, event: Any) -> None:
        """Process one event of the parser."""
        self.last = place = self.place_at(event.start_mark.line, event.start_mark.column)
        if isinstance(event, yaml_events.DocumentStartEvent):
            self.documents += 1
            if self.documents > 1:
                self.fail(place, "a second document begins here; a study is one document")
        elif isinstance(event, yaml_events.MappingStartEvent | yaml_events.SequenceStartEvent):
            is_mapping = isinstance(event, yaml_events.MappingStartEvent)
            self.open(place, is_mapping=is_mapping, anchor=event.anchor, tag=event.tag)
        elif isinstance(event, yaml_events.MappingEndEvent | yaml_events.SequenceEndEvent):
            self.close()
        elif isinstance(event, yaml_events.ScalarEvent):
            is_plain = event.implicit[0] and not event.style
            self.scalar(event.value, place, is_plain=is_plain, anchor=event.anchor, tag=event.tag)
        elif isinstance(event, yaml_events.AliasEvent):
            self.alias(event.anchor, place)

    def take_value(self, value: Value) -> None:
        """Process a Python value; all of it has the place where reading began."""
        if isinstance(value, Mapping):
            self.open(self.start, is_mapping=True)
            for key, item in value.items():
                self.take_value(key)
                self.take_value(item)
            self.close()
        elif isinstance(value, list | tuple):
            self.open(self.start, is_mapping=False)
            for item in value:
                self.take_value(item)
            self.close()
        elif isinstance(value, str):
            self.scalar(value, self.start, is_plain=False)
        else:  # including numbers of other libraries, as they print themselves
            self.scalar(scalar_text(cast(Scalar, value)), self.start, is_plain=True)

    def scalar(self, written: str, place: Place, *, is_plain: bool, anchor: str | None = None, tag: Any = None) -> None:
        """Add a single value; unless it is plain, quotes make it text."""
        self.count_values(place, 1)
        self.tags(tag, place)
        text = self.text(written, place)
        self.add(ScalarEntry(place=place, value=_resolved(text) if is_plain else text, text=text), anchor, 1, 0)

    def open(self, place: Place, *, is_mapping: bool, anchor: str | None = None, tag: Any = None) -> None:
        """Begin a mapping or a list."""
        self.count_values(place, 1)
        self.check_depth(place, 0)
        self.tags(tag, place)
        if anchor:
            self.anchors[anchor] = None
        members: dict[str, Member] | None = {} if is_mapping else None
        self.frames.append(_Frame(place=place, anchor=anchor, count_before=self.count - 1, members=members))

    def close(self) -> None:
        """End the innermost mapping or list."""
        frame = self.frames[-1]
        if frame.members is None:
            entry: Entry = ListEntry(place=frame.place, items=tuple(frame.items))
        else:
            entry = self.unwrapped(MappingEntry(place=frame.place, members=frame.members))
        self.frames.pop()
        self.add(entry, frame.anchor, self.count - frame.count_before, frame.height)

    def alias(self, name: str, place: Place) -> None:
        """Insert an anchored entry again."""
        entry: Entry = ScalarEntry(place=place, value=None, text="")
        if name not in self.anchors:
            self.note(place, f"there is no anchor '&{name}'{nearest_name(name, self.anchors)}")
        elif (anchored := self.anchors[name]) is None:
            self.note(place, f"'*{name}' is inside '&{name}' and would refer to itself without end")
        else:
            entry, count, height = anchored
            self.count_values(place, count)
            self.check_depth(place, height)
            self.add(entry, None, count, height)
            return
        self.add(entry, None, 1, 0)

    def add(self, entry: Entry, anchor: str | None, count: int, height: int) -> None:
        """Add a finished entry to the innermost open mapping or list."""
        if anchor:
            self.anchors[anchor] = (entry, count, height)
        if not self.frames:
            self.root = entry
            return
        frame = self.frames[-1]
        frame.height = max(frame.height, height + 1)
        if frame.members is None:
            frame.items.append(entry)
        elif frame.key is None:
            frame.key = self.key(entry)
        else:
            (name, key_place), members = frame.key, frame.members
            if name == "<<":
                self.note(key_place, "YAML 1.2 has no merge key; cameras share values by from: and like:")
            elif not name:
                pass  # the mistake in the key is already recorded
            elif name in members:
                first = members[name].key_place.line
                self.note(key_place, f"duplicate key, first on line {first}; remove one of them")
            else:
                members[name] = Member(key_place, entry)
            frame.key = None

    def key(self, entry: Entry) -> tuple[str, Place]:
        """Read an entry as a key; one that is not text is a mistake, and its text as written stands for it."""
        if isinstance(entry, ScalarEntry) and isinstance(entry.value, str) and entry.value:
            return entry.value, entry.place
        text = entry.text if isinstance(entry, ScalarEntry) else ""
        self.note(entry.place, f"a key is text; write '{text}' in quotes" if text else "a name is expected as the key")
        return text, entry.place

    def text(self, written: str, place: Place) -> str:
        """Refuse escapes of lone surrogates and of the null character."""
        if "\0" in written:
            self.note(place, "an escape gives the null character, which no text may contain")
            written = written.replace("\0", "\ufffd")
        if any("\ud800" <= letter <= "\udfff" for letter in written):
            self.note(place, "an escape gives half a character (a lone surrogate)")
            return "".join("\ufffd" if "\ud800" <= letter <= "\udfff" else letter for letter in written)
        return written

    def tags(self, tag: Any, place: Place) -> None:
        """Refuse tags, since the schema defines the type of each value."""
        if tag is not None and not self.may_have_tags:
            self.note(place, _NO_TAGS)

    def count_values(self, place: Place, count: int) -> None:
        """Refuse more values, after expansion, than any study needs."""
        self.count += count
        if self.count > MOST_VALUES:
            self.fail(place, f"the file contains more than {MOST_VALUES} values, repetitions by '*' included")

    def check_depth(self, place: Place, height: int) -> None:
        """Refuse deeper nesting than any study needs."""
        if len(self.frames) + height >= DEEPEST:
            self.fail(place, _TOO_DEEP)

    def unwrapped(self, entry: MappingEntry) -> Entry:
        """The value of ``{value: …, basis: …, note: …}`` with its annotation; any other mapping as it is."""
        others = [key for key in entry.members if key != "value"]
        if "value" not in entry.members or not others or any(nearest(key, ("basis", "note")) is None for key in others):
            return entry
        value = entry.members["value"].entry
        here = self.path()
        for key in others:
            if key not in ("basis", "note"):
                what = f"unknown key beside a value{nearest_name(key, ('basis', 'note'))}"
                self.note(entry.members[key].key_place, what, (*here, key))
        if isinstance(value, MappingEntry) or value.annotation is not None:
            self.note(value.place, "a basis belongs to a single value or to a list", (*here, "value"))
            return entry
        return _annotated(value, Annotation(basis=self.basis(entry, here), note=self.remark(entry, here)))

    def basis(self, entry: MappingEntry, here: Path) -> Any:
        """Read the basis of a value; None if it is not one."""
        if "basis" not in entry.members:
            return None
        stated = entry.members["basis"].entry
        if isinstance(stated, ScalarEntry) and stated.value in BASES:
            return stated.value
        shown = f"'{stated.text}'" if isinstance(stated, ScalarEntry) else "this"
        close = nearest_name(stated.text, BASES) if isinstance(stated, ScalarEntry) else ""
        what = f"{shown} is not a basis; one of {', '.join(BASES)} is expected{close if 'nearest' in close else ''}"
        self.note(stated.place, what, (*here, "basis"))
        return None

    def remark(self, entry: MappingEntry, here: Path) -> str:
        """Read the note of a value."""
        if "note" not in entry.members:
            return ""
        stated = entry.members["note"].entry
        if isinstance(stated, ScalarEntry) and isinstance(stated.value, str):
            return stated.value
        self.note(stated.place, "a note is text; write it in quotes", (*here, "note"))
        return ""


def _annotated(value: ScalarEntry | ListEntry, annotation: Annotation) -> Entry:
    if isinstance(value, ListEntry):
        return ListEntry(place=value.place, items=value.items, annotation=annotation)
    return ScalarEntry(place=value.place, value=value.value, text=value.text, annotation=annotation)


def _resolved(text: str) -> Scalar:
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


def _marked(error: MarkedYAMLError, start: Place) -> Place:
    """Place of a syntax error."""
    mark = error.problem_mark or error.context_mark
    if mark is None:
        return start
    return Place(start.file, start.line + mark.line, mark.column + (start.column if mark.line == 0 else 1))


def _syntax(error: MarkedYAMLError) -> str:
    """Describe a syntax error, with a remedy for common mistakes."""
    problem = str(error.problem or error.context or "this is not valid YAML")
    if "\\t" in problem:
        return "YAML does not allow a tab here; indent with spaces"
    hint = "; text that contains ': ' needs quotes" if "mapping values" in problem else ""
    context = f" {error.context}" if error.context and error.problem else ""
    return f"this is not valid YAML: {problem}{context}{hint}"
