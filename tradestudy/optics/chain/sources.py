"""Extended sources: a disc, its quadrature nodes, the symmetries that save most of them, and spectral shares."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.arguments import checked
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy
from tradestudy.optics.chain.microlens_nodes import plane_wave_degree, plane_wave_degrees
from tradestudy.optics.chain.scene import LightPath
from tradestudy.optics.propagation.lens import PointSource
from tradestudy.optics.quadrature import gauss_legendre, ring_angles

_LARGEST_PHASE = 3e3
Symmetry = tuple[int, int, bool]  # signs of x and y, then whether x and y are swapped


@checked
@dataclass(frozen=True, kw_only=True)
class DiscSource:
    """A disc of uniform brightness, parallel to the plane of the main lens.

    Parameters
    ----------
    diameter
        Diameter [m], > 0.
    distance
        Distance in front of the main lens [m], > 0.
    x, y
        Transverse position of the centre [m], in the same coordinates as the centre of the lens.
    coherent
        False: the points of the disc radiate independently, so their intensities add. True: the whole disc emits one
        wave, with the same phase at every point.

    Raises
    ------
    OutOfRangeError
        If the diameter or the distance is not positive, or a number is not finite.

    Examples
    --------
    >>> from tradestudy import optics
    >>> optics.DiscSource(diameter=4e-3, distance=0.15).centre.distance
    0.15
    """

    diameter: float
    distance: float
    x: float = 0.0
    y: float = 0.0
    coherent: bool = False

    def __post_init__(self) -> None:
        if not (self.diameter > 0 and math.isfinite(self.diameter)):
            raise OutOfRangeError(
                "diameter of the source",
                value=f"{self.diameter:g} m",
                limit="> 0, finite",
                remedy="use a PointSource for a point",
            )
        if not self.distance > 0:
            raise OutOfRangeError(
                "distance of the source", value=f"{self.distance:g} m", limit="> 0", remedy="measure it from the lens"
            )
        self.centre  # noqa: B018  (refuses a position that is not finite)

    @property
    def centre(self) -> PointSource:
        """Centre of the disc, as a point source."""
        return PointSource(x=self.x, y=self.y, distance=self.distance)


@dataclass(frozen=True, kw_only=True)
class SourceNodes:
    """Polar nodes on a disc, ring by ring, with fewer nodes on smaller rings; the weights sum to 1.

    Attributes
    ----------
    radial_points, radial_weights
        Gauss–Legendre nodes in the squared relative radius, in (0, 1), and weights.
    rings
        Node positions (x, y) of each ring, shape (angles, 2) [m].
    """

    radial_points: FloatArray
    radial_weights: FloatArray
    rings: tuple[FloatArray, ...]

    @property
    def all(self) -> FloatArray:
        """Every node, shape (nodes, 2) [m]."""
        return np.concatenate(self.rings)


def source_nodes(path: LightPath, source: DiscSource, *, wavelength: float, density: float) -> SourceNodes:
    """Place nodes that resolve how the light on a pixel changes as the source point moves.

    A microlens sees the source through the part of the pupil that lights it; the width w of this part is that of the
    microlens times |b/a_L|, at most the whole pupil. As a function of the source point, the light has no frequency
    above the cutoff of that part, w/(λ a).

    Parameters
    ----------
    path, source, wavelength
        Camera, disc, wavelength.
    density
        Fraction of that cutoff to resolve.
    """
    depth = abs(path.image_at_array(source.centre)[2])
    image = abs(path.array_distance - path.image_at_array(source.centre)[2])
    pupil = 2 * path.main_lens.radius
    width = min(pupil, 2 * path.microlenses.cell_reach * image / depth) if depth > 0 else pupil
    phase = density * math.pi * source.diameter * width / (wavelength * source.distance)
    if phase > _LARGEST_PHASE:
        raise UnaffordableError(
            "points of the source",
            value=f"a phase of {phase:.2g} rad from the middle of the disc to its edge",
            limit=f"{_LARGEST_PHASE:g} rad, about a million points",
            remedy="use a smaller disc, or rays on both legs",
        )
    points, weights = gauss_legendre(max(4, plane_wave_degree(phase) // 4 + 2))
    return SourceNodes(
        radial_points=points,
        radial_weights=weights,
        rings=_rings(source, np.sqrt(points), phase),
    )


def spectral_shares(wavelengths: FloatArray, weights: FloatArray) -> FloatArray:
    """Shares of the light at each wavelength, which sum to 1.

    Raises
    ------
    OutOfRangeError
        If shapes differ, or a weight is negative, infinite or not a number, or all are zero.
    """
    if wavelengths.ndim != 1 or wavelengths.shape != weights.shape or wavelengths.size == 0:
        raise OutOfRangeError(
            "spectrum",
            value=f"shapes {wavelengths.shape}, {weights.shape}",
            limit="two arrays of shape (n,), n ≥ 1",
            remedy="give one weight for each wavelength",
        )
    if not (np.all(weights >= 0) and np.isfinite(weights).all() and weights.any()):
        raise OutOfRangeError(
            "spectral weights",
            value=str(weights),
            limit="≥ 0, finite, not all zero",
            remedy="give the power at each wavelength",
        )
    relative = weights / weights.max()  # the sum of the largest floats overflows
    return np.asarray(relative / relative.sum())


def tolerated_density(accuracy: ChainAccuracy) -> float:
    """Fraction of the cutoff that must be resolved for a tolerance."""
    return min(1.0, 0.63 * math.pow(1e-2 / accuracy.tolerance, 1 / 6))


def _rings(source: DiscSource, relative_radii: FloatArray, phase: float) -> tuple[FloatArray, ...]:
    """Equally spaced nodes, a multiple of eight for the symmetries of a square array."""
    counts = 8 * np.maximum(2, -(-(plane_wave_degrees(phase * relative_radii) + 1) // 8))
    angle = ring_angles(counts)
    radius = np.repeat(source.diameter / 2 * relative_radii, counts)
    positions = np.column_stack([source.x + radius * np.cos(angle), source.y + radius * np.sin(angle)])
    return tuple(np.split(positions, np.cumsum(counts)[:-1]))


def symmetries(path: LightPath, source: DiscSource) -> list[Symmetry]:
    """Reflections and quarter turns that leave lenses, pixels and the disc unchanged; the identity comes first."""
    if not all(pupil.round for pupil in path.pupils):
        return [(1, 1, False)]
    candidates: list[Symmetry] = [(sx, sy, swap) for swap in (False, True) for sx in (1, -1) for sy in (1, -1)]
    return [symmetry for symmetry in candidates if _leaves(path, source, symmetry)]


def moved(points: FloatArray, symmetry: Symmetry) -> FloatArray:
    """Apply a symmetry to points (…, 2)."""
    sx, sy, swap = symmetry
    signed = points * np.array([sx, sy])
    return np.asarray(signed[..., ::-1] if swap else signed)


def moved_image(pixels: FloatArray, symmetry: Symmetry) -> FloatArray:
    """Apply a symmetry to images on the last two axes: the light of each point moves to its `moved` position."""
    sx, sy, swap = symmetry
    flipped = pixels[..., :: 1 if sy > 0 else -1, :: 1 if sx > 0 else -1]
    return np.asarray(flipped.swapaxes(-1, -2) if swap else flipped)


def orbits(nodes: SourceNodes, ring: int, group: list[Symmetry]) -> Iterator[tuple[int, int]]:
    """One node of each set of nodes that the symmetries map onto each other, and the size of the set."""
    points = nodes.rings[ring]
    scale = 1e-6 * float(np.ptp(points[:, 0]) + np.ptp(points[:, 1]))
    places = np.rint(np.stack([moved(points, symmetry) for symmetry in group], axis=1) / scale).astype(np.int64)
    visited: set[tuple[int, int]] = set()
    for index, images in enumerate(places.tolist()):
        place, *_ = copies = [(x, y) for x, y in images]  # the identity comes first
        if place not in visited:
            orbit = set(copies)
            visited |= orbit
            yield index, len(orbit)


def lens_orbits(centres: FloatArray, group: list[Symmetry]) -> Iterator[tuple[int, list[Symmetry]]]:
    """One microlens of each set that the symmetries map onto each other, and the symmetries that yield the set."""
    remaining = set(range(len(centres)))
    while remaining:
        index = min(remaining)
        copies: dict[int, Symmetry] = {}
        for symmetry in group:
            nearest = int(np.argmin(np.linalg.norm(centres - moved(centres[index], symmetry), axis=1)))
            copies.setdefault(nearest, symmetry)
        remaining -= copies.keys()
        yield index, list(copies.values())


def _leaves(path: LightPath, source: DiscSource, symmetry: Symmetry) -> bool:
    """Whether a symmetry leaves the whole light path unchanged."""
    lenses, pixels = path.microlenses, path.pixels
    if symmetry[2] and (lenses.layout == "hexagonal" or pixels.shape[0] != pixels.shape[1]):
        return False
    slack = 1e-9 * lenses.pitch
    for point in (pixels.centre, (source.x, source.y)):
        if np.max(np.abs(moved(np.asarray(point), symmetry) - point)) > slack:
            return False
    distance = np.linalg.norm(moved(lenses.centres, symmetry)[:, None] - lenses.centres, axis=-1)
    partner = np.argmin(distance, axis=1)
    same_focus = np.array_equal(lenses.focal_lengths[partner], lenses.focal_lengths)
    return bool(np.all(distance.min(axis=1) < slack) and same_focus)
