"""How much the light of several microlenses that meets on a pixel may interfere."""

from __future__ import annotations

import math

import numpy as np

from tradestudy.effects.light_scene import LightScene


def light_behind_neighbours(scene: LightScene) -> float:
    """Upper bound on the light that leaves its microlens's cell, relative L2 over the picture.

    Rays that land behind a neighbour count by the root of their share. Where none do, diffraction sends the share
    2 λ N/(π² m) beyond the margin m, where its intensity per power is at most λ N/(π³ m³).
    """
    margins = scene.margins
    if math.isinf(np.min(margins, initial=math.inf)):
        return 0.0
    outside = float(np.mean(margins < 0.0))
    if outside > 0.0:
        return math.sqrt(outside / max(1.0 - outside, outside))
    margin = max(float(margins.min()), 1.0 / scene.cutoff)
    share = 2.0 / (math.pi**2 * scene.cutoff * margin)
    size = scene.spot_radius + scene.blur_on_detector + 1.0 / scene.cutoff + scene.path.pixels.pitch
    return math.sqrt(share * size**2 / (math.pi**2 * scene.cutoff * margin**3))


def fringe_contrast(scene: LightScene) -> float:
    """What is left of fringes between neighbouring microlenses after pixel and source have averaged them.

    Their frequency is pitch/(λ b_L); a pixel leaves at most 1/(π f p), a disc of radius r 1.6/(2π f r)^{3/2}.
    """
    f = scene.path.microlenses.pitch / (scene.wavelength * scene.path.detector_distance)
    pixel = min(1.0, 1.0 / (math.pi * f * scene.path.pixels.pitch))
    x = 2.0 * math.pi * f * scene.spot_radius
    return pixel * (min(1.0, 1.6 / x**1.5) if x > 0.0 else 1.0)


def interference_change(scene: LightScene) -> float:
    """Relative L2 on the picture of the interference of own and foreign light: 2 √(own · foreign) · contrast."""
    return 2.0 * math.sqrt(light_behind_neighbours(scene)) * fringe_contrast(scene)
