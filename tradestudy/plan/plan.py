"""What a study will simulate, what it leaves out and why, and how long it will take; computes nothing else."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from tradestudy.accuracy import Accuracy
from tradestudy.effects.base import SlotName
from tradestudy.effects.selection import Selection
from tradestudy.errors import UnaffordableError
from tradestudy.machine import machine_speed
from tradestudy.plan.affordable import tightest_offer
from tradestudy.plan.choice import choose
from tradestudy.plan.plan_text import plan_text
from tradestudy.plan.predicted_time import PredictedStep, predicted_seconds
from tradestudy.plan.situations.situation import Situation
from tradestudy.study.definition import StudyDefinition
from tradestudy.wording import counted


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
        file = self.definition.file
        pieces = [(one, self.selections[one.name]) for one in self.situations]
        return "\n".join(plan_text(f"{file.study}: {file.title}", self.accuracy, pieces, self.steps, self.seconds))


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
    speed = machine_speed()
    situations, selections = choose(definition)
    acting = definition.with_models(_models(selections))
    plan = Plan(
        definition=acting,
        accuracy=accuracy,
        situations=situations,
        selections=selections,
        steps=_steps(acting, selections, speed),
    )
    if plan.seconds[0] > accuracy.budget:
        raise _too_long(definition, situations, speed, plan)
    return plan


def _steps(acting: StudyDefinition, selections: Mapping[str, Selection], speed: float) -> tuple[PredictedStep, ...]:
    return *predicted_seconds(acting, speed), *_pictures(acting, selections, speed)


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
    definition: StudyDefinition, situations: tuple[Situation, ...], speed: float, plan: Plan
) -> UnaffordableError:
    """The error that names the shortfall and the tightest tolerance whose run fits the budget."""
    budget = plan.accuracy.budget

    def seconds(asked: StudyDefinition, selections: Mapping[str, Selection]) -> float:
        return math.fsum(step.low for step in _steps(asked.with_models(_models(selections)), selections, speed))

    offer = tightest_offer(definition, situations, seconds)
    if offer is None:
        remedy = "raise the budget or ask for less"
    elif offer.seconds > budget:
        remedy = (
            f"with no looser --tolerance it takes less than with '{offer.tolerance}', "
            f"{_against(offer.seconds, budget)} s; raise the budget or ask for less"
        )
    else:
        remedy = (
            f"{offer.tolerance} can be had in {_against(offer.seconds, budget)} s; ask for that with "
            f"--tolerance '{offer.tolerance}', or raise the budget"
        )
    return UnaffordableError(
        "the accuracy wanted takes longer than the budget",
        value=f"{_against(plan.seconds[0], budget)} s",
        limit=f"{budget:g} s",
        remedy=remedy,
    )


def _against(seconds: float, budget: float) -> str:
    """Three digits, or as many as keep it on its side of the budget."""
    rounded = (float(f"{seconds:.{digits}g}") for digits in range(3, 18))
    return f"{next(one for one in rounded if (one > budget) == (seconds > budget)):.15g}"
