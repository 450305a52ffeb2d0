"""What a study says beside ``from:`` of how its calibration files are to be read."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from tradestudy.cameras.imported import Convention, Imported, ImportedCamera, ImportedRig
from tradestudy.study.camera_files.located import CameraFile, Located
from tradestudy.units import LENGTH, UnitError, parse

PIXEL_ORIGIN: Final = "the centre of the first pixel is (0, 0), x to the right and y down"


@dataclass(frozen=True, kw_only=True)
class Request:
    """What cannot be read from the files.

    Parameters
    ----------
    length_unit
        In which the files write lengths, as the study names it; empty where it does not.
    pair
        Names of the left and the right camera, of a file that holds several; empty: as the format orders them.
    pictures
        Whether depth is measured in the pictures as taken, or in rectified ones.
    lens_model
        Where it is not the one that the format takes: ``fisheye``.
    """

    length_unit: str = ""
    pair: tuple[str, ...] = ()
    pictures: str = "raw"
    lens_model: str = ""

    def metres(self, value: Located, *, stated: str = "", why: str = "") -> tuple[float, Convention]:
        """One of the file's lengths in metres, and where that is known from.

        Parameters
        ----------
        value
            A length, for messages and the register.
        stated, why
            The unit that the file or the definition of its format states, and where; empty: neither does.

        Raises
        ------
        CameraFileError
            Nobody states the unit.
        """
        unit = self.length_unit or stated
        if not unit:
            raise value.fail("the file does not state its unit of length; say length_unit: mm (or m) beside from:")
        by = "length_unit of the study" if self.length_unit else why
        return parse(f"1 {unit}", LENGTH), Convention(name="length unit", says=f"{unit}, by {by}", key=value.key)


@dataclass(frozen=True, kw_only=True)
class Format:
    """A format of calibration files.

    Parameters
    ----------
    name, word
        As its users call it, and in one word of the command line.
    options
        Which fields of a `Request` say something about files of this format.
    recognises
        Whether a file is of this format, by its content.
    read
        From the files that a camera names to what they say.
    write
        From a pair and the beginning of file names to the texts of files that say the same, by name; it raises
        `CannotHoldError` on what they cannot hold. None: nothing is written in this format.
    """

    name: str
    word: str = ""
    options: tuple[str, ...] = ()
    recognises: Callable[[CameraFile], bool]
    read: Callable[[Sequence[CameraFile], Request], Imported]
    write: Callable[[ImportedRig, str], Mapping[str, str]] | None = None


class CannotHoldError(Exception):
    """A format has no place for coefficients of a lens.

    Parameters
    ----------
    names
        Of the coefficients, or of the lens model where that itself is unknown to the format.
    """

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(names)
        self.names = tuple(names)


def held(camera: ImportedCamera, names: Sequence[str], *, of: str = "rational") -> tuple[float, ...]:
    """The coefficients of a lens in the order of a format.

    Raises
    ------
    CannotHoldError
        The lens has another model, or coefficients that act and are not among the names.
    """
    if camera.lens_model != of:
        raise CannotHoldError([f"the lens model {camera.lens_model}"])
    if beyond := [name for name, value in camera.coefficients.items() if value != 0.0 and name not in names]:
        raise CannotHoldError(beyond)
    return tuple(camera.coefficients.get(name, 0.0) for name in names)


def fewest(camera: ImportedCamera, names: Sequence[str], counts: Sequence[int]) -> tuple[float, ...]:
    """The coefficients of a lens by the shortest of several forms that hold them.

    Raises
    ------
    CannotHoldError
        None of the forms does.
    """
    for count in counts[:-1]:
        with suppress(CannotHoldError):
            return held(camera, names[:count])
    return held(camera, names[: counts[-1]])


def wrong_request(key: str, value: object) -> str:
    """What is wrong with what a study says under one of the keys of a `Request`; empty where nothing is."""
    if key == "length_unit":
        try:
            parse(f"1 {value}" if isinstance(value, str) else value, LENGTH)
        except UnitError as error:
            return str(error)
    elif key == "pair":
        if not (isinstance(value, list) and len(value) == 2 and all(isinstance(one, str) for one in value)):
            return "the names of the left and the right camera are expected, such as [cam0, cam1]"
    elif value not in (choices := {"pictures": ("raw", "rectified"), "lens_model": ("fisheye",)}[key]):
        return f"{' or '.join(choices)} is expected"
    return ""


def origin_of_pixels(value: Located) -> Convention:
    """The origin that all formats here share."""
    return Convention(name="origin of pixels", says=PIXEL_ORIGIN, key=value.key)
