"""Plan a study: what a run simulates, what it leaves out and why, and the predicted time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from tradestudy.accuracy import Accuracy
from tradestudy.analysis.trade_off import refuse_words
from tradestudy.effects.models import Models
from tradestudy.errors import UnaffordableError
from tradestudy.plan.choice import Chosen, choose_models
from tradestudy.plan.plan_text import plan_lines
from tradestudy.plan.predicted_time import PredictedStep, Stopwatch, predicted_steps
from tradestudy.study.definition import StudyDefinition
from tradestudy.units import DURATION, FRACTION, pretty


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The decisions of a study.

    Parameters
    ----------
    definition
        The study, with the chosen models applied.
    accuracy
        Its tolerances and time limit.
    problems
        Every problem of the study with its models.
    steps
        Every step of the run, with its predicted time on this machine.
    """

    definition: StudyDefinition
    accuracy: Accuracy
    problems: tuple[Chosen, ...]
    steps: tuple[PredictedStep, ...]

    @property
    def seconds(self) -> float:
        """Predicted time of the whole run [s]."""
        return math.fsum(step.seconds for step in self.steps)

    def models(self, problem: str) -> Models:
        """The models applied to a problem, by effect."""
        return next(one.models for one in self.problems if one.name == problem)

    def parts(self, step: str) -> tuple[float, ...]:
        """Predicted seconds of the parts of a step, in the order of computation; empty if they are equally long."""
        return next((one.parts for one in self.steps if one.name == step), ())

    def seconds_by_problem(self, step: str) -> Mapping[str, float]:
        """Predicted seconds of a step for each of its problems."""
        return next(one.problems for one in self.steps if one.name == step)

    def text(self, *, verbose: bool = False) -> str:
        """The plan as text: one line per problem and one for the run; with every decision if verbose."""
        return "\n".join(plan_lines(self.problems, dict(_settled(self.definition)), self.steps, verbose=verbose))

    def __repr__(self) -> str:
        return self.text()


def _settled(definition: StudyDefinition) -> Iterator[tuple[str, str]]:
    """Questions that compare given models, which leaves no choice: their names, and how they are answered."""
    file = definition.file
    if (fresnel := file.fresnel_validity) is not None:
        error = pretty(fresnel.tolerance, FRACTION, digits=2)
        yield (
            "fresnel-validity",
            f"Fresnel and Kirchhoff diffraction, because the study compares them; both to {error} of the intensity, "
            "nothing left out",
        )
    if file.hard_cases is not None:
        yield (
            "hard-cases",
            "textbook formulas and the program's, each against a reference, because the study compares them",
        )


def plan_of(definition: StudyDefinition) -> Plan:
    """Choose the models of every problem of a study and predict the time of the run.

    Raises
    ------
    UnaffordableError
        If even the most complete models exceed a tolerance, or the predicted time exceeds the study's time limit.
    StudyError
        If the study forces a model that none of its problems has, or weighs a criterion that is not a number.
    """
    refuse_words(definition)
    watch = Stopwatch()
    accuracy = definition.file.accuracy.asked()
    problems = choose_models(definition)
    other_models: dict[str, dict[str, Models]] = {}
    for one in problems:
        for reading, models in one.choice.other_models.items():
            other_models.setdefault(reading, {})[one.name] = models
    applied = definition.with_models({one.name: one.models for one in problems}, other_models)
    plan = Plan(definition=applied, accuracy=accuracy, problems=problems, steps=predicted_steps(applied, watch))
    if plan.seconds > accuracy.time_limit:
        raise UnaffordableError(
            "the run is predicted to exceed its time limit",
            value=pretty(plan.seconds, DURATION, digits=2),
            limit=pretty(accuracy.time_limit, DURATION),
            remedy="raise accuracy.time_limit, loosen the tolerance, or ask for less",
        )
    return plan
