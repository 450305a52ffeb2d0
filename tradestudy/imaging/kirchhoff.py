"""Diffraction and defocus together by Kirchhoff's integral: the Hankel transform of the intensity on the sensor.

What it adds to Fresnel's transfer is computed on a lattice and interpolated. Where the plane is fixed, the lattice lies
in the defocus; where it follows the image, in the logarithm of its distance. The lattice is the same whatever is asked,
so that an answer does not depend on the other distances asked for.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from tradestudy.imaging.transfer import fresnel_transfer
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.quadrature import disc_nodes, gauss_legendre

if TYPE_CHECKING:  # propagation takes as long to import as all the rest, and few pictures need it
    from tradestudy.optics.propagation import CircularLens, LensPhase, PointSource

    LatticePoint = tuple[float, float, float, float, float, LensPhase]  # arguments of `kirchhoff_correction`

# Farther than this a point source is at infinity to all digits that matter, and the paths are still exact.
FARTHEST = 1e6
_TOLERANCE = 1e-4
_NODES_PER_PERIOD = 5
_PERIODS = 12
_FREQUENCIES = 97
# Of the lattice.
_POINTS = 4
_WAVES = 0.1
_LOG_PLANE = 0.05
_IN_FOCUS_WAVES = 1e-6


def correction_at(correction: FloatArray, share: FloatArray) -> FloatArray:
    """A correction of `kirchhoff_correction` at shares of the cut-off; 0 past it, where both are below the error."""
    from scipy.interpolate import CubicSpline

    inside = share < 1.0
    table = np.linspace(0.0, 1.0, _FREQUENCIES)
    return np.asarray(np.where(inside, CubicSpline(table, correction)(np.where(inside, share, 0.0)), 0.0))


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

    N, blur = plane / aperture, aperture * plane * abs(1.0 / focal_length - 1.0 / distance - 1.0 / plane)
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


def kirchhoff_transfers(
    frequency: FloatArray,
    *,
    wavelength: float,
    aperture_diameter: float,
    focal_length: FloatArray,
    plane_distance: FloatArray,
    defocus_waves: FloatArray,
    lens_phase: LensPhase,
) -> tuple[FloatArray, FloatArray]:
    """Transfer by Kirchhoff's integral, ``2π ∫ I(r) J₀(2π ν r) r dr``, interpolated between planes or defoci.

    Parameters
    ----------
    frequency
        ν ≥ 0 [cycles/m] in the plane, shape (distances, frequencies).
    wavelength, aperture_diameter
        λ and of the lens [m].
    lens_phase
        ``perfect`` or ``parabolic``; see `CircularLens`.
    focal_length, plane_distance
        [m], shape (distances,).
    defocus_waves
        Path error at the rim ``A²/8 (1/a + 1/b − 1/f)/λ``, signed; its object distance is where the point stands. 0 is
        the point that the plane is in focus for. A negative object distance is that of light that converges towards a
        point behind the lens; beyond 1000 km a point counts as infinitely far away.

    Returns
    -------
    tuple
        Transfer, 1 at frequency 0, shape (distances, frequencies), and its error, shape (distances,): that of the
        lattice points and the difference of cubic and parabolic interpolation. NaN where a length is.

    Raises
    ------
    TradestudyError
        From `aperture_field`: the lens or the point is impossible, or takes more nodes than are allowed.
    """
    value, error = np.full_like(frequency, np.nan), np.full(len(frequency), np.nan)
    for k in np.flatnonzero(np.isfinite(plane_distance + defocus_waves + focal_length)):
        f, plane, waves = float(focal_length[k]), float(plane_distance[k]), float(defocus_waves[k])
        place = float(_place(plane_distance[k], defocus_waves[k]))
        around = _points_around(wavelength, aperture_diameter, f, plane, waves, lens_phase)
        found = [kirchhoff_correction(*point) for point in around]
        tables = np.stack([table for table, _ in found])
        since_first = place - math.floor(place) + 1.0
        cubic = _lagrange(since_first, _POINTS) @ tables
        parabola = _lagrange(since_first, _POINTS - 1) @ tables[:-1]
        N = plane / aperture_diameter
        blur = 8.0 * N * abs(waves) * wavelength
        value[k] = fresnel_transfer(frequency[k], wavelength, N, blur)
        value[k] += correction_at(cubic, wavelength * N * frequency[k])
        error[k] = max(off for _, off in found) + float(np.max(np.abs(cubic - parabola)))
    return value, error


def lattice_points(
    *,
    wavelength: float,
    aperture_diameter: float,
    focal_length: FloatArray,
    plane_distance: FloatArray,
    defocus_waves: FloatArray,
    lens_phase: LensPhase,
) -> tuple[LatticePoint, ...]:
    """Arguments of every `kirchhoff_correction` that `kirchhoff_transfers` takes for the same lens, each once."""
    lengths = np.stack(np.broadcast_arrays(focal_length, plane_distance, defocus_waves), axis=1)
    found = {
        point: None
        for f, plane, waves in lengths[np.isfinite(lengths).all(axis=1)].tolist()
        for point in _points_around(wavelength, aperture_diameter, f, plane, waves, lens_phase)
    }
    return tuple(found)


def _points_around(
    wavelength: float, aperture: float, focal_length: float, plane: float, waves: float, lens_phase: LensPhase
) -> tuple[LatticePoint, ...]:
    """Between which a transfer is interpolated, in order."""
    first = math.floor(_place(np.asarray(plane), np.asarray(waves))) - 1
    found = []
    for j in range(first, first + _POINTS):
        b, w = (plane, j * _WAVES) if _is_fixed(np.asarray(waves)) else (math.exp(j * _LOG_PLANE), 0.0)
        inverse = 1.0 / focal_length - 1.0 / b + 8.0 * wavelength * w / aperture**2
        distance = math.copysign(1.0 / max(abs(inverse), 1.0 / FARTHEST), inverse)
        found.append((wavelength, aperture, focal_length, distance, b, lens_phase))
    return tuple(found)


def lattice_defocus(plane_distance: FloatArray, defocus_waves: FloatArray) -> FloatArray:
    """Defocus [waves] of every point of the lattice that planes [m] and defoci [waves] call for, each counted once."""
    fixed = _is_fixed(defocus_waves)
    first = np.floor(_place(plane_distance, defocus_waves)) - 1.0
    steps, planes = (
        np.unique(first[chosen & np.isfinite(first), np.newaxis] + np.arange(_POINTS)) for chosen in (fixed, ~fixed)
    )
    return np.concatenate([steps * _WAVES, np.zeros(planes.size)])


def _is_fixed(defocus_waves: FloatArray) -> BoolArray:
    """Whether the plane stands still, out of focus, and does not follow the image."""
    return np.asarray(np.abs(defocus_waves) > _IN_FOCUS_WAVES)


def _place(plane_distance: FloatArray, defocus_waves: FloatArray) -> FloatArray:
    """On the lattice, in steps of it."""
    along_plane = np.log(plane_distance) / _LOG_PLANE
    return np.asarray(np.where(_is_fixed(defocus_waves), defocus_waves / _WAVES, along_plane))


def _lagrange(place: float, count: int) -> FloatArray:
    """Weights of values at 0, 1 … count − 1."""
    nodes = np.arange(count, dtype=np.float64)
    return np.array([np.prod([(place - m) / (n - m) for m in nodes if m != n]) for n in nodes])
