"""Noise of the electrons, of their reading, and of their rounding."""

from __future__ import annotations

import math

from tradestudy.effects.base import OFF, Slot, SlotName
from tradestudy.effects.picture.trial import PictureTrial, bounded, weighed


def sensor_noise(trial: PictureTrial) -> Slot:
    """Off is listed and never fits: without noise a matcher would make no error."""
    slot: SlotName = "sensor_noise"
    return Slot(
        name=slot,
        models=(
            bounded(trial, OFF, math.inf, "electrons per pixel", trial.electrons,
                    "noise is what makes a matcher err; without it there is no disparity error to speak of"),
            weighed(trial, slot, "shot", criterion="read and rounding noise over all", number=trial.read_noise_share
                    + trial.quantisation_share, reason="shot noise outweighs the others where light is plenty"),
            weighed(trial, slot, "shot+read", criterion="rounding noise over all", number=trial.quantisation_share,
                    reason="rounding adds a twelfth of a step squared"),
            weighed(trial, slot, "shot+read+quantisation", criterion="rounding noise over all",
                    number=trial.quantisation_share, reason="all three"),
        ),
    )  # fmt: skip
