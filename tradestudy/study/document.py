"""A study file in memory: a plain tree, and the file, line and column of every value."""

from __future__ import annotations

import operator
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path as FilePath
from typing import Any, Final, Literal, NamedTuple, cast, get_args

from tradestudy.errors import Problem, escaped
from tradestudy.units import significant

Path = tuple[str | int, ...]
Scalar = str | int | float | bool | None
Value = str | float | bool | None | Sequence["Value"] | Mapping[str, "Value"]
Basis = Literal["paper", "datasheet", "measured", "assumed", "derived"]
BASES: tuple[str, ...] = get_args(Basis)


class Place(NamedTuple):
    """Where something is written; line and column count from 1."""

    file: str
    line: int
    column: int

    def problem(self, path: Path, what: str) -> Problem:
        """A mistake at this place."""
        return Problem(file=self.file, line=self.line, column=self.column, path=dotted(path), what=what)


OF_SOURCE: tuple[str, ...] = ("title", "revision", "url", "read_on", "quote")  # revision may be left out

# Place of a value that is in no file.
OUTSIDE = Place("--set", 1, 1)
# Place of a study that Python gives as a dictionary.
DICTIONARY = Place("--dictionary", 1, 1)
OF_PYTHON = (OUTSIDE.file, DICTIONARY.file)

_FOUND = re.compile(r"\d+\.\d{10,}")  # a number from a fit; nobody writes so many decimals


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where a value was read: title and revision of a document, its address, the day, and the words that say it."""

    title: str
    url: str
    read_on: str
    quote: str
    revision: str = ""

    def __str__(self) -> str:
        title = ", ".join(filter(None, (self.title, self.revision)))
        return f"{title}: “{self.quote}” ({self.url}, read {self.read_on})"


@dataclass(frozen=True, kw_only=True)
class Annotation:
    """Basis of a value, a remark, and where the value was read."""

    basis: Basis | None = None
    note: str = ""
    source: Source | None = None

    @property
    def remark(self) -> str:
        """Note and source in words."""
        return "; ".join(filter(None, (self.note, str(self.source or ""))))

    def given(self) -> dict[str, str | dict[str, str]]:
        """What stands beside the value in a file, without what is empty."""
        source = {} if self.source is None else {key: text for key, text in asdict(self.source).items() if text}
        said = {"basis": self.basis, "note": self.note, "source": source}
        return {key: value for key, value in said.items() if value}


@dataclass(frozen=True, kw_only=True)
class ScalarEntry:
    """A single value, and its text as written."""

    place: Place
    value: Scalar
    text: str
    annotation: Annotation | None = None

    @classmethod
    def of(cls, value: Scalar) -> ScalarEntry:
        """An entry for a value that is in no file."""
        return cls(place=OUTSIDE, value=value, text=scalar_text(value))


@dataclass(frozen=True, kw_only=True)
class AskedEntry(ScalarEntry):
    """A value that a study has to give because the calibration file of its camera does not.

    Parameters
    ----------
    instead
        Keys beside it, any of which may be given instead.
    """

    value: Scalar = None
    text: str = ""
    instead: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ListEntry:
    """A list."""

    place: Place
    items: tuple[Entry, ...]
    annotation: Annotation | None = None


@dataclass(frozen=True, kw_only=True)
class Override:
    """A value set on the command line or from Python, and the value that it replaces.

    Parameters
    ----------
    path
        Path of the value.
    text
        The new value as given; empty if it removes the study's value.
    before
        The study's own value; empty if it has none.
    kept_by
        Cameras that inherit the replaced value by ``like``, and keep it.
    """

    path: Path
    text: str
    before: str
    kept_by: tuple[str, ...] = ()


class Member(NamedTuple):
    """A key's place, and its value."""

    key_place: Place
    entry: Entry


@dataclass(frozen=True, kw_only=True)
class MappingEntry:
    """A mapping; ``implied`` if only the path of a ``--set`` created it."""

    place: Place
    members: Mapping[str, Member]
    implied: bool = False
    annotation: None = None


Entry = ScalarEntry | ListEntry | MappingEntry


TOPICS: Final = ("format", "cameras", "lens model", "lengths", "not used")
"""What the lines of a `Reading` say."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What was read from the calibration files of one camera; as text, in one line.

    Parameters
    ----------
    camera
        Name of the camera in the study.
    said
        Topics, of `TOPICS`, and what was read.
    """

    camera: str
    said: tuple[tuple[str, str], ...]

    def __str__(self) -> str:
        return f"{self.camera}: {'; '.join(words for _, words in self.said)}"

    @property
    def lines(self) -> tuple[str, ...]:
        """One line for each topic."""
        by_topic = {topic: "; ".join(words for about, words in self.said if about == topic) for topic in TOPICS}
        further = (f"  {by_topic[topic] or f'{topic}: none'}" for topic in TOPICS[1:])
        return (f"{self.camera}: {by_topic[TOPICS[0]]}", *further)


@dataclass(frozen=True, kw_only=True)
class Document:
    """A study with everything it refers to, and the mistakes found while reading it.

    Parameters
    ----------
    root
        The study as written, with cameras taken from their files.
    problems
        Mistakes found while reading; a document with mistakes is never valid, and `validate` reports them with its own.
    broken
        Paths whose content could not be assembled; the schema's mistakes there are not reported.
    overrides
        Values set from outside, in the order in which they were given.
    imported
        What was read from calibration files, for each camera.
    like
        For each camera that is like another, the name of the other.
    """

    root: MappingEntry
    problems: tuple[Problem, ...] = ()
    broken: frozenset[Path] = field(default_factory=frozenset)
    overrides: tuple[Override, ...] = ()
    imported: tuple[Reading, ...] = ()
    like: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def tree(self) -> dict[str, Any]:
        """The study as plain dictionaries, lists and scalars, without the bases of its values."""
        return cast(dict[str, Any], plain(self.root))

    @cached_property
    def annotations(self) -> Mapping[Path, Annotation]:
        """Basis and note of every value that has them, in the order of the study."""
        return {path: entry.annotation for path, entry in walk(self.root, ()) if entry.annotation is not None}

    def locate(self, path: str | Path) -> Place:
        """Find where a value is written (file, line, column); for a mapping or a list, the place of its key.

        For a path that does not exist, find the place of the nearest part above it.
        """
        place, entry = self.root.place, cast(Entry, self.root)
        for key in self.path_of(path):
            if isinstance(entry, MappingEntry) and str(key) in entry.members:
                key_place, entry = entry.members[str(key)]
                place = entry.place if isinstance(entry, ScalarEntry) else key_place
            elif isinstance(entry, ListEntry) and isinstance(key, int) and key < len(entry.items):
                entry = entry.items[key]
                place = entry.place
            else:
                break
        return place

    def problem(self, path: Path, what: str) -> Problem:
        """A mistake in the value at a path."""
        return self.locate(path).problem(path, what)

    def folder_of(self, path: Path) -> FilePath:
        """Folder of the files named in a part of the study: that of the file that contains the part."""
        file = FilePath(self.locate(path).file)
        # A value from the command line or from Python is in no file.
        return (file if file.is_file() else FilePath(self.root.place.file)).parent

    def locate_key(self, path: str | Path) -> Place:
        """Find where the key of a value is written; for an item of a list, the place of the item."""
        *parents, last = self.path_of(path)
        above = self.entry(tuple(parents))
        if isinstance(above, MappingEntry) and last in above.members:
            return above.members[cast(str, last)].key_place
        return self.locate(path)

    def text_of(self, path: str | Path) -> str:
        """A value for people to read: as it was written, without its basis, lists as ``[a, b]``.

        Numbers from a fit, which have all digits of a float, are rounded.

        Raises
        ------
        KeyError
            If there is nothing at that path.
        """
        entry = self.entry(path)
        if entry is None:
            raise KeyError(dotted(self.path_of(path)))
        return _FOUND.sub(lambda number: significant(float(number[0])), text_of(entry))

    def entry(self, path: str | Path) -> Entry | None:
        """The entry at a path, or None."""
        entry: Entry | None = self.root
        for key in self.path_of(path):
            entry = child(entry, key)
        return entry

    def path_of(self, path: str | Path) -> Path:
        """Split a dotted path; ``cameras.`` may be omitted before a camera, and names with dots are recognised."""
        if not isinstance(path, str):
            return path
        steps = path.split(".")
        cameras = child(self.root, "cameras")
        if _first_key(self.root, steps) is None and isinstance(cameras, MappingEntry) and _first_key(cameras, steps):
            steps = ["cameras", *steps]
        return _split(self.root, steps)

    def with_root(self, root: MappingEntry, changed: Path) -> Document:
        """The document with another tree, in which one value was set from outside; it records the value before.

        The basis of the study's own value is recorded with that value, since it does not apply to the new one.
        """
        earlier = next((override for override in self.overrides if override.path == changed), None)
        after = replace(self, root=root)
        override = Override(
            path=changed,
            text=_with_basis(after.entry(changed)),
            before=_with_basis(self.entry(changed)) if earlier is None else earlier.before,
            kept_by=self._inheriting(changed, after) if earlier is None else earlier.kept_by,
        )
        remaining = tuple(override for override in self.overrides if override.path != changed)
        return replace(after, overrides=(*remaining, override))

    def with_texts(self, texts: Mapping[Path, str]) -> Document:
        """The document with other texts of existing single values, which keep their places, bases and overrides."""
        after = replace(self, root=cast(MappingEntry, _with_texts(self.root, (), texts)))
        overrides = (
            replace(override, text=_with_basis(after.entry(override.path)))
            if any(path[: len(override.path)] == override.path for path in texts)
            else override
            for override in self.overrides
        )
        return replace(after, overrides=tuple(overrides))

    def _inheriting(self, changed: Path, after: Document) -> tuple[str, ...]:
        """Cameras that have what ``after`` changes by being like the camera at the changed path, not by themselves."""
        if len(changed) < 3 or changed[0] != "cameras":
            return ()
        # Merging shares entries, so that a camera that inherits a value has the same object.
        new = after.entry(changed)
        ends = [
            path
            for path, entry in ([] if new is None else walk(new, changed))
            if self.entry(path) is not entry and not isinstance(self.entry(path), MappingEntry)
        ]
        return tuple(
            camera
            for camera in self.like
            if str(changed[1]) in self._models_of(camera)
            and any(self.entry(path) is self.entry(("cameras", camera, *path[2:])) for path in ends or [changed])
        )

    def _models_of(self, camera: str) -> Iterator[str]:
        """The cameras that a camera is like, nearest first."""
        while camera in self.like:
            camera = self.like[camera]
            yield camera

    def with_problems(self, *problems: Problem) -> Document:
        """The document with further mistakes."""
        return replace(self, problems=(*self.problems, *problems))


def overlap(path: Path, others: Iterable[Path]) -> str:
    """Why a value at a path cannot be set beside those at others: one would replace another; empty if none would."""
    for other in others:
        if path == other:
            return "is set twice; omit one of the values"
        if path[: len(other)] == other or other[: len(path)] == path:
            return f"overlaps {dotted(other)}, which is set too; omit one of the values"
    return ""


def dotted(path: Path) -> str:
    """A path as written in ``--set``; control characters are escaped so that they never reach a terminal."""
    return escaped(".".join(str(step) for step in path))


def scalar_text(value: Scalar) -> str:
    """A scalar as written in a file."""
    if value is None:
        return "null"
    return str(value).lower() if isinstance(value, bool) else str(value)


def text_of(entry: Entry) -> str:
    """An entry as it was written, without its basis; lists as ``[a, b]``, mappings as ``{a: b}``."""
    if isinstance(entry, ScalarEntry):
        return entry.text
    if isinstance(entry, ListEntry):
        return f"[{', '.join(text_of(item) for item in entry.items)}]"
    return "{" + ", ".join(f"{key}: {text_of(member.entry)}" for key, member in entry.members.items()) + "}"


def plain(entry: Entry) -> Any:
    """An entry as plain dictionaries, lists and scalars."""
    if isinstance(entry, MappingEntry):
        return {key: plain(member.entry) for key, member in entry.members.items()}
    if isinstance(entry, ListEntry):
        return [plain(item) for item in entry.items]
    return entry.value


def child(entry: Entry | None, key: str | int) -> Entry | None:
    """The entry under a key or at an index, or None."""
    if isinstance(entry, MappingEntry) and key in entry.members:
        return entry.members[cast(str, key)].entry
    if isinstance(entry, ListEntry) and isinstance(key, int) and 0 <= key < len(entry.items):
        return entry.items[key]
    return None


def merged(below: Entry, above: Entry) -> Entry:
    """Merge an entry into the one below it, mappings key by key; others are replaced, and a null removes a key."""
    if not (isinstance(below, MappingEntry) and isinstance(above, MappingEntry)):
        return above
    members = dict(below.members)
    for key, member in above.members.items():
        if is_null(member.entry):
            members.pop(key, None)
        elif key in members:
            members[key] = Member(member.key_place, merged(members[key].entry, member.entry))
        else:
            members[key] = member
    return MappingEntry(place=above.place, members=unanswered(members))


def unanswered(members: Mapping[str, Member]) -> dict[str, Member]:
    """Members of a mapping without those that it asks for although another is given instead."""
    given_keys = {key for key, member in members.items() if not isinstance(member.entry, AskedEntry)}
    return {
        key: member
        for key, member in members.items()
        if not isinstance(member.entry, AskedEntry) or given_keys.isdisjoint(member.entry.instead)
    }


def removals_of_nothing(below: Entry, above: Entry, path: Path) -> Iterator[tuple[Path, Place, Mapping[str, Member]]]:
    """Removals of keys that the entry below does not have: path, place, and the members that it has."""
    if not (isinstance(below, MappingEntry) and isinstance(above, MappingEntry)):
        return
    for key, member in above.members.items():
        if key in below.members:
            yield from removals_of_nothing(below.members[key].entry, member.entry, (*path, key))
        elif is_null(member.entry):
            yield (*path, key), member.key_place, below.members


def count_values(entry: Entry) -> int:
    """Count the mappings, lists and scalars of an entry, including itself."""
    return sum(1 for _ in walk(entry, ()))


def is_null(entry: Entry) -> bool:
    """Whether an entry is an explicit null and not an omitted value."""
    return isinstance(entry, ScalarEntry) and entry.value is None and bool(entry.text)


def walk(entry: Entry, path: Path) -> Iterator[tuple[Path, Entry]]:
    """An entry and all entries below it, with their paths."""
    yield path, entry
    if isinstance(entry, MappingEntry):
        for key, member in entry.members.items():
            yield from walk(member.entry, (*path, key))
    elif isinstance(entry, ListEntry):
        for index, item in enumerate(entry.items):
            yield from walk(item, (*path, index))


def _with_basis(entry: Entry | None) -> str:
    """A value and its basis, such as "9.8 (datasheet: section 2)"."""
    if entry is None:
        return ""
    annotation = entry.annotation or Annotation()
    basis = ": ".join(part for part in (annotation.basis, annotation.remark) if part)
    return text_of(entry) + (f" ({basis})" if basis else "")


def _with_texts(entry: Entry, here: Path, texts: Mapping[Path, str]) -> Entry:
    """An entry with other texts of single values by their paths; the same object where nothing changes."""
    if isinstance(entry, ScalarEntry):
        return replace(entry, value=texts[here], text=texts[here]) if here in texts else entry
    if isinstance(entry, ListEntry):
        items = tuple(_with_texts(item, (*here, index), texts) for index, item in enumerate(entry.items))
        return entry if all(map(operator.is_, items, entry.items)) else replace(entry, items=items)
    members = {
        key: member
        if (changed := _with_texts(member.entry, (*here, key), texts)) is member.entry
        else member._replace(entry=changed)
        for key, member in entry.members.items()
    }
    same = all(map(operator.is_, members.values(), entry.members.values()))
    return entry if same else replace(entry, members=members)


def _first_key(entry: MappingEntry, steps: list[str]) -> int | None:
    """Number of leading steps that form the longest existing key; None if they form none."""
    return next((n for n in range(len(steps), 0, -1) if ".".join(steps[:n]) in entry.members), None)


def _split(entry: Entry | None, steps: list[str]) -> Path:
    """Follow the steps as far as they exist; beyond, each step is a key of its own."""
    if not steps:
        return ()
    count, key = 1, cast(str | int, steps[0])
    if isinstance(entry, MappingEntry):
        count = _first_key(entry, steps) or 1
        key = ".".join(steps[:count])
    elif isinstance(entry, ListEntry) and steps[0].isdecimal() and len(steps[0]) < 9:
        key = int(steps[0])
    return (key, *_split(child(entry, key), steps[count:]))
