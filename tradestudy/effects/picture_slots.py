"""Slots of a picture that depth is measured from: what each model would do to the disparity error derived from it.

The numbers that tell how strong an effect is hold whether it reaches depth or not; each takes its value and, where it
belongs to a distance, ``at``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal

from tradestudy.accuracy import Quantity
from tradestudy.effects.base import OFF, Bound, EffectCriterion, Model, Slot, SlotName

# Trials are made at some of the distances and with one slot changed at a time; what lies in between, and what two
# slots do together beyond the sum of each, has to fit into this factor.
MARGIN: Final = 2.0
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

blur_over_pixel = partial(
    EffectCriterion,
    words="blur over pixel",
    definition="c/p; c the diameter of the geometric blur circle on the sensor, of both lenses together, p the "
    "pitch of the picture's samples: pixels, or microlenses for views of an unfocused plenoptic camera; "
    "diffraction is not in it",
)
main_lens_airy = partial(
    EffectCriterion,
    words="Airy radius of the main lens over pixel",
    definition="1.22 λ N M/p; N the working f-number, M the magnification by microlenses behind it or 1, p the "
    "pitch of the picture's samples",
)
microlens_airy = partial(
    EffectCriterion,
    words="Airy radius of a microlens over pixel",
    definition="1.22 λ b/(D p); b from the array to the sensor, D the aperture of a microlens, p the pixel pitch",
)
reach_over_airy = partial(
    EffectCriterion,
    words="half a micro-image over Airy radius",
    definition="w/(2 · 1.22 λ b/D); w the width of a micro-image, b and D as for the Airy radius of a microlens",
)
PIXEL_OVER_PITCH = EffectCriterion(
    words="pixel over pitch",
    definition="side of the square that a pixel collects from, over the distance of neighbouring pixels",
    value=1.0,
)
EXTENT_OF_POINTS = EffectCriterion(
    words="extent of a point", definition="none: points of a texture have no extent", value=math.nan
)
spectrum_width = partial(
    EffectCriterion,
    words="width of the spectrum over its centre",
    definition="(longest − shortest wavelength)/central wavelength",
)
light_left = partial(
    EffectCriterion,
    words="light left at the field angle",
    definition="cos⁴ θ times the share of the pupil that the stops leave at the field angle θ that depth is asked "
    "for; 1 on the axis",
)
electrons = partial(
    EffectCriterion, words="electrons per pixel", definition="mean number in the darkest pixel that is asked for"
)


@dataclass(frozen=True, kw_only=True)
class Worst:
    """The worst value over all places, and the distance where it stands [m]; NaN where it belongs to none."""

    value: float
    at: float = math.nan


@dataclass(frozen=True, kw_only=True)
class PictureTrial:
    """How a derived disparity error moves with each model, and the numbers that tell why.

    Parameters
    ----------
    change
        Relative change of the disparity error, the largest over usable distances and variants of the study, if one
        slot takes a model in place of the most complete one that is in closed form.
    blur_px
        Largest geometric blur [samples].
    main_lens_airy_px, microlens_airy_px
        Largest radius of the first dark ring of either lens on the sensor [samples]; NaN without such a stage.
    lens_phases
        ``parabolic`` or ``perfect``: how lenses bend light by Kirchhoff's model, under some variant of the study.
    aberration_waves
        Largest path [waves] by which the exact spherical waves of the main lens, and of a microlens, depart from the
        parabolic ones of Fresnel at the rim.
    paraxial_change
        Relative change of the disparity error that these waves make as a defocus, for either lens.
    obliquity
        ``sin² θ`` of the rays at the rim of either lens on their way to its picture: what amplitude loses from axis to
        rim.
    electrons
        Fewest per pixel.
    illumination
        cos⁴ and stops at the field angle asked for; 1 on the axis.
    read_noise_share, quantisation_share
        Of the noise power, the largest.
    spectrum_width
        (longest − shortest wavelength)/central.
    microlens_reach_airy
        Half a micro-image over the Airy radius of a microlens, the smallest; infinite without microlenses.
    depth_change
        Relative change of the depth uncertainty that such a one of the disparity error makes at most, the largest over
        every distance that counts: more than it where the far end of depth runs away, infinite where that is lost.
    seconds
        Predicted cost [s] of a model by name.
    lattice_seconds
        What Kirchhoff's transfer takes beforehand for either lens [s].
    """

    change: Callable[[SlotName, str], float]
    blur_px: Worst
    main_lens_airy_px: Worst
    microlens_airy_px: Worst
    lens_phases: Sequence[str]
    aberration_waves: tuple[Worst, Worst]
    paraxial_change: tuple[float, float]
    obliquity: tuple[float, float]
    electrons: Worst
    illumination: float
    read_noise_share: float
    quantisation_share: float
    spectrum_width: float
    microlens_reach_airy: Worst
    depth_change: Callable[[float], float]
    seconds: Callable[[str], float]
    lattice_seconds: tuple[float, float]


def weighed(trial: PictureTrial, slot: SlotName, name: str, criterion: EffectCriterion, reason: str) -> Model:
    """A model whose bound is its trial with the margin."""
    return bounded(trial, name, MARGIN * trial.change(slot, name), criterion, reason)


def bounded(
    trial: PictureTrial, name: str, change: float, criterion: EffectCriterion, reason: str, *, beforehand: float = 0.0
) -> Model:
    """A model whose bound on the disparity error was found otherwise, with what it takes beforehand [s]."""
    quantity: Quantity = "depth_uncertainty"
    found = trial.depth_change(change)
    if math.isinf(found) and math.isfinite(change):
        reason += f"; a disparity error off by {100 * change:.0f} %, its bound, loses the far end of depth somewhere"
    bound = Bound(relative_change=found, criterion=criterion, reason=reason)
    return Model(name=name, bounds={quantity: bound}, seconds=trial.seconds(name) + beforehand)


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
