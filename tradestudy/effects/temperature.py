"""The slot of temperature: expansion of the baseline, or of the distance from main lens to microlens array."""

from __future__ import annotations

from tradestudy.effects.base import OFF, Bound, EffectCriterion, Model, Slot

EXPANSION = "expansion"


def temperature_slot(
    *, share_of_uncertainty: float, expansion: float, error: float, seconds: float, is_declared: bool
) -> Slot:
    """Models of a temperature that differs from that of the calibration.

    Parameters
    ----------
    share_of_uncertainty
        1 − (uncertainty without it)/(with it), the largest over usable distances.
    expansion
        Relative change of length, one standard deviation.
    error
        Stated error of the model that includes it, as a share of the depth uncertainty.
    seconds
        Predicted cost of including it [s].
    is_declared
        Whether the study declares a temperature.
    """
    if not is_declared:
        reason = "the study declares no change of temperature"
    else:
        reason = "the uncertainty without it falls short of that with it by at most this share, at any distance"
    criterion = EffectCriterion(
        words="relative expansion",
        definition="coefficient of expansion times the deviation of temperature: relative change, one standard "
        "deviation, of the baseline or of the distance from main lens to array",
        value=expansion,
    )
    off = Model(
        name=OFF,
        bounds={"depth_uncertainty": Bound(
            relative_change=share_of_uncertainty, criterion=criterion, reason=reason,
        )},
    )  # fmt: skip
    if not is_declared:
        return Slot(name="temperature", models=(off,))
    on = Model(
        name=EXPANSION,
        seconds=seconds,
        bounds={"depth_uncertainty": Bound(
            relative_change=error, criterion=criterion,
            reason="expansion is one more error of the length that it changes",
        )},
    )  # fmt: skip
    return Slot(name="temperature", models=(off, on))
