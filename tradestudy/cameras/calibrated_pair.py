"""Two cameras as a calibration found them: what depth is read with in place of a design."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from tradestudy.optics.lens_models.lens_model import LensModel
from tradestudy.optics.lens_models.rational import IDEAL

Lenses = tuple[LensModel, LensModel]
"""Of the left camera and of the right one."""
PINHOLES: Final[Lenses] = (IDEAL, IDEAL)
RADIAL: Final = ("k1", "k2")
"""The coefficients that are parameters of a camera unless others are named."""


@dataclass(frozen=True, kw_only=True)
class CalibratedPair:
    """A calibrated pair of cameras.

    Parameters
    ----------
    parameters
        Of the left camera and of the right one: focal lengths and principal point [px], and coefficients of its lens
        model [1, rad]. Then the rotation vector [rad] and the translation [m] from the left camera's frame to the right
        one's, as `calibration.projection` takes them.
    lenses
        Lens models of both cameras.
    free
        Which coefficients are among the parameters, and can be in error: those of these names in both cameras.
    """

    parameters: tuple[float, ...]
    lenses: Lenses = PINHOLES
    free: tuple[str, ...] = RADIAL
