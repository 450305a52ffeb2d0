"""Lattices of microlenses, and how many microlenses see a point.

A lens sees the point if the ray from the point through the centre of the lens comes from the pupil: if this centre lies
in the disc that the pupil projects through the image point onto the array. Over all positions, the fraction of points
with at least k lenses in a disc of radius r is the fraction whose k-th nearest lens is within r. The points whose k-th
nearest lens is the one at the origin form the k-th Brillouin zone of the lattice, which has the area of one cell. Along
the ray at angle φ, the lens at g becomes nearer than the origin at s_g(φ) = |g|/(2 cos(φ − φ_g)). So the zone is the
stretch between the (k−1)-th and the k-th smallest s_g, and

    P(n ≥ k) = 1/cell ∮ ½ [min(r, s_k(φ))² − min(r, s_{k−1}(φ))²] dφ,

which has a closed form between the angles at which the order of the s_g changes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.errors import OutOfRangeError, UnaffordableError
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


LARGEST_COUNT: Final = 32
# The covering radius is known to this relative rounding; within it, a radius counts as having reached it.
_ROUNDING: Final = 1e-14
# Entries in a row of lens indices: the lens at the origin; no lens, because the zone is empty there.
_ORIGIN: Final = -1
_NO_LENS: Final = -2


def projected_radius_over_pitch(
    *,
    microlens_object_distance: ArrayLike,
    mla_distance: ArrayLike,
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
) -> FloatArray:
    """Radius of the disc of light on the array, over the pitch: |a_L| A / (2 b p) with b = z − a_L.

    Parameters
    ----------
    microlens_object_distance
        Signed distance a_L from the main lens's image to the array [m]: positive for an image in front of the array
        (Keplerian), negative for one behind it (Galilean), −∞ for an object in the main lens's front focal plane.
    mla_distance
        Main lens to array, z > 0 [m].
    pupil_diameter
        Diameter A of the main lens's pupil, in the plane of the lens [m].
    microlens_pitch
        Distance between neighbouring lenses, p > 0 [m].

    Returns
    -------
    Radius over pitch [1], broadcast; |v| z / (2 b) when the f-numbers match as b_L/p = z/A. It is 0 for an
    image on the array and A/(2p) for one at infinity behind it.

    Raises
    ------
    OutOfRangeError
        For an image that is not behind the main lens (a_L ≥ z), and for lengths that are not positive.
    """
    a_L = np.asarray(microlens_object_distance, dtype=np.float64)
    z, A, p = _positive(mla_distance, pupil_diameter, microlens_pitch)
    if not np.all(a_L < z):
        raise OutOfRangeError(
            "image of the main lens relative to the array",
            value=f"{np.max(a_L):g} m in front of the array",
            limit="less than the distance from main lens to array",
            remedy="move the object beyond the front focal point of the main lens",
        )
    # a_L/(z − a_L) written so that an image at infinity behind the array gives its limit −1.
    with np.errstate(divide="ignore"):
        ratio = np.where(a_L == 0, 0.0, 1 / (z / a_L - 1))
    return np.asarray(np.abs(ratio) * A / (2 * p))


def covering_microlens_object_distance(
    radius_over_pitch: ArrayLike,
    *,
    keplerian: bool,
    mla_distance: ArrayLike,
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
) -> FloatArray:
    """Signed a_L at which the disc of light has a given radius: a_L = ±2 r z / (A ± 2 r), the total covering plane.

    The inverse of `projected_radius_over_pitch` for one sign of the relay. With the radius from
    `covering_radius_over_pitch`, it is the plane beyond which the required number of lenses sees every point: images
    farther in front of the array for a Keplerian relay, farther behind it for a Galilean one.

    Parameters
    ----------
    radius_over_pitch
        Radius of the disc over the pitch [1].
    keplerian
        Whether the image lies in front of the array.
    mla_distance, pupil_diameter, microlens_pitch
        As in `projected_radius_over_pitch` [m].

    Returns
    -------
    Signed distance [m], broadcast; −∞ for a Galilean relay where 2 r p reaches the pupil diameter exactly.

    Raises
    ------
    OutOfRangeError
        For a Galilean relay whose pupil is smaller than the requested disc: no image behind the array reaches it.
    """
    z, A, p = _positive(mla_distance, pupil_diameter, microlens_pitch)
    disc = 2 * np.asarray(radius_over_pitch, dtype=np.float64) * p
    if keplerian:
        return np.asarray(disc * z / (A + disc))
    if np.any(disc > A):
        raise OutOfRangeError(
            "diameter of the disc of light on the array",
            value=f"{np.max(disc):g} m",
            limit=f"≤ {np.min(A):g} m, the pupil diameter, for a Galilean relay",
            remedy="open the aperture or take a smaller microlens pitch",
        )
    with np.errstate(divide="ignore"):  # an image at infinity is a valid limit
        return np.asarray(-disc * z / (A - disc))


def _positive(*lengths: ArrayLike) -> tuple[FloatArray, ...]:
    """Return lengths as arrays; refuses one that is not positive."""
    arrays = tuple(np.asarray(length, dtype=np.float64) for length in lengths)
    for array in arrays:
        if not np.all(array > 0):
            raise OutOfRangeError(
                "length of the camera",
                value=f"{np.min(array):g} m",
                limit="> 0 m",
                remedy="check the unit and the sign",
            )
    return arrays


def seen_count_probability(
    radius_over_pitch: ArrayLike,
    *,
    at_least: int,
    layout: Layout = "hexagonal",
    types: int = 1,
    counting: Counting = "all_lenses",
) -> FloatArray:
    """Probability, over all positions of a point, that at least a given number of microlenses see it.

    Parameters
    ----------
    radius_over_pitch
        Radius of the disc that the pupil projects onto the array through the image point, over the pitch [1], any
        shape. With matched f-numbers it is |v|/2 · z/b.
    at_least
        Required number of lenses, 1 to 32.
    layout
        ``hexagonal`` or ``square``.
    types
        1, or 3 on a hexagonal layout (each type then sits on a hexagonal lattice of √3 pitches).
    counting
        ``all_lenses``: of any type. ``given_type``: of one type named beforehand. ``some_type``: at least one type
        reaches the number. ``every_type``: each type does. With a single type, all four agree.

    Returns
    -------
    Probability [1], in the shape of ``radius_over_pitch``.

    Notes
    -----
    Closed form, exact up to rounding (below 1e-13 absolute). It is exactly 0 below the smallest radius that can contain
    that many lenses, and exactly 1 from `covering_radius_over_pitch` on. A lens counts when its centre is in the disc.
    Light that touches only its rim does not count, so for r → 0 the probability of one lens vanishes too.

    Raises
    ------
    OutOfRangeError
        For a negative radius, an unknown layout, a number of types that the layout cannot carry, or a number below one.
    UnaffordableError
        For a number above 32.
    """
    radius = as_radii(radius_over_pitch)
    _require_number(at_least)
    counted, spacing = counted_on_lattice(layout, types, counting)
    return _shell(layout, counted, at_least).probability(radius / spacing)


def covering_radius_over_pitch(
    *, at_least: int, layout: Layout = "hexagonal", types: int = 1, counting: Counting = "all_lenses"
) -> float:
    """Smallest radius over pitch from which on every point is seen by at least a given number of microlenses.

    On a hexagonal array, for a pair: 1 for any lenses (|v| = 2 with matched f-numbers), 2/√3 for some type of
    three, √3 for each type. Parameters, exactness and errors as in `seen_count_probability`.
    """
    _require_number(at_least)
    counted, spacing = counted_on_lattice(layout, types, counting)
    return _shell(layout, counted, at_least).covering_radius * spacing


def mean_seen_count(radius_over_pitch: ArrayLike, *, layout: Layout = "hexagonal", types: int = 1) -> FloatArray:
    """Mean number of microlenses of one type that see a point: area of the disc over that of the type's cell.

    On a hexagonal array of one type with matched f-numbers, it is 0.907 v² for b ≈ z. Exact at every radius: each lens
    is in the disc for a fraction of positions equal to the area of the disc over that of the cell.
    """
    require_types(layout, types)
    radius = as_radii(radius_over_pitch)
    return np.asarray(math.pi * radius**2 / (lattice_of(layout).cell_area * types))


def _require_number(at_least: int) -> None:
    """Refuse numbers of lenses below one, or too large to compute."""
    if at_least < 1:
        raise OutOfRangeError(
            "required number of microlenses", value=str(at_least), limit="≥ 1", remedy="require one or more"
        )
    if at_least > LARGEST_COUNT:
        raise UnaffordableError(
            "required number of microlenses",
            value=str(at_least),
            limit=f"≤ {LARGEST_COUNT} (the table grows as its cube)",
            remedy="compare with mean_seen_count instead",
        )


@dataclass(frozen=True, kw_only=True)
class _Edge:
    """One boundary of a zone: on each interval of angle, the bisector of the origin and one lens."""

    lens_distance: FloatArray
    lens_angle: FloatArray
    begin: FloatArray
    end: FloatArray

    def area(self, radius: FloatArray) -> FloatArray:
        """∫ ½ min(r, s(φ))² dφ summed over the intervals, for a column of radii."""
        ratio = np.divide(
            self.lens_distance,
            2 * radius,
            out=np.ones(np.broadcast_shapes(radius.shape, self.lens_distance.shape)),
            where=self.lens_distance < 2 * radius,
        )
        half_angle = np.arccos(ratio)
        first = np.clip(self.lens_angle - half_angle, self.begin, self.end) - self.lens_angle
        last = np.clip(self.lens_angle + half_angle, self.begin, self.end) - self.lens_angle
        inside = (self.lens_distance / 2) ** 2 * (np.tan(last) - np.tan(first))
        outside = radius**2 * ((self.end - self.begin) - (last - first))
        return np.asarray(0.5 * np.sum(inside + outside, axis=-1))

    def largest(self) -> float:
        """Largest distance of the boundary from the origin."""
        slant = np.cos(np.stack((self.begin, self.end)) - self.lens_angle)
        return float(np.max(self.lens_distance / (2 * slant)))


@dataclass(frozen=True, kw_only=True)
class _Shell:
    """The points for which the lens at the origin completes the count: between two edges, in one wedge."""

    inner: _Edge | None
    outer: _Edge
    weight: float

    @property
    def covering_radius(self) -> float:
        return self.outer.largest()

    def probability(self, radius: FloatArray) -> FloatArray:
        column = np.minimum(radius, self.covering_radius)[..., np.newaxis]
        area = self.outer.area(column)
        if self.inner is not None:
            area = area - self.inner.area(column)
        covered = radius >= self.covering_radius * (1 - _ROUNDING)
        return np.where(covered, 1.0, np.clip(area * self.weight, 0.0, 1.0))


@lru_cache(maxsize=64)
def _shell(layout: Layout, counting: Counting, at_least: int) -> _Shell:
    """Find, for every stretch of angle with a fixed order of the bisectors, which of them bound the zone."""
    lattice = lattice_of(layout)
    reach = _reach(lattice, counting, at_least)
    positions, colours = lattice.neighbours(2 * reach)
    breaks = order_changes(lattice, positions, within=reach)
    angle = np.arctan2(positions[:, 1], positions[:, 0])
    distance = np.hypot(positions[:, 0], positions[:, 1])
    middle = 0.5 * (breaks[1:] + breaks[:-1])
    reached = distance_to_bisector(positions, middle)
    inner, outer = _bounds(reached, colours, counting, at_least)
    rows = np.arange(len(middle))
    depth = np.where(inner == _ORIGIN, 0.0, reached[rows, inner])
    inner, outer = (np.where(reached[rows, outer] > depth, lens, _NO_LENS) for lens in (inner, outer))
    changes = (np.diff(inner, prepend=_NO_LENS - 1) != 0) | (np.diff(outer, prepend=_NO_LENS - 1) != 0)
    first = np.flatnonzero(changes)
    begin, end = breaks[first], breaks[np.append(first[1:], len(middle))]
    kept = outer[first] != _NO_LENS
    begin, end, inner, outer = begin[kept], end[kept], inner[first][kept], outer[first][kept]

    def edge(lens: Integers) -> _Edge:
        return _Edge(lens_distance=distance[lens], lens_angle=angle[lens], begin=begin, end=end)

    starts_at_origin = bool(np.all(inner == _ORIGIN))
    return _Shell(
        inner=None if starts_at_origin else edge(inner),
        outer=edge(outer),
        weight=lattice.sectors / lattice.cell_area,
    )


def _reach(lattice: Lattice, counting: Counting, at_least: int) -> float:
    """Upper bound on the radius that every point needs: a disc contains all cells a circumradius inside its rim."""
    spacing = 1.0 if counting == "all_lenses" else SAME_TYPE_PITCH
    return spacing * (lattice.cell_circumradius + math.sqrt(at_least * lattice.cell_area / math.pi)) + 1e-9


def _bounds(reached: FloatArray, colours: Integers, counting: Counting, at_least: int) -> tuple[Integers, Integers]:
    """Find the lenses whose bisectors bound the zone from inside (`_ORIGIN`: none does) and from outside."""
    own = colours >= 0 if counting == "all_lenses" else colours == 0
    before, after = _ranked(reached, own, at_least - 1), _ranked(reached, own, at_least)
    if counting == "all_lenses":
        return before, after
    others = [_ranked(reached, colours == colour, at_least) for colour in (1, 2)]
    if counting == "some_type":  # up to where another type has the number first
        return before, _outermost(-reached, [after, *others])
    return _outermost(reached, [before, *others]), after  # from where the other types have it too


def _ranked(reached: FloatArray, among: NDArray[np.bool_], rank: int) -> Integers:
    """Find the lens whose bisector is reached as the rank-th among some, per row; the origin for rank 0."""
    if rank == 0:
        return np.full(len(reached), _ORIGIN)
    chosen = np.flatnonzero(among)
    return chosen[np.argpartition(reached[:, chosen], rank - 1, axis=-1)[:, rank - 1]]


def _outermost(depth: FloatArray, candidates: list[Integers]) -> Integers:
    """The lens with the greatest depth among several, per row; the origin only where there is no other."""
    rows = np.arange(len(depth))
    depths = np.stack([np.where(lens == _ORIGIN, -np.inf, depth[rows, lens]) for lens in candidates])
    return np.asarray(np.stack(candidates)[np.argmax(depths, axis=0), rows])
