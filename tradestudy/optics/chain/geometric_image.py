"""Image by paraxial rays alone: areas of the pupil that a pixel sees, cut by the edges of microlenses and source.

Paraxial rays are linear: a source point s and a pupil point u meet the array at x = −s z/a + κ u with κ = 1 − z/b, and
the detector at x (1 + b_L/z − b_L/f_L) + c b_L/f_L − u b_L/z behind a microlens at c. For a point source only u is
free: a pixel's share is the area in the plane of u where pupil, aperture and pixel overlap. For a disc, x is free too:
it runs over nodes fitted to the aperture, and at each node the overlap of pupil, disc and pixel is again an area in u.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainImage, refuse_pixel_centres
from tradestudy.optics.chain.microlens_nodes import Disc, Region, cell_nodes, cell_parts
from tradestudy.optics.chain.scene import LightPath
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.lens import PointSource
from tradestudy.optics.quadrature import gauss_legendre

_AT_ONCE = 2_000_000  # numbers in a block
_SMALLEST = 1e-12  # scale below which a plane is in focus on the next


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
            kept = 1 + b / z - b * power
            result.append(
                _Rays(
                    region=region,
                    centre=(centre - chief)[None],
                    landing=(chief * kept + b * power * centre)[None],
                    weights=np.ones(1),
                    array_scale=spread,
                    detector_scale=spread * kept - b / z,
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
