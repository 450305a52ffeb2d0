"""What a study will simulate, what it leaves out and why, and how long it will take."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tradestudy.accuracy import Accuracy
from tradestudy.analysis.trade_off import refuse_words
from tradestudy.effects.models import Models
from tradestudy.errors import UnaffordableError
from tradestudy.plan.choice import Chosen, choose_models
from tradestudy.plan.plan_text import plan_lines
from tradestudy.plan.predicted_time import PredictedStep, Stopwatch, predicted_steps
from tradestudy.study.definition import StudyDefinition
from tradestudy.units import DURATION, pretty


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The decisions of a study.

    Parameters
    ----------
    definition
        The study, with the chosen models acting in it.
    accuracy
        What it asks for.
    pieces
        Every piece of it with its models.
    steps
        What every step of the run will take on this machine.
    """

    definition: StudyDefinition
    accuracy: Accuracy
    pieces: tuple[Chosen, ...]
    steps: tuple[PredictedStep, ...]

    @property
    def seconds(self) -> float:
        """What the whole run will take [s]."""
        return math.fsum(step.seconds for step in self.steps)

    def models(self, piece: str) -> Models:
        """The models that act in a piece, by effect."""
        return next(one.models for one in self.pieces if one.name == piece)

    def text(self, *, verbose: bool = False) -> str:
        """The plan as a person reads it: a line for each piece and one for the run; every decision if verbose."""
        return "\n".join(plan_lines(self.pieces, self.steps, verbose=verbose))

    def __repr__(self) -> str:
        return self.text()


def plan_of(definition: StudyDefinition) -> Plan:
    """Choose the models of every piece of a study and predict what the run takes.

    Raises
    ------
    UnaffordableError
        Where not even the most complete models keep the tolerance, or the run would exceed the study's time limit.
    StudyError
        Where the study names a model that no piece of it has, or weighs a criterion that is no number.
    """
    refuse_words(definition)
    watch = Stopwatch()
    accuracy = definition.file.accuracy.asked()
    pieces = choose_models(definition)
    elsewhere: dict[str, dict[str, Models]] = {}
    for one in pieces:
        for reading, models in one.choice.elsewhere.items():
            elsewhere.setdefault(reading, {})[one.name] = models
    acting = definition.with_models({one.name: one.models for one in pieces}, elsewhere)
    plan = Plan(definition=acting, accuracy=accuracy, pieces=pieces, steps=predicted_steps(acting, watch))
    if plan.seconds > accuracy.time_limit:
        raise UnaffordableError(
            "the run is predicted to exceed its time limit",
            value=pretty(plan.seconds, DURATION, digits=2),
            limit=pretty(accuracy.time_limit, DURATION),
            remedy="raise accuracy.time_limit, loosen the tolerance, or ask for less",
        )
    return plan
