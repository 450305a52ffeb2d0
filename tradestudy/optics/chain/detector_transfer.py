"""From the microlens array to the detector: the exact transfer function of the leg, applied by Fourier transforms.

A discrete set of nodes has an exact spectrum (one nonuniform FFT). Multiplied by the transfer function of free space
and transformed back it gives the field on a regular grid, whatever the number of nodes: the only approximations are the
largest angle that is kept and the period of the grid, both chosen from the geometry so that no light that is kept
wraps around into the targets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import finufft
import numpy as np
import numpy.typing as npt
import scipy.fft

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation.direct import ComplexArray, unit_phasor

_FINEST = 1e-4  # tolerance from which on light fades out over no greater length
_STEEPEST = 0.98  # sine up to which the period follows the light; beyond, `response` refuses


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

    @property
    def frequency_step(self) -> float:
        """Distance of neighbouring frequencies; carriers are whole multiples of it [1/m]."""
        return 1 / self.period

    def window(self) -> FloatArray:
        """One inside the band, falling smoothly to zero over its outer part; frequencies in the order of the FFT."""
        axis = self.frequency_step * np.arange(self.count // 2 + 1)
        f = np.hypot(axis, axis[:, None])
        ramp = np.clip((self.half_band - f) / (self.half_band - self.full_band), 0.0, 1.0)
        quarter = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
        half = np.concatenate([quarter, quarter[(self.count - 1) // 2 : 0 : -1]])
        return np.concatenate([half, half[:, (self.count - 1) // 2 : 0 : -1]], axis=1)


@dataclass(frozen=True, kw_only=True)
class Response:
    """Transfer function of free space, tabulated once for every carrier.

    Attributes
    ----------
    transfer
        Grid and law.
    values
        At frequencies of both axes from the lowest to the highest, in steps of `Transfer.frequency_step`; zero in the
        middle.
    window
        `Transfer.window` in the same precision.
    """

    transfer: Transfer
    values: ComplexArray
    window: FloatArray

    def apply(self, spectrum: ComplexArray, carrier: tuple[int, int]) -> None:
        """Multiply a spectrum, shape (count, count) as (f_y, f_x), about a carrier (x, y) in frequency steps."""
        middle, count = self.values.shape[0] // 2, self.transfer.count
        # The FFT keeps frequencies from zero on first, and then those below; about a carrier each lie side by side.
        lies = ((slice(0, -(-count // 2)), 0), (slice(-(-count // 2), count), -count))
        for rows, from_y in lies:
            for columns, from_x in lies:
                here = tuple(
                    slice(middle + carrier[axis] + shift + part.start, middle + carrier[axis] + shift + part.stop)
                    for axis, part, shift in ((1, rows, from_y), (0, columns, from_x))
                )
                spectrum[rows, columns] *= self.values[here]
        spectrum *= self.window


def response(transfer: Transfer, *, largest_carrier: float = 0.0, single: bool = False) -> Response:
    """Tabulate the transfer function of a leg, constant phase dropped.

    Kirchhoff: exp(i b k_z)/(1 + i k_z/(k² b)). The first factor belongs to Rayleigh–Sommerfeld I; the paper's
    kernel lacks its 1 + i/(k s), and at the stationary point s = b k/k_z.
    Fresnel: exp(−iπ λ b f²).

    Parameters
    ----------
    transfer
        Grid and law.
    largest_carrier
        Largest magnitude of a carrier [1/m].
    single
        Give 32-bit numbers.

    Raises
    ------
    OutOfRangeError
        If light of the band about such a carrier does not propagate.
    """
    count = transfer.count // 2 + math.ceil(largest_carrier * transfer.period) + 2
    sine = transfer.wavelength * transfer.frequency_step * np.arange(count)
    squared = (sine**2)[None, :] + (sine**2)[:, None]
    k_b = 2 * math.pi / transfer.wavelength * transfer.distance
    kind = np.complex64 if single else np.complex128
    if transfer.paraxial:
        return _tabulated(transfer, unit_phasor(-k_b / 2 * squared).astype(kind))
    if transfer.wavelength * (transfer.half_band + largest_carrier) >= 1:
        raise OutOfRangeError(
            "angle between array and detector",
            value="sine ≥ 1",
            limit="propagating waves",
            remedy="widen the gap or narrow the detector",
        )
    cosine = np.sqrt(np.maximum(1 - squared, 0))
    quadrant = unit_phasor(-k_b * squared / (1 + cosine)) / (1 + 1j / k_b * cosine)
    return _tabulated(transfer, quadrant.astype(kind))


def _tabulated(transfer: Transfer, quadrant: ComplexArray) -> Response:
    """Both signs of both frequencies, of which the transfer function is even."""
    half = np.concatenate([quadrant[:0:-1], quadrant])
    values = np.concatenate([half[:, :0:-1], half], axis=1)
    return Response(transfer=transfer, values=values, window=transfer.window().astype(_real_of(values)))


def fading_length(
    wavelength: float, distance: float, reach: float, *, paraxial: bool, tolerance: float = _FINEST
) -> float:
    """Distance over which light that lands beyond a reach from its start fades out [m].

    The band's edge must not ring: as many Fresnel lengths of the slanted path, √(λ b)/cos^{3/2} (without the cosine in
    Fresnel's law), as the tolerance has decimals.
    """
    slant = 1.0 if paraxial else 1 + (reach / distance) ** 2
    return -math.log10(max(tolerance, _FINEST)) * math.sqrt(wavelength * distance) * math.pow(slant, 0.75)


def sine_towards(offset: float, distance: float, *, paraxial: bool) -> float:
    """λ f of light that lands this far from where it started."""
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
    tilt: float = 0.0,
    tolerance: float = _FINEST,
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
    tolerance
        Relative error aimed at, from which the length follows over which light fades out.

    Raises
    ------
    OutOfRangeError
        If the samples are too coarse for the band.
    """
    band = half_band(wavelength, distance, kept_reach, paraxial=paraxial, tolerance=tolerance)
    if 2 * band * spacing > 1:
        raise OutOfRangeError(
            "distance of detector samples",
            value=f"{spacing:g} m",
            limit=f"≤ {1 / (2 * band):g} m",
            remedy="use more samples along a pixel",
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


def patch_fields(
    transfer: Transfer,
    *,
    x: FloatArray,
    y: FloatArray,
    strengths: ComplexArray,
    response: Response,
    carriers: npt.NDArray[np.int_],
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
    response
        Transfer function.
    carriers
        Carrier (x, y) of each set in frequency steps, shape (sets, 2).
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
    shift_x, shift_y = (
        unit_phasor(2 * np.pi * np.outer(start[:, axis], transfer.frequencies)).astype(spectrum.dtype)
        for axis in (0, 1)
    )
    rows, columns = shape
    fields = np.empty((spectrum.shape[0], rows, columns), dtype=spectrum.dtype)
    for each, field, carrier, x_phase, y_phase in zip(spectrum, fields, carriers, shift_x, shift_y, strict=True):
        response.apply(each, (int(carrier[0]), int(carrier[1])))
        each *= y_phase[:, None]
        partial = scipy.fft.ifft(each, axis=0, overwrite_x=True)[:rows]
        partial *= x_phase / transfer.spacing**2
        field[:] = scipy.fft.ifft(partial, axis=1, overwrite_x=True)[:, :columns]
    return fields


def _real_of(array: ComplexArray) -> type[np.floating]:
    """Real type of the same precision."""
    return np.float32 if array.dtype == np.complex64 else np.float64
