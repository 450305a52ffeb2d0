"""/calibration: the inferred calibrations, with their diagnostics and the results of the fits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.calibration.calibration_file import CalibrationDraws
from tradestudy.calibration.corners.trust import DISTANCES
from tradestudy.calibration.posteriors import InferredCalibration
from tradestudy.calibration.projection import lens_of_text, text_of_lens
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.run.groups.real_rig import rig_lenses, rig_rows, rig_trust

_SHOWN_STEPS = 300


def calibration_group(inferred: Mapping[str, InferredCalibration]) -> xr.Dataset:
    """/calibration: the posterior of every camera with an inferred calibration, and the results of the fits."""
    posterior, names = _posteriors(inferred)
    lenses, lens_names = rig_lenses(inferred)
    values = posterior | rig_rows(inferred) | rig_trust(inferred) | lenses
    distances: dict[str, Any] = {"rig_distance": list(DISTANCES)} if "rig_claimed" in values else {}
    models = {"lens_model": lens_names} if lenses else {}
    return dataset("calibration", values, {"posterior": list(inferred), "parameter": names, **distances, **models})


def _posteriors(calibrations: Mapping[str, InferredCalibration]) -> tuple[dict[str, Any], list[str]]:
    """Variables of the inferred calibrations, padded with NaN over all parameters."""
    names = list(dict.fromkeys(name for one in calibrations.values() for name in one.sample.names))
    most = max(len(one.posterior.draws) for one in calibrations.values())
    ensembles = max(one.sample.chains.shape[0] for one in calibrations.values())

    def over_parameters(get: Any) -> FloatArray:
        return np.stack([_spread(one, names, np.asarray(get(one))) for one in calibrations.values()])

    def of_each(get: Any) -> list[Any]:
        return [get(one) for one in calibrations.values()]

    overconfidence = [
        np.full(len(one.sample.names), np.nan)
        if one.fit is None
        else np.concatenate([one.fit.explained.overconfidence, np.full(5, np.nan)])
        for one in calibrations.values()
    ]
    return {
        "posterior_converged": of_each(lambda one: not one.failures),
        "posterior_verdict": of_each(lambda one: "; ".join(one.failures)),
        "posterior_kind": of_each(lambda one: "simulated target" if one.fit is None else "corners of a board"),
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
        "posterior_best": over_parameters(_best),
        "posterior_lens_model": of_each(lambda one: text_of_lens(one.posterior.lens)),
        "posterior_pixels": of_each(lambda one: one.posterior.pixels or (0, 0)),
        "posterior_draw": over_parameters(lambda one: _draws(one, most)),
        "posterior_trace": over_parameters(lambda one: _trace(one, ensembles)),
        "rig_overconfidence": np.stack(
            [_spread(one, names, row) for one, row in zip(calibrations.values(), overconfidence, strict=True)]
        ),
    }, names


def _draws(one: InferredCalibration, most: int) -> FloatArray:
    """The propagated draws, over the parameters of the sample; NaN for parameters without draws."""
    found = np.full((most, len(one.sample.names)), np.nan)
    columns = [one.sample.names.index(name) for name in one.posterior.names]
    found[: len(one.posterior.draws), columns] = one.posterior.draws
    return found


def _best(one: InferredCalibration) -> FloatArray:
    """The best fit of a rig calibrated from corners, over the parameters of the sample; NaN for others."""
    found = np.full(len(one.sample.names), np.nan)
    if one.posterior.best is not None:
        found[[one.sample.names.index(name) for name in one.posterior.names]] = one.posterior.best
    return found


def _trace(one: InferredCalibration, ensembles: int) -> FloatArray:
    """The first walker of each ensemble at evenly spaced steps, shape (ensembles, steps, parameters)."""
    chains = one.sample.chains[:, :, 0]
    steps = (np.arange(_SHOWN_STEPS) * chains.shape[1]) // _SHOWN_STEPS
    padded = np.full((ensembles, _SHOWN_STEPS, chains.shape[-1]), np.nan)
    padded[: len(chains)] = chains[:, steps]
    return padded


def _spread(one: InferredCalibration, names: list[str], values: FloatArray) -> FloatArray:
    """Place values over a calibration's own parameters (last axis) among the parameters of all calibrations."""
    found = np.full((*values.shape[:-1], len(names)), np.nan)
    found[..., [names.index(name) for name in one.sample.names]] = values
    return found


def saved_posteriors(tree: xr.DataTree) -> dict[str, CalibrationDraws]:
    """The posteriors of a run, by camera, as written beside its results."""
    if "calibration" not in tree.children:
        return {}
    group, found = tree["calibration"].to_dataset(), {}
    for name in group["posterior"].values:
        one = group.sel(posterior=name)
        of_rig = bool(np.isfinite(one["posterior_best"].values).any())
        drawn = one["parameter"].values[np.isfinite(one["posterior_draw"].values).any(axis=0)]
        own = one.sel(parameter=drawn)
        draws = own["posterior_draw"].values
        draws = draws[np.isfinite(draws).all(axis=1)]
        columns, rows = (int(count) for count in own["posterior_pixels"].values)
        found[str(name)] = CalibrationDraws(
            names=tuple(map(str, own["parameter"].values)),
            draws=draws,
            reference=None if of_rig else draws.mean(axis=0),
            best=own["posterior_best"].values if of_rig else None,
            pixels=(columns, rows) if of_rig else None,
            lens=lens_of_text(str(one["posterior_lens_model"].item())),
        )
    return found
