"""How much the light of several microlenses that meets on a pixel may interfere."""

from __future__ import annotations

import math

import numpy as np

from tradestudy.effects.light_scene import LightScene
from tradestudy.optics.arrays import FloatArray


def light_behind_neighbours(scene: LightScene) -> float:
    """Upper bound on the light that leaves its microlens's cell, relative L2 over the picture.

    A ray that lands behind a neighbour is there with all its light. One that lands the margin m inside its own cell
    sends the share 2/(π² f_c m) beyond its border by diffraction at an aperture of cutoff f_c, of which at most half
    to that side.
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
    inside = np.maximum(margins, 0.2 / scene.cutoff)
    return np.asarray(np.where(margins < 0.0, 1.0, 0.2 / (scene.cutoff * inside)))


def fringe_contrast(scene: LightScene) -> float:
    """What is left of fringes between neighbouring microlenses after pixel and source have averaged them.

    Their frequency is pitch/(λ b_L); a pixel leaves at most 1/(π f p), a disc of radius r 1.6/(2π f r)^{3/2}.
    """
    pixel = 1.0 / (math.pi * _fringe_frequency(scene) * scene.path.pixels.pitch)
    return min(1.0, pixel) * _contrast_by_source(scene)


def sampled_fringes(scene: LightScene) -> float:
    """Relative L2 of the fringes that samples keep and pixels average."""
    return 2.0 * math.sqrt(float(np.mean(_shares_outside(scene)))) * _contrast_by_source(scene)


def _contrast_by_source(scene: LightScene) -> float:
    x = max(2.0 * math.pi * _fringe_frequency(scene) * scene.spot_radius, 1e-9)
    return min(1.0, 1.6 / math.pow(x, 1.5))


def _fringe_frequency(scene: LightScene) -> float:
    return scene.path.microlenses.pitch / (scene.wavelength * scene.path.detector_distance)
