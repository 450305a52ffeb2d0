"""A plan as a person reads it in a terminal: every decision with its numbers, and what each step will take."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from tradestudy.effects.base import NOTHING_LEFT_OUT
from tradestudy.effects.selection import Decision
from tradestudy.units import DURATION, FRACTION, pretty, significant

if TYPE_CHECKING:
    from tradestudy.study.plan import Plan

_TAKEN, _LEFT = "●", "○"


def plan_text(plan: Plan) -> str:
    """The whole plan, ready to print."""
    return "\n".join(_lines(plan))


def _lines(plan: Plan) -> Iterator[str]:
    yield f"{plan.definition.file.study}: {plan.definition.file.title}"
    for situation in plan.situations:
        chosen = plan.selections[situation.name]
        wanted = ", ".join(
            f"{pretty(plan.accuracy.relative[q], FRACTION)} of {q.replace('_', ' ')} wanted, "
            f"omissions change at most {_share(chosen.bounds[q])}"
            for q in situation.quantities
        )
        yield ""
        yield f"{situation.title} ({situation.name}): {wanted}"
        if any(chosen.bounds[q] > plan.accuracy.relative[q] * (1.0 + 1e-9) for q in situation.quantities):
            yield "  more than is wanted: models are forced, and the others were chosen as if these changed nothing"
        yield from _harmless(chosen.decisions)
        weighed = [decision for decision in chosen.decisions if not _is_harmless(decision)]
        width = max((len(_head(decision)) for decision in weighed), default=0)
        for decision in weighed:
            shown = not decision.chosen and decision.slot != "sampling"
            number = f" ({said})" if shown and (said := _number(decision)) else ""
            yield f"  {_TAKEN if decision.chosen else _LEFT} {_head(decision):<{width}}  {decision.why}{number}"
            if decision.chosen:
                yield f"    {'':<{width}}  {_because(decision)}"
    yield ""
    width = max(len(step.name) for step in plan.steps)
    for step in plan.steps:
        yield f"  {step.name:<{width}}  {_seconds(step.low, step.high):>16}  {step.work}"
    yield f"  {'in all':<{width}}  {_seconds(*plan.seconds):>16}  predicted for this machine"


def _is_harmless(decision: Decision) -> bool:
    """Whether a model acts and changes nothing at all."""
    return (
        decision.chosen
        and not decision.forced
        and all(bound.relative_change == 0.0 for bound in decision.model.bounds.values())
    )


def _harmless(decisions: tuple[Decision, ...]) -> Iterator[str]:
    """Effects whose model changes nothing, together where they have one reason."""
    by_reason: dict[tuple[str, str], list[Decision]] = {}
    for decision in filter(_is_harmless, decisions):
        bound = next(iter(decision.model.bounds.values()))
        by_reason.setdefault((decision.model.name, bound.reason), []).append(decision)
    for (model, reason), members in by_reason.items():
        yield f"  {_TAKEN} {', '.join(one.slot.replace('_', ' ') for one in members)}: {model}"
        yield f"      {reason if reason == NOTHING_LEFT_OUT else f'changes nothing: {reason}'}"
        if numbers := [text for one in members if (text := _number(one))]:
            yield f"      {'; '.join(numbers)}"


def _number(decision: Decision) -> str:
    bound = max(decision.model.bounds.values(), key=lambda one: one.relative_change)
    return (
        ""
        if math.isnan(bound.number) or bound.reason == NOTHING_LEFT_OUT
        else f"{bound.criterion} {significant(bound.number)}"
    )


def _head(decision: Decision) -> str:
    return f"{decision.slot.replace('_', ' ')}: {decision.model.name}"


def _because(decision: Decision) -> str:
    """The reason of the bound that weighs most, with its number."""
    bound = max(decision.model.bounds.values(), key=lambda one: one.relative_change)
    number = _number(decision)
    return f"{bound.reason} ({number})" if number else bound.reason


def _seconds(low: float, high: float) -> str:
    ends = dict.fromkeys(pretty(value, DURATION, digits=2) for value in (low, high))
    return " to ".join(ends)


def _share(value: float) -> str:
    return "without bound" if math.isinf(value) else pretty(value, FRACTION, digits=2)
