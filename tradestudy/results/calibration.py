"""What /calibration and /sensitivity hold, and what they add to /decision."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import Variable

_OVER = ("camera", "field", "way", "distance")
_TABLE = ("camera", "field", "way")
_REPLICATES = "standard error over independent scrambles"

CALIBRATION: Final[Mapping[str, Variable]] = {
    "nominal_depth": Variable(
        dims=("camera", "field", "distance"),
        units="m",
        long_name="depth read without any error; NaN where the camera does not see the point",
        error="rounding",
    ),
    "depth_quantile": Variable(
        dims=(*_OVER, "quantile"),
        units="m",
        long_name="quantile of depth by the exact model, conditional on a reading; infinite beyond infinity",
        symbol="a_p",
        reference="JCGM 101:2008, 7.7",
        error="depth_quantile_error",
    ),
    "depth_quantile_error": Variable(dims=(*_OVER, "quantile"), units="m", long_name=_REPLICATES),
    "depth_uncertainty": Variable(
        dims=_OVER,
        units="m",
        long_name="half the central 68.27 % interval of depth",
        symbol="u(a)",
        error="depth_uncertainty_error",
    ),
    "depth_uncertainty_error": Variable(dims=_OVER, units="m", long_name=_REPLICATES),
    "shortest_interval": Variable(
        dims=(*_OVER, "end"),
        units="m",
        long_name="shortest 95 % interval; NaN to infinity where none is bounded",
        reference="JCGM 101:2008, 7.7.3",
        error="shortest_interval_error",
    ),
    "shortest_interval_error": Variable(dims=(*_OVER, "end"), units="m", long_name=_REPLICATES),
    "mean": Variable(dims=_OVER, units="m", long_name="mean depth; NaN where moments do not exist", error="mean_error"),
    "mean_error": Variable(dims=_OVER, units="m", long_name=_REPLICATES),
    "bias": Variable(
        dims=_OVER, units="m", long_name="mean less nominal; NaN where moments do not exist", error="mean_error"
    ),
    "standard_deviation": Variable(
        dims=_OVER,
        units="m",
        long_name="standard deviation of depth; NaN where it does not exist",
        error="standard_deviation_error",
    ),
    "standard_deviation_error": Variable(dims=_OVER, units="m", long_name=_REPLICATES),
    "moments_exist": Variable(dims=_OVER, units="1", long_name="whether mean and standard deviation of depth exist"),
    "moments_end": Variable(
        dims=_TABLE,
        units="m",
        long_name="where mean and standard deviation cease to exist; infinite for beyond the range, NaN for nowhere",
    ),
    "infinite_fraction": Variable(
        dims=_OVER,
        units="1",
        long_name="probability of a reading at or beyond infinity",
        error="infinite_fraction_error",
    ),
    "infinite_fraction_error": Variable(dims=_OVER, units="1", long_name=_REPLICATES),
    "failed_fraction": Variable(
        dims=(*_OVER, "cause"),
        units="1",
        long_name="probability of no reading, by cause; the quantiles are conditional on the rest",
        error="failed_fraction_error",
    ),
    "failed_fraction_error": Variable(dims=(*_OVER, "cause"), units="1", long_name=_REPLICATES),
    "status": Variable(
        dims=_OVER, units="", long_name="converged, budget, memory, or unranked where there is no reading at all"
    ),
    "draws": Variable(dims=_TABLE, units="1", long_name="draws of the exact model"),
    "linear_uncertainty": Variable(
        dims=_OVER,
        units="m",
        long_name="standard uncertainty by the law of propagation, first order",
        reference="JCGM 100:2008, eq. 13",
        error="see linear_verdict",
    ),
    "linear_quantile": Variable(
        dims=(*_OVER, "quantile"),
        units="m",
        long_name="quantile of the normal distribution that the line in depth implies",
        error="see linear_verdict",
    ),
    "inverse_linear_quantile": Variable(
        dims=(*_OVER, "quantile"),
        units="m",
        long_name="quantile by the line in inverse depth, mapped back",
        error="see inverse_linear_verdict",
    ),
    "linear_verdict": Variable(
        dims=_OVER,
        units="",
        long_name="whether the linear 95 % interval may be used at two digits",
        reference="JCGM 101:2008, 8.1",
    ),
    "inverse_linear_verdict": Variable(
        dims=_OVER,
        units="",
        long_name="whether the 95 % interval by the line in inverse depth may be used at two digits",
        reference="JCGM 101:2008, 8.1",
    ),
    "tier": Variable(dims=_OVER, units="", long_name="cheapest method whose 95 % interval has the accuracy asked for"),
    "tier_evaluations": Variable(dims=(*_TABLE, "method"), units="1", long_name="evaluations of the exact model"),
    "tier_seconds": Variable(dims=(*_TABLE, "method"), units="s", long_name="seconds on the machine of the run"),
    "tier_error": Variable(
        dims=(*_TABLE, "method"),
        units="1",
        long_name="largest error of an end of the 95 % interval over its distance, where that end is finite",
    ),
    "posterior_converged": Variable(
        dims=("posterior",), units="1", long_name="whether the inferred calibration may be stated as converged"
    ),
    "posterior_verdict": Variable(
        dims=("posterior",), units="", long_name="limits that the chains do not meet; empty where they converged"
    ),
    "posterior_kind": Variable(dims=("posterior",), units="", long_name="what the calibration was inferred from"),
    "posterior_lengths": Variable(
        dims=("posterior",),
        units="1",
        long_name="kept steps over the longest autocorrelation time",
        symbol="N/τ",
    ),
    "posterior_acceptance": Variable(
        dims=("posterior", "ensemble"), units="1", long_name="share of accepted proposals"
    ),
    "posterior_marginal_efficiency": Variable(
        dims=("posterior",),
        units="1",
        long_name="share of draws that survive reweighting to poses settled anew at each draw",
    ),
    "posterior_evaluations": Variable(dims=("posterior",), units="1", long_name="log posteriors computed"),
    "posterior_seconds": Variable(dims=("posterior",), units="s", long_name="seconds of sampling"),
    "laplace_seconds": Variable(dims=("posterior",), units="s", long_name="seconds of the normal approximation"),
    "posterior_mean": Variable(
        dims=("posterior", "parameter"),
        units="mixed",
        long_name="mean of the posterior in SI, or pixels where the name says so; NaN where not inferred",
        error="posterior_deviation over the square root of posterior_bulk_size",
    ),
    "posterior_deviation": Variable(
        dims=("posterior", "parameter"), units="mixed", long_name="standard deviation of the posterior"
    ),
    "prior_deviation": Variable(
        dims=("posterior", "parameter"), units="mixed", long_name="of the prior; infinite where flat"
    ),
    "laplace_deviation": Variable(
        dims=("posterior", "parameter"), units="mixed", long_name="of the normal approximation"
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
        dims=("posterior", "parameter"), units="1", long_name="effective size of the bulk of the draws"
    ),
    "posterior_tail_size": Variable(
        dims=("posterior", "parameter"), units="1", long_name="effective size of the tails of the draws"
    ),
    "posterior_draw": Variable(
        dims=("posterior", "draw", "parameter"), units="mixed", long_name="joint draws, spread over all chains"
    ),
    "posterior_trace": Variable(
        dims=("posterior", "ensemble", "step", "parameter"),
        units="mixed",
        long_name="first walker of each ensemble at steps spread over the kept chain",
    ),
    "rig_quantity": Variable(dims=("rig_row",), units="", long_name="what was found of a real rig"),
    "rig_camera": Variable(dims=("rig_row",), units="", long_name="the rig"),
    "rig_value": Variable(dims=("rig_row",), units="", long_name="the value, with its unit"),
    "rig_overconfidence": Variable(
        dims=("posterior", "parameter"),
        units="1",
        long_name="standard deviation with the left–right term over that claimed without it; NaN where there is none",
    ),
}

SENSITIVITY: Final[Mapping[str, Variable]] = {
    "source_uncertainty": Variable(
        dims=("camera", "field", "distance", "source"),
        units="m",
        long_name="half the central 68.27 % interval of depth from one independent source alone",
        error="source_uncertainty_error",
    ),
    "source_uncertainty_error": Variable(
        dims=("camera", "field", "distance", "source"), units="m", long_name=_REPLICATES
    ),
    "source_class": Variable(
        dims=("camera", "source"), units="", long_name="how often the source is drawn anew; empty where absent"
    ),
    "source_parameters": Variable(
        dims=("camera", "source"), units="", long_name="parameters that the source moves together"
    ),
    "parameter_uncertainty": Variable(
        dims=("camera", "field", "distance", "parameter"),
        units="m",
        long_name="half the central 68.27 % interval of depth from one parameter alone; NaN where that would mislead",
        error="parameter_uncertainty_error",
    ),
    "parameter_uncertainty_error": Variable(
        dims=("camera", "field", "distance", "parameter"), units="m", long_name=_REPLICATES
    ),
    "parameter_refused": Variable(
        dims=("camera",), units="", long_name="why there is no tornado by parameter; empty where there is one"
    ),
    "first_index": Variable(
        dims=("camera", "field", "distance", "source"),
        units="1",
        long_name="share of the variance of inverse depth from a source alone",
        symbol="S_i",
        error="first_index_error",
    ),
    "first_index_error": Variable(dims=("camera", "field", "distance", "source"), units="1", long_name=_REPLICATES),
    "total_index": Variable(
        dims=("camera", "field", "distance", "source"),
        units="1",
        long_name="share of the variance of inverse depth from a source with all its interactions",
        symbol="S_Ti",
        error="total_index_error",
    ),
    "total_index_error": Variable(dims=("camera", "field", "distance", "source"), units="1", long_name=_REPLICATES),
    "index_refused": Variable(
        dims=("camera", "field", "distance"), units="", long_name="why there are no indices; empty where there are"
    ),
}

DECISION_ADDITIONS: Final[Mapping[str, Variable]] = {
    "rank_first": Variable(
        dims=("pair", "field", "rank_way", "rank_distance"),
        units="1",
        long_name="probability that the depth error of the first camera is the smaller one",
        error="rank_first_error",
    ),
    "rank_first_error": Variable(dims=("pair", "field", "rank_way", "rank_distance"), units="1", long_name=_REPLICATES),
    "rank_second": Variable(
        dims=("pair", "field", "rank_way", "rank_distance"),
        units="1",
        long_name="probability that the depth error of the second camera is the smaller one",
        error="rank_first_error",
    ),
    "pair_first": Variable(dims=("pair",), units="", long_name="first camera"),
    "pair_second": Variable(dims=("pair",), units="", long_name="second camera"),
    "equal_distance": Variable(
        dims=("pair", "field", "rank_way", "sampled_crossing"),
        units="m",
        long_name="distance where both are equally uncertain by the exact models; NaN where there is none",
        error="equal_distance_error",
    ),
    "equal_distance_error": Variable(
        dims=("pair", "field", "rank_way", "sampled_crossing"),
        units="m",
        long_name="Monte Carlo standard error; infinite where not every replicate crosses",
    ),
    "stability_says": Variable(dims=("stability",), units="", long_name="the inverse question"),
    "stability_answer": Variable(dims=("stability",), units="", long_name="the answer in words"),
    "stability_declared": Variable(
        dims=("stability",), units="mixed", long_name="standard deviation as declared, in stability_units"
    ),
    "stability_value": Variable(
        dims=("stability",),
        units="mixed",
        long_name="standard deviation that would be needed, in stability_units; NaN where none answers",
        error="stability_error",
    ),
    "stability_error": Variable(dims=("stability",), units="mixed", long_name=_REPLICATES),
    "stability_units": Variable(dims=("stability",), units="", long_name="SI unit"),
    "stability_wanted": Variable(dims=("stability",), units="m", long_name="depth uncertainty asked for"),
    "stability_without": Variable(dims=("stability",), units="m", long_name="depth uncertainty without this error"),
    "stability_as_declared": Variable(dims=("stability",), units="m", long_name="depth uncertainty as declared"),
}
