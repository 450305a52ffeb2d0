"""The light of paraxial rays on the array, as a wave: one sphere about the main lens's image, cut off by a shadow."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.rays import blur_radius
from tradestudy.optics.chain.regions import Disc
from tradestudy.optics.chain.scene import LightPath
from tradestudy.optics.propagation.direct import ComplexArray, unit_phasor
from tradestudy.optics.propagation.lens import PointSource
from tradestudy.optics.propagation.paths import ParabolicPath, SphericalPath

_LEAST_ZONES = 0.5


@dataclass(frozen=True, kw_only=True)
class RayWave:
    """Wave that the paraxial rays of a point source are on the array.

    U(x) = exp(i k s(x))/(√π R |κ|) within R |κ| of the chief ray, else 0; κ = 1 − z/b takes the pupil's radius R to
    that of its shadow, and s is the path of the sphere about the main lens's image, to second order in `paraxial`.
    The power through the pupil is 1 and arrives unchanged, as rays carry it: the edge diffracts nothing on this leg.

    Parameters
    ----------
    path
        The camera.
    source
        Point source before the main lens; its image may lie before the array or behind it.
    wavelength
        [m].
    paraxial
        Whether the leg behind the array is Fresnel's, which takes every path to second order; else the exact path.

    Raises
    ------
    OutOfRangeError
        If the array lies in the focus of the main lens, where rays have no density.
    """

    path: LightPath
    source: PointSource
    wavelength: float
    paraxial: bool

    def __post_init__(self) -> None:
        refuse_focus_on_array(self.path, self.source, self.wavelength)

    @property
    def whole_pupil(self) -> bool:
        """Every array point sees one pupil point."""
        return False

    @property
    def lit(self) -> Disc:
        """What the pupil's light covers of the array."""
        x, y = self.path.chief_point(self.source)
        return Disc(x=x, y=y, radius=blur_radius(self.path, self.source))

    def power(self) -> float:
        """∫ |U|² over the pupil."""
        return 1.0

    def field(self, x: FloatArray, y: FloatArray) -> ComplexArray:
        """Wave at points of the array that are lit; the shadow is the caller's to leave out."""
        image_x, image_y, depth = self.path.image_at_array(self.source)
        kind = ParabolicPath if self.paraxial else SphericalPath
        sphere = kind(x=image_x, y=image_y, distance=depth)
        phase = 2 * math.pi / self.wavelength * np.asarray(sphere.value(x, y))
        return np.asarray(unit_phasor(phase) / (math.sqrt(math.pi) * self.lit.radius))


def refuse_focus_on_array(path: LightPath, source: PointSource, wavelength: float) -> None:
    """Refuse rays where the array is in focus.

    Raises
    ------
    OutOfRangeError
        If the main lens's blur on the array has less than half a Fresnel zone.
    """
    depth = abs(path.image_at_array(source)[2])
    zones = blur_radius(path, source) ** 2 / (wavelength * depth) if depth > 0 else 0.0
    if zones < _LEAST_ZONES:
        raise OutOfRangeError(
            "rays on one leg, with the microlens array in the focus of the main lens",
            value=f"a blur of {zones:.2g} Fresnel zones on the array",
            limit=f"≥ {_LEAST_ZONES} zones",
            remedy="use fresnel or kirchhoff on both legs, or geometric on both",
        )
