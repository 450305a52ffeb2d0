"""Defocus in the picture: everything sharp, or the blur disc of geometric optics."""

from __future__ import annotations

from tradestudy.effects.base import OFF, Slot
from tradestudy.effects.picture.trial import PictureTrial, weighed

_CRITERION = "blur over pixel"


def defocus_blur(trial: PictureTrial) -> Slot:
    """Off or the disc; where diffraction is by waves, the defocus belongs to it."""
    return Slot(
        name="defocus_blur",
        models=(
            weighed(trial, "defocus_blur", OFF, criterion=_CRITERION, number=trial.blur_px,
                    reason="a blur smaller than a pixel takes little of the texture that a matcher uses"),
            weighed(trial, "defocus_blur", "disc", criterion=_CRITERION, number=trial.blur_px,
                    reason="the disc is the most complete model of defocus here"),
        ),
    )  # fmt: skip
