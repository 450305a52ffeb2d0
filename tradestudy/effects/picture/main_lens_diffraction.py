"""Diffraction at the main lens, in the picture that a disparity error is derived from."""

from __future__ import annotations

from tradestudy.effects.base import Slot
from tradestudy.effects.picture.diffraction import diffraction
from tradestudy.effects.picture.trial import PictureTrial


def main_lens_diffraction(trial: PictureTrial) -> Slot:
    """Off, Airy, Fresnel or Kirchhoff, on the way from the lens to its own image."""
    return diffraction(trial, "main_lens_diffraction")
