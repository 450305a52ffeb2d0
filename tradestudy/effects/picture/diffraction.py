"""Diffraction in the picture, at the main lens or at the microlenses: the two slots share their models."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, Literal

from tradestudy.effects.base import OFF, EffectCriterion, Model, Slot
from tradestudy.effects.picture.criteria import main_lens_airy, microlens_airy
from tradestudy.effects.picture.trial import MARGIN, PictureTrial, bounded

# Numerical error of a transfer by Kirchhoff, which Fresnel's is held against.
_TRANSFER_ERROR: Final = 1e-4
_PATHS: Final[Mapping[str, str]] = {
    "parabolic": "R⁴/(8 λ) (1/b³ + 1/a³), for a parabolic lens",
    "perfect": "R⁴/(8 λ) |1/b³ − (1/f − 1/a)³|, for a lens of exact paths",
}


def diffraction(trial: PictureTrial, at: Literal["main_lens_diffraction", "microlens_diffraction"]) -> Slot:
    """Off, the Airy pattern beside the blur disc, the defocused pupil by Fresnel, or by Kirchhoff's exact paths.

    What Kirchhoff adds to Fresnel is bounded by the path that parabolic waves leave out, which balanced is a defocus,
    and by what the angle θ of the rays at the rim does: amplitude falls by ε = sin² θ towards it, and the cutoff is
    2 sin θ/λ, ε/2 below 1/(λ N). Together they take ε more, in logarithms, of what diffraction takes from contrast, to
    a tenth of that below 0.6 of the cutoff; so they add ε of what it adds to the error, with the margin for the rest.
    """
    stage = 0 if at == "main_lens_diffraction" else 1
    airy = (trial.main_lens_airy_px, trial.microlens_airy_px)[stage]
    spread = (main_lens_airy, microlens_airy)[stage](airy.value, airy.at)
    if math.isnan(airy.value):
        absent = "this camera's picture is formed without microlenses between it and the scene"
        return Slot(name=at, models=(bounded(trial, OFF, 0.0, spread, absent),))
    waves = trial.aberration_waves[stage]
    paths = EffectCriterion(
        words="waves between exact and parabolic paths",
        definition=f"{' or '.join(_PATHS[phase] for phase in trial.lens_phases)}; R the radius of the aperture, f the "
        "focal length, a and b the distances to the object and to the plane of the picture",
        value=waves.value,
        at=waves.at,
    )
    rim = trial.obliquity[stage] * min(1.0, trial.change(at, OFF))
    left_out = MARGIN * (trial.paraxial_change[stage] + rim) + _TRANSFER_ERROR

    def held_against_fresnel(name: str, reason: str) -> Model:
        return bounded(trial, name, MARGIN * trial.change(at, name) + left_out, spread, reason)

    return Slot(
        name=at,
        models=(
            held_against_fresnel(
                OFF, "diffraction takes texture from a matcher, below a pixel in proportion to this number: it counts "
                "unless it is far below 1 at every distance, or defocus has taken that texture before"
            ),
            held_against_fresnel(
                "airy", "the transfer of the disc times that of Airy misses how defocus and diffraction act together: "
                "it counts unless one of the two is well below a pixel"
            ),
            bounded(trial, "fresnel", left_out, paths,
                    "parabolic waves in place of spherical ones leave out the path of this many waves at the rim, "
                    "which blurs as so much more defocus: in focus it counts from a quarter on, and from ever less "
                    "where defocus has taken most of the texture; and that rays at the rim weigh sin² θ less, about "
                    "1/(4 N²), which counts as that share of what diffraction does"),
            bounded(trial, "kirchhoff", 0.0, paths,
                    "exact paths and cosines: the most complete model here", beforehand=trial.lattice_seconds[stage]),
        ),
    )  # fmt: skip
