"""Diffraction at the microlenses: none, Fresnel's law or Kirchhoff's."""

from __future__ import annotations

from tradestudy.effects.base import OFF, Bound, Model, Slot
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.main_lens_diffraction import complete
from tradestudy.effects.picture_change import (
    aperture_transfer,
    edge_wave,
    frequencies,
    law_change,
    picture_change,
    pixel_transfer,
    source_transfer,
)


def microlens_diffraction_in_picture(scene: LightScene) -> Slot:
    """Law of the leg from the array to the detector, and what it may change in the pixels of a picture.

    Rays leave out the finite width of the lens: the transfer function loses at most 1 − T(f), T that of the lit width
    without aberration (for any defocus, as the ray sum runs over the whole aperture and the wave's over its overlap);
    far from focus it is the wave from the rim, η of the field at either side.
    """
    law = scene.detector_law
    fresnel = picture_change(scene, law_change(scene, law.displacement)) + law.brightness
    f = frequencies(scene)
    lost = 1.0 - aperture_transfer(scene, f)
    rim = edge_wave(scene.microlens_fresnel_number)
    spread = min(
        picture_change(scene, lost * source_transfer(scene, f) * pixel_transfer(scene, f)),
        2.0 * rim if scene.microlens_fresnel_number > 1.0 else 2.0,
    )
    width = 1.0 / (scene.cutoff * scene.path.pixels.pitch)
    return Slot(
        name="microlens_diffraction",
        models=(
            Model(
                name=OFF,
                bounds={
                    "pixel_intensity": Bound(
                        relative_change=spread + fresnel,
                        criterion="width of a diffraction image over pixel",
                        number=width,
                        reason="rays leave out the spread by the aperture of a microlens and aberration of exact paths",
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
                        reason="second-order paths leave out aberration behind the array, which moves light",
                    )
                },
            ),
            Model(name="kirchhoff", bounds={"pixel_intensity": complete()}),
        ),
    )
