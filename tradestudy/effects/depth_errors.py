"""The slot of calibration: its errors left out, or propagated to depth linearly or exactly."""

from __future__ import annotations

import math
from typing import Final

from tradestudy.effects.base import COMPLETE, OFF, Bound, EffectCriterion, Model, Slot

LINEAR: Final = "linear"
EXACT: Final = "exact"


def calibration_slot(
    *, share_of_uncertainty: float, linear_error: float, at: float, exact_seconds: float, are_declared: bool
) -> Slot:  # fmt: skip
    """Models of calibration errors for the depth uncertainty of one camera.

    Parameters
    ----------
    share_of_uncertainty
        1 − (uncertainty without them)/(with them), the largest over usable distances: what leaving them out changes.
    linear_error
        Largest departure of the linear model from exact draws at the distances tried, as a share of the uncertainty;
        infinite where it cannot be tried.
    at
        Where that is [m]; NaN where it was not tried.
    exact_seconds
        Predicted cost of draws [s]; a line costs a few readings, which is nothing beside it.
    are_declared
        Whether the study declares any.
    """
    off = Bound(
        relative_change=share_of_uncertainty,
        criterion=EffectCriterion(
            words="share of calibration errors in the depth uncertainty",
            definition="1 − u/u₀; u the depth uncertainty without them, u₀ with them, the largest at any distance; "
            "twice that where the disparity error is derived, at most 1",
            value=share_of_uncertainty,
        ),
        reason="the uncertainty without them falls short of that with them by at most this share, at any distance"
        if are_declared
        else "the study declares no calibration error of this camera",
    )
    tried = EffectCriterion(
        words="departure from exact draws, over the uncertainty",
        definition="|u/u₀ − 1|; u half the width of any reported interval by the line, u₀ by draws through the exact "
        "reading, with twice the standard error of the draws; the largest at the distances tried",
        value=linear_error,
        at=at,
    )
    linear = Bound(
        relative_change=linear_error,
        criterion=tried,
        reason="tried against exact draws at the ends and in the middle of the usable range, where the uncertainty "
        "is the largest share of the distance, and wherever the study asks"
        if math.isfinite(linear_error)
        else "its calibration is inferred during the run, or depth is lost: how far a line misses it is not known",
    )
    models = (
        Model(name=OFF, bounds={"depth_uncertainty": off}),
        Model(name=LINEAR, bounds={"depth_uncertainty": linear}),
        Model(name=EXACT, bounds={"depth_uncertainty": COMPLETE}, seconds=exact_seconds),
    )
    return Slot(name="calibration", models=models)
