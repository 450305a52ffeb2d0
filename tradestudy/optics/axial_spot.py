"""Light of an on-axis point behind a circular lens: Kirchhoff's and Fresnel's integrals over the radius alone."""

from __future__ import annotations

import math

import numpy as np

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation.lens import LensPhase
from tradestudy.optics.quadrature import gauss_legendre

_BLOCK = 128  # radii that share a rule: inner ones need fewer nodes, and a block stays in the processor's cache
_CHECKED = 32  # in each block, every 32nd radius, beginning with the first
_STEP = 32  # between node counts, so that a few rules serve all spots
_MOST_NODES = 2**13
_ANGLES = np.linspace(0.0, np.pi / 2.0, 33)  # α of ρ = R sin α, in which Gauss's nodes are evenly spaced


def axial_kirchhoff_spot(
    radius: FloatArray,
    *,
    wavelength: float,
    aperture_diameter: float,
    focal_length: float,
    object_distance: float,
    plane_distance: float,
    lens_phase: LensPhase,
) -> tuple[FloatArray, float]:
    """Kirchhoff's intensity over the power in the pupil, ``|∬ U K dq|² / ∬ |U|² dq``, with exact paths and cosines.

    U is the light of the point behind the lens, whose amplitude falls off as 1/(a² + ρ²), and
    ``K = b exp(iks)/(iλs²)``. Around a ring of the pupil the path ``s² = b² + ρ² + r² − 2ρr cos φ`` runs from m − X to
    m + X, with X = ρr/m. The angle θ in ``s = m − X cos θ`` turns the mean of K around the ring into

    ``b exp(ikm)/(iλm²) · ⟨exp(−ikXc) / ((1 − 2ηc) √((1 − ηc)² − η²))⟩``,  c = cos θ,  η = X/2m,

    which is exact. The quotient is expanded up to η³; the mean over θ is then a sum of J₀(kX) and J₁(kX).

    Parameters
    ----------
    radius
        r ≥ 0 in the plane [m], ascending, shape (n,).
    wavelength, aperture_diameter
        λ and the diameter of the lens [m], > 0.
    focal_length
        Focal length [m], ≠ 0; < 0 for a diverging lens.
    object_distance
        a [m], ≠ 0; < 0 for light that converges towards a point behind the lens.
    plane_distance
        b [m], > 0.
    lens_phase
        ``perfect`` or ``parabolic``; see `CircularLens`.

    Returns
    -------
    tuple
        Intensity [1/m²], shape (n,), and its relative error (L2): the change with more nodes at some of the radii, plus
        the term in η⁴. η is at most a quarter of the sine of the rim's angle, which keeps this term below 1e-4 at f/4
        and slower; for faster lenses it exceeds 1e-4 only where r is not small compared with b.

    Raises
    ------
    OutOfRangeError
        The lens phase is neither of the two.
    UnaffordableError
        Defocus or aberration needs more than 8192 nodes.

    References
    ----------
    "Diffraction model of a plenoptic camera for in-situ space exploration", eqs. 9–16.
    """
    if lens_phase not in ("perfect", "parabolic"):
        raise OutOfRangeError("lens phase of an axial spot", value=repr(lens_phase), limit="perfect | parabolic")
    k, b, rim = 2.0 * math.pi / wavelength, plane_distance, aperture_diameter / 2.0

    def path_behind_lens(rho: FloatArray) -> FloatArray:
        if lens_phase == "perfect":
            return _spherical_path(rho, 1.0 / object_distance - 1.0 / focal_length)
        return _spherical_path(rho, 1.0 / object_distance) - rho**2 / (2.0 * focal_length)

    def intensity(r: FloatArray, nodes: int) -> FloatArray:
        t, weight = gauss_legendre(nodes)
        rho = rim * np.sqrt(t)
        m, X = _ring_paths(rho, r, b)
        phase = k * (path_behind_lens(rho)[:, np.newaxis] + (m - b))
        real, imaginary = _mean_around_ring(k * X, 1.0 / (2.0 * k * m))
        cosine, sine = np.cos(phase), np.sin(phase)
        amplitude = weight / (1.0 + (rho / object_distance) ** 2)
        square = m**2
        u = _summed(amplitude, (cosine * real - sine * imaginary) / square)
        v = _summed(amplitude, (sine * real + cosine * imaginary) / square)
        return np.asarray(np.pi * (b * rim / wavelength) ** 2 * (1.0 + (rim / object_distance) ** 2) * (u**2 + v**2))

    blocks, changes = [], []
    for r in _blocks(radius):
        rho = rim * np.sin(_ANGLES)
        m, X = _ring_paths(rho, r[[0, -1]], b)
        steps = np.abs(np.diff(path_behind_lens(rho)[:, np.newaxis] + m, axis=0)) + np.diff(X, axis=0)
        nodes = _node_count(k * float(np.max(steps)) / _ANGLES[1])
        blocks.append(intensity(r, nodes))
        changes.append(intensity(r[::_CHECKED], nodes + _STEP) - blocks[-1][::_CHECKED])
    checked = np.concatenate([block[::_CHECKED] for block in blocks])
    quadrature = float(np.linalg.norm(np.concatenate(changes)) / np.linalg.norm(checked))
    # The omitted terms of the field, at most 40 η⁴, count twice in the intensity.
    m, X = _ring_paths(np.array([rim]), radius, b)
    return np.concatenate(blocks), quadrature + 80.0 * float(np.max(X / (2.0 * m))) ** 4


def axial_fresnel_spot(
    radius: FloatArray, *, wavelength: float, aperture_diameter: float, plane_distance: float, defocus_waves: float
) -> FloatArray:
    """Fresnel's intensity of the same point, divided by the power in the pupil [1/m²], shape (n,), to 10 digits.

    ``(π/4) (A/λb)² |∫₀¹ exp(2πi W t) J₀(π A r √t / λb) dt|²``, for W waves of defocus at the rim; `radius` ascends.
    """
    from scipy.special import j0

    scale = math.pi * aperture_diameter / (wavelength * plane_distance)
    of_defocus = 2.0 * np.pi * abs(defocus_waves) * np.sin(2.0 * _ANGLES)
    blocks = []
    for r in _blocks(radius):
        t, weight = gauss_legendre(_node_count(float(np.max(of_defocus + scale * r[-1] * np.cos(_ANGLES)))))
        bessel = j0(np.sqrt(t)[:, np.newaxis] * (scale * r))
        phase = 2.0 * np.pi * defocus_waves * t
        blocks.append(_summed(weight * np.cos(phase), bessel) ** 2 + _summed(weight * np.sin(phase), bessel) ** 2)
    return np.asarray(scale**2 / (4.0 * np.pi) * np.concatenate(blocks))


def _summed(weight: FloatArray, values: FloatArray) -> FloatArray:
    """Weighted sum over the nodes; on one thread, since several would mostly wait for each other."""
    return np.asarray(np.einsum("n,nr->r", weight, values))


def _mean_around_ring(x: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Real and imaginary parts of the mean over θ in `axial_kirchhoff_spot`, for x = kX and q = 1/(2km).

    ``1 + 3ηc + η²(7c² + 1/2) + η³(15c³ + 5c/2)``, with η = q x; the omitted terms are at most 40 η⁴. The means of
    exp(−ixc) times 1, c, c², c³ are J₀, −iJ₁, J₀ − J₁/x and −i(J₁ + J₀/x − 2J₁/x²).
    """
    from scipy.special import j0, j1

    eta, zeroth, first = q * x, j0(x), j1(x)
    real = zeroth * (1.0 + 7.5 * eta**2) - 7.0 * q * eta * first
    imaginary = -eta * ((3.0 + 17.5 * eta**2 - 30.0 * q**2) * first + 15.0 * q * eta * zeroth)
    return real, imaginary


def _ring_paths(rho: FloatArray, r: FloatArray, b: float) -> tuple[FloatArray, FloatArray]:
    """Mean m of the longest and the shortest path from a ring to a point, and half their difference X [m]."""
    out = rho[:, np.newaxis]
    mean = (np.sqrt(b**2 + (out + r) ** 2) + np.sqrt(b**2 + (out - r) ** 2)) / 2.0
    return mean, out * r / mean


def _spherical_path(rho: FloatArray, vergence: float) -> FloatArray:
    """√(d² + ρ²) − d with the sign of d = 1/vergence [m], without cancellation; d may be infinite."""
    return np.asarray(vergence * rho**2 / (1.0 + np.sqrt(1.0 + (vergence * rho) ** 2)))


def _blocks(radius: FloatArray) -> list[FloatArray]:
    return np.array_split(radius, math.ceil(radius.size / _BLOCK))


def _node_count(steepest: float) -> int:
    """Number of Gauss nodes in t = sin² α for a phase that changes by at most this many radians per radian of α."""
    count = _STEP * math.ceil((steepest / 2.0 + 8.0) / _STEP)
    if count > _MOST_NODES:
        raise UnaffordableError(
            "nodes of the spot of a point on the axis",
            value=str(count),
            limit=f"at most {_MOST_NODES}",
            remedy="use rays: blur or aberration amounts to thousands of wavelengths",
        )
    return count
