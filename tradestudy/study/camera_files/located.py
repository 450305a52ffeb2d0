"""Values of calibration files with their places, converted to the expected type or refused there."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath

from tradestudy.errors import Problem
from tradestudy.study.document import Entry, ListEntry, MappingEntry, Path, Place, ScalarEntry, dotted, plain

_LARGEST = 1e12  # larger than any number of a camera, in any unit


class CameraFileError(Exception):
    """A calibration file is invalid; contains the mistake with its place."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.problem = problem


@dataclass(frozen=True, kw_only=True)
class CameraFile:
    """A calibration file as text and, where its syntax has one, as a tree.

    Parameters
    ----------
    path, label
        The file, and its name in the study, which distinguishes equal names in different folders.
    syntax
        Syntax of its text.
    text
        Its text.
    root
        Its content; an empty mapping for a table.
    places
        Places of the values used, by file and key.
    used
        Keys that lead to the values used.
    inexact
        Rotation matrices that the nearest rotation replaces, in words, by file and key.
    """

    path: FilePath
    label: str
    syntax: str
    text: str
    root: Entry
    places: dict[str, Place] = field(default_factory=dict)
    used: set[Path] = field(default_factory=set)
    inexact: dict[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the file, without its folder."""
        return self.path.name

    @property
    def top(self) -> Located:
        """The outermost value of the file."""
        return Located(file=self, entry=self.root, path=())

    def unused(self) -> Iterator[Located]:
        """The outermost values of which no part was used; a list of numbers counts as one value."""
        return _unused(self.top, {path[:count] for path in self.used for count in range(len(path))})


@dataclass(frozen=True, kw_only=True)
class Located:
    """A value of a calibration file.

    Parameters
    ----------
    file
        Its file.
    entry, path
        The value, and the keys that lead to it.
    """

    file: CameraFile
    entry: Entry
    path: Path

    @property
    def key(self) -> str:
        """File and key, under which the file also records the place of this value."""
        label = f"{self.file.label}: {dotted(self.path)}" if self.path else self.file.label
        self.file.places[label] = self.entry.place
        return label

    @property
    def last(self) -> str:
        """Last of the keys that lead to the value."""
        return str(self.path[-1]) if self.path else self.file.name

    def fail(self, what: str) -> CameraFileError:
        """A mistake at this value."""
        return CameraFileError(self.entry.place.problem(self.path, what))

    def has(self, *keys: str) -> bool:
        """Whether the value is a mapping with all of these keys."""
        return isinstance(self.entry, MappingEntry) and all(key in self.entry.members for key in keys)

    def find(self, *names: str) -> Located | None:
        """The value under any of these keys, which are names of one quantity; None if there is none, or an empty one.

        Raises
        ------
        CameraFileError
            Two of the keys have different values.
        """
        members = self.entry.members if isinstance(self.entry, MappingEntry) else {}
        written = {name: members[name].entry for name in names if name in members}
        given = [
            Located(file=self.file, entry=entry, path=(*self.path, name))
            for name, entry in written.items()
            if not (isinstance(entry, ScalarEntry) and entry.value is None)
        ]
        for other in given[1:]:
            if _content(other.entry) != _content(given[0].entry):
                what = f"{given[0].last} and {other.last} mean the same, but their values differ; remove the wrong one"
                raise other.fail(what)
            other.use()
        return given[0] if given else None

    def need(self, *names: str) -> Located:
        """The value under any of these keys, which are names of one quantity.

        Raises
        ------
        CameraFileError
            None of them has a value, or two have different ones.
        """
        found = self.find(*names)
        if found is None:
            raise self.fail(f"the key {' or '.join(names)} is missing")
        return found

    def use(self) -> None:
        """Note that the whole value has been used."""
        self.file.used.add(self.path)

    def items(self) -> Iterator[Located]:
        """The items of a list.

        Raises
        ------
        CameraFileError
            The value is not a list.
        """
        if not isinstance(self.entry, ListEntry):
            raise self.fail("a list is expected")
        for index, entry in enumerate(self.entry.items):
            yield Located(file=self.file, entry=entry, path=(*self.path, index))

    def names(self) -> tuple[str, ...]:
        """Keys of a mapping, in order."""
        return tuple(self.entry.members) if isinstance(self.entry, MappingEntry) else ()

    def text(self) -> str:
        """A single value as text."""
        if not isinstance(self.entry, ScalarEntry) or self.entry.value is None:
            raise self.fail("a text is expected")
        self.use()
        return self.entry.text.strip()

    def number(self) -> float:
        """A single finite number, written as a number or as text."""
        self.use()
        shown = self.entry.text if isinstance(self.entry, ScalarEntry) else "a list or a mapping"
        value = self.entry.value if isinstance(self.entry, ScalarEntry) else None
        if isinstance(value, str):
            try:
                value = float(value)
            except ValueError:
                value = None
        if value is None or isinstance(value, bool):
            raise self.fail(f"'{shown[:40]}' is not a number")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not abs(number) <= _LARGEST:
            raise self.fail(f"'{shown[:40]}' is out of range; a finite number up to {_LARGEST:g} is expected")
        return number

    def count(self) -> int:
        """A whole number of pixels, from 1 to a million."""
        number = self.number()
        if number != round(number) or not 1 <= number <= 1_000_000:
            raise self.fail(f"{number:g} is not a number of pixels; a whole number from 1 to 1000000 is expected")
        return int(number)

    def numbers(self, *counts: int) -> tuple[float, ...]:
        """The numbers of a list or of its rows; if counts are given, the list must have one of these lengths."""
        found = [*self._numbers()]
        self.use()
        if counts and len(found) not in counts:
            raise self.fail(f"{len(found)} numbers are given; {' or '.join(map(str, counts))} are expected")
        return tuple(found)

    def _numbers(self) -> Iterator[float]:
        for item in self.items():
            if isinstance(item.entry, ListEntry):
                yield from item._numbers()
            else:
                yield item.number()


def _unused(value: Located, partly: set[Path]) -> Iterator[Located]:
    """See `CameraFile.unused`; ``partly`` holds the keys of values of which a part was used."""
    if value.path in value.file.used:
        return
    below: list[Located] = []
    if isinstance(value.entry, MappingEntry):
        below = [replace(value, entry=one.entry, path=(*value.path, key)) for key, one in value.entry.members.items()]
    elif isinstance(value.entry, ListEntry):
        below = [*value.items()]
    elif value.entry.value is None:  # an empty value states nothing
        return
    if value.path not in partly:
        if below or isinstance(value.entry, ScalarEntry):
            yield value
    elif isinstance(value.entry, MappingEntry) or _has_mapping(value.entry):
        for one in below:
            yield from _unused(one, partly)


def _content(entry: Entry) -> object:
    """A value for comparison: of a matrix that states its numbers of rows and columns, the elements."""
    content = plain(entry)
    return content.get("data", content) if isinstance(content, dict) else content


def _has_mapping(entry: Entry) -> bool:
    return isinstance(entry, MappingEntry) or (isinstance(entry, ListEntry) and any(map(_has_mapping, entry.items)))
