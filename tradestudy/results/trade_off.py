"""/criteria: weighed criteria, ranks over all possible weights, and Pareto-optimal designs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import Variable

_BOTH: Final = ("candidate", "weighed")
_SMAA: Final = "Lahdelma and Salminen, Oper. Res. 49, 444 (2001)"

TRADE_OFF: Final[Mapping[str, Variable]] = {
    "weighed_value": Variable(
        dims=_BOTH,
        units="mixed",
        long_name="value of a criterion for a candidate, in weighed_units; NaN where the candidate is not usable",
        error="weighed_value_error",
    ),
    "weighed_value_error": Variable(
        dims=_BOTH, units="mixed", long_name="standard error of weighed_value", error="itself an estimate"
    ),
    "weighed_units": Variable(dims=("weighed",), units="", long_name="SI unit of weighed_value, 'worst' and 'best'"),
    "weighed_says": Variable(dims=("weighed",), units="", long_name="meaning of the criterion"),
    "worst": Variable(dims=("weighed",), units="mixed", long_name="value that scores 0", error="none: declared"),
    "best": Variable(dims=("weighed",), units="mixed", long_name="value that scores 1", error="none: declared"),
    "worth": Variable(
        dims=_BOTH,
        units="1",
        long_name="score of weighed_value, linear from 0 at 'worst' to 1 at 'best', and clipped beyond; 0 where "
        "weighed_value is NaN",
        error="that of weighed_value divided by 'best' minus 'worst'",
    ),
    "clipped": Variable(
        dims=_BOTH, units="1", long_name="whether weighed_value lies beyond 'worst' or 'best'", error="exact"
    ),
    "weight_low": Variable(
        dims=("weighed",), units="1", long_name="smallest possible weight of the criterion", error="none: declared"
    ),
    "weight_high": Variable(
        dims=("weighed",), units="1", long_name="largest possible weight of the criterion", error="none: declared"
    ),
    "weight_order": Variable(
        dims=("weighed",),
        units="1",
        long_name="position of the criterion in the declared order of importance, counted from 1; 0 where no "
        "order is declared",
        error="none: declared",
    ),
    "weight_mean": Variable(
        dims=("weighed",), units="1", long_name="mean of all possible weights of the criterion", error="below 1e-3"
    ),
    "rank_acceptability": Variable(
        dims=("candidate", "rank"),
        units="1",
        symbol="b_i^r",
        reference=_SMAA,
        long_name="fraction of the possible weights and errors that give a candidate this rank",
        error="rank_acceptability_error",
    ),
    "rank_acceptability_error": Variable(
        dims=("candidate", "rank"),
        units="1",
        long_name="standard error over independent scrambles, at least that of a single draw where anything is drawn",
        error="itself an estimate",
    ),
    "central_weight": Variable(
        dims=_BOTH,
        units="1",
        symbol="w_i^c",
        reference=_SMAA,
        long_name="mean of the weights that rank a candidate first; NaN for the reason in central_weight_reason",
        error="central_weight_error",
    ),
    "central_weight_error": Variable(
        dims=_BOTH,
        units="1",
        long_name="standard error over independent scrambles",
        error="itself an estimate",
    ),
    "central_weight_reason": Variable(
        dims=("candidate",), units="", long_name="why a candidate has no central weights; empty where it has them"
    ),
    "design_value": Variable(
        dims=_BOTH,
        units="mixed",
        long_name="weighed_value in a design of the sweep",
        error="as weighed_value_error",
    ),
    "feasible": Variable(
        dims=("candidate",),
        units="1",
        long_name="whether this candidate meets every 'must' requirement, including those that any camera may meet",
        error="exact",
    ),
    "on_pareto_front": Variable(
        dims=("candidate",),
        units="1",
        long_name="whether no candidate in a feasible design is at least as good in every criterion and better in one",
        error="exact for the given values",
    ),
}
