"""Light of one microlens in the picture of its neighbour."""

from __future__ import annotations

import math

from tradestudy.effects.base import OFF, Slot
from tradestudy.effects.picture.criteria import reach_over_airy
from tradestudy.effects.picture.trial import PictureTrial, bounded


def crosstalk(trial: PictureTrial) -> Slot:
    """Left out: windows are matched inside a micro-image, and the share of light from beyond it bounds the change.

    Outside radius r the Airy pattern holds ``1 − E ≈ 2/(π v)`` of its light, v = π r/(λN), here 1.22 π reaches; that
    share of light without the texture dims contrast, and the error grows by as much.
    """
    reach = trial.microlens_reach_airy
    criterion = reach_over_airy(math.nan if math.isinf(reach.value) else reach.value, reach.at)
    if math.isinf(reach.value):
        reason = "there are no micro-images side by side"
        return Slot(name="crosstalk", models=(bounded(trial, OFF, 0.0, criterion, reason),))
    share = min(1.0, 2.0 / (math.pi * 1.22 * math.pi * reach.value))
    change = share / (1.0 - share) if share < 1.0 else math.inf
    reason = (
        "no more light comes from a neighbour than an Airy pattern holds beyond half a micro-image, 0.17 over this "
        "number of it: the bound is that share"
    )
    return Slot(name="crosstalk", models=(bounded(trial, OFF, change, criterion, reason),))
