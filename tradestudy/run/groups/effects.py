"""/effects: every decision of the plan, with its numbers."""

from __future__ import annotations

import math

import xarray as xr

from tradestudy.accuracy import QUANTITIES
from tradestudy.effects import Change, Changes
from tradestudy.plan.plan import Plan
from tradestudy.plan.plan_text import summary
from tradestudy.results import dataset

_NONE = Change(relative=math.nan, evidence="computed")


def effects_group(plan: Plan) -> xr.Dataset:
    """/effects over decisions, and over the problems of the study that they belong to."""
    decisions = [(one, decision) for one in plan.problems for decision in one.choice.decisions]
    changes = [_row(decision.changes) for _, decision in decisions]
    together = [_row(one.choice.changes) for one in plan.problems]
    return dataset(
        "effects",
        {
            "problem_of": [one.name for one, _ in decisions],
            "slot": [decision.slot for _, decision in decisions],
            "model": [decision.model for _, decision in decisions],
            "chosen": [float(decision.chosen) for _, decision in decisions],
            "forced": [float(decision.forced) for _, decision in decisions],
            "reason": [one.reasons.get(decision.slot, "") for one, decision in decisions],
            "change": [[one.relative for one in row] for row in changes],
            "evidence": [[_evidence(one) for one in row] for row in changes],
            "change_at": [[one.at for one in row] for row in changes],
            "joint_change": [[one.relative for one in row] for row in together],
            "joint_evidence": [[_evidence(one) for one in row] for row in together],
            "forced_change": [[one.relative for one in _row(problem.by_forcing)] for problem in plan.problems],
            "tolerance": [[one.asked.get(q, math.nan) for q in QUANTITIES] for one in plan.problems],
            "problem_title": [one.title for one in plan.problems],
            "summary": [summary(one) for one in plan.problems],
        },
        {
            "decision": [f"{one.name}: {decision.slot}: {decision.model}" for one, decision in decisions],
            "quantity": list(QUANTITIES),
            "problem": [one.name for one in plan.problems],
        },
    )


def _row(changes: Changes) -> list[Change]:
    return [changes.get(q, _NONE) for q in QUANTITIES]


def _evidence(change: Change) -> str:
    return "" if math.isnan(change.relative) else change.evidence
