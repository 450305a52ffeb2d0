"""Values of calibration files with their places, and the options for reading them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath
from typing import Final

from tradestudy.cameras.imported import Convention, Imported, ImportedCamera, ImportedRig
from tradestudy.declarations.lens_models import FittedLensModel
from tradestudy.errors import Problem
from tradestudy.study.document import Entry, ListEntry, MappingEntry, Path, Place, ScalarEntry, dotted, plain
from tradestudy.units import LENGTH, UnitError, parse

_LARGEST = 1e12  # larger than any number of a camera, in any unit
YES: Final = ("true", "yes", "on")
SET: Final = ("1", "1.", "1.0", *YES)
NOT_SET: Final = ("0", "0.", "0.0", "false", "no", "off")


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
    beside
        Keys that lead to values which the definition of the format gives no part in the calibration.
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
    beside: set[Path] = field(default_factory=set)
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
        written = {key: members[key].entry for key in names if key in members}
        values = [
            Located(file=self.file, entry=entry, path=(*self.path, key))
            for key, entry in written.items()
            if not (isinstance(entry, ScalarEntry) and entry.value is None)
        ]
        for other in values[1:]:
            if _content(other.entry) != _content(values[0].entry):
                what = f"{values[0].last} and {other.last} mean the same, but their values differ; remove the wrong one"
                raise other.fail(what)
            other.use()
        return values[0] if values else None

    def need(self, *names: str) -> Located:
        """The value under any of these keys, which are names of one quantity.

        Raises
        ------
        CameraFileError
            None of them has a value, or two have different ones.
        """
        value = self.find(*names)
        if value is None:
            raise self.fail(f"the key {' or '.join(names)} is missing")
        return value

    def use(self) -> None:
        """Note that the whole value has been used."""
        self.file.used.add(self.path)

    def set_aside(self, *names: str) -> None:
        """Note that these keys, or all if none is named, are no part of a calibration if they are not used."""
        self.file.beside.update((*self.path, key) for key in names or self.names())

    def use_matrix(self) -> None:
        """Note that a matrix has been used: the numbers, and how they are stored, but no other key beside them."""
        for key in ("rows", "cols", "sizes", "dt", "data"):
            if self.has(key):
                self.file.used.add((*self.path, key))

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

    def pair(self) -> tuple[Located, Located]:
        """The width and the height in a list of two."""
        items = tuple(self.items())
        if len(items) != 2:
            raise self.fail(f"{len(items)} values are given; width and height are expected")
        return items[0], items[1]

    def names(self) -> tuple[str, ...]:
        """Keys of a mapping, in order."""
        return tuple(self.entry.members) if isinstance(self.entry, MappingEntry) else ()

    def text(self) -> str:
        """A single value as text."""
        if not isinstance(self.entry, ScalarEntry) or self.entry.value is None:
            raise self.fail("a text is expected")
        self.use()
        return self.entry.text.strip()

    def flag(self, yes: Sequence[str] = (), no: Sequence[str] = ()) -> bool:
        """Whether a flag is set: 1, true, yes, on or one of ``yes`` if so; 0, false, no, off or one of ``no`` if not.

        Raises
        ------
        CameraFileError
            It says none of these.
        """
        text = self.text().lower()
        if text in (*SET, *yes):
            return True
        if text in (*NOT_SET, *no):
            return False
        names = "".join(f", {word}" for word in (*yes, *no))
        raise self.fail(f"'{text[:40]}' is unknown; one of 1, true, yes, on, 0, false, no, off{names} is expected")

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
            # A whole number may have so many digits that no float can hold it.
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
        numbers = [*self._numbers()]
        self.use()
        if counts and len(numbers) not in counts:
            raise self.fail(f"{len(numbers)} numbers are given; {' or '.join(map(str, counts))} are expected")
        return tuple(numbers)

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
        members = value.entry.members.items()
        below = [replace(value, entry=member.entry, path=(*value.path, key)) for key, member in members]
    elif isinstance(value.entry, ListEntry):
        below = [*value.items()]
    elif value.entry.value is None:  # an empty value states nothing
        return
    if value.path not in partly:
        # An empty list or mapping states nothing.
        if below or isinstance(value.entry, ScalarEntry):
            yield value
    elif isinstance(value.entry, MappingEntry) or _has_mapping(value.entry):
        for inner in below:
            yield from _unused(inner, partly)


def _content(entry: Entry) -> object:
    """A value for comparison: of a matrix that states its numbers of rows and columns, the elements."""
    content = plain(entry)
    return content.get("data", content) if isinstance(content, dict) else content


def _has_mapping(entry: Entry) -> bool:
    return isinstance(entry, MappingEntry) or (isinstance(entry, ListEntry) and any(map(_has_mapping, entry.items)))


OTHER_CAMERAS: Final = "cameras not used"
"""Name of the convention that lists the cameras of a file that are not part of the pair."""
UNUSED: Final = "not used"
"""Name of the convention that lists the keys or columns of calibration files that the program does not use."""
PIXEL_ORIGIN: Final = "the centre of the first pixel is (0, 0), x to the right and y down"


_UNIT: Final = re.compile(
    r"((T|length|translation|baseline|distance|world)_?)?units?(_of_(length|T|translation))?", re.IGNORECASE
)
"""Keys of files that name the unit of their lengths."""


class NoLengthUnitError(CameraFileError):
    """Neither a file nor its format nor the study states the unit of length."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Information that calibration files may lack.

    Parameters
    ----------
    length_unit
        Unit of length of the files, from the study; empty if not given.
    pair
        Names of the left and the right camera in a file with several; empty: in the order of the format.
    pixels
        Columns and rows of the pictures as taken, from the study; None if it gives none.
    pictures
        ``raw`` or ``rectified``: the pictures in which depth is measured.
    lens_model
        ``fisheye`` or ``pinhole`` if the format does not say which; empty if not given.
    fitted_lens
        The lens model to fit to corners; None for the default.
    """

    length_unit: str = ""
    pair: tuple[str, ...] = ()
    pixels: tuple[int, int] | None = None
    pictures: str = "raw"
    lens_model: str = ""
    fitted_lens: FittedLensModel | None = None

    def metres(self, value: Located, *, stated: str = "", why: str = "") -> tuple[float, Convention]:
        """The unit of length in metres, and its origin: the study, else a key such as ``T_unit`` or the format.

        Parameters
        ----------
        value
            A length, for messages and the register.
        stated, why
            Unit stated by the definition of the format, and its words; empty if it states none.

        Raises
        ------
        NoLengthUnitError
            The unit is unknown.
        CameraFileError
            A key of the file names another unit than the study or the format.
        """
        named = next(_units_named(value.file.top), None)
        if named is not None and not stated:
            stated, why = named.text(), f"{named.last} of the file"
        unit = self.length_unit or stated
        if not unit:
            what = "the file does not state its unit of length; give length_unit: mm (or m) beside from:"
            raise NoLengthUnitError(value.fail(what).problem)
        by = "length_unit of the study" if self.length_unit else why
        metre = parse(f"1 {unit}", LENGTH)
        if named is not None and not math.isclose(parse(f"1 {named.text()}", LENGTH), metre):
            what = f"{named.text()} is not the unit in which lengths are read, {unit} by {by}; correct the wrong one"
            raise named.fail(what + ("" if self.length_unit else ", or give length_unit beside from:"))
        return metre, Convention(name="length unit", says=f"{unit}, by {by}", key=value.key)

    def refuse_other_lens(self, named: Located, kind: str) -> None:
        """Refuse a file that names a kind of lens, ``fisheye`` or ``pinhole``, other than that of the study.

        Raises
        ------
        CameraFileError
            They contradict each other.
        """
        if self.lens_model not in ("", kind):
            raise named.fail(
                f"{named.text()[:40]} contradicts lens_model: {self.lens_model} of the study; remove the wrong one"
            )


def _units_named(top: Located) -> Iterator[Located]:
    """The keys of a file, such as ``T_unit``, whose values are units of length."""
    for key in top.names():
        value = top.find(key) if _UNIT.fullmatch(key) else None
        if value is not None and isinstance(value.entry, ScalarEntry):
            with suppress(UnitError):
                parse(f"1 {value.entry.text}", LENGTH)
                yield value


@dataclass(frozen=True, kw_only=True)
class Format:
    """A format of calibration files.

    Parameters
    ----------
    name, word
        Name of the format, and its name on the command line.
    options
        Fields of a `Request` that apply to this format.
    recognises
        Whether the content of a file has this format.
    whole
        Why one file is enough; empty if a pair may need more.
    read
        Camera or rig from the files of a camera.
    signs
        Keys by which people know the format, for messages.
    is_general
        Whether a file that also fits another format has that one.
    write
        The text of each file for a pair, by file name, given the pair and the stem of the names; raises
        `UnsupportedLensError` for a lens that the format cannot represent. None: export is not supported.
    """

    name: str
    word: str = ""
    options: tuple[str, ...] = ()
    whole: str = ""
    recognises: Callable[[CameraFile], bool]
    read: Callable[[Sequence[CameraFile], Request], Imported]
    signs: tuple[str, ...] = ()
    is_general: bool = False
    write: Callable[[ImportedRig, str], Mapping[str, str]] | None = None


class UnsupportedLensError(Exception):
    """A format cannot represent a lens.

    Parameters
    ----------
    names
        The coefficients, or the lens model, that the format lacks.
    """

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(names)
        self.names = tuple(names)


def coefficients_of(camera: ImportedCamera, names: Sequence[str], *, model: str = "rational") -> tuple[float, ...]:
    """The coefficients of a lens in the order of a format.

    Raises
    ------
    UnsupportedLensError
        The lens has another model, or nonzero coefficients that are not among the names.
    """
    if camera.lens_model != model:
        raise UnsupportedLensError([f"the lens model {camera.lens_model}"])
    if beyond := [name for name, value in camera.coefficients.items() if value != 0.0 and name not in names]:
        raise UnsupportedLensError(beyond)
    return tuple(camera.coefficients.get(name, 0.0) for name in names)


def shortest_coefficients(camera: ImportedCamera, names: Sequence[str], counts: Sequence[int]) -> tuple[float, ...]:
    """The coefficients of a lens in the shortest of several forms that contains them.

    Raises
    ------
    UnsupportedLensError
        None of the forms contains them.
    """
    for count in counts[:-1]:
        with suppress(UnsupportedLensError):
            return coefficients_of(camera, names[:count])
    return coefficients_of(camera, names[: counts[-1]])


def wrong_request(key: str, value: object) -> str:
    """What is wrong with a value that a study gives for a `Request`; empty if nothing is."""
    if key == "length_unit":
        try:
            parse(f"1 {value}" if isinstance(value, str) else value, LENGTH)
        except UnitError as error:
            return str(error)
    elif key == "pair":
        if not (isinstance(value, list) and len(value) == 2 and all(type(name) in (str, int) for name in value)):
            return "the names of the left and the right camera are expected, such as [cam0, cam1]"
    elif value not in (choices := {"pictures": ("raw", "rectified"), "lens_model": ("fisheye", "pinhole")}[key]):
        corners = "; calibration.corners.lens_model declares a model to fit to corners"
        return f"{' or '.join(choices)} is expected{corners if key == 'lens_model' else ''}"
    return ""


def other_cameras(cameras: Mapping[str, Located], pair: Sequence[str]) -> tuple[Convention, ...]:
    """The cameras of a file that are not part of the pair, in words."""
    others = {name: camera for name, camera in cameras.items() if name not in pair}
    for camera in others.values():
        camera.use()
    key = next((camera.key for camera in others.values()), "")
    return (Convention(name=OTHER_CAMERAS, says=", ".join(others), key=key),) if others else ()
