"""From a study file to a document: cameras from their own files, one camera like another, values set from outside."""

from __future__ import annotations

import stat
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

from tradestudy.declarations.mistakes import nearest_name
from tradestudy.errors import Problem, StudyError
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
    count_values,
    dotted,
    is_null,
    merged,
)
from tradestudy.study.schema.validation import validate
from tradestudy.study.source import MOST_VALUES, UnreadableError, compose, entry_of_value
from tradestudy.units import nearest

__all__ = ["Document", "read", "validate", "with_values"]

MOST_BYTES = 1_000_000
LONGEST_CHAIN = 50
_SHARING = ("from", "like")


def read(path: Path, overrides: Sequence[str] = ()) -> Document:
    """Read a study file and everything that it refers to.

    Parameters
    ----------
    path
        A YAML 1.2 file.
    overrides
        ``path=value`` texts; the path is dotted, a camera may stand without ``cameras.``, and the value is YAML. They
        are laid over the study after `from` and `like`, so that only the named camera changes.

    Returns
    -------
    Document
        Mistakes that leave a tree standing are kept in it, for `validate` to report together with its own.

    Raises
    ------
    StudyError
        When there is no tree: no such file, larger than 1 MB, binary, empty, or broken YAML.
    """
    place = Place(str(path), 1, 1)
    try:
        entry, problems = _load(path)
    except UnreadableError as error:
        raise StudyError(error.problems) from None
    if not isinstance(entry, MappingEntry):
        problems.append(entry.place.problem((), f"a study is a mapping of keys to values, not {_kind(entry)}"))
        raise StudyError(problems)
    cameras = _Cameras(folder=path.parent, root=replace(entry, place=place))
    root = cameras.resolved()
    document = Document(root=root, problems=(*problems, *cameras.problems), broken=frozenset(cameras.broken))
    for number, override in enumerate(overrides, start=1):
        document = _overridden(document, override, number)
    return document


def with_values(
    document: Document, values: Mapping[str, Value | Entry], *, written_at: Mapping[str, str | tree.Path] | None = None
) -> Document:
    """Lay other values over a document, as a sweep or another reading of the same study does.

    Parameters
    ----------
    document
        Stays as it is.
    values
        For each dotted path a text as a file holds it, in YAML; or what such a text would give, as entries or as Python
        has it. A null takes a value back.
    written_at
        For a path, where in the document its value comes from; mistakes are then reported there, else at ``--set``.

    Returns
    -------
    Document
        Problems that the values bring are kept in it, for `validate` to report.
    """
    for number, (path, value) in enumerate(values.items(), start=1):
        source = (written_at or {}).get(path)
        place = Place(OUTSIDE.file, number, 1) if source is None else document.locate(source)
        document = _with_value(document, path, value, place, place)
    return document


def _load(path: Path) -> tuple[Entry, list[Problem]]:
    """Read a file into entries, or refuse it in words."""
    place = Place(str(path), 1, 1)
    try:
        content = _content(path, place)
    except FileNotFoundError:
        raise _refused(place, f"there is no such file{_nearest_file(path)}") from None
    except (OSError, ValueError) as error:  # ValueError: a name that no file system allows
        raise _refused(place, f"it cannot be read ({getattr(error, 'strerror', None) or error})") from None
    if b"\0" in content:
        raise _refused(place, "it is a binary file; a study is text in YAML")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = content[: error.start]
        line, column = before.count(b"\n") + 1, len(before) - (before.rfind(b"\n") + 1) + 1
        raise _refused(
            Place(str(path), line, column), f"the byte 0x{content[error.start]:02x} is not UTF-8; save it as UTF-8"
        ) from None
    return compose(text, place)


def _content(path: Path, place: Place) -> bytes:
    """Read the bytes of a regular file of a bearable size; devices and pipes could go on for ever."""
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise _refused(place, "it is a folder; a study file is expected")
    if not stat.S_ISREG(mode):
        raise _refused(place, "it is not a regular file; a study file is expected")
    with path.open("rb") as file:
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise _refused(
            place, "it is larger than 1 MB; a study file is at most 1 MB, and data belong in files of their own"
        )
    return content


def _refused(place: Place, what: str) -> UnreadableError:
    return UnreadableError([place.problem((), what)])


def _nearest_file(path: Path) -> str:
    """Name the file of the same folder that may have been meant."""
    try:
        names = [entry.name for entry, _ in zip(path.parent.iterdir(), range(1000), strict=False)]
    except OSError:
        return ""
    close = nearest(path.name, names)
    return f"; nearest: '{path.parent / close}'" if close else ""


class _Cameras:
    """Puts cameras together from their files and from each other; a camera that has a mistake is left as written."""

    def __init__(self, *, folder: Path, root: MappingEntry) -> None:
        self.folder, self.root = folder, root
        self.problems: list[Problem] = []
        self.broken: list[tree.Path] = []
        self.done: dict[str, Entry | None] = {}
        self.files: dict[str, tuple[Entry, list[Problem]]] = {}
        self.values = 0

    def resolved(self) -> MappingEntry:
        """Give the study with every camera in full."""
        written = self.root.members.get("cameras")
        if written is None or not isinstance(written.entry, MappingEntry):
            return self.root
        self.written = written.entry
        members = {
            name: Member(member.key_place, self.camera(name, ()) or member.entry)
            for name, member in self.written.members.items()
        }
        cameras = Member(written.key_place, replace(self.written, members=members))
        return replace(self.root, members={**self.root.members, "cameras": cameras})

    def camera(self, name: str, chain: tuple[str, ...]) -> Entry | None:
        """Give one camera in full, or None after noting why there is none."""
        if name not in self.done:
            self.done[name] = self.put_together(name, chain)
            if self.done[name] is None:
                self.broken.append(("cameras", name))
        return self.done[name]

    def put_together(self, name: str, chain: tuple[str, ...]) -> Entry | None:
        """Lay what the study says of a camera over what it shares."""
        own = self.written.members[name].entry
        if not isinstance(own, MappingEntry):
            return own
        sharing = [key for key in _SHARING if key in own.members]
        if not sharing:
            return own
        if len(sharing) > 1:
            self.note(own.members["like"].key_place, name, "like", "a camera has from: or like:, not both")
            return None
        member = own.members[sharing[0]]
        if not (isinstance(member.entry, ScalarEntry) and isinstance(member.entry.value, str)):
            expected = "the name of a file" if sharing[0] == "from" else "the name of a camera"
            self.note(member.entry.place, name, sharing[0], f"{expected} is expected")
            return None
        source = self.from_file if sharing[0] == "from" else self.like_camera
        below = source(name, member.entry.value, member.entry.place, (*chain, name))
        if below is None:
            return None
        if self.values > MOST_VALUES:
            return None  # told at the camera that went beyond
        self.values += count_values(below)
        if self.values > MOST_VALUES:
            self.note(member.entry.place, name, sharing[0], f"the cameras together hold more than {MOST_VALUES} values")
            return None
        above = {key: member for key, member in own.members.items() if key not in _SHARING}
        changed = replace(own, members=above)
        self.problems += _taken_back_in_vain(below, changed, ("cameras", name))
        return merged(below, changed)

    def from_file(self, name: str, file: str, place: Place, _chain: tuple[str, ...]) -> Entry | None:
        """Read a camera's own file."""
        try:
            entry, problems = self.files[file] if file in self.files else _load(self.folder / file)
        except UnreadableError as error:
            if error.problems[0].line == error.problems[0].column == 1 and len(error.problems) == 1:
                self.note(place, name, "from", f"'{error.problems[0].file}': {error.problems[0].what}")
            else:
                self.problems += error.problems
            return None
        self.problems += [
            replace(problem, path=f"cameras.{name}.{problem.path}".removesuffix(".")) for problem in problems
        ]
        self.files[file] = (entry, [])  # for the next camera, whose mistakes in it are told already
        if not isinstance(entry, MappingEntry):
            self.problems.append(entry.place.problem(("cameras", name), f"a camera is expected, not {_kind(entry)}"))
            return None
        for key in _SHARING:
            if key in entry.members:
                what = f"a camera file stands alone; {key}: belongs in the study"
                self.note(entry.members[key].key_place, name, key, what)
                return None
        return entry

    def like_camera(self, name: str, other: str, place: Place, chain: tuple[str, ...]) -> Entry | None:
        """Find the camera that another is like."""
        if other in chain:
            circle = " → ".join((*chain[chain.index(other) :], other))
            self.note(place, name, "like", f"the cameras are like each other in a circle: {circle}")
            return None
        if len(chain) >= LONGEST_CHAIN:
            self.note(place, name, "like", f"more than {LONGEST_CHAIN} cameras are like each other in a chain")
            return None
        if other not in self.written.members:
            known = [camera for camera in self.written.members if camera != name]
            self.note(place, name, "like", f"no camera is called '{other}'{nearest_name(other, known)}")
            return None
        below = self.camera(other, chain)
        return below if isinstance(below, MappingEntry) else None

    def note(self, place: Place, name: str, key: str, what: str) -> None:
        """Remember a mistake of a camera."""
        self.problems.append(place.problem(("cameras", name, key), what))


def _overridden(document: Document, override: str, number: int) -> Document:
    """Apply one ``path=value`` of the command line."""
    path, sign, text = override.partition("=")
    place = Place(OUTSIDE.file, number, 1)
    if not sign or not path.strip():
        return document.with_problems(
            place.problem((), f"'{override}' does not read as path=value, such as scene.wavelength=550 nm")
        )
    written = text.lstrip()
    value_place = Place(OUTSIDE.file, number, len(override) - len(written) + 1)
    return _with_value(document, path.strip(), written, place, value_place)


def _with_value(document: Document, path: str, value: Value | Entry, place: Place, value_place: Place) -> Document:
    """Put a value where a dotted path points."""
    steps = document.path_of(path)
    try:
        entry, problems = _read_value(value, value_place)
    except UnreadableError as error:
        return document.with_problems(*(replace(problem, path=dotted(steps)) for problem in error.problems))
    if (sharing := next(_shared(steps, entry), None)) is not None:
        return document.with_problems(
            place.problem(
                sharing, f"{sharing[-1]}: puts the study together and cannot be set; edit the file, or set its values"
            )
        )
    below = document.entry(steps)
    if below is not None:
        problems += _taken_back_in_vain(below, entry, steps)
    try:
        root = cast(MappingEntry, _placed(document.root, steps, (), Member(place, entry)))
    except _NoSuchPlaceError as error:
        problems.append(place.problem(steps, str(error)))
        return document.with_problems(*problems)
    # What another reading of the study writes itself is the study's own.
    changed = document.with_root(root, steps) if place.file == OUTSIDE.file else replace(document, root=root)
    return changed.with_problems(*problems)


def _read_value(value: Value | Entry, place: Place) -> tuple[Entry, list[Problem]]:
    """Give what is to stand in the tree, and the mistakes that left it standing."""
    if isinstance(value, Entry):
        return value, []
    if not isinstance(value, str):
        return entry_of_value(value, place)
    if _is_comment(value):
        what = f"{value.strip()!r} is a comment in YAML, which gives no value; quote it where the sign is meant"
        raise _refused(place, what)
    return compose(value, place) if value.strip() else (ScalarEntry(place=place, value=None, text=""), [])


def _is_comment(text: str) -> bool:
    """Whether nothing but comments stands there."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return bool(lines) and all(line.startswith("#") for line in lines)


def _shared(steps: tree.Path, entry: Entry) -> Iterator[tree.Path]:
    """Where a value, or what is within it, would put a camera together from others."""
    if steps[0] != "cameras":
        return
    if len(steps) == 3 and steps[2] in _SHARING:
        yield steps
    elif len(steps) < 3 and isinstance(entry, MappingEntry):
        for key, member in entry.members.items():
            yield from _shared((*steps, key), member.entry)


def _taken_back_in_vain(below: Entry, above: Entry, path: tree.Path) -> list[Problem]:
    """Refuse every key that is taken back and is not there."""
    return [
        place.problem(where, _nothing_to_take_back(where[-1], members))
        for where, place, members in tree.taken_back_in_vain(below, above, path)
    ]


def _nothing_to_take_back(key: str | int, members: Mapping[str, Member]) -> str:
    return f"there is no '{key}' here that null could take back{nearest_name(str(key), members)}"


class _NoSuchPlaceError(Exception):
    """A path leads through something that has nothing below it."""


def _placed(entry: Entry | None, steps: tree.Path, above: tree.Path, new: Member) -> Entry:
    """Give an entry with a member put in at the end of the steps; what is missing on the way is implied."""
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
            raise _NoSuchPlaceError(_nothing_to_take_back(key, members))
        del members[key]
        return replace(entry, members=members)
    old = members.get(key)
    changed = _placed(old.entry if old else None, rest, (*above, key), new)
    members[key] = Member(new.key_place if old is None or not rest else old.key_place, changed)
    return replace(entry, members=members)


def _kind(entry: Entry) -> str:
    if isinstance(entry, ScalarEntry):
        return "a single value" if entry.text else "nothing"
    return "a list" if isinstance(entry, ListEntry) else "a mapping"
