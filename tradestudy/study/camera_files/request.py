"""What a study says beside ``from:`` of how its calibration files are to be read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from tradestudy.cameras.imported import Convention, Imported
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
    name
        As its users call it.
    recognises
        Whether a file is of this format, by its content.
    read
        From the files that a camera names to what they say.
    """

    name: str
    recognises: Callable[[CameraFile], bool]
    read: Callable[[Sequence[CameraFile], Request], Imported]


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
