"""/calibration: errors propagated through the exact models, the calibrations inferred, and the groups that follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.analysis.propagation import (
    FIELDS,
    TIERS,
    WAYS,
    PropagatedWay,
    PropagationPoint,
    moments_end,
    propagate_all_ways,
)
from tradestudy.calibration.declaration import CalibrationStudyPart
from tradestudy.calibration.posteriors import InferredCalibration
from tradestudy.calibration.uncertain_cameras import UncertainCameras
from tradestudy.execution import Steps
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.run.groups.real_rig import rig_rows
from tradestudy.run.groups.sensitivity import sensitivity_group
from tradestudy.run.groups.uncertain_decision import uncertain_decision
from tradestudy.study.definition import StudyDefinition
from tradestudy.uncertainty.evaluation import CAUSES
from tradestudy.uncertainty.outputs import PROBABILITIES

_SHOWN_DRAWS, _SHOWN_STEPS = 2000, 300


def uncertain_groups(
    definition: StudyDefinition, part: CalibrationStudyPart, decision: xr.Dataset, steps: Steps
) -> dict[str, xr.Dataset]:
    """/calibration, /sensitivity, and /decision with what calibration errors add to it."""
    uncertain = definition.uncertain_cameras(part, steps)
    added = uncertain_decision(uncertain, part, steps.progress)
    return {
        "/calibration": calibration_group(uncertain, part, steps),
        "/sensitivity": sensitivity_group(list(uncertain.cameras.values()), part, steps),
        "/decision": decision if added is None else decision.merge(added),
    }


def calibration_group(uncertain: UncertainCameras, part: CalibrationStudyPart, steps: Steps) -> xr.Dataset:
    """/calibration over (camera, field, way, distance), and the posteriors."""
    distance = np.array(part.distance_values())
    cameras = list(uncertain.cameras.values())
    asked = [
        PropagationPoint(
            camera=camera,
            distance=distance,
            fields=(0.0, part.edge),
            accuracy=part.accuracy,
            budget=part.budget,
            seed=part.seed,
        )
        for camera in cameras
    ]
    table = steps.map("propagation", propagate_all_ways, asked, list(uncertain.cameras))
    coordinates: dict[str, Any] = {
        "camera": [camera.name for camera in cameras],
        "field": list(FIELDS),
        "way": list(WAYS),
        "distance": distance,
        "quantile": list(PROBABILITIES),
        "end": ["low", "high"],
        "cause": list(CAUSES),
        "method": list(TIERS),
    }
    values = _propagated(table, distance)
    if uncertain.calibrations:
        posterior, names = _posteriors(uncertain)
        values |= posterior
        coordinates |= {"posterior": list(uncertain.calibrations), "parameter": names}
    if uncertain.rigs:
        values |= rig_rows(uncertain.rigs)
    attributes = {"seed": part.seed, "accuracy": part.accuracy, "budget": part.budget, "edge": part.edge}
    return dataset("calibration", values, coordinates, attributes=attributes)


def _propagated(table: Sequence[Sequence[Sequence[PropagatedWay]]], distance: FloatArray) -> dict[str, Any]:
    """Variables of the propagation, (camera, field, way, …)."""

    def each(get: Any) -> Any:
        return np.array([[[get(way) for way in field] for field in camera] for camera in table])

    def monte_carlo(name: str) -> Any:
        return each(lambda way: np.moveaxis(getattr(way.monte_carlo, name), -1, 0))

    return {
        "nominal_depth": np.array([[field[0].monte_carlo.nominal for field in camera] for camera in table]),
        "depth_quantile": monte_carlo("quantiles"),
        "depth_quantile_error": monte_carlo("quantiles_error"),
        "depth_uncertainty": monte_carlo("half_width"),
        "depth_uncertainty_error": monte_carlo("half_width_error"),
        "shortest_interval": monte_carlo("shortest"),
        "shortest_interval_error": monte_carlo("shortest_error"),
        "failed_fraction": monte_carlo("failed_fraction"),
        "failed_fraction_error": monte_carlo("failed_fraction_error"),
        **{
            name: monte_carlo(name)
            for name in (
                "mean", "mean_error", "bias", "standard_deviation", "standard_deviation_error", "moments_exist",
                "infinite_fraction", "infinite_fraction_error", "status",
            )
        },
        "moments_end": each(lambda way: moments_end(way.monte_carlo, distance)),
        "draws": each(lambda way: way.monte_carlo.draws),
        "linear_uncertainty": each(lambda way: way.linear.uncertainty),
        "linear_quantile": each(lambda way: way.linear.quantiles.T),
        "inverse_linear_quantile": each(lambda way: way.inverse_linear.quantiles.T),
        "linear_verdict": each(lambda way: way.linear.verdict),
        "inverse_linear_verdict": each(lambda way: way.inverse_linear.verdict),
        "tier": each(lambda way: way.tier),
        "tier_evaluations": each(
            lambda way: [way.linear.evaluations, way.inverse_linear.evaluations, way.monte_carlo.evaluations]
        ),
        "tier_seconds": each(lambda way: [way.linear.seconds, way.inverse_linear.seconds, way.monte_carlo.seconds]),
        "tier_error": each(lambda way: _tier_errors(way, distance)),
    }  # fmt: skip


def _tier_errors(way: PropagatedWay, distance: FloatArray) -> list[float]:
    """Largest error of each tier relative to distance, that of Monte Carlo by its own standard error."""
    own = np.max(way.monte_carlo.quantiles_error[[0, -1]], axis=0)
    errors = []
    for error in (way.linear.error, way.inverse_linear.error, own):
        relative = error / distance
        finite = relative[np.isfinite(relative)]
        errors.append(float(finite.max()) if finite.size else float("nan"))
    return errors


def _posteriors(uncertain: UncertainCameras) -> tuple[dict[str, Any], list[str]]:
    """Variables of the inferred calibrations, padded with NaN over all parameters."""
    calibrations = uncertain.calibrations
    names = list(dict.fromkeys(name for one in calibrations.values() for name in one.sample.names))
    ensembles = max(one.sample.chains.shape[0] for one in calibrations.values())

    def over_parameters(get: Any) -> FloatArray:
        return np.stack([_spread(one, names, np.asarray(get(one))) for one in calibrations.values()])

    def of_each(get: Any) -> list[Any]:
        return [get(one) for one in calibrations.values()]

    rigs: Mapping[str, Any] = uncertain.rigs
    overconfidence = [
        np.concatenate([rigs[name].fit.explained.overconfidence, [np.nan, np.nan]])
        if name in rigs
        else np.full(len(one.sample.names), np.nan)
        for name, one in calibrations.items()
    ]
    return {
        "posterior_converged": of_each(lambda one: not one.failures),
        "posterior_verdict": of_each(lambda one: "; ".join(one.failures)),
        "posterior_kind": ["corners of a board" if name in rigs else "synthetic target" for name in calibrations],
        "posterior_lengths": of_each(lambda one: one.sample.diagnostics.lengths),
        "posterior_acceptance": np.stack(
            of_each(
                lambda one: np.pad(
                    one.sample.diagnostics.acceptance,
                    (0, ensembles - len(one.sample.diagnostics.acceptance)),
                    constant_values=np.nan,
                )
            )
        ),
        "posterior_marginal_efficiency": of_each(lambda one: one.check.efficiency),
        "posterior_evaluations": of_each(lambda one: one.sample.evaluations),
        "posterior_seconds": of_each(lambda one: one.sample.seconds),
        "laplace_seconds": of_each(lambda one: one.laplace_seconds),
        "posterior_mean": over_parameters(lambda one: one.sample.draws.mean(axis=0)),
        "posterior_deviation": over_parameters(lambda one: one.sample.draws.std(axis=0)),
        "prior_deviation": over_parameters(lambda one: one.prior_deviation),
        "laplace_deviation": over_parameters(lambda one: one.laplace_deviation),
        "posterior_autocorrelation": over_parameters(lambda one: one.sample.diagnostics.autocorrelation_steps),
        "posterior_r_hat": over_parameters(lambda one: one.sample.diagnostics.r_hat),
        "posterior_bulk_size": over_parameters(lambda one: one.sample.diagnostics.bulk_effective_size),
        "posterior_tail_size": over_parameters(lambda one: one.sample.diagnostics.tail_effective_size),
        "posterior_draw": over_parameters(_draws),
        "posterior_trace": over_parameters(lambda one: _trace(one, ensembles)),
        "rig_overconfidence": np.stack(
            [_spread(one, names, row) for one, row in zip(calibrations.values(), overconfidence, strict=True)]
        ),
    }, names


def _draws(one: InferredCalibration) -> FloatArray:
    """Draws spread over all chains, shape (draws, parameters); NaN where a short chain has no more."""
    found = one.sample.thinned(min(_SHOWN_DRAWS, len(one.sample.draws)))
    return np.pad(found, ((0, _SHOWN_DRAWS - len(found)), (0, 0)), constant_values=np.nan)


def _trace(one: InferredCalibration, ensembles: int) -> FloatArray:
    """The first walker of each ensemble at evenly spread steps, shape (ensembles, steps, parameters)."""
    chains = one.sample.chains[:, :, 0]
    steps = (np.arange(_SHOWN_STEPS) * chains.shape[1]) // _SHOWN_STEPS
    padded = np.full((ensembles, _SHOWN_STEPS, chains.shape[-1]), np.nan)
    padded[: len(chains)] = chains[:, steps]
    return padded


def _spread(one: InferredCalibration, names: list[str], values: FloatArray) -> FloatArray:
    """Values over a calibration's own parameters (last axis) laid into those of all calibrations."""
    found = np.full((*values.shape[:-1], len(names)), np.nan)
    found[..., [names.index(name) for name in one.sample.names]] = values
    return found
