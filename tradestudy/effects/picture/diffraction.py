"""Diffraction in the picture, at the main lens or at the microlenses: the two slots share their models."""

from __future__ import annotations

import math
from typing import Final, Literal

from tradestudy.effects.base import OFF, Model, Slot
from tradestudy.effects.picture.trial import MARGIN, PictureTrial, bounded

# Numerical error of a transfer by Kirchhoff, which Fresnel's is held against.
_TRANSFER_ERROR: Final = 1e-4


def diffraction(trial: PictureTrial, at: Literal["main_lens_diffraction", "microlens_diffraction"]) -> Slot:
    """Off, the Airy pattern beside the blur disc, the defocused pupil by Fresnel, or by Kirchhoff's exact paths.

    What Kirchhoff adds to Fresnel is bounded by the path that parabolic waves leave out, which balanced is a defocus,
    and by the fall ε of the amplitude towards the rim, which about its mean leaves ± ε/2.
    """
    stage = 0 if at == "main_lens_diffraction" else 1
    airy = (trial.main_lens_airy_px, trial.microlens_airy_px)[stage]
    waves = trial.aberration_waves[stage]
    if math.isnan(airy):
        absent = "this camera's picture is formed without microlenses between it and the scene"
        return Slot(name=at, models=(bounded(trial, OFF, 0.0, "Airy radius over pixel", math.nan, absent),))
    left_out = MARGIN * trial.paraxial_change[stage] + trial.obliquity[stage] / 2.0 + _TRANSFER_ERROR
    spread, paths = "Airy radius over pixel", "waves between exact and parabolic paths"

    def held_against_fresnel(name: str, reason: str) -> Model:
        return bounded(trial, name, MARGIN * trial.change(at, name) + left_out, spread, airy, reason)

    return Slot(
        name=at,
        models=(
            held_against_fresnel(
                OFF, "an Airy pattern smaller than a pixel takes little of the texture that a matcher uses"
            ),
            held_against_fresnel("airy", "disc times Airy misses how defocus and diffraction act together"),
            bounded(trial, "fresnel", left_out, paths, waves,
                    "parabolic waves in place of spherical ones leave out the path of this many waves at the rim"),
            bounded(trial, "kirchhoff", 0.0, paths, waves,
                    "exact paths and cosines: the most complete model here"),
        ),
    )  # fmt: skip
