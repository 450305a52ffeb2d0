"""The forms in which a study uses its cameras: as declared, under readings, in designs, for inverse questions."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.depth_camera import DepthCamera, false_match_share
from tradestudy.depth.evaluation import distribution, imaged, model_error
from tradestudy.effects import OFF
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.study.building import apply_models
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import Entry
from tradestudy.study.varying import SweepAxis, Varying, sweep_axes

# The largest number of designs examined in a sweep, evenly along each axis with its ends. The ends alone are not
# enough: changes are not monotonic where a design between them is in focus and they are not.
_MOST_DESIGNS: Final = 48
_ENDS: Final = 2
# Number of values examined of the parameter that an inverse question varies, including its ends.
_OF_QUESTIONS: Final = 5


def every_variant(definition: StudyDefinition) -> Iterator[tuple[str, StudyDefinition]]:
    """The study, its readings, designs of its sweep, values of its inverse questions and ends of its assumptions.

    Each comes with the name of its reading or question, which may use models of its own; "" for study and designs.
    """
    yield "", definition
    yield from definition.readings.items()
    for axes in _axes_of_cameras(definition):
        for values in _designs(axes):
            yield "", definition.with_values({axis.path: value for axis, value in zip(axes, values, strict=True)})
    for name, question in definition.file.solve.items():
        varying = Varying.of(definition, question)
        for value in np.linspace(varying.low, varying.high, _OF_QUESTIONS):
            yield name, definition.with_values(varying.changes(float(value)))
    for variant in _assumed(definition):
        yield "value_of_information", variant


def _axes_of_cameras(definition: StudyDefinition) -> Iterator[tuple[SweepAxis, ...]]:
    """For every camera, the axes of the sweep that can change it; each set of axes once.

    An axis of another camera would take the place of designs in which the camera itself changes.
    """
    axes = sweep_axes(definition)
    paths = [definition.document.path_of(axis.path) for axis in axes]
    found = (
        tuple(axis for axis, path in zip(axes, paths, strict=True) if path[0] != "cameras" or path[1] == name)
        for name in definition.case.cameras
    )
    yield from dict.fromkeys(own for own in found if own)


def _assumed(definition: StudyDefinition) -> Iterator[StudyDefinition]:
    """The study with each assumption at either of its ends, the others as declared."""
    part = definition.file.value_of_information
    for one in part.assumptions.values() if part is not None else ():
        if one.readings is None:
            for value in (one.low, one.high):
                yield definition.with_values(dict.fromkeys(one.paths, value))
        for name in one.readings or ():
            yield definition.with_values(definition.entries_of_reading(name))


def _designs(axes: Sequence[SweepAxis]) -> Iterator[tuple[Entry, ...]]:
    """The values along all axes, for every design examined."""
    sizes = [len(axis.values) for axis in axes]
    while math.prod(sizes) > _MOST_DESIGNS and max(sizes) > _ENDS:
        sizes[sizes.index(max(sizes))] -= 1
    kept = [
        [axis.values[k] for k in np.unique(np.round(np.linspace(0, len(axis.values) - 1, size)).astype(int))]
        for axis, size in zip(axes, sizes, strict=True)
    ]
    return itertools.islice(itertools.product(*kept), _MOST_DESIGNS)


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
