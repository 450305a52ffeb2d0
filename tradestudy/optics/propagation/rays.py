"""Rays from a lens to given targets: the points of the aperture where the path is stationary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.phasors import ComplexArray, unit_phasor
from tradestudy.optics.propagation.kernels import Kernel
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
    found = _newton(paths, u, v, x, y, z, wave.lens.radius)
    if all_branches:
        found = _distinct(u, v, found, wave.lens.radius)
    return _with_curvature(paths, u, v, x, y, z, found)


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
    seen = np.arctan2(rim_y - y[:, None], rim_x - x[:, None])
    turn = np.diff(seen, axis=1)
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
    found = np.zeros(u.shape, dtype=bool)
    target = np.broadcast_to(np.arange(x.size), u.shape)
    for step_number in range(_MAX_STEPS):
        at = target[active]
        here_u, here_v = u[active], v[active]
        step_u, step_v = _step(paths, here_u, here_v, x[at], y[at], z[at])
        length = np.hypot(step_u, step_v)
        # The first step is the paraxial ray and may be long; later ones are limited to a third of the radius.
        longest = 50 * radius if step_number == 0 else radius / 3
        with np.errstate(invalid="ignore", divide="ignore"):  # a flat path gives no step: that start is dropped
            shrink = np.minimum(1.0, longest / np.where(length > 0, length, 1.0))
            u[active], v[active] = here_u + shrink * step_u, here_v + shrink * step_v
            # The next step would be about the square of this one, and the path changes by the square of that.
            done = length < 1e-4 * radius
            lost = ~np.isfinite(length) | (np.hypot(u[active], v[active]) > 60 * radius)
        found[active] = done
        going = np.zeros_like(active)
        going[active] = ~done & ~lost
        active = going
        if not active.any():
            break
    return found


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


def _distinct(u: Array, v: Array, found: BoolArray, radius: float) -> BoolArray:
    """Keep one of the starts that ended at the same ray."""
    kept = np.zeros_like(found)
    for i in range(u.shape[0]):
        with np.errstate(invalid="ignore"):
            same = np.hypot(u[:i] - u[i], v[:i] - v[i]) < 1e-6 * radius
        kept[i] = found[i] & ~(same & kept[:i]).any(axis=0)
    return kept


def _with_curvature(paths: PathSum, u: Array, v: Array, x: Array, y: Array, z: Array, found: BoolArray) -> Rays:
    safe_u, safe_v = np.where(found, u, 0.0), np.where(found, v, 0.0)
    *_, xx, xy, yy = _derivatives(paths, safe_u, safe_v, x, y, z)
    return Rays(u=safe_u, v=safe_v, found=found, determinant=xx * yy - xy * xy, trace=xx + yy)
