"""Diffraction and defocus together by Kirchhoff's integral: the Hankel transform of the intensity on the sensor."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from tradestudy.imaging.transfer.fresnel import fresnel_transfer
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.quadrature import disc_nodes, gauss_legendre

if TYPE_CHECKING:  # propagation takes as long to import as all the rest, and few pictures need it
    from tradestudy.optics.propagation import CircularLens, LensPhase, PointSource

# Farther than this a point source is at infinity to all digits that matter, and the paths are still exact.
FARTHEST = 1e6
_TOLERANCE = 1e-4
_NODES_PER_PERIOD = 5
_PERIODS = 12
_FREQUENCIES = 97


def correction_at(correction: FloatArray, share: FloatArray) -> FloatArray:
    """A correction of `kirchhoff_correction` at shares of the cut-off; 0 past it, where both are below the error."""
    from scipy.interpolate import CubicSpline

    inside = share < 1.0
    table = np.linspace(0.0, 1.0, _FREQUENCIES)
    return np.asarray(np.where(inside, CubicSpline(table, correction)(np.where(inside, share, 0.0)), 0.0))


def _cone(aperture: float, focal_length: float, distance: float, plane: float) -> tuple[float, float]:
    """f-number at the plane and diameter of the geometric blur [m]."""
    return plane / aperture, aperture * plane * abs(1.0 / focal_length - 1.0 / distance - 1.0 / plane)


@lru_cache(maxsize=2**15)  # of a kilobyte each
def kirchhoff_correction(
    wavelength: float, aperture: float, focal_length: float, distance: float, plane: float, lens_phase: LensPhase
) -> tuple[FloatArray, float]:
    """Kirchhoff's transfer less Fresnel's at 97 even shares of the cut-off from 0 to 1, and its error.

    The transfer is ``2π ∫ I(r) J₀(2π ν r) r dr`` over the spot of a point on the axis. The spot falls off as 1/r³ and
    its transform converges slowly, but Fresnel's spot has the same tail and a transform in one smooth integral: only
    the difference of the two is transformed, over the geometric blur and 12 periods λ N. The error is the larger of
    what the outer half of the spot contributes and what normalising took away; the propagation itself is good to 1e-4
    of the spot.
    """
    from scipy.special import j0

    from tradestudy.optics.propagation import CircularLens, PointSource

    N, blur = _cone(aperture, focal_length, distance, plane)
    period = wavelength * N
    panels = math.ceil((0.6 * blur) / period) + _PERIODS
    t, w = gauss_legendre(_NODES_PER_PERIOD)
    r = (np.arange(panels)[:, np.newaxis] + t).ravel() * period
    weight = 2.0 * np.pi * r * np.tile(w, panels) * period
    source = PointSource(distance=distance)
    lens = CircularLens(radius=aperture / 2.0, focal_length=focal_length, lens_phase=lens_phase)
    difference = _spot(source, lens, r, plane, wavelength) - _fresnel_spot(r, wavelength, aperture, plane, blur)
    frequency = np.linspace(0.0, 1.0 / period, _FREQUENCIES)
    terms = j0(2.0 * np.pi * np.outer(frequency, r)) * (weight * difference)
    correction = terms.sum(axis=1)
    outer = float(np.max(np.abs(terms[:, r > r[-1] / 2.0].sum(axis=1))))
    fresnel = fresnel_transfer(frequency, wavelength, N, blur)
    at_zero = 1.0 + float(correction[0])
    normalised = (fresnel + correction) / at_zero - fresnel
    normalised.setflags(write=False)
    return normalised, max(outer, abs(at_zero - 1.0))


def _spot(source: PointSource, lens: CircularLens, r: FloatArray, plane: float, wavelength: float) -> FloatArray:
    """Kirchhoff's intensity over the power that passed the pupil [1/m²]."""
    from tradestudy.optics.propagation import FieldAccuracy, TargetPoints, aperture_field, lens_wave

    field = aperture_field(
        source=source,
        lens=lens,
        targets=TargetPoints(x=r, y=0.0, distance=plane),
        wavelength=wavelength,
        method="kirchhoff",
        accuracy=FieldAccuracy(tolerance=_TOLERANCE),
    )
    wave = lens_wave(source=source, lens=lens, wavelength=wavelength)
    nodes = disc_nodes(radius=lens.radius, radial_count=12, angular_count=24)
    power = float(nodes.weights @ np.abs(wave.amplitude(nodes.x, nodes.y)) ** 2)
    return np.asarray(field.intensity / power)


def _fresnel_spot(r: FloatArray, wavelength: float, aperture: float, plane: float, blur: float) -> FloatArray:
    """Fresnel's intensity on the axis of a circular lens over the power that passed it [1/m²].

    ``(π/4) (A/λb)² |∫₀¹ exp(2πi W t) J₀(π A r √t / λb) dt|²`` with W = c/(8 N λ) waves of defocus at the rim.
    """
    from scipy.special import j0

    waves = blur * aperture / (8.0 * plane * wavelength)
    reach = np.pi * aperture / (wavelength * plane) * r
    t, w = gauss_legendre(24 + math.ceil(0.5 * float(reach[-1]) + 4.0 * waves))
    amplitude = (w * np.exp(2j * np.pi * waves * t)) @ j0(np.sqrt(t)[:, np.newaxis] * reach)
    return np.asarray(np.pi / 4.0 * (aperture / (wavelength * plane)) ** 2 * np.abs(amplitude) ** 2)
