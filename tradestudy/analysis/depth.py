"""Depth of one camera over distances: discrimination, uncertainty with its parts, quantiles, failures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.depth_camera import (
    DepthCamera,
    DepthErrorPart,
    disparity_error_at,
    numerical_error_of_disparity_error,
)
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.uncertainty.sum_of_errors import SumOfErrors

WAYS: Final = ("noise", "calibration", "both")
ONE_SIGMA: Final = (0.15865525393145707, 0.8413447460685429)
QUANTILES: Final = (0.025, ONE_SIGMA[0], 0.5, ONE_SIGMA[1], 0.975)


@dataclass(frozen=True, kw_only=True)
class DepthEvaluation:
    """What one camera knows about depth; arrays over distance unless said otherwise.

    Parameters
    ----------
    distance
        True distance [m].
    discrimination
        Towards and away from the camera [m], shape (2, distance); the second may be infinite.
    uncertainty, quantile, failed_fraction
        For noise only, calibration only and both: half the central 68.27 % interval [m], shape (way, distance); the
        quantiles of depth [m], shape (way, distance, quantile), infinite where they lie beyond the pole; the share of
        measurements beyond it.
    uncertainty_error
        Estimated error [m] of the uncertainty for both, from the exact camera model.
    parts
        Uncertainty [m] from each part alone.
    disparity_px, equivalent_baseline
        As the camera defines them.
    disparity_error_px, disparity_error_px_error
        Standard deviation of one measured disparity [px], and its numerical error.
    """

    distance: FloatArray
    discrimination: FloatArray
    uncertainty: FloatArray
    quantile: FloatArray
    failed_fraction: FloatArray
    uncertainty_error: FloatArray
    parts: Mapping[str, FloatArray]
    disparity_px: FloatArray
    equivalent_baseline: FloatArray
    disparity_error_px: FloatArray
    disparity_error_px_error: FloatArray


def evaluate_depth(camera: DepthCamera, distance: FloatArray) -> DepthEvaluation:
    """Evaluate a camera at distances [m], shape (distance,).

    Where the camera forms no image everything is NaN.

    All errors are added up as errors of disparity, an inverse depth in which pixel noise acts exactly and calibration
    almost linearly, and the quantiles are mapped back to depth; a standard deviation of depth, which often does not
    exist, is never formed.
    """
    given, distance = distance, _imaged(camera, distance)
    parts = camera.depth_error_parts(distance)
    sums = [_sum(_of_way(parts, way), distance.shape) for way in WAYS]
    quantile = np.stack([np.stack([_depth_quantile(camera, distance, s, p) for p in QUANTILES], axis=-1) for s in sums])
    return DepthEvaluation(
        distance=given,
        discrimination=np.stack(camera.depth_discrimination(distance)),
        uncertainty=_half_width(quantile[..., 1], quantile[..., 3]),
        quantile=quantile,
        failed_fraction=np.stack([_failed_fraction(camera, distance, s) for s in sums]),
        uncertainty_error=_linearisation_error(camera, distance, parts),
        parts={part.name: _uncertainty(camera, distance, _sum((part,), distance.shape)) for part in parts},
        disparity_px=camera.disparity_px(distance),
        equivalent_baseline=camera.equivalent_baseline(distance),
        disparity_error_px=np.where(np.isnan(distance), np.nan, disparity_error_at(camera, distance)),
        disparity_error_px_error=np.where(
            np.isnan(distance), np.nan, numerical_error_of_disparity_error(camera, distance)
        ),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthErrors:
    """What the errors of a camera together do to depth at distances [m]; answers share what they rest on.

    Parameters
    ----------
    camera
        With the errors that it declares.
    distance
        [m]; NaN where the camera forms no image.
    way
        Which errors: ``both``, ``noise`` or ``calibration`` alone.
    """

    camera: DepthCamera
    distance: FloatArray
    way: str = "both"

    @classmethod
    def of(cls, camera: DepthCamera, distance: FloatArray, way: str = "both") -> DepthErrors:
        """At distances that may lie where no image is formed."""
        return cls(camera=camera, distance=_imaged(camera, distance), way=way)

    @cached_property
    def _parts(self) -> tuple[DepthErrorPart, ...]:
        return _of_way(self.camera.depth_error_parts(self.distance), self.way)

    @cached_property
    def _sum(self) -> SumOfErrors:
        return _sum(self._parts, self.distance.shape)

    @cached_property
    def _reach(self) -> FloatArray:
        return self._sum.quantile(ONE_SIGMA[1])

    @cached_property
    def uncertainty(self) -> FloatArray:
        """Half the central 68.27 % interval of depth [m]."""
        return _uncertainty_of_reach(self.camera, self.distance, self._reach)

    def largest_change(self, change: float) -> FloatArray:
        """Relative change of the uncertainty at most, if every error changed by up to such a share, either way.

        Larger errors change it by more than smaller ones, for depth falls ever more steeply towards its far end.
        Infinite where that is lost for some of these errors only; NaN where for all, and where no image is formed.
        """
        wide = _uncertainty_of_reach(self.camera, self.distance, (1.0 + change) * self._reach)
        lost, narrow = np.isinf(wide), self.uncertainty
        if np.isinf(narrow).any():
            narrow = _uncertainty_of_reach(self.camera, self.distance, max(0.0, 1.0 - change) * self._reach)
        known = np.where(~lost & (self.uncertainty > 0.0), self.uncertainty, np.nan)
        return np.where(lost & np.isfinite(narrow), np.inf, wide / known - 1.0)

    @property
    def failed_fraction(self) -> FloatArray:
        """Share of measurements that end beyond infinity."""
        return _failed_fraction(self.camera, self.distance, self._sum)

    @property
    def closed_form_error(self) -> FloatArray:
        """Estimated error of the uncertainty, as a share of it; NaN where either has no bound."""
        known = np.where(self.uncertainty > 0.0, self.uncertainty, np.nan)
        return np.asarray(_linearisation_error(self.camera, self.distance, self._parts) / known)


def depth_uncertainty(camera: DepthCamera, distance: FloatArray, way: str = "both") -> FloatArray:
    """Half the central 68.27 % interval of depth [m], and nothing else: for root finding."""
    distance = _imaged(camera, distance)
    return _uncertainty(camera, distance, _sum(_of_way(camera.depth_error_parts(distance), way), distance.shape))


def _imaged(camera: DepthCamera, distance: FloatArray) -> FloatArray:
    """Distances with NaN where the camera forms no image, so that no number comes out there."""
    return np.where(camera.images(distance), distance, np.nan)


def _of_way(parts: tuple[DepthErrorPart, ...], way: str) -> tuple[DepthErrorPart, ...]:
    if way == "both":
        return parts
    return tuple(part for part in parts if (part.error_class == "per measurement") == (way == "noise"))


def _sum(parts: tuple[DepthErrorPart, ...], shape: tuple[int, ...]) -> SumOfErrors:
    acting = [part for part in parts if np.any(part.disparity_error != 0.0)]
    return SumOfErrors.of(
        [part.disparity_error for part in acting if part.shape == "normal"],
        [part.disparity_error for part in acting if part.shape == "uniform"],
        shape,
    )


def _depth_quantile(camera: DepthCamera, distance: FloatArray, errors: SumOfErrors, probability: float) -> FloatArray:
    # Depth falls with disparity: its p-quantile is the (1 − p)-quantile there, and the sum is symmetric.
    return camera.depth_of_disparity(camera.disparity(distance) - errors.quantile(probability), distance)


def _half_width(low: FloatArray, high: FloatArray) -> FloatArray:
    """Half an interval; infinite where its far end is, also where both are."""
    unbounded = np.isinf(high)
    return np.asarray(np.where(unbounded, np.inf, (high - np.where(unbounded, 0.0, low)) / 2.0))


def _uncertainty(camera: DepthCamera, distance: FloatArray, errors: SumOfErrors) -> FloatArray:
    return _uncertainty_of_reach(camera, distance, errors.quantile(ONE_SIGMA[1]))


def _uncertainty_of_reach(camera: DepthCamera, distance: FloatArray, reach: FloatArray) -> FloatArray:
    """Of errors of disparity that stay within so much of it [m on the sensor] in 68.27 % of cases, either way alike."""
    disparity = camera.disparity(distance)
    low, high = (camera.depth_of_disparity(disparity + sign * reach, distance) for sign in (1.0, -1.0))
    return _half_width(low, high)


def _failed_fraction(camera: DepthCamera, distance: FloatArray, errors: SumOfErrors) -> FloatArray:
    return errors.cumulative(camera.disparity_of_infinity(distance) - camera.disparity(distance))


def _linearisation_error(camera: DepthCamera, distance: FloatArray, parts: tuple[DepthErrorPart, ...]) -> FloatArray:
    """How far errors added up in disparity miss the exact model, summed over one-deviation errors of each part [m].

    Both the half difference (the width of the interval) and the half sum (its middle) of the two ends count; NaN where
    an end is infinite, where the uncertainty is infinite or about to be.
    """
    directions = camera.error_directions(distance)
    linear = {part.name: part.disparity_error for part in parts}
    errors = np.stack([np.broadcast_to(linear.get(name, 0.0), distance.shape) for name in directions])
    disparity = camera.disparity(distance)
    far, near = (camera.depth_of_disparity(disparity + sign * errors, distance) for sign in (-1.0, 1.0))
    linear_width, linear_shift = _half_difference_and_sum(far, near, np.isfinite(far))
    plus, minus = _read_with_each(camera, distance, [error for group in directions.values() for error in group])
    exact_width, exact_shift = _half_difference_and_sum(plus, minus, np.isfinite(plus) & np.isfinite(minus))
    total, first = np.zeros_like(distance), 0
    for k, group in enumerate(directions.values()):
        own = slice(first, first + len(group))
        width = np.hypot.reduce(exact_width[own], axis=0)
        shift = np.sum(exact_shift[own] - distance, axis=0)
        total = total + np.abs(width - linear_width[k]) + np.abs(shift - (linear_shift[k] - distance))
        first += len(group)
    return total


def _half_difference_and_sum(high: FloatArray, low: FloatArray, known: BoolArray) -> tuple[FloatArray, FloatArray]:
    high, low = np.where(known, high, np.nan), np.where(known, low, np.nan)
    return (high - low) / 2.0, (high + low) / 2.0


def _read_with_each(
    camera: DepthCamera, distance: FloatArray, errors: Sequence[Mapping[str, ArrayLike]]
) -> tuple[FloatArray, FloatArray]:
    """Depth read with every one of some errors alone, added and taken away [m]; shape (errors, distances)."""
    names = dict.fromkeys(name for error in errors for name in error)
    rows: dict[str, FloatArray] = {}
    for name in names:
        own = [np.asarray(error.get(name, 0.0), dtype=np.float64) for error in errors]
        shape = distance.shape if any(value.ndim for value in own) else (1,)
        rows[name] = np.stack([np.broadcast_to(value, shape) for value in own])
    plus, minus = (
        camera.depth_with_errors(distance, {name: sign * row for name, row in rows.items()}) for sign in (1.0, -1.0)
    )
    return plus, minus
