"""/calibration: fitted calibrations; /sensitivity: depth uncertainty by error source; the ranks of /decision."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import ESTIMATE, Variable

CALIBRATION: Final[Mapping[str, Variable]] = {
    "posterior_converged": Variable(
        dims=("posterior",),
        units="1",
        long_name="whether the chains pass all checks: they are long enough (posterior_lengths ≥ 50, effective sample "
        "sizes ≥ 400), agree with each other (split R-hat ≤ 1.01 between ensembles, ≤ 1.1 within one) and accept 20 to "
        "50 % of the steps, and posterior_marginal_efficiency is at least 0.9",
    ),
    "posterior_verdict": Variable(
        dims=("posterior",),
        units="",
        long_name="names of the checks that the chains failed; empty where they passed all",
    ),
    "posterior_kind": Variable(
        dims=("posterior",),
        units="",
        long_name="what the calibration was fitted to: simulated views of a board ('simulated target') or corners "
        "found in real pictures of one ('corners of a board')",
    ),
    "posterior_lengths": Variable(
        dims=("posterior",),
        units="1",
        long_name="length of the chains: number of steps after the warm-up, divided by the longest autocorrelation "
        "time of a parameter",
        symbol="N/τ",
    ),
    "posterior_acceptance": Variable(
        dims=("posterior", "ensemble"),
        units="1",
        long_name="fraction of the proposed steps that the sampler accepted; NaN for indices after the last "
        "ensemble of a calibration",
    ),
    "posterior_marginal_efficiency": Variable(
        dims=("posterior",),
        units="1",
        long_name="effective number of draws after reweighting, as a fraction of all draws; the chains sample a "
        "posterior that is integrated only approximately over the poses of the board; to check this approximation, the "
        "poses are fitted anew for each draw, and the draws are reweighted by the result; the fraction is near 1 if "
        "the approximation is good",
    ),
    "posterior_evaluations": Variable(
        dims=("posterior",), units="1", long_name="number of evaluations of the log posterior"
    ),
    "posterior_seconds": Variable(dims=("posterior",), units="s", long_name="computing time of the chains"),
    "laplace_seconds": Variable(
        dims=("posterior",), units="s", long_name="computing time of the normal approximation of the posterior"
    ),
    "posterior_mean": Variable(
        dims=("posterior", "parameter"),
        units="mixed",
        long_name="posterior mean of a parameter; NaN where the parameter is not fitted",
        error="posterior_deviation divided by the square root of posterior_bulk_size",
    ),
    "posterior_deviation": Variable(
        dims=("posterior", "parameter"),
        units="mixed",
        long_name="posterior standard deviation of a parameter; NaN where the parameter is not fitted",
    ),
    "prior_deviation": Variable(
        dims=("posterior", "parameter"),
        units="mixed",
        long_name="prior standard deviation of a parameter; infinite where the prior is flat, NaN where the "
        "parameter is not fitted",
    ),
    "laplace_deviation": Variable(
        dims=("posterior", "parameter"),
        units="mixed",
        long_name="standard deviation of a parameter by the normal approximation of the posterior; NaN where the "
        "parameter is not fitted",
    ),
    "posterior_autocorrelation": Variable(
        dims=("posterior", "parameter"),
        units="1",
        long_name="integrated autocorrelation time of a parameter, in steps; NaN where the parameter is not fitted",
        symbol="τ",
    ),
    "posterior_r_hat": Variable(
        dims=("posterior", "parameter"),
        units="1",
        long_name="rank-normalised split R-hat of a parameter over independent ensembles; NaN where the parameter "
        "is not fitted",
        reference="Vehtari et al., Bayesian Analysis 16 (2021) 667",
    ),
    "posterior_bulk_size": Variable(
        dims=("posterior", "parameter"),
        units="1",
        long_name="effective sample size of a parameter in the bulk of the posterior; NaN where the parameter is "
        "not fitted",
    ),
    "posterior_tail_size": Variable(
        dims=("posterior", "parameter"),
        units="1",
        long_name="effective sample size of a parameter in the tails of the posterior; NaN where the parameter is "
        "not fitted",
    ),
    "posterior_best": Variable(
        dims=("posterior", "parameter"),
        units="mixed",
        long_name="best-fit value of a parameter, with which a stereo rig calibrated from corners computes depth; NaN "
        "for cameras not calibrated from corners, and for parameters that are not used to compute depth",
        error="see posterior_deviation",
    ),
    "posterior_lens_model": Variable(
        dims=("posterior",),
        units="",
        long_name="lens model of both cameras: its name, its fitted coefficients, and the values from which the fit "
        "started; empty for the default, a pinhole model with radial distortion by k1 and k2 only",
    ),
    "posterior_pixels": Variable(
        dims=("posterior", "side"),
        units="px",
        long_name="number of columns, then of rows (along 'side') of the calibration pictures; 0 without pictures",
    ),
    "posterior_draw": Variable(
        dims=("posterior", "draw", "parameter"),
        units="mixed",
        long_name="value of a parameter in one of the draws of all parameters together, taken from all chains; NaN "
        "where the parameter is not drawn, and for indices after the last draw",
    ),
    "posterior_trace": Variable(
        dims=("posterior", "ensemble", "step", "parameter"),
        units="mixed",
        long_name="value of a parameter along the first chain of each ensemble, at steps spread evenly after the "
        "warm-up; NaN where the parameter is not fitted, and for indices after the last ensemble of the calibration",
    ),
    "rig_quantity": Variable(
        dims=("rig_row",), units="", long_name="quantity that the calibration from corners determines or checks"
    ),
    "rig_camera": Variable(dims=("rig_row",), units="", long_name="stereo rig to which rig_quantity belongs"),
    "rig_value": Variable(dims=("rig_row",), units="", long_name="value of rig_quantity, with its unit"),
    "rig_claimed": Variable(
        dims=("posterior", "rig_distance"),
        units="m",
        long_name="standard deviation of depth according to the covariance of the fit to all corners; NaN for "
        "cameras not calibrated from corners",
    ),
    "rig_halves_difference": Variable(
        dims=("posterior", "rig_distance"),
        units="m",
        long_name="root-mean-square difference between the depths from two fits, each to a random half of the "
        "views; NaN for cameras not calibrated from corners",
    ),
    "rig_halves_claim": Variable(
        dims=("posterior", "rig_distance"),
        units="m",
        long_name="rig_halves_difference as predicted from the variances of depth, V_A and V_B, according to the two "
        "fits; NaN for cameras not calibrated from corners",
        symbol="√(V_A + V_B)",
    ),
    "rig_lens_support": Variable(
        dims=("posterior", "lens_model"),
        units="1",
        long_name="how much better another lens model predicts the corners than the model in use: difference between "
        "the log likelihoods of views left out of the fit one at a time; NaN where the model was not compared",
        error="see rig_lens_support_deviation",
    ),
    "rig_lens_support_deviation": Variable(
        dims=("posterior", "lens_model"),
        units="1",
        long_name="standard error of rig_lens_support over views; NaN where the model was not compared",
        error=ESTIMATE,
    ),
    "rig_lens_change": Variable(
        dims=("posterior", "lens_model", "rig_distance"),
        units="m",
        long_name="depth by another lens model minus depth by the model in use, from the same pictures; NaN where the "
        "model was not compared",
        error="see rig_lens_change_deviation",
    ),
    "rig_lens_change_deviation": Variable(
        dims=("posterior", "lens_model", "rig_distance"),
        units="m",
        long_name="standard error of rig_lens_change, by a jackknife over views; NaN where the model was not compared",
        error=ESTIMATE,
    ),
    "rig_residual": Variable(
        dims=("posterior", "rig_side", "rig_cell_row", "rig_cell_column", "rig_axis"),
        units="px",
        long_name="mean residual along x or y of the corners in one cell of a grid over the left or right picture, "
        "with the left and the right camera each fitted alone; NaN in cells without corners and for rigs not "
        "calibrated from corners",
    ),
    "rig_overconfidence": Variable(
        dims=("posterior", "parameter"),
        units="1",
        long_name="standard deviation of a parameter according to a fit that lets the board move between the left and "
        "the right exposure of a view, divided by its standard deviation according to a fit that does not; NaN where "
        "the parameter is not fitted",
    ),
}

SENSITIVITY: Final[Mapping[str, Variable]] = {
    "corner": Variable(
        dims=("camera", "field"),
        units="",
        long_name="corner of the picture towards which the field position lies: the one where depth is least certain; "
        "empty on the axis",
    ),
    "source_uncertainty": Variable(
        dims=("camera", "field", "distance", "source"),
        units="m",
        long_name="depth uncertainty from one error source alone; NaN where the camera lacks the source",
        error="see source_uncertainty_error",
    ),
    "source_uncertainty_error": Variable(
        dims=("camera", "field", "distance", "source"),
        units="m",
        long_name="standard error of source_uncertainty over scrambles; NaN where the camera lacks the source",
        error=ESTIMATE,
    ),
    "source_class": Variable(
        dims=("camera", "source"),
        units="",
        long_name="how often the error takes a new value: 'per rig', 'per session', 'per lens or pixel' or 'per "
        "measurement'; empty where the camera lacks the source",
    ),
    "source_parameters": Variable(
        dims=("camera", "source"),
        units="",
        long_name="parameters that the error source changes together; empty where the camera lacks the source",
    ),
    "parameter_uncertainty": Variable(
        dims=("camera", "field", "distance", "parameter"),
        units="m",
        long_name="depth uncertainty from the error of one parameter alone; NaN where the camera lacks the "
        "parameter, or for the reason in parameter_refused",
        error="see parameter_uncertainty_error",
    ),
    "parameter_uncertainty_error": Variable(
        dims=("camera", "field", "distance", "parameter"),
        units="m",
        long_name="standard error of parameter_uncertainty over scrambles; NaN where parameter_uncertainty is NaN",
        error=ESTIMATE,
    ),
    "parameter_refused": Variable(
        dims=("camera",),
        units="",
        long_name="why parameter_uncertainty is not computed; empty where it is",
    ),
    "first_index": Variable(
        dims=("camera", "field", "distance", "source"),
        units="1",
        long_name="first-order Sobol index: fraction of the variance of inverse depth (1/depth) that the error "
        "source causes alone; NaN where the camera lacks the source, or for the reason in index_refused",
        symbol="S_i",
        error="see first_index_error",
    ),
    "first_index_error": Variable(
        dims=("camera", "field", "distance", "source"),
        units="1",
        long_name="standard error of first_index over scrambles; NaN where first_index is NaN",
        error=ESTIMATE,
    ),
    "total_index": Variable(
        dims=("camera", "field", "distance", "source"),
        units="1",
        long_name="total Sobol index: fraction of the variance of inverse depth (1/depth) that the error source "
        "causes, including its interactions with others; NaN where first_index is NaN",
        symbol="S_Ti",
        error="see total_index_error",
    ),
    "total_index_error": Variable(
        dims=("camera", "field", "distance", "source"),
        units="1",
        long_name="standard error of total_index over scrambles; NaN where total_index is NaN",
        error=ESTIMATE,
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
        long_name="probability that the depth error of pair_first is smaller in magnitude than that of pair_second; "
        "failed measurements count as infinite errors",
        error="see rank_first_error",
    ),
    "rank_first_error": Variable(
        dims=("pair", "rank_error_source", "rank_distance"),
        units="1",
        long_name="standard error of rank_first over scrambles",
        error=ESTIMATE,
    ),
    "rank_second": Variable(
        dims=("pair", "rank_error_source", "rank_distance"),
        units="1",
        long_name="probability that the depth error of pair_second is smaller in magnitude than that of pair_first",
        error="see rank_first_error",
    ),
    "pair_first": Variable(dims=("pair",), units="", long_name="first camera of the pair"),
    "pair_second": Variable(dims=("pair",), units="", long_name="second camera of the pair"),
}
