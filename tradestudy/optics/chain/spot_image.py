"""Image of an incoherent disc: the mean over its points, with the symmetry of the scene and the error of the mean."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.array_field import PupilWave
from tradestudy.optics.chain.averaging_error import angular_error, radial_error
from tradestudy.optics.chain.point_image import compute_point, reference_law
from tradestudy.optics.chain.scene import Legs, LightPath
from tradestudy.optics.chain.sources import (
    DiscSource,
    SourceNodes,
    Symmetry,
    moved_image,
    orbits,
    source_nodes,
    symmetries,
    tolerated_density,
)
from tradestudy.optics.chain.spot_points import Spot, lights_of, mean_on_pixels, point_light, prepare_spot, tables_at

_CHECKED_POINTS = 2
# So few points may err by less than others do, and what all lack alike weighs more in the smoother picture of the spot:
# of the light spot at 0.1 %, points err by 0.05 to 0.06 %, and all together by 0.08 %.
_SAFETY_OF_TWO = 2.0
_MOST_DRAWN = 40
_HARDLY_ANY = 0.1  # of what a point brings on average


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
    pixels = np.tensordot(nodes.radial_weights, rings.mean(axis=1), axes=1)
    size = float(np.linalg.norm(pixels))
    per_point = _points_check(spot, nodes, float(pixels.sum()), rng)
    terms = {
        "source angles": angular_error(spot, nodes, rings, group) / size if size > 0.0 else 0.0,
        "source radii": radial_error(spot, nodes, rings.mean(axis=1), images.along) / size if size > 0.0 else 0.0,
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
    """Mean pixel image of each ring from its even and from its odd angles, and images of the first one of each.

    Shapes (rings, 2, rows, columns) and (rings, rows, columns).
    """

    pixels: FloatArray
    along: FloatArray
    pixel_error: float
    points: int
    handed_over: float


def _ring_images(spot: Spot, nodes: SourceNodes, group: list[Symmetry], done: Callable[[float], None]) -> _RingImages:
    """Follow the light of one point of every orbit of the symmetries."""
    images, along, errors, points, handed = [], [], [], 0, spot.tables.handed_over if spot.tables else 0.0
    for ring in range(len(nodes.rings)):
        chosen = list(orbits(nodes, ring, group))
        points += len(chosen)
        lights = lights_of(spot, nodes.rings[ring][[index for index, _ in chosen]])
        handed = max(handed, *(light.handed_over for light in lights))
        known = [(index, n, light) for (index, n), light in zip(chosen, lights, strict=True)]
        means = [mean_on_pixels(spot, [(n, light) for i, n, light in known if i % 2 == odd]) for odd in (0, 1)]
        images.append([pixels for pixels, _ in means])
        along.append(lights[0].on_pixels(spot))
        errors.append(max(error for _, error in means))
        done(sum(len(one) for one in nodes.rings[: ring + 1]) / len(nodes.all))
    return _RingImages(
        pixels=np.asarray(images),
        along=np.asarray(along),
        pixel_error=max(errors),
        points=points,
        handed_over=handed,
    )


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
