"""The micro-images of a raw picture, each in a small square of whole pixels, and interpolation between them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.microlens_exposure import lattice_counts
from tradestudy.cameras.plenoptic import PlenopticCamera
from tradestudy.optics.arrays import BoolArray, FloatArray, Samples
from tradestudy.optics.window_matching import cubic_weights

Indices = NDArray[np.intp]
MARGIN: Final = 1
"""Width of the margin around a micro-image that gives all its pixels neighbours [px]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MicrolensGrid:
    """Microlenses whose micro-images lie on the sensor, numbered along both directions of the lattice.

    Parameters
    ----------
    first, second
        Numbers of each microlens, shape (lenses,).
    centre, image_centre
        Centre of each microlens and of its micro-image on the sensor [px], x and y as columns and rows of pixels, shape
        (2, lenses).
    pixel_pitch
        Width of a pixel [m].
    sensor_middle
        The middle of the sensor, shape (2, 1) [px].
    middle, image_middle
        Centre of the microlens with the numbers 0, 0, and of its micro-image if neither array nor sensor were tilted,
        shape (2, 1) [px].
    gap
        Distance from each microlens to the sensor [m], shape (lenses,).
    radius
        Radius of a micro-image [px].
    index
        Index of the lens with given numbers, relative to `low`; −1 for none.
    low
        Smallest number along each direction.
    basis
        Columns are the steps from a microlens to its neighbours [px].
    """

    first: Indices
    second: Indices
    centre: Samples
    image_centre: Samples
    pixel_pitch: float
    sensor_middle: Samples
    middle: Samples
    image_middle: Samples
    gap: Samples
    radius: float
    index: Indices
    low: tuple[int, int]
    basis: Samples

    @property
    def half(self) -> int:
        """Pixels from the middle of a square to its edge."""
        return math.ceil(self.radius)

    @property
    def side(self) -> int:
        """Side of a square [px]."""
        return 2 * self.half + 1

    @property
    def corner(self) -> Indices:
        """Column and row of the first pixel of every square, shape (2, lenses)."""
        return np.asarray(np.rint(self.image_centre).astype(np.intp) - self.half)

    def on_sensor(self, place: Samples) -> FloatArray:
        """Positions from the middle of the sensor [m] of positions (2, …) in pixels."""
        return np.asarray((place - self.sensor_middle) * self.pixel_pitch, np.float64)

    def beside(self, step: tuple[int, int]) -> Indices:
        """Index of the lens one step away from each; −1 for none."""
        return self.numbered(self.first + step[0], self.second + step[1])

    def numbered(self, first: Indices, second: Indices) -> Indices:
        """Index of the lenses with these numbers along both directions; −1 for none."""
        i, j = first - self.low[0], second - self.low[1]
        rows, columns = self.index.shape
        inside = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
        return np.where(inside, self.index[np.clip(i, 0, rows - 1), np.clip(j, 0, columns - 1)], -1)


def microlens_grid(camera: PlenopticCamera) -> MicrolensGrid:
    """The grid of a camera without errors."""
    (exposure,) = camera.exposures(1.0, {}, None, 0.0)  # the reference distance does not matter to the array
    array, sensor, geometry = exposure.microlenses, exposure.sensor, exposure.geometry
    rows, columns = lattice_counts(array, sensor)
    first, second = (
        grid.ravel()
        for grid in np.meshgrid(np.arange(-columns, columns + 1), np.arange(-rows, rows + 1), indexing="ij")
    )
    # In pixels, whose centres lie at whole numbers.
    middle = np.array([[sensor.columns], [sensor.rows]]) / 2.0 - 0.5
    over = float(geometry.image_spread({}))
    centre = exposure.centres(first, second)
    on_array = centre / sensor.pixel_pitch
    seen = exposure.image_centres(centre) / sensor.pixel_pitch + middle
    zero = np.zeros((2, 1))
    array_middle = middle + exposure.offset / sensor.pixel_pitch
    radius = array.pitch * (1.0 + over) / 2.0 / sensor.pixel_pitch
    lit = np.all((seen > -radius) & (seen < 2.0 * middle + radius), axis=0)
    first, second = first[lit], second[lit]
    low = (int(first.min()), int(second.min()))
    index = np.full((int(np.ptp(first)) + 1, int(np.ptp(second)) + 1), -1, np.intp)
    index[first - low[0], second - low[1]] = np.arange(first.size)
    steps = exposure.centres(np.array([1, 0]), np.array([0, 1])) / sensor.pixel_pitch
    return MicrolensGrid(
        first=first,
        second=second,
        centre=on_array[:, lit] + array_middle,
        image_centre=seen[:, lit],
        pixel_pitch=sensor.pixel_pitch,
        sensor_middle=middle,
        middle=array_middle,
        image_middle=middle + exposure.image_centres(zero) / sensor.pixel_pitch,
        gap=np.broadcast_to(exposure.place_of(centre).gap, lit.shape)[lit],
        radius=radius,
        index=index,
        low=low,
        basis=steps,
    )


def squares(grid: MicrolensGrid, picture: Samples, pure: BoolArray) -> Samples:
    """The micro-image of every lens with a margin of `MARGIN` pixels; NaN in pixels that do not show it.

    Returns
    -------
    Samples
        Shape (lenses, side + 2 margins, side + 2 margins).
    """
    rows, columns = picture.shape
    corner = grid.corner - MARGIN
    line = np.arange(grid.side + 2 * MARGIN)
    x, y = (corner[k][:, np.newaxis] + line for k in (0, 1))
    within = (
        np.square(x - grid.image_centre[0][:, np.newaxis])[:, np.newaxis, :]
        + np.square(y - grid.image_centre[1][:, np.newaxis])[:, :, np.newaxis]
        <= grid.radius**2
    )
    within &= ((y >= 0) & (y < rows))[:, :, np.newaxis] & ((x >= 0) & (x < columns))[:, np.newaxis, :]
    place = np.clip(y, 0, rows - 1)[:, :, np.newaxis], np.clip(x, 0, columns - 1)[:, np.newaxis, :]
    return np.where(within & pure[place], picture[place], picture.dtype.type(np.nan))


def smoothed(values: Samples) -> Samples:
    """Pictures smoothed by (1 6 1)/8 along the last two axes; the transfer is ``1 − sin²(π ν)/2`` along each.

    The result is ``p + (p₋ − 2p + p₊)/8``. Where a neighbour is missing, the second difference counts as 0, so that no
    pixel is lost and slopes are preserved up to the edge.
    """
    for axis in (-2, -1):
        lines = np.moveaxis(values, axis, -1)
        bend = np.zeros_like(lines)
        bend[..., 1:-1] = lines[..., 2:] - 2 * lines[..., 1:-1] + lines[..., :-2]
        values = np.moveaxis(lines + np.nan_to_num(bend) / 8, -1, axis)
    return np.ascontiguousarray(values)


def with_correlated_noise(gradient: Samples, window: int) -> Samples:
    """A gradient convolved with the correlation that `smoothed` leaves in white noise, (1 12 38 12 1)/64 along an axis.

    In a window of n pixels along an axis, a fraction 1 − k/n of them has a partner k apart. Missing pixels count as 0.
    """
    from scipy.ndimage import correlate1d

    kernel = np.array([1.0, 12.0, 38.0, 12.0, 1.0]) / 64.0 * (1.0 - np.abs(np.arange(-2, 3)) / window)
    convolved = np.nan_to_num(gradient)
    for axis in (-2, -1):
        convolved = correlate1d(convolved, kernel, axis=axis, mode="constant")
    return np.asarray(convolved)


def moved(source: Samples, lenses: Indices, place: Samples, side: int) -> Samples:
    """Squares of lenses interpolated at fractional positions (2, lenses): cubic, but linear beside missing pixels."""
    whole = np.floor(place).astype(np.intp)
    across, down = (cubic_weights(place[k] - whole[k]).astype(source.dtype) for k in (0, 1))
    wide, last = side + 3, source.shape[-1] - 1
    y, x = (whole[k][:, np.newaxis] - 1 + np.arange(wide) for k in (1, 0))
    beyond = ((y < 0) | (y > last))[:, :, np.newaxis] | ((x < 0) | (x > last))[:, np.newaxis, :]
    y, x = np.clip(y, 0, last), np.clip(x, 0, last)
    near = source[lenses[:, np.newaxis, np.newaxis], y[:, :, np.newaxis], x[:, np.newaxis, :]]
    near[beyond] = np.nan
    cubic = _weighted(near, across, down, 0)
    t, u = (np.asarray(place[k] - whole[k], source.dtype)[:, np.newaxis] for k in (0, 1))
    linear = _weighted(near, np.concatenate([1 - t, t], axis=1), np.concatenate([1 - u, u], axis=1), 1)
    return np.where(np.isnan(cubic), linear, cubic)


def _weighted(near: Samples, across: Samples, down: Samples, first: int) -> Samples:
    """Weighted sums of neighbours, starting at neighbour `first`."""
    side = near.shape[-1] - 3
    n = across.shape[1]
    columns = np.zeros((len(near), near.shape[1], side), near.dtype)
    for k in range(n):
        columns += across[:, k, np.newaxis, np.newaxis] * near[:, :, first + k : first + k + side]
    sums = np.zeros((len(near), side, side), near.dtype)
    for k in range(n):
        sums += down[:, k, np.newaxis, np.newaxis] * columns[:, first + k : first + k + side]
    return sums


def sampled(picture: Samples, place: Samples) -> Samples:
    """A picture interpolated at positions (2, points) [px]: cubic, but linear beside missing pixels and NaN on them."""
    corner = np.floor(place).astype(np.intp)
    rows, columns = picture.shape
    x, y = (np.add.outer(np.arange(-1, 3), corner[k]) for k in (0, 1))
    near = picture[np.clip(y, 0, rows - 1)[:, np.newaxis], np.clip(x, 0, columns - 1)[np.newaxis]]
    beyond = ((y < 0) | (y >= rows))[:, np.newaxis] | ((x < 0) | (x >= columns))[np.newaxis]
    near = np.where(beyond, np.nan, near)
    t, u = (place[k] - corner[k] for k in (0, 1))
    cubic = np.einsum("yxn,nx,ny->n", near, cubic_weights(t), cubic_weights(u))
    linear = np.einsum("yxn,xn,yn->n", near[1:3, 1:3], np.stack([1.0 - t, t]), np.stack([1.0 - u, u]))
    return np.asarray(np.where(np.isnan(cubic), linear, cubic))
