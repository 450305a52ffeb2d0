"""The extent of a source: a disc, or all its light from its middle."""

from __future__ import annotations

import math

from tradestudy.effects.base import OFF, Bound, Model, Slot
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.main_lens_diffraction import complete
from tradestudy.effects.picture_change import (
    aperture_transfer,
    edge_wave,
    frequencies,
    picture_change,
    pixel_transfer,
    source_transfer,
)


def source_extent_in_picture(scene: LightScene) -> Slot:
    """A point in the middle of the source, or the whole disc.

    A point lacks the disc's blur, 1 − 2J₁(x)/x of every frequency; and it lights the array through one shadow of the
    pupil, where the disc averages over shadows that lie apart by as much as the disc seems to move.
    """
    f = frequencies(scene)
    sharper = (1.0 - source_transfer(scene, f)) * aperture_transfer(scene, f) * pixel_transfer(scene, f)
    moved = scene.source.diameter / 2.0 * scene.path.array_distance / scene.source.distance
    blur = max(scene.blur_on_array, 1e-12)
    averaged = min(1.0, (moved / blur) ** 2 * 2.0 * max(scene.main_fresnel_number, 1.0))
    shadow = averaged * (2.0 * edge_wave(scene.main_fresnel_number) + math.sqrt(min(1.0, moved / blur)))
    lit = aperture_transfer(scene, f) * pixel_transfer(scene, f)
    return Slot(
        name="source_extent",
        models=(
            Model(
                name=OFF,
                bounds={
                    "pixel_intensity": Bound(
                        relative_change=picture_change(scene, sharper) + picture_change(scene, shadow * lit),
                        criterion="image of the source over pixel",
                        number=2.0 * scene.spot_radius / scene.path.pixels.pitch,
                        reason="a point has neither the width of the source nor its averaged shadows",
                    )
                },
            ),
            Model(name="disc", bounds={"pixel_intensity": complete()}),
        ),
    )
