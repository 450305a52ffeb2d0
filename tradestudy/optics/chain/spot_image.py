"""Image of an incoherent disc: the mean over its points, with the symmetry of the scene and the error of the mean."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.array_field import PupilWave
from tradestudy.optics.chain.pixels import light_on_pixels
from tradestudy.optics.chain.point_image import compute_point, reference_law
from tradestudy.optics.chain.scene import Legs, LightPath
from tradestudy.optics.chain.sources import (
    DiscSource,
    SourceNodes,
    moved_image,
    orbits,
    source_nodes,
    symmetries,
    tolerated_density,
)
from tradestudy.optics.chain.spot_points import PointLight, Spot, point_light, prepare_spot, tables_at

_THREADS = 2
_CHECKED_POINTS = 2
# So few points may err by less than others do, and what all lack alike weighs more in the smoother picture of the spot:
# of the light spot at 0.1 %, points err by 0.05 to 0.06 %, and all together by 0.08 %.
_SAFETY_OF_TWO = 2.0
_MOST_DRAWN = 40
_HARDLY_ANY = 0.1  # of what a point brings on average
_RESOLVED = 0.5  # error of a quarter of the angles below which its further fall can be told


def wave_spot_image(
    path: LightPath,
    source: DiscSource,
    *,
    wavelength: float,
    legs: Legs,
    accuracy: ChainAccuracy,
    rng: np.random.Generator,
    done: Callable[[float], None] = lambda _share: None,
) -> ChainImage:
    """Image of an incoherent disc by wave optics, averaged over its area.

    Parameters
    ----------
    path, source
        Camera and disc.
    wavelength
        [m].
    legs
        Law of each leg; waves behind the array.
    accuracy
        What to aim at.
    rng
        Draws the source points whose image is checked.
    done
        Hears what share of the points is done, ring by ring.

    Raises
    ------
    UnaffordableError
        If tables or patches need more memory than allowed.
    NotConvergedError
        If the image of a source point differs grossly from that of the single-point computation.
    """
    density = source_density(accuracy)
    nodes = source_nodes(path, source, wavelength=wavelength, density=density)
    spot = prepare_spot(path, source, nodes, wavelength, legs, accuracy)
    group = symmetries(path, source)
    images = _ring_images(spot, nodes, group, done)
    rings = np.mean([moved_image_stack(images.pixels, one) for one in group], axis=0)
    pixels = np.tensordot(nodes.radial_weights, rings[:, 2:].mean(axis=1), axes=1)
    size = float(np.linalg.norm(pixels))
    per_point = _points_check(spot, nodes, float(pixels.sum()), rng)
    averaging = (_angular_error(nodes, rings) / size, _radial_error(nodes, rings) / size) if size > 0.0 else (0.0, 0.0)
    terms = {
        "source angles": averaging[0],
        "source radii": averaging[1],
        "single points": per_point,
        "pixel integration": images.pixel_error,
    }
    return ChainImage(
        pixels=pixels,
        numerical_error=math.hypot(*terms.values()),
        error_terms=terms,
        direct_check={},
        microlens_share=math.nan,
        effort={
            "source points": images.points,
            "source nodes": nodes.all.shape[0],
            "nodes per microlens": spot.plane.cell.x.size,
            "samples per patch": spot.response.transfer.count**2,
        },
        handed_over=images.handed_over,
    )


def moved_image_stack(rings: FloatArray, symmetry: tuple[int, int, bool]) -> FloatArray:
    """`moved_image` on the last two axes."""
    flat = rings.reshape(-1, *rings.shape[-2:])
    return np.stack([moved_image(one, symmetry) for one in flat]).reshape(rings.shape)


def source_density(accuracy: ChainAccuracy) -> float:
    """Share of the cutoff to resolve: the light near it is weak, and the pixel averages it away."""
    return accuracy.source_sampling * tolerated_density(accuracy)


@dataclass(frozen=True, kw_only=True)
class _RingImages:
    """Mean pixel image of each ring from some of its angles, shape (rings, 4, rows, columns).

    From every fourth angle, from every fourth two further on, from all even ones, and from all odd ones. Where symmetry
    carries the first into the second they are one.
    """

    pixels: FloatArray
    pixel_error: float
    points: int
    handed_over: float


def _ring_images(
    spot: Spot, nodes: SourceNodes, group: list[tuple[int, int, bool]], done: Callable[[float], None]
) -> _RingImages:
    """Follow the light of one point of every orbit of the symmetries."""
    images, errors, points, handed = [], [], 0, spot.tables.handed_over if spot.tables else 0.0
    with ThreadPoolExecutor(_THREADS) as pool:
        for ring in range(len(nodes.rings)):
            chosen = list(orbits(nodes, ring, group))
            points += len(chosen)
            at = [(float(x), float(y)) for x, y in (nodes.rings[ring][i] for i, _ in chosen)]
            shared = tables_at(spot, at)
            lights = list(pool.map(lambda p, s=shared: point_light(spot, p, s[p]), at))
            handed = max(handed, *(light.handed_over for light in lights))
            known = [(i, n, light) for (i, n), light in zip(chosen, lights, strict=True)]
            means = []
            for step, first in ((4, 0), (4, 2), (2, 0), (2, 1)):
                part = [(n, light) for i, n, light in known if i % step == first]
                part = part or [(n, light) for i, n, light in known if i % 4 == 0]
                means.append(_mean_on_pixels(spot, part))
            images.append([one[0] for one in means])
            errors.append(max(one[1] for one in means))
            done(sum(len(one) for one in nodes.rings[: ring + 1]) / len(nodes.all))
    return _RingImages(pixels=np.asarray(images), pixel_error=max(errors), points=points, handed_over=handed)


def _mean_on_pixels(spot: Spot, part: list[tuple[int, PointLight]]) -> tuple[FloatArray, float]:
    """Weighted mean of points on the pixels, and the error of integrating over them."""
    points = sum(n for n, _ in part)
    intensity = np.asarray(sum(n * light.intensity for n, light in part), dtype=np.float64) / points
    pixels, error = light_on_pixels(intensity, spot.path.pixels, per_pixel=spot.per_pixel)
    return pixels + sum(n * light.far for n, light in part) / points, error


def _angular_error(nodes: SourceNodes, rings: FloatArray) -> float:
    """Error of half the angles, even against odd, carried on to that of all as it fell from that of a quarter.

    Spectra that decay fast square it, or more once a quarter of the angles resolves something; twice that is stated,
    and no more than its power 3/2, which starved nodes bear out.
    """
    sums = np.tensordot(nodes.radial_weights, rings, axes=1)
    size = float(np.linalg.norm(sums[2:].mean(axis=0)))
    quarter, half = (float(np.linalg.norm(sums[k] - sums[k + 1])) / 2 / size for k in (0, 2))
    if not 0.0 < half < 1.0:
        return half * size
    if quarter <= half:
        return size * math.pow(half, 1.5)
    fell = math.log(half) / math.log(quarter) if quarter < 1.0 else math.inf
    power = min(max(fell, 1.5), 2.4 if quarter < _RESOLVED else 2.0)
    return size * min(math.pow(half, 1.5), 2.0 * math.pow(half, power))


def _radial_error(nodes: SourceNodes, rings: FloatArray) -> float:
    """Highest Legendre coefficient that the rings resolve, carried on to the first that they do not."""
    n = nodes.radial_points.size
    legendre = np.polynomial.legendre.legvander(2 * nodes.radial_points - 1, n - 1)
    coefficients = np.tensordot(
        (legendre * nodes.radial_weights[:, None]).T * (2 * np.arange(n) + 1)[:, None],
        rings[:, 2:].mean(axis=1),
        axes=1,
    )
    last = float(np.linalg.norm(coefficients[-1])) / (2 * n - 1)
    size = float(np.linalg.norm(coefficients[0]))
    return last * min(1.0, math.sqrt(last / size))


def _points_check(spot: Spot, nodes: SourceNodes, light: float, rng: np.random.Generator) -> float:
    """Relative L2 difference of random source points' pixels from the single-point computation, times a safety.

    Points that bring hardly any of the light say nothing of the picture and are passed over, unless all do. A boundary
    wave is compared with Kirchhoff's integral: what its leading term leaves out is stated, not refused.
    """
    squares: list[float] = []
    sizes: list[float] = []
    picks = rng.choice(nodes.all, size=min(_MOST_DRAWN, len(nodes.all)), replace=False)
    finer = spot.accuracy.unstarved()
    for number, pick in enumerate(picks):
        if len(squares) == _CHECKED_POINTS:
            break
        at = (float(pick[0]), float(pick[1]))
        fast = point_light(spot, at, tables_at(spot, [at])[at]).on_pixels(spot)
        left = len(picks) - number
        if fast.sum() < _HARDLY_ANY * light and left > _CHECKED_POINTS - len(squares):
            continue
        wave = spot.wave(*at)
        reference = wave.reference if isinstance(wave, PupilWave) else wave
        law = reference_law(spot.legs.to_detector)
        truth = compute_point(reference, law, finer).pixels / wave.power()
        squares.append(float(np.sum((fast - truth) ** 2)))
        sizes.append(float(np.sum(truth**2)))
    if not any(squares):
        return 0.0  # no light by either
    error = math.sqrt(sum(squares) / sum(sizes)) if any(sizes) else math.inf
    if error > 0.3 and "boundary_wave" not in (spot.legs.to_array, spot.legs.to_detector):
        raise NotConvergedError(
            "points of the spot disagree with the single-point computation",
            value=f"{error:.2g}",
            limit="0.3",
            remedy="refine diffraction_reach, microlens_nodes or pupil_nodes",
        )
    return _SAFETY_OF_TWO * error
