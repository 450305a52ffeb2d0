"""Light lost towards the edge of the field."""

from __future__ import annotations

from tradestudy.effects.base import OFF, Slot
from tradestudy.effects.picture.trial import PictureTrial, weighed


def vignetting(trial: PictureTrial) -> Slot:
    """Off, or cos⁴ with the stops at the field angle where depth is asked for."""
    lost = "light left at the field angle"
    return Slot(
        name="vignetting",
        models=(
            weighed(trial, "vignetting", OFF, criterion=lost, number=trial.illumination,
                    reason="fewer electrons mean more shot noise in proportion; on the axis none are lost"),
            weighed(trial, "vignetting", "cos4", criterion=lost, number=trial.illumination,
                    reason="cos⁴ and the overlap of the stops are closed forms"),
        ),
    )  # fmt: skip
