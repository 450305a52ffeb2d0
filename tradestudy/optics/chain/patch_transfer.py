"""From one microlens to a patch of the detector: Fresnel's law by one transform, and Kirchhoff's law from it.

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

from tradestudy.errors import UnaffordableError
from tradestudy.optics.arrays import FloatArray, IndexArray
from tradestudy.optics.chain.detector_transfer import decades, fading, fading_length, real_type
from tradestudy.optics.phasors import ComplexArray, unit_phasor

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
    at = plan.spacing * np.arange(-(plan.count // 2), plan.count - plan.count // 2, dtype=np.float64)
    curvature = unit_phasor(math.pi / area * at**2 - math.pi / 4) / math.sqrt(area)
    ratio = None
    if plan.reach is not None:
        outer = plan.reach.kept + plan.reach.fade
        curvature *= fading(np.abs(at), plan.reach.kept, outer)
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
        along_x, along_y = ((law.curvature * one).astype(kind) for one in carriers)
        sums *= along_y[:, :, None]
        sums *= along_x[:, None, :]
        return np.asarray(sums)
    along_x, along_y = (one.astype(kind) for one in carriers)
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
    for each, field, step, x_phase, y_phase in zip(sums, fields, steps, shift_x, shift_y, strict=True):
        each *= curvature
        spectrum = scipy.fft.fft2(each, overwrite_x=True)
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
            here = tuple(
                slice(middle + int(carrier[axis]) + shift + part.start, middle + int(carrier[axis]) + shift + part.stop)
                for axis, part, shift in ((1, rows, from_y), (0, columns, from_x))
            )
            spectrum[rows, columns] *= ratio[here]
