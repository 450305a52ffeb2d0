"""Pixels integrate the light that falls on them; a sample at the centre does not."""

from __future__ import annotations

from typing import Final

from tradestudy.effects.base import OFF, Model, Slot
from tradestudy.effects.interference import sampled_fringes
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.picture_change import (
    bound_of,
    complete,
    diffraction_width,
    frequencies,
    lit_transfer,
    peak_change,
    picture_change,
    pixel_transfer,
)

_SAFETY: Final = 2.5  # see `picture_change`


def pixel_integration_in_picture(scene: LightScene) -> Slot:
    """One sample at the middle of a pixel, or the integral over its square.

    A sample keeps of every frequency 1 − sinc more than the integral does, spread over the picture or, for an image
    below a pixel, at its peak; fringes between microlenses, which the integral averages, it keeps whole.
    """
    kept = lit_transfer(scene, pixels=False) * (1.0 - pixel_transfer(scene, frequencies(scene)))
    change = max(picture_change(scene, kept), peak_change(scene, kept))
    return Slot(
        name="pixel_integration",
        models=(
            Model(
                name=OFF,
                bounds=bound_of(
                    scene,
                    _SAFETY * change + sampled_fringes(scene),
                    criterion=diffraction_width(scene),
                    reason="one sample at the centre stands for the whole pixel: it counts unless diffraction, defocus "
                    "or the source make the picture smooth over many pixels",
                ),
            ),
            Model(name="square", bounds=complete()),
        ),
    )
