"""Diffraction at the microlenses, in the picture that a disparity error is derived from."""

from __future__ import annotations

from tradestudy.effects.base import Slot
from tradestudy.effects.picture.diffraction import diffraction
from tradestudy.effects.picture.trial import PictureTrial


def microlens_diffraction(trial: PictureTrial) -> Slot:
    """Off, Airy, Fresnel or Kirchhoff, from a microlens to the detector; off alone for a camera without them."""
    return diffraction(trial, "microlens_diffraction")
