"""Every slot of a picture: what each of its models would do to the disparity error that is derived from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, Literal

from tradestudy.effects.base import OFF, EffectCriterion, Model, Slot, SlotName
from tradestudy.effects.picture.criteria import (
    EXTENT_OF_POINTS,
    PIXEL_OVER_PITCH,
    blur_over_pixel,
    electrons,
    light_left,
    main_lens_airy,
    microlens_airy,
    reach_over_airy,
    spectrum_width,
)
from tradestudy.effects.picture.trial import MARGIN, PictureTrial, bounded, weighed


def defocus_blur(trial: PictureTrial) -> Slot:
    """Off or the disc; where diffraction is by waves, the defocus belongs to it."""
    blur = blur_over_pixel(value=trial.blur_px.value, at=trial.blur_px.at)
    return Slot(
        name="defocus_blur",
        models=(
            weighed(trial, "defocus_blur", OFF, blur,
                    "blur takes texture from a matcher, below a pixel as the square of this number: it counts unless "
                    "it is well below 1 at every distance"),
            weighed(trial, "defocus_blur", "disc", blur, "the disc is the most complete model of defocus here"),
        ),
    )  # fmt: skip


_RULE: Final = (
    "leaving this share of the noise power out lowers noise by half of it, and the bound is twice the largest "
    "change at the distances tried: it fits where this number is below the accuracy wanted, alone and with the other "
    "omissions"
)
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
    spread = (main_lens_airy, microlens_airy)[stage](value=airy.value, at=airy.at)
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


def crosstalk(trial: PictureTrial) -> Slot:
    """Off: a window sees its own microlens only; share: what neighbours spread into it dims the texture and is noise.

    In the middle of a micro-image of radius r the share is what an Airy pattern holds outside, ``2/(π v)``,
    v = π r/(λN) = 1.22 π r/(Airy radius), about 0.17 over the criterion; towards its edge it is more.
    """
    reach = trial.microlens_reach_airy
    criterion = reach_over_airy(value=math.nan if math.isinf(reach.value) else reach.value, at=reach.at)
    if math.isinf(reach.value):
        reason = "there are no micro-images side by side"
        return Slot(name="crosstalk", models=(bounded(trial, OFF, 0.0, criterion, reason),))
    return Slot(
        name="crosstalk",
        models=(
            weighed(trial, "crosstalk", OFF, criterion,
                    "in the middle of a micro-image neighbours bring 0.17 over this number of the light, towards its "
                    "edge more: it counts unless that is well below the accuracy wanted"),
            weighed(trial, "crosstalk", "share", criterion,
                    "the share of neighbours in a window, dimming its texture and adding theirs: the most complete "
                    "model here"),
        ),
    )  # fmt: skip


def pixel_integration(trial: PictureTrial) -> Slot:
    """Off: the picture at the pixels' centres; square: its mean over each of them."""
    return Slot(
        name="pixel_integration",
        models=(
            weighed(trial, "pixel_integration", OFF, PIXEL_OVER_PITCH,
                    "the mean over a pixel dims the finest texture that the pixels resolve by a third: it counts "
                    "unless blur and diffraction have taken that texture before"),
            weighed(trial, "pixel_integration", "square", PIXEL_OVER_PITCH,
                    "the mean over the active pixel is exact"),
        ),
    )  # fmt: skip


def source_extent(trial: PictureTrial) -> Slot:
    """Off: the texture is the source, point by point."""
    reason = "every point of the texture is a source of its own; none has an extent"
    return Slot(name="source_extent", models=(bounded(trial, OFF, 0.0, EXTENT_OF_POINTS, reason),))


def spectrum(trial: PictureTrial) -> Slot:
    """Off: the central wavelength; weighted: the mean transfer over the spectrum, where one is declared."""
    width = spectrum_width(value=trial.spectrum_width)
    if math.isnan(trial.spectrum_width):
        reason = "the study declares one wavelength"
        return Slot(name="spectrum", models=(bounded(trial, OFF, 0.0, width, reason),))
    return Slot(
        name="spectrum",
        models=(
            weighed(trial, "spectrum", OFF, width,
                    "diffraction grows in proportion to wavelength, so that colours either side of the centre nearly "
                    "cancel: what is left counts where diffraction does and the spectrum is wide or one-sided"),
            weighed(trial, "spectrum", "weighted", width, "the mean over the declared wavelengths"),
        ),
    )  # fmt: skip


def vignetting(trial: PictureTrial) -> Slot:
    """Off, or cos⁴ with the stops at the field angle where depth is asked for."""
    left = light_left(value=trial.illumination)
    return Slot(
        name="vignetting",
        models=(
            weighed(trial, "vignetting", OFF, left,
                    "the share of light that is lost raises noise over signal by half of itself or more, and the "
                    "bound is twice the largest change at the distances tried: nothing is left out where this number "
                    "is 1, on the axis"),
            weighed(trial, "vignetting", "cos4", left, "cos⁴ and the overlap of the stops are closed forms"),
        ),
    )  # fmt: skip


def sensor_noise(trial: PictureTrial) -> Slot:
    """Off is listed and never fits: without noise a matcher would make no error."""
    slot: SlotName = "sensor_noise"
    both = EffectCriterion(
        words="read and rounding noise over all",
        definition="(σ² of reading + step²/12)/(electrons + σ² of reading + step²/12) in the darkest pixel, step the "
        "electrons of one digital number",
        value=trial.read_noise_share + trial.quantisation_share,
    )
    rounding = EffectCriterion(
        words="rounding noise over all",
        definition="step²/12 over the same sum",
        value=trial.quantisation_share,
    )
    return Slot(
        name=slot,
        models=(
            bounded(trial, OFF, math.inf, electrons(value=trial.electrons.value, at=trial.electrons.at),
                    "noise is what makes a matcher err; without it there is no disparity error to speak of"),
            weighed(trial, slot, "shot", both, _RULE),
            weighed(trial, slot, "shot+read", rounding, _RULE),
            weighed(trial, slot, "shot+read+quantisation", rounding,
                    "shot, read and rounding noise: the most complete model here"),
        ),
    )  # fmt: skip
