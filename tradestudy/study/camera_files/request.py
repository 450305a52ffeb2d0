"""Options for reading calibration files, beside ``from:`` in a study."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from tradestudy.cameras.imported import Convention, Imported, ImportedCamera, ImportedRig
from tradestudy.declarations.lens_models import FittedLensModel
from tradestudy.study.camera_files.located import CameraFile, CameraFileError, Located
from tradestudy.study.document import ScalarEntry
from tradestudy.units import LENGTH, UnitError, parse

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


def _units_named(top: Located) -> Iterator[Located]:
    """The keys of a file, such as ``T_unit``, whose values are units of length."""
    for name in top.names():
        value = top.find(name) if _UNIT.fullmatch(name) else None
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
    read
        Camera or rig from the files of a camera.
    write
        The text of each file for a pair, by file name, given the pair and the stem of the names; raises
        `UnsupportedLensError` for a lens that the format cannot represent. None: export is not supported.
    """

    name: str
    word: str = ""
    options: tuple[str, ...] = ()
    recognises: Callable[[CameraFile], bool]
    read: Callable[[Sequence[CameraFile], Request], Imported]
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


def coefficients_of(camera: ImportedCamera, names: Sequence[str], *, of: str = "rational") -> tuple[float, ...]:
    """The coefficients of a lens in the order of a format.

    Raises
    ------
    UnsupportedLensError
        The lens has another model, or nonzero coefficients that are not among the names.
    """
    if camera.lens_model != of:
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
        if not (isinstance(value, list) and len(value) == 2 and all(type(one) in (str, int) for one in value)):
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


def origin_of_pixels(value: Located) -> Convention:
    """The origin of pixels, the same for all formats."""
    return Convention(name="origin of pixels", says=PIXEL_ORIGIN, key=value.key)
