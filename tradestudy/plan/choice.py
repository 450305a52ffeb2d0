"""The models of every piece of a study: weighed, chosen, or refused; nothing is simulated for it."""

from __future__ import annotations

from collections.abc import Mapping

from tradestudy.accuracy import Accuracy
from tradestudy.effects.base import SlotName
from tradestudy.effects.selection import Selection
from tradestudy.errors import StudyError, UnaffordableError
from tradestudy.plan.situations.every import every_situation
from tradestudy.plan.situations.situation import Situation
from tradestudy.study.definition import StudyDefinition


def choose(definition: StudyDefinition) -> tuple[tuple[Situation, ...], Mapping[str, Selection]]:
    """Weigh the models of every piece of a study, and choose the cheapest that are accurate enough, by its name.

    Raises
    ------
    UnaffordableError
        Where nothing is accurate enough; with the nearest accuracy that can be had.
    StudyError
        Where the study forces a model that no piece of it has.
    """
    forced = definition.file.effects.forced()
    situations = tuple(every_situation(definition, forced))
    _check_forced(definition, situations, forced)
    timeless = Accuracy(relative=definition.file.accuracy.wanted().relative)
    return situations, _selections(situations, timeless, forced)


def _selections(
    situations: tuple[Situation, ...], accuracy: Accuracy, forced: dict[SlotName, str]
) -> Mapping[str, Selection]:
    """Of every piece, or one refusal of all that cannot be had, so that an offer of one is not refused by the next."""
    found: dict[str, Selection] = {}
    refused: list[UnaffordableError] = []
    for one in situations:
        try:
            found[one.name] = one.select(accuracy, forced)
        except UnaffordableError as error:
            refused.append(error)
    if len(refused) > 1:
        raise UnaffordableError("\n".join(map(str, refused)))
    if refused:
        raise refused[0]
    return found


def _check_forced(
    definition: StudyDefinition, situations: tuple[Situation, ...], forced: Mapping[SlotName, str]
) -> None:
    """Refuse a forced model that nothing in the study has: it would be ignored."""
    problems = []
    for slot, name in forced.items():
        offered = [model for one in situations for own in one.slots if own.name == slot for model in own.model_names]
        if name not in offered:
            known = ", ".join(dict.fromkeys(offered)) or "nothing"
            what = f"'{name}' acts nowhere in this study, which offers {known} in this slot"
            if offered == ["off"] * len(offered) and offered:
                what += "; what happens in a picture reaches depth only where disparity_error is derived"
            problems.append(definition.document.locate(("effects", slot)).problem(("effects", slot), what))
    if problems:
        raise StudyError(problems)
