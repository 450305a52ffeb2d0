"""Depth of one camera over distance: discrimination, uncertainty with its causes, quantiles, failures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final, Protocol

import numpy as np

from tradestudy.cameras.calibration import ONE_SIGMA
from tradestudy.cameras.depth_camera import (
    DepthCamera,
    disparity_error_at,
    false_match_share,
    numerical_error_of_disparity_error,
)
from tradestudy.cameras.depth_measurement import FieldPosition
from tradestudy.depth.distribution import DepthDistribution, judged_by_larger, standard_error
from tradestudy.depth.draws import exact_distribution, trial_distribution
from tradestudy.depth.linear import (
    has_covariance,
    linear_distribution,
    linearised_depth,
    noise_distribution,
    second_order,
)
from tradestudy.depth.remembered import remembered
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.uncertainty.sensitivity import shapley_shares

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
    uncertainty, quantile, failed_fraction, error_radius
        For noise only, calibration only and both: half the central 68.27 % interval [m], shape (error source,
        distance); the quantiles of depth [m], shape (error source, distance, quantile), infinite at or beyond infinity;
        the share of measurements there or falsely matched; the radius about the true distance [m] that contains
        68.27 % of all measurements. The first two exclude false matches.
    uncertainty_error, failed_fraction_error, error_radius_error
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
    error_radius: FloatArray
    uncertainty_error: FloatArray
    failed_fraction_error: FloatArray
    error_radius_error: FloatArray
    converged: BoolArray
    shares: Mapping[str, FloatArray]
    disparity_px: FloatArray
    equivalent_baseline: FloatArray
    disparity_error_px: FloatArray
    disparity_error_px_error: FloatArray

    @property
    def judged(self) -> FloatArray:
        """The larger of half width and radius [m], shape (error source, distance): what ranks are judged by."""
        return judged_by_larger(self.uncertainty, self.error_radius, self.uncertainty, self.error_radius)

    @property
    def judged_error(self) -> FloatArray:
        """Estimated error of `judged` [m]."""
        return judged_by_larger(self.uncertainty, self.error_radius, self.uncertainty_error, self.error_radius_error)


def evaluate_depth(camera: DepthCamera, distance: FloatArray, field: FieldPosition = 0.0) -> DepthEvaluation:
    """Evaluate a camera at distances [m], shape (distance,), at one position in the picture.

    Where the camera forms no image or does not see the point, all its measurements are NaN.
    """
    requested, distance = distance, imaged(camera, distance)
    depths = [distribution(camera, distance, error_source, field) for error_source in ERROR_SOURCES]
    uncertainty = np.stack([depth.half_width for depth in depths])
    failed = np.stack([depth.failed_fraction for depth in depths])
    radius = np.stack([depth.error_radius for depth in depths])
    if camera.propagation.model != "exact":
        errors = [model_error(camera, distance, error_source, field) for error_source in ERROR_SOURCES]
        uncertainty_error = np.stack([error.half_width for error in errors]) * finite(uncertainty)
        radius_error = np.stack([error.radius for error in errors]) * finite(radius)
        failed_error = np.stack([error.failed_fraction for error in errors])
        converged = np.ones(distance.shape, dtype=bool)
    else:
        uncertainty_error = np.stack([depth.half_width_error for depth in depths])
        radius_error = np.stack([depth.error_radius_error for depth in depths])
        failed_error = np.stack([depth.failed_fraction_error for depth in depths])
        converged = np.logical_and.reduce([depth.converged(camera.propagation.tolerance) for depth in depths])
    return DepthEvaluation(
        distance=requested,
        discrimination=np.stack(camera.depth_discrimination(distance)),
        uncertainty=uncertainty,
        quantile=np.stack([depth.quantile.T for depth in depths]),
        failed_fraction=failed,
        error_radius=radius,
        error_radius_error=radius_error,
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


class Reading(Protocol):
    """Gives the distribution of a camera's depth at distances [m]."""

    def __call__(
        self, camera: DepthCamera, distance: FloatArray, error_source: str, field: FieldPosition = 0.0, /
    ) -> DepthDistribution:
        """The distribution due to an error source at a position in the picture."""
        ...


@remembered(256)  # limits, ratios and tables of a camera request it repeatedly
def distribution(
    camera: DepthCamera, distance: FloatArray, error_source: str, field: FieldPosition = 0.0, /
) -> DepthDistribution:
    """The distribution of depth at distances [m], by the camera's model of propagation.

    Every model treats noise alone exactly.
    """
    model, groups = camera.propagation.model, camera.calibration.groups
    false_matches = false_match_share(camera, error_source)
    if error_source == "noise" or (error_source == "both" and (model == "off" or not groups)):
        return noise_distribution(camera, distance, field, false_matches)
    if not groups or (model != "exact" and has_covariance(camera)):
        return linear_distribution(camera, distance, field, error_source, false_matches)
    return exact_distribution(camera, distance, field, error_source)


def depth_uncertainty(
    camera: DepthCamera, distance: FloatArray, error_source: str = "both", field: FieldPosition = 0.0
) -> FloatArray:
    """Half the central 68.27 % interval of depth [m]: the spread of measurements, whatever their bias."""
    return distribution(camera, imaged(camera, distance), error_source, field).half_width


def judged_at(camera: DepthCamera, distance: FloatArray, error_source: str = "both") -> FloatArray:
    """The uncertainty [m] that judges a camera (`judged_uncertainty`), computed at the distances themselves."""
    return distribution(camera, imaged(camera, distance), error_source).judged


def finite(width: FloatArray) -> FloatArray:
    """A width, NaN where it is unbounded: no error can be stated there."""
    return np.where(np.isinf(width), np.nan, width)


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelError:
    """Estimated error of a model of propagation relative to exact draws, over distances.

    Parameters
    ----------
    half_width, radius, judged
        Errors of the depth uncertainty, of the radius about the true distance, and of the larger of these, relative to
        the model's values.
    intervals
        Largest error of `judged` or of the half width of any reported interval, relative to that of the draws.
    failures
        Computes `failed_fraction` on demand.
    """

    half_width: FloatArray
    radius: FloatArray
    judged: FloatArray
    intervals: FloatArray
    failures: Callable[[], FloatArray]

    @property
    def failed_fraction(self) -> FloatArray:
        """Error of the failed fraction, absolute."""
        return self.failures()


@remembered(64)
def model_error(
    camera: DepthCamera, distance: FloatArray, error_source: str = "both", field: FieldPosition = 0.0
) -> ModelError:
    """Estimate the error of a camera's model of propagation.

    If all errors are normal, the exact model to second order gives the error. Otherwise draws at some of these
    distances do: between two of them, the larger error counts, plus twice the standard error of the draws.
    """
    seen = distance[~np.isnan(distance)]
    varies = error_source != "noise" and any(group.dimensions for group in camera.calibration.groups)
    if not seen.size or not varies:  # exact in every model
        none = np.where(np.isnan(distance), np.nan, 0.0)
        return ModelError(half_width=none, radius=none, judged=none, intervals=none, failures=lambda: none)
    if (curved := second_order(camera, distance, field, error_source)) is not None:
        line = distribution(camera, distance, error_source, field)
        expected = curved.expected
        return ModelError(
            half_width=_apart(expected.half_widths(ONE_SIGMA), line.half_widths(ONE_SIGMA)) + curved.uncertain,
            radius=_apart(expected.error_radii, line.error_radii) + curved.uncertain,
            judged=_apart(expected.judged_widths, line.judged_widths) + curved.uncertain,
            intervals=_apart_anywhere(line, expected, camera) + curved.uncertain,
            failures=lambda: np.abs(line.failed_fraction - expected.failed_fraction),
        )
    places = seen[np.unique(np.linspace(0, seen.size - 1, _PILOTS).round().astype(int))]
    draws = trial_distribution(camera, places, field, error_source)
    line = distribution(camera, places, error_source, field)
    neighbour = partial(_larger_neighbour, distance, places)

    def failures() -> FloatArray:
        failed = np.abs(line.failed_fraction - draws.failed_fraction) + 2.0 * draws.failed_fraction_error
        return neighbour(failed)

    return ModelError(
        half_width=neighbour(_apart(draws.half_widths(ONE_SIGMA), line.half_widths(ONE_SIGMA))),
        radius=neighbour(_apart(draws.error_radii, line.error_radii)),
        judged=neighbour(_apart(draws.judged_widths, line.judged_widths)),
        intervals=neighbour(_apart_anywhere(line, draws, camera)),
        failures=failures,
    )


def clear_departure(camera: DepthCamera, distance: FloatArray, field: FieldPosition = 0.0) -> FloatArray:
    """How far the widths of a linear model are off along the direction in which the errors change depth most.

    A cheap first estimate for errors of any distribution; 0 where it gives no answer, NaN where nothing is measured.
    """
    curved = second_order(camera, distance, field, "both", any_shape=True)
    if curved is None:
        return np.zeros(distance.shape)
    return _apart_anywhere(distribution(camera, distance, "both", field), curved.expected, camera)


def _apart_anywhere(depth: DepthDistribution, other: DepthDistribution, camera: DepthCamera) -> FloatArray:
    """The largest bound on the difference of the half widths of all reported intervals and of the judged widths."""
    bounds = [_apart(depth.half_widths(share), other.half_widths(share)) for share in camera.propagation.coverages]
    return np.asarray(np.fmax.reduce([*bounds, _apart(depth.judged_widths, other.judged_widths)]))


def _apart(widths: FloatArray, other: FloatArray) -> FloatArray:
    """Bound on the difference of widths (scrambles, distances), relative to ``other``; infinite if one alone is."""
    width, reference = np.mean(widths, axis=0), np.mean(other, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        error = np.nan_to_num((standard_error(widths) + standard_error(other)) / reference)
        relative = np.abs(width / reference - 1.0) + 2.0 * error
    lost = np.isinf(width) | np.isinf(reference)
    return np.where(np.isinf(width) & np.isinf(reference), 0.0, np.where(lost, np.inf, relative))


def _larger_neighbour(distance: FloatArray, places: FloatArray, values: FloatArray) -> FloatArray:
    """At each distance, the larger of the values at the two places around it; NaN if neither is known."""
    above = np.clip(np.searchsorted(places, distance), 0, places.size - 1)
    below = np.maximum(above - 1, 0)
    return np.where(np.isnan(distance), np.nan, np.fmax(values[above], values[below]))


def variance_shares(camera: DepthCamera, distance: FloatArray, field: FieldPosition = 0.0) -> dict[str, FloatArray]:
    """Share of the variance of inverse depth due to each part of the errors; see `shapley_shares`.

    Linearises inverse depth; NaN if an uncertain parameter has no variance, or where nothing is measured.
    """
    part_of = {name: camera.parameter(name).part for group in camera.calibration.groups for name in group.parameters}
    parts = ("noise", *dict.fromkeys(part_of.values()))
    try:
        line = linearised_depth(camera, distance, field, "noise" if camera.propagation.model == "off" else "both")
    except OutOfRangeError:
        return {part: np.full(distance.shape, np.nan) for part in parts}
    rows = [[k for k, name in enumerate(line.parameters) if part_of.get(name, "noise") == part] for part in parts]
    return dict(zip(parts, shapley_shares(line.sensitivity, line.covariance, rows), strict=True))


def imaged(camera: DepthCamera, distance: FloatArray) -> FloatArray:
    """The distances, NaN where the camera forms no image, so that nothing is computed there."""
    return np.where(camera.images(distance), distance, np.nan)
