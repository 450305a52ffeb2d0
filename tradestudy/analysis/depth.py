"""Depth of one camera over distance: discrimination, uncertainty with its causes, quantiles, failures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Final

import numpy as np

from tradestudy.analysis.depth_distribution import DepthDistribution
from tradestudy.analysis.depth_draws import exact_distribution, trial_distribution
from tradestudy.analysis.linear_depth import (
    has_covariance,
    linear_distribution,
    linearised_depth,
    noise_distribution,
)
from tradestudy.analysis.second_order import second_order
from tradestudy.cameras.calibration import ONE_SIGMA
from tradestudy.cameras.depth_camera import (
    DepthCamera,
    disparity_error_at,
    false_match_share,
    numerical_error_of_disparity_error,
)
from tradestudy.cameras.depth_measurement import FieldPosition
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.uncertainty.shapley import shapley_shares

ERROR_SOURCES: Final = ("noise", "calibration", "both")
_PILOTS: Final = 9  # distances at which a model is compared with draws


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthEvaluation:
    """Depth errors of one camera; arrays over distance unless stated otherwise.

    Parameters
    ----------
    distance
        True distance [m].
    discrimination
        Towards and away from the camera [m], shape (2, distance); the second may be infinite.
    uncertainty, quantile, failed_fraction
        For noise only, calibration only and both: half the central 68.27 % interval [m], shape (error source,
        distance); the quantiles of depth [m], shape (error source, distance, quantile), infinite at or beyond infinity;
        the share of measurements there or falsely matched. The first two exclude false matches.
    uncertainty_error, failed_fraction_error
        Estimated errors of these, shape (error source, distance): the standard error of the draws, or the measured
        difference between a cheaper model and draws.
    converged
        Whether the sampling error is within the tolerance; always true for the linear model.
    shares
        Share of the variance of inverse depth due to each part [1], by Shapley effects: they sum to 1.
    disparity_px, equivalent_baseline
        Disparity [px] and equivalent baseline [m], as the camera defines them.
    disparity_error_px, disparity_error_px_error
        Standard deviation of one measured disparity [px], and its numerical error.
    """

    distance: FloatArray
    discrimination: FloatArray
    uncertainty: FloatArray
    quantile: FloatArray
    failed_fraction: FloatArray
    uncertainty_error: FloatArray
    failed_fraction_error: FloatArray
    converged: BoolArray
    shares: Mapping[str, FloatArray]
    disparity_px: FloatArray
    equivalent_baseline: FloatArray
    disparity_error_px: FloatArray
    disparity_error_px_error: FloatArray


def evaluate_depth(camera: DepthCamera, distance: FloatArray, field: FieldPosition = 0.0) -> DepthEvaluation:
    """Evaluate a camera at distances [m], shape (distance,), at one position in the picture.

    Where the camera forms no image or does not see the point, all its measurements are NaN.
    """
    given, distance = distance, _imaged(camera, distance)
    found = [distribution(camera, distance, error_source, field) for error_source in ERROR_SOURCES]
    uncertainty, failed = (np.stack([getattr(one, of) for one in found]) for of in ("half_width", "failed_fraction"))
    if camera.propagation.model != "exact":
        measured = [model_error(camera, distance, error_source, field) for error_source in ERROR_SOURCES]
        relative = np.stack([one.half_width for one in measured])
        known = np.where(np.isinf(uncertainty), np.nan, uncertainty)
        uncertainty_error = relative * known
        failed_error = np.stack([one.failed_fraction for one in measured])
        converged = np.ones(distance.shape, dtype=bool)
    else:
        uncertainty_error = np.stack([one.half_width_error for one in found])
        failed_error = np.stack([one.failed_fraction_error for one in found])
        converged = np.logical_and.reduce([one.converged(camera.propagation.tolerance) for one in found])
    return DepthEvaluation(
        distance=given,
        discrimination=np.stack(camera.depth_discrimination(distance)),
        uncertainty=uncertainty,
        quantile=np.stack([one.quantile.T for one in found]),
        failed_fraction=failed,
        uncertainty_error=uncertainty_error,
        failed_fraction_error=failed_error,
        converged=converged,
        shares=variance_shares(camera, distance, field),
        disparity_px=camera.disparity_px(distance),
        equivalent_baseline=camera.equivalent_baseline(distance),
        disparity_error_px=np.where(np.isnan(distance), np.nan, disparity_error_at(camera, distance, field)),
        disparity_error_px_error=np.where(
            np.isnan(distance), np.nan, numerical_error_of_disparity_error(camera, distance, field)
        ),
    )


def distribution(
    camera: DepthCamera, distance: FloatArray, error_source: str, field: FieldPosition = 0.0
) -> DepthDistribution:
    """The distribution of depth at distances [m], by the camera's model of propagation.

    Every model treats noise alone exactly.
    """
    return _known(camera, distance.tobytes(), field, error_source)


@lru_cache(maxsize=256)
def _known(camera: DepthCamera, distances: bytes, field: FieldPosition, error_source: str) -> DepthDistribution:
    """The distribution, cached because limits, ratios and tables of a camera request it repeatedly."""
    return _with_false_matches(
        _of_true_matches(camera, np.frombuffer(distances), field, error_source), camera, error_source
    )


def _of_true_matches(
    camera: DepthCamera, distance: FloatArray, field: FieldPosition, error_source: str
) -> DepthDistribution:
    model, groups = camera.propagation.model, camera.calibration.groups
    if error_source == "noise" or (error_source == "both" and (model == "off" or not groups)):
        return noise_distribution(camera, distance, field)
    if not groups or (model != "exact" and has_covariance(camera)):
        return linear_distribution(camera, distance, field, error_source)
    return exact_distribution(camera, distance, field, error_source)


def _with_false_matches(found: DepthDistribution, camera: DepthCamera, error_source: str) -> DepthDistribution:
    """The distribution with the false matches m added to the failures f: ``1 − (1 − f)(1 − m)``."""
    share = 0.0 if error_source == "calibration" else false_match_share(camera)
    if share == 0.0:
        return found
    return replace(found, failures=lambda: found.failed + share * (1.0 - found.failed))


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthErrors:
    """The combined effect of a camera's errors on depth at distances [m]; all answers share one distribution.

    Parameters
    ----------
    camera
        The camera with its calibration and model of propagation.
    distance
        [m]; NaN where the camera forms no image.
    error_source
        The errors considered: ``both``, ``noise`` or ``calibration`` alone.
    field
        The position in the picture.
    """

    camera: DepthCamera
    distance: FloatArray
    error_source: str = "both"
    field: FieldPosition = 0.0

    @classmethod
    def of(
        cls, camera: DepthCamera, distance: FloatArray, error_source: str = "both", field: FieldPosition = 0.0
    ) -> DepthErrors:
        """The errors at any distances, including those where the camera forms no image."""
        return cls(camera=camera, distance=_imaged(camera, distance), error_source=error_source, field=field)

    @cached_property
    def _distribution(self) -> DepthDistribution:
        return distribution(self.camera, self.distance, self.error_source, self.field)

    @property
    def uncertainty(self) -> FloatArray:
        """Half the central 68.27 % interval of depth [m]."""
        return self._distribution.half_width

    @property
    def failed_fraction(self) -> FloatArray:
        """Share of measurements that read infinity or beyond, or are false matches."""
        return self._distribution.failed_fraction


def depth_uncertainty(
    camera: DepthCamera, distance: FloatArray, error_source: str = "both", field: FieldPosition = 0.0
) -> FloatArray:
    """Half the central 68.27 % interval of depth [m], for root finding."""
    return distribution(camera, _imaged(camera, distance), error_source, field).half_width


def depth_uncertainty_error(camera: DepthCamera, distance: FloatArray, field: FieldPosition = 0.0) -> FloatArray:
    """Estimated error of `depth_uncertainty` [m]: the standard error of draws, or the error of a cheaper model."""
    distance = _imaged(camera, distance)
    found = distribution(camera, distance, "both", field)
    if camera.propagation.model == "exact":
        return found.half_width_error
    known = np.where(np.isinf(found.half_width), np.nan, found.half_width)
    return np.asarray(model_error(camera, distance, "both", field).half_width * known)


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelError:
    """Estimated error of a model of propagation relative to exact draws, over distances.

    Parameters
    ----------
    half_width
        Error of the depth uncertainty, relative to the model's value.
    intervals
        Largest error of the half width of any reported interval, relative to the half width of the draws.
    failures
        Computes `failed_fraction` on demand.
    """

    half_width: FloatArray
    intervals: FloatArray
    failures: Callable[[], FloatArray]

    @property
    def failed_fraction(self) -> FloatArray:
        """Error of the failed fraction, absolute."""
        return self.failures()


def model_error(
    camera: DepthCamera, distance: FloatArray, error_source: str = "both", field: FieldPosition = 0.0
) -> ModelError:
    """Estimate the error of a camera's model of propagation.

    If all errors are normal, the exact model to second order gives the error. Otherwise draws at some of these
    distances do: between two of them, the larger error counts, plus twice the standard error of the draws.
    """
    known = distance[~np.isnan(distance)]
    if not known.size or error_source == "noise" or not camera.calibration.groups:  # exact in every model
        none = np.where(np.isnan(distance), np.nan, 0.0)
        return ModelError(half_width=none, intervals=none, failures=lambda: none)
    if (curved := second_order(camera, distance, field, error_source)) is not None:
        line = distribution(camera, distance, error_source, field)
        read = _with_false_matches(curved.expected, camera, error_source)
        intervals = [_apart(line, read, coverage) + curved.uncertain for coverage in camera.propagation.coverages]
        return ModelError(
            half_width=_apart(read, line, ONE_SIGMA) + curved.uncertain,
            intervals=np.fmax.reduce(intervals),
            failures=lambda: np.abs(line.failed_fraction - read.failed_fraction),
        )
    places = known[np.unique(np.linspace(0, known.size - 1, _PILOTS).round().astype(int))]
    draws = _with_false_matches(trial_distribution(camera, places, field, error_source), camera, error_source)
    line = distribution(camera, places, error_source, field)
    intervals = [_apart(line, draws, coverage) for coverage in camera.propagation.coverages]

    def failures() -> FloatArray:
        failed = np.abs(line.failed_fraction - draws.failed_fraction) + 2.0 * draws.failed_fraction_error
        return _larger_neighbour(distance, places, failed)

    return ModelError(
        half_width=_larger_neighbour(distance, places, _apart(draws, line, ONE_SIGMA)),
        intervals=_larger_neighbour(distance, places, np.fmax.reduce(intervals)),
        failures=failures,
    )


def clear_departure(camera: DepthCamera, distance: FloatArray, field: FieldPosition = 0.0) -> FloatArray:
    """How far the half widths of a linear model are off along the direction in which the errors change depth most.

    A cheap first estimate for errors of any distribution; 0 where it gives no answer, NaN where nothing is measured.
    """
    read = second_order(camera, distance, field, "both", any_shape=True)
    if read is None:
        return np.zeros(distance.shape)
    line = distribution(camera, distance, "both", field)
    found = [_apart(line, read.expected, coverage) for coverage in camera.propagation.coverages]
    return np.asarray(np.fmax.reduce(found))


def _apart(one: DepthDistribution, other: DepthDistribution, coverage: float) -> FloatArray:
    """Bound on the difference of half widths, relative to those of ``other``; infinite if only one has no far end."""
    width, drawn = (np.mean(either.half_widths(coverage), axis=0) for either in (one, other))
    with np.errstate(invalid="ignore", divide="ignore"):
        error = np.nan_to_num((one.half_width_errors(coverage) + other.half_width_errors(coverage)) / drawn)
        relative = np.abs(width / drawn - 1.0) + 2.0 * error
    lost = np.isinf(width) | np.isinf(drawn)
    return np.where(np.isinf(width) & np.isinf(drawn), 0.0, np.where(lost, np.inf, relative))


def _larger_neighbour(distance: FloatArray, places: FloatArray, values: FloatArray) -> FloatArray:
    """At each distance, the larger of the values at the two places around it; NaN if neither is known."""
    above = np.clip(np.searchsorted(places, distance), 0, places.size - 1)
    below = np.maximum(above - 1, 0)
    return np.where(np.isnan(distance), np.nan, np.fmax(values[above], values[below]))


def variance_shares(camera: DepthCamera, distance: FloatArray, field: FieldPosition = 0.0) -> dict[str, FloatArray]:
    """Share of the variance of inverse depth due to each part of the errors; see `shapley_shares`.

    Linearises inverse depth; NaN if an uncertain parameter has no variance, or where nothing is measured.
    """
    parts = {name: camera.parameter(name).part for group in camera.calibration.groups for name in group.parameters}
    names = ("noise", *dict.fromkeys(parts.values()))
    try:
        line = linearised_depth(camera, distance, field, "noise" if camera.propagation.model == "off" else "both")
    except OutOfRangeError:
        return {name: np.full(distance.shape, np.nan) for name in names}
    rows = [[k for k, own in enumerate(line.parameters) if parts.get(own, "noise") == name] for name in names]
    return dict(zip(names, shapley_shares(line.sensitivity, line.covariance, rows), strict=True))


def _imaged(camera: DepthCamera, distance: FloatArray) -> FloatArray:
    """The distances, NaN where the camera forms no image, so that nothing is computed there."""
    return np.where(camera.images(distance), distance, np.nan)
