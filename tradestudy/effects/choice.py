"""Choose the cheapest models that answer a question within its tolerance."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Final, Literal

from tradestudy.accuracy import Quantity
from tradestudy.effects.models import Models, SlotName
from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.units import FRACTION, pretty

NAMED: Final = "forced by the study"
Evidence = Literal["computed", "rule", "trial"]
"""How a change is known: computed everywhere, by a closed rule with a margin, or tried at a few places."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """The change of a quantity when a set of models replaces the most complete one.

    Parameters
    ----------
    relative
        The largest relative change to be expected; infinite where none can be stated.
    least
        Known lower bound of the change; no trial can bring it below.
    evidence
        How the change is known. A rule and a trial are evidence, not bounds; the number includes their margins.
    at
        Distance at which the change is largest [m]; NaN where it has no distance.
    """

    relative: float
    least: float = 0.0
    evidence: Evidence = "computed"
    at: float = math.nan


Changes = Mapping[Quantity, Change]


@dataclass(frozen=True, kw_only=True)
class Slot:
    """An effect in one problem of a study, and its possible models from the cheapest to the most complete.

    Parameters
    ----------
    name, models
        The effect and its models.
    saves_time
        Whether a simpler model is faster; if not, the most complete one is used.
    costly
        Rank of the most complete model among those that take far longer than all others, so that they are replaced
        first, beginning with the highest rank; 0 if it does not.
    reason
        Why there is only one model; empty where there are several.

    Raises
    ------
    OutOfRangeError
        If there is no model, or two share a name.
    """

    name: SlotName
    models: tuple[str, ...]
    saves_time: bool = True
    costly: int = 0
    reason: str = ""

    def under(self, forced: Models) -> Slot:
        """The same effect with the one model that the study forces, if it forces one."""
        if (named := forced.get(self.name)) is None:
            return self
        return replace(self, models=(named,), reason=NAMED)

    def __post_init__(self) -> None:
        if not self.models or len(set(self.models)) < len(self.models):
            raise OutOfRangeError(
                f"models of {self.name}", value=", ".join(self.models), limit="one or more, all different"
            )


class SimulationProblem(ABC):
    """A problem of a study: a camera, a light path or a lens, and how its models change its answers."""

    name: str
    title: str
    asked: tuple[Quantity, ...]
    """The quantities that the question uses; only these decide."""
    slots: tuple[Slot, ...]
    """Effects in the order in which simpler models are tried: those that save the most time first."""

    @property
    def complete(self) -> Models:
        """The most complete models that the study allows, with which all others are compared."""
        return {slot.name: slot.models[-1] for slot in self.slots}

    @abstractmethod
    def changes(self, models: Models) -> Changes:
        """How much a set of models changes each asked quantity, as far as is known yet."""

    def other_models(self, models: Models) -> Mapping[str, Models]:  # noqa: ARG002  # most problems use one set everywhere
        """Readings and inverse questions that need other models than these, by name."""
        return {}

    def unasked(self, models: Models) -> Changes:  # noqa: ARG002  # most problems have nothing else to show
        """Changes of quantities that are shown but do not decide."""
        return {}

    def try_out(self, models: Models) -> bool:  # noqa: ARG002  # some problems have nothing to try
        """Try a more expensive model at a few places, so that `changes` is known better; False if none is left."""
        return False


@dataclass(frozen=True, kw_only=True)
class Decision:
    """The decision on one model.

    Parameters
    ----------
    slot, model
        The effect and its model.
    chosen, forced
        Whether the model is applied, and whether the study forces the model of this effect.
    alone
        Computes `changes` on demand.
    """

    slot: SlotName
    model: str
    chosen: bool
    forced: bool
    alone: Callable[[], Changes]

    @cached_property
    def changes(self) -> Changes:
        """Changes due to this model alone, with the most complete models of all other effects."""
        return self.alone()


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """One model for every effect of a problem.

    Parameters
    ----------
    problem
        The problem.
    models
        The applied models.
    forced
        The models that the study forces.
    """

    problem: SimulationProblem
    models: Models
    forced: Models

    @cached_property
    def changes(self) -> Changes:
        """Changes due to all omissions together, of the asked quantities and of others that are shown."""
        return {**self.problem.changes(self.models), **self.problem.unasked(self.models)}

    @cached_property
    def other_models(self) -> Mapping[str, Models]:
        """Readings and inverse questions that need other models, by name."""
        return self.problem.other_models(self.models)

    @cached_property
    def decisions(self) -> tuple[Decision, ...]:
        """Every model of every effect."""
        complete = self.problem.complete
        return tuple(
            Decision(
                slot=slot.name,
                model=model,
                chosen=self.models[slot.name] == model,
                forced=slot.name in self.forced,
                alone=partial(self.problem.changes, {**complete, slot.name: model}),
            )
            for slot in self.problem.slots
            for model in slot.models
        )


def choose(problem: SimulationProblem, tolerances: Mapping[Quantity, float], forced: Models) -> Choice:
    """Replace models by simpler ones, effect by effect, as long as all asked quantities stay within their tolerance.

    Costly models go first, so that no other omission uses up the tolerance before. Every replacement is judged together
    with those before it, so that omissions do not have to be added up.

    Parameters
    ----------
    problem
        The problem; where a model is forced, its slot offers no other.
    tolerances
        Largest relative change that all omissions together may cause, for every asked quantity.
    forced
        The models that the study forces.

    Raises
    ------
    UnaffordableError
        If even the most complete models exceed a tolerance.
    """
    complete = problem.complete
    if not _fits(problem, complete, tolerances):
        raise _out_of_reach(problem, problem.changes(complete), tolerances)
    chosen = dict(complete)
    saving = [slot for slot in problem.slots if slot.saves_time]
    for slot in sorted((one for one in saving if one.costly), key=lambda one: -one.costly):
        chosen[slot.name] = _first_that_fits(problem, slot.name, slot.models[-2:-1], chosen, tolerances)
    for slot in saving:
        simpler = slot.models[: slot.models.index(chosen[slot.name])]
        chosen[slot.name] = _first_that_fits(problem, slot.name, simpler, chosen, tolerances)
    return Choice(problem=problem, models=chosen, forced=forced)


def _first_that_fits(
    problem: SimulationProblem,
    slot: SlotName,
    models: tuple[str, ...],
    chosen: Models,
    tolerances: Mapping[Quantity, float],
) -> str:
    """The first of some models of an effect that fits with the models chosen so far; the chosen one if none does."""
    return next((model for model in models if _fits(problem, {**chosen, slot: model}, tolerances)), chosen[slot])


def _fits(problem: SimulationProblem, models: Models, tolerances: Mapping[Quantity, float]) -> bool:
    """Whether a set of models answers within the tolerances, with trials where these can decide."""
    while True:
        found = problem.changes(models)
        over = [(found[q], tolerances[q]) for q in problem.asked if found[q].relative > tolerances[q]]
        if not over:
            return True
        if any(change.least > tolerance for change, tolerance in over) or not problem.try_out(models):
            return False


def _out_of_reach(
    problem: SimulationProblem, changes: Changes, tolerances: Mapping[Quantity, float]
) -> UnaffordableError:
    worst = max(problem.asked, key=lambda q: changes[q].relative / tolerances[q])
    return UnaffordableError(
        f"{problem.title}: even the most complete models cannot keep the {worst.replace('_', ' ')} "
        "within the tolerance",
        value=pretty(changes[worst].relative, FRACTION, digits=2),
        limit=pretty(tolerances[worst], FRACTION),
        remedy="loosen the tolerance, or force the models under 'effects'",
    )
