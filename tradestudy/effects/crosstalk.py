"""Cross-talk between microlenses: light that lands behind a neighbour."""

from __future__ import annotations

from typing import Final

import numpy as np

from tradestudy.effects.base import OFF, EffectCriterion, Model, Slot
from tradestudy.effects.interference import interference_change, light_behind_neighbours
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.picture_change import bound_of, complete

_SAFETY: Final = 1.5  # see `picture_change`


def crosstalk_in_picture(scene: LightScene) -> Slot:
    """Whether a pixel takes light of the nearest microlens alone, or of all, added as fields.

    Left out are the light that leaves its cell and its interference with what is there.
    """
    change = _SAFETY * (light_behind_neighbours(scene) + interference_change(scene))
    return Slot(
        name="crosstalk",
        models=(
            Model(
                name=OFF,
                bounds=bound_of(
                    scene,
                    change,
                    criterion=EffectCriterion(
                        words="pixels between the outermost ray and the neighbour's cell",
                        definition="least distance of a ray on the detector from the border of its microlens's cell, "
                        "over the pixel pitch; negative behind a neighbour",
                        value=float(np.min(scene.margins, initial=np.inf)) / scene.path.pixels.pitch,
                    ),
                    reason="diffraction carries 0.2 of its width λ b/w over a ray's distance from the border of its "
                    "cell across, where it may interfere: unless all rays stay many such widths away, it counts",
                ),
            ),
            Model(name="coherent", bounds=complete()),
        ),
    )
