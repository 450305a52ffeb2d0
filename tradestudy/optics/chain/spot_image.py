"""Image of an incoherent disc: the mean over its points, with the symmetry of the scene and the error of the mean."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage, ComputeParts
from tradestudy.optics.chain.arriving_light import point_wave
from tradestudy.optics.chain.lit_part import light_left_out, lit_disc
from tradestudy.optics.chain.point_image import compute_point, plan_point, reference_law
from tradestudy.optics.chain.scene import Legs, LightPath
from tradestudy.optics.chain.sources import (
    DiscSource,
    SourceNodes,
    Symmetry,
    moved_image,
    orbits,
    symmetries,
)
from tradestudy.optics.chain.spot_points import (
    FollowedPoints,
    SpotRequest,
    follow_points,
    forget_spot,
)

_SAFETY_OF_ANGLES = 1.5  # one or two rings represent all rings
_SAFETY_OF_RADII = 2.0  # one azimuth represents all azimuths
AZIMUTHS = 8  # at which all rings have points
CHECKED_POINTS = 2
# The few points that are checked may err less than the others (for the light spot at 0.1 %, by 0.006 to 0.012 %), and
# an error common to all points weighs more in the smoother picture of the spot.
_SAFETY_OF_TWO = 2.0
_SHARE_OF_NODES = (
    0.85  # approximate share of the time; the rest goes to points between the nodes that estimate the error
)
_MOST_DRAWN = 40
_AT_ONCE = 8  # points between the rings in one part of the work
_LEFT_OUT = 0.5  # of the tolerance that the part of a disc taken as dark may contribute
_HARDLY_ANY = 0.1  # of the average light of a point: points with less count as dark


def _turned_ring(request: SpotRequest, nodes: SourceNodes, ring: int, group: list[Symmetry]) -> partial[FollowedPoints]:
    """Points halfway between the angles of a ring, apart from those that symmetries yield."""
    points, middle = nodes.rings[ring], np.array([request.source.x, request.source.y])
    cosine, sine = math.cos(math.pi / len(points)), math.sin(math.pi / len(points))
    turned = middle + (points - middle) @ np.array([[cosine, sine], [-sine, cosine]])
    chosen = list(orbits(replace(nodes, rings=(turned,)), 0, group))
    return partial(follow_points, request, turned[[index for index, _ in chosen]], tuple(n for _, n in chosen))


def _angular_error(nodes: SourceNodes, halves: FloatArray, between: dict[int, FloatArray]) -> float:
    """Error of the mean over all angles, from the difference between even and odd angles and its measured decrease.

    Parameters
    ----------
    nodes
        Nodes of the disc.
    halves
        Mean pixel images of each ring from its even and from its odd angles, shape (rings, 2, rows, columns).
    between
        Mean pixel images of some rings from points halfway between their angles.
    """
    difference = (halves[:, 0] - halves[:, 1]) / 2
    falls = [0.0]
    for ring, image in between.items():
        size = float(np.linalg.norm(difference[ring]))
        of_all = float(np.linalg.norm(halves[ring].mean(axis=0) - image)) / 2
        falls.append(min(of_all / size, 1.0) if size > 0.0 else 0.0)
    half = float(np.linalg.norm(np.tensordot(nodes.radial_weights, difference, axes=1)))
    return _SAFETY_OF_ANGLES * max(falls) * half


def _along_radius(
    source: DiscSource, nodes: SourceNodes, eighths: list[dict[int, FloatArray]]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Squared relative radii of rings and of points between them, images of the rings, and positions of the points.

    All lie along the brightest azimuth. `eighths` contains the pixel images of points at eighths of a turn on each
    ring, without those that symmetries yield; these are the same for every ring.
    """
    sizes = {eighth: [np.linalg.norm(ring[eighth]) for ring in eighths] for eighth in eighths[0]}
    brightest = max(sizes, key=lambda eighth: float(nodes.radial_weights @ sizes[eighth]))
    azimuth = 2 * math.pi * brightest / AZIMUTHS
    # Halfway in the angle α of t = sin²(α/2), in which Gauss's nodes are almost evenly spaced.
    turn = np.arccos(1 - 2 * nodes.radial_points)
    between = (1 - np.cos((np.r_[0.0, turn] + np.r_[turn, math.pi]) / 2)) / 2
    direction = np.array([math.cos(azimuth), math.sin(azimuth)])
    places = np.array([source.x, source.y]) + np.outer(source.diameter / 2 * np.sqrt(between), direction)
    return np.r_[nodes.radial_points, between], np.array([ring[brightest] for ring in eighths]), places


def _radial_error(nodes: SourceNodes, rings: FloatArray, squared: FloatArray, images: FloatArray) -> float:
    """Error of the rule along the brightest azimuth, reduced because the mean over angles is smoother.

    The rule is compared with the polynomial through its nodes and as many points between them. The highest Legendre
    coefficients that the rings resolve tell how much smoother the mean is.

    Parameters
    ----------
    nodes, rings
        Nodes of the disc, and the mean pixel image of each ring.
    squared, images
        Squared relative radii along that azimuth, rings first, and the pixel image at each of them.
    """
    n = nodes.radial_points.size
    legendre = np.polynomial.legendre.legvander(2 * squared - 1, 2 * n)
    # Over the squared radius, all Legendre polynomials but the constant one have the mean 0.
    weights = np.linalg.solve(legendre.T, np.eye(2 * n + 1)[0])
    weights[:n] -= nodes.radial_weights
    lacking = np.tensordot(weights, images, axes=1)
    sharp, smooth = (_highest(nodes, along) for along in (images[:n], rings))
    smoother = min(smooth / sharp, 1.0) if sharp > 0.0 else 1.0
    return _SAFETY_OF_RADII * smoother * float(np.linalg.norm(lacking))


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
    done: Callable[[float], None],
    compute: ComputeParts,
) -> ChainImage:
    """Image of an incoherent disc by wave optics, averaged over its area.

    Parameters
    ----------
    path, source
        Camera and disc.
    wavelength
        Wavelength [m].
    legs
        Law of each leg; the leg behind the array carries waves.
    accuracy
        Tolerance and sampling.
    rng
        Draws the source points whose image is checked.
    done
        Called with the completed fraction of the points.
    compute
        Computes the points of the rings and those that check the picture.

    Raises
    ------
    UnaffordableError
        If tables, samples, or points that check the picture need more memory than allowed.
    NotConvergedError
        If the image of a source point differs grossly from that of the single-point computation.
    """
    request = SpotRequest(path=path, source=source, wavelength=wavelength, legs=legs, accuracy=accuracy)
    tolerance = accuracy.tolerance
    lit = lit_disc(path, source, wavelength=wavelength, tolerance=tolerance)
    # The whole disc is computed only if its dark part turns out to matter: it may be far larger than the lit one.
    if lit != source:
        image, edge = _disc_image(replace(request, source=lit), rng, done, compute)
        beyond = light_left_out(path, source, lit, edge, wavelength=wavelength, tolerance=tolerance)
        left_out = beyond / (float(np.linalg.norm(image.pixels)) or math.inf)
        if left_out <= _LEFT_OUT * tolerance:
            return replace(
                image,
                pixels=image.pixels * (lit.diameter / source.diameter) ** 2,
                numerical_error=math.hypot(image.numerical_error, left_out),
                error_terms=image.error_terms | {"dark part of the source": left_out},
            )
    return _disc_image(request, rng, done, compute)[0]


def refuse_large_disc(
    path: LightPath, source: DiscSource, *, wavelength: float, legs: Legs, accuracy: ChainAccuracy
) -> None:
    """Refuse the image of a disc that the memory could not hold, before anything is computed.

    Raises
    ------
    UnaffordableError
        If tables, the transfer behind a microlens, or single points that are checked need more memory than allowed.
    """
    lit = lit_disc(path, source, wavelength=wavelength, tolerance=accuracy.tolerance)
    request = SpotRequest(path=path, source=lit, wavelength=wavelength, legs=legs, accuracy=accuracy)
    request.refuse_large()
    _refuse_large_points(request)


def _refuse_large_points(request: SpotRequest) -> None:
    for point in (request.source.centre, request.outermost):
        wave = point_wave(request.path, point, wavelength=request.wavelength, legs=request.legs)
        plan_point(wave.reference, reference_law(request.legs.to_detector), request.accuracy.unstarved())


def _disc_image(
    request: SpotRequest, rng: np.random.Generator, done: Callable[[float], None], compute: ComputeParts
) -> tuple[ChainImage, FloatArray]:
    """The image of a whole disc, and the mean image of its outermost ring of nodes; errors as for `wave_spot_image`."""
    source, nodes = request.source, request.nodes
    _refuse_large_points(request)  # before minutes of computation
    group = symmetries(request.path, source)
    images = _ring_images(request, nodes, group, compute, lambda share: done(_SHARE_OF_NODES * share))
    rings = np.mean([moved_image(images.pixels, turn) for turn in group], axis=0)
    pixels = np.tensordot(nodes.radial_weights, rings.mean(axis=1), axes=1)
    # The ring whose halves differ most, and the ring where the weighted difference is largest.
    apart = np.linalg.norm(rings[:, 0] - rings[:, 1], axis=(1, 2))
    uneven = sorted({int(np.argmax(apart)), int(np.argmax(nodes.radial_weights * apart))})
    squared, on_rings, radial = _along_radius(source, nodes, images.eighths)
    picks = rng.choice(nodes.all, size=min(_MOST_DRAWN, len(nodes.all)), replace=False)
    turned = [_turned_ring(request, nodes, ring, group) for ring in uneven]
    chunks = np.array_split(radial, -(-len(radial) // _AT_ONCE))
    # In `followed`, the turned rings come first, then the points along the brightest azimuth.
    *followed, per_point = compute(
        [
            *turned,
            *(
                partial(follow_points, request, points, (1,) * len(points), tuple(range(len(points))))
                for points in chunks
            ),
            partial(_points_error, request, picks, float(pixels.sum())),
        ],
        lambda share: done(_SHARE_OF_NODES + (1 - _SHARE_OF_NODES) * share),
    )
    forget_spot()
    between = {
        ring: np.asarray(np.mean([moved_image(points.pixels, turn) for turn in group], axis=0))
        for ring, points in zip(uneven, followed, strict=False)
    }
    along = np.concatenate([on_rings, *(points.alone for points in followed[len(uneven) :])])
    size = float(np.linalg.norm(pixels)) or math.inf  # no light: no error
    terms = {
        "source angles": _angular_error(nodes, rings, between) / size,
        "source radii": _radial_error(nodes, rings.mean(axis=1), squared, along) / size,
        "single points": per_point,
        "pixel integration": images.pixel_error,
    }
    image = ChainImage(
        pixels=pixels,
        numerical_error=math.hypot(*terms.values()),
        error_terms=terms,
        direct_check={},
        microlens_share=math.nan,
        effort={
            "source points": images.points + sum(len(part.args[1]) for part in turned) + len(radial),
            "source nodes": nodes.all.shape[0],
            **images.effort,
        },
        handed_over=images.handed_over,
    )
    return image, np.asarray(rings[-1].mean(axis=0))


def followed_points(path: LightPath, source: DiscSource, nodes: SourceNodes) -> float:
    """Approximate number of points followed: nodes apart from those that symmetries yield, and points between them."""
    group = symmetries(path, source)
    distinct = sum(1 for ring in range(len(nodes.rings)) for _ in orbits(nodes, ring, group))
    return distinct + 2 * max(map(len, nodes.rings)) / len(group) + len(nodes.rings) + 1


@dataclass(frozen=True, kw_only=True)
class _RingImages:
    """Mean pixel images of each ring, from its even and from its odd angles, and images of points at common azimuths.

    The means have shape (rings, 2, rows, columns); the images are listed for each ring by the eighth of a turn.
    """

    pixels: FloatArray
    eighths: list[dict[int, FloatArray]]
    pixel_error: float
    points: int
    handed_over: float
    effort: dict[str, int]


def _ring_images(
    request: SpotRequest,
    nodes: SourceNodes,
    group: list[Symmetry],
    compute: ComputeParts,
    progress: Callable[[float], None],
) -> _RingImages:
    """Follow the light of one point of every set of points that the symmetries map onto each other."""
    parts, eighths = [], []
    for ring, points in enumerate(nodes.rings):
        chosen = list(orbits(nodes, ring, group))
        for odd in (0, 1):
            half = [(index, n) for index, n in chosen if index % 2 == odd]
            azimuths = {
                number: AZIMUTHS * index // len(points)
                for number, (index, _) in enumerate(half)
                if AZIMUTHS * index % len(points) == 0
            }
            eighths.append((ring, list(azimuths.values())))
            places, weights = points[[index for index, _ in half]], tuple(n for _, n in half)
            parts.append(partial(follow_points, request, places, weights, tuple(azimuths)))
    followed: list[FollowedPoints] = compute(parts, progress)
    images: list[dict[int, FloatArray]] = [{} for _ in nodes.rings]
    for (ring, at_eighths), ring_half in zip(eighths, followed, strict=True):
        images[ring] |= zip(at_eighths, ring_half.alone, strict=True)
    pixels = np.array([points.pixels for points in followed])
    return _RingImages(
        pixels=pixels.reshape(len(nodes.rings), 2, *pixels.shape[1:]),
        eighths=images,
        pixel_error=max(points.pixel_error for points in followed),
        points=sum(len(part.args[1]) for part in parts),
        handed_over=max(points.handed_over for points in followed),
        effort=followed[0].effort,
    )


def _points_error(request: SpotRequest, picks: FloatArray, light: float) -> float:
    """Relative L2 difference of random source points' pixels from the single-point computation, with a safety factor.

    Points with hardly any light reveal nothing about the picture; they are skipped unless all are dark. A boundary wave
    is compared with Kirchhoff's integral: the error of its leading term is stated, not refused.
    """
    squares: list[float] = []
    sizes: list[float] = []
    spot = request.prepared()
    law, finer = reference_law(request.legs.to_detector), request.accuracy.unstarved()
    for number, pick in enumerate(picks):
        if len(squares) == CHECKED_POINTS:
            break
        place = (float(pick[0]), float(pick[1]))
        fast = spot.light(place).on_pixels(spot)
        remaining = len(picks) - number
        if fast.sum() < _HARDLY_ANY * light and remaining > CHECKED_POINTS - len(squares):
            continue
        wave = request.wave(*place)
        truth = compute_point(wave.reference, law, finer).pixels / wave.power()
        squares.append(float(np.sum((fast - truth) ** 2)))
        sizes.append(float(np.sum(truth**2)))
    if not any(squares):
        return 0.0  # neither finds any light
    error = math.sqrt(sum(squares) / sum(sizes)) if any(sizes) else math.inf
    if error > 0.3 and "boundary_wave" not in (request.legs.to_array, request.legs.to_detector):
        raise NotConvergedError(
            "points of the spot disagree with the single-point computation",
            value=f"{error:.2g}",
            limit="0.3",
            remedy="refine diffraction_reach, microlens_nodes or pupil_nodes",
        )
    return _SAFETY_OF_TWO * error
