"""The uncertainty budget of depth: what every uncertain input contributes, and the expanded uncertainty."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_measurement import PIXEL_NOISE
from tradestudy.depth.draws import nominal_inverse, uncertain_groups
from tradestudy.depth.evaluation import imaged
from tradestudy.depth.linear import LinearisedDepth, linearised_depth
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset, distances_without_decision
from tradestudy.study.prepared import PreparedStudy
from tradestudy.uncertainty.distributions import Empirical, StudentT
from tradestudy.uncertainty.joint import JointDraws, JointNormal

_NUMBERS: Final = ("input_uncertainty", "correlation", "sensitivity_coefficient", "contribution", "variance")


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraBudget:
    """The budget of one camera over distances, to first order in every input.

    Parameters
    ----------
    rows
        The variables of each input and of each correlated pair, by the names of ``/budget``; text and degrees of
        freedom are single values, numbers have shape (distances,).
    combined
        Combined standard uncertainty of depth [m]: the square root of the sum of all ``variance``, shape (distances,).
    freedom
        Effective degrees of freedom by Welch and Satterthwaite, shape (distances,); infinite where no input has any.
    factor
        Ratio of the expanded to the combined uncertainty, shape (distances,).
    """

    rows: dict[str, dict[str, Any]]
    combined: FloatArray
    freedom: FloatArray
    factor: FloatArray


def camera_budget(camera: DepthCamera, distance: FloatArray, coverage: float) -> CameraBudget:
    """Budget of the depth that a camera measures on the axis at distances [m], with its models of propagation.

    Depth is 1/w, so its derivative with respect to an input is −1/w² times that of the inverse depth w. A Student-t
    distribution contributes its standard deviation, which exceeds its scale because of the few measurements behind it.
    Welch–Satterthwaite, which accounts for these itself, takes the scale, so that they do not count twice.

    Numbers are NaN where the camera does not see the point, or if an input has no variance.
    """
    from scipy.special import ndtri, stdtrit

    error_source = "noise" if camera.propagation.model == "off" else "both"
    distance, inputs = imaged(camera, distance), _inputs(camera, error_source)
    line, inverse = _linearised(camera, distance, error_source), nominal_inverse(camera, distance, 0.0)
    derivative = 0.0 - line.sensitivity / np.where(inverse > 0.0, inverse, np.nan) ** 2  # 0, not −0, without effect
    spread = np.sqrt(np.diag(line.covariance))[:, None] * np.ones_like(distance)
    rows: dict[str, dict[str, Any]] = {}
    for k, (parameter, texts) in enumerate(inputs.items()):
        # The linear model knows noise as a score: the error divided by its standard deviation.
        unit = camera.noise(distance) / camera.sample_pitch if parameter == PIXEL_NOISE else 1.0
        numbers = (spread[k] * unit, np.nan, derivative[k] / unit, np.abs(derivative[k]) * spread[k])
        rows[parameter] = texts | dict(zip(_NUMBERS, (*numbers, numbers[-1] ** 2), strict=True))
    for i, j in np.argwhere(np.triu(np.nan_to_num(line.covariance), 1)):
        covariance = line.covariance[i, j]
        numbers = (np.nan, covariance / (spread[i] * spread[j]), np.nan, np.nan)
        variance = 2.0 * derivative[i] * derivative[j] * covariance
        pair = f"{line.parameters[i]} and {line.parameters[j]}"
        rows[pair] = dict(zip(_NUMBERS, (*numbers, variance), strict=True))
    combined = np.sqrt(np.maximum(np.sum([row["variance"] for row in rows.values()], axis=0), 0.0))
    degrees = np.array([[texts["degrees_of_freedom"]] for texts in inputs.values()])
    # The scale of a Student t distribution is √(1 − 2/ν) of its standard deviation.
    of_scales = derivative * np.sqrt(np.maximum(1.0 - 2.0 / degrees, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        narrow = np.sqrt(np.einsum("pd,pq,qd->d", of_scales, line.covariance, of_scales))
        freedom = narrow**4 / np.sum((of_scales * spread) ** 4 / degrees, axis=0)
        upper = 0.5 + coverage / 2.0
        factor = np.where(np.isinf(freedom), ndtri(upper), stdtrit(freedom, upper)) * narrow / combined
    return CameraBudget(rows=rows, combined=combined, freedom=freedom, factor=factor)


def _inputs(camera: DepthCamera, error_source: str) -> dict[str, dict[str, Any]]:
    """What is known of each input at any distance, by name, in the order of the linear model."""
    inputs: dict[str, dict[str, Any]] = {}
    for group in uncertain_groups(camera, error_source):
        inferred, simulated = isinstance(group, JointDraws | JointNormal), camera.calibration.source == "target"
        for k, parameter in enumerate(group.parameters):
            marginal = group.marginal(k)
            observed = not simulated if inferred else isinstance(marginal, StudentT | Empirical)
            inputs[parameter] = {
                "distribution": re.sub(r"(?<!^)(?=[A-Z])", "-", type(marginal).__name__).lower(),
                "evaluation": "A" if observed else "B",
                "input_units": "px" if parameter == PIXEL_NOISE else camera.parameter(parameter).unit,
                "degrees_of_freedom": marginal.degrees_of_freedom if isinstance(marginal, StudentT) else math.inf,
            }
    return inputs


def _linearised(camera: DepthCamera, distance: FloatArray, error_source: str) -> LinearisedDepth:
    """The linear model of inverse depth; NaN if an input has no variance."""
    try:
        return linearised_depth(camera, distance, 0.0, error_source)
    except OutOfRangeError:
        names = tuple(parameter for group in uncertain_groups(camera, error_source) for parameter in group.parameters)
        shape = (len(names), distance.size)
        return LinearisedDepth(
            parameters=names, covariance=np.full((len(names),) * 2, np.nan), sensitivity=np.full(shape, np.nan)
        )


def budget_group(study: PreparedStudy, depth: xr.Dataset) -> xr.Dataset:
    """/budget over (camera, distance, source), for the study as declared, at the distances that reports list.

    ``depth`` is ``/depth_at_places`` or, without declared distances, ``/depth``: its widest intervals of depths decide
    whether an expanded uncertainty can stand for them.
    """
    distance = depth["distance"].values
    if study.file.decision is None:
        distance = distances_without_decision(distance)
    quantiles = depth["depth_quantile"].sel(error_source="both", distance=distance).transpose("quantile", "camera", ...)
    coverage = float(quantiles["quantile"][-1] - quantiles["quantile"][0])
    near, far = quantiles.values[[0, -1]]
    cameras = study.case.cameras
    budgets = [camera_budget(camera, distance, coverage) for camera in cameras.values()]
    combined, freedom, factor = (
        np.array([getattr(budget, attribute) for budget in budgets]) for attribute in ("combined", "freedom", "factor")
    )
    tolerance = next(iter(cameras.values())).propagation.tolerance  # the study's, of all cameras
    with np.errstate(invalid="ignore"):
        holds = np.abs(2.0 * factor * combined / (far - near) - 1.0) <= tolerance
    rows = [budget.rows for budget in budgets]
    sources = sorted(dict.fromkeys(source for row in rows for source in row), key=lambda source: " and " in source)

    def filled(variable: str, absent: Any) -> NDArray[Any]:
        empty = np.full(distance.shape, absent, dtype=object if absent == "" else np.float64)
        over = [
            [np.broadcast_to(row.get(source, {}).get(variable, empty), empty.shape) for source in sources]
            for row in rows
        ]
        return np.moveaxis(np.array(over, dtype=empty.dtype), 1, 2)

    values = {
        **{variable: filled(variable, "") for variable in ("distribution", "evaluation", "input_units")},
        **{variable: filled(variable, math.nan) for variable in (*_NUMBERS, "degrees_of_freedom")},
        "combined_uncertainty": combined,
        "effective_degrees_of_freedom": freedom,
        "coverage": np.full(combined.shape, coverage),
        "coverage_factor": np.where(holds, factor, np.nan),
        "expanded_uncertainty": np.where(holds, factor * combined, np.nan),
        "interval_near": near,
        "interval_far": far,
    }
    coordinates: dict[str, Any] = {"camera": list(cameras), "distance": distance, "source": sources}
    return dataset("budget", values, coordinates, attributes={"tolerance": tolerance})
