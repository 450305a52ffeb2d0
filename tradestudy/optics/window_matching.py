"""Disparity of two pictures within square windows: the best whole step, then its fraction, with standard deviations.

The least-squares shift of a window solves ``B(d) = Σ g (O(d) − R) = 0``: R is the window of the reference, O(d) the
other picture moved by d, and g the gradient of the reference along the direction of the disparity. That is the normal
equation of Lucas and Kanade in its inverse-compositional form. B is linear in O, so moving the other picture by a
fraction of a step and summing is the same as summing at whole steps and interpolating B. Therefore B is computed once
for every whole step, and the Newton steps for all windows cost a few operations each.

g and the noise of O are independent, and g is an odd difference of R. So neither the noise of the interpolated picture
nor that of the reference shifts the root: there is no pixel locking by noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray, Samples

_NEWTON_STEPS: Final = 4
_DOUBT: Final = 3.0  # standard deviations by which the best step must beat every other
_MISFIT: Final = 4.0  # standard deviations by which the residual may exceed that of noise alone
_SLACK: Final = 1.0  # fraction of the squared gradient that the fraction of a step may add to the residual
_BEYOND: Final = 0.01  # of a step by which a root may miss its bracket
_LEAST_RISE: Final = 0.1  # of the slope of B over the squared gradient, which is 1 without noise


class Reason(IntEnum):
    """Why a point has no depth; 0 where it has one."""

    MEASURED = 0
    NO_PARTNER = 1
    TEXTURELESS = 2
    AMBIGUOUS = 3
    NO_MATCH = 4
    INCONSISTENT = 5
    OUT_OF_RANGE = 6
    LESS_SHARP = 7
    NO_LIGHT = 8


REASONS: Final = {
    Reason.MEASURED: "measured",
    Reason.NO_PARTNER: "no second picture shows it, or too little of its window is in both",
    Reason.TEXTURELESS: "too little texture in the window",
    Reason.AMBIGUOUS: "two disparities fit equally well",
    Reason.NO_MATCH: "the two pictures differ by more than their noise",
    Reason.INCONSISTENT: "the match in the opposite direction disagrees, for example because the point is occluded",
    Reason.OUT_OF_RANGE: "the best match lies at an end of the search range",
    Reason.LESS_SHARP: "its microlens is not of the sharpest type at its depth",
    Reason.NO_LIGHT: "too little light reaches the pixel, or several microlenses light it",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Matches:
    """Disparities of all windows; all arrays have the shape of the reference.

    Parameters
    ----------
    disparity
        Disparity [steps]; NaN where none was measured.
    deviation
        Standard deviation due to the noise of both pictures [steps], from the texture of the window itself and the
        noise of each of its pixels: ``√(Σ g² v)/|B′(d)|``, where v is the variance of the difference. For smoothed
        pictures, one of the two factors g is `PairOfPictures.noise_gradient`.
    reason
        `Reason` for each window.
    """

    disparity: Samples
    deviation: Samples
    reason: NDArray[np.uint8]


def gradient_along(picture: Samples, direction: tuple[float, float]) -> Samples:
    """Scalar product of a vector (x, y) and the central differences over the last two axes; NaN at the edges."""
    gradient = np.full_like(picture, np.nan)
    across = (picture[..., 1:-1, 2:] - picture[..., 1:-1, :-2]) * picture.dtype.type(direction[0] / 2.0)
    down = (picture[..., 2:, 1:-1] - picture[..., :-2, 1:-1]) * picture.dtype.type(direction[1] / 2.0)
    if direction[1] == 0.0:  # no rows beside are needed
        gradient[..., 1:-1] = (picture[..., 2:] - picture[..., :-2]) * picture.dtype.type(direction[0] / 2.0)
    else:
        gradient[..., 1:-1, 1:-1] = across + down
    return gradient


def window_sum(values: Samples, window: int) -> Samples:
    """Sum over a square window around every pixel, over the last two axes; nothing is added beyond the edges."""
    from scipy.ndimage import uniform_filter1d

    for axis in (-1, -2):
        values = uniform_filter1d(values, window, axis=axis, mode="constant")
    return np.asarray(values * values.dtype.type(window * window))


def odd_window(window_px: float) -> int:
    """Odd number of pixels nearest to a declared window, at least 3.

    Raises
    ------
    OutOfRangeError
        For a window below 2 px.
    """
    if not window_px >= 2.0:
        raise OutOfRangeError("matching window", value=f"{window_px:g} px", limit="2 px or more")
    return max(3, 2 * round((window_px - 1.0) / 2.0) + 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class PairOfPictures:
    """Two pictures that a disparity moves against each other.

    Parameters
    ----------
    gradient
        Gradient of a picture at the same place per step of disparity, shape (…, rows, columns); NaN where undefined.
    difference
        Function of a whole step: the second picture moved back by it minus the first, the variance of the noise of this
        difference, and where both are valid. For smoothed pictures, the variance is that of the noise before smoothing.
    noise_gradient
        For smoothed pictures, the gradient convolved with the correlation c that smoothing leaves in white noise: for
        a smoothing kernel h and noise n of variance v, the variance of Σ g (h∗n) is Σ g (c∗g) v. None for pictures as
        taken.
    """

    gradient: Samples
    difference: Callable[[int], tuple[Samples, Samples, BoolArray]]
    noise_gradient: Samples | None = None


def match_windows(
    pairs: Sequence[PairOfPictures],
    steps: Sequence[int],
    *,
    window: int,
    least_share: float,
    largest_deviation: float,
    start: Samples | None = None,
) -> Matches:
    """Disparity of the window around every pixel, by least squares over all pairs of pictures.

    Parameters
    ----------
    pairs
        One pair, or several with independent noise that share one disparity.
    steps
        Six or more consecutive whole steps; disparities between the second and the last but one can be measured.
    window
        Side of the windows [px], odd. Where only part of a window lies in both pictures, that part is used.
    least_share
        Smallest fraction of a window's pixels that must be valid.
    largest_deviation
        Standard deviation above which a window counts as textureless [steps].
    start
        Whole steps known in advance, which replace the search; NaN where unknown.
    """
    misfit, error, size, noises, count, middle = _sums(pairs, steps, window)
    enough = count >= max(1.0, least_share * window * window * len(pairs))
    misfit = np.where(enough, misfit / np.maximum(count, 1), np.inf)
    error = np.where(enough, error, np.nan)
    if start is None:
        best = np.argmin(misfit, axis=0)
    else:
        best = np.clip(np.rint(np.nan_to_num(start)) - steps[0], 0, len(steps) - 1).astype(np.intp)
    # B rises through its root, so its sign at the best step tells on which side the root lies. The cubic through it
    # needs one step more on either side.
    first = np.where(_at(error, best) > 0.0, best - 1, best)
    inside = (first >= 1) & (first <= len(steps) - 3)
    first = np.clip(first, 1, len(steps) - 3)
    corner = np.stack([_at(error, first + k) for k in (-1, 0, 1, 2)])
    n, steepness = (np.maximum(_at(count, best), 1.0), _at(size, best))
    fraction, rise = _root(corner)
    least = _at(misfit, best)
    with np.errstate(divide="ignore", invalid="ignore"):  # no texture at all, refused below
        noise = np.where(np.isfinite(least), _at(noises, best) / steepness, np.nan)
        deviation = np.sqrt(noise / steepness) / np.abs(rise)
    spread = noise * np.sqrt(2.0 / n)  # of the mean of n squared normal errors
    # The last reason that applies stays: those that make the others meaningless come last.
    reason = np.full(n.shape, Reason.MEASURED, np.uint8)
    crosses = np.isfinite(fraction) & (np.abs(fraction - 0.5) <= 0.5 + _BEYOND) & (rise > _LEAST_RISE)
    fits = least <= noise + _MISFIT * spread + _SLACK * steepness / n
    reason[~(crosses & fits)] = Reason.NO_MATCH
    if start is None:
        # The steps beside the best one fit nearly as well: they belong to the same minimum.
        number = np.arange(len(steps)).reshape(-1, *([1] * best.ndim))
        rival = np.min(np.where(np.abs(number - best) >= 2, misfit, np.inf), axis=0)
        reason[rival < least + _DOUBT * np.sqrt(2.0) * spread] = Reason.AMBIGUOUS
    reason[~(deviation <= largest_deviation)] = Reason.TEXTURELESS
    reason[~inside] = Reason.OUT_OF_RANGE
    if start is not None:
        reason[~np.isfinite(start)] = Reason.NO_MATCH
    reason[~(np.any(enough, axis=0) & np.take_along_axis(middle, best[np.newaxis], axis=0)[0])] = Reason.NO_PARTNER
    good = reason == Reason.MEASURED
    return Matches(
        disparity=np.where(good, np.asarray(steps)[first] + fraction, np.nan),
        deviation=np.where(good, deviation, np.nan),
        reason=reason,
    )


def _sums(
    pairs: Sequence[PairOfPictures], steps: Sequence[int], window: int
) -> tuple[Samples, Samples, Samples, Samples, Samples, BoolArray]:
    """Window sums at every step: squared difference, B over Σ g², Σ g² itself, Σ g² times the variance, and pixels.

    The last item tells where both pictures see the pixel in the middle of the window: elsewhere, depth would be a
    guess.
    """
    shape, kind = pairs[0].gradient.shape, pairs[0].gradient.dtype
    misfit, moment, size, noise, count = (np.zeros((len(steps), *shape), kind) for _ in range(5))
    middle = np.zeros((len(steps), *shape), bool)
    for pair in pairs:
        defined = np.isfinite(pair.gradient)
        g = np.where(defined, pair.gradient, kind.type(0))
        on_noise = g if pair.noise_gradient is None else np.where(defined, pair.noise_gradient, kind.type(0))
        for k, step in enumerate(steps):
            difference, variance, visible = pair.difference(step)
            middle[k] |= visible
            usable = visible & defined
            difference = np.where(usable, difference, kind.type(0))
            misfit[k] += window_sum(difference * difference, window)
            moment[k] += window_sum(g * difference, window)
            size[k] += window_sum(g * g * usable, window)
            noise[k] += window_sum(g * on_noise * np.where(usable, variance, kind.type(0)), window)
            count[k] += window_sum(usable.astype(kind), window)
    with np.errstate(divide="ignore", invalid="ignore"):  # no texture at all
        return misfit, moment / size, size, noise, count, middle


def _at(cube: Samples, index: NDArray[np.intp]) -> Samples:
    return np.asarray(np.take_along_axis(cube, index[np.newaxis], axis=0)[0], np.float64)


def _root(corner: Samples) -> tuple[Samples, Samples]:
    """Where the cubic through four values at −1, 0, 1, 2 is zero between 0 and 1, and its slope at that point.

    A missing value is extrapolated linearly from its two neighbours.
    """
    before, low, high, after = corner
    high = np.where(np.isfinite(high), high, 2.0 * low - before)
    low = np.where(np.isfinite(low), low, 2.0 * high - after)
    before = np.where(np.isfinite(before), before, 2.0 * low - high)
    after = np.where(np.isfinite(after), after, 2.0 * high - low)
    c1 = high - before / 3.0 - low / 2.0 - after / 6.0
    c2 = (before + high) / 2.0 - low
    c3 = (after - before) / 6.0 + (low - high) / 2.0
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.clip(-low / (high - low), 0.0, 1.0)
        for _ in range(_NEWTON_STEPS):
            t = np.clip(t - (low + t * (c1 + t * (c2 + t * c3))) / (c1 + t * (2.0 * c2 + 3.0 * t * c3)), -0.5, 1.5)
        return t, c1 + t * (2.0 * c2 + 3.0 * t * c3)


def cubic_weights(fraction: ArrayLike) -> FloatArray:
    """Weights of the samples at −1, 0, 1 and 2 for a position t from 0 to 1, shape (…, 4); exact for cubics.

    They are Lagrange's polynomials: each is 1 at its own sample and 0 at the other three.
    """
    t = np.asarray(fraction, dtype=np.float64)
    return np.stack(
        [
            -t * (t - 1.0) * (t - 2.0) / 6.0,
            (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
            -(t + 1.0) * t * (t - 2.0) / 2.0,
            (t + 1.0) * t * (t - 1.0) / 6.0,
        ],
        axis=-1,
    )
