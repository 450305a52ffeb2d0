"""Cross-talk between microlenses: light that lands behind a neighbour."""

from __future__ import annotations

import numpy as np

from tradestudy.effects.base import OFF, Bound, Model, Slot
from tradestudy.effects.interference import interference_change, light_behind_neighbours
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.main_lens_diffraction import complete


def crosstalk_in_picture(scene: LightScene) -> Slot:
    """Whether a pixel takes light of the nearest microlens alone, or of all, added as fields.

    Left out are the light that leaves its cell and its interference with what is there.
    """
    foreign = light_behind_neighbours(scene)
    margin = float(np.min(scene.margins, initial=np.inf)) / scene.path.pixels.pitch
    return Slot(
        name="crosstalk",
        models=(
            Model(
                name=OFF,
                bounds={
                    "pixel_intensity": Bound(
                        relative_change=foreign + interference_change(scene),
                        criterion="pixels between the outermost ray and the neighbour's cell",
                        number=margin,
                        reason="every pixel takes the light of its nearest microlens alone",
                    )
                },
            ),
            Model(name="coherent", bounds={"pixel_intensity": complete()}),
        ),
    )
