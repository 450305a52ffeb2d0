"""A calibrated pair of cameras, which measures depth instead of the design."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from tradestudy.optics.lens_models.lens_model import LensModel
from tradestudy.optics.lens_models.rational import IDEAL

Lenses = tuple[LensModel, LensModel]
"""Lens models of the left and the right camera."""
PINHOLES: Final[Lenses] = (IDEAL, IDEAL)
RADIAL: Final = ("k1", "k2")
"""The coefficients that are parameters of a camera by default."""


@dataclass(frozen=True, kw_only=True)
class CalibratedPair:
    """A calibrated pair of cameras.

    Parameters
    ----------
    parameters
        For the left and then the right camera: focal lengths and principal point [px], and coefficients of its lens
        model [1, rad]. Then the rotation vector [rad] and the translation [m] from the left camera's frame to the right
        one's, as `calibration.projection` expects them.
    lenses
        Lens models of both cameras.
    free
        Names of the coefficients of both cameras that are parameters and can be in error.
    """

    parameters: tuple[float, ...]
    lenses: Lenses = PINHOLES
    free: tuple[str, ...] = RADIAL
