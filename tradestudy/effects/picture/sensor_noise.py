"""Noise of the electrons, of their reading, and of their rounding."""

from __future__ import annotations

import math
from typing import Final

from tradestudy.effects.base import OFF, EffectCriterion, Slot, SlotName
from tradestudy.effects.picture.criteria import electrons
from tradestudy.effects.picture.trial import PictureTrial, bounded, weighed

_RULE: Final = (
    "leaving this share of the noise power out lowers noise by half of it, and the bound is twice the largest "
    "change at the distances tried: it fits where this number is below the accuracy wanted, alone and with the other "
    "omissions"
)


def sensor_noise(trial: PictureTrial) -> Slot:
    """Off is listed and never fits: without noise a matcher would make no error."""
    slot: SlotName = "sensor_noise"
    both = EffectCriterion(
        words="read and rounding noise over all",
        definition="(σ² of reading + step²/12)/(electrons + σ² of reading + step²/12) in the darkest pixel, step the "
        "electrons of one digital number",
        value=trial.read_noise_share + trial.quantisation_share,
    )
    rounding = EffectCriterion(
        words="rounding noise over all",
        definition="step²/12 over the same sum",
        value=trial.quantisation_share,
    )
    return Slot(
        name=slot,
        models=(
            bounded(trial, OFF, math.inf, electrons(trial.electrons.value, trial.electrons.at),
                    "noise is what makes a matcher err; without it there is no disparity error to speak of"),
            weighed(trial, slot, "shot", both, _RULE),
            weighed(trial, slot, "shot+read", rounding, _RULE),
            weighed(trial, slot, "shot+read+quantisation", rounding,
                    "shot, read and rounding noise: the most complete model here"),
        ),
    )  # fmt: skip
