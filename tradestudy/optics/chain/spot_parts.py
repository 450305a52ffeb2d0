"""Independent parts of a spot's image: the light that some points of the source send to the pixels."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import lru_cache
from threading import Lock
from typing import Any

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy
from tradestudy.optics.chain.scene import Legs, LightPath
from tradestudy.optics.chain.sources import DiscSource, source_nodes, tolerated_density
from tradestudy.optics.chain.spot_points import PointLight, Spot, lights_of, mean_on_pixels, prepare_spot

_PREPARING = Lock()  # so that threads that begin together prepare a spot only once


@dataclass(frozen=True, kw_only=True, eq=False)
class AskedSpot:
    """Everything that a worker needs to prepare a spot by itself.

    Requests compare by identity; all copies of one request that reach another process become one object there.
    """

    path: LightPath
    source: DiscSource
    wavelength: float
    legs: Legs
    accuracy: ChainAccuracy

    def __reduce__(self) -> tuple[Any, ...]:
        return _received, (pickle.dumps({one.name: getattr(self, one.name) for one in fields(self)}),)

    def prepared(self) -> Spot:
        """Data shared by all points, kept for the latest request only: parts of one spot are computed in sequence."""
        with _PREPARING:
            return _prepared(self)


@lru_cache(maxsize=1)
def _received(content: bytes) -> AskedSpot:
    return AskedSpot(**pickle.loads(content))  # pickled by `AskedSpot.__reduce__`


@lru_cache(maxsize=1)
def _prepared(asked: AskedSpot) -> Spot:
    nodes = source_nodes(asked.path, asked.source, wavelength=asked.wavelength, density=source_density(asked.accuracy))
    return prepare_spot(asked.path, asked.source, nodes, asked.wavelength, asked.legs, asked.accuracy)


def forget_spot() -> None:
    """Free the tables of the spot that was prepared last."""
    _prepared.cache_clear()


def source_density(accuracy: ChainAccuracy) -> float:
    """Fraction of the cutoff to resolve: light near the cutoff is weak, and the pixel averages it away."""
    return accuracy.source_sampling * tolerated_density(accuracy)


@dataclass(frozen=True, kw_only=True)
class FollowedPoints:
    """Mean light of some points of a spot on the pixels.

    Attributes
    ----------
    pixels
        Weighted mean, shape (rows, columns).
    pixel_error
        Relative L2 error of its integration over the pixels.
    alone
        Image of each point that was requested separately, shape (points, rows, columns).
    handed_over
        Largest fraction that a boundary wave left to Kirchhoff's integral.
    effort
        Counts of nodes and samples for each point.
    """

    pixels: FloatArray
    pixel_error: float
    alone: FloatArray
    handed_over: float
    effort: dict[str, int]


def follow_points(
    asked: AskedSpot, places: FloatArray, weights: tuple[int, ...], alone: tuple[int, ...] = ()
) -> FollowedPoints:
    """Follow weighted source points, shape (n, 2); `alone` lists those whose images are also returned separately."""
    spot = asked.prepared()
    images, handed = [], [spot.tables.handed_over if spot.tables else 0.0]

    def followed() -> Iterator[tuple[int, PointLight]]:
        for number, (weight, light) in enumerate(zip(weights, lights_of(spot, places), strict=True)):
            handed.append(light.handed_over)
            if number in alone:
                images.append(light.on_pixels(spot))
            yield weight, light

    pixels, error = mean_on_pixels(spot, followed())
    return FollowedPoints(
        pixels=pixels,
        pixel_error=error,
        alone=np.array(images).reshape(-1, *pixels.shape),
        handed_over=max(handed),
        effort={
            "nodes per microlens": spot.plane.cell.x.size,
            "samples per patch": spot.samples**2,
        },
    )
