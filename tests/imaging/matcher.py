"""Pictures of random texture, and a sub-pixel matcher that knows nothing of the bound it is held against.

The texture is drawn in Fourier space on a finer grid than the pixels, blurred there, shifted, integrated over pixels
and sampled, so that it may be aliased; the matcher is Lucas and Kanade's, on quintic splines.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter
from scipy.special import j1

Array = NDArray[np.float64]
MARGIN = 8  # pixels around a window that splines and smoothing need


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What is drawn: electrons, texture and blur in pixels, noise in electrons."""

    electrons: float
    contrast: float
    length_px: float
    blur_px: float
    noise: float
    window: int
    oversampling: int = 4

    def amplitude(self, size: int) -> tuple[Array, Array]:
        """Fourier amplitude of the blurred, pixel-integrated texture on the fine periodic grid, and its ν_x."""
        fine = size * self.oversampling
        nu = np.fft.fftfreq(fine, 1.0 / self.oversampling)
        x, y = np.meshgrid(nu, nu)
        r = np.hypot(x, y)
        density = 2 * np.pi * (self.contrast * self.length_px) ** 2 / (1 + (2 * np.pi * self.length_px * r) ** 2) ** 1.5
        q = np.pi * self.blur_px * np.where(r > 0, r, 1.0)
        disc = np.where(r * self.blur_px > 0, 2 * j1(q) / np.where(q > 0, q, 1.0), 1.0)
        # White noise of variance 1 per fine sample has the density 1/oversampling² per px².
        return self.electrons * np.sqrt(density) * self.oversampling * disc * np.sinc(x) * np.sinc(y), x


def picture_pairs(scene: Scene, disparity: Array, per_disparity: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Noisy pictures, and the same surfaces moved to the right by the disparities [px]; shape (pairs, size, size).

    One large periodic surface is drawn for each disparity and cut into pictures that stand in order of it.
    """
    size = scene.window + 2 * MARGIN
    across = math.ceil(math.sqrt(per_disparity))
    amplitude, x = scene.amplitude(next_fast_len(across * size))
    step = scene.oversampling
    pairs: tuple[list[Array], list[Array]] = ([], [])
    for d in disparity:
        drawn = np.fft.fft2(rng.standard_normal(amplitude.shape)) * amplitude
        for pictures, shift in zip(pairs, (0.0, d), strict=True):
            surface = np.fft.ifft2(drawn * np.exp(-2j * np.pi * x * shift)).real[::step, ::step]
            surface = surface + scene.noise * rng.standard_normal(surface.shape)
            cuts = [(row * size, column * size) for row in range(across) for column in range(across)]
            pictures += [surface[r : r + size, c : c + size] for r, c in cuts[:per_disparity]]
    return np.stack(pairs[0]), np.stack(pairs[1])


def lucas_kanade(left: Array, right: Array, window: int, *, smoothing: float, start: float, rounds: int = 12) -> float:
    """Disparity [px] that brings the window of one picture onto the other: Gauss–Newton on the squared differences.

    Both pictures are smoothed by a small Gaussian, the other is interpolated by quintic splines, the slope is the mean
    of both; NaN where it does not settle within the picture.
    """
    size = left.shape[0]
    first, second = ((gaussian_filter(p, smoothing) if smoothing > 0 else p) for p in (left, right))
    low = (size - window) // 2
    rows, columns = np.mgrid[low : low + window, low : low + window].astype(float)
    splines = [spline_filter(p, order=5) for p in (first, second)]

    def sampled(k: int, shift: float) -> Array:
        return map_coordinates(splines[k], [rows, columns + shift], order=5, prefilter=False)

    template, eps = sampled(0, 0.0), 1e-3
    slope_left = (sampled(0, eps) - sampled(0, -eps)) / (2 * eps)
    d = start
    for _ in range(rounds):
        moved = sampled(1, d)
        slope = (slope_left + (sampled(1, d + eps) - sampled(1, d - eps)) / (2 * eps)) / 2
        difference = template - moved
        difference = difference - difference.mean()
        step = float(np.sum(slope * difference) / np.sum(slope * slope))
        d += step
        if abs(d) > MARGIN - 3:
            return np.nan
        if abs(step) < 1e-6:
            return d
    return d


def best_integer(left: Array, right: Array, window: int, reach: int) -> int:
    """Whole-pixel disparity of the least sum of squared differences within ±reach."""
    low = (left.shape[0] - window) // 2
    template = left[low : low + window, low : low + window]
    costs = [
        np.sum((template - right[low : low + window, low + d : low + d + window]) ** 2)
        for d in range(-reach, reach + 1)
    ]
    return int(np.argmin(costs)) - reach
