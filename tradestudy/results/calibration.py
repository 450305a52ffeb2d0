"""/calibration: inferred calibrations; /sensitivity: depth uncertainty by error source; the ranks of /decision."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import Variable

_REPLICATES = "standard error over independent scrambles"
_ESTIMATE = "itself an estimate"

CALIBRATION: Final[Mapping[str, Variable]] = {
    "posterior_converged": Variable(
        dims=("posterior",), units="1", long_name="whether the chains of the inferred calibration converged"
    ),
    "posterior_verdict": Variable(
        dims=("posterior",), units="", long_name="convergence limits that the chains miss; empty where they converged"
    ),
    "posterior_kind": Variable(dims=("posterior",), units="", long_name="data that the calibration was inferred from"),
    "posterior_lengths": Variable(
        dims=("posterior",),
        units="1",
        long_name="number of kept steps, divided by the longest autocorrelation time",
        symbol="N/τ",
    ),
    "posterior_acceptance": Variable(
        dims=("posterior", "ensemble"), units="1", long_name="fraction of proposed steps that the sampler accepts"
    ),
    "posterior_marginal_efficiency": Variable(
        dims=("posterior",),
        units="1",
        long_name="effective fraction of draws after reweighting them with poses refitted at each draw",
    ),
    "posterior_evaluations": Variable(
        dims=("posterior",), units="1", long_name="number of evaluations of the log posterior"
    ),
    "posterior_seconds": Variable(dims=("posterior",), units="s", long_name="computing time of the sampling"),
    "laplace_seconds": Variable(dims=("posterior",), units="s", long_name="computing time of the normal approximation"),
    "posterior_mean": Variable(
        dims=("posterior", "parameter"),
        units="mixed",
        long_name="posterior mean of a parameter, in SI or, where the name of the parameter says so, in pixels; "
        "NaN where it is not inferred",
        error="posterior_deviation over the square root of posterior_bulk_size",
    ),
    "posterior_deviation": Variable(
        dims=("posterior", "parameter"), units="mixed", long_name="posterior standard deviation of a parameter"
    ),
    "prior_deviation": Variable(
        dims=("posterior", "parameter"),
        units="mixed",
        long_name="prior standard deviation of a parameter; infinite where the prior is flat",
    ),
    "laplace_deviation": Variable(
        dims=("posterior", "parameter"),
        units="mixed",
        long_name="standard deviation of a parameter by the normal approximation",
    ),
    "posterior_autocorrelation": Variable(
        dims=("posterior", "parameter"), units="1", long_name="integrated autocorrelation time [steps]", symbol="τ"
    ),
    "posterior_r_hat": Variable(
        dims=("posterior", "parameter"),
        units="1",
        long_name="rank-normalised split R-hat over independent ensembles",
        reference="Vehtari et al., Bayesian Analysis 16 (2021) 667",
    ),
    "posterior_bulk_size": Variable(
        dims=("posterior", "parameter"), units="1", long_name="effective sample size in the bulk"
    ),
    "posterior_tail_size": Variable(
        dims=("posterior", "parameter"), units="1", long_name="effective sample size in the tails"
    ),
    "posterior_best": Variable(
        dims=("posterior", "parameter"),
        units="mixed",
        long_name="parameter values with which a rig calibrated from corners measures depth; NaN for other cameras",
        error="posterior_deviation",
    ),
    "posterior_lens_model": Variable(
        dims=("posterior",),
        units="",
        long_name="lens model of both cameras, unless it is a pinhole with k1 and k2: its name, the coefficients "
        "that are parameters, and the starting point of the fit",
    ),
    "posterior_pixels": Variable(
        dims=("posterior", "side"),
        units="px",
        long_name="number of columns and rows of the calibration pictures; 0 if there are none",
    ),
    "posterior_draw": Variable(
        dims=("posterior", "draw", "parameter"), units="mixed", long_name="joint draws from all chains"
    ),
    "posterior_trace": Variable(
        dims=("posterior", "ensemble", "step", "parameter"),
        units="mixed",
        long_name="positions of each ensemble's first walker, at steps spread over the kept chain",
    ),
    "rig_quantity": Variable(dims=("rig_row",), units="", long_name="name of a finding about a real rig"),
    "rig_camera": Variable(dims=("rig_row",), units="", long_name="name of the rig"),
    "rig_value": Variable(dims=("rig_row",), units="", long_name="value of the finding, with its unit"),
    "rig_claimed": Variable(
        dims=("posterior", "rig_distance"),
        units="m",
        long_name="standard deviation of depth according to the fit to corners, midway between the axes",
    ),
    "rig_halves_difference": Variable(
        dims=("posterior", "rig_distance"),
        units="m",
        long_name="root mean square difference of depth between fits to random halves of the views",
    ),
    "rig_halves_claim": Variable(
        dims=("posterior", "rig_distance"),
        units="m",
        long_name="rig_halves_difference as predicted from the covariances of the two halves",
        symbol="√(C_A + C_B)",
    ),
    "rig_lens_support": Variable(
        dims=("posterior", "lens_model"),
        units="1",
        long_name="gain in log likelihood, for views left out in turn, of another lens model over the one in "
        "use; NaN where the model was not compared",
        error="rig_lens_support_deviation",
    ),
    "rig_lens_support_deviation": Variable(
        dims=("posterior", "lens_model"),
        units="1",
        long_name="standard error of rig_lens_support over views",
        error=_ESTIMATE,
    ),
    "rig_lens_change": Variable(
        dims=("posterior", "lens_model", "rig_distance"),
        units="m",
        long_name="change of the depth measured in the same pictures when another lens model replaces the one in use",
        error="rig_lens_change_deviation",
    ),
    "rig_lens_change_deviation": Variable(
        dims=("posterior", "lens_model", "rig_distance"),
        units="m",
        long_name="standard error of rig_lens_change by the jackknife over views",
        error=_ESTIMATE,
    ),
    "rig_residual": Variable(
        dims=("posterior", "rig_side", "rig_cell_row", "rig_cell_column", "rig_axis"),
        units="px",
        long_name="mean residual of the corners in a cell of the left or right picture; NaN in cells without corners",
    ),
    "rig_overconfidence": Variable(
        dims=("posterior", "parameter"),
        units="1",
        long_name="standard deviation of a parameter with the term for differences between left and right, "
        "relative to that without this term; NaN without the term",
    ),
}

SENSITIVITY: Final[Mapping[str, Variable]] = {
    "source_uncertainty": Variable(
        dims=("camera", "field", "distance", "source"),
        units="m",
        long_name="half the width of the central 68.27 % interval of depth from one independent error source alone",
        error="source_uncertainty_error",
    ),
    "source_uncertainty_error": Variable(
        dims=("camera", "field", "distance", "source"), units="m", long_name=_REPLICATES, error=_ESTIMATE
    ),
    "source_class": Variable(
        dims=("camera", "source"), units="", long_name="how often the error source is redrawn; empty where absent"
    ),
    "source_parameters": Variable(
        dims=("camera", "source"), units="", long_name="parameters that the error source changes together"
    ),
    "parameter_uncertainty": Variable(
        dims=("camera", "field", "distance", "parameter"),
        units="m",
        long_name="half the width of the central 68.27 % interval of depth from one parameter alone; NaN where "
        "that would mislead",
        error="parameter_uncertainty_error",
    ),
    "parameter_uncertainty_error": Variable(
        dims=("camera", "field", "distance", "parameter"), units="m", long_name=_REPLICATES, error=_ESTIMATE
    ),
    "parameter_refused": Variable(
        dims=("camera",), units="", long_name="why the report has no tornado chart by parameter; empty where it has one"
    ),
    "first_index": Variable(
        dims=("camera", "field", "distance", "source"),
        units="1",
        long_name="share of the variance of inverse depth from an error source alone",
        symbol="S_i",
        error="first_index_error",
    ),
    "first_index_error": Variable(
        dims=("camera", "field", "distance", "source"), units="1", long_name=_REPLICATES, error=_ESTIMATE
    ),
    "total_index": Variable(
        dims=("camera", "field", "distance", "source"),
        units="1",
        long_name="share of the variance of inverse depth from an error source with all its interactions",
        symbol="S_Ti",
        error="total_index_error",
    ),
    "total_index_error": Variable(
        dims=("camera", "field", "distance", "source"), units="1", long_name=_REPLICATES, error=_ESTIMATE
    ),
    "index_refused": Variable(
        dims=("camera", "field", "distance"),
        units="",
        long_name="why first_index and total_index are not computed; empty where they are",
    ),
}

RANKS: Final[Mapping[str, Variable]] = {
    "rank_first": Variable(
        dims=("pair", "rank_error_source", "rank_distance"),
        units="1",
        long_name="probability that the depth error of the first camera is the smaller one",
        error="rank_first_error",
    ),
    "rank_first_error": Variable(
        dims=("pair", "rank_error_source", "rank_distance"), units="1", long_name=_REPLICATES, error=_ESTIMATE
    ),
    "rank_second": Variable(
        dims=("pair", "rank_error_source", "rank_distance"),
        units="1",
        long_name="probability that the depth error of the second camera is the smaller one",
        error="rank_first_error",
    ),
    "pair_first": Variable(dims=("pair",), units="", long_name="first camera of the pair"),
    "pair_second": Variable(dims=("pair",), units="", long_name="second camera of the pair"),
}
