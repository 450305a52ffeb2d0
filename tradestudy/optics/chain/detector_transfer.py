"""From the microlens array to the detector: the exact transfer function of the leg, applied by Fourier transforms.

A discrete set of nodes has an exact spectrum (one nonuniform FFT). Multiplied by the transfer function of free space
and transformed back, it gives the field on a regular grid, whatever the number of nodes. The only approximations are
the largest angle that is kept and the period of the grid; both follow from the geometry, such that no light that is
kept wraps around into the targets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import finufft
import numpy as np
import scipy.fft

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.phasors import ComplexArray, unit_phasor

_FINEST = 1e-4  # below this tolerance, light fades out over no greater length
_STEEPEST = 0.98  # sine of the steepest angle that the period allows for


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """Grid and transfer function of one leg.

    Attributes
    ----------
    wavelength, distance
        λ and length of the leg [m].
    paraxial
        Whether Fresnel's law applies; otherwise Kirchhoff's.
    spacing
        Distance between detector samples [m].
    count
        Samples along a side of the periodic grid.
    full_band, half_band
        Spatial frequencies up to which all light is kept, and at which it has faded out [1/m].
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
        """Frequencies of one axis in FFT order [1/m]."""
        return np.asarray(scipy.fft.fftfreq(self.count, self.spacing))

    @property
    def frequency_step(self) -> float:
        """Distance between neighbouring frequencies [1/m]."""
        return 1 / self.period


@dataclass(frozen=True, kw_only=True)
class Response:
    """Transfer function of free space, tabulated once.

    Attributes
    ----------
    transfer
        Grid and law.
    quadrant
        Transfer function, which is even, at the frequencies ≥ 0 of both axes; shape (n, n) with n = count // 2 + 1.
        It has faded out beyond the full band.
    """

    transfer: Transfer
    quadrant: ComplexArray

    def apply(self, spectrum: ComplexArray) -> None:
        """Multiply a spectrum in FFT order: first the frequencies from zero up, then the negative ones."""
        count = self.transfer.count
        above, below = slice(-(-count // 2)), slice(count // 2, 0, -1)
        for rows, to_rows in ((above, above), (below, slice(above.stop, None))):
            for columns, to_columns in ((above, above), (below, slice(above.stop, None))):
                spectrum[to_rows, to_columns] *= self.quadrant[rows, columns]


def response(transfer: Transfer, *, single: bool = False) -> Response:
    """Tabulate the transfer function of a leg without its constant phase; in 32-bit numbers if `single`.

    Kirchhoff: exp(i b k_z)/(1 + i k_z/(k² b)). The numerator belongs to Rayleigh–Sommerfeld I; the paper's kernel lacks
    the factor 1 + i/(k s) of that law, where s = b k/k_z at the stationary point.
    Fresnel: exp(−iπ λ b f²).
    """
    frequency = transfer.frequency_step * np.arange(transfer.count // 2 + 1)
    sine = transfer.wavelength * frequency
    squared = (sine**2)[None, :] + (sine**2)[:, None]
    k_b = 2 * math.pi / transfer.wavelength * transfer.distance
    if transfer.paraxial:
        quadrant = unit_phasor(-k_b / 2 * squared)
    else:
        cosine = np.sqrt(np.maximum(1 - squared, 0))
        quadrant = unit_phasor(-k_b * squared / (1 + cosine))
        quadrant /= 1 + 1j / k_b * cosine
    quadrant *= fading(np.hypot(frequency, frequency[:, None]), transfer.full_band, transfer.half_band)
    return Response(transfer=transfer, quadrant=quadrant.astype(np.complex64 if single else np.complex128))


def fading(at: FloatArray, full: float, end: float) -> FloatArray:
    """Factor that is 1 up to `full` and falls smoothly to 0 at `end`."""
    ramp = np.clip((end - at) / (end - full), 0.0, 1.0)
    return np.asarray(ramp**3 * (10 - 15 * ramp + 6 * ramp**2))


def fading_length(
    wavelength: float, distance: float, reach: float, *, paraxial: bool, tolerance: float = _FINEST
) -> float:
    """Distance over which light that lands farther than `reach` from its start fades out [m].

    So that the edge of the band does not ring, it spans as many Fresnel lengths of the slanted path, √(λ b)/cos^{3/2}
    (without the cosine in Fresnel's law), as the tolerance has decimals.
    """
    slant = 1.0 if paraxial else 1 + (reach / distance) ** 2
    return decades(tolerance) * math.sqrt(wavelength * distance) * math.pow(slant, 0.75)


def decades(tolerance: float) -> float:
    """Number of Fresnel lengths over which light must fade out so that the edge of a band does not ring."""
    return -math.log10(max(tolerance, _FINEST))


def sine_towards(offset: float, distance: float, *, paraxial: bool) -> float:
    """Sine of the angle, λ f, of light that lands this far from where it started; its tangent in Fresnel's law."""
    return offset / distance if paraxial else offset / math.hypot(offset, distance)


def half_band(
    wavelength: float, distance: float, kept_reach: float, *, paraxial: bool, tolerance: float = _FINEST
) -> float:
    """Frequency at which light that lands beyond the kept reach has faded out [1/m]; samples must resolve it."""
    faded = kept_reach + fading_length(wavelength, distance, kept_reach, paraxial=paraxial, tolerance=tolerance)
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
    tolerance: float = _FINEST,
) -> Transfer:
    """Choose band and period for nodes and targets within squares about one axis.

    Parameters
    ----------
    wavelength, distance, paraxial
        Wavelength and length of the leg [m], and whether Fresnel's law applies.
    node_reach, target_reach
        Half sides of the squares that contain nodes and targets [m].
    kept_reach
        Light is kept if it lands within this distance of where it started [m].
    spacing
        Distance between detector samples [m]; the caller makes it divide the pixel pitch.
    tolerance
        Target for the relative error; it sets the length over which light fades out.

    Raises
    ------
    OutOfRangeError
        If the samples are too coarse for the band.
    """
    band = half_band(wavelength, distance, kept_reach, paraxial=paraxial, tolerance=tolerance)
    if 2 * band * spacing > 1:
        raise OutOfRangeError(
            "distance between detector samples",
            value=f"{spacing:g} m",
            limit=f"≤ {1 / (2 * band):g} m",
            remedy="use more samples along a pixel",
        )
    travel = _landing(band * wavelength, distance, paraxial=paraxial)
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


def detector_field(
    response: Response,
    *,
    x: FloatArray,
    y: FloatArray,
    strengths: ComplexArray,
    start: FloatArray,
    shape: tuple[int, int],
    tolerance: float,
    threads: int = 0,
) -> ComplexArray:
    """Field of nodes on a rectangle of the detector.

    Parameters
    ----------
    response
        Grid and transfer function.
    x, y
        Node positions [m], shape (n,).
    strengths
        Field times area weight, shape (n,).
    start
        First sample (x, y) [m].
    shape
        Samples (rows, columns), at most ``count``.
    tolerance
        Tolerance of the nonuniform FFT.
    threads
        Threads that it may use; 0 for all.

    Returns
    -------
    ndarray
        Field, in the given shape.
    """
    transfer, real = response.transfer, real_type(strengths)
    scale = 2 * np.pi / transfer.period
    spectrum = finufft.nufft2d1(
        (scale * y).astype(real),
        (scale * x).astype(real),
        np.ascontiguousarray(strengths),
        (transfer.count, transfer.count),
        eps=tolerance,
        isign=-1,
        modeord=1,
        nthreads=threads,
    )
    x_phase, y_phase = (unit_phasor(2 * np.pi * s * transfer.frequencies).astype(spectrum.dtype) for s in start)
    rows, columns = shape
    response.apply(spectrum)
    spectrum *= y_phase[:, None]
    partial = scipy.fft.ifft(spectrum, axis=0, overwrite_x=True)[:rows]
    partial *= x_phase / transfer.spacing**2
    return np.asarray(scipy.fft.ifft(partial, axis=1, overwrite_x=True)[:, :columns])


def real_type(array: ComplexArray) -> type[np.floating]:
    """Real type of the same precision."""
    return np.float32 if array.dtype == np.complex64 else np.float64
