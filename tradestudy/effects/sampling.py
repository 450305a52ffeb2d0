"""The sampling of integrals: a numerical tolerance is a model like others, which leaves out what lies between nodes."""

from __future__ import annotations

from typing import Final

from tradestudy.accuracy import Quantity
from tradestudy.effects.base import Bound, EffectCriterion, Model, Slot

TOLERANCES: Final = (0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)


def sampling(quantity: Quantity) -> Slot:
    """Tolerances from the loosest to the tightest; each is the bound of what it may change.

    Parameters
    ----------
    quantity
        That is computed to them.
    """
    return Slot(
        name="sampling",
        models=tuple(
            Model(
                name=tolerance_name(tolerance),
                bounds={
                    quantity: Bound(
                        relative_change=tolerance,
                        criterion=EffectCriterion(
                            words="numerical tolerance",
                            definition="relative error that the nodes of all integrals are placed for",
                            value=tolerance,
                        ),
                        reason="nodes are placed to meet it, and every result states what it reached",
                    )
                },
            )
            for tolerance in TOLERANCES
        ),
    )


def tolerance_name(tolerance: float) -> str:
    """As in ``0.5 %``."""
    return f"{100.0 * tolerance:.6g} %"


def tolerance_of(model: Model) -> float:
    """The tolerance that a model stands for."""
    (bound,) = model.bounds.values()
    return bound.relative_change
