"""Diffraction at the main lens: none, Fresnel's law or Kirchhoff's."""

from __future__ import annotations

from tradestudy.effects.base import OFF, Bound, Model, Slot
from tradestudy.effects.interference import interference_change
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.picture_change import (
    aperture_transfer,
    edge_wave,
    frequencies,
    law_change,
    picture_change,
    pixel_transfer,
    source_transfer,
)


def main_lens_diffraction_in_picture(scene: LightScene) -> Slot:
    """Law of the leg from the main lens to the array, and what it may change in the pixels of a picture.

    Fresnel: rays of the exact paths land up to δ elsewhere, which turns the transfer function by at most 2π f δ; the
    cosines that Fresnel takes for one add to it. Rays besides leave out the wave from the rim of the pupil, which is
    on the array the share η of the field, and moves intensities by up to 2 η; and the interference of microlenses.
    """
    law = scene.main_law
    fresnel = picture_change(scene, law_change(scene, law.displacement)) + law.brightness
    f = frequencies(scene)
    lit = aperture_transfer(scene, f) * source_transfer(scene, f) * pixel_transfer(scene, f)
    rim = 2.0 * edge_wave(scene.main_fresnel_number)
    rays = picture_change(scene, rim * lit) + fresnel + interference_change(scene)
    return Slot(
        name="main_lens_diffraction",
        models=(
            Model(
                name=OFF,
                bounds={
                    "pixel_intensity": Bound(
                        relative_change=rays,
                        criterion="Fresnel number of the pupil from the array",
                        number=scene.main_fresnel_number,
                        reason="rays leave out the wave from the rim of the pupil and the aberration of exact paths",
                    )
                },
            ),
            Model(
                name="fresnel",
                bounds={
                    "pixel_intensity": Bound(
                        relative_change=fresnel,
                        criterion="displacement of rays over pixel",
                        number=law.displacement / scene.path.pixels.pitch,
                        reason="second-order paths leave out aberration of the main lens, which moves light",
                    )
                },
            ),
            Model(name="kirchhoff", bounds={"pixel_intensity": complete()}),
        ),
    )


def complete() -> Bound:
    """Of the model that leaves nothing out."""
    return Bound(relative_change=0.0, criterion="left out", number=0.0, reason="nothing is left out")
