"""The cheapest models that answer a question within its tolerance."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal

from tradestudy.accuracy import Quantity
from tradestudy.effects.models import Models, SlotName
from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.units import FRACTION, pretty

NAMED: Final = "the study names the model"
Evidence = Literal["computed", "rule", "trial"]
"""How a change is known: by computing it everywhere, by a closed rule with a margin, or at a few places."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """How far a quantity moves if a set of models stands in for the most complete one.

    Parameters
    ----------
    relative
        The largest relative change that has to be expected; infinite where none can be stated.
    least
        What it is known to be at least, so that no trial can bring it below.
    evidence
        How it is known. A rule and a trial are evidence, not bounds; their margins are in the number.
    at
        Distance at which it is the largest [m]; NaN where it belongs to none.
    """

    relative: float
    least: float = 0.0
    evidence: Evidence = "computed"
    at: float = math.nan


Changes = Mapping[Quantity, Change]


@dataclass(frozen=True, kw_only=True)
class Slot:
    """An effect of one piece of a study: the models that could stand for it, from the cheapest to the most complete.

    Parameters
    ----------
    name, models
        The effect and its models.
    saves_time
        Whether a simpler model is quicker; where none is, the most complete one stands.
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
    reason: str = ""

    def under(self, forced: Models) -> Slot:
        """The same effect with the one model that a study names, if it names one."""
        if (named := forced.get(self.name)) is None:
            return self
        return replace(self, models=(named,), reason=NAMED)

    def __post_init__(self) -> None:
        if not self.models or len(set(self.models)) < len(self.models):
            raise OutOfRangeError(
                f"models of {self.name}", value=", ".join(self.models), limit="one or more, all different"
            )


class Piece(ABC):
    """A camera, a light path or a lens of a study, and what its models change in its answers."""

    name: str
    title: str
    asked: tuple[Quantity, ...]
    """The quantities that the question uses; only these decide."""
    slots: tuple[Slot, ...]
    """In the order in which simpler models are tried: those that save the most time first."""

    @property
    def complete(self) -> Models:
        """The most complete models that the study allows, which all others are held against."""
        return {slot.name: slot.models[-1] for slot in self.slots}

    @abstractmethod
    def changes(self, models: Models) -> Changes:
        """How far a set of models moves each asked quantity, by what is known so far."""

    def elsewhere(self, models: Models) -> Mapping[str, Models]:  # noqa: ARG002  # most pieces are the same everywhere
        """Readings and inverse questions that take other models than these, by name."""
        return {}

    def unasked(self, models: Models) -> Changes:  # noqa: ARG002  # most pieces have nothing else to show
        """The same of quantities that are shown and decide nothing."""
        return {}

    def try_out(self, models: Models) -> bool:  # noqa: ARG002  # some pieces have nothing to try
        """Run a more expensive model at a few places, so that `changes` of a set is known better; False if it is."""
        return False


@dataclass(frozen=True, kw_only=True)
class Decision:
    """What became of one model.

    Parameters
    ----------
    slot, model
        The effect and the way to treat it.
    chosen, forced
        Whether it acts, and whether the study insists on the model of this effect.
    changes
        What it alone changes, beside the most complete models of the other effects.
    """

    slot: SlotName
    model: str
    chosen: bool
    forced: bool
    changes: Changes


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """One model for every effect of a piece.

    Parameters
    ----------
    piece
        What it is for.
    models
        What acts.
    forced
        Models that the study insists on.
    """

    piece: Piece
    models: Models
    forced: Models

    @cached_property
    def changes(self) -> Changes:
        """What all that is left out changes together, in quantities that are asked for and in others that are shown."""
        return {**self.piece.changes(self.models), **self.piece.unasked(self.models)}

    @cached_property
    def elsewhere(self) -> Mapping[str, Models]:
        """Readings and inverse questions that take other models, by name."""
        return self.piece.elsewhere(self.models)

    @cached_property
    def decisions(self) -> tuple[Decision, ...]:
        """Every model of every effect; found when it is looked at, for it decides nothing."""
        complete = self.piece.complete
        return tuple(
            Decision(
                slot=slot.name,
                model=model,
                chosen=self.models[slot.name] == model,
                forced=slot.name in self.forced,
                changes=self.piece.changes({**complete, slot.name: model}),
            )
            for slot in self.piece.slots
            for model in slot.models
        )


def choose(piece: Piece, tolerances: Mapping[Quantity, float], forced: Models) -> Choice:
    """Replace models by simpler ones, effect by effect, as long as all asked quantities stay within their tolerance.

    Every replacement is judged together with those before it, so that omissions do not have to be added up.

    Parameters
    ----------
    piece
        What is chosen for; its slots offer no other model where one is forced.
    tolerances
        Relative change that all omissions together may make, for every asked quantity.
    forced
        Models that the study insists on.

    Raises
    ------
    UnaffordableError
        If not even the most complete models answer within the tolerance.
    """
    complete = piece.complete
    if not _fits(piece, complete, tolerances):
        raise _out_of_reach(piece, piece.changes(complete), tolerances)
    chosen = dict(complete)
    for slot in (one for one in piece.slots if one.saves_time):
        for model in slot.models[:-1]:
            if _fits(piece, {**chosen, slot.name: model}, tolerances):
                chosen[slot.name] = model
                break
    return Choice(piece=piece, models=chosen, forced=forced)


def _fits(piece: Piece, models: Models, tolerances: Mapping[Quantity, float]) -> bool:
    """Whether a set answers within the tolerance, tried out where that can decide."""
    while True:
        found = piece.changes(models)
        over = [(found[q], tolerances[q]) for q in piece.asked if found[q].relative > tolerances[q]]
        if not over:
            return True
        if any(change.least > tolerance for change, tolerance in over) or not piece.try_out(models):
            return False


def _out_of_reach(piece: Piece, changes: Changes, tolerances: Mapping[Quantity, float]) -> UnaffordableError:
    worst = max(piece.asked, key=lambda q: changes[q].relative / tolerances[q])
    return UnaffordableError(
        f"{piece.title}: not even the most complete models give the {worst.replace('_', ' ')} to the tolerance",
        value=pretty(changes[worst].relative, FRACTION, digits=2),
        limit=pretty(tolerances[worst], FRACTION),
        remedy="loosen the tolerance, or name the models under 'effects'",
    )
