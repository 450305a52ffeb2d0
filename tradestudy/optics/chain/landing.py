"""Rays behind the array: on both legs, or behind waves, which are integrated where they land on a pixel.

At the array point x, light arrives along the line from the main lens's image x', and the microlens at c bends it as a
paraxial ray. It lands at m x + t, with m = 1 + b_L/a_L − b_L/f_L and t = b_L c/f_L − b_L x'/a_L. A pixel's share is the
irradiance integrated over the part of each aperture whose light lands on it. Nothing diffracts or interferes behind the
array.

A pixel's share is the integral of the irradiance over the source points s and array points x whose light lands on it.
The landing point is linear in both. The inner integral is cut exactly along the edges of the pixels; it runs over the
plane that moves the landing point farther (source points where the microlenses are near focus, array points of a small
source). The outer one is smooth enough for a rule fitted to a disc or a cell.

Paraxial rays are linear: a source point s and a pupil point u meet the array at x = −s z/a + κ u with κ = 1 − z/b, and
the detector at x (1 + b_L/z − b_L/f_L) + c b_L/f_L − u b_L/z behind a microlens at c. For a point source only u is
free: a pixel's share is the area in the plane of u where pupil, aperture and pixel overlap. For a disc, x is free too:
it runs over nodes fitted to the aperture, and at each node the overlap of pupil, disc and pixel is again an area in u.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import FloatArray, IndexArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage, refuse_pixel_centres, relative_change
from tradestudy.optics.chain.array_field import PupilWave, direct_field
from tradestudy.optics.chain.arriving_light import (
    ArrayField,
    ArrivingLight,
    SourceTables,
    arriving_light,
    refuse_focus_on_array,
    source_tables,
)
from tradestudy.optics.chain.detector_patch import lit_radius
from tradestudy.optics.chain.lit_part import lit_part
from tradestudy.optics.chain.microlens_nodes import (
    Disc,
    Region,
    cell_nodes,
    cell_parts,
    on_segments,
    resolving,
    subintervals,
    tapered_disc_nodes,
)
from tradestudy.optics.chain.scene import Legs, LightPath, PixelGrid
from tradestudy.optics.chain.sources import DiscSource, lens_orbits, moved_image, symmetries, tolerated_density
from tradestudy.optics.propagation.lens import PointSource
from tradestudy.optics.propagation.result import squared_magnitude
from tradestudy.optics.quadrature import gauss_legendre

_SAFETY = 2.5  # where rows of pixels graze the outline of a microlens, both computations converge slowly
_CHECK_POINTS = 16
_GROSS = 0.2  # discrepancy from direct quadrature that is refused at any tolerance
_FOR_BENDING = 3  # extra nodes where an outline ends vertically
_FINER = 1.5  # factor on the sampling of field and irradiance on the array in the second computation
_SMALLEST = 1e-12  # scale below which one plane is focused on the next


@dataclass(frozen=True, kw_only=True)
class PixelNodes:
    """Area rule on a region, each node with the pixel that its light lands on.

    Attributes
    ----------
    x, y, weights
        Positions [m] and area weights [m²], shape (n,).
    pixel
        Flat index of the pixel, −1 off the detector.
    """

    x: FloatArray
    y: FloatArray
    weights: FloatArray
    pixel: IndexArray


def landing_point_image(wave: PupilWave, *, accuracy: ChainAccuracy, rng: np.random.Generator) -> ChainImage:
    """Image of one point by waves to the array and rays behind it.

    `microlens_nodes` refines the nodes of the irradiance; `rng` draws the points that are checked against direct
    quadrature. The pixels sum to `microlens_share` if all light lands on the detector: rays lose nothing.

    Raises
    ------
    OutOfRangeError
        If the array lies in the focus of the main lens, or the pixels do not integrate.
    UnaffordableError
        If the field needs more memory than allowed.
    NotConvergedError
        If the field disagrees grossly with direct quadrature, or Kirchhoff's integral misses the tolerance where it
        replaces a boundary wave.
    """
    refuse_pixel_centres(wave.path.pixels)
    refuse_focus_on_array(wave.path, wave.source, wave.wavelength)
    # Few nodes fall on a pixel's share of a microlens, and a slightly coarser rule would often have as many. The second
    # computation is therefore finer: the two then share none of their error.
    finer = replace(
        accuracy.unstarved(),
        field_sampling=_FINER * max(accuracy.field_sampling, 1.0),
        microlens_nodes=_FINER * max(accuracy.microlens_nodes, 1.0),
    )
    with ThreadPoolExecutor(2) as pool:  # a boundary wave is compared with Kirchhoff's integral
        fine, reference = pool.map(_landed_point, (wave, wave.reference), (accuracy, finer))
    terms = {
        "other sampling": _SAFETY * relative_change(fine.pixels, reference.pixels),
        "unlit microlenses": fine.lost / float(np.linalg.norm(fine.pixels)) if fine.lost > 0.0 else 0.0,
    }
    check = _point_check(wave, fine, rng)
    if check > _GROSS:
        raise NotConvergedError(
            "the main lens's field disagrees with direct quadrature",
            value=f"{check:.2g}",
            limit=f"{_GROSS:g}",
            remedy="refine pupil_nodes or field_sampling",
        )
    return ChainImage(
        pixels=fine.pixels,
        numerical_error=math.hypot(*terms.values()),
        error_terms=terms,
        direct_check={"irradiance on the array": check},
        microlens_share=float(fine.light.sum()),
        effort={"microlens nodes": fine.light.size, "array samples": fine.arriving.samples},
        handed_over=fine.arriving.handed_over,
    )


def irradiance_frequency(path: LightPath, wavelength: float) -> float:
    """Highest spatial frequency of the irradiance on the array: between rays from opposite rims of the pupil [1/m]."""
    radius, z = path.main_lens.radius, path.array_distance
    return 2 * radius / math.hypot(radius, z) / wavelength


def pixel_nodes(
    region: Region,
    pixels: PixelGrid,
    *,
    scale: float,
    offset: tuple[float, float],
    frequency: float,
    tolerance: float,
    corners: bool = True,
) -> PixelNodes:
    """Nodes on a region, cut along the edges of the pixels; a point x of the region lands at `scale` x + `offset`.

    Between the cuts the integrand is as smooth as the irradiance, which sets the rate of convergence. Without
    `corners`, columns are not cut where the outline crosses the edge of a row: pixels on the outline then err by about
    a hundredth of their light, at half the nodes.
    """
    rows, columns = pixels.shape
    scale = math.copysign(max(abs(scale), _SMALLEST), scale)
    edges_x, edges_y = ((e - t) / scale for e, t in zip((pixels.edges_x, pixels.edges_y), offset, strict=True))
    low, high = (float(f(region.breaks)) for f in (np.min, np.max))
    cuts = np.concatenate([region.breaks, edges_x, region.on_line(edges_y) if corners else []])
    start, stop = subintervals(cuts, low, high)
    upright = (start == low) | (stop == high)
    across = on_segments(
        start,
        stop,
        resolving(np.where(upright, math.pi / 2, 1.0) * (stop - start), frequency, tolerance=tolerance, spare=0)
        + _FOR_BENDING * upright,
        bend=upright,
    )
    bottom, top = region.span(across.points)
    # The strips below and above the detector count too: their light belongs to that of the microlens.
    ends = np.sort(edges_y)
    lower = np.clip(np.concatenate([[-np.inf], ends]), bottom[:, None], top[:, None])
    upper = np.clip(np.concatenate([ends, [np.inf]]), bottom[:, None], top[:, None])
    along = on_segments(
        lower.ravel(), upper.ravel(), resolving((upper - lower).ravel(), frequency, tolerance=tolerance, spare=0)
    )
    which, strip = np.divmod(along.owner, rows + 2)
    x = across.points[which]
    column = np.searchsorted(np.sort(edges_x), x) - 1
    row = strip - 1
    if scale < 0:  # sorting the edges mirrored the image
        row, column = rows - 1 - row, columns - 1 - column
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    return PixelNodes(
        x=x,
        y=along.points,
        weights=across.weights[which] * along.weights,
        pixel=np.where(inside, row * columns + column, -1),
    )


def on_pixels(power: FloatArray, pixel: IndexArray, grid: PixelGrid) -> FloatArray:
    """Power that lands on each pixel, shape (rows, columns)."""
    held = pixel >= 0
    total = np.bincount(pixel[held], weights=power[held], minlength=math.prod(grid.shape))
    return np.asarray(total.reshape(grid.shape), dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class _LandedPoint:
    """Nodes with the share of the light on each, the share on each pixel, and the light left out, as in `LitPart`."""

    arriving: ArrivingLight
    nodes: PixelNodes
    light: FloatArray
    pixels: FloatArray
    lost: float


def landing_nodes(path: LightPath, source: PointSource, *, frequency: float, tolerance: float) -> PixelNodes:
    """Nodes on every cell, each with the pixel that its light reaches; weights have the signs of `cell_parts`."""
    b, lenses = path.detector_distance, path.microlenses
    image_x, image_y, depth = path.image_at_array(source)
    parts = []
    for index, centre in enumerate(lenses.centres):
        for region, power, sign in cell_parts(lenses, float(lenses.focal_lengths[index]), *map(float, centre)):
            offset = b * power * centre - b / depth * np.array([image_x, image_y])
            nodes = pixel_nodes(
                region,
                path.pixels,
                scale=1 + b / depth - b * power,
                offset=(float(offset[0]), float(offset[1])),
                frequency=frequency,
                tolerance=tolerance,
            )
            parts.append(replace(nodes, weights=sign * nodes.weights))
    x, y, weights = (np.concatenate([getattr(part, name) for part in parts]) for name in ("x", "y", "weights"))
    return PixelNodes(x=x, y=y, weights=weights, pixel=np.concatenate([part.pixel for part in parts]))


def light_on_nodes(
    wave: PupilWave, field_at: ArrayField, *, frequency: float, tolerance: float
) -> tuple[PixelNodes, FloatArray]:
    """Nodes of one source point on every cell, and the share of the light through the pupil that arrives on each."""
    nodes = landing_nodes(wave.path, wave.source, frequency=frequency, tolerance=tolerance)
    return nodes, nodes.weights * squared_magnitude(field_at(nodes.x, nodes.y)) / wave.power()


def _landed_point(wave: PupilWave, accuracy: ChainAccuracy) -> _LandedPoint:
    """Light on nodes of every microlens that is lit, and the pixels where it lands."""
    lit = lit_part(wave, accuracy)
    assert isinstance(lit.wave, PupilWave)  # because the whole wave is one
    wave, arriving = lit.wave, arriving_light(lit.wave, accuracy)
    frequency = accuracy.microlens_nodes * irradiance_frequency(wave.path, wave.wavelength)
    nodes, light = light_on_nodes(wave, arriving.read, frequency=frequency, tolerance=accuracy.tolerance)
    pixels = on_pixels(light, nodes.pixel, wave.path.pixels)
    return _LandedPoint(arriving=arriving, nodes=nodes, light=light, pixels=pixels, lost=lit.lost)


def _point_check(wave: PupilWave, landed: _LandedPoint, rng: np.random.Generator) -> float:
    """Relative discrepancy of the irradiance at random nodes from direct quadrature."""
    lit = np.abs(landed.light)
    if not lit.any():
        return 0.0
    pick = rng.choice(lit.size, size=_CHECK_POINTS, p=lit / lit.sum())
    truth = squared_magnitude(direct_field(wave, landed.nodes.x[pick], landed.nodes.y[pick])) / wave.power()
    computed = landed.light[pick] / landed.nodes.weights[pick]
    return float(np.linalg.norm(computed - truth) / np.linalg.norm(truth))


_SAFETY_OF_DISC = 1.5  # the two computations share some of their error
_FEWER = 0.7  # factor on source nodes and tables in the second computation
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

    `microlens_nodes` refines the array's nodes, `source_sampling` the disc's; `rng` draws the points where the
    interpolated irradiance is checked against direct quadrature.

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
    sampling = accuracy.source_sampling  # a factor below 1 is compared with 1, as in `ChainAccuracy.compared`
    coarser = replace(
        accuracy.compared(),
        # Rays carry every ripple of the field to a pixel, and a field sampled only just finely enough has the same
        # ripples on a coarser grid: it is finer in the second computation.
        field_sampling=_FINER * max(accuracy.field_sampling, 1.0),
        source_sampling=_FEWER * sampling if sampling >= 1 else 1.0,
    )
    with ThreadPoolExecutor(2) as pool:
        fine, reference = pool.map(
            lambda settings: _landed_disc(path, source, wavelength, *settings), ((legs, accuracy), (compared, coarser))
        )
    terms = {"other sampling": _SAFETY_OF_DISC * relative_change(fine.pixels, reference.pixels)}
    return ChainImage(
        pixels=fine.pixels,
        numerical_error=math.hypot(*terms.values()),
        error_terms=terms,
        direct_check={"irradiance on the array": _disc_check(fine.tables, source, rng)},
        microlens_share=fine.share,
        effort={"irradiances": fine.reads, "array samples": fine.tables.samples},
        handed_over=fine.tables.handed_over,
    )


@dataclass(frozen=True, kw_only=True)
class _LandedDisc:
    """Fractions on the pixels and on the array, and the tables from which they were computed."""

    tables: SourceTables
    pixels: FloatArray
    share: float
    reads: int


def _landed_disc(
    path: LightPath, source: DiscSource, wavelength: float, legs: Legs, accuracy: ChainAccuracy
) -> _LandedDisc:
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
    return _LandedDisc(tables=tables, pixels=pixels, share=share, reads=reads)


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
        image, share, reads = np.zeros(pixels.shape), 0.0, 0
        powers = np.where(cell.in_lens, 1 / lenses.focal_lengths[index], 0.0)
        for dx, dy, weight, power in zip(cell.x, cell.y, cell.weights, powers, strict=True):
            offset = np.array([dx, dy])
            point = lenses.centres[index] + offset
            landing = point * (1 + b / depth) - b * power * offset
            nodes = pixel_nodes(
                disc,
                pixels,
                scale=pull,
                offset=(float(landing[0]), float(landing[1])),
                frequency=on_disc,
                tolerance=accuracy.tolerance,
                corners=accuracy.tolerance < _CORNERS_BELOW,
            )
            light = nodes.weights * tables.irradiance(nodes.x, nodes.y, point[0], point[1])
            image += weight * on_pixels(light, nodes.pixel, pixels)
            share += weight * float(light.sum())
            reads += light.size
        per_area = len(copies) / (math.pi * source.diameter**2 / 4)
        yield per_area * np.mean([moved_image(image, turn) for turn in group], axis=0), per_area * share, reads


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
    frequency = accuracy.microlens_nodes * fringes
    for x, y, weight in zip(disc.x, disc.y, weights, strict=True):
        place = float(x), float(y)
        field_at = partial(tables.field, place, tables.at([place])[place])
        nodes, light = light_on_nodes(tables.wave(*place), field_at, frequency=frequency, tolerance=accuracy.tolerance)
        yield weight * on_pixels(light, nodes.pixel, path.pixels), weight * float(light.sum()), light.size


def _disc_check(tables: SourceTables, source: DiscSource, rng: np.random.Generator) -> float:
    """Relative discrepancy of the irradiance from direct quadrature, at random source points and array points."""
    lenses = tables.path.microlenses
    radius = source.diameter / 2 * np.sqrt(rng.random(_CHECK_POINTS))
    angle = 2 * math.pi * rng.random(_CHECK_POINTS)
    points = lenses.centres[rng.integers(lenses.count, size=_CHECK_POINTS)]
    points = points + lenses.aperture_width / math.sqrt(8) * rng.uniform(-1, 1, points.shape)
    s, t = source.x + radius * np.cos(angle), source.y + radius * np.sin(angle)
    computed = tables.irradiance(s, t, points[:, 0], points[:, 1])
    truth = []
    for (x, y), (p, q) in zip(np.column_stack([s, t]), points, strict=True):
        wave = tables.wave(float(x), float(y))
        truth.append(abs(direct_field(wave, np.array([p]), np.array([q]))[0]) ** 2 / wave.power())
    size = float(np.linalg.norm(truth))
    return float(np.linalg.norm(computed - truth)) / size if size > 0 else 0.0


_AT_ONCE = 2_000_000  # numbers in a block


@dataclass(frozen=True, kw_only=True)
class _Rays:
    """Rays in a set of cases: pupil points u meet the region at `array_scale` u and land at `detector_scale` u.

    The centre of the region, relative to each case, and the landing point of u = 0 have shape (n, 2), weights (n,).
    """

    region: Region
    centre: FloatArray
    landing: FloatArray
    weights: FloatArray
    array_scale: float
    detector_scale: float
    sign: float


def geometric_image(path: LightPath, source: PointSource | DiscSource, *, density: float) -> ChainImage:
    """Fraction of the pupil's light on each pixel by paraxial rays.

    Parameters
    ----------
    path
        The camera; the shape of the lens phases does not matter to paraxial rays.
    source
        Point or disc; a disc is averaged over its area.
    density
        Factor on the numbers of quadrature nodes: 24 across a pixel, about 200 on a microlens for a disc.

    Returns
    -------
    ChainImage
        ``numerical_error`` is the change from a computation with 0.7 times the nodes.

    Raises
    ------
    OutOfRangeError
        If the pixels do not integrate.
    """
    refuse_pixel_centres(path.pixels)
    fine, coarse = (_shares(path, source, density * factor) for factor in (1.0, 0.7))
    size = float(np.linalg.norm(fine))
    change = float(np.linalg.norm(fine - coarse)) / size if size > 0 else 0.0
    return ChainImage(
        pixels=fine,
        numerical_error=change,
        error_terms={"coarser computation": change},
        direct_check={},
        microlens_share=math.nan,
        effort={"microlenses": path.microlenses.count},
    )


def _shares(path: LightPath, source: PointSource | DiscSource, density: float) -> FloatArray:
    """Sum of the shares over microlenses and gaps."""
    cases = _disc_cases(path, source, density) if isinstance(source, DiscSource) else _point_cases(path, source)
    pixels = np.zeros(path.pixels.shape)
    for rays in cases:
        pixels += rays.sign * _areas(path, rays, columns=max(4, round(24 * density)))
    return pixels


def _point_cases(path: LightPath, point: PointSource) -> list[_Rays]:
    """One case per lens and part of its cell."""
    lenses, z, b = path.microlenses, path.array_distance, path.detector_distance
    chief = np.array(path.chief_point(point))
    spread = 1 - z / path.main_lens.image_of(point)[2]
    result = []
    for centre, focal_length in zip(lenses.centres, lenses.focal_lengths, strict=True):
        for region, power, sign in cell_parts(lenses, float(focal_length), 0.0, 0.0):
            magnified = 1 + b / z - b * power
            result.append(
                _Rays(
                    region=region,
                    centre=(centre - chief)[None],
                    landing=(chief * magnified + b * power * centre)[None],
                    weights=np.ones(1),
                    array_scale=spread,
                    detector_scale=spread * magnified - b / z,
                    sign=sign,
                )
            )
    return result


def _disc_cases(path: LightPath, source: DiscSource, density: float) -> list[_Rays]:
    """One case per lens with all its nodes: for a fixed array point, the disc is a region in the plane of u."""
    lenses, z, b = path.microlenses, path.array_distance, path.detector_distance
    shrink = z / source.distance
    chief = np.array(path.chief_point(source.centre))
    spread = 1 - z / path.main_lens.image_of(source.centre)[2]
    nodes = cell_nodes(lenses, cycles=2.0 * density)
    offset = np.column_stack([nodes.x, nodes.y])
    image = Disc(x=0.0, y=0.0, radius=source.diameter / 2 * shrink)
    weights = nodes.weights / (math.pi * image.radius**2)
    result = []
    for centre, focal_length in zip(lenses.centres, lenses.focal_lengths, strict=True):
        x = centre + offset
        # Light through a clear gap is not bent.
        power = np.where(nodes.in_lens, 1 / focal_length, 0.0)[:, None]
        result.append(
            _Rays(
                region=image,
                centre=x - chief,
                landing=x * (1 + b / z) - b * power * offset,
                weights=weights,
                array_scale=spread,
                detector_scale=-b / z,
                sign=1.0,
            )
        )
    return result


def _areas(path: LightPath, rays: _Rays, *, columns: int) -> FloatArray:
    """Weighted fraction of the pupil whose rays pass the region and land in each pixel.

    Exact in y; Gauss–Legendre with `columns` nodes across each pixel in x.
    """
    to_array, to_detector = (math.copysign(max(abs(s), _SMALLEST), s) for s in (rays.array_scale, rays.detector_scale))
    radius = path.main_lens.radius
    hole = rays.centre / to_array  # centre of the region in the plane of u, (n, 2)
    # Traced back to the pupil, pixels are rectangles: a pixel's share is the area of its overlap with pupil and region.
    edges_x = np.sort((path.pixels.edges_x - rays.landing[:, :1]) / to_detector, axis=1)
    edges_y = np.sort((path.pixels.edges_y - rays.landing[:, 1:]) / to_detector, axis=1)
    half_width = float(rays.region.breaks[-1]) / abs(to_array)
    low = np.maximum(-radius, hole[:, 0] - half_width)[:, None]
    high = np.minimum(radius, hole[:, 0] + half_width)[:, None]
    edges_x = np.clip(edges_x, low, np.maximum(low, high))
    t, w = gauss_legendre(columns)
    total = np.zeros(path.pixels.shape)
    touched = np.flatnonzero(np.any(np.diff(edges_x, axis=1) > 0, axis=0))
    block = max(1, _AT_ONCE // max(1, touched.size * columns * path.pixels.shape[0]))
    for start in range(0, rays.weights.size, block):
        part = slice(start, start + block)
        left, width = edges_x[part, touched], np.diff(edges_x[part], axis=1)[:, touched]
        x = left[:, :, None] + width[:, :, None] * t
        disc = np.sqrt(np.maximum(radius**2 - x**2, 0.0))
        half = rays.region.span((x - hole[part, :1, None]) * abs(to_array))[1] / abs(to_array)
        middle = hole[part, 1:, None]
        bottom = np.maximum(-disc, middle - half)
        top = np.maximum(np.minimum(disc, middle + half), bottom)
        inside = np.diff(np.clip(edges_y[part, None, None, :], bottom[..., None], top[..., None]), axis=-1)
        total[:, touched] += np.einsum("n,nc,k,nckr->rc", rays.weights[part], width, w, inside, optimize=True)
    if to_detector < 0:  # sorting the edges mirrored the image
        total = total[::-1, ::-1]
    return total / (math.pi * radius**2)
