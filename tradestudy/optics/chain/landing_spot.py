"""Image of an incoherent disc by waves to the array and rays behind it.

A pixel's share is the integral of the irradiance over the source points s and array points x whose light lands on it.
The landing point is linear in both. The inner integral is cut exactly along the edges of the pixels; it runs over the
plane that moves the landing point farther (source points where the microlenses are near focus, array points of a small
source). The outer one is smooth enough for a rule fitted to a disc or a cell.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage, refuse_pixel_centres, relative_change
from tradestudy.optics.chain.array_field import direct_field
from tradestudy.optics.chain.arriving_light import SourceTables, refuse_focus_on_array, source_tables
from tradestudy.optics.chain.detector_patch import lit_radius
from tradestudy.optics.chain.landing import (
    compared_settings,
    irradiance_frequency,
    landing_nodes,
    on_pixels,
    pixel_nodes,
)
from tradestudy.optics.chain.microlens_nodes import Disc, cell_nodes, tapered_disc_nodes
from tradestudy.optics.chain.scene import Legs, LightPath
from tradestudy.optics.chain.sources import (
    DiscSource,
    lens_orbits,
    moved_image,
    symmetries,
    tolerated_density,
)
from tradestudy.optics.propagation.lens import PointSource

_SAFETY = 1.5  # the two computations share some of their error
_FEWER = 0.7  # factor on source nodes and tables in the second computation
_CHECK_POINTS = 16
_CORNERS_BELOW = 3e-3  # tolerance below which columns are also cut where the disc's rim crosses the edge of a row
_SHARE_OF_FRINGES = 0.1  # fraction resolved on a pixel's share of the disc; array nodes average the rest


def landing_spot_image(
    path: LightPath,
    source: DiscSource,
    *,
    wavelength: float,
    legs: Legs,
    accuracy: ChainAccuracy,
    rng: np.random.Generator,
) -> ChainImage:
    """Image of an incoherent disc, averaged over its area, by waves to the array and rays behind it.

    Parameters
    ----------
    path, source
        Camera and disc.
    wavelength
        Wavelength [m].
    legs
        Law of the leg to the array; `to_detector` is geometric.
    accuracy
        Tolerance and sampling; `microlens_nodes` refines the array's nodes, `source_sampling` the disc's.
    rng
        Draws the points where the interpolated irradiance is checked against direct quadrature.

    Raises
    ------
    OutOfRangeError
        If the array lies in the focus of the main lens, or the pixels do not integrate.
    UnaffordableError
        If tables need more memory than allowed.
    NotConvergedError
        If Kirchhoff's integral misses the tolerance where it replaces a boundary wave.
    """
    refuse_pixel_centres(path.pixels)
    refuse_focus_on_array(path, source.centre, wavelength)
    compared = replace(legs, to_array="kirchhoff") if legs.to_array == "boundary_wave" else legs
    with ThreadPoolExecutor(2) as pool:
        fine, other = pool.map(
            lambda each: _landed(path, source, wavelength, *each), ((legs, accuracy), (compared, _coarser(accuracy)))
        )
    terms = {"other sampling": _SAFETY * relative_change(fine.pixels, other.pixels)}
    return ChainImage(
        pixels=fine.pixels,
        numerical_error=math.hypot(*terms.values()),
        error_terms=terms,
        direct_check={"irradiance on the array": _irradiance_check(fine.tables, source, rng)},
        microlens_share=fine.share,
        effort={"irradiances": fine.reads, "array samples": fine.tables.samples},
        handed_over=fine.tables.handed_over,
    )


def _coarser(accuracy: ChainAccuracy) -> ChainAccuracy:
    """Settings of the comparison image; a factor below 1 is compared with 1, as in `ChainAccuracy.compared`."""
    sampling = accuracy.source_sampling
    return replace(compared_settings(accuracy), source_sampling=_FEWER * sampling if sampling >= 1 else 1.0)


@dataclass(frozen=True, kw_only=True)
class _Landed:
    """Fractions on the pixels and on the array, and the tables from which they were computed."""

    tables: SourceTables
    pixels: FloatArray
    share: float
    reads: int


def _landed(path: LightPath, source: DiscSource, wavelength: float, legs: Legs, accuracy: ChainAccuracy) -> _Landed:
    """Integrate over both planes; the inner integral is over the one that moves the landing point farther."""
    assert legs.to_array != "geometric"  # `geometric_image` computes those
    off, radius = math.hypot(source.x, source.y), source.diameter / 2
    rim = PointSource(x=source.x + radius, y=source.y, distance=source.distance)
    tables = source_tables(
        path,
        source,
        (max(off - radius, 0.0), off + radius),
        wavelength=wavelength,
        method=legs.to_array,
        accuracy=accuracy,
        half_width=max(lit_radius(path, point, wavelength, accuracy) for point in (source.centre, rim))
        + path.microlenses.cell_reach,
    )
    image = _image_moves(path, source)
    lens = max(abs(scale) for scale in _lens_moves(path, source))
    over = _over_array if image * source.diameter > lens * path.microlenses.aperture_width else _over_source
    pixels, share, reads = np.zeros(path.pixels.shape), 0.0, 0
    for part, power, count in over(tables, source, accuracy):
        pixels += part
        share += power
        reads += count
    return _Landed(tables=tables, pixels=pixels, share=share, reads=reads)


def _image_moves(path: LightPath, source: DiscSource) -> float:
    """How far the landing point moves with the source point, for a fixed point of the array."""
    depth = path.image_at_array(source.centre)[2]
    return abs(path.detector_distance * (path.array_distance - depth) / (depth * source.distance))


def _lens_moves(path: LightPath, source: DiscSource) -> list[float]:
    """How far the landing point moves with the array point, for a fixed source point: behind a lens and in a gap."""
    b, depth = path.detector_distance, path.image_at_array(source.centre)[2]
    powers = [1 / float(f) for f in np.unique(path.microlenses.focal_lengths)]
    return [1 + b / depth - b * power for power in (*powers, *([0.0] if path.microlenses.gaps == "clear" else []))]


def _over_array(
    tables: SourceTables, source: DiscSource, accuracy: ChainAccuracy
) -> Iterator[tuple[FloatArray, float, int]]:
    """Outer sum over nodes of the array; inner integral over the disc, cut along the pixels as each node sees them."""
    path = tables.path
    lenses, pixels, b = path.microlenses, path.pixels, path.detector_distance
    depth = path.image_at_array(source.centre)[2]
    pull = b * (path.array_distance - depth) / (depth * source.distance)
    fringes = irradiance_frequency(path, tables.wavelength)
    # A pixel's share of the disc blurs the fringes; what remains of them moves with the pixels.
    moves = max(abs(scale) for scale in _lens_moves(path, source))
    blurred = min(fringes, abs(pull) * source.distance / path.array_distance / pixels.pitch)
    density = accuracy.microlens_nodes * tolerated_density(accuracy)
    cycles = density * lenses.aperture_width / 2 * (moves / pixels.pitch + blurred)
    cell = cell_nodes(lenses, cycles=cycles)
    disc = Disc(x=source.x, y=source.y, radius=source.diameter / 2)
    on_disc = accuracy.source_sampling * _SHARE_OF_FRINGES * fringes * path.array_distance / source.distance
    group = symmetries(path, source)
    for index, copies in lens_orbits(lenses.centres, group):
        mates = len(copies)
        image, share, reads = np.zeros(pixels.shape), 0.0, 0
        powers = np.where(cell.in_lens, 1 / lenses.focal_lengths[index], 0.0)
        for dx, dy, weight, power in zip(cell.x, cell.y, cell.weights, powers, strict=True):
            offset = np.array([dx, dy])
            at = lenses.centres[index] + offset
            landing = at * (1 + b / depth) - b * power * offset
            nodes = pixel_nodes(
                disc,
                pixels,
                scale=pull,
                offset=(float(landing[0]), float(landing[1])),
                frequency=on_disc,
                tolerance=accuracy.tolerance,
                corners=accuracy.tolerance < _CORNERS_BELOW,
            )
            light = nodes.weights * tables.irradiance(nodes.x, nodes.y, at[0], at[1])
            image += weight * on_pixels(light, nodes.pixel, pixels)
            share += weight * float(light.sum())
            reads += light.size
        area = math.pi * source.diameter**2 / 4
        yield mates / area * np.mean([moved_image(image, one) for one in group], axis=0), mates / area * share, reads


def _over_source(
    tables: SourceTables, source: DiscSource, accuracy: ChainAccuracy
) -> Iterator[tuple[FloatArray, float, int]]:
    """Outer sum over nodes of the disc; inner integral over the cells, cut along the pixels as each node sees them."""
    path = tables.path
    fringes = irradiance_frequency(path, tables.wavelength)
    moves = _image_moves(path, source) / path.pixels.pitch
    phase = accuracy.source_sampling * tolerated_density(accuracy) * math.pi * source.diameter * moves
    disc = tapered_disc_nodes(
        radius=source.diameter / 2, radial_phase=phase, angular_phase=phase, centre=(source.x, source.y)
    )
    weights = disc.weights / disc.weights.sum()
    for x, y, weight in zip(disc.x, disc.y, weights, strict=True):
        place = float(x), float(y)
        wave = tables.wave(*place)
        nodes = landing_nodes(
            path, wave.source, frequency=accuracy.microlens_nodes * fringes, tolerance=accuracy.tolerance
        )
        field = tables.field(place, tables.at([place])[place], nodes.x, nodes.y)
        light = weight / wave.power() * nodes.weights * np.abs(field) ** 2
        yield on_pixels(light, nodes.pixel, path.pixels), float(light.sum()), light.size


def _irradiance_check(tables: SourceTables, source: DiscSource, rng: np.random.Generator) -> float:
    """Relative discrepancy of the irradiance from direct quadrature, at random source points and array points."""
    lenses = tables.path.microlenses
    radius = source.diameter / 2 * np.sqrt(rng.random(_CHECK_POINTS))
    angle = 2 * math.pi * rng.random(_CHECK_POINTS)
    at = lenses.centres[rng.integers(lenses.count, size=_CHECK_POINTS)]
    at = at + lenses.aperture_width / math.sqrt(8) * rng.uniform(-1, 1, at.shape)
    s, t = source.x + radius * np.cos(angle), source.y + radius * np.sin(angle)
    here = tables.irradiance(s, t, at[:, 0], at[:, 1])
    truth = []
    for (x, y), (p, q) in zip(np.column_stack([s, t]), at, strict=True):
        wave = tables.wave(float(x), float(y))
        truth.append(abs(direct_field(wave, np.array([p]), np.array([q]))[0]) ** 2 / wave.power())
    size = float(np.linalg.norm(truth))
    return float(np.linalg.norm(here - truth)) / size if size > 0 else 0.0
