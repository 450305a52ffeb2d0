"""The cheapest models that answer a question within its tolerance."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from tradestudy.accuracy import Quantity
from tradestudy.effects.models import Models, SlotName
from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.units import FRACTION, pretty

Evidence = Literal["computed", "bound", "trial"]
"""How a change is known: by computing it everywhere, by a rule that it cannot exceed, or at a few places."""


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
        How it is known. A trial is evidence, not a bound; its margin is in the number.
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

    @abstractmethod
    def changes(self, models: Models) -> Changes:
        """How far a set of models moves each quantity, those that are not asked for too, by what is known so far."""

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


@dataclass(frozen=True, kw_only=True)
class Choice:
    """One model for every effect of a piece.

    Parameters
    ----------
    models
        What acts.
    changes
        What all that is left out changes together, forced models included.
    decisions
        Every model of every effect.
    """

    models: Models
    changes: Changes
    decisions: tuple[Decision, ...]


def choose(piece: Piece, tolerances: Mapping[Quantity, float], forced: Models) -> Choice:
    """Replace models by simpler ones, effect by effect, as long as all asked quantities stay within their tolerance.

    Every replacement is judged together with those before it, so that omissions do not have to be added up. Forced
    models count as given: what they change is reported and held against nothing.

    Parameters
    ----------
    piece
        What is chosen for.
    tolerances
        Relative change that all omissions together may make, for every quantity.
    forced
        Models that the study insists on.

    Raises
    ------
    UnaffordableError
        If not even the most complete models answer within the tolerance.
    """
    given = {slot.name: forced.get(slot.name, slot.models[-1]) for slot in piece.slots}
    beside = {q: change.relative for q, change in piece.changes(given).items()} if forced else {}

    def fits(models: Models) -> bool:
        while True:
            found = piece.changes(models)
            over = {q: found[q] for q in piece.asked if found[q].relative > tolerances[q] + beside.get(q, 0.0)}
            if not over:
                return True
            if any(one.least > tolerances[q] + beside.get(q, 0.0) for q, one in over.items()):
                return False
            if not piece.try_out(models):
                return False

    if not forced and not fits(given):
        raise _out_of_reach(piece, piece.changes(given), tolerances)
    chosen = dict(given)
    for slot in piece.slots:
        if slot.name in forced or not slot.saves_time:
            continue
        for model in slot.models[:-1]:
            if fits({**chosen, slot.name: model}):
                chosen[slot.name] = model
                break
    decisions = tuple(
        Decision(
            slot=slot.name,
            model=model,
            chosen=chosen[slot.name] == model,
            forced=slot.name in forced,
            changes=piece.changes({**given, slot.name: model}),
        )
        for slot in piece.slots
        for model in slot.models
    )
    return Choice(models=chosen, changes=piece.changes(chosen), decisions=decisions)


def _out_of_reach(piece: Piece, changes: Changes, tolerances: Mapping[Quantity, float]) -> UnaffordableError:
    worst = max(piece.asked, key=lambda q: changes[q].relative / tolerances[q])
    reached = changes[worst].relative
    return UnaffordableError(
        f"{piece.title}: not even the most complete models give the {worst.replace('_', ' ')} to the tolerance",
        value=pretty(reached, FRACTION, digits=2),
        limit=pretty(tolerances[worst], FRACTION),
        remedy="loosen the tolerance, or name the models under 'effects'",
    )
