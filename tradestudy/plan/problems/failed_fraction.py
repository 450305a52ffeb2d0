"""How a usable range limited by failed measurements changes if calibration errors are omitted or propagated linearly.

Shares refer to the true matches, because the number of false ones does not depend on the model and would hide how the
others depend on distance.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.analysis.depth import distribution, imaged, model_error
from tradestudy.cameras.depth_camera import DepthCamera, false_match_share
from tradestudy.effects import OFF
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.study.building import apply_models

_SLOPE_STEP: Final = 1e-2  # of the distance of an end, for the slope there
_AT_AN_END: Final = 0.05  # closer to an end than this share of its distance, a fraction counts as being at its limit


def of_true_matches(camera: DepthCamera, failed: ArrayLike) -> FloatArray:
    """A failed fraction, or its bound, as a share of the true matches; negative where false matches alone exceed it."""
    share = false_match_share(camera)
    return np.asarray((np.asarray(failed) - share) / (1.0 - share))


def failed_fraction(camera: DepthCamera, distance: FloatArray) -> FloatArray:
    """Share of true matches with a depth beyond infinity, by the camera's model of propagation."""
    return of_true_matches(camera, distribution(camera, imaged(camera, distance), "both").failed_fraction)


def verdict_changed_without_calibration(camera: DepthCamera, bound: float, distance: FloatArray) -> BoolArray:
    """Where noise alone meets the limit on the failed fraction and all errors violate it, or vice versa."""
    without = failed_fraction(apply_models(camera, {"calibration": OFF}), distance)
    return np.asarray((without <= bound) != (failed_fraction(camera, distance) <= bound))


def shift_without_calibration(camera: DepthCamera, bound: float, ends: FloatArray) -> float:
    """The largest relative shift, to first order, of ends that the failed fraction sets.

    Infinite where no measurement fails without calibration errors.
    """
    own = failed_fraction(camera, ends)
    by_failures = _near(own, bound)
    if not by_failures.any():
        return 0.0
    without = failed_fraction(apply_models(camera, {"calibration": OFF}), ends[by_failures])
    with np.errstate(divide="ignore"):
        moved = np.abs(np.log(without / own[by_failures]))
    return float(np.max(moved / _slope(camera, ends[by_failures])))


def missed_by_the_line(
    camera: DepthCamera, bound: float, places: FloatArray, failed: FloatArray, ends: FloatArray
) -> float:
    """The largest relative shift that the error of linear propagation causes in an end set by the failed fraction.

    Infinite where that error leaves open whether the limit is met.

    Parameters
    ----------
    camera
        The camera with linear propagation.
    bound
        Largest allowed failed fraction.
    places, failed, ends
        Distances [m], the linearly propagated failed fraction there, and the ends of usable ranges [m].
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
_NEAR: Final = 1.0  # in the logarithm; an end is known to 1 %, within which a fraction can change severalfold


def _near(own: FloatArray, bound: float) -> BoolArray:
    """Where a fraction is as near to its bound as at an end that the bound sets; a bound of 0 is never near."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.abs(np.log(np.maximum(own, _TINY) / bound)) < _NEAR)


def _error(camera: DepthCamera, distance: FloatArray) -> FloatArray:
    """Error of the failed fraction by the camera's model of propagation."""
    return np.asarray(model_error(camera, distance).failed_fraction / (1.0 - false_match_share(camera)))


def _slope(camera: DepthCamera, ends: FloatArray) -> FloatArray:
    """Absolute slope d ln(failed fraction)/d ln(distance) at the ends; tiny where it is unknown or zero."""
    above, below = (failed_fraction(camera, ends * (1.0 + sign * _SLOPE_STEP)) for sign in (1.0, -1.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.abs(np.log(above / below)) / (2.0 * _SLOPE_STEP)
    return np.where(np.isfinite(slope) & (slope > 0.0), slope, _TINY)
