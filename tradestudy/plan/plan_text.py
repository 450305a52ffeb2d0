"""A plan as a person reads it in a terminal: every decision with its numbers, and what each step will take."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from tradestudy.accuracy import Accuracy, Quantity
from tradestudy.effects.base import NOTHING_LEFT_OUT, Bound
from tradestudy.effects.selection import Decision, Selection
from tradestudy.plan.predicted_time import PredictedStep
from tradestudy.plan.situations.situation import Situation
from tradestudy.results.effects import OF_NOISE_ALONE, TIMES_WITH_A_MODEL, WHERE_NUMBERS_ARE_TAKEN
from tradestudy.units import DURATION, FRACTION, pretty, significant
from tradestudy.wording import distance

Pieces = Sequence[tuple[Situation, Selection]]
_QUANTITIES: Final[Mapping[Quantity, str]] = {
    "depth_uncertainty": "depth uncertainty",
    "depth_of_field": "the ends of depth of field",
    "pixel_intensity": "pixel intensity (relative L2 over the pixels)",
    "psf_width": "the width of a point's image",
}
_TAKEN, _LEFT = "●", "○"


def plan_text(
    heading: str, accuracy: Accuracy, pieces: Pieces, steps: Sequence[PredictedStep], seconds: tuple[float, float]
) -> Iterator[str]:
    """The lines of a whole plan: what acts in every piece of a study, every step, and the seconds of all together."""
    yield heading
    for situation, chosen in pieces:
        wanted = ", ".join(
            f"{pretty(accuracy.relative[q], FRACTION)} of {_QUANTITIES[q]} wanted, "
            f"omissions change at most {_share(chosen.bounds[q])}"
            for q in situation.quantities
        )
        yield ""
        yield f"{situation.title} ({situation.name}): {wanted}; takes {_duration(chosen.seconds)}"
        if any(chosen.bounds[q] > accuracy.relative[q] * (1.0 + 1e-9) for q in situation.quantities):
            yield "  more than is wanted: models are forced, and the others were chosen as if these changed nothing"
        yield from _harmless(chosen.decisions)
        weighed = [decision for decision in chosen.decisions if not _is_harmless(decision)]
        width = max((len(_head(decision)) for decision in weighed), default=0)
        for decision in weighed:
            shown = not decision.chosen and decision.slot != "sampling"
            number = f" ({said})" if shown and (said := _number(decision)) else ""
            mark, head = _TAKEN if decision.chosen else _LEFT, f"{_head(decision):<{width}}"
            yield f"  {mark} {head}  {_duration(decision.seconds):>8}  {decision.why}{number}"
            if decision.chosen:
                yield f"    {'':<{width}}  {'':>8}  {_because(decision)}"
    yield from _explained(pieces)
    yield ""
    width = max(len(step.name) for step in steps)
    for step in steps:
        yield f"  {step.name:<{width}}  {_seconds(step.low, step.high):>16}  {step.work}"
    yield f"  {'in all':<{width}}  {_seconds(*seconds):>16}  predicted for this machine"


def _explained(pieces: Pieces) -> Iterator[str]:
    """What the columns are, the rules that refused what did not fit, and the formula of every number above."""
    decisions = [decision for _, chosen in pieces for decision in chosen.decisions]
    rules = {_head(one): bound.reason for one in decisions if not one.chosen and (bound := _told(one)) is not None}
    numbers = {bound.criterion.words: bound.criterion for one in decisions if (bound := _told(one)) is not None}
    if not numbers:
        return
    yield ""
    yield f"  Times above: {TIMES_WITH_A_MODEL}."
    if any("depth_uncertainty" in one.quantities for one, _ in pieces):
        yield f"  {OF_NOISE_ALONE}"
    if any(not math.isnan(criterion.at) for criterion in numbers.values()):
        yield f"  {WHERE_NUMBERS_ARE_TAKEN}"
    for heading, told in (
        ("The rules of models that do not act:", rules),
        ("The numbers:", {words: criterion.definition for words, criterion in numbers.items()}),
    ):
        if told:
            yield ""
            yield f"  {heading}"
            yield from (f"    {words}: {text}" for words, text in told.items())


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


def _told(decision: Decision) -> Bound | None:
    """The bound that weighs most, if its number says something."""
    bound = max(decision.model.bounds.values(), key=lambda one: one.relative_change)
    silent = math.isnan(bound.criterion.value) or bound.reason == NOTHING_LEFT_OUT
    return None if silent else bound


def _number(decision: Decision) -> str:
    bound = _told(decision)
    if bound is None:
        return ""
    found = f"{bound.criterion.words} {significant(bound.criterion.value)}"
    return found if math.isnan(bound.criterion.at) else f"{found} at {distance(bound.criterion.at)}"


def _head(decision: Decision) -> str:
    return f"{decision.slot.replace('_', ' ')}: {decision.model.name}"


def _because(decision: Decision) -> str:
    """The reason of the bound that weighs most, with its number."""
    bound = max(decision.model.bounds.values(), key=lambda one: one.relative_change)
    number = _number(decision)
    return f"{bound.reason} ({number})" if number else bound.reason


def _duration(seconds: float) -> str:
    return "—" if math.isinf(seconds) else pretty(seconds, DURATION, digits=2)


def _seconds(low: float, high: float) -> str:
    ends = dict.fromkeys(pretty(value, DURATION, digits=2) for value in (low, high))
    return " to ".join(ends)


def _share(value: float) -> str:
    return "without bound" if math.isinf(value) else pretty(value, FRACTION, digits=2)
