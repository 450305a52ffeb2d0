"""The families of lens models, by the names that studies and files use."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.optics.lens_models.double_sphere import DoubleSphere
from tradestudy.optics.lens_models.extended_unified import ExtendedUnified
from tradestudy.optics.lens_models.field_of_view import FieldOfView
from tradestudy.optics.lens_models.kannala_brandt import KannalaBrandt
from tradestudy.optics.lens_models.lens_model import LensModel
from tradestudy.optics.lens_models.omnidirectional import Omnidirectional
from tradestudy.optics.lens_models.rational import Rational

FAMILIES: Final[Mapping[str, type[LensModel]]] = {
    family.name: family
    for family in (Rational, KannalaBrandt, FieldOfView, Omnidirectional, DoubleSphere, ExtendedUnified)
}
ANGLES: Final = ("tau_x", "tau_y", "w")
"""Coefficients in rad; the others are numbers."""
STARTS: Final[Mapping[str, Mapping[str, float]]] = {
    FieldOfView.name: {"w": 0.9},
    Omnidirectional.name: {"xi": 1.0},
    DoubleSphere.name: {"xi": 0.0, "alpha": 0.5},
    ExtendedUnified.name: {"alpha": 0.5, "beta": 1.0},
}
"""Coefficients that fits start from, in the middle of what lenses have; those of the other families are zero."""
