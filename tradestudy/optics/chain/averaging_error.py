"""What the mean over the points of a disc lacks: a few more points tell how fast the errors of its rules fall."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.sources import SourceNodes, Symmetry, moved_image, orbits
from tradestudy.optics.chain.spot_points import Spot, lights_of, mean_on_pixels

_SAFETY_OF_ANGLES = 1.5  # one or two rings stand for all
_SAFETY_OF_RADII = 2.0  # one azimuth stands for all
AZIMUTHS = 8  # that every ring has


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
