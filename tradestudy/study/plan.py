"""What a study will simulate, what it leaves out and why, and how long it will take; computes nothing else."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from tradestudy.accuracy import Accuracy
from tradestudy.effects.base import SlotName
from tradestudy.effects.selection import Selection, offered
from tradestudy.errors import UnaffordableError
from tradestudy.machine import machine_speed
from tradestudy.study.choice import choose
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.plan_text import plan_text
from tradestudy.study.predicted_time import PredictedStep, predicted_seconds
from tradestudy.study.situations.situation import Situation
from tradestudy.wording import counted

_ROUNDS = 40


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The decisions of a study.

    Parameters
    ----------
    definition
        The study, with the chosen models acting in it.
    accuracy
        What was asked for.
    situations
        Every piece of the study that effects are chosen for.
    selections
        What was chosen, by the name of the piece.
    steps
        What every step of the run will take on this machine.
    """

    definition: StudyDefinition
    accuracy: Accuracy
    situations: tuple[Situation, ...]
    selections: Mapping[str, Selection]
    steps: tuple[PredictedStep, ...]

    @property
    def seconds(self) -> tuple[float, float]:
        """Least and most that the whole run will take [s]; they differ where samplers stop by themselves."""
        return math.fsum(step.low for step in self.steps), math.fsum(step.high for step in self.steps)

    def __str__(self) -> str:
        return plan_text(self)


def _models(selections: Mapping[str, Selection]) -> Mapping[str, Mapping[SlotName, str]]:
    return {
        name: {slot: model.name for slot, model in selection.chosen.items()} for name, selection in selections.items()
    }


def plan_of(definition: StudyDefinition) -> Plan:
    """Choose the models of every piece of a study and predict what the run takes.

    Raises
    ------
    UnaffordableError
        Where nothing is accurate enough, or the run would take longer than the study's budget; with the nearest
        accuracy that can be had.
    StudyError
        Where the study forces a model that no piece of it has.
    """
    accuracy = definition.file.accuracy.wanted()
    forced = definition.file.effects.forced()
    speed = machine_speed()
    situations, selections = choose(definition)
    acting = definition.with_models(_models(selections))
    plan = Plan(
        definition=acting,
        accuracy=accuracy,
        situations=situations,
        selections=selections,
        steps=(*predicted_seconds(acting, speed), *_pictures(acting, selections, speed)),
    )
    if plan.seconds[0] > accuracy.budget:
        raise _too_long(definition, situations, forced, speed, plan)
    return plan


def _pictures(
    definition: StudyDefinition, selections: Mapping[str, Selection], speed: float
) -> tuple[PredictedStep, ...]:
    """What deriving disparity errors from pictures adds to the depth of cameras."""
    derived = [
        name
        for name, camera in definition.case.cameras.items()
        if not isinstance(camera.disparity_error_px, float | int)
    ]
    seconds = math.fsum(selections[name].seconds for name in derived) / speed
    work = f"{counted(len(derived), 'camera')} whose disparity error is derived"
    return (PredictedStep(name="pictures", low=seconds, high=seconds, work=work),) if derived else ()


def _too_long(
    definition: StudyDefinition,
    situations: tuple[Situation, ...],
    forced: dict[SlotName, str],
    speed: float,
    plan: Plan,
) -> UnaffordableError:
    """The error that names the shortfall and the nearest accuracy whose run fits the budget."""
    budget = plan.accuracy.budget

    def seconds(factor: float) -> float:
        looser = Accuracy(relative={name: value * factor for name, value in plan.accuracy.relative.items()})
        chosen = {one.name: one.select(looser, forced) for one in situations}
        acting = definition.with_models(_models(chosen))
        return math.fsum(step.low for step in (*predicted_seconds(acting, speed), *_pictures(acting, chosen, speed)))

    most = math.log(1.0 / max(plan.accuracy.relative.values()))  # nothing is asked for beyond the whole
    loosest = seconds(math.exp(most))
    if loosest > budget:
        remedy = f"even to 100 % it takes {loosest:.3g} s; raise the budget or ask for less"
    else:
        low, high = 0.0, most
        for _ in range(_ROUNDS):
            middle = (low + high) / 2.0
            low, high = (low, middle) if seconds(math.exp(middle)) <= budget else (middle, high)
        offer = offered(plan.accuracy, math.exp(high))
        remedy = f"{offer} can be had in {seconds(math.exp(high)):.3g} s; ask for that, or raise the budget"
    return UnaffordableError(
        "the accuracy wanted takes longer than the budget",
        value=f"{plan.seconds[0]:.3g} s",
        limit=f"{budget:g} s",
        remedy=remedy,
    )
