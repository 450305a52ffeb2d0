"""The numbers that tell how strong the effects of a picture are, whether they reach depth or not."""

from __future__ import annotations

import math

from tradestudy.effects.base import EffectCriterion


def blur_over_pixel(value: float, at: float) -> EffectCriterion:
    """Of the geometric blur."""
    return EffectCriterion(
        words="blur over pixel",
        definition="c/p; c the diameter of the geometric blur circle on the sensor, of both lenses together, p the "
        "pitch of the picture's samples: pixels, or microlenses for views of an unfocused plenoptic camera; "
        "diffraction is not in it",
        value=value,
        at=at,
    )


def main_lens_airy(value: float, at: float) -> EffectCriterion:
    """Of the main lens, as its picture arrives on the sensor."""
    return EffectCriterion(
        words="Airy radius of the main lens over pixel",
        definition="1.22 λ N M/p; N the working f-number, M the magnification by microlenses behind it or 1, p the "
        "pitch of the picture's samples",
        value=value,
        at=at,
    )


def microlens_airy(value: float, at: float) -> EffectCriterion:
    """Of a microlens."""
    return EffectCriterion(
        words="Airy radius of a microlens over pixel",
        definition="1.22 λ b/(D p); b from the array to the sensor, D the aperture of a microlens, p the pixel pitch",
        value=value,
        at=at,
    )


def reach_over_airy(value: float, at: float) -> EffectCriterion:
    """Of a micro-image."""
    return EffectCriterion(
        words="half a micro-image over Airy radius",
        definition="w/(2 · 1.22 λ b/D); w the width of a micro-image, b and D as for the Airy radius of a microlens",
        value=value,
        at=at,
    )


def pixel_over_pitch() -> EffectCriterion:
    """Of the samples."""
    return EffectCriterion(
        words="pixel over pitch",
        definition="side of the square that a pixel collects from, over the distance of neighbouring pixels",
        value=1.0,
    )


def extent_of_points() -> EffectCriterion:
    """Of the texture, which has no value."""
    return EffectCriterion(
        words="extent of a point", definition="none: points of a texture have no extent", value=math.nan
    )


def spectrum_width(value: float) -> EffectCriterion:
    """Of the declared spectrum."""
    return EffectCriterion(
        words="width of the spectrum over its centre",
        definition="(longest − shortest wavelength)/central wavelength",
        value=value,
    )


def light_left(value: float) -> EffectCriterion:
    """At the field angle that depth is asked for."""
    return EffectCriterion(
        words="light left at the field angle",
        definition="cos⁴ θ times the share of the pupil that the stops leave at the field angle θ that depth is asked "
        "for; 1 on the axis",
        value=value,
    )


def electrons(value: float, at: float) -> EffectCriterion:
    """Of the darkest pixel."""
    return EffectCriterion(
        words="electrons per pixel", definition="mean number in the darkest pixel that is asked for", value=value, at=at
    )
