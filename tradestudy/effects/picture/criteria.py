"""The numbers that tell how strong the effects of a picture are, whether they reach depth or not.

Each takes its value and, where it belongs to a distance, ``at``.
"""

from __future__ import annotations

import math
from functools import partial

from tradestudy.effects.base import EffectCriterion

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
