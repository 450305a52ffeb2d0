"""From the microlens array to the detector: the exact transfer function of the leg, applied by Fourier transforms.

A discrete set of nodes has an exact spectrum (one nonuniform FFT). Multiplied by the transfer function of free space
and transformed back it gives the field on a regular grid, whatever the number of nodes: the only approximations are the
largest angle that is kept and the period of the grid, both chosen from the geometry so that no light that is kept
wraps around into the targets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import finufft
import numpy as np
import scipy.fft

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation.direct import ComplexArray

_FADING = 4.0  # Fresnel lengths beyond what is kept over which light fades out, so that the band's edge does not ring


_STEEPEST = 0.98  # sine up to which the period follows the light; beyond, `Transfer.response` refuses


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """Grid and transfer function of one leg.

    Attributes
    ----------
    wavelength, distance
        [m].
    paraxial
        Fresnel; else Kirchhoff.
    spacing
        Distance of detector samples [m].
    count
        Samples a side of one period.
    full_band, half_band
        Spatial frequency up to which all light is kept, and at which it has faded out [1/m].
    """

    wavelength: float
    distance: float
    paraxial: bool
    spacing: float
    count: int
    full_band: float
    half_band: float

    @property
    def period(self) -> float:
        """Side of the periodic grid [m]."""
        return self.spacing * self.count

    @property
    def frequencies(self) -> FloatArray:
        """Frequencies of one axis in the order of the FFT [1/m]."""
        return np.asarray(scipy.fft.fftfreq(self.count, self.spacing))

    def response(self, carrier: tuple[float, float], *, single: bool = False) -> ComplexArray:
        """Transfer function about a carrier frequency, shape (count, count) as (f_y, f_x), constant phase dropped.

        Kirchhoff: exp(i b k_z)/(1 + i k_z/(k² b)). The first factor belongs to Rayleigh–Sommerfeld I; the paper's
        kernel lacks its 1 + i/(k s), and at the stationary point s = b k/k_z.
        Fresnel: exp(−iπ λ b f²).

        `single` computes in 32 bits: 1e-5 rad of error in a millimetre.
        """
        real = np.dtype(np.float32 if single else np.float64)
        sine_x: FloatArray = (self.wavelength * (self.frequencies + carrier[0])).astype(real)
        sine_y: FloatArray = (self.wavelength * (self.frequencies + carrier[1])).astype(real)
        squared = (sine_x**2)[None, :] + (sine_y**2)[:, None]
        k_b = 2 * math.pi / self.wavelength * self.distance
        window: FloatArray = self._window.astype(real)
        if self.paraxial:
            return _phasor(-k_b / 2 * squared, window)
        if float(np.max(squared, where=window > 0, initial=0.0)) >= 1:
            raise OutOfRangeError(
                "angle between array and detector",
                value="sine ≥ 1",
                limit="propagating waves",
                remedy="widen the gap or narrow the detector",
            )
        cosine = np.sqrt(np.maximum(1 - squared, 0))
        factor = cosine / k_b
        return _phasor(-k_b * squared / (1 + cosine) - np.arctan(factor), window / np.sqrt(1 + factor**2))

    @cached_property
    def _window(self) -> FloatArray:
        """One inside the band, falling smoothly to zero over its outer part."""
        f = np.hypot(self.frequencies[None, :], self.frequencies[:, None])
        ramp = np.clip((self.half_band - f) / (self.half_band - self.full_band), 0.0, 1.0)
        return np.asarray(ramp**3 * (10 - 15 * ramp + 6 * ramp**2))


def _phasor(phase: FloatArray, amplitude: FloatArray) -> ComplexArray:
    """Complex number of the same precision from its phase and amplitude."""
    result = np.empty(phase.shape, dtype=np.result_type(phase.dtype, np.complex64))
    np.cos(phase, out=result.real)
    np.sin(phase, out=result.imag)
    result *= amplitude
    return result


def fading_length(wavelength: float, distance: float, reach: float, *, paraxial: bool) -> float:
    """Distance over which light fades out that lands beyond a reach from where it started [m].

    In Fresnel lengths of the slanted path: √(λ b)/cos^{3/2}, without the cosine in Fresnel's law.
    """
    slant = 1.0 if paraxial else 1 + (reach / distance) ** 2
    return _FADING * math.sqrt(wavelength * distance) * math.pow(slant, 0.75)


def sine_towards(offset: float, distance: float, *, paraxial: bool) -> float:
    """λ f of light that lands this far from where it started."""
    return offset / distance if paraxial else offset / math.hypot(offset, distance)


def half_band(wavelength: float, distance: float, kept_reach: float, *, paraxial: bool) -> float:
    """Frequency at which light has faded out that lands beyond what is kept [1/m]; samples must resolve it."""
    faded = kept_reach + fading_length(wavelength, distance, kept_reach, paraxial=paraxial)
    return sine_towards(faded, distance, paraxial=paraxial) / wavelength


def _landing(sine: float, distance: float, *, paraxial: bool) -> float:
    """Inverse of `sine_towards`."""
    if paraxial:
        return distance * sine
    sine = min(sine, _STEEPEST)
    return distance * sine / math.sqrt(1 - sine**2)


def choose_transfer(
    *,
    wavelength: float,
    distance: float,
    paraxial: bool,
    node_reach: float,
    target_reach: float,
    kept_reach: float,
    spacing: float,
    tilt: float = 0.0,
) -> Transfer:
    """Choose band and period for nodes and targets within squares about one axis.

    Parameters
    ----------
    wavelength, distance, paraxial
        Of the leg.
    node_reach, target_reach
        Half sides of the squares that hold nodes and targets [m].
    kept_reach
        Light that lands up to this far from where it started is kept [m].
    spacing
        Distance of detector samples [m]; it is the caller's to divide the pixel.
    tilt
        Largest sine of a carrier; targets then lie about where the carrier lands.

    Raises
    ------
    OutOfRangeError
        If the samples are too coarse for the band.
    """
    band = half_band(wavelength, distance, kept_reach, paraxial=paraxial)
    if 2 * band * spacing > 1:
        raise OutOfRangeError(
            "distance of detector samples",
            value=f"{spacing:g} m",
            limit=f"≤ {1 / (2 * band):g} m",
            remedy="take more samples along a pixel",
        )
    farthest = _landing(tilt + band * wavelength, distance, paraxial=paraxial)
    travel = farthest - _landing(tilt, distance, paraxial=paraxial)
    period = max(node_reach + target_reach + travel, 2 * target_reach + 2 * spacing)
    return Transfer(
        wavelength=wavelength,
        distance=distance,
        paraxial=paraxial,
        spacing=spacing,
        count=int(scipy.fft.next_fast_len(math.ceil(period / spacing), real=False)),
        full_band=sine_towards(kept_reach, distance, paraxial=paraxial) / wavelength,
        half_band=band,
    )


def propagate(
    transfer: Transfer,
    *,
    x: FloatArray,
    y: FloatArray,
    strengths: ComplexArray,
    responses: ComplexArray,
    start: FloatArray,
    shape: tuple[int, int],
    tolerance: float,
    threads: int = 0,
) -> ComplexArray:
    """Field of sets of nodes on patches of the detector.

    Parameters
    ----------
    transfer
        Grid and law.
    x, y
        Node positions relative to the set's origin [m], shape (n,), the same for every set.
    strengths
        Field times area weight, carrier taken out, shape (sets, n).
    responses
        `Transfer.response` of each set's carrier, shape (sets, count, count).
    start
        First sample (x, y) of each patch relative to the set's origin [m], shape (sets, 2).
    shape
        Samples (rows, columns) of a patch, at most ``count``.
    tolerance
        Of the nonuniform FFT.
    threads
        For it to use; 0 for all.

    Returns
    -------
    ndarray
        Field over its carrier, shape (sets, rows, columns).
    """
    scale = 2 * np.pi / transfer.period
    spectrum = finufft.nufft2d1(
        scale * y.astype(_real_of(strengths)),
        scale * x.astype(_real_of(strengths)),
        np.ascontiguousarray(strengths),
        (transfer.count, transfer.count),
        eps=tolerance,
        isign=-1,
        modeord=1,
        nthreads=threads,
    ).reshape(-1, transfer.count, transfer.count)
    spectrum *= responses
    shift_x, shift_y = (
        np.exp(2j * np.pi * np.outer(start[:, axis], transfer.frequencies)).astype(spectrum.dtype) for axis in (0, 1)
    )
    spectrum *= shift_y[:, :, None]
    spectrum *= shift_x[:, None, :]
    rows, columns = shape
    partial = scipy.fft.ifft(spectrum, axis=1, overwrite_x=True)[:, :rows]
    return np.asarray(scipy.fft.ifft(partial, axis=2, overwrite_x=True)[:, :, :columns] / transfer.spacing**2)


def _real_of(array: ComplexArray) -> type[np.floating]:
    """Real type of the same precision."""
    return np.float32 if array.dtype == np.complex64 else np.float64
