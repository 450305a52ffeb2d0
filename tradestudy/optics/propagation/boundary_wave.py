"""Rays through a lens, and the boundary-diffraction wave from the rim of its aperture.

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

import numpy as np

from tradestudy.optics.arrays import BoolArray, ComplexArray, FloatArray, unit_phasor
from tradestudy.optics.propagation.kernels import Kernel, KirchhoffKernel
from tradestudy.optics.propagation.lens import LensWave
from tradestudy.optics.propagation.paths import Array, PathSum, SphericalPath

_MAX_STEPS = 60
_STARTS_PER_RING = (1, 8, 16)


@dataclass(frozen=True, kw_only=True)
class Rays:
    """Rays that reach targets; arrays of shape (branches, targets).

    Attributes
    ----------
    u, v
        Where the ray leaves the lens plane, relative to the centre of the lens [m].
    found
        Whether there is such a ray; it may lie outside the aperture.
    determinant
        Determinant of the second derivatives of the path over the aperture [1/m²]: zero on a caustic.
    trace
        Their trace [1/m].
    """

    u: FloatArray
    v: FloatArray
    found: BoolArray
    determinant: FloatArray
    trace: FloatArray

    def inside(self, radius: float) -> BoolArray:
        """Whether rays pass through the aperture."""
        return np.asarray(self.found & (np.hypot(self.u, self.v) <= radius))


def find_rays(wave: LensWave, x: FloatArray, y: FloatArray, z: FloatArray, *, all_branches: bool) -> Rays:
    """Find the points q of the lens plane with ∇(path(q) + |P − q|) = 0.

    Parameters
    ----------
    wave
        Wave behind the lens, with exact paths.
    x, y, z
        Targets relative to the centre of the lens [m], shape (m,).
    all_branches
        Whether to look for every ray, as behind a caustic; otherwise only for the one next to the paraxial ray.
    """
    paths = wave.paths
    if len(paths.terms) == 1 and isinstance(paths.terms[0], SphericalPath):
        u, v = _through_focus(paths.terms[0], x, y, z)
        return _with_curvature(paths, u[None], v[None], x, y, z, np.isfinite(u)[None])
    start_u, start_v = _starts(wave.lens.radius, all_branches)
    u = np.broadcast_to(start_u[:, None], (start_u.size, x.size)).copy()
    v = np.broadcast_to(start_v[:, None], u.shape).copy()
    converged = _newton(paths, u, v, x, y, z, wave.lens.radius)
    if all_branches:
        converged = _distinct(u, v, converged, wave.lens.radius)
    return _with_curvature(paths, u, v, x, y, z, converged)


def ray_fields(wave: LensWave, kernel: Kernel, rays: Rays, x: FloatArray, y: FloatArray, z: FloatArray) -> ComplexArray:
    """Field of every ray by stationary phase, 0 for those outside the aperture, shape (branches, targets).

    iλ A(q) K(q, P) exp(i k path)/√|det|, times −i for a saddle of the path and −1 for a maximum; infinite on a
    caustic. For a spherical wave that is exact geometrical optics.
    """
    inside = rays.inside(wave.lens.radius)
    u, v = np.where(inside, rays.u, 0.0), np.where(inside, rays.v, 0.0)
    cosine = wave.axial_cosine(u, v)
    turned = np.where(rays.determinant < 0, -1j, np.where(rays.trace < 0, -1.0, 1.0))
    onward, spreading = kernel.path_and_spreading(u, v, cosine, x, y, z)
    path = wave.paths.value(u, v) + onward + kernel.path(x, y, z)
    strength = wave.amplitude(u, v) * spreading
    with np.errstate(divide="ignore", invalid="ignore"):  # on a caustic the field of a ray is infinite
        magnitude = np.where(rays.determinant == 0, np.inf, 1 / np.sqrt(np.abs(rays.determinant)))
    field = np.zeros(u.shape, dtype=np.complex128)
    finite = inside & np.isfinite(magnitude)
    field[finite] = (strength * turned * unit_phasor(np.asarray(wave.wavenumber * path)))[finite] * magnitude[finite]
    field[inside & ~finite] = np.inf
    return field


def one_ray_per_target(wave: LensWave, z: FloatArray) -> bool:
    """Whether the map from the aperture along the rays to the nearest and farthest target plane is one to one.

    A sufficient criterion: the symmetric part of the map's derivative keeps one sign over the (convex) aperture. Also
    False where the phase is steeper than that of any ray.
    """
    paths = wave.paths
    if len(paths.terms) == 1:
        return True  # straight lines through one point
    u, v = aperture_mesh(wave.lens.radius)
    p_x, p_y = paths.slope(u, v)
    if np.max(p_x**2 + p_y**2) >= 1.0:
        return False
    front = paths.expansion(u, v)
    xx, xy, yy = front.xx, front.xy, front.yy
    c = np.sqrt(1 - p_x**2 - p_y**2)
    for distance in {float(z.min()), float(z.max())}:
        # Derivative of q + z p/c with respect to q.
        a = 1 + distance / c * (xx + p_x * (p_x * xx + p_y * xy) / c**2)
        b = distance / c * (xy + p_x * (p_x * xy + p_y * yy) / c**2)
        d = distance / c * (xy + p_y * (p_x * xx + p_y * xy) / c**2)
        e = 1 + distance / c * (yy + p_y * (p_x * xy + p_y * yy) / c**2)
        definite = a * e - ((b + d) / 2) ** 2 > 0
        if not definite.all() or (a > 0).any() != (a > 0).all():
            return False
    return True


def fewest_zones(wave: LensWave, z: float) -> float:
    """Smallest number of Fresnel zones across the aperture, of all targets that rays meet in a plane; 0 at a caustic.

    It is R² √|det|/λ, from the determinant of the path's second derivatives: for a spherical wave, the Fresnel number
    R² |1/z − 1/b|/λ.
    """
    u, v = aperture_mesh(wave.lens.radius)
    x, y = land(wave, u, v, np.asarray(z))
    *_, xx, xy, yy = _derivatives(wave.paths, u, v, x, y, np.asarray(z))
    return float(wave.lens.radius**2 * np.sqrt(np.abs(xx * yy - xy * xy).min()) / wave.wavelength)


def aperture_mesh(radius: float) -> tuple[FloatArray, FloatArray]:
    """Points on 16 rings of an aperture out to its edge, flat."""
    ring, angle = radius * np.arange(1, 17) / 16.0, 2 * np.pi * np.arange(32) / 32
    return np.multiply.outer(ring, np.cos(angle)).ravel(), np.multiply.outer(ring, np.sin(angle)).ravel()


def within_rim(wave: LensWave, x: FloatArray, y: FloatArray, z: FloatArray) -> BoolArray:
    """Whether targets lie within the curve where the rays from the rim land: winding number by quadrant angles."""
    angle = 2 * np.pi * np.arange(129) / 128
    rim_x, rim_y = land(wave, wave.lens.radius * np.cos(angle), wave.lens.radius * np.sin(angle), z[:, None])
    bearing = np.arctan2(rim_y - y[:, None], rim_x - x[:, None])
    turn = np.diff(bearing, axis=1)
    return np.asarray(np.abs(np.sum(turn - 2 * np.pi * np.round(turn / (2 * np.pi)), axis=1)) > np.pi)


def land(wave: LensWave, u: FloatArray, v: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where rays that leave the lens at (u, v) meet the planes z, by plain tracing."""
    p_x, p_y = wave.paths.slope(u, v)
    c = np.sqrt(1 - p_x**2 - p_y**2)
    return u + z * p_x / c, v + z * p_y / c


def _through_focus(sphere: SphericalPath, x: Array, y: Array, z: Array) -> tuple[FloatArray, FloatArray]:
    """Where the straight line through the centre of a spherical wave and a target meets the lens plane."""
    with np.errstate(divide="ignore", invalid="ignore"):  # in the focal plane no ray reaches any other point
        share = z / (z + sphere.distance)
        u, v = x - (x - sphere.x) * share, y - (y - sphere.y) * share
    # In the focus itself all rays meet: any of them represents the caustic.
    miss = np.hypot(np.hypot(x - sphere.x, y - sphere.y), z + sphere.distance)
    absent = np.where(miss < 1e-12 * z, 0.0, np.nan)
    return np.where(np.isfinite(share), u, absent), np.where(np.isfinite(share), v, absent)


def _starts(radius: float, all_branches: bool) -> tuple[FloatArray, FloatArray]:
    """Starting points of Newton's method: the vertex, and rings over the aperture."""
    if not all_branches:
        return np.zeros(1), np.zeros(1)
    ring = np.repeat(radius * np.asarray([0.0, 0.5, 0.95]), _STARTS_PER_RING)
    angle = np.concatenate([2 * np.pi * (np.arange(n) + 0.25) / n for n in _STARTS_PER_RING])
    return ring * np.cos(angle), ring * np.sin(angle)


def _newton(paths: PathSum, u: Array, v: Array, x: Array, y: Array, z: Array, radius: float) -> BoolArray:
    """Newton's method in place on the gradient of the path; True where it converged."""
    active = np.ones(u.shape, dtype=bool)
    converged = np.zeros(u.shape, dtype=bool)
    target = np.broadcast_to(np.arange(x.size), u.shape)
    for step_number in range(_MAX_STEPS):
        index = target[active]
        here_u, here_v = u[active], v[active]
        step_u, step_v = _step(paths, here_u, here_v, x[index], y[index], z[index])
        length = np.hypot(step_u, step_v)
        # The first step is the paraxial ray and may be long; later ones are limited to a third of the radius.
        longest = 50 * radius if step_number == 0 else radius / 3
        with np.errstate(invalid="ignore", divide="ignore"):  # a flat path gives no step: that start is dropped
            shrink = np.minimum(1.0, longest / np.where(length > 0, length, 1.0))
            u[active], v[active] = here_u + shrink * step_u, here_v + shrink * step_v
            # The next step would be about the square of this one, and the path changes by the square of that.
            done = length < 1e-4 * radius
            lost = ~np.isfinite(length) | (np.hypot(u[active], v[active]) > 60 * radius)
        converged[active] = done
        going = np.zeros_like(active)
        going[active] = ~done & ~lost
        active = going
        if not active.any():
            break
    return converged


def _step(paths: PathSum, u: Array, v: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
    """Newton's step towards zero gradient of the path."""
    g_x, g_y, xx, xy, yy = _derivatives(paths, u, v, x, y, z)
    determinant = xx * yy - xy * xy
    with np.errstate(divide="ignore", invalid="ignore"):  # a flat path gives no step: that start is dropped
        return (xy * g_y - yy * g_x) / determinant, (xy * g_x - xx * g_y) / determinant


def _derivatives(paths: PathSum, u: Array, v: Array, x: Array, y: Array, z: Array) -> tuple[Array, ...]:
    """Gradient and second derivatives of the path to the target by way of (u, v)."""
    front = paths.expansion(u, v)
    a, b = u - x, v - y
    s = np.sqrt(a * a + b * b + z * z)
    cos_x, cos_y = a / s, b / s
    return (
        front.p_x + cos_x,
        front.p_y + cos_y,
        front.xx + (1 - cos_x * cos_x) / s,
        front.xy - cos_x * cos_y / s,
        front.yy + (1 - cos_y * cos_y) / s,
    )


def _distinct(u: Array, v: Array, converged: BoolArray, radius: float) -> BoolArray:
    """Keep one of the starts that ended at the same ray."""
    kept = np.zeros_like(converged)
    for i in range(u.shape[0]):
        with np.errstate(invalid="ignore"):
            same = np.hypot(u[:i] - u[i], v[:i] - v[i]) < 1e-6 * radius
        kept[i] = converged[i] & ~(same & kept[:i]).any(axis=0)
    return kept


def _with_curvature(paths: PathSum, u: Array, v: Array, x: Array, y: Array, z: Array, found: BoolArray) -> Rays:
    safe_u, safe_v = np.where(found, u, 0.0), np.where(found, v, 0.0)
    *_, xx, xy, yy = _derivatives(paths, safe_u, safe_v, x, y, z)
    return Rays(u=safe_u, v=safe_v, found=found, determinant=xx * yy - xy * xy, trace=xx + yy)


_PAIRS_AT_ONCE = 12_000  # a dozen arrays of this size stay in the second-level cache
_POLE_STEPS = 12
_LEAST_DEPTH = (
    1e-7  # a target exactly on the shadow of the edge: the two poles meet there, and only their sum is finite
)


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
) -> tuple[ComplexArray, BoolArray]:
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
    Wave to add to the field of the rays that pass inside the aperture, shape (m,), and which targets next to the shadow
    of the edge have poles that were not found, shape (m,).
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
    return field + correction, failed


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
    zeros, ones = np.zeros_like(u), np.ones_like(u)
    linear = [
        [p_x, p_y, p_z, -radius * outward],
        [p_z * cos, p_z * sin, -outward, -radius * p_z],
        [-2 * u, -2 * v, zeros, radius**2 * ones],
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
    # The path from the centre is left out of the many sines, which may be in single precision, and added at the end.
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


def _residue(wave: LensWave, kernel: KirchhoffKernel, pole: _EdgePoint, z: Array) -> ComplexArray:
    """Residue of the integrand over the angle at a zero of its denominator."""
    strength = wave.amplitude(pole.u, pole.v) * np.exp(1j * wave.wavenumber * pole.path)
    ratio = _obliquity_ratio(kernel, pole.p_z, pole.s, z)
    return np.asarray(strength * (wave.lens.radius / (4 * math.pi)) * pole.across / pole.s * ratio / pole.slope)


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
    for point, pole, sign in ((above, angle, 1), (above.conjugate(), angle.conj(), -1)):
        decay = np.exp(-sign * 1j * count * (pole - start[near]))
        # Above: 1/(1 − decay). Below: 1/(decay − 1).
        total += 2j * math.pi * _residue(wave, kernel, point, z) / (sign * (1 - decay))
    correction[near] = np.where(converged, total, 0.0)
    failed[near] = ~converged | (depth[near] < _LEAST_DEPTH)
    return correction, failed


def _find_poles(
    wave: LensWave, angle: ComplexArray, x: Array, y: Array, z: Array
) -> tuple[ComplexArray, _EdgePoint, BoolArray]:
    """Zeros of the denominator next to starting angles, above or on the real axis, by Newton's method."""
    point = _edge_point(wave, angle, x, y, z)
    for _ in range(_POLE_STEPS):
        step = np.where(point.slope == 0, 0.0, point.denominator / np.where(point.slope == 0, 1.0, point.slope))
        size = np.abs(step)
        angle = angle - step * np.minimum(1.0, 0.3 / np.maximum(size, 0.3))
        point = _edge_point(wave, angle, x, y, z)
        # The convergence is quadratic relative to the distance between the two poles.
        if np.max(size / np.maximum(np.abs(angle.imag), _LEAST_DEPTH)) < 1e-4:
            break
    return angle, point, np.asarray((size < 1e-3) & (angle.imag > 0))
