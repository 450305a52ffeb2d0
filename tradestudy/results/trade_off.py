"""/criteria: weighted criteria, ranks over all possible weights, and Pareto-optimal designs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import DECLARED, ESTIMATE, EXACT, Variable

_BOTH: Final = ("candidate", "weighed")
_SMAA: Final = "Lahdelma and Salminen, Oper. Res. 49, 444 (2001)"

TRADE_OFF: Final[Mapping[str, Variable]] = {
    "weighed_value": Variable(
        dims=_BOTH,
        units="mixed",
        long_name="value of the weighted criterion for a candidate, in the unit given by weighed_units; NaN where the "
        "candidate has none, for example because it is not usable",
        error="see weighed_value_error",
    ),
    "weighed_value_error": Variable(
        dims=_BOTH, units="mixed", long_name="standard error of weighed_value, in the same unit", error=ESTIMATE
    ),
    "weighed_units": Variable(
        dims=("weighed",), units="", long_name="unit of weighed_value, 'worst' and 'best'; '1' for plain numbers"
    ),
    "weighed_says": Variable(dims=("weighed",), units="", long_name="meaning of the weighted criterion"),
    "worst": Variable(
        dims=("weighed",),
        units="mixed",
        long_name="value that scores 0, in the unit given by weighed_units",
        error=DECLARED,
    ),
    "best": Variable(
        dims=("weighed",),
        units="mixed",
        long_name="value that scores 1, in the unit given by weighed_units",
        error=DECLARED,
    ),
    "worth": Variable(
        dims=_BOTH,
        units="1",
        long_name="score of weighed_value: rises linearly from 0 at 'worst' to 1 at 'best' and is constant beyond; 0 "
        "where weighed_value is NaN",
        error="that of weighed_value, divided by the difference between 'best' and 'worst'",
    ),
    "clipped": Variable(
        dims=_BOTH,
        units="1",
        long_name="whether weighed_value lies outside the range from 'worst' to 'best'",
        error=EXACT,
    ),
    "weight_low": Variable(
        dims=("weighed",),
        units="1",
        long_name="smallest possible weight, as a fraction of the sum of all weights",
        error=DECLARED,
    ),
    "weight_high": Variable(
        dims=("weighed",),
        units="1",
        long_name="largest possible weight, as a fraction of the sum of all weights",
        error=DECLARED,
    ),
    "weight_order": Variable(
        dims=("weighed",),
        units="1",
        long_name="position of the criterion in trade_off.order, from 1, the most important; 0 where no order is "
        "declared",
        error=DECLARED,
    ),
    "weight_mean": Variable(
        dims=("weighed",),
        units="1",
        long_name="mean weight of the criterion over all possible weights, as a fraction of the sum of all weights",
        error="below 1e-3",
    ),
    "rank_acceptability": Variable(
        dims=("candidate", "rank"),
        units="1",
        symbol="b_i^r",
        reference=_SMAA,
        long_name="fraction of the draws (of possible weights, and of errors of the criteria) in which the candidate "
        "has this rank",
        error="see rank_acceptability_error",
    ),
    "rank_acceptability_error": Variable(
        dims=("candidate", "rank"),
        units="1",
        long_name="standard error of rank_acceptability over scrambles, at least 1/n for n draws; 0 "
        "where nothing is drawn",
        error=ESTIMATE,
    ),
    "central_weight": Variable(
        dims=_BOTH,
        units="1",
        symbol="w_i^c",
        reference=_SMAA,
        long_name="mean weight of a criterion over the draws in which the candidate ranks first; where it is NaN, "
        "central_weight_reason says why",
        error="see central_weight_error",
    ),
    "central_weight_error": Variable(
        dims=_BOTH,
        units="1",
        long_name="standard error of central_weight over scrambles; NaN where central_weight is NaN",
        error=ESTIMATE,
    ),
    "central_weight_reason": Variable(
        dims=("candidate",), units="", long_name="why central_weight is NaN; empty where it is not"
    ),
    "design_value": Variable(
        dims=_BOTH,
        units="mixed",
        long_name="weighed_value in each design of a sweep; NaN where the candidate has none",
        error="similar to weighed_value_error",
    ),
    "feasible": Variable(
        dims=("candidate",),
        units="1",
        long_name="whether every requirement of priority 'must' is met; a requirement with 'camera: any' counts as met "
        "only if this candidate itself meets it",
        error=EXACT,
    ),
    "on_pareto_front": Variable(
        dims=("candidate",),
        units="1",
        long_name="whether the candidate is feasible and Pareto-optimal: no feasible candidate of any design is at "
        "least as good in every weighted criterion and better in at least one",
        error="none: exact for the stored values",
    ),
}
