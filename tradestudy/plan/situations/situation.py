"""One piece of a study that effects are chosen for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tradestudy.accuracy import Accuracy, Quantity
from tradestudy.effects.base import Slot, SlotName
from tradestudy.effects.selection import Chosen, Selection, select, sum_of_seconds
from tradestudy.errors import UnaffordableError


@dataclass(frozen=True, kw_only=True)
class Situation:
    """A camera, a light path or a lens, what is asked of it, and the models that could answer.

    Parameters
    ----------
    name, title
        Name in the results and words in reports.
    quantities
        What is asked for.
    slots
        Bounds are those of the worst place looked at: distances, readings, designs of the sweep and of inverse
        questions.
    seconds
        Predicted cost of a set of models [s].
    """

    name: str
    title: str
    quantities: tuple[Quantity, ...]
    slots: tuple[Slot, ...]
    seconds: Callable[[Chosen], float] = sum_of_seconds

    def select(self, accuracy: Accuracy, forced: dict[SlotName, str]) -> Selection:
        """Choose its models; a forced model that this piece does not have is for the other pieces.

        Raises
        ------
        UnaffordableError
            Where no set of its models is accurate enough.
        """
        own = {slot.name: forced[slot.name] for slot in self.slots if forced.get(slot.name) in slot.model_names}
        try:
            return select(self.slots, quantities=self.quantities, accuracy=accuracy, forced=own, seconds=self.seconds)
        except UnaffordableError as error:
            raise UnaffordableError(
                f"{self.title}: {error.what}", value=error.value, limit=error.limit, remedy=error.remedy
            ) from None
