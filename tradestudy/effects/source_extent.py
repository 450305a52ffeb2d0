"""The extent of a source: a disc, or all its light from its middle."""

from __future__ import annotations

import math
from typing import Final

from tradestudy.effects.base import OFF, EffectCriterion, Model, Slot
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.picture_change import (
    bound_of,
    complete,
    frequencies,
    lit_transfer,
    picture_change,
    rim_share,
    source_transfer,
)

_SAFETY: Final = 1.2  # see `picture_change`


def source_extent_in_picture(scene: LightScene) -> Slot:
    """A point in the middle of the source, or the whole disc.

    A point lacks the disc's blur, 1 − 2J₁(x)/x of every frequency. It lights the array through one shadow of the
    pupil; the disc averages over shadows apart by s z/a, across which the wave from the rim turns by k R/z s z/a and
    the shadow moves by as much of its width.
    """
    point = lit_transfer(scene, source=False)
    blur = 1.0 - source_transfer(scene, frequencies(scene))
    moved = scene.source.diameter / 2.0 * scene.path.array_distance / scene.source.distance
    turn = 2.0 * math.pi / scene.wavelength * scene.path.main_lens.radius / scene.path.array_distance * moved
    averaged = min(1.0, turn**2 / 4.0)
    shadow = averaged * (2.0 * rim_share(scene) + min(1.0, moved / max(scene.blur_on_array, 1e-9)))
    return Slot(
        name="source_extent",
        models=(
            Model(
                name=OFF,
                bounds=bound_of(
                    scene,
                    _SAFETY * (picture_change(scene, blur * point) + picture_change(scene, shadow * point)),
                    criterion=EffectCriterion(
                        words="image of the source over pixel",
                        definition="diameter of the source's image behind one microlens by rays, no wider than that of "
                        "the pupil, over the pixel pitch",
                        value=2.0 * scene.spot_radius / scene.path.pixels.pitch,
                    ),
                    reason="a point has neither the width of the source nor its averaged shadows: they count unless "
                    "this is well below 1",
                ),
            ),
            Model(name="disc", bounds=complete()),
        ),
    )
