"""Waves to the array and rays behind it: every array point sends its irradiance to one place on the detector.

At the array point x, light arrives along the line from the main lens's image x', and the microlens at c bends it as a
paraxial ray. It lands at m x + t, with m = 1 + b_L/a_L − b_L/f_L and t = b_L c/f_L − b_L x'/a_L. A pixel's share is the
irradiance integrated over the part of each aperture whose light lands on it. Nothing diffracts or interferes behind the
array.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import FloatArray, IndexArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage, refuse_pixel_centres, relative_change
from tradestudy.optics.chain.array_field import PupilWave, direct_field
from tradestudy.optics.chain.arriving_light import ArrivingLight, arriving_light, refuse_focus_on_array
from tradestudy.optics.chain.lit_part import lit_part
from tradestudy.optics.chain.microlens_nodes import (
    Region,
    aperture_region,
    cell_region,
    on_segments,
    resolving,
    subintervals,
)
from tradestudy.optics.chain.scene import LightPath, PixelGrid
from tradestudy.optics.propagation.lens import PointSource

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

    Parameters
    ----------
    wave
        Camera, source, wavelength and law of the leg to the array.
    accuracy
        Tolerance and sampling; `microlens_nodes` refines the nodes of the irradiance.
    rng
        Draws the points that are checked against direct quadrature.

    Returns
    -------
    ChainImage
        The pixels sum to `microlens_share` if all light lands on the detector: rays lose nothing.

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
        fine, other = pool.map(_landed, (wave, wave.reference), (accuracy, finer))
    power, size = wave.power(), float(np.linalg.norm(fine.pixels))
    terms = {
        "other sampling": _SAFETY * relative_change(fine.pixels, other.pixels),
        "unlit microlenses": fine.lost * power / size if fine.lost > 0.0 else 0.0,
    }
    check = _irradiance_check(wave, fine, rng)
    if check > _GROSS:
        raise NotConvergedError(
            "the main lens's field disagrees with direct quadrature",
            value=f"{check:.2g}",
            limit=f"{_GROSS:g}",
            remedy="refine pupil_nodes or field_sampling",
        )
    return ChainImage(
        pixels=fine.pixels / power,
        numerical_error=math.hypot(*terms.values()),
        error_terms=terms,
        direct_check={"irradiance on the array": check},
        microlens_share=float(fine.power.sum()) / power,
        effort={"microlens nodes": fine.power.size, "array samples": fine.light.samples},
        handed_over=fine.light.handed_over,
    )


def compared_settings(accuracy: ChainAccuracy) -> ChainAccuracy:
    """Settings of the second computation: those of `ChainAccuracy.compared`, but with a finer field on the array.

    Rays carry every ripple of the field to a pixel, and a field sampled only just finely enough has the
    same ripples on a coarser grid.
    """
    return replace(accuracy.compared(), field_sampling=_FINER * max(accuracy.field_sampling, 1.0))


def irradiance_frequency(path: LightPath, wavelength: float) -> float:
    """Highest spatial frequency of the irradiance on the array: between rays from opposite rims of the pupil [1/m]."""
    radius, z = path.main_lens.radius, path.array_distance
    return 2 * radius / math.hypot(radius, z) / wavelength


def landing_parts(path: LightPath, index: int) -> Iterator[tuple[Region, float, float]]:
    """Parts of a cell: region, lens power there [1/m] and sign; a clear gap is the cell minus its aperture."""
    lenses = path.microlenses
    x, y = (float(c) for c in lenses.centres[index])
    aperture = aperture_region(lenses, x, y)
    yield aperture, 1 / float(lenses.focal_lengths[index]), 1.0
    if lenses.gaps == "clear":
        yield cell_region(lenses, x, y), 0.0, 1.0
        yield aperture, 0.0, -1.0


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
    if scale < 0:
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
class _Landed:
    """Nodes with the power of each, the power on each pixel, and the power left out, as in `LitPart`."""

    light: ArrivingLight
    nodes: PixelNodes
    power: FloatArray
    pixels: FloatArray
    lost: float


def landing_nodes(path: LightPath, source: PointSource, *, frequency: float, tolerance: float) -> PixelNodes:
    """Nodes on every cell, each with the pixel that its light reaches; `landing_parts` gives the signs of weights."""
    b = path.detector_distance
    image_x, image_y, depth = path.image_at_array(source)
    parts = []
    for index, centre in enumerate(path.microlenses.centres):
        for region, power, sign in landing_parts(path, index):
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


def _landed(wave: PupilWave, accuracy: ChainAccuracy) -> _Landed:
    """Irradiance on nodes of every microlens that is lit, and the pixels where it lands."""
    lit = lit_part(wave, accuracy)
    assert isinstance(lit.wave, PupilWave)  # because the whole wave is one
    wave = lit.wave
    frequency = accuracy.microlens_nodes * irradiance_frequency(wave.path, wave.wavelength)
    nodes = landing_nodes(wave.path, wave.source, frequency=frequency, tolerance=accuracy.tolerance)
    light = arriving_light(wave, accuracy)
    power = nodes.weights * np.abs(light.read(nodes.x, nodes.y)) ** 2
    pixels = on_pixels(power, nodes.pixel, wave.path.pixels)
    return _Landed(light=light, nodes=nodes, power=power, pixels=pixels, lost=lit.lost)


def _irradiance_check(wave: PupilWave, done: _Landed, rng: np.random.Generator) -> float:
    """Relative discrepancy of the irradiance at random nodes from direct quadrature."""
    lit = np.abs(done.power)
    if not lit.any():
        return 0.0
    pick = rng.choice(lit.size, size=_CHECK_POINTS, p=lit / lit.sum())
    truth = np.abs(direct_field(wave, done.nodes.x[pick], done.nodes.y[pick])) ** 2
    here = done.power[pick] / done.nodes.weights[pick]
    return float(np.linalg.norm(here - truth) / np.linalg.norm(truth))
