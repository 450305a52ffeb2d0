"""/effects: every decision of the plan, with its numbers."""

from __future__ import annotations

import math

import xarray as xr

from tradestudy.accuracy import QUANTITIES
from tradestudy.plan.plan import Plan
from tradestudy.results import dataset


def effects_group(plan: Plan) -> xr.Dataset:
    """/effects over decisions, and over the pieces of the study that they belong to."""
    decisions = [(one, decision) for one in plan.situations for decision in plan.selections[one.name].decisions]
    worst = [max(decision.model.bounds.values(), key=lambda b: b.relative_change) for _, decision in decisions]
    return dataset(
        "effects",
        {
            "situation": [one.name for one, _ in decisions],
            "slot": [decision.slot for _, decision in decisions],
            "model": [decision.model.name for _, decision in decisions],
            "chosen": [float(decision.chosen) for _, decision in decisions],
            "forced": [float(decision.forced) for _, decision in decisions],
            "bound": [
                [decision.model.change_of(q) if q in one.quantities else math.nan for q in QUANTITIES]
                for one, decision in decisions
            ],
            "criterion": [bound.criterion.words for bound in worst],
            "definition": [bound.criterion.definition for bound in worst],
            "number": [bound.criterion.value for bound in worst],
            "number_at": [bound.criterion.at for bound in worst],
            "reason": [bound.reason for bound in worst],
            "why": [decision.why for _, decision in decisions],
            "predicted_seconds": [decision.seconds for _, decision in decisions],
            "joint_bound": [
                [plan.selections[one.name].bounds.get(q, math.nan) for q in QUANTITIES] for one in plan.situations
            ],
            "wanted": [
                [plan.accuracy.relative[q] if q in one.quantities else math.nan for q in QUANTITIES]
                for one in plan.situations
            ],
            "piece_title": [one.title for one in plan.situations],
            "piece_seconds": [plan.selections[one.name].seconds for one in plan.situations],
        },
        {
            "decision": [f"{one.name}: {decision.slot}: {decision.model.name}" for one, decision in decisions],
            "quantity": list(QUANTITIES),
            "piece": [one.name for one in plan.situations],
        },
    )
