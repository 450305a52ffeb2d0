"""Image of an incoherent disc: the mean over its points, with the symmetry of the scene and the error of the mean."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.array_field import PupilWave
from tradestudy.optics.chain.arriving_light import RayWave, point_wave
from tradestudy.optics.chain.detector_patch import outermost
from tradestudy.optics.chain.point_image import compute_point, plan_point, reference_law
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
from tradestudy.optics.chain.spot_points import (
    PointLight,
    Spot,
    lights_of,
    mean_on_pixels,
    point_light,
    prepare_spot,
    tables_at,
)

_SAFETY_OF_ANGLES = 1.5  # one or two rings stand for all
_SAFETY_OF_RADII = 2.0  # one azimuth stands for all
AZIMUTHS = 8  # that every ring has
CHECKED_POINTS = 2
# So few points may err by less than others do (of the light spot at 0.1 %, by 0.006 to 0.012 %), and what all lack
# alike weighs more in the smoother picture of the spot.
_SAFETY_OF_TWO = 2.0
_SHARE_OF_NODES = 0.85  # of the time, about; the rest goes to points between them that tell the error
_MOST_DRAWN = 40
_HARDLY_ANY = 0.1  # of what a point brings on average


@dataclass(frozen=True, kw_only=True)
class AveragingErrors:
    """Errors of the mean over angles and over radii, L2 over the pixels, and how many points told them."""

    angles: float
    radii: float
    points: int


def averaging_errors(
    spot: Spot, nodes: SourceNodes, group: list[Symmetry], halves: FloatArray, brightness: FloatArray
) -> AveragingErrors:
    """Follow points between the nodes of a disc, and tell from them what the mean over the nodes lacks.

    Parameters
    ----------
    spot, nodes
        Disc, and its nodes.
    group
        Symmetries of the scene.
    halves
        Mean pixel images of each ring from its even and from its odd angles, shape (rings, 2, rows, columns).
    brightness
        L2 size of the pixel image of points at every eighth of a turn, zero where symmetries give it, shape
        (rings, AZIMUTHS).
    """
    angles, on_rings = _angular_error(spot, nodes, group, halves)
    radii, on_azimuth = _radial_error(spot, nodes, halves.mean(axis=1), brightness)
    return AveragingErrors(angles=angles, radii=radii, points=on_rings + on_azimuth)


def _angular_error(spot: Spot, nodes: SourceNodes, group: list[Symmetry], halves: FloatArray) -> tuple[float, int]:
    """Error of half the angles, even against odd, which falls to that of all as it is measured to fall.

    The angles in between are followed, too: on the ring where the halves differ most, and on that where it weighs most.
    """
    difference = (halves[:, 0] - halves[:, 1]) / 2
    size = np.linalg.norm(difference, axis=(1, 2))
    falls, points = [0.0], 0
    for ring in {int(np.argmax(size)), int(np.argmax(nodes.radial_weights * size))}:
        between, followed = _between(spot, nodes, ring, group)
        of_all = float(np.linalg.norm(halves[ring].mean(axis=0) - between)) / 2
        falls.append(min(of_all / size[ring], 1.0) if size[ring] > 0.0 else 0.0)
        points += followed
    half = float(np.linalg.norm(np.tensordot(nodes.radial_weights, difference, axes=1)))
    return _SAFETY_OF_ANGLES * max(falls) * half, points


def _between(spot: Spot, nodes: SourceNodes, ring: int, group: list[Symmetry]) -> tuple[FloatArray, int]:
    """Mean pixel image of a ring from the angles halfway between its nodes, and the points that it took."""
    at, middle = nodes.rings[ring], np.array([spot.source.x, spot.source.y])
    cosine, sine = math.cos(math.pi / len(at)), math.sin(math.pi / len(at))
    turned = middle + (at - middle) @ np.array([[cosine, sine], [-sine, cosine]])
    chosen = list(orbits(replace(nodes, rings=(turned,)), 0, group))
    lights = lights_of(spot, turned[[index for index, _ in chosen]])
    image = mean_on_pixels(spot, ((n, light) for (_, n), light in zip(chosen, lights, strict=True)))[0]
    return np.asarray(np.mean([moved_image(image, one) for one in group], axis=0)), len(chosen)


def _radial_error(spot: Spot, nodes: SourceNodes, rings: FloatArray, brightness: FloatArray) -> tuple[float, int]:
    """Error of the rule along the brightest azimuth, smaller as the mean over angles is smoother than its light.

    The rule is held against the polynomial through its nodes and as many points between them. How much smoother the
    mean is, the highest Legendre coefficients tell that the rings resolve.
    """
    azimuth = 2 * math.pi * int(np.argmax(nodes.radial_weights @ brightness)) / AZIMUTHS
    turn = np.arccos(1 - 2 * nodes.radial_points)
    squared = np.r_[nodes.radial_points, (1 - np.cos((np.r_[0.0, turn] + np.r_[turn, math.pi]) / 2)) / 2]
    direction = np.array([math.cos(azimuth), math.sin(azimuth)])
    places = np.array([spot.source.x, spot.source.y]) + np.outer(spot.source.diameter / 2 * np.sqrt(squared), direction)
    images = np.array([light.on_pixels(spot) for light in lights_of(spot, places)])
    n = turn.size
    legendre = np.polynomial.legendre.legvander(2 * squared - 1, 2 * n)
    weights = np.linalg.solve(legendre.T, np.eye(2 * n + 1)[0])
    weights[:n] -= nodes.radial_weights
    lacking = np.tensordot(weights, images, axes=1)
    sharp, smooth = (_highest(nodes, along) for along in (images[:n], rings))
    smoother = min(smooth / sharp, 1.0) if sharp > 0.0 else 1.0
    return _SAFETY_OF_RADII * smoother * float(np.linalg.norm(lacking)), len(places)


def _highest(nodes: SourceNodes, images: FloatArray) -> float:
    """Size of the highest Legendre coefficients over the squared radius."""
    n = nodes.radial_points.size
    legendre = np.polynomial.legendre.legvander(2 * nodes.radial_points - 1, n - 1)[:, n - max(1, n // 8) :]
    return float(np.linalg.norm(np.tensordot((legendre * nodes.radial_weights[:, None]).T, images, axes=1)))


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
        If tables, samples, or points by which the picture is checked need more memory than allowed.
    NotConvergedError
        If the image of a source point differs grossly from that of the single-point computation.
    """
    density = source_density(accuracy)
    nodes = source_nodes(path, source, wavelength=wavelength, density=density)
    for point in (source.centre, outermost(source, nodes)):  # what takes minutes is not begun in vain
        wave = point_wave(path, point, wavelength=wavelength, legs=legs)
        plan_point(_reference(wave), reference_law(legs.to_detector), accuracy.unstarved())
    spot = prepare_spot(path, source, nodes, wavelength, legs, accuracy)
    group = symmetries(path, source)
    images = _ring_images(spot, nodes, group, done)
    rings = np.mean([moved_image(images.pixels, one) for one in group], axis=0)
    pixels = np.tensordot(nodes.radial_weights, rings.mean(axis=1), axes=1)
    size = float(np.linalg.norm(pixels))
    lacking = averaging_errors(spot, nodes, group, rings, images.brightness)
    done(1.0)
    per_point = _points_check(spot, nodes, float(pixels.sum()), rng)
    terms = {
        "source angles": lacking.angles / size if size > 0.0 else 0.0,
        "source radii": lacking.radii / size if size > 0.0 else 0.0,
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
            "source points": images.points + lacking.points,
            "source nodes": nodes.all.shape[0],
            "nodes per microlens": spot.plane.cell.x.size,
            "samples per patch": spot.response.transfer.count**2,
        },
        handed_over=images.handed_over,
    )


def followed_points(path: LightPath, source: DiscSource, nodes: SourceNodes) -> float:
    """Points of a disc that are followed: nodes without those that symmetries give, and points between them, about."""
    group = symmetries(path, source)
    distinct = sum(1 for ring in range(len(nodes.rings)) for _ in orbits(nodes, ring, group))
    return distinct + 2 * max(map(len, nodes.rings)) / len(group) + 2 * len(nodes.rings) + 1


def source_density(accuracy: ChainAccuracy) -> float:
    """Share of the cutoff to resolve: the light near it is weak, and the pixel averages it away."""
    return accuracy.source_sampling * tolerated_density(accuracy)


@dataclass(frozen=True, kw_only=True)
class _RingImages:
    """Mean pixel image of each ring from its even and from its odd angles, and L2 sizes of images at common azimuths.

    Shapes (rings, 2, rows, columns) and (rings, AZIMUTHS).
    """

    pixels: FloatArray
    brightness: FloatArray
    pixel_error: float
    points: int
    handed_over: float


def _ring_images(spot: Spot, nodes: SourceNodes, group: list[Symmetry], done: Callable[[float], None]) -> _RingImages:
    """Follow the light of one point of every orbit of the symmetries."""
    images, errors, points, handed = [], [], 0, [spot.tables.handed_over if spot.tables else 0.0]
    brightness = np.zeros((len(nodes.rings), AZIMUTHS))

    def followed(ring: int, part: list[tuple[int, int]]) -> Iterator[tuple[int, PointLight]]:
        lights = lights_of(spot, nodes.rings[ring][[index for index, _ in part]])
        for (index, n), light in zip(part, lights, strict=True):
            handed.append(light.handed_over)
            azimuth, between = divmod(AZIMUTHS * index, len(nodes.rings[ring]))
            if not between:
                brightness[ring, azimuth] = np.linalg.norm(light.on_pixels(spot))
            yield n, light

    for ring in range(len(nodes.rings)):
        chosen = list(orbits(nodes, ring, group))
        points += len(chosen)
        halves = [[(i, n) for i, n in chosen if i % 2 == odd] for odd in (0, 1)]
        lights = followed(ring, halves[0] + halves[1])
        means = [mean_on_pixels(spot, islice(lights, len(half))) for half in halves]
        images.append([pixels for pixels, _ in means])
        errors.append(max(error for _, error in means))
        done(_SHARE_OF_NODES * sum(len(one) for one in nodes.rings[: ring + 1]) / len(nodes.all))
    return _RingImages(
        pixels=np.asarray(images),
        brightness=brightness,
        pixel_error=max(errors),
        points=points,
        handed_over=max(handed),
    )


def _reference(wave: PupilWave | RayWave) -> PupilWave | RayWave:
    return wave.reference if isinstance(wave, PupilWave) else wave


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
        if len(squares) == CHECKED_POINTS:
            break
        at = (float(pick[0]), float(pick[1]))
        fast = point_light(spot, at, tables_at(spot, [at])[at]).on_pixels(spot)
        left = len(picks) - number
        if fast.sum() < _HARDLY_ANY * light and left > CHECKED_POINTS - len(squares):
            continue
        wave = spot.wave(*at)
        law = reference_law(spot.legs.to_detector)
        truth = compute_point(_reference(wave), law, finer).pixels / wave.power()
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
