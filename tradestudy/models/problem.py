"""Problems of a study: how much their models change their answers, and which are the cheapest within the tolerance."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Final, Literal

from tradestudy.accuracy import Quantity
from tradestudy.effects import Models, SlotName
from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.units import FRACTION, pretty

NAMED: Final = "forced by the study"
Evidence = Literal["computed", "rule", "trial"]
"""How a change is known: computed everywhere, estimated by a rule with a margin, or tried at a few places."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """The change of a quantity when a set of models replaces the most complete one.

    Parameters
    ----------
    relative
        The largest relative change expected; infinite if it is unknown.
    least
        Known lower bound of the change, which no trial can lower.
    evidence
        How the change is known. Rules and trials are evidence, not bounds; the number includes their margins.
    at
        Distance at which the change is largest [m]; NaN if it has none.
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
        Rank of the most complete model among those that take far longer than all others; these are replaced first, from
        the highest rank down. 0 if the model does not take that long.
    reason
        Why there is only one model; empty if there are several.

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
        """The effect with the single model that the study forces, if it does."""
        if (model := forced.get(self.name)) is None:
            return self
        return replace(self, models=(model,), reason=NAMED)

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
    """The quantities that the question uses; they alone determine the choice."""
    slots: tuple[Slot, ...]
    """Effects in the order in which simpler models are tried: those that save the most time first."""

    @property
    def complete(self) -> Models:
        """The most complete models that the study allows, with which all others are compared."""
        return {slot.name: slot.models[-1] for slot in self.slots}

    @property
    def reasons(self) -> Models:
        """Why an effect has a single model, by effect."""
        return {slot.name: slot.reason for slot in self.slots if slot.reason}

    @abstractmethod
    def changes(self, models: Models) -> Changes:
        """How much a set of models changes each quantity of the question, as far as known."""

    def other_models(self, models: Models) -> Mapping[str, Models]:  # noqa: ARG002  # most problems use one set everywhere
        """Readings and inverse questions that need other models than these, by name."""
        return {}

    def unasked(self, models: Models) -> Changes:  # noqa: ARG002  # most problems have nothing else to show
        """Changes of quantities that are shown but do not affect the choice."""
        return {}

    def try_out(self, models: Models) -> bool:  # noqa: ARG002  # some problems have nothing to try
        """Try a more expensive model at a few places, to improve `changes`; False if none is left to try."""
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
        """Changes due to this model alone, with the most complete model of every other effect."""
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
    asked
        Tolerances that decide, by quantity.
    by_forcing
        Changes due to the forced models, relative to the most complete ones; empty if the study forces none.
    """

    problem: SimulationProblem
    models: Models
    forced: Models
    asked: Mapping[Quantity, float]
    by_forcing: Changes

    @property
    def name(self) -> str:
        """Name of the problem."""
        return self.problem.name

    @cached_property
    def changes(self) -> Changes:
        """Changes due to all simplifications together, in quantities of the question and others that are shown."""
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


def choose(
    problem: SimulationProblem,
    tolerances: Mapping[Quantity, float],
    forced: Models,
    free: SimulationProblem | None = None,
) -> Choice:
    """Replace models by simpler ones, effect by effect, as long as every quantity asked for stays within its tolerance.

    Costly models are replaced first, before other simplifications use up the tolerance. Every replacement is judged
    together with those before it, so that their changes need not be added up.

    Parameters
    ----------
    problem
        The problem; if a model is forced, its slot offers no other.
    tolerances
        Largest relative change that all simplifications together may cause, for every quantity asked for.
    forced
        The models that the study forces.
    free
        The same problem without forced models; None leaves out the changes due to them.

    Raises
    ------
    UnaffordableError
        If even the most complete models exceed a tolerance.
    """
    complete = problem.complete
    if not _fits(problem, complete, tolerances):
        changes = problem.changes(complete)
        worst = max(problem.asked, key=lambda q: changes[q].relative / tolerances[q])
        raise UnaffordableError(
            f"{problem.title}: even the most complete models cannot keep the {worst.replace('_', ' ')} "
            "within the tolerance",
            value=pretty(changes[worst].relative, FRACTION, digits=2),
            limit=pretty(tolerances[worst], FRACTION),
            remedy="loosen the tolerance, or force the models under 'effects'",
        )
    chosen = dict(complete)
    saving = [slot for slot in problem.slots if slot.saves_time]
    # Only by their next simpler models here; simpler ones still are tried in the turn of the effect below.
    for slot in sorted((slot for slot in saving if slot.costly), key=lambda slot: -slot.costly):
        chosen[slot.name] = _first_that_fits(problem, slot.name, slot.models[-2:-1], chosen, tolerances)
    for slot in saving:
        simpler = slot.models[: slot.models.index(chosen[slot.name])]
        chosen[slot.name] = _first_that_fits(problem, slot.name, simpler, chosen, tolerances)
    return Choice(
        problem=problem,
        models=chosen,
        forced=forced,
        asked={quantity: tolerances[quantity] for quantity in problem.asked},
        by_forcing=_by_forcing(free, problem),
    )


def _by_forcing(free: SimulationProblem | None, problem: SimulationProblem) -> Changes:
    """Changes due to the forced models where they differ from the most complete ones."""
    if free is None or free.complete == problem.complete:
        return {}
    while free.try_out(problem.complete):
        pass
    return free.changes(problem.complete)


def _first_that_fits(
    problem: SimulationProblem,
    slot: SlotName,
    models: tuple[str, ...],
    chosen: Models,
    tolerances: Mapping[Quantity, float],
) -> str:
    """The first model of an effect that, with those chosen so far, keeps the tolerances; else the chosen one."""
    return next((model for model in models if _fits(problem, {**chosen, slot: model}, tolerances)), chosen[slot])


def _fits(problem: SimulationProblem, models: Models, tolerances: Mapping[Quantity, float]) -> bool:
    """Whether a set of models keeps the tolerances, after trials if these can decide."""
    while True:
        changes = problem.changes(models)
        over = [(changes[q], tolerances[q]) for q in problem.asked if changes[q].relative > tolerances[q]]
        if not over:
            return True
        # Trials can only lower a change to its lower bound, so none is made where that already exceeds the tolerance.
        if any(change.least > tolerance for change, tolerance in over) or not problem.try_out(models):
            return False
