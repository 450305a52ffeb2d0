"""A plan as text for the terminal: one line per problem, or every decision with its numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from tradestudy.accuracy import IN_WORDS, Quantity
from tradestudy.effects import LENSES, MODEL, NAMED, OFF, Change, Evidence, left_out
from tradestudy.models.choice import Chosen
from tradestudy.models.slow_steps import Work, magnitude
from tradestudy.units import FRACTION, pretty
from tradestudy.wording import distance, fewest_digits, listed

_SIGNIFICANT: Final = 0.01  # share of the tolerance


def plan_lines(
    problems: Sequence[Chosen], settled: Mapping[str, str], work: Sequence[Work], space: str, *, verbose: bool
) -> Iterator[str]:
    """One line per problem, with all decisions if verbose, and one for the run, with all steps if verbose.

    `settled` states, by name, how questions that leave no choice of models are answered; `space` ends the line for the
    run.
    """
    width = max(map(len, [*(one.name for one in problems), *settled, "run"]))
    for one in problems:
        own = [part.seconds for part in work if part.problem == one.name]
        takes = f"; {magnitude(math.fsum(own))}" if own else ""
        yield f"{one.name:<{width}}  {summary(one)}{takes}"
        if verbose:
            yield from (f"{'':<{width}}    {line}" for line in _decisions(one))
    yield from (f"{name:<{width}}  {how}" for name, how in settled.items())
    yield f"{'run':<{width}}  {_slow(work)}{space}"
    if verbose:
        steps = max(len(part.step) for part in work)
        for part in work:
            name = f"{part.problem}, " if part.problem else ""
            yield f"{'':<{width}}    {part.step:<{steps}}  {magnitude(part.seconds):>7}  {name}{part.amount}"


def _slow(work: Sequence[Work]) -> str:
    """The magnitude of the run, and the step that takes most of it, with the amount of its slowest part."""
    total = math.fsum(part.seconds for part in work)
    seconds: dict[str, float] = {}
    for part in work:
        seconds[part.step] = seconds.get(part.step, 0.0) + part.seconds
    step = max(seconds, key=lambda one: seconds[one])
    slowest = max((part for part in work if part.step == step), key=lambda part: part.seconds)
    of = f" for {slowest.problem}" if slowest.problem else ""
    return f"{magnitude(total)}, mostly {step} ({slowest.amount}{of})"


def summary(one: Chosen) -> str:
    """What is simulated, and the largest omission with its change and the tolerance."""
    return "; ".join(filter(None, (_simulated(one), _left_out(one), _forced(one))))


def _simulated(one: Chosen) -> str:
    """The applied models in words: those of diffraction, calibration and sampling that the problem has."""
    models = one.models
    parts = [MODEL[slot, models[slot]] for slot in LENSES if models.get(slot, OFF) != OFF]
    pictured = "microlens_diffraction" in models and one.reasons.get("defocus_blur", "") in ("", NAMED)
    if not parts:
        parts = ["no diffraction"] if pictured else []
    if one.reasons.get("calibration") and models["calibration"] == OFF and "calibration" not in one.choice.forced:
        parts.append(one.reasons["calibration"])
    elif "calibration" in models:
        drawn = listed([f"“{name}”" for name in one.choice.other_models])
        model = models["calibration"]
        named = "without calibration errors" if model == OFF else MODEL["calibration", model]
        parts.append(named + f" (exact for {drawn})" * bool(drawn))
    if "sampling" in models:
        parts.append(f"sampled to {models['sampling']}")
    if not pictured and "calibration" in models:
        why = one.reasons.get("defocus_blur", "")
        parts.insert(0, f"geometry only ({why})" if why else "geometry only")
        return "; ".join(parts)
    return ", ".join(parts) or "geometry only"


def _left_out(one: Chosen) -> str:
    """The omission with the largest change, and the change due to all omissions with its tolerance."""
    omitted = [
        (change.relative / one.asked[quantity], quantity, change, decision)
        for decision in one.choice.decisions
        if decision.chosen and not decision.forced
        for quantity, change in decision.changes.items()
        if quantity in one.asked and change.relative > 0.0
    ]
    if not omitted:
        return _without_effect(one) or "nothing left out" + _first_refused(one)
    _, quantity, _, decision = max(omitted, key=lambda found: found[0])
    change = one.choice.changes[quantity]  # due to all omissions; can be less than that due to one of them
    significant = {id(found[3]) for found in omitted if found[0] >= _SIGNIFICANT}
    suffix = " and smaller effects together" if len(significant) > 1 else ""
    return (
        f"leaving out {left_out(decision.slot, decision.model)}{suffix} changes the {IN_WORDS[quantity]} by "
        f"{_amount(change, one.asked[quantity])} {_allowance(quantity, change, one)}"
    )


def _without_effect(one: Chosen) -> str:
    """The omissions that change no answer; empty if nothing is left out."""
    complete = one.choice.problem.complete
    omissions = [
        left_out(decision.slot, decision.model)
        for decision in one.choice.decisions
        if decision.chosen and not decision.forced and decision.model != complete[decision.slot]
    ]
    return f"leaving out {listed(omissions)} changes nothing" if omissions else ""


def _first_refused(one: Chosen) -> str:
    """The omission that comes closest to its tolerance without meeting it, which explains why nothing is left out."""
    refused = [
        (max(change.relative / one.asked[quantity] for quantity, change in asked.items()), decision, asked)
        for decision in one.choice.decisions
        if not decision.chosen and decision.slot not in one.choice.forced and not one.reasons.get(decision.slot)
        if (asked := {quantity: change for quantity, change in decision.changes.items() if quantity in one.asked})
    ]
    refused = [found for found in refused if found[0] > 1.0]
    if not refused:
        return ""
    _, decision, asked = min(reversed(refused), key=lambda found: found[0])  # of equals, the most complete model
    quantity, change = max(asked.items(), key=lambda item: item[1].relative / one.asked[item[0]])
    omission = left_out(decision.slot, decision.model)
    if math.isinf(change.relative):
        allowed = pretty(one.asked[quantity], FRACTION)
        return (
            f", because it is unknown by how much leaving out {omission} would change the {IN_WORDS[quantity]} "
            f"({allowed} allowed)"
        )
    return (
        f", because leaving out {omission} would change the {IN_WORDS[quantity]} by "
        f"{_amount(change, one.asked[quantity])} {_allowance(quantity, change, one)}"
    )


def _allowance(quantity: Quantity, change: Change, one: Chosen) -> str:
    """The evidence of a change, if it is a trial, and the tolerance, in brackets."""
    how = f"{_tried(quantity)}; " if change.evidence == "trial" else ""
    return f"({how}{pretty(one.asked[quantity], FRACTION)} allowed)"


def _forced(one: Chosen) -> str:
    if not one.by_forcing:
        return ""
    quantity, change = max(
        ((q, c) for q, c in one.by_forcing.items() if q in one.asked), key=lambda found: found[1].relative
    )
    if change.relative == 0.0:
        return ""
    named = ", ".join(
        f"{slot.replace('_', ' ')}: {model}" for slot, model in one.choice.forced.items() if slot in one.models
    )
    more, share = "more than" if change.relative > one.asked[quantity] else "within", _share(quantity, change, one)
    return (
        f"{named}, as the study requires, changes the {IN_WORDS[quantity]} by {share}, {more} the "
        f"{pretty(one.asked[quantity], FRACTION)} allowed"
    )


def _decisions(one: Chosen) -> Iterator[str]:
    """Every model of every effect with its change, or the reason why the effect has only one model."""
    for quantity in dict.fromkeys([*one.asked, *one.choice.changes]):
        share = _share(quantity, one.choice.changes[quantity], one)
        limit = f"{pretty(one.asked[quantity], FRACTION)} allowed" if quantity in one.asked else "no tolerance applies"
        yield f"all omissions together change the {IN_WORDS[quantity]} by {share}; {limit}"
    stated: set[str] = set()
    yield "● used, ○ not used; each change is relative to the most complete model of the effect"
    for decision in one.choice.decisions:
        mark, name = "●" if decision.chosen else "○", f"{decision.slot.replace('_', ' ')}: {decision.model}"
        if reason := one.reasons.get(decision.slot):
            once = "" if reason in stated else f"  {reason}"
            stated.add(reason)
            yield f"{mark} {name}{once}"
            continue
        asked = ((quantity, change) for quantity, change in decision.changes.items() if quantity in one.asked)
        changed = ", ".join(f"the {IN_WORDS[of]} by {_share(of, change, one)}" for of, change in asked)
        yield f"{mark} {name}" + f"  changes {changed}" * bool(changed)


def _share(quantity: Quantity, change: Change, one: Chosen) -> str:
    """A change and its evidence: "0.22 %", "up to about 1.3 %", "about 0.02 % (trial at a few distances)"."""
    if math.isinf(change.relative) or change.relative == 0.0:
        return _amount(change)
    amount = _amount(change, one.asked.get(quantity, math.nan))
    at = "" if math.isnan(change.at) else f" at {distance(change.at)}"
    return f"{amount}{at}{f' ({_tried(quantity)})' if change.evidence == 'trial' else ''}"


def _tried(quantity: Quantity) -> str:
    return f"trial at a few {'places' if quantity == 'pixel_intensity' else 'distances'}"


def _amount(change: Change, tolerance: float = math.nan) -> str:
    """The size of a change, with enough digits to tell it from its tolerance."""
    if math.isinf(change.relative):
        return "an unknown amount"
    if change.relative == 0.0:
        return "0 %"
    known: dict[Evidence, str] = {"computed": "", "rule": "up to about ", "trial": "about "}
    size, allowed = pretty(change.relative, FRACTION, digits=2), pretty(tolerance, FRACTION)
    if size == allowed:
        digits = fewest_digits(lambda digits: pretty(change.relative, FRACTION, digits=digits) != allowed)
        size = pretty(change.relative, FRACTION, digits=digits)
    return f"{known[change.evidence]}{size}"
