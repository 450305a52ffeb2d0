"""The boundary-diffracted wave (Maggi, Rubinowicz, Miyamoto, Wolf): diffraction as light from the edge of the aperture.

A wave behind an aperture is the light of geometrical optics plus a wave from the edge,

    U_B(P) = (1/4π) ∮ A exp(i k (path + s))/s · (p × ŝ)·dl / (1 − p·ŝ),

with p the direction of the arriving wave, ŝ the direction to the target, and the edge traversed from x to y.
Both parts jump where P crosses the shadow of the edge; their sum does not. Near the shadow, the integrand has a pair of
poles close to the real axis of the angle. The trapezoidal rule over the angle, corrected by the residues of these
poles, converges fast right up to the shadow.

The formula is exact for a spherical wave with the textbook obliquity (and its 1/(k r) terms); for other waves and
obliquities it is the leading term for many Fresnel zones across the aperture.

References
----------
A. Rubinowicz, "Die Beugungswelle in der Kirchhoffschen Theorie der Beugungserscheinungen", 1917;
K. Miyamoto and E. Wolf, "Generalization of the Maggi–Rubinowicz theory of the boundary diffraction wave", 1962;
L. N. Trefethen and J. A. C. Weideman, "The exponentially convergent trapezoidal rule", 2014 (poles).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from tradestudy.optics.arrays import BoolArray, FloatArray

if TYPE_CHECKING:  # the package of methods imports this one
    from tradestudy.optics.phasors import ComplexArray
    from tradestudy.optics.propagation.kernels import KirchhoffKernel
    from tradestudy.optics.propagation.lens import LensWave
    from tradestudy.optics.propagation.paths import Array
    from tradestudy.optics.propagation.rays import Rays

_PAIRS_AT_ONCE = 12_000  # a dozen arrays of this size stay in the second-level cache
_POLE_STEPS = 12
_LEAST_DEPTH = (
    1e-7  # a target exactly on the shadow of the edge: the two poles meet there, and only their sum is finite
)


@dataclass(frozen=True, kw_only=True)
class EdgeField:
    """Field of the edge at flat targets, and where its poles were not found.

    Attributes
    ----------
    field
        Boundary-diffracted wave, shape (m,).
    failed
        Targets next to the shadow of the edge whose poles were not found.
    """

    field: ComplexArray
    failed: BoolArray


def edge_field(
    *,
    wave: LensWave,
    kernel: KirchhoffKernel,
    rays: Rays,
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    count: int,
    tolerance: float,
) -> EdgeField:
    """Boundary-diffracted wave of a circular lens.

    Parameters
    ----------
    wave
        Wave behind the lens, with exact paths.
    kernel
        Kernel whose obliquity is used; an obliquity other than the textbook one enters by its ratio to it on the edge.
    rays
        One ray to every target, from `find_rays`.
    x, y, z
        Targets relative to the centre of the lens [m], shape (m,).
    count
        Nodes on the edge.
    tolerance
        Fraction of the geometric light below which the effect of a pole is left uncorrected; from 1e-5 up, sines are
        computed in single precision.

    Returns
    -------
    EdgeField
        Wave to add to the field of the rays that pass inside the aperture.
    """
    # Two node sets, half a step apart: a target takes the one whose nodes stay away from its pole.
    bearing = np.arctan2(rays.v[0], rays.u[0])
    nearest = np.mod(bearing * count / (2 * math.pi), 1.0)
    shifted = (nearest < 0.25) | (nearest > 0.75)
    field = np.zeros(x.size, dtype=np.complex128)
    for chosen, start in ((~shifted, 0.0), (shifted, math.pi / count)):
        angle = start + 2 * math.pi * np.arange(count) / count
        index = np.flatnonzero(chosen)
        for part in np.array_split(index, max(1, math.ceil(index.size * count / _PAIRS_AT_ONCE))):
            field[part] = _trapezoid(wave, kernel, angle, x[part], y[part], z[part], tolerance)
    start_of = np.where(shifted, math.pi / count, 0.0)
    correction, failed = _pole_terms(wave, kernel, rays, x, y, z, count, start_of, tolerance)
    return EdgeField(field=field + correction, failed=failed)


def pole_reach(count: int, tolerance: float) -> float:
    """Distance of a pole from the edge, |ln(ray radius/aperture radius)|, beyond which it needs no correction."""
    return -1.2 * math.log(tolerance) / count


def _trapezoid(
    wave: LensWave, kernel: KirchhoffKernel, angle: FloatArray, x: Array, y: Array, z: Array, tolerance: float
) -> ComplexArray:
    """Sum over the nodes of the edge, for every target."""
    if x.size == 0:
        return np.zeros(0, dtype=np.complex128)
    k, radius = wave.wavenumber, wave.lens.radius
    cos, sin = np.cos(angle), np.sin(angle)
    u, v = radius * cos, radius * sin
    p_x, p_y = wave.paths.slope(u, v)
    p_z = wave.axial_cosine(u, v)
    outward = p_x * cos + p_y * sin
    strength = wave.field(u, v) * (0.5 * radius / angle.size)  # (1/4π) · R · 2π/n
    # p·S, (p × S)·t and −2 P·q, with S = P − q and t = (−sin, cos, 0), are linear in (x, y, z, 1): one product.
    nothing, one = np.zeros_like(u), np.ones_like(u)
    linear = [
        [p_x, p_y, p_z, -radius * outward],
        [p_z * cos, p_z * sin, -outward, -radius * p_z],
        [-2 * u, -2 * v, nothing, radius**2 * one],
    ]
    targets = np.stack([x, y, z, np.ones_like(x)], axis=1)
    along, weight, s = (targets @ np.asarray(rows) for rows in linear)
    centre = np.sqrt(x * x + y * y + z * z)[:, None]
    s += centre * centre
    np.sqrt(s, out=s)
    along -= s
    along *= s
    weight /= along
    weight = -weight * _obliquity_ratio(kernel, p_z, s, z[:, None])  # complex with the near term
    s -= centre
    terms = _turned(weight, s, k, tolerance)
    total = np.einsum("ij,j->i", terms, strength)  # without threads for a small product
    return np.asarray(total * np.exp(1j * k * centre[:, 0]))


def _turned(weight: Array, path: FloatArray, k: float, tolerance: float) -> ComplexArray:
    """weight · exp(i k path); where 1e-7 is enough, full turns are removed and sines computed in single precision."""
    if tolerance < 1e-5:
        phase = k * path
        cos, sin = np.cos(phase), np.sin(phase)
    else:
        turns = path * (k / (2 * math.pi))
        turns -= np.rint(turns)
        single = turns.astype(np.float32)
        single *= np.float32(2 * math.pi)
        cos, sin = np.cos(single), np.sin(single)
    terms = np.empty(path.shape, dtype=np.complex128)
    if np.iscomplexobj(weight):
        terms.real, terms.imag = cos, sin
        terms *= weight
        return terms
    np.multiply(cos, weight, out=terms.real)
    np.multiply(sin, weight, out=terms.imag)
    return terms


def _obliquity_ratio(kernel: KirchhoffKernel, p_z: Array, s: Array, z: Array) -> Array | float:
    """Requested obliquity, relative to the textbook one (p_z + z/s)/2."""
    if kernel.obliquity == "textbook":
        return 1.0
    ratio = 2 * z / (p_z * s + z)
    if kernel.obliquity == "paper":
        return np.asarray(ratio)
    return np.asarray(ratio * (1 + 1j / (kernel.wavenumber * s)))


@dataclass(frozen=True, kw_only=True)
class _EdgePoint:
    """Geometry at complex angles of the edge; every entry is conjugate at the conjugate angle."""

    u: Array
    v: Array
    p_z: Array
    s: Array
    path: Array  # along the wave and on to the target
    across: Array  # (p × S)·t
    denominator: Array  # s − p·S
    slope: Array  # its derivative with respect to the angle

    def conjugate(self) -> _EdgePoint:
        return _EdgePoint(**{f.name: np.conj(getattr(self, f.name)) for f in fields(self)})


def _edge_point(wave: LensWave, angle: ComplexArray, x: Array, y: Array, z: Array) -> _EdgePoint:
    radius = wave.lens.radius
    cos, sin = np.cos(angle), np.sin(angle)
    u, v = radius * cos, radius * sin
    wavefront = wave.paths.expansion(u, v)
    p_x, p_y = wavefront.p_x, wavefront.p_y
    p_z = np.sqrt(1 - p_x * p_x - p_y * p_y)
    turn_x = radius * (wavefront.xy * cos - wavefront.xx * sin)
    turn_y = radius * (wavefront.yy * cos - wavefront.xy * sin)
    turn_z = -(p_x * turn_x + p_y * turn_y) / p_z
    a, b = x - u, y - v
    s = np.sqrt(a * a + b * b + z * z)
    to_x, to_y, to_z = a / s, b / s, z / s
    ds = radius * (to_x * sin - to_y * cos)
    # d = p − ŝ vanishes at the poles: from it, 1 − p·ŝ = d·d/2 keeps its digits, and so does its derivative.
    d_x, d_y, d_z = p_x - to_x, p_y - to_y, p_z - to_z
    turn = (
        d_x * (turn_x - (radius * sin - to_x * ds) / s)
        + d_y * (turn_y + (radius * cos + to_y * ds) / s)
        + d_z * (turn_z + to_z * ds / s)
    )
    half = (d_x * d_x + d_y * d_y + d_z * d_z) / 2
    return _EdgePoint(
        u=u,
        v=v,
        p_z=p_z,
        s=s,
        path=wavefront.value + s,
        across=s * ((p_x * cos + p_y * sin) * d_z - (d_x * cos + d_y * sin) * p_z),
        denominator=s * half,
        slope=s * turn + ds * half,
    )


def _residue(wave: LensWave, kernel: KirchhoffKernel, at: _EdgePoint, z: Array) -> ComplexArray:
    """Residue of the integrand over the angle at a zero of its denominator."""
    strength = wave.amplitude(at.u, at.v) * np.exp(1j * wave.wavenumber * at.path)
    ratio = _obliquity_ratio(kernel, at.p_z, at.s, z)
    return np.asarray(strength * (wave.lens.radius / (4 * math.pi)) * at.across / at.s * ratio / at.slope)


def _pole_terms(
    wave: LensWave,
    kernel: KirchhoffKernel,
    rays: Rays,
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    count: int,
    start: FloatArray,
    tolerance: float,
) -> tuple[ComplexArray, BoolArray]:
    """Correction of the trapezoidal rule for the poles near the edge.

    With residues r above and below the real axis of the angle, the integral is the sum plus
    2πi [Σ_above r/(1 − exp(−i n (θ − θ₀))) + Σ_below r/(exp(i n (θ − θ₀)) − 1)].
    """
    correction = np.zeros(x.size, dtype=np.complex128)
    failed = np.zeros(x.size, dtype=bool)
    distance = np.hypot(rays.u[0], rays.v[0]) / wave.lens.radius
    with np.errstate(divide="ignore"):  # a ray through the vertex has its poles at infinity
        depth = np.abs(np.log(distance))
    near = np.flatnonzero(rays.found[0] & (depth < pole_reach(count, tolerance)))
    if near.size == 0:
        return correction, failed
    x, y, z = x[near], y[near], z[near]
    start_angle = np.arctan2(rays.v[0, near], rays.u[0, near]) + 1j * np.maximum(depth[near], _LEAST_DEPTH)
    angle, above, converged = _find_poles(wave, start_angle, x, y, z)
    total = np.zeros(near.size, dtype=np.complex128)
    for at, pole, sign in ((above, angle, 1), (above.conjugate(), angle.conj(), -1)):
        decay = np.exp(-sign * 1j * count * (pole - start[near]))
        # Above: 1/(1 − decay). Below: 1/(decay − 1).
        total += 2j * math.pi * _residue(wave, kernel, at, z) / (sign * (1 - decay))
    correction[near] = np.where(converged, total, 0.0)
    failed[near] = ~converged | (depth[near] < _LEAST_DEPTH)
    return correction, failed


def _find_poles(
    wave: LensWave, angle: ComplexArray, x: Array, y: Array, z: Array
) -> tuple[ComplexArray, _EdgePoint, BoolArray]:
    """Zeros of the denominator next to starting angles, above or on the real axis, by Newton's method."""
    at = _edge_point(wave, angle, x, y, z)
    for _ in range(_POLE_STEPS):
        step = np.where(at.slope == 0, 0.0, at.denominator / np.where(at.slope == 0, 1.0, at.slope))
        size = np.abs(step)
        angle = angle - step * np.minimum(1.0, 0.3 / np.maximum(size, 0.3))
        at = _edge_point(wave, angle, x, y, z)
        # The convergence is quadratic relative to the distance between the two poles.
        if np.max(size / np.maximum(np.abs(angle.imag), _LEAST_DEPTH)) < 1e-4:
            break
    return angle, at, np.asarray((size < 1e-3) & (angle.imag > 0))
