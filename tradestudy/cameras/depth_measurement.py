"""The arguments and results of all error models."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.error_vocabulary import SESSION_PARAMETERS
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray

Errors = Mapping[str, ArrayLike]
"""Errors by name, in SI; missing ones are zero. Arrays of shape (draws, 1) give one row per draw."""


_GRID: Final = 5  # places across and down a part of the picture


@dataclass(frozen=True, kw_only=True)
class PicturePlace:
    """One position in the picture.

    Parameters
    ----------
    across, down
        Distance from the middle as a fraction of half the sensor, −1 (left, top) to 1 (right, bottom).
    """

    across: float
    down: float

    def __post_init__(self) -> None:
        for share in (self.across, self.down):
            require_field(abs(share))


@dataclass(frozen=True, kw_only=True, eq=False)
class PicturePlaces:
    """Positions anywhere in the picture, one for each measured distance.

    Parameters
    ----------
    across, down : array (distances,)
        Distance from the middle as a fraction of half the sensor, −1 to 1.
    """

    across: FloatArray
    down: FloatArray


FieldPosition = float | PicturePlace
"""A position in the picture; a number is a fraction of the way from the axis to the lower right corner."""
Field = FieldPosition | PicturePlaces
"""One position in the picture, or one for each measured distance."""

# Errors of calibration are correlated and act from one side, as the yaw of one camera of a pair does, so no camera
# measures alike in all four; the disparity error alone depends only on the distance from the middle.
CORNERS: Final[Mapping[str, tuple[int, int]]] = {
    "lower right": (1, 1),
    "lower left": (-1, 1),
    "upper right": (1, -1),
    "upper left": (-1, -1),
}
"""The corners of the picture, with the signs of their positions across and down."""


def towards_corners(share: float) -> tuple[PicturePlace, ...]:
    """The places at a fraction of the way from the middle of the picture to its corners, in the order of `CORNERS`."""
    return tuple(PicturePlace(across=share * across, down=share * down) for across, down in CORNERS.values())


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredInverseDepth:
    """Inverse depths measured by a camera.

    Parameters
    ----------
    inverse_depth
        w = 1/Z [1/m], shape (draws, distances); w ≤ 0 is at or beyond infinity.
    no_overlap
        Where the camera does not see the point at all; broadcasts against ``inverse_depth``.
    out_of_range
        Where the errors make the camera impossible: a length is not positive, or a distortion has no inverse.
    """

    inverse_depth: FloatArray
    no_overlap: BoolArray
    out_of_range: BoolArray


def places_within(share: float) -> tuple[PicturePlace, ...]:
    """A grid of places over the rectangle that reaches a fraction of the way to the corners of the picture.

    The first ones are its corners; the middle is one of them. Depth uncertainty changes smoothly over the picture, so
    that its largest value in the rectangle lies near one of them, usually in a corner or on an edge.
    """
    steps = share * np.linspace(-1.0, 1.0, _GRID)
    inner = (PicturePlace(across=float(across), down=float(down)) for down in steps for across in steps)
    return tuple(dict.fromkeys((*towards_corners(share), *inner)))


def place_words(field: FieldPosition) -> str:
    """A position in the picture, in words."""
    if not isinstance(field, PicturePlace):
        field = PicturePlace(across=field, down=field)
    across, down = abs(field.across), abs(field.down)
    left, top = "left" if field.across < 0.0 else "right", "top" if field.down < 0.0 else "bottom"
    if across == down:
        corner = f"{'upper' if top == 'top' else 'lower'} {left} corner"
        return f"{100.0 * across:.3g} % of the way to the {corner}" if across else "on the axis"
    towards = [
        f"{100.0 * share:.3g} % of the way to the {edge}"
        for share, edge in ((across, f"{left} edge"), (down, f"{top} edge"))
        if share
    ]
    return " and ".join(towards)


def require_known(errors: Errors, known: Collection[str], camera: str) -> None:
    """Refuse errors that a camera does not have."""
    if unknown := sorted(set(errors) - set(known) - set(SESSION_PARAMETERS)):
        raise OutOfRangeError(
            f"{camera} has no such error",
            value=", ".join(unknown),
            limit=", ".join(sorted({*known, *SESSION_PARAMETERS})),
            remedy="use one of the names of its error model",
        )


def shares_of(field: Field) -> tuple[FloatArray, FloatArray]:
    """Position as fractions of half the sensor, across and down; refuses positions beyond the edge."""
    if isinstance(field, PicturePlace | PicturePlaces):
        return np.asarray(field.across), np.asarray(field.down)
    require_field(field)
    return np.asarray(field), np.asarray(field)


def require_field(field: float) -> None:
    """Refuse a position beyond the edge of the sensor."""
    if not 0.0 <= field <= 1.0:
        raise OutOfRangeError(
            "field position beyond the edge of the sensor",
            value=f"{field:g}",
            limit="0 (axis) to 1 (corner of the sensor)",
            remedy="give the field position as a fraction of the distance from axis to corner",
        )


def value_of(errors: Errors, name: str) -> FloatArray:
    """One error, zero where it is not given."""
    return np.asarray(errors.get(name, 0.0), dtype=np.float64)
