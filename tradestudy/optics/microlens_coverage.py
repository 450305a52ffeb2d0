"""Lattices of microlenses, and how many microlenses see a point.

A lens sees the point if the ray from the point through the centre of the lens comes from the pupil: if this centre lies
in the disc that the pupil projects through the image point onto the array. Over all positions, the fraction of points
with at least two lenses in a disc of radius r is the fraction whose second-nearest lens is within r. The points whose
second-nearest lens is the one at the origin form the second Brillouin zone of the lattice, which has the area of one
cell. Along the ray at angle φ, the lens at g becomes nearer than the origin at s_g(φ) = |g|/(2 cos(φ − φ_g)). So the
zone is the stretch between the smallest and the second smallest s_g, and

    P(n ≥ 2) = 1/cell ∮ ½ [min(r, s_2(φ))² − min(r, s_1(φ))²] dφ,

where in each wedge of the symmetric lattice, the same two lenses bound the zone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray

Layout = Literal["hexagonal", "square"]
# Angles closer than this differ only by rounding.
_SAME_ANGLE = 1e-12


@dataclass(frozen=True, kw_only=True)
class Lattice:
    """A lattice of unit pitch with a nearest neighbour on the x axis.

    ``sectors`` wedges of equal angle, the first from angle 0, are copies of each other by rotation and
    reflection; a sum over the plane is ``sectors`` times the sum over one of them. Along every ray in the first wedge,
    the first lens that becomes nearer than the origin is the neighbour on the x axis, and the second is the one at the
    distance ``second_distance`` and the angle ``second_angle`` [rad].
    """

    second_vector: tuple[float, float]
    cell_area: float
    sectors: int
    second_distance: float
    second_angle: float

    @property
    def wedge(self) -> float:
        """Angle of the fundamental wedge [rad]."""
        return 2 * math.pi / self.sectors

    def neighbours(self, reach: float) -> FloatArray:
        """Positions (n, 2) of the lenses within ``reach`` of the lens at the origin, without it."""
        span = math.ceil(reach / self.second_vector[1]) + 1
        i, j = (index.ravel() for index in np.mgrid[-2 * span : 2 * span + 1, -span : span + 1])
        positions = np.stack((i + j * self.second_vector[0], j * self.second_vector[1]), axis=-1)
        squared = np.sum(positions**2, axis=-1)
        within = (squared > 0) & (squared <= reach**2)
        return np.asarray(positions[within])


LATTICES: Final[dict[Layout, Lattice]] = {
    "hexagonal": Lattice(
        second_vector=(0.5, math.sqrt(3) / 2),
        cell_area=math.sqrt(3) / 2,
        sectors=12,
        second_distance=1.0,
        second_angle=math.pi / 3,
    ),
    "square": Lattice(
        second_vector=(0.0, 1.0),
        cell_area=1.0,
        sectors=8,
        second_distance=math.sqrt(2),
        second_angle=math.pi / 4,
    ),
}


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


# Radius over pitch from which on every point is seen by two lenses, on both layouts: the point that needs the largest
# disc is a lens itself, whose neighbours are one pitch away.
PAIR_COVERING_RADIUS: Final = 1.0
_HALVINGS: Final = 60  # of the interval in which a distance is sought, down to rounding
# Within this relative rounding, a radius counts as having reached the covering radius.
_ROUNDING: Final = 1e-14


def projected_radius_over_pitch(
    *,
    microlens_object_distance: ArrayLike,
    mla_distance: ArrayLike,
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
    pupil_ratio: float = 1.0,
) -> FloatArray:
    """Radius of the disc of light on the array, over the pitch: |a_L| A / (2 p (z − g a_L)).

    Parameters
    ----------
    microlens_object_distance
        Signed distance a_L from the main lens's image to the array [m]: positive for an image in front of the array
        (Keplerian), negative for one behind it (Galilean), −∞ for an object in the main lens's front focal plane.
    mla_distance
        Exit pupil to array, times g, z > 0 [m]; main lens to array for a thin lens.
    pupil_diameter
        Diameter A of the main lens's entrance pupil [m].
    microlens_pitch
        Distance between neighbouring lenses, p > 0 [m].
    pupil_ratio
        g, the diameter of the entrance pupil over that of the exit pupil: 1 for a thin lens, 0 for an exit pupil at
        infinity.

    Returns
    -------
    Radius over pitch [1], broadcast; |v| z / (2 b) when the f-numbers match as b_L/p = z/A. It is 0 for an
    image on the array and A/(2 g p) for one at infinity behind it.

    Raises
    ------
    OutOfRangeError
        For an image that is not behind the exit pupil (g a_L ≥ z), and for lengths that are not positive.
    """
    a_L = np.asarray(microlens_object_distance, dtype=np.float64)
    z, A, p = _positive(mla_distance, pupil_diameter, microlens_pitch)
    if not np.all(np.where(a_L > 0.0, pupil_ratio * a_L, 0.0) < z):
        raise OutOfRangeError(
            "image of the main lens relative to the array",
            value=f"{np.max(a_L):g} m in front of the array",
            limit="less than the distance from main lens to array",
            remedy="move the object beyond the front focal point of the main lens",
        )
    # a_L/(z − g a_L) written so that an image at infinity behind the array gives its limit −1/g.
    with np.errstate(divide="ignore"):
        ratio = np.where(a_L == 0, 0.0, 1 / (z / a_L - pupil_ratio))
    return np.asarray(np.abs(ratio) * A / (2 * p))


def lit_radius_over_pitch(
    radius_over_pitch: ArrayLike, *, lens_radius_over_pitch: float, least_share: float
) -> FloatArray:
    """Largest distance of the centre of a microlens from that of the disc of light at which it is lit well enough.

    Well enough means by at least a share of the light of the best-lit microlens: by the area in which disc and aperture
    overlap, over that of the smaller of the two. For shares towards 0, the distance is the sum of both radii, where
    light begins to enter; for 1 it is their difference.

    Parameters
    ----------
    radius_over_pitch
        Radius of the disc of light R over the pitch [1], at least 0; NaN is returned for NaN.
    lens_radius_over_pitch
        Radius of the aperture of a microlens r over the pitch [1], above 0.
    least_share
        The share, above 0 and at most 1.

    Returns
    -------
    Distance over pitch [1], to rounding, in the shape of ``radius_over_pitch``.

    Notes
    -----
    Averaged over all positions of the point, the shares of the light of one filled microlens add up to the number of
    centres in the disc: ``π R² · π r²/(π r² · cell)``. A count of centres is therefore the number of microlenses that
    would be filled by the same light, and a count of partly lit ones is larger for shares below about one half.
    """
    R, r = np.asarray(radius_over_pitch, dtype=np.float64), lens_radius_over_pitch
    least = least_share * math.pi * np.square(np.minimum(R, r))
    # The common area falls from that of the smaller disc to 0 between these distances.
    low, high = np.abs(R - r), R + r
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        enough = _common_area(middle, R, r) >= least
        low, high = np.where(enough, middle, low), np.where(enough, high, middle)
    return np.asarray(low)


def _common_area(apart: FloatArray, first: FloatArray, second: float) -> FloatArray:
    """Area in which two discs overlap whose centres lie between the difference and the sum of their radii apart."""
    chord = (np.square(apart) + np.square(first) - second**2) / (2.0 * np.maximum(apart, 1e-300))
    near, far = np.clip(chord, -first, first), np.clip(apart - chord, -second, second)

    def segment(radius: ArrayLike, distance: FloatArray) -> FloatArray:
        ratio = np.clip(distance / np.maximum(radius, 1e-300), -1.0, 1.0)
        return np.asarray(np.square(radius) * (np.arccos(ratio) - ratio * np.sqrt(1.0 - np.square(ratio))))

    return segment(first, near) + segment(second, far)


def covering_microlens_object_distance(
    radius_over_pitch: ArrayLike,
    *,
    keplerian: bool,
    mla_distance: ArrayLike,
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
    pupil_ratio: float = 1.0,
) -> FloatArray:
    """Signed a_L at which the disc of light has a given radius: a_L = ±2 r p z / (A ± 2 r p g).

    The inverse of `projected_radius_over_pitch` for one sign of the relay. With the radius `PAIR_COVERING_RADIUS`,
    it is the total covering plane, beyond which two lenses see every point: images farther in front of the array for a
    Keplerian relay, farther behind it for a Galilean one.

    Parameters
    ----------
    radius_over_pitch
        Radius of the disc over the pitch [1].
    keplerian
        Whether the image lies in front of the array.
    mla_distance, pupil_diameter, microlens_pitch, pupil_ratio
        As in `projected_radius_over_pitch`.

    Returns
    -------
    Signed distance [m], broadcast; −∞ for a Galilean relay where 2 r p reaches the diameter of the exit pupil exactly.

    Raises
    ------
    OutOfRangeError
        For a Galilean relay whose pupil is smaller than the requested disc: no image behind the array reaches it.
    """
    z, A, p = _positive(mla_distance, pupil_diameter, microlens_pitch)
    disc = 2 * np.asarray(radius_over_pitch, dtype=np.float64) * p
    wider = pupil_ratio * disc
    if keplerian:
        return np.asarray(disc * z / (A + wider))
    if np.any(wider > A):
        raise OutOfRangeError(
            "diameter of the disc of light on the array",
            value=f"{np.max(disc):g} m",
            limit=f"≤ {np.min(A) / pupil_ratio:g} m, the diameter of the exit pupil, for a Galilean relay",
            remedy="open the aperture or take a smaller microlens pitch",
        )
    with np.errstate(divide="ignore"):  # an image at infinity is a valid limit
        return np.asarray(-disc * z / (A - wider))


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


def pair_probability(radius_over_pitch: FloatArray, *, layout: Layout) -> FloatArray:
    """Probability, over all positions of a point, that at least two microlenses see it.

    Parameters
    ----------
    radius_over_pitch
        Radius of the disc that the pupil projects onto the array through the image point, over the pitch [1], any
        shape. With matched f-numbers it is |v|/2 · z/b.
    layout
        ``hexagonal`` or ``square``.

    Returns
    -------
    Probability [1], in the shape of ``radius_over_pitch``.

    Notes
    -----
    Closed form, exact up to rounding (below 1e-13 absolute). It is exactly 0 up to half a pitch, and exactly 1 from
    `PAIR_COVERING_RADIUS` on. A lens counts when its centre is in the disc.
    """
    lattice = LATTICES[layout]
    within = np.minimum(radius_over_pitch, PAIR_COVERING_RADIUS)
    outer = _area_before_bisector(within, lattice.second_distance, lattice.second_angle, lattice.wedge)
    area = outer - _area_before_bisector(within, 1.0, 0.0, lattice.wedge)
    covered = radius_over_pitch >= PAIR_COVERING_RADIUS * (1 - _ROUNDING)
    return np.where(covered, 1.0, np.clip(area * (lattice.sectors / lattice.cell_area), 0.0, 1.0))


def _area_before_bisector(radius: FloatArray, distance: float, angle: float, wedge: float) -> FloatArray:
    """∫ ½ min(r, s(φ))² dφ over the wedge from 0, where s is the bisector of the origin and one lens."""
    ratio = np.divide(distance, 2 * radius, out=np.ones_like(radius), where=distance < 2 * radius)
    half_angle = np.arccos(ratio)  # the circle lies beyond the bisector this far to each side of the lens
    first, last = (np.clip(angle + side * half_angle, 0.0, wedge) - angle for side in (-1, 1))
    inside = (distance / 2) ** 2 * (np.tan(last) - np.tan(first))
    outside = radius**2 * (wedge - (last - first))
    return np.asarray(0.5 * (inside + outside))


def mean_seen_count(radius_over_pitch: FloatArray, *, layout: Layout) -> FloatArray:
    """Mean number of microlenses that see a point: area of the disc over that of a cell.

    On a hexagonal array with matched f-numbers, it is 0.907 v² for b ≈ z. Exact at every radius: each lens
    is in the disc for a fraction of positions equal to the area of the disc over that of the cell.
    """
    return np.asarray(math.pi * radius_over_pitch**2 / LATTICES[layout].cell_area)
