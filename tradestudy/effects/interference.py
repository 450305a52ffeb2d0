"""How much the light of several microlenses that meets on a pixel may interfere."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.picture_change import disc_envelope
from tradestudy.optics.arrays import FloatArray

_AIRY_TAIL: Final = 2.0 / math.pi**2  # share of an Airy pattern of cutoff f_c outside the radius m, times f_c m


def light_behind_neighbours(scene: LightScene) -> float:
    """Upper bound on the light that leaves its microlens's cell, relative L2 over the picture.

    A ray that lands behind a neighbour is there with all its light. One that lands the margin m inside its own cell
    sends by diffraction at an aperture of cutoff f_c at most the share 2/(π² f_c m) beyond its border: all of an Airy
    pattern that is farther from its middle, whichever side it is on.
    """
    return math.sqrt(float(np.mean(_shares_outside(scene) ** 2)))


def interference_change(scene: LightScene) -> float:
    """Relative L2 that interference of own and foreign light makes on the picture: 2 √(own · foreign) · contrast."""
    return 2.0 * math.sqrt(float(np.mean(_shares_outside(scene)))) * fringe_contrast(scene)


def _shares_outside(scene: LightScene) -> FloatArray:
    """Share of the light of every ray that diffraction carries out of its cell; 0 where no ray passes."""
    margins = scene.margins
    if not margins.size:
        return np.zeros(1)
    within = np.maximum(margins, _AIRY_TAIL / scene.cutoff)  # closer to the border no more than all of it leaves
    return np.asarray(np.where(margins < 0.0, 1.0, _AIRY_TAIL / (scene.cutoff * within)))


def fringe_contrast(scene: LightScene) -> float:
    """What is left of fringes between neighbouring microlenses after pixel and source have averaged them.

    Their frequency is pitch/(λ b_L); a pixel leaves at most 1/(π f p), a disc of radius r the
    envelope of 2 J₁(x)/x, x = 2π f r.
    """
    pixel = 1.0 / (math.pi * _fringe_frequency(scene) * scene.path.pixels.pitch)
    return min(1.0, pixel) * _contrast_by_source(scene)


def sampled_fringes(scene: LightScene) -> float:
    """Relative L2 of the fringes that samples keep and pixels average."""
    return 2.0 * math.sqrt(float(np.mean(_shares_outside(scene)))) * _contrast_by_source(scene)


def _contrast_by_source(scene: LightScene) -> float:
    return float(disc_envelope(2.0 * math.pi * _fringe_frequency(scene) * scene.spot_radius))


def _fringe_frequency(scene: LightScene) -> float:
    return scene.path.microlenses.pitch / (scene.wavelength * scene.path.detector_distance)
