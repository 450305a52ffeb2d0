"""Slots of a picture that reaches no result: everything that happens in it is left out."""

from __future__ import annotations

from collections.abc import Mapping

from tradestudy.effects.base import OFF, Bound, EffectCriterion, Model, Slot, SlotName


def declared_reason(disparity_error_px: float) -> str:
    """Why the picture does not matter where the disparity error [px] is declared."""
    return (
        f"the disparity error is declared, {disparity_error_px:g} px, and stands for the whole picture; "
        "what blurs, mixes or dims the picture reaches depth only if it is derived"
    )


def unused_slots(*, reason: str, numbers: Mapping[SlotName, EffectCriterion]) -> tuple[Slot, ...]:
    """Slots that can only be off, each with the number that tells how strong the effect would be in a picture.

    Parameters
    ----------
    reason
        Why nothing of it matters.
    numbers
        The slots; for each, the number that tells a reader how strong the effect is.
    """
    found = []
    for name, criterion in numbers.items():
        bound = Bound(relative_change=0.0, criterion=criterion, reason=reason)
        found.append(Slot(name=name, models=(Model(name=OFF, bounds={"depth_uncertainty": bound}),)))
    return tuple(found)
