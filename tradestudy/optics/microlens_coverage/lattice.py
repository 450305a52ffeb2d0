"""Lattices of microlenses in units of their pitch: the types laid over them, and the order of lenses by distance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray

Integers = NDArray[np.int64]

Layout = Literal["hexagonal", "square"]
Counting = Literal["all_lenses", "given_type", "some_type", "every_type"]

# Each of three types on a hexagonal lattice sits on a hexagonal lattice of this pitch.
SAME_TYPE_PITCH: Final = math.sqrt(3)
# Angles closer than this differ only by rounding.
_SAME_ANGLE = 1e-12


@dataclass(frozen=True, kw_only=True)
class Lattice:
    """A lattice of unit pitch with a nearest neighbour on the x axis.

    ``sectors`` wedges of equal angle, the first from angle 0, are copies of each other by rotation and
    reflection; a sum over the plane is ``sectors`` times the sum over one of them.
    """

    second_vector: tuple[float, float]
    cell_area: float
    cell_circumradius: float
    sectors: int

    @property
    def wedge(self) -> float:
        """Angle of the fundamental wedge [rad]."""
        return 2 * math.pi / self.sectors

    def neighbours(self, reach: float) -> tuple[FloatArray, Integers]:
        """Positions (n, 2) and colours of the lenses within ``reach`` of the lens at the origin, without it.

        The colour is the type in the three-type array: 0 is the type of the lens at the origin.
        """
        span = math.ceil(reach / self.second_vector[1]) + 1
        i, j = (index.ravel() for index in np.mgrid[-2 * span : 2 * span + 1, -span : span + 1])
        positions = np.stack((i + j * self.second_vector[0], j * self.second_vector[1]), axis=-1)
        squared = np.sum(positions**2, axis=-1)
        kept = (squared > 0) & (squared <= reach**2)
        return positions[kept], ((i - j) % 3)[kept].astype(np.int64)


LATTICES: Final[dict[Layout, Lattice]] = {
    "hexagonal": Lattice(
        second_vector=(0.5, math.sqrt(3) / 2),
        cell_area=math.sqrt(3) / 2,
        cell_circumradius=1 / math.sqrt(3),
        sectors=12,
    ),
    "square": Lattice(second_vector=(0.0, 1.0), cell_area=1.0, cell_circumradius=1 / math.sqrt(2), sectors=8),
}


def lattice_of(layout: Layout) -> Lattice:
    """Lattice of a layout; refuses an unknown one."""
    if layout not in LATTICES:
        raise OutOfRangeError(
            "unknown layout of microlenses",
            value=repr(layout),
            limit=" | ".join(LATTICES),
            remedy="name one of these",
        )
    return LATTICES[layout]


def require_types(layout: Layout, types: int) -> None:
    """Refuse numbers of types that do not tile the layout into equal lattices of one shape."""
    if types == 1 or (types == 3 and layout == "hexagonal"):
        return
    raise OutOfRangeError(
        f"microlens types on a {layout} layout, each on a {layout} lattice of its own",
        value=str(types),
        limit="1, or 3 on a hexagonal layout (a square lattice has no square sublattice of index 3)",
        remedy="use a hexagonal layout for three types",
    )


def as_radii(radius_over_pitch: ArrayLike) -> FloatArray:
    """Check that radii are non-negative numbers (infinity is allowed)."""
    radius = np.asarray(radius_over_pitch, dtype=np.float64)
    if not np.all(radius >= 0):
        raise OutOfRangeError(
            "radius of the projected pupil over microlens pitch",
            value=f"{radius[~(radius >= 0)].flat[0]:g}",
            limit="a number ≥ 0",
            remedy="give |a_L| A/(2 b p)",
        )
    return radius


def counted_on_lattice(layout: Layout, types: int, counting: Counting) -> tuple[Counting, float]:
    """Reduce a count to one lattice: what is counted there, and the lattice's pitch in pitches of the whole array.

    A given type of three sits on a lattice of its own, so its lenses count as all lenses of a coarser array.
    """
    lattice_of(layout)
    require_types(layout, types)
    if counting not in get_args(Counting):
        raise OutOfRangeError(
            "unknown way of counting microlenses",
            value=repr(counting),
            limit=" | ".join(get_args(Counting)),
            remedy="name one of these",
        )
    if types == 1:
        return "all_lenses", 1.0
    return ("all_lenses", SAME_TYPE_PITCH) if counting == "given_type" else (counting, 1.0)


def distance_to_bisector(positions: FloatArray, direction: FloatArray) -> FloatArray:
    """Distance along each direction (rows) from which each lens (columns) is nearer than the origin: |g|²/(2 g·u).

    Infinite for a lens that never comes closer.
    """
    along = np.cos(direction)[:, np.newaxis] * positions[:, 0] + np.sin(direction)[:, np.newaxis] * positions[:, 1]
    squared = np.sum(positions**2, axis=-1)
    never = np.full(along.shape, np.inf)
    return np.asarray(np.divide(squared, 2 * along, out=never, where=along > 1e-9))


def order_changes(lattice: Lattice, positions: FloatArray, *, within: float) -> FloatArray:
    """Angles in the wedge at which two lenses become nearer than the origin at the same distance, within a radius.

    The ends of the wedge are the first and the last of the angles. At g and h this is where |g|²/(g·u) =
    |h|²/(h·u).
    """
    near = positions[np.sum(positions**2, axis=-1) <= (2 * within) ** 2]
    i, j = np.triu_indices(len(near), k=1)
    squared = np.sum(near**2, axis=-1)[:, np.newaxis]
    normal = squared[i] * near[j] - squared[j] * near[i]
    crossing = np.arctan2(-normal[:, 0], normal[:, 1]) % math.pi
    along = np.cos(crossing) * near[i, 0] + np.sin(crossing) * near[i, 1]
    reached = 2 * within * along >= squared[i, 0]
    in_wedge = (crossing > _SAME_ANGLE) & (crossing < lattice.wedge - _SAME_ANGLE)
    angles = np.sort(crossing[reached & in_wedge])
    distinct = angles[np.diff(angles, prepend=-1.0) > _SAME_ANGLE]
    return np.concatenate(([0.0], distinct, [lattice.wedge]))
