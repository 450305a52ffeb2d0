"""The baseline that the microlenses seeing a point offer, and the lengths of their pairs.

All depth estimators are put on one scale. For a baseline B in the plane of the array, the error of the virtual depth is

    σ_v = √2 v² σ_u / B,    with B and σ_u (error of one micro-image coordinate) in the same unit.

An adjacent pair has B = p. Least squares over all lenses, with both coordinates of each, has
σ_v = v² σ_u/√(Σ|x − x̄|²), so B = √(2 Σ|x − x̄|²); for two lenses, both rules give their distance. Which lenses see a
point depends on its position, so B is defined by the mean square error: 1/B² is the mean of 1/B(x)² over the positions
with a pair.

Consider points along a ray from one lens at angle φ, each with the disc around it that just reaches back to that lens.
The lens at g enters the disc at the distance s_g(φ) = |g|/(2 cos(φ − φ_g)), so the set of lenses only grows along the
ray. The integral over a cell of any function h of this set is therefore

    ∫ h dA = ∫dφ Σ_j (h(with origin) − h(without)) ½ [min(r, s_{j+1})² − min(r, s_j)²],

which is piecewise linear in r² on each ray. The angle is integrated over the symmetric wedge by Gauss–Legendre rules
between the angles at which the order of the lenses near the origin changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.microlens_coverage import (
    LATTICES,
    Layout,
    distance_to_bisector,
    order_changes,
)

JudgedPairs = Literal["widest-pair", "least-squares"]

# The table ends here; beyond, a disc holds more than 130 lenses and the law for many lenses takes over.
_TABLE_RADIUS: Final = 6.0

# Order changes farther out than this only move small steps of the integrand.
_RESOLVED_RADIUS: Final = 3.0

# Gauss–Legendre nodes per interval of angle. Half as many would change the baseline by up to 6e-4 of it.
_NODES: Final = 4


def equivalent_baseline(radius_over_pitch: FloatArray, *, layout: Layout, judged: JudgedPairs) -> FloatArray:
    """Baseline B over the pitch [1] of the pair of lenses that would have the same mean square error of depth.

    It is averaged over the positions that have a pair; their fraction is `pair_probability`.

    Parameters
    ----------
    radius_over_pitch
        Radius of the disc of light on the array over the pitch, ≥ 0 [1], any shape.
    layout
        ``hexagonal`` or ``square``.
    judged
        ``widest-pair``: the longest pair of lenses that see a point. With matched f-numbers, σ_v/(σ_u/p) is 1.5–1.6 |v|
        for |v| from 4 to 6, and more below. For large discs B → 2 r. ``least-squares``: all lenses together, with both
        coordinates, B = √(2 Σ|x − x̄|²). With matched f-numbers, σ_v/(σ_u/p) = √2 v²/(B/p) falls to 4 √(2A/π) = 2.97
        for a hexagonal array (where A is the area of a cell over p²), independent of v; B → r² √(π/A). This assumes
        that all counted lenses form sharp images.

    Returns
    -------
    B/p, in the shape of the radius; NaN where no position has a pair (radius over pitch ≤ 1/2). Beyond six pitches, the
    deficit from the limit of large discs is extrapolated, and may be wrong by half of it: for the widest pair as
    r^(−8/5), the law of the nearest miss among lattice points in a thin lens-shaped area ∝ √r δ^(3/2), and for least
    squares as r⁻².
    """
    return _table(layout, judged).at(radius_over_pitch)


@dataclass(frozen=True, kw_only=True)
class _Estimator:
    """Baseline of an estimator as a function of the set of lenses."""

    gain: Callable[[FloatArray], FloatArray]
    """1/B² with the lens at the origin less 1/B² without, for sets that grow along each ray."""
    limit: Callable[[FloatArray, float], FloatArray]
    """B of a large disc, from its radius and the area of a cell."""
    deficit_exponent: float
    """How the relative distance from the limit falls with the radius."""


@dataclass(frozen=True, kw_only=True)
class _Table:
    """B² over squared radius, up to the table's end, and the law beyond."""

    squared_radius: FloatArray
    sum_of_inverse_squares: FloatArray
    share: FloatArray
    estimator: _Estimator
    cell_area: float

    def at(self, radius: FloatArray) -> FloatArray:
        near = self.within(np.minimum(radius, _TABLE_RADIUS))
        limit = self.estimator.limit(np.maximum(radius, _TABLE_RADIUS), self.cell_area)
        at_end = self.estimator.limit(np.asarray(_TABLE_RADIUS), self.cell_area)
        deficit_at_end = 1 - self.within(np.asarray(_TABLE_RADIUS)) / at_end
        growth = np.maximum(radius, _TABLE_RADIUS) / _TABLE_RADIUS
        deficit = deficit_at_end * growth**-self.estimator.deficit_exponent
        return np.where(radius > _TABLE_RADIUS, limit * (1 - deficit), near)

    def within(self, radius: FloatArray) -> FloatArray:
        share = np.interp(radius**2, self.squared_radius, self.share)
        inverse = np.interp(radius**2, self.squared_radius, self.sum_of_inverse_squares)
        ratio = np.divide(share, inverse, out=np.full(share.shape, np.nan), where=(radius > 0.5) & (inverse > 0))
        return np.asarray(np.sqrt(ratio))


@lru_cache(maxsize=8)
def _table(layout: Layout, judged: JudgedPairs) -> _Table:
    """Tabulate one estimator on one lattice: means over all positions of 1/B² (0 without a pair), and of having one."""
    estimator = _ESTIMATORS[judged]
    positions, squared_reach, weight = _rays(layout)
    gain = estimator.gain(positions)
    has_pair = np.zeros_like(gain)  # the lens at the origin completes a pair only where there is one other
    has_pair[:, 0] = 1.0
    squared_radius, inverse_squares, share = _integrate(squared_reach, weight, gain, has_pair)
    return _Table(
        squared_radius=squared_radius,
        sum_of_inverse_squares=inverse_squares,
        share=share,
        estimator=estimator,
        cell_area=LATTICES[layout].cell_area,
    )


def _integrate(
    squared_reach: FloatArray, weight: FloatArray, gain: FloatArray, has_pair: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sum over the stretches of all rays: piecewise linear in r², with a kink where a lens enters."""
    order = np.argsort(squared_reach, axis=None)
    arrival = squared_reach.ravel()[order]

    def accumulated(step: FloatArray) -> FloatArray:
        kink = (np.diff(step, prepend=0.0, axis=-1) * weight[:, np.newaxis]).ravel()[order]
        return np.concatenate(([0.0], np.cumsum(np.cumsum(kink)[:-1] * np.diff(arrival))))

    return arrival, accumulated(gain), accumulated(has_pair)


def _rays(layout: Layout) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lenses in order of entry, shape (rays, lenses, 2), their squared distances of entry, and weights of the rays."""
    lattice = LATTICES[layout]
    positions = lattice.neighbours(2 * _TABLE_RADIUS + 2)
    breaks = order_changes(lattice, positions, within=_RESOLVED_RADIUS)
    node, share = np.polynomial.legendre.leggauss(_NODES)
    half = 0.5 * np.diff(breaks)[:, np.newaxis]
    direction = (breaks[:-1, np.newaxis] + half * (1 + node)).ravel()
    arrival = distance_to_bisector(positions, direction)
    order = np.argsort(arrival, axis=-1)
    arrival = np.take_along_axis(arrival, order, axis=-1)
    count = int(np.max(np.sum(arrival <= _TABLE_RADIUS, axis=-1))) + 1
    weight = (half * share).ravel() * lattice.sectors / (2 * lattice.cell_area)
    return positions[order[:, :count]], arrival[:, :count] ** 2, weight


def _widest_pair_gain(positions: FloatArray) -> FloatArray:
    """1/B² of the longest pair with the lens at the origin minus that without it (0 without a pair)."""
    with_origin = np.maximum.accumulate(np.sum(positions**2, axis=-1), axis=-1)
    newest = np.empty_like(with_origin)
    for ray, (x, y) in enumerate(np.moveaxis(positions, -1, 1)):  # one ray at a time keeps the pairs in the cache
        squared = (x[:, np.newaxis] - x) ** 2 + (y[:, np.newaxis] - y) ** 2
        newest[ray] = np.max(np.tril(squared), axis=-1)
    without = np.maximum.accumulate(newest, axis=-1)
    return 1 / np.maximum(with_origin, without) - _inverse(without)


def _least_squares_gain(positions: FloatArray) -> FloatArray:
    """1/(2 Σ|x − x̄|²) with the lens at the origin minus that without it (0 without a pair)."""
    count = np.arange(1, positions.shape[1] + 1)
    about_origin = np.cumsum(np.sum(positions**2, axis=-1), axis=-1)
    squared_sum = np.sum(np.cumsum(positions, axis=1) ** 2, axis=-1)
    with_origin = about_origin - squared_sum / (count + 1)
    without = np.where(count > 1, about_origin - squared_sum / count, 0.0)
    return np.asarray(0.5 * (1 / with_origin - _inverse(without)))


def _inverse(value: FloatArray) -> FloatArray:
    """1/x, and 0 at 0: a set without a pair adds nothing to the sum."""
    return np.divide(1.0, value, out=np.zeros_like(value), where=value > 0)


_ESTIMATORS: Final[dict[JudgedPairs, _Estimator]] = {
    "widest-pair": _Estimator(gain=_widest_pair_gain, limit=lambda radius, _: 2 * radius, deficit_exponent=8 / 5),
    "least-squares": _Estimator(
        gain=_least_squares_gain,
        limit=lambda radius, cell_area: radius**2 * math.sqrt(math.pi / cell_area),
        deficit_exponent=2.0,
    ),
}


# Radius with hundreds of different lengths; larger discs use the same lengths, scaled.
_LARGEST_RADIUS: Final = 6.0


@dataclass(frozen=True, kw_only=True)
class PairLengths:
    """Pairs of lenses sorted by length, shape (lengths, radii)."""

    over_pitch: FloatArray
    """D/p [1]."""
    share: FloatArray
    """Share of the information of all pairs, with windows of the same size [1]: sums to 1, or is 0 without pairs."""


def least_squares_pairs(radius_over_pitch: FloatArray, *, layout: Layout) -> PairLengths:
    """Fraction of the information on depth that pairs of each length carry in least squares over all lenses.

    ``Σ_i |x_i − x̄|² = (1/k) Σ_{i<j} |x_i − x_j|²`` for k lenses: least squares carries the information of all pairs
    together, each in proportion to the square of its length D. A disc of radius r at a random position contains both
    lenses of a pair in proportion to C(D), the area common to two such discs a distance D apart. So pairs of one length
    count in proportion to their number around one lens times ``D² C(D)``, with ``C = 2 r² (arccos u − u √(1 − u²))``
    and ``u = D/2r``.

    Parameters
    ----------
    radius_over_pitch
        r/p, shape (radii,).
    layout
        ``hexagonal`` or ``square``.

    Notes
    -----
    1/k differs between positions of the disc, but is taken as equal for all. Windows that follow from these fractions
    are at most 8 % smaller (near r/p = 1.1) than those from the mean square error over positions, and at most 2 % from
    r/p = 1.3 on.
    """
    within = np.minimum(radius_over_pitch, _LARGEST_RADIUS)
    growth = np.maximum(radius_over_pitch / _LARGEST_RADIUS, 1.0)
    length, number = _shells(layout)
    with np.errstate(divide="ignore"):  # no disc, no pair
        u = np.minimum(length[:, np.newaxis] / (2.0 * within), 1.0)
    pairs = (number * length**2)[:, np.newaxis] * (np.arccos(u) - u * np.sqrt(1.0 - u * u))
    whole = np.sum(pairs, axis=0)
    return PairLengths(over_pitch=length[:, np.newaxis] * growth, share=pairs / np.where(whole > 0.0, whole, 1.0))


@lru_cache(maxsize=4)
def _shells(layout: Layout) -> tuple[FloatArray, FloatArray]:
    """Distances of the lenses around one lens, and how many lie at each."""
    positions = LATTICES[layout].neighbours(2.0 * _LARGEST_RADIUS)
    squared, number = np.unique(np.round(np.sum(positions**2, axis=-1), 6), return_counts=True)
    return np.sqrt(squared), number.astype(np.float64)
