"""Transfer of light from the microlenses to samples of the detector, over all of it or on patches.

A discrete set of nodes has an exact spectrum (one nonuniform FFT). Multiplied by the transfer function of free space
and transformed back, it gives the field on a regular grid, whatever the number of nodes. The only approximations are
the largest angle that is kept and the period of the grid; both follow from the geometry, such that no light that is
kept wraps around into the targets.

By Fresnel's law, nodes x_n of strength s_n produce on a patch about m the field

    U(m + δ) = exp(iπ (δ² + 2 δ·m)/(λ b))/(iλ b) Σ_n s_n exp(iπ |x_n − m|²/(λ b)) exp(−2πi δ·x_n/(λ b)),

This is one nonuniform FFT that is no larger than the patch. The transfer function of Kirchhoff's law differs from
Fresnel's by a phase that moves light by b (tan θ − sin θ). It is applied to Fresnel's field wherever it moves light
into the patch; beyond, that field fades out, so that nothing wraps around.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import finufft
import numpy as np
import scipy.fft

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.arrays import ComplexArray, FloatArray, IndexArray, unit_phasor

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


def fading(magnitude: FloatArray, full: float, end: float) -> FloatArray:
    """Factor that is 1 up to `full` and falls smoothly to 0 at `end`."""
    ramp = np.clip((end - magnitude) / (end - full), 0.0, 1.0)
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
    # Light of the outermost node wraps around into the targets only if it travels farther than any that is kept.
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
    # Rows outside the rectangle are dropped first; the transform along the other axis then does not cover them.
    partial = scipy.fft.ifft(spectrum, axis=0, overwrite_x=True)[:rows]
    partial *= x_phase / transfer.spacing**2
    return np.asarray(scipy.fft.ifft(partial, axis=1, overwrite_x=True)[:, :columns])


def real_type(array: ComplexArray) -> type[np.floating]:
    """Real type of the same precision."""
    return np.float32 if array.dtype == np.complex64 else np.float64


_DIRECTIONS = 2 * math.pi * np.arange(16) / 16
_MIDDLES = 5  # distances of a patch from its microlens that are tried


@dataclass(frozen=True, kw_only=True)
class FresnelReach:
    """Part of Fresnel's field that contributes to a patch, centred where Fresnel's law sends the patch's middle.

    Attributes
    ----------
    kept
        All light that Kirchhoff's law moves into the patch lies within this distance along x and y [m].
    fade
        Beyond, the field fades out over this length [m].
    period
        Side of the periodic grid on which light that is moved does not return to the patch [m].
    steepest
        Sines of the angles up to which light lands in the patch, and at which it has faded out.
    """

    kept: float
    fade: float
    period: float
    steepest: tuple[float, float]

    def band(self, node_reach: float, wavelength: float, distance: float) -> float:
        """Largest frequency along x and y relative to that of the middle [1/m]; samples must resolve it."""
        return (self.kept + self.fade + node_reach) / (wavelength * distance)


def fresnel_reach(
    *, wavelength: float, distance: float, half_side: float, node_reach: float, farthest: float, tolerance: float
) -> FresnelReach:
    """Trace light from the rim of the nodes to the rim of a patch by both laws.

    Parameters
    ----------
    wavelength, distance
        λ and length of the leg [m].
    half_side
        Half the side of the patch [m].
    node_reach
        Radius of the disc that contains the nodes [m].
    farthest
        Largest distance of a patch's middle from the middle of its nodes [m].
    tolerance
        Target for the relative error; it sets the length over which light fades out.
    """
    rim = np.column_stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)])
    nodes = np.concatenate([np.zeros((1, 2)), node_reach * rim])
    across = half_side * np.arange(-1, 2)
    patch = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2)
    # By symmetry, an eighth of all directions represents the others.
    middles = np.concatenate([share * farthest * rim[:3] for share in np.linspace(0.0, 1.0, _MIDDLES)])
    landing = middles[:, None, None] + patch[:, None]
    tangent = (landing - nodes) / distance
    sine, straight = _sine(tangent), _sine(middles / distance)[:, None, None]
    steepest = float(np.max(np.sum(tangent**2, axis=-1)))
    kept = float(np.max(np.abs(nodes + distance * (sine - straight))))
    moved = float(np.max(np.abs(distance * (tangent - sine) - (middles[:, None, None] - distance * straight))))
    # Fresnel lengths of the displacement, whose derivative with respect to the frequency is λ b (1/cos³θ − 1).
    blur = math.sqrt(wavelength * distance * (math.pow(1 + steepest, 1.5) - 1))
    fade = decades(tolerance) * blur
    kept += wavelength * distance / (4 * half_side)  # carriers are whole multiples of the frequency step
    outer = kept + fade
    slope = math.sqrt(steepest)
    beyond = (
        slope + fading_length(wavelength, distance, slope * distance, paraxial=False, tolerance=tolerance) / distance
    )
    return FresnelReach(
        kept=kept,
        fade=fade,
        period=outer + max(outer, half_side + moved),
        steepest=(slope / math.hypot(1, slope), beyond / math.hypot(1, beyond)),
    )


def _sine(tangent: FloatArray) -> FloatArray:
    return np.asarray(tangent / np.sqrt(1 + np.sum(tangent**2, axis=-1, keepdims=True)))


@dataclass(frozen=True, kw_only=True)
class PatchPlan:
    """Samples of a patch and of Fresnel's field for it.

    Attributes
    ----------
    wavelength, distance
        λ and length of the leg [m].
    spacing
        Distance between samples [m].
    half
        Samples on either side of the middle one.
    reach
        Part of Fresnel's field that contributes; None if Fresnel's law is requested.
    farthest
        Largest distance of a patch's middle from the middle of its nodes [m].
    """

    wavelength: float
    distance: float
    spacing: float
    half: int
    reach: FresnelReach | None
    farthest: float

    @property
    def side(self) -> int:
        """Samples along a side of the patch."""
        return 2 * self.half + 1

    @property
    def count(self) -> int:
        """Samples along a side of Fresnel's field."""
        if self.reach is None:
            return self.side
        return int(scipy.fft.next_fast_len(math.ceil(self.reach.period / self.spacing) + 1, real=False))

    @property
    def frequency_step(self) -> float:
        """Distance between neighbouring frequencies of Fresnel's field [1/m]."""
        return 1 / (self.count * self.spacing)


@dataclass(frozen=True, kw_only=True)
class PatchLaw:
    """Tables that turn sums over nodes into the field on a patch.

    Attributes
    ----------
    plan
        Samples.
    curvature
        exp(iπ δ²/(λ b))/√(iλ b) along one axis of Fresnel's field, faded out beyond its reach, shape (count,).
    ratio
        Kirchhoff's transfer function over Fresnel's, at frequencies of both axes from the lowest to the highest in
        steps of `PatchPlan.frequency_step`, zero in the middle; None for Fresnel's law.
    """

    plan: PatchPlan
    curvature: ComplexArray
    ratio: ComplexArray | None


def patch_law(plan: PatchPlan, *, memory_limit: float, single: bool = False) -> PatchLaw:
    """Tabulate the law of a leg without its constant phase, as in `detector_transfer.response`; 32-bit if `single`.

    A table larger than the memory limit [bytes] is refused.
    """
    kind = np.complex64 if single else np.complex128
    area = plan.wavelength * plan.distance
    position = plan.spacing * np.arange(-(plan.count // 2), plan.count - plan.count // 2, dtype=np.float64)
    curvature = unit_phasor(math.pi / area * position**2 - math.pi / 4) / math.sqrt(area)
    ratio = None
    if plan.reach is not None:
        outer = plan.reach.kept + plan.reach.fade
        curvature *= fading(np.abs(position), plan.reach.kept, outer)
        refuse_large_patch(plan, memory_limit)
        sine = plan.wavelength * plan.frequency_step * np.arange(_frequencies(plan))
        squared = (sine**2)[None, :] + (sine**2)[:, None]
        k_b = 2 * math.pi / plan.wavelength * plan.distance
        cosine = np.sqrt(np.maximum(1 - squared, 0.0))
        # −k b (sin²θ/(1 + cos θ) − sin²θ/2), without cancellation.
        phase = -k_b / 2 * (squared / (1 + cosine)) ** 2
        quadrant = unit_phasor(phase) / (1 + 1j / k_b * cosine)
        quadrant = (quadrant * fading(np.sqrt(squared), *plan.reach.steepest)).astype(kind)
        half = np.concatenate([quadrant[:0:-1], quadrant])
        ratio = np.concatenate([half[:, :0:-1], half], axis=1)
    return PatchLaw(plan=plan, curvature=curvature, ratio=ratio)


def _frequencies(plan: PatchPlan) -> int:
    """Frequencies along a side of a quadrant of the transfer function."""
    steepest = float(_sine(np.array([plan.farthest / plan.distance]))[0])
    return plan.count // 2 + math.ceil(steepest / plan.wavelength / plan.frequency_step) + 2


def refuse_large_patch(plan: PatchPlan, memory_limit: float) -> None:
    """Refuse a patch whose transfer function exceeds the memory [bytes]."""
    needed = 4 * 16.0 * _frequencies(plan) ** 2
    if plan.reach is not None and needed > memory_limit:
        raise UnaffordableError(
            "the transfer function behind a microlens",
            value=f"{needed / 1e9:.3g} GB",
            limit=f"{memory_limit / 1e9:.3g} GB",
            remedy="check the sizes of the microlenses and of the source, or raise the tolerance or the memory limit",
        )


def patch_fields(
    law: PatchLaw, *, x: FloatArray, y: FloatArray, strengths: ComplexArray, middles: FloatArray, tolerance: float
) -> ComplexArray:
    """Field of each set of nodes on its own patch.

    Parameters
    ----------
    law
        Samples and propagation law.
    x, y
        Node positions relative to the set's origin [m], shape (n,), the same for every set.
    strengths
        Field times area weight, shape (sets, n); its precision is that of the result.
    middles
        Middle sample (x, y) of each patch relative to the set's origin [m], shape (sets, 2).
    tolerance
        Tolerance of the nonuniform FFT.

    Returns
    -------
    ndarray
        Field, shape (sets, side, side).
    """
    plan, kind = law.plan, strengths.dtype
    area, real = plan.wavelength * plan.distance, real_type(strengths)
    steps = np.zeros(middles.shape, dtype=int)
    origin = middles
    if law.ratio is not None:  # Fresnel's law sends the carrier here, and Kirchhoff's law to the middle
        steps = np.rint(_sine(middles / plan.distance) / (plan.wavelength * plan.frequency_step)).astype(int)
        origin = area * plan.frequency_step * steps
    bent = unit_phasor(math.pi / area * (x**2 + y**2))
    tilt = unit_phasor(
        math.pi / area * np.sum(origin**2, axis=1, keepdims=True)
        - 2 * math.pi / area * (origin[:, :1] * x + origin[:, 1:] * y)
    )
    scale = 2 * math.pi * plan.spacing / area
    sums = finufft.nufft2d1(
        (scale * y).astype(real),
        (scale * x).astype(real),
        (strengths * (bent * tilt)).astype(kind),
        (plan.count, plan.count),
        eps=tolerance,
        isign=-1,
        nthreads=1,
    ).reshape(-1, plan.count, plan.count)
    moved = middles - origin
    from_middle = plan.spacing * (np.arange(plan.side) - plan.half)
    carriers = [
        unit_phasor(2 * math.pi / area * origin[:, axis, None] * (from_middle + moved[:, axis, None]))
        for axis in (0, 1)
    ]
    if law.ratio is None:
        along_x, along_y = ((law.curvature * carrier).astype(kind) for carrier in carriers)
        sums *= along_y[:, :, None]
        sums *= along_x[:, None, :]
        return np.asarray(sums)
    along_x, along_y = (carrier.astype(kind) for carrier in carriers)
    fields = np.asarray(_corrected(law, law.ratio, sums, steps, moved))
    fields *= along_y[:, :, None]
    fields *= along_x[:, None, :]
    return fields


def _corrected(
    law: PatchLaw, ratio: ComplexArray, sums: ComplexArray, steps: IndexArray, moved: FloatArray
) -> ComplexArray:
    """Kirchhoff's field over its carrier, on patches that lie `moved` from where Fresnel's law puts them."""
    plan = law.plan
    curvature = (law.curvature[:, None] * law.curvature).astype(sums.dtype)
    frequencies = scipy.fft.fftfreq(plan.count, plan.spacing)
    start = moved + plan.spacing * (plan.count // 2 - plan.half)
    shift_x, shift_y = (
        unit_phasor(2 * math.pi * np.outer(start[:, axis], frequencies)).astype(sums.dtype) for axis in (0, 1)
    )
    fields = np.empty((sums.shape[0], plan.side, plan.side), dtype=sums.dtype)
    for patch, field, step, x_phase, y_phase in zip(sums, fields, steps, shift_x, shift_y, strict=True):
        patch *= curvature
        spectrum = scipy.fft.fft2(patch, overwrite_x=True)
        _multiply(spectrum, ratio, step)
        spectrum *= y_phase[:, None]
        partial = scipy.fft.ifft(spectrum, axis=0, overwrite_x=True)[: plan.side]
        partial *= x_phase
        field[:] = scipy.fft.ifft(partial, axis=1, overwrite_x=True)[:, : plan.side]
    return fields


def _multiply(spectrum: ComplexArray, ratio: ComplexArray, carrier: IndexArray) -> None:
    """Multiply a spectrum, in the order of the FFT, by a table about a carrier (x, y) in frequency steps."""
    middle, count = ratio.shape[0] // 2, spectrum.shape[0]
    # In FFT order, frequencies from zero up come first, then the negative ones; about a carrier, each group is
    # contiguous.
    lies = ((slice(0, -(-count // 2)), 0), (slice(-(-count // 2), count), -count))
    for rows, from_y in lies:
        for columns, from_x in lies:
            window = tuple(
                slice(middle + int(carrier[axis]) + shift + part.start, middle + int(carrier[axis]) + shift + part.stop)
                for axis, part, shift in ((1, rows, from_y), (0, columns, from_x))
            )
            spectrum[rows, columns] *= ratio[window]
