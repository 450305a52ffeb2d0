"""The spectrum of the light: all wavelengths, or their mean alone."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from tradestudy.effects.base import OFF, EffectCriterion, Model, Slot
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.picture_change import (
    aperture_transfer,
    bound_of,
    complete,
    edge_wave,
    frequencies,
    lit_transfer,
    picture_change,
    pixel_transfer,
    rim_light,
    source_transfer,
)
from tradestudy.optics.arrays import FloatArray

_SAFETY: Final = 2.0  # see `picture_change`


def spectrum_in_picture(scene: LightScene, *, wavelengths: FloatArray, weights: FloatArray) -> Slot:
    """Light of the scene's wavelength alone, or of several with their weights; one model where there is but one.

    The mean wavelength's transfer function differs from the weighted one by what the cutoff moves; the wave from a rim
    with N Fresnel zones turns by π N δλ/λ against the rest, and rings wash out by the square of that.
    """
    if wavelengths.size == 1:
        return Slot(name="spectrum", models=(Model(name=OFF, bounds=complete()),))
    f, share = frequencies(scene), weights / weights.sum()
    moved = sum(
        s * aperture_transfer(replace(scene, wavelength=float(w)), f) for s, w in zip(share, wavelengths, strict=True)
    )
    width = math.sqrt(float(share @ (wavelengths / scene.wavelength - 1.0) ** 2))
    rims = (
        (rim_light(scene), scene.main_fresnel_number),
        (edge_wave(scene.microlens_fresnel_number), scene.microlens_fresnel_number),
    )
    washed = sum(rim * min(1.0, (math.pi * (zones + 0.5) * width) ** 2 / 2.0) for rim, zones in rims)
    passed = source_transfer(scene, f) * pixel_transfer(scene, f)
    change = np.abs(moved - aperture_transfer(scene, f)) * passed + washed * lit_transfer(scene)
    return Slot(
        name="spectrum",
        models=(
            Model(
                name=OFF,
                bounds=bound_of(
                    scene,
                    _SAFETY * picture_change(scene, change),
                    criterion=EffectCriterion(
                        words="width of the spectrum over its mean wavelength",
                        definition="√(Σ s (λ/λ_mean − 1)²); s the share of the light at the wavelength λ",
                        value=width,
                    ),
                    reason="the rings of one wavelength stand for those of all, which wash out by the square of π "
                    "times this number times the Fresnel number: they count unless that product is well below 1",
                ),
            ),
            Model(name="weighted", bounds=complete()),
        ),
    )
