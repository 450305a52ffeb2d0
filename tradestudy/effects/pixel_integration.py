"""Pixels integrate the light that falls on them; a sample at the centre does not."""

from __future__ import annotations

import math

from tradestudy.effects.base import OFF, Bound, Model, Slot
from tradestudy.effects.interference import light_behind_neighbours
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.main_lens_diffraction import complete
from tradestudy.effects.picture_change import (
    aperture_transfer,
    frequencies,
    peak_change,
    picture_change,
    pixel_transfer,
    source_transfer,
)


def pixel_integration_in_picture(scene: LightScene) -> Slot:
    """One sample at the middle of a pixel, or the integral over its square.

    A sample keeps of every frequency 1 − sinc more than the integral does, spread over the picture or, for an image
    below a pixel, at its peak; fringes between microlenses, which the integral averages, it keeps whole.
    """
    f = frequencies(scene)
    kept = (1.0 - pixel_transfer(scene, f)) * aperture_transfer(scene, f) * source_transfer(scene, f)
    largest = max(picture_change(scene, kept), peak_change(scene, kept))
    fringes = 2.0 * math.sqrt(light_behind_neighbours(scene))
    x = 2.0 * math.pi * scene.path.microlenses.pitch / (scene.wavelength * scene.path.detector_distance)
    x *= scene.spot_radius
    fringes *= min(1.0, 1.6 / x**1.5) if x > 0.0 else 1.0
    return Slot(
        name="pixel_integration",
        models=(
            Model(
                name=OFF,
                bounds={
                    "pixel_intensity": Bound(
                        relative_change=largest + fringes,
                        criterion="width of a diffraction image over pixel",
                        number=1.0 / (scene.cutoff * scene.path.pixels.pitch),
                        reason="one sample at the centre stands for the whole pixel",
                    )
                },
            ),
            Model(name="square", bounds={"pixel_intensity": complete()}),
        ),
    )
