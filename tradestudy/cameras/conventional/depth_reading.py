"""Depth from focus: the picture of a stack in which a point is sharpest.

The pictures are rescaled to match the first one, since a lens focused closer magnifies more. The focus measure is the
energy of the gradient in a window, minus that of the noise. A parabola in inverse focus distance is fitted to its
logarithm, because the blur is proportional to the difference between inverse focus distance and inverse depth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.cameras.conventional.design import ConventionalCamera
from tradestudy.cameras.depth_map import DepthMap, DepthReader, DepthSearch, FlatPicture, TrueDepth, lies_within
from tradestudy.cameras.single_lens import SingleLensExposure
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, Samples
from tradestudy.optics.window_matching import Reason, gradient_along, odd_window, window_sum

LEAST_PICTURES: Final = 3
_NOISE_SPREAD: Final = 1.5  # ratio of the variance of the noise energy in one pixel to the square of its mean
_CERTAIN: Final = 4.0  # standard deviations by which the energy at the peak must exceed that of noise
_LARGEST_DEVIATION: Final = 0.5  # largest standard deviation of the peak's position, in steps of the stack


@dataclass(frozen=True, kw_only=True, eq=False)
class FocusStackReader(DepthReader):
    """Depth from a camera's focus stack; the map has the pixels of its first picture.

    Parameters
    ----------
    camera, search
        The camera, and the depths to search.

    Raises
    ------
    OutOfRangeError
        The stack has fewer than three pictures and therefore no peak.
    """

    camera: ConventionalCamera
    search: DepthSearch

    def __post_init__(self) -> None:
        if len(self._stack) < LEAST_PICTURES:
            raise OutOfRangeError(
                "too few pictures in a focus stack for depth from focus",
                value=str(len(self._stack)),
                limit=f"{LEAST_PICTURES} or more",
                remedy="allow more images over a wider range, or remove the camera from scene.image",
            )

    @property
    def _stack(self) -> list[SingleLensExposure]:
        return list(self.camera.exposures(self.search.far, {}, None, 0.0))

    def read(self, pictures: Mapping[str, FlatPicture]) -> DepthMap:
        """Depth where the sharpest picture lies between two others."""
        stack = self._stack
        window = odd_window(self.search.window_px)
        sums, lit = [], np.ones(pictures[stack[0].name].values.shape, bool)
        for exposure in stack:
            picture = pictures[exposure.name]
            scale = exposure.image_distance / stack[0].image_distance
            seen = _scaled(_gradient_energy(np.where(picture.pure, picture.values, np.nan)), scale)
            lit &= np.isfinite(seen)
            # A pixel without light would spoil every window that contains it; `lit` excludes the pixel itself.
            energies = np.stack([seen, _scaled(_noise_energy(picture.variance), scale)])
            energies[:, ~np.all(np.isfinite(energies), axis=0)] = 0.0
            # Magnification reduces gradients.
            sums.append(window_sum(energies, window) * (scale / window) ** 2)
        energy, noise = np.stack(sums, axis=1).astype(np.float64)
        signals = energy - noise
        inverse = 1.0 / np.array([exposure.focus_distance for exposure in stack])
        best = np.argmax(signals, axis=0)
        middle = np.clip(best, 1, len(stack) - 2)
        three = middle + np.array([-1, 0, 1])[:, np.newaxis, np.newaxis]
        signal, level = (np.take_along_axis(values, three, axis=0) for values in (signals, noise))
        at = inverse[three]
        present = np.maximum(signal, 0.0)
        # The energy (g + n)² of a gradient g with noise n scatters by n² and by 2 g n.
        spread = np.sqrt(_NOISE_SPREAD * np.square(level) + 2.0 * level * present) / window
        certain = (signal[1] > _CERTAIN * spread[1]) & np.all(signal > 0.0, axis=0)
        # Uncertain energies may have no logarithm.
        present = np.where(certain, signal, 1.0)
        peak, curvature, slopes = _vertex(at, np.log(present))
        error = np.sqrt(np.sum(np.square(slopes * spread / present), axis=0))
        certain &= error <= _LARGEST_DEVIATION * (at[0] - at[2]) / 2.0
        reason = np.full(best.shape, Reason.MEASURED, np.uint8)
        inside = (best == middle) & (curvature < 0.0) & (peak <= at[0]) & (peak >= at[2])
        reason[~certain] = Reason.TEXTURELESS
        reason[~inside] = Reason.OUT_OF_RANGE
        reason[~lit] = Reason.NO_LIGHT
        good = reason == Reason.MEASURED
        depth = np.where(good, 1.0 / np.where(good, peak, 1.0), np.nan)
        deviation = np.where(good, error * np.square(depth), np.nan)
        return DepthMap(
            depth=depth, deviation=deviation, disparity_deviation=np.full(depth.shape, np.nan), reason=reason
        )

    def truth(self, depths: Mapping[str, Samples], pure: Mapping[str, BoolArray]) -> TrueDepth:
        """True depth in the first picture; measurable within the range of the stack."""
        stack = self._stack
        first = stack[0].name
        depth = np.where(pure[first], depths[first], np.nan)
        ends = sorted(exposure.focus_distance for exposure in stack)
        return TrueDepth(depth=depth, measurable=lies_within(depth, ends[0], ends[-1]))


def _gradient_energy(values: Samples) -> Samples:
    across, down = (
        gradient_along(values, (1.0, 0.0)),
        np.swapaxes(gradient_along(np.swapaxes(values, 0, 1), (1.0, 0.0)), 0, 1),
    )
    return np.asarray(np.square(across) + np.square(down))


def _noise_energy(variance: Samples) -> Samples:
    """Gradient energy of noise alone: a central difference has a quarter of the summed variance of its two neighbours.

    Values at the rim are meaningless, but there is no gradient there either.
    """
    neighbours = np.stack([np.roll(variance, step, axis) for axis in (0, 1) for step in (-1, 1)])
    return np.asarray(np.mean(neighbours, axis=0))


def _scaled(values: Samples, scale: float) -> Samples:
    """Rescale a picture about its centre: each pixel takes the value nearest to ``scale`` times its position."""
    if scale == 1.0:
        return values
    index = [np.rint((np.arange(n) + 0.5 - n / 2.0) * scale + n / 2.0 - 0.5).astype(np.intp) for n in values.shape]
    inside = [(places >= 0) & (places < n) for places, n in zip(index, values.shape, strict=True)]
    picked = values[np.ix_(*(np.clip(places, 0, n - 1) for places, n in zip(index, values.shape, strict=True)))]
    return np.where(inside[0][:, np.newaxis] & inside[1][np.newaxis, :], picked, np.nan).astype(values.dtype)


def _vertex(x: Samples, y: Samples) -> tuple[Samples, Samples, Samples]:
    """Vertex of the parabola through three points, its second coefficient, and its derivatives with respect to y."""
    x0, x1, x2 = x
    d = np.stack([(x1 - x2), (x2 - x0), (x0 - x1)])
    e = np.stack([x1**2 - x2**2, x2**2 - x0**2, x0**2 - x1**2])
    top, bottom = np.sum(e * y, axis=0), 2.0 * np.sum(d * y, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):  # three equal values
        place = top / bottom
        slopes = (e - 2.0 * d * place) / bottom
    curvature = bottom / (2.0 * (x0 - x1) * (x0 - x2) * (x1 - x2))
    return place, curvature, slopes
