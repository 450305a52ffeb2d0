"""Defocus in the picture: everything sharp, or the blur disc of geometric optics."""

from __future__ import annotations

from tradestudy.effects.base import OFF, Slot
from tradestudy.effects.picture.criteria import blur_over_pixel
from tradestudy.effects.picture.trial import PictureTrial, weighed


def defocus_blur(trial: PictureTrial) -> Slot:
    """Off or the disc; where diffraction is by waves, the defocus belongs to it."""
    blur = blur_over_pixel(trial.blur_px.value, trial.blur_px.at)
    return Slot(
        name="defocus_blur",
        models=(
            weighed(trial, "defocus_blur", OFF, blur,
                    "blur takes texture from a matcher, below a pixel as the square of this number: it counts unless "
                    "it is well below 1 at every distance"),
            weighed(trial, "defocus_blur", "disc", blur, "the disc is the most complete model of defocus here"),
        ),
    )  # fmt: skip
