"""Light of one microlens in the picture of its neighbour."""

from __future__ import annotations

import math

from tradestudy.effects.base import OFF, Slot
from tradestudy.effects.picture.criteria import reach_over_airy
from tradestudy.effects.picture.trial import PictureTrial, bounded, weighed


def crosstalk(trial: PictureTrial) -> Slot:
    """Off: a window sees its own microlens only; share: what neighbours spread into it dims the texture and is noise.

    In the middle of a micro-image of radius r the share is what an Airy pattern holds outside, ``2/(π v)``,
    v = π r/(λN) = 1.22 π r/(Airy radius), about 0.17 over the criterion; towards its edge it is more.
    """
    reach = trial.microlens_reach_airy
    criterion = reach_over_airy(math.nan if math.isinf(reach.value) else reach.value, reach.at)
    if math.isinf(reach.value):
        reason = "there are no micro-images side by side"
        return Slot(name="crosstalk", models=(bounded(trial, OFF, 0.0, criterion, reason),))
    return Slot(
        name="crosstalk",
        models=(
            weighed(trial, "crosstalk", OFF, criterion,
                    "in the middle of a micro-image neighbours bring 0.17 over this number of the light, towards its "
                    "edge more: it counts unless that is well below the accuracy wanted"),
            weighed(trial, "crosstalk", "share", criterion,
                    "the share of neighbours in a window, dimming its texture and adding theirs: the most complete "
                    "model here"),
        ),
    )  # fmt: skip
