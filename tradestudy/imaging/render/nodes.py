"""Sample points on a pixel and on the lit part of a lens.

The lit part of a lens is the overlap of two discs, as seen from the pixel: its own aperture and that of the stop. Nodes
of the unit disc are mapped to it along the line through both centres, where half the height of the overlap is known in
closed form. So no node is wasted, and the weight of a node is the Jacobian of the map.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from tradestudy.cameras.light_cones import LightCones, Stop
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray

LEAST_NODES: Final = 4
_MOST_ON_RING: Final = 15
_GOLDEN: Final = 0.381966  # of a turn: neighbours along one ring are far apart along the other
# Root of x⁴ = x + 1: modulo 1, multiples of its inverse powers fill a cube evenly.
_CUBIC: Final = 1.22074408460575947536
_FILTER: Final = 3.0  # variance of a node's filter, in units of the whole variance over the number of nodes
_DARK: Final = 1e-7  # weight of an unlit node, over the squared radius of the lens
_SMALLEST_SCALE: Final = (
    1e-6  # of the change at the stop with the place on the lens; below it, the stop counts as infinitely far
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Nodes:
    """Places on a unit pixel (side 1) and a unit disc (radius 1), both centred on 0.

    Parameters
    ----------
    pixel, disc
        Shape (nodes, 2).
    pixel_spread, disc_spread
        Variance along one axis that is left to the filter of each node, of 1/12 and 1/4 in all.
    """

    pixel: FloatArray
    disc: FloatArray
    pixel_spread: float
    disc_spread: float


@cache
def nodes(count: int) -> Nodes:
    """Nodes spread evenly over both areas, with zero mean and the areas' covariance minus a part.

    A filter on what each node sees makes up for that part, so that first and second moments are exact for any number
    of nodes. If the part were 1/n, the filters of neighbouring nodes would hardly touch; at three times that, the
    picture of a texture comes closest to one with many nodes.

    Few nodes form the centre and a ring on each area. The nodes go round one ring several times while they go round
    the other once, so that their sum remains a ring at every amount of blur. From 6 to 16 nodes, this errs less than a
    spiral, by a third with 12. More nodes, or a number without such rings, follow a spiral on the disc and the R₃
    sequence.

    Raises
    ------
    OutOfRangeError
        There are fewer than four.
    """
    if count < LEAST_NODES:
        raise OutOfRangeError("samples of a pixel", value=str(count), limit=f"{LEAST_NODES} or more")
    turns = _turns(count - 1)
    places = _spiral(count) if turns is None else _rings(count - 1, turns)
    part = min(_FILTER / count, 0.5)
    whole = np.sqrt(np.array([1.0, 1.0, 3.0, 3.0]) * (1.0 - part) / 12.0)
    places -= places.mean(axis=0)
    if count > places.shape[1]:  # fewer nodes cannot span both areas
        # The smallest change that gives the required covariance: the symmetric square root.
        values, vectors = np.linalg.eigh(np.cov(places.T, bias=True) / np.outer(whole, whole))
        places = places / whole @ (vectors / np.sqrt(values)) @ vectors.T * whole
    else:
        places *= whole / places.std(axis=0)
    return Nodes(pixel=places[:, :2], disc=places[:, 2:], pixel_spread=part / 12.0, disc_spread=part / 4.0)


def _turns(ring: int) -> int | None:
    """How many times a ring of nodes turns on the pixel while it turns once on the disc; None if no number works.

    A number of turns that divides the ring would repeat places, and ±1 would always move both alike.
    """
    if ring > _MOST_ON_RING:
        return None
    possible = [turns for turns in range(2, (ring + 1) // 2) if math.gcd(turns, ring) == 1]
    return min(possible, key=lambda turns: abs(turns - _GOLDEN * ring), default=None)


def _rings(ring: int, turns: int) -> FloatArray:
    """Directions on the pixel and the disc, shape (ring + 1, 4), the centre first."""
    angle = 2.0 * np.pi * np.arange(ring) / ring
    around = np.stack([np.cos(turns * angle), np.sin(turns * angle), np.cos(angle), np.sin(angle)], axis=-1)
    return np.concatenate([np.zeros((1, 4)), around])


def _spiral(count: int) -> FloatArray:
    """Places on the pixel and the disc, shape (count, 4)."""
    k = np.arange(count)
    angle, across, down = (0.5 + k / _CUBIC**power for power in (1, 2, 3))
    radius, angle = np.sqrt((k + 0.5) / count), 2.0 * np.pi * angle
    pixel = np.stack([across, down], axis=-1) % 1.0 - 0.5
    return np.concatenate([pixel, np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)], axis=-1)


def fewer(count: int) -> int:
    """Number of nodes for a barely lit lens, given the full number."""
    return max(LEAST_NODES, count // 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class LitPart:
    """The lit parts of lenses, from ``low`` to ``low + 2 half`` along ``axis`` from the centre of each lens [m].

    Parameters
    ----------
    axis
        Unit vector from the centre of the lens to that of the stop as seen there, shape (2, cones).
    near, width
        Near edge and width of the stop along that axis; None without a stop.
    low, half
        Start of the overlap, and half its length; 0 or less if nothing is lit.
    """

    axis: FloatArray
    near: FloatArray | None
    width: FloatArray | None
    low: FloatArray
    half: FloatArray


def lit_part(cones: LightCones, pixel_x: float, pixel_y: float) -> LitPart:
    """The lit part of each cone's lens, seen from a place [m] on its pixel."""
    r, stop = cones.lens_radius, cones.stop
    kind = cones.start.dtype.type
    if stop is None:
        size = cones.start.shape[1]
        axis = np.zeros((2, size), kind)
        axis[0] = 1.0
        return LitPart(axis=axis, near=None, width=None, low=np.full(size, -r, kind), half=np.full(size, r, kind))
    moved = np.stack([np.asarray(stop.by_pixel * pixel_x), np.asarray(stop.by_pixel * pixel_y)]).reshape(2, -1)
    place = stop.place + moved.astype(stop.place.dtype)
    by_lens = _by_lens(stop)
    distance = np.sqrt(place[0] * place[0] + place[1] * place[1])
    axis = place * (-np.sign(by_lens) / np.maximum(distance, kind(1e-12)))
    scale = np.abs(by_lens)
    # Measured from the near edge, so that a stop much larger than the lens costs no digits.
    near = (distance - kind(stop.radius)) / scale
    width = kind(2.0 * stop.radius) / scale
    low = np.maximum(near, kind(-r))
    return LitPart(axis=axis, near=near, width=width, low=low, half=(np.minimum(near + width, kind(r)) - low) / 2)


def places_on_lens(lit: LitPart, radius: float, across: float, beside: float) -> tuple[FloatArray, FloatArray]:
    """Map a node of the unit disc to the lit parts: places η from the lens centres, shape (2, cones), and weights.

    π times the mean weight of the nodes tends to the lit area [m²]. If no light reaches this place of the pixel, the
    weight is tiny and the place is the point of the lens nearest to the light, so that a pixel lit only in a corner
    without a node still sees the scene there.
    """
    kind = lit.low.dtype.type
    half = np.maximum(lit.half, 0)
    t = np.minimum(lit.low + half * kind(1.0 + across), kind(radius))
    height = _half_height(lit, radius, t) * kind(1.0 / np.sqrt(max(1.0 - across * across, 1e-12)))
    y = height * kind(beside)
    ax, ay = lit.axis
    return np.stack([t * ax - y * ay, t * ay + y * ax]), half * height + kind(_DARK * radius * radius)


def equal_disc(lit: LitPart, radius: float) -> FloatArray:
    """Squared radius [m²] of a disc about as large as the lit part: the product of its half axes."""
    half = np.maximum(lit.half, 0)
    return np.asarray(half * _half_height(lit, radius, lit.low + half))


def _half_height(lit: LitPart, radius: float, t: FloatArray) -> FloatArray:
    """Half the extent [m] of the lit part across its axis, at places t along it."""
    kind = lit.low.dtype.type
    squared = (kind(radius) - t) * (kind(radius) + t)
    if lit.near is not None and lit.width is not None:
        from_near = t - lit.near
        squared = np.minimum(squared, from_near * (lit.width - from_near))
    return np.asarray(np.sqrt(np.maximum(squared, 0)))


def lit_area(cones: LightCones, pixel_width: float) -> FloatArray:
    """Lit area [m²] of each cone's lens, averaged over a square pixel of a width [m].

    It is integrated by Gauss–Legendre, with more nodes if the edge of the light moves by more than the radius of the
    lens across the pixel.
    """
    r, stop = cones.lens_radius, cones.stop
    if stop is None:
        return np.full(cones.pixel.size, np.pi * r * r)
    place, by_lens = stop.place.astype(float), np.abs(_by_lens(stop).astype(float))
    by_pixel = np.abs(np.asarray(stop.by_pixel, float))
    distance = np.hypot(*place)
    reach = by_pixel * pixel_width * np.sqrt(0.5)
    whole = np.pi * np.minimum(np.square(r), np.square(stop.radius / by_lens))
    contained = distance + reach <= np.abs(stop.radius - by_lens * r)
    area = np.where(contained, whole, 0.0)
    edge = np.flatnonzero(~contained & (distance - reach < stop.radius + by_lens * r))
    scales = tuple(np.broadcast_to(scale, distance.shape)[edge] for scale in (by_pixel, by_lens))
    fine = bool(edge.size) and float(np.max(scales[0] / scales[1])) * pixel_width > r
    t, w = np.polynomial.legendre.leggauss(5 if fine else 2)
    for x, wx in zip(t, w, strict=True):
        for y, wy in zip(t, w, strict=True):
            moved = np.hypot(*(place[:, edge] + np.array([[x], [y]]) * (pixel_width / 2.0) * scales[0]))
            area[edge] += wx * wy / 4.0 * _overlap(moved / scales[1], r, stop.radius / scales[1])
    return area


def _by_lens(stop: Stop) -> FloatArray:
    """Change of the place at the stop with that on the lens; tiny instead of 0 for an infinitely distant stop."""
    by_lens = np.asarray(stop.by_lens, stop.place.dtype)
    return np.where(np.abs(by_lens) < _SMALLEST_SCALE, stop.place.dtype.type(_SMALLEST_SCALE), by_lens)


def _overlap(distance: FloatArray, first: float, second: FloatArray) -> FloatArray:
    """Area of the overlap of two discs."""
    apart = np.maximum(distance, 1e-12 * first)
    first_cosine = np.clip((apart**2 + first**2 - second**2) / (2.0 * apart * first), -1.0, 1.0)
    second_cosine = np.clip((apart**2 + second**2 - first**2) / (2.0 * apart * second), -1.0, 1.0)
    return np.asarray(
        first**2 * (np.arccos(first_cosine) - first_cosine * np.sqrt(1.0 - first_cosine * first_cosine))
        + second**2 * (np.arccos(second_cosine) - second_cosine * np.sqrt(1.0 - second_cosine * second_cosine))
    )
