"""The field of a point source behind a circular lens: dispatch to the chosen method, and the method of rays."""

from __future__ import annotations

import math
import time

import numpy as np

from tradestudy.errors import NotConvergedError, OutOfRangeError
from tradestudy.optics.arguments import check_wavelength, checked
from tradestudy.optics.arrays import ComplexArray, FloatArray, IndexArray
from tradestudy.optics.propagation.boundary_wave import Rays, find_rays, land, one_ray_per_target, ray_fields
from tradestudy.optics.propagation.hybrid import hybrid_field
from tradestudy.optics.propagation.kernels import FresnelKernel, Kernel, KirchhoffKernel
from tradestudy.optics.propagation.lens import CircularLens, LensWave, Obliquity, PointSource, check_obliquity
from tradestudy.optics.propagation.result import ApertureField, Effort, Method, NumericalError, squared_magnitude
from tradestudy.optics.propagation.sampling import (
    Limits,
    NodeCounts,
    check_affordable,
    check_time,
    refuse_near_zone,
)
from tradestudy.optics.propagation.targets import Targets
from tradestudy.optics.propagation.wave_optics import FieldAccuracy, nodes_for, propagate_wave, sample_wave

_TARGETS_AT_ONCE = 4096
METHODS: tuple[Method, ...] = ("geometric", "boundary_wave", "fresnel", "kirchhoff")


def geometric_field(
    *, wave: LensWave, kernel: KirchhoffKernel, targets: Targets, accuracy: FieldAccuracy, limits: Limits
) -> ApertureField:
    """Geometrical optics behind a lens: |U|² = Σ |A|²/|∂P/∂q| over the rays that reach a target.

    The field adds the rays with their phases (each caustic passed multiplies a ray by −i); the intensity adds them
    without interference. Both are 0 where no ray arrives and infinite on a caustic.

    The stated error comes from tracing the neighbours of rays to the check targets: where they land and the area that
    they cover are compared with the closed-form derivatives. It does not cover diffraction.

    Parameters
    ----------
    wave
        Wave behind the lens, with exact paths.
    kernel
        Kernel whose obliquity is used.
    targets
        Points or grid.
    accuracy
        Tolerance and check.
    limits
        Memory and time allowed.

    Raises
    ------
    UnaffordableError
        The targets exceed the limits.
    NotConvergedError
        Intensities by tracing and in closed form differ by more than the tolerance.
    """
    started = time.perf_counter()
    size = math.prod(targets.shape)
    check_affordable(NodeCounts(radial=1, angular=1), targets=size, check_targets=0, limits=limits)
    centre = wave.lens.centre
    x, y, z = targets.coordinates()
    x, y = x - centre[0], y - centre[1]
    all_branches = not one_ray_per_target(wave, z)

    def rays_to(part: slice | IndexArray) -> tuple[Rays, ComplexArray]:
        rays = find_rays(wave, x[part], y[part], z[part], all_branches=all_branches)
        return rays, ray_fields(wave, kernel, rays, x[part], y[part], z[part])

    field, intensity = np.empty(size, dtype=np.complex128), np.empty(size)
    for start in range(0, size, _TARGETS_AT_ONCE):
        part = slice(start, start + _TARGETS_AT_ONCE)
        ray_field = rays_to(part)[1]
        with np.errstate(invalid="ignore"):  # infinite field on a caustic: the sum over rays is infinite too
            field[part], intensity[part] = ray_field.sum(axis=0), squared_magnitude(ray_field).sum(axis=0)
        spent, finished = time.perf_counter() - started, min(start + _TARGETS_AT_ONCE, size)
        check_time(spent=spent, needed=spent * (size / finished - 1), limits=limits, what="tracing the rays")
    seconds = time.perf_counter() - started
    started = time.perf_counter()
    rng = np.random.default_rng(accuracy.seed)
    index = rng.choice(size, size=min(accuracy.check_targets, size), replace=False)
    rays, ray_field = rays_to(index)
    error, checked = _traced(wave, rays.u, rays.v, ray_field, x[index], y[index], z[index])
    if error > accuracy.tolerance:
        raise NotConvergedError(
            "traced and computed ray intensities differ",
            value=f"{error:.2g}",
            limit=f"{accuracy.tolerance:g}",
            remedy="raise the tolerance, or move the targets off the caustic",
        )
    return ApertureField(
        field=np.asarray(field.reshape(targets.shape)),
        intensity=np.asarray(intensity.reshape(targets.shape)),
        targets=targets,
        pupil_power=wave.power(),
        error=NumericalError(field=error / 2, intensity=error, nodes=0.0, low_rank=0.0, nufft=0.0, check=error),
        effort=Effort(
            nodes=0,
            radial_nodes=0,
            angular_nodes=0,
            rank=0,
            tiles=1,
            rounds=1,
            seconds=seconds,
            check_seconds=time.perf_counter() - started,
            check_targets=checked,
        ),
        method="geometric",
    )


def _traced(
    wave: LensWave, u: FloatArray, v: FloatArray, ray_field: np.ndarray, x: FloatArray, y: FloatArray, z: FloatArray
) -> tuple[float, int]:
    """Largest relative error of single rays' intensities, from tracing their neighbours, and the number of rays."""
    lit = np.isfinite(ray_field) & (np.abs(ray_field) > 0)
    if not lit.any():
        return 0.0, 0
    x, y, z = (np.broadcast_to(c, lit.shape)[lit] for c in (x, y, z))
    u, v, intensity = u[lit], v[lit], squared_magnitude(ray_field[lit])
    step = 1e-3 * wave.lens.radius
    derivatives = []
    for a, b in ((step, 0.0), (0.0, step)):
        near = [np.asarray(land(wave, u + m * a, v + m * b, z)) for m in (-2, -1, 1, 2)]
        derivatives.append((near[0] - 8 * near[1] + 8 * near[2] - near[3]) / (12 * step))
    area = np.abs(derivatives[0][0] * derivatives[1][1] - derivatives[0][1] * derivatives[1][0])
    expected = squared_magnitude(wave.amplitude(u, v)) / area
    landed = land(wave, u, v, z)
    miss = np.hypot(landed[0] - x, landed[1] - y)
    # A miss changes the intensity by at most its share of the distance over which the pencil doubles its area.
    spread = np.sqrt(area) * wave.lens.radius
    relative = np.abs(intensity / expected - 1) + miss / spread
    return float(relative.max() + 16 * math.ulp(1.0)), int(lit.sum())


@checked
def aperture_field(
    *,
    source: PointSource,
    lens: CircularLens,
    targets: Targets,
    wavelength: float,
    method: Method,
    accuracy: FieldAccuracy,
    obliquity: Obliquity = "paper",
    limits: Limits | None = None,
    counts: NodeCounts | None = None,
) -> ApertureField:
    """Field and intensity behind a circular lens lit by a point source, with their errors.

    U(P) = ∬ U_s(q) t(q) exp(i φ(q)) K(q, P) dq is the field at a target P. The integral extends over the points q of
    the aperture. U_s is the field of the source just in front of the lens, t the amplitude transmission of the pupil, φ
    the phase that lens and pupil add, and K the kernel that propagates the field from q to P.

    Parameters
    ----------
    source
        Point source, on or off the axis. A negative distance stands for light that converges to a point behind the
        lens.
    lens
        The lens: its aperture, phase and `Pupil`.
    targets
        Points at which the field is computed. A `TargetGrid` is faster than scattered `TargetPoints`.
    wavelength
        Wavelength λ [m], > 0 and at most the diameter of the aperture.
    method
        Method of propagation; the equations are those of the paper under References.

        * ``kirchhoff``: exact paths and obliquity factors, eqs. 9–16.
        * ``fresnel``: paths to second order, obliquity factors 1, eqs. 17–22. To this order, the phases of parabolic,
          stigmatic and perfect lenses do not differ.
        * ``boundary_wave``: rays and the wave diffracted at the edge of the aperture, which together approximate
          Kirchhoff's integral. The integral itself is used at targets where the rays or the edge wave become infinite,
          and near a focus if that is faster.
        * ``geometric``: rays along exact paths, without diffraction.
    accuracy
        Tolerance of the intensity, as a relative L2 error over the targets, and the check that measures the error.
    obliquity
        Obliquity factor in K, as in `KirchhoffKernel`. U_s contains the factor a/r for ``paper``, 1 for ``textbook``,
        and a/r (1 + i/(k r)) for ``rayleigh-sommerfeld-1``, where a is the distance of the source from the lens plane,
        r its distance from q, and k = 2π/λ. ``fresnel`` accepts only the default.
    limits
        Nodes, memory and time that the computation may take. Default: 2·10⁷ nodes, 2 GB and 600 s.
    counts
        Numbers of quadrature nodes on the aperture, for convergence studies. Given numbers are not increased, so the
        stated error may exceed the tolerance. ``boundary_wave`` uses only the angular number; ``geometric`` accepts
        none. Default: as many as the variation of the phase over the aperture requires.

    Returns
    -------
    ApertureField
        Field [1/m² for a source of unit strength, as in eqs. 10–12] and intensity [1/m⁴], both in the shape of the
        targets, with their stated errors and the computing effort. The field omits the constant phase k n Δ of a lens
        of refractive index n and central thickness Δ.

    Raises
    ------
    OutOfRangeError
        An argument is outside the range in which the method holds, the wavelength exceeds the diameter of the aperture,
        a target lies within a wavelength of the lens plane, or an argument does not apply to the method:
        ``geometric`` and ``boundary_wave`` accept only pupils described by Zernike coefficients alone.
    UnaffordableError
        The computation needs more than ``limits`` allows.
    NotConvergedError
        The method, or double precision, cannot reach the tolerance at these targets.

    References
    ----------
    "Diffraction model of a plenoptic camera for in-situ space exploration", eqs. 9–22.

    Examples
    --------
    Peak intensity, per unit of power through the pupil, behind an f/4.2 lens with a parabolic phase:

    >>> from tradestudy import optics
    >>> field = optics.aperture_field(
    ...     source=optics.PointSource(distance=0.15),
    ...     lens=optics.CircularLens(radius=1.5e-3, focal_length=12.5e-3, lens_phase="parabolic"),
    ...     targets=optics.TargetGrid.centred(centre=(0.0, 0.0), pitch=0.5e-6, count=65, distance=13.64e-3),
    ...     wavelength=550e-9,
    ...     method="kirchhoff",
    ...     accuracy=optics.FieldAccuracy(tolerance=1e-6),
    ... )
    >>> print(f"{field.intensity.max() / field.pupil_power:.3g} 1/m², to 1e-6: {field.error.intensity <= 1e-6}")
    5.1e+10 1/m², to 1e-6: True
    """
    if method not in METHODS:
        raise OutOfRangeError("method", value=repr(method), limit=" | ".join(METHODS), remedy="choose one")
    if method == "fresnel" and obliquity != "paper":
        raise OutOfRangeError(
            "obliquity of the Fresnel integral",
            value=repr(obliquity),
            limit="'paper', the default",
            remedy="Fresnel sets all cosines to 1; leave the obliquity out",
        )
    if method == "geometric" and counts is not None:
        raise OutOfRangeError("node counts of rays", value=str(counts), limit="None", remedy="leave them out")
    if method in ("boundary_wave", "geometric") and lens.pupil is not None and not lens.pupil.evenly_lit:
        raise OutOfRangeError(
            "rays or boundary waves with a nonuniform pupil",
            value=f"amplitude or obscuration, by method {method!r}",
            limit="neither",
            remedy="use method 'kirchhoff' or 'fresnel'",
        )
    wave = lens_wave(source=source, lens=lens, wavelength=wavelength, paraxial=method == "fresnel", obliquity=obliquity)
    nearest = float(targets.box()[2][0])
    refuse_near_zone(width=2 * lens.radius, nearest=nearest, wavelength=wavelength)
    exact = KirchhoffKernel(wavelength=wavelength, obliquity=obliquity)
    if method == "geometric":
        return geometric_field(wave=wave, kernel=exact, targets=targets, accuracy=accuracy, limits=limits or Limits())
    if method == "boundary_wave":
        return hybrid_field(
            wave=wave,
            kernel=exact,
            targets=targets,
            accuracy=accuracy,
            limits=limits or Limits(),
            edge_nodes=None if counts is None else counts.angular,
        )
    kernel: Kernel = FresnelKernel(wavelength=wavelength) if method == "fresnel" else exact
    return propagate_wave(
        sample=lambda n: sample_wave(wave, n),
        counts=counts or (lambda: nodes_for(wave, kernel, targets, accuracy)),
        kernel=kernel,
        targets=targets,
        accuracy=accuracy,
        limits=limits,
        fixed_nodes=counts is not None,
    )


def lens_wave(
    *,
    source: PointSource,
    lens: CircularLens,
    wavelength: float,
    paraxial: bool = False,
    obliquity: Obliquity = "paper",
) -> LensWave:
    """Wave of a point source behind a lens.

    Raises
    ------
    OutOfRangeError
        The wavelength is not a positive length, or the obliquity is unknown.
    """
    check_wavelength(wavelength)
    check_obliquity(obliquity)
    return LensWave(source=source, lens=lens, wavelength=wavelength, paraxial=paraxial, obliquity=obliquity)
