"""What readers of calibration files have in common: the choice of two cameras, keys of one camera, and the pair."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.cameras.imported import Convention, ImportedCamera, ImportedRig, LensModelName
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.located import CameraFileError, Located, Request
from tradestudy.study.camera_files.pairs import checked_camera, paired, pinhole

RAW: Final = "raw: as taken, before rectification"
RADTAN: Final = ("k1", "k2", "p1", "p2", "k3")
FISHEYE: Final = ("k1", "k2", "k3", "k4")


@dataclass(frozen=True, kw_only=True)
class Definition:
    """What the definition of a format says that its files do not.

    Parameters
    ----------
    format
        Name of the format.
    direction
        What its transforms lead from and to.
    unit, by
        Unit of its lengths, empty if the files have any, and what says so if not the definition.
    pictures
        Whether the cameras are those of raw or of rectified pictures.
    """

    format: str
    direction: str
    unit: str = ""
    by: str = ""
    pictures: str = RAW


def rig(
    first: ImportedCamera,
    second: ImportedCamera,
    transform: FloatArray,
    *,
    defined: Definition,
    where: Located,
    request: Request,
    exchanged: str = "",
    others: tuple[Convention, ...] = (),
) -> ImportedRig:
    """The pair of two cameras of a file.

    Parameters
    ----------
    first, second
        Left and right, or upper and lower.
    transform
        From the first camera to the second one, 4 × 4, lengths in the unit of the file.
    defined, where
        What the format says, and where the file gives the transform.
    request
        What the study says.
    exchanged
        What to do if left and right are exchanged, if not to give ``pair``.
    others
        Further conventions.

    Raises
    ------
    CameraFileError
        See `paired` and `Request.metres`.
    """
    metre, unit = request.metres(where, stated=defined.unit, why=defined.by or f"the format {defined.format}")
    says = {
        "format": defined.format,
        "direction of transforms": defined.direction,
        "pictures": defined.pictures,
    }
    return paired(
        first,
        second,
        transform[:3, :3],
        transform[:3, 3] * metre,
        metre=metre,
        where=(where, where),
        exchanged=exchanged or f"left and right are exchanged; give pair: [{second.name}, {first.name}] beside from:",
        conventions=(*(Convention(name=name, says=text, key=where.key) for name, text in says.items()), unit, *others),
    )


def transform_of(rotation: FloatArray, translation: Sequence[float] | FloatArray) -> FloatArray:
    """A 4 × 4 transform."""
    transform: FloatArray = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, translation
    return transform


def chosen(names: Sequence[str], request: Request, at: Located) -> tuple[str, str]:
    """The two cameras that ``pair`` names, or the first two.

    Raises
    ------
    CameraFileError
        There are no such cameras.
    """
    for name in request.pair:
        if name not in names:
            raise at.fail(f"pair: no camera is called '{name}'; known: {', '.join(names)}")
    if len(names) < 2:
        raise at.fail(f"the file contains {len(names)} of the cameras that a pair needs; two are expected")
    first, second = request.pair or names[:2]
    if first == second:
        raise at.fail(f"pair: {first} occurs twice; two cameras are expected")
    return first, second


def keyed(
    name: str,
    value: Located,
    model: LensModelName,
    coefficients: Mapping[str, float],
    *,
    lens: Located | None = None,
    keys: Sequence[str] = ("fx", "fy", "cx", "cy"),
    size: Located | tuple[Located, Located] | None,
    request: Request,
    says: str = "",
    fisheye: str | None = None,
) -> ImportedCamera:
    """One camera whose focal lengths and principal point have a key each.

    Parameters
    ----------
    name, value
        Name of the camera, and the mapping with its keys.
    model, coefficients, lens
        Its lens, and the mapping with the coefficients if it is another one.
    keys
        Keys of focal lengths and principal point.
    size
        Where the file gives the size of the pictures; None: the study gives it.
    request
        What the study says.
    says, fisheye
        See `checked_camera`.
    """
    fx, fy, cx, cy = (value.need(key).number() for key in keys)
    return checked_camera(
        name,
        pinhole(value, fx, fy, cx, cy),
        model,
        coefficients,
        matrix=value,
        lens=lens or value,
        size=size,
        pixels=request.pixels,
        says=says,
        fisheye=fisheye,
    )


def given(value: Located, names: Sequence[str], keys: Sequence[str] = ()) -> dict[str, float]:
    """The coefficients that have keys in a mapping; keys are names unless given."""
    coefficients = {name: value.find(key) for name, key in zip(names, keys or names, strict=True)}
    return {name: coefficient.number() for name, coefficient in coefficients.items() if coefficient is not None}


def only(names: Sequence[str], numbers: Sequence[float], lens: Located) -> dict[str, float]:
    """Coefficients in order; numbers beyond the last name must be 0.

    Raises
    ------
    CameraFileError
        There are too few, or others than 0 beyond.
    """
    if len(numbers) < len(names) or any(numbers[len(names) :]):
        raise lens.fail(f"{len(numbers)} numbers are given; {len(names)} are expected")
    return dict(zip(names, numbers, strict=False))


def unknown(named: Located, known: Sequence[str]) -> CameraFileError:
    """A lens model that a format lacks or the program does not read."""
    return named.fail(f"the camera model '{named.text()[:40]}' is unknown; one of {', '.join(known)} is expected")
