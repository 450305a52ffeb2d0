"""What leaving calibration out, or propagating it along a line, does to a usable range that failures limit.

All shares are of the true matches: false ones are as many whatever model acts, and would hide how the rest depends on
distance.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.analysis.depth import DepthErrors, model_error
from tradestudy.cameras.depth_camera import DepthCamera, false_match_share
from tradestudy.effects.models import OFF
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.study.acting import acting

_BESIDE: Final = 1e-2  # of the distance of an end, for the slope there
_AT_AN_END: Final = 0.05  # as near to an end a fraction is as good as at its limit


def of_true_matches(camera: DepthCamera, failed: ArrayLike) -> FloatArray:
    """What a failed fraction, or its bound, is of the true matches alone; below 0 for one that false ones exceed."""
    share = false_match_share(camera)
    return np.asarray((np.asarray(failed) - share) / (1.0 - share))


def failed_fraction(camera: DepthCamera, distance: FloatArray) -> FloatArray:
    """Share of true matches that end beyond infinity, by the model of propagation that acts."""
    return of_true_matches(camera, DepthErrors.of(camera, distance).failed_fraction)


def verdict_changed_without_calibration(camera: DepthCamera, bound: float, distance: FloatArray) -> BoolArray:
    """Where a limit of the failed fraction is kept by noise alone and broken by all errors, or the reverse."""
    without = failed_fraction(acting(camera, {"calibration": OFF}), distance)
    return np.asarray((without <= bound) != (failed_fraction(camera, distance) <= bound))


def shift_without_calibration(camera: DepthCamera, bound: float, ends: FloatArray) -> float:
    """The largest relative shift, to first order, of ends that the failed fraction sets; infinite if none fail."""
    own = failed_fraction(camera, ends)
    by_failures = _near(own, bound)
    if not by_failures.any():
        return 0.0
    without = failed_fraction(acting(camera, {"calibration": OFF}), ends[by_failures])
    with np.errstate(divide="ignore"):
        moved = np.abs(np.log(without / own[by_failures]))
    return float(np.max(moved / _slope(camera, ends[by_failures])))


def missed_by_the_line(
    camera: DepthCamera, bound: float, places: FloatArray, failed: FloatArray, ends: FloatArray
) -> float:
    """What a line may move an end that failures set, relative; infinite where it cannot tell whether a limit is kept.

    Parameters
    ----------
    camera
        With the line acting.
    bound
        Largest failed fraction.
    places, failed, ends
        Distances [m], the failed fraction there by the line, and the ends of usable ranges [m].
    """
    apart = np.ones(places.shape, dtype=bool)
    for end in ends:
        apart &= np.abs(np.log(places / end)) > _AT_AN_END
    close = np.flatnonzero(apart & (failed > bound / _FAR) & (failed < bound * _FAR))  # else no error reaches it
    if close.size:
        close = close[np.unique(np.linspace(0, close.size - 1, _PLACES).round().astype(int))]
        error = _error(camera, places[close])
        if np.any((error > 0.0) & (np.abs(failed[close] - bound) <= error)):
            return np.inf
    if not ends.size:
        return 0.0
    own = failed_fraction(camera, ends)
    set_here = ends[_near(own, bound)]
    if not set_here.size:
        return 0.0
    error = np.nan_to_num(_error(camera, set_here))
    return float(np.max(np.log1p(error / failed_fraction(camera, set_here)) / _slope(camera, set_here)))


_TINY: Final = 1e-300
_FAR: Final = 30.0
_PLACES: Final = 9
_NEAR: Final = 1.0  # of a logarithm: an end is known to a hundredth, over which a fraction changes manifold


def _near(own: FloatArray, bound: float) -> BoolArray:
    """Where a bound, 0 where false matches take up all of it, is as near as at an end that it sets."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.abs(np.log(np.maximum(own, _TINY) / bound)) < _NEAR)


def _error(camera: DepthCamera, distance: FloatArray) -> FloatArray:
    """What the model of propagation may miss of the failed fraction."""
    return np.asarray(model_error(camera, distance).failed_fraction / (1.0 - false_match_share(camera)))


def _slope(camera: DepthCamera, ends: FloatArray) -> FloatArray:
    """Of the logarithm of the failed fraction over that of distance, its size."""
    above, below = (failed_fraction(camera, ends * (1.0 + sign * _BESIDE)) for sign in (1.0, -1.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.abs(np.log(above / below)) / (2.0 * _BESIDE)
    return np.where(np.isfinite(slope) & (slope > 0.0), slope, _TINY)
