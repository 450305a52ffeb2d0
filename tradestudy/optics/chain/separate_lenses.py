"""Every pixel sees one microlens alone: what is left of an image without cross-talk."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.image import chain_image
from tradestudy.optics.chain.regions import IntArray
from tradestudy.optics.chain.scene import Legs, LightPath, PixelGrid
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.lens import PointSource


def separate_image(
    path: LightPath,
    source: PointSource | DiscSource,
    *,
    wavelength: float,
    legs: Legs,
    accuracy: ChainAccuracy,
    rng: np.random.Generator,
    done: Callable[[float], None] = lambda _share: None,
) -> ChainImage:
    """Light on every pixel from the microlens alone that lies before it, as seen from the middle of the main lens.

    Parameters and errors as of `chain_image`, which computes each microlens with its own pixels; what lands behind a
    neighbour is lost, and nothing interferes across microlenses. `done` hears of every microlens.
    """
    owner = nearest_microlens(path)
    pixels, errors, checks, effort, handed, passed = np.zeros(owner.shape), [], [], [], [], 0.0
    present = np.unique(owner)
    for number, index in enumerate(present, start=1):
        mine = owner == index
        window = _window(mine)
        alone = chain_image(
            microlens_alone(path, int(index), owner),
            source,
            wavelength=wavelength,
            legs=legs,
            accuracy=accuracy,
            rng=rng,
        )
        pixels[window] += np.where(mine[window], alone.pixels, 0.0)
        errors.append(alone.numerical_error * float(np.linalg.norm(alone.pixels)))
        checks.append(alone.direct_check)
        effort.append(alone.effort)
        passed += alone.microlens_share
        handed.append(alone.handed_over)
        done(number / len(present))
    size = float(np.linalg.norm(pixels))
    error = math.hypot(*errors) / size if size > 0.0 else 0.0
    return ChainImage(
        pixels=pixels,
        numerical_error=error,
        error_terms={"microlenses alone": error},
        direct_check={name: max(check[name] for check in checks) for name in checks[0]},
        microlens_share=passed,
        effort={name: sum(one[name] for one in effort) for name in effort[0]},
        handed_over=max(handed),
    )


def nearest_microlens(path: LightPath) -> IntArray:
    """Index of the microlens before each pixel, shape (rows, columns): centres lie 1 + b_L/z times farther out."""
    edges = path.pixels.edges_x, path.pixels.edges_y
    x, y = ((edge[1:] + edge[:-1]) / 2 for edge in edges)
    seen = path.microlenses.centres * (1.0 + path.detector_distance / path.array_distance)
    distance: FloatArray = np.hypot(x[None, :, None] - seen[:, 0], y[:, None, None] - seen[:, 1])
    # A hair in favour of the first, so that rounding does not decide where a pixel lies midway.
    return np.asarray(np.argmin(distance + 1e-9 * path.microlenses.pitch * np.arange(len(seen)), axis=-1))


def _window(mine: BoolArray) -> tuple[slice, slice]:
    """The smallest rectangle of pixels, as rows and columns, that holds all that are marked."""
    rows, columns = (np.flatnonzero(mine.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def microlens_alone(path: LightPath, index: int, owner: IntArray) -> LightPath:
    """One microlens and the pixels that it owns, of those that `nearest_microlens` gives it."""
    lenses, grid, window = path.microlenses, path.pixels, _window(owner == index)
    one = slice(index, index + 1)
    middle = [
        (edges[part.start] + edges[part.stop]) / 2
        for edges, part in zip((grid.edges_x, grid.edges_y), reversed(window), strict=True)
    ]
    shape = (window[0].stop - window[0].start, window[1].stop - window[1].start)
    return replace(
        path,
        microlenses=replace(lenses, centres=lenses.centres[one], focal_lengths=lenses.focal_lengths[one]),
        pixels=PixelGrid(
            pitch=grid.pitch, shape=shape, centre=(float(middle[0]), float(middle[1])), integrated=grid.integrated
        ),
    )
