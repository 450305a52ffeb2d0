"""Light lost towards the edge of the field."""

from __future__ import annotations

from tradestudy.effects.base import OFF, Slot
from tradestudy.effects.picture.criteria import light_left
from tradestudy.effects.picture.trial import PictureTrial, weighed


def vignetting(trial: PictureTrial) -> Slot:
    """Off, or cos⁴ with the stops at the field angle where depth is asked for."""
    left = light_left(trial.illumination)
    return Slot(
        name="vignetting",
        models=(
            weighed(trial, "vignetting", OFF, left,
                    "the share of light that is lost raises noise over signal by half of itself or more, and the "
                    "bound is twice the largest change at the distances tried: nothing is left out where this number "
                    "is 1, on the axis"),
            weighed(trial, "vignetting", "cos4", left, "cos⁴ and the overlap of the stops are closed forms"),
        ),
    )  # fmt: skip
