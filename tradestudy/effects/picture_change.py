"""How far a change of the transfer function moves the pixels of a picture, by Parseval over spatial frequency.

Every effect multiplies its closed forms by a factor of safety of its own, for what they leave out: microlenses that are
lit in part, rings that the detector cuts. The factors come from random light paths;
`python -m tests.campaigns.light_bounds` holds them against others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Final

import numpy as np
from scipy.special import j0, j1

from tradestudy.accuracy import Quantity
from tradestudy.effects.base import Bound, EffectCriterion, Model
from tradestudy.effects.light_scene import LawDifference, LightScene
from tradestudy.imaging.transfer import disc_transfer
from tradestudy.optics.arrays import FloatArray

_POINTS: Final = 600
_SCENES: Final = 8  # whose numbers are kept
_ENVELOPE: Final = 1.651
_AIRY_TAIL: Final = 2.0 / math.pi**2  # share of an Airy pattern of cutoff f_c outside the radius m, times f_c m
_EDGE_WAVE: Final = (
    1.0 / math.pi
)  # ∫ |U − U_rays|² dv at a straight edge, v = x √(2/(λ z)); the intensity's is the same


@lru_cache(maxsize=_SCENES)
def frequencies(scene: LightScene) -> FloatArray:
    """Frequencies on the detector from far below the width of the picture to far above what a pixel passes [1/m].

    Shared and read-only.
    """
    widest = max(scene.spot_radius, scene.blur_on_detector, scene.path.pixels.pitch)
    found = np.geomspace(1e-2 / widest, 4.0 / scene.path.pixels.pitch + 4.0 / widest, _POINTS)
    found.setflags(write=False)
    return found


def aperture_transfer(scene: LightScene, f: FloatArray) -> FloatArray:
    """Transfer function of the lit part of one microlens without aberration: what none of that width exceeds."""
    s = np.minimum(f / scene.cutoff, 1.0)
    return np.asarray(2.0 / math.pi * (np.arccos(s) - s * np.sqrt(1.0 - s**2)))


def disc_envelope(x: FloatArray | float) -> FloatArray:
    """What |2 J₁(x)/x| never exceeds: 1 and c/x^{3/2}; far out c = 2 √(2/π) = 1.596 would do, x = 2.17 needs 1.651."""
    return np.asarray(np.minimum(1.0, _ENVELOPE / np.maximum(x, 1e-9) ** 1.5))


def pixel_transfer(scene: LightScene, f: FloatArray) -> FloatArray:
    """Of a pixel, for all directions alike: that of a disc of its area."""
    return disc_transfer(f, 2.0 * scene.path.pixels.pitch / math.sqrt(math.pi))


def source_transfer(scene: LightScene, f: FloatArray) -> FloatArray:
    """Of the image of the source behind one microlens."""
    return disc_transfer(f, 2.0 * scene.spot_radius)


def lit_transfer(scene: LightScene, *, source: bool = True, pixels: bool = True) -> FloatArray:
    """What source, defocus, aperture and pixel leave of every frequency, at most; without some if asked.

    Defocus leaves the envelope of 2 J₁(x)/x, and rings, which hold the share η² of the light's square
    over all frequencies up to the cutoff: η/(2π N) of each, four times that where the detector cuts the picture.
    """
    f = frequencies(scene)
    zones = max(scene.microlens_fresnel_number, 1e-9)
    defocused = disc_envelope(2.0 * math.pi * f * scene.least_blur_on_detector)
    blurred = np.minimum(1.0, defocused + 2.0 * edge_wave(zones) / (math.pi * zones))
    left = blurred * aperture_transfer(scene, f)
    if source:
        left = left * source_transfer(scene, f)
    return np.asarray(left * pixel_transfer(scene, f) if pixels else left)


def picture_change(scene: LightScene, change: FloatArray) -> float:
    """Relative L2 over the picture of one microlens of a change of its transfer function.

    √(∫ |change|² f df / ∫ |picture|² f df): Parseval's theorem, source and pixel in both, or as the caller has it.

    Parameters
    ----------
    scene
        Light path and source.
    change
        Largest change of the picture's spectrum at `frequencies`, relative to its value at zero.
    """
    f = frequencies(scene)
    # f df = f² d ln f on the logarithmic grid
    return math.sqrt(float(np.trapezoid(f**2 * change**2, np.log(f)))) / _norm(scene)


def peak_change(scene: LightScene, change: FloatArray) -> float:
    """The same change all in the one pixel in whose centre all frequencies are in phase: p ∫ change 2π f df."""
    f = frequencies(scene)
    peak = float(np.trapezoid(f**2 * np.abs(change), np.log(f)))
    return math.sqrt(2.0 * math.pi) * scene.path.pixels.pitch * peak / _norm(scene)


@lru_cache(maxsize=_SCENES)
def _norm(scene: LightScene) -> float:
    """√∫ |picture|² f df of the most complete models, at least: defocus and displacement of rays blur it besides."""
    f = frequencies(scene)
    law = math.hypot(_finite(scene.main_law.displacement), _finite(scene.detector_law.displacement))
    aberration = np.exp(-(np.minimum(math.pi * f * law, 10.0) ** 2))
    picture = aperture_transfer(scene, f) * source_transfer(scene, f) * pixel_transfer(scene, f)
    picture = picture * disc_transfer(f, 2.0 * scene.blur_on_detector) * aberration
    # what lies below the first frequency is a whole disc of them
    return math.sqrt(float(np.trapezoid(f**2 * picture**2, np.log(f)) + f[0] ** 2 / 2.0))


def edge_wave(fresnel_number: float) -> float:
    """Relative L2 of what diffraction at the rim of a disc adds to its light: (√2/π)^½ N^{-1/4}, at most 1.

    Over the width of the disc's shadow the edge wave ∫ |U − U_rays|² dv = 1/π stands on the rim of length 2π ρ, with
    v = √(2N) at the distance ρ.
    """
    if fresnel_number <= 0.0:
        return 1.0
    return min(1.0, math.sqrt(math.sqrt(2.0) * _EDGE_WAVE) * math.pow(fresnel_number, -0.25))


def rim_share(scene: LightScene) -> float:
    """Share of the rim's wave in the field on the microlenses: η over the whole shadow, or more about its axis.

    There the whole rim is in phase, and its wave as strong as the light: J₀(k R r/z) at the distance r, whose square
    has the mean J₀² + J₁² over a disc. A source that moves the shadow is left to `rim_light`.
    """
    path, lenses = scene.path, scene.path.microlenses
    aside = np.linalg.norm(lenses.centres - np.asarray(path.chief_point(scene.source.centre)), axis=1)
    farthest = max(float(np.min(aside)), lenses.aperture_width / 2.0)
    x = 2.0 * math.pi / scene.wavelength * path.main_lens.radius / path.array_distance * farthest
    return max(edge_wave(scene.main_fresnel_number), math.sqrt(float(j0(x) ** 2 + j1(x) ** 2)))


def rim_light(scene: LightScene) -> float:
    """Share of the rim's wave in the field on the microlenses, less where source and pixel average it.

    It turns by k R/z per metre of the array. On one pixel falls light of that part of the source whose image it is,
    which moves the pupil's shadow by r; of fringes that fine a disc of radius r leaves 2 J₁(x)/x, x = k R r/z.
    """
    path, source = scene.path, scene.source
    moved = source.diameter / 2.0 * path.array_distance / source.distance
    seen = min(1.0, path.pixels.pitch / math.sqrt(math.pi) / max(scene.spot_radius, 1e-12))
    x = 2.0 * math.pi / scene.wavelength * path.main_lens.radius / path.array_distance * moved * seen
    return rim_share(scene) * float(disc_envelope(x))


def law_change(scene: LightScene, law: LawDifference) -> float:
    """Change of the picture by another law: rays land elsewhere by δ, which turns phases by min(2, 2π f δ), or fade."""
    turned = np.minimum(2.0, 2.0 * math.pi * frequencies(scene) * _finite(law.displacement))
    return picture_change(scene, turned * lit_transfer(scene)) + law.brightness


def bound_of(scene: LightScene, change: float, *, criterion: EffectCriterion, reason: str) -> Mapping[Quantity, Bound]:
    """The bound on pixels; infinite, with why, where rays and widths say nothing."""
    why = scene.why_unbounded
    change = math.inf if why or not math.isfinite(change) else change
    return {"pixel_intensity": Bound(relative_change=change, criterion=criterion, reason=why if why else reason)}


def fresnel_law(scene: LightScene, law: LawDifference, change: float, *, lens: str, aberration: str) -> Model:
    """Fresnel's law at a lens, and the change by what it leaves out of its paths."""
    return Model(
        name="fresnel",
        bounds=bound_of(
            scene,
            change,
            criterion=EffectCriterion(
                words=f"displacement of rays by the {lens} over pixel",
                definition="δ/p; δ the root mean square by which rays land elsewhere on the detector by exact than by "
                "parabolic paths, p the pixel pitch",
                value=law.displacement / scene.path.pixels.pitch,
            ),
            reason=f"second-order paths leave out {aberration}, which moves light so far: it counts unless that is "
            "well below a pixel, or the picture has no detail as fine",
        ),
    )


def diffraction_width(scene: LightScene) -> EffectCriterion:
    """Of the image that diffraction at a microlens makes of a point."""
    return EffectCriterion(
        words="width of a diffraction image over pixel",
        definition="λ b/(w p); b from the array to the detector, w the width of a microlens that is lit, p the pixel "
        "pitch",
        value=1.0 / (scene.cutoff * scene.path.pixels.pitch),
    )


def _finite(displacement: float) -> float:
    """A displacement without bound turns every phase, which a metre does too."""
    return min(displacement, 1.0)


def light_behind_neighbours(scene: LightScene) -> float:
    """Upper bound on the light that leaves its microlens's cell, relative L2 over the picture.

    A ray that lands behind a neighbour is there with all its light. One that lands the margin m inside its own cell
    sends by diffraction at an aperture of cutoff f_c at most the share 2/(π² f_c m) beyond its border: all of an Airy
    pattern that is farther from its middle, whichever side it is on.
    """
    return math.sqrt(float(np.mean(_shares_outside(scene) ** 2)))


def interference_change(scene: LightScene, *, pixels: bool = True) -> float:
    """Relative L2 that interference of own and foreign light makes on the picture: 2 √(own · foreign) · contrast.

    The contrast is what pixel and source leave of fringes between neighbouring microlenses by averaging them, or the
    source alone where pixels are sampled. Their frequency is pitch/(λ b_L); a pixel leaves at most 1/(π f p), a disc of
    radius r the envelope of 2 J₁(x)/x, x = 2π f r.
    """
    frequency = scene.path.microlenses.pitch / (scene.wavelength * scene.path.detector_distance)
    contrast = float(disc_envelope(2.0 * math.pi * frequency * scene.spot_radius))
    if pixels:
        contrast *= min(1.0, 1.0 / (math.pi * frequency * scene.path.pixels.pitch))
    return 2.0 * math.sqrt(float(np.mean(_shares_outside(scene)))) * contrast


def _shares_outside(scene: LightScene) -> FloatArray:
    """Share of the light of every ray that diffraction carries out of its cell; 0 where no ray passes."""
    margins = scene.margins
    if not margins.size:
        return np.zeros(1)
    within = np.maximum(margins, _AIRY_TAIL / scene.cutoff)  # closer to the border no more than all of it leaves
    return np.asarray(np.where(margins < 0.0, 1.0, _AIRY_TAIL / (scene.cutoff * within)))
