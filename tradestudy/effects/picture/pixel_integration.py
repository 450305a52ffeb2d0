"""Pixels as points, or as squares that collect."""

from __future__ import annotations

from tradestudy.effects.base import OFF, Slot
from tradestudy.effects.picture.criteria import pixel_over_pitch
from tradestudy.effects.picture.trial import PictureTrial, weighed


def pixel_integration(trial: PictureTrial) -> Slot:
    """Off: the picture at the pixels' centres; square: its mean over each of them."""
    return Slot(
        name="pixel_integration",
        models=(
            weighed(trial, "pixel_integration", OFF, pixel_over_pitch(),
                    "the mean over a pixel dims the finest texture that the pixels resolve by a third: it counts "
                    "unless blur and diffraction have taken that texture before"),
            weighed(trial, "pixel_integration", "square", pixel_over_pitch(),
                    "the mean over the active pixel is exact"),
        ),
    )  # fmt: skip
