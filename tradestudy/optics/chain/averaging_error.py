"""What the mean over the points of a disc lacks: a few more points tell how fast the errors of its rules fall."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.sources import SourceNodes, Symmetry, moved_image, orbits
from tradestudy.optics.chain.spot_points import Spot, lights_of, mean_on_pixels

_SAFETY_OF_ANGLES = 1.5  # two rings stand for all
_SAFETY_OF_RADII = 2.0  # one azimuth stands for all


def angular_error(spot: Spot, nodes: SourceNodes, rings: FloatArray, group: list[Symmetry]) -> float:
    """Error of half the angles, even against odd, which falls to that of all as it is measured to fall on two rings.

    There the angles in between are followed, too: the outermost ring, whose angles are the most starved, and one
    halfway to it.
    """
    half = np.tensordot(nodes.radial_weights, rings[:, 0] - rings[:, 1], axes=1) / 2
    falls = []
    for ring in {len(nodes.rings) // 2, len(nodes.rings) - 1}:
        of_half = float(np.linalg.norm(rings[ring, 0] - rings[ring, 1])) / 2
        of_all = float(np.linalg.norm(rings[ring].mean(axis=0) - _between(spot, nodes, ring, group))) / 2
        falls.append(min(of_all / of_half, 1.0) if of_half > 0.0 else 0.0)
    return _SAFETY_OF_ANGLES * max(falls) * float(np.linalg.norm(half))


def _between(spot: Spot, nodes: SourceNodes, ring: int, group: list[Symmetry]) -> FloatArray:
    """Mean pixel image of a ring from the angles halfway between its nodes."""
    at, middle = nodes.rings[ring], np.array([spot.source.x, spot.source.y])
    cosine, sine = math.cos(math.pi / len(at)), math.sin(math.pi / len(at))
    turned = middle + (at - middle) @ np.array([[cosine, sine], [-sine, cosine]])
    chosen = list(orbits(replace(nodes, rings=(turned,)), 0, group))
    lights = lights_of(spot, turned[[index for index, _ in chosen]])
    image = mean_on_pixels(spot, [(n, light) for (_, n), light in zip(chosen, lights, strict=True)])[0]
    return np.asarray(np.mean([moved_image(image, one) for one in group], axis=0))


def radial_error(spot: Spot, nodes: SourceNodes, rings: FloatArray, along: FloatArray) -> float:
    """Error of the rule along one azimuth, smaller as the mean over all angles is smoother than the light along one.

    The rule is held against the polynomial through its nodes and as many points between them. How much smoother the
    mean is, the highest Legendre coefficients tell that the rings resolve.

    Parameters
    ----------
    spot, nodes
        Disc, and its nodes.
    rings
        Mean pixel images of every ring, shape (rings, rows, columns).
    along
        Images of the first node of every ring, all at one azimuth, of the same shape.
    """
    turn = np.arccos(1 - 2 * nodes.radial_points)
    between = (1 - np.cos((np.r_[0.0, turn] + np.r_[turn, math.pi]) / 2)) / 2
    radii = spot.source.diameter / 2 * np.sqrt(between)
    places = np.column_stack([spot.source.x + radii, np.full(radii.size, spot.source.y)])
    more = np.array([light.on_pixels(spot) for light in lights_of(spot, places)])
    n = turn.size
    legendre = np.polynomial.legendre.legvander(2 * np.r_[nodes.radial_points, between] - 1, 2 * n)
    weights = np.linalg.solve(legendre.T, np.eye(2 * n + 1)[0])
    lacking = np.tensordot(weights, np.concatenate([along, more]), axes=1)
    lacking -= np.tensordot(nodes.radial_weights, along, axes=1)
    sharp, smooth = (_highest(nodes, images) for images in (along, rings))
    smoother = min(smooth / sharp, 1.0) if sharp > 0.0 else 1.0
    return _SAFETY_OF_RADII * smoother * float(np.linalg.norm(lacking))


def _highest(nodes: SourceNodes, images: FloatArray) -> float:
    """Size of the highest Legendre coefficients over the squared radius."""
    n = nodes.radial_points.size
    legendre = np.polynomial.legendre.legvander(2 * nodes.radial_points - 1, n - 1)[:, n - max(1, n // 8) :]
    return float(np.linalg.norm(np.tensordot((legendre * nodes.radial_weights[:, None]).T, images, axes=1)))
