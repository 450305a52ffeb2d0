"""The slots of errors that act on depth: calibration, left out or added up in disparity, and temperature."""

from __future__ import annotations

from tradestudy.effects.base import OFF, Bound, EffectCriterion, Model, Slot

LINEAR, EXPANSION = "linear", "expansion"


def calibration_slot(*, share_of_uncertainty: float, linear_error: float, seconds: float, are_declared: bool) -> Slot:
    """Models of calibration errors for the depth uncertainty of one camera.

    Draws through the exact camera model are no model of this slot: a study that asks for them has a calibration part,
    which stands beside the closed form and is compared with it.

    Parameters
    ----------
    share_of_uncertainty
        1 − (uncertainty without them)/(with them), the largest over usable distances: what leaving them out changes.
    linear_error
        Largest stated error of adding them up in disparity, as a share of the depth uncertainty.
    seconds
        Predicted cost of adding them up [s].
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
    linear = Bound(
        relative_change=linear_error,
        criterion=EffectCriterion(
            words="departure from the exact camera model, over the uncertainty",
            definition="stated error of the depth uncertainty in closed form over that uncertainty, the largest at "
            "usable distances",
            value=linear_error,
        ),
        reason="errors add up in disparity, where they act almost linearly; one-deviation errors through the exact "
        "camera model tell how nearly",
    )
    models = (
        Model(name=OFF, bounds={"depth_uncertainty": off}),
        Model(name=LINEAR, bounds={"depth_uncertainty": linear}, seconds=seconds),
    )
    return Slot(name="calibration", models=models if are_declared else models[:1])


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
    reason = (
        "the uncertainty without it falls short of that with it by at most this share, at any distance"
        if is_declared
        else "the study declares no change of temperature"
    )
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
    on = Model(
        name=EXPANSION,
        seconds=seconds,
        bounds={"depth_uncertainty": Bound(
            relative_change=error, criterion=criterion,
            reason="expansion is one more error of the length that it changes",
        )},
    )  # fmt: skip
    return Slot(name="temperature", models=(off, on) if is_declared else (off,))
