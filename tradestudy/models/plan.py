"""Plan a study: what a run simulates, what it leaves out and why, and which steps are slow."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from tradestudy.accuracy import Accuracy
from tradestudy.depth.usable import LIMIT_NAMES
from tradestudy.effects import Models
from tradestudy.errors import UnaffordableError
from tradestudy.models.choice import Chosen, choose_models, refuse_chosen_spot
from tradestudy.models.plan_text import plan_lines
from tradestudy.models.slow_steps import Work, magnitude, work_of
from tradestudy.results import GROUPS
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.varying import sweep_axes
from tradestudy.units import DATA, DURATION, FRACTION, pretty

TIME_REMEDY: Final = "raise accuracy.time_limit, loosen the tolerance, or ask for less"
_PARTS: Final = 4  # groups of errors of a camera, each with its share of the variance
_IN_MEMORY: Final = 3.5  # peak of a run relative to the results, as measured for 2652 designs
_WORTH_NAMING: Final = 8e9  # bit
_CERTAINLY_TOO_LONG: Final = 10.0  # times the limit; the table of seconds is not more precise


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
    work
        All work of the run, in the order of its steps.
    """

    definition: StudyDefinition
    accuracy: Accuracy
    problems: tuple[Chosen, ...]
    work: tuple[Work, ...]

    def models(self, problem: str) -> Models:
        """The models applied to a problem, by effect."""
        return next(one.models for one in self.problems if one.name == problem)

    def text(self, *, verbose: bool = False) -> str:
        """The plan as text: one line per problem and one for the run; with every decision if verbose."""
        settled, space = dict(_settled(self.definition)), _space(self.definition)
        return "\n".join(plan_lines(self.problems, settled, self.work, space, verbose=verbose))

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


def _space(definition: StudyDefinition) -> str:
    """Memory and disk space that a run takes, in words; empty up to 1 GB of memory."""
    results = size_of_depth(definition)
    memory = _IN_MEMORY * results
    if memory <= _WORTH_NAMING:
        return ""
    return f"; about {pretty(memory, DATA, digits=2)} of memory, {pretty(results, DATA, digits=2)} on disk"


def size_of_depth(definition: StudyDefinition) -> float:
    """Size of the results over distance and all designs of a study [bit], to about a quarter."""
    case = definition.case
    quantiles = [len(camera.propagation.probabilities) for camera in case.cameras.values()]
    sizes = {
        "camera": len(case.cameras), "distance": case.distance.size, "interval": 1, "side": 2, "error_source": 3,
        "quantile": max(quantiles, default=0), "part": _PARTS, "limit": len(LIMIT_NAMES),
    }  # fmt: skip
    numbers = sum(math.prod(sizes[dim] for dim in variable.dims) for variable in GROUPS["depth"].values())
    return 64.0 * numbers * math.prod(len(axis.values) for axis in sweep_axes(definition))


def plan_of(definition: StudyDefinition) -> Plan:
    """Choose the models of every problem of a study and name the slow steps of its run.

    Raises
    ------
    UnaffordableError
        If even the most complete models exceed a tolerance, or the run would take far longer than its time
        limit.
    StudyError
        If the study forces a model that none of its problems has, or weighs a criterion that is not a number.
    """
    accuracy = definition.file.accuracy.asked()
    problems = choose_models(definition)
    other_models: dict[str, dict[str, Models]] = {}
    for one in problems:
        for reading, models in one.choice.other_models.items():
            other_models.setdefault(reading, {})[one.name] = models
    applied = definition.with_models({one.name: one.models for one in problems}, other_models)
    plan = Plan(definition=applied, accuracy=accuracy, problems=problems, work=work_of(applied))
    refuse_chosen_spot(definition, problems)
    seconds = math.fsum(one.seconds for one in plan.work)
    if seconds > _CERTAINLY_TOO_LONG * accuracy.time_limit:
        raise UnaffordableError(
            "the run would take far longer than its time limit",
            value=magnitude(seconds),
            limit=pretty(accuracy.time_limit, DURATION),
            remedy=TIME_REMEDY,
        )
    return plan
