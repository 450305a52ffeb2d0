"""Rays and the wave from the edge together: the hybrid of geometrical optics and diffraction."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import BoolArray, ComplexArray, FloatArray, unit_phasor
from tradestudy.optics.propagation.boundary_wave import (
    Rays,
    edge_field,
    fewest_zones,
    find_rays,
    land,
    one_ray_per_target,
    pole_reach,
    ray_fields,
    within_rim,
)
from tradestudy.optics.propagation.kernels import KirchhoffKernel, direct_sum
from tradestudy.optics.propagation.lens import LensWave
from tradestudy.optics.propagation.result import (
    ApertureField,
    CheckErrors,
    CheckTargets,
    Effort,
    choose_check_targets,
    squared_magnitude,
    stated_error,
)
from tradestudy.optics.propagation.sampling import (
    Limits,
    NodeCounts,
    check_affordable,
    check_time,
    edge_node_count,
    outline,
    time_left,
)
from tradestudy.optics.propagation.targets import TargetGrid, TargetPoints, Targets, chebyshev_grid, polar_field
from tradestudy.optics.propagation.wave_optics import (
    FieldAccuracy,
    largest_field,
    nodes_for,
    propagate_wave,
    rounding_error,
    sample_wave,
)

LEAST_ZONES = 0.5  # Fresnel zones across the aperture below which rays and edge nearly cancel: the focus
_LEAST_DOUBTED = 0.05  # zones below which the chance of a draw stays the same, so that one target cannot take all
_MAX_ROUNDS = 4
_POLAR_SHARE = 0.1  # of the tolerance of an evaluation, for sampling on rings
_FEW_POINTS = 1000  # points of a rectangle up to which a search for fewer costs more than it saves
_WORTHWHILE = 0.5  # fraction of the points of a rectangle above which rings do not pay off
_AREA_NODE = (
    150  # pairs of a target and an edge node that take as long as a node of Kirchhoff's integral, check included
)
_RAY = 70  # such pairs that take as long as the ray to a target
_SHARE = 0.1  # of the tolerance, for nodes, poles and interpolation together; the rest is the method's own error


@dataclass(frozen=True, kw_only=True)
class _Evaluation:
    """Field at the targets, which of them the boundary wave cannot compute, and the Fresnel zones of all."""

    field: ComplexArray
    singular: BoolArray
    zones: FloatArray


@dataclass(frozen=True, kw_only=True)
class UncheckedField:
    """Field at the targets, in their shape, and the fraction of them that was left to Kirchhoff's integral."""

    field: ComplexArray
    handed_over: float


def unchecked_hybrid_field(
    *, wave: LensWave, kernel: KirchhoffKernel, targets: Targets, tolerance: float, limits: Limits
) -> UncheckedField:
    """Field of `hybrid_field` without a stated error, for callers that compare their own result with Kirchhoff's.

    Parameters
    ----------
    wave, kernel, targets, limits
        As in `hybrid_field`.
    tolerance
        Nodes, poles and interpolation use a tenth of it; the error of the leading term may exceed it.

    Raises
    ------
    UnaffordableError
        The limits do not allow the targets.
    NotConvergedError
        Kirchhoff's integral at the targets handed over misses the tolerance.
    """
    accuracy = FieldAccuracy(tolerance=tolerance)
    edge = _edge_nodes(wave, kernel, targets, accuracy)
    check_affordable(
        NodeCounts(radial=1, angular=edge), targets=math.prod(targets.shape), check_targets=0, limits=limits
    )
    result = _evaluate(wave, kernel, targets, edge, accuracy)
    field, share = _filled(result, wave, kernel, targets, accuracy, limits)
    return UncheckedField(field=field.reshape(targets.shape), handed_over=share)


def hybrid_field(
    *,
    wave: LensWave,
    kernel: KirchhoffKernel,
    targets: Targets,
    accuracy: FieldAccuracy,
    limits: Limits,
    edge_nodes: int | None = None,
) -> ApertureField:
    """Ray optics plus the boundary-diffracted wave; Kirchhoff where they are singular.

    Kirchhoff's integral computes targets within half a Fresnel zone of a focus or a caustic, unless their ray passes
    so far outside the aperture that the caustic does not reach the edge; targets that several rays
    may reach, and targets on the shadow of the edge whose pole is not found; and all targets in a plane near a focus or
    caustic where that is faster. The fraction of such targets is reported.

    The stated error is measured against direct quadrature of the area integral, so it includes the error of the
    leading term for waves that are not spherical. Where all targets are handed over, error and effort are those of
    Kirchhoff's integral.

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
    edge_nodes
        Nodes on the edge. Default: from the slope of the path along it.

    Raises
    ------
    NotConvergedError
        The method's own error at these targets exceeds the tolerance.
    UnaffordableError
        The limits do not allow the targets handed over, or the check.
    """
    size = math.prod(targets.shape)
    seconds, check_seconds, last = 0.0, 0.0, 0.0
    begun = started = time.perf_counter()
    edge = edge_nodes or _edge_nodes(wave, kernel, targets, accuracy)
    seconds += time.perf_counter() - started
    check_affordable(NodeCounts(radial=1, angular=edge), targets=size, check_targets=0, limits=limits)
    reference: _Reference | None = None
    for rounds in range(1, _MAX_ROUNDS + 1):
        started = time.perf_counter()
        check_time(spent=started - begun, needed=2 * last, limits=limits)
        result = _evaluate(wave, kernel, targets, edge, accuracy)
        remaining = time_left(limits, time.perf_counter() - begun)
        if result.singular.all():
            area = _area_integral(wave, kernel, targets, accuracy, remaining)
            effort = replace(area.effort, seconds=time.perf_counter() - begun - area.effort.check_seconds)
            return replace(area, effort=effort, method="boundary_wave", handed_over=1.0)
        field, share = _filled(result, wave, kernel, targets, accuracy, remaining)
        intensity = squared_magnitude(field)
        checked = time.perf_counter()
        last = checked - started
        seconds += last
        remaining = time_left(limits, checked - begun)
        # The area integral does not depend on the nodes of the edge: one reference serves all rounds.
        if reference is None:
            # Squared errors to suspect at targets that are not handed over, up to a factor: larger for fewer zones.
            suspected = np.where(result.singular, 0.0, 1 / np.maximum(result.zones, _LEAST_DOUBTED) ** 2)
            doubt = np.asarray(suspected) if result.singular.any() else None
            reference = _reference(wave, kernel, targets, intensity, doubt, accuracy, remaining)
        check = _check(wave, kernel, field, reference, edge, accuracy)
        error = stated_error(intensity, check, largest=reference.largest, rounding=reference.rounding)
        check_seconds += time.perf_counter() - checked
        if error.intensity <= accuracy.tolerance or edge_nodes is not None:
            break
        # More nodes help only where they cause much of the error; the rest is that of the leading term.
        if check.nodes < 0.3 * check.total or rounds == _MAX_ROUNDS:
            raise NotConvergedError(
                "rays and boundary wave do not reach the tolerance: they are the leading term for many Fresnel zones",
                value=f"stated relative L2 error of the intensity {error.intensity:.2g}",
                limit=f"{accuracy.tolerance:g}",
                remedy="use method 'kirchhoff', a larger tolerance, the textbook obliquity or a perfect lens",
            )
        edge *= 2
    return ApertureField(
        field=field.reshape(targets.shape),
        intensity=intensity.reshape(targets.shape),
        targets=targets,
        pupil_power=wave.power(),
        error=error,
        effort=Effort(
            nodes=edge,
            radial_nodes=1,
            angular_nodes=edge,
            rank=0,
            tiles=1,
            rounds=rounds,
            seconds=seconds,
            check_seconds=check_seconds,
            check_targets=check.targets,
        ),
        method="boundary_wave",
        handed_over=share,
    )


def _edge_nodes(wave: LensWave, kernel: KirchhoffKernel, targets: Targets, accuracy: FieldAccuracy) -> int:
    """Number of nodes on the edge, from the slope of the path along it."""
    lens = wave.lens
    x, y, z = targets.box()
    x, y, z = outline(x - lens.centre[0], y - lens.centre[1], z)
    return edge_node_count(
        wave.paths,
        kernel,
        radius=lens.radius,
        x=x,
        y=y,
        z=z,
        tolerance=_SHARE * accuracy.tolerance,
    )


@dataclass(frozen=True, kw_only=True)
class _Reference:
    probes: CheckTargets
    field: ComplexArray
    largest: float
    rounding: float


def _reference(
    wave: LensWave,
    kernel: KirchhoffKernel,
    targets: Targets,
    intensity: FloatArray,
    doubt: FloatArray | None,
    accuracy: FieldAccuracy,
    limits: Limits,
) -> _Reference:
    """Direct quadrature of the area integral at the check targets, on 1.5 times the nodes needed each way."""
    finer = nodes_for(wave, kernel, targets, accuracy).scaled(1.5)
    check_affordable(finer, targets=0, check_targets=accuracy.check_targets, limits=limits)
    probes = choose_check_targets(targets, intensity, count=accuracy.check_targets, seed=accuracy.seed, doubt=doubt)
    samples = sample_wave(wave, finer)
    exact = direct_sum(samples, kernel, probes.x, probes.y, probes.z)
    return _Reference(
        probes=probes,
        field=exact,
        largest=largest_field(samples, kernel, targets),
        rounding=rounding_error(samples, kernel, targets),
    )


def _check(
    wave: LensWave,
    kernel: KirchhoffKernel,
    field: ComplexArray,
    reference: _Reference,
    edge: int,
    accuracy: FieldAccuracy,
) -> CheckErrors:
    """Compare with the area integral, and with twice as many nodes on the edge."""
    probes = reference.probes
    computed = field[probes.index]
    points = TargetPoints(x=probes.x, y=probes.y, distance=probes.z)
    finer = _evaluate(wave, kernel, points, 2 * edge, accuracy)
    field_share, intensity_share = probes.shares(reference.field, computed)
    return CheckErrors(
        nodes=probes.norm(np.where(finer.singular, 0.0, computed - finer.field)),
        sums=0.0,
        total=probes.norm(computed - reference.field),
        intensity=probes.intensity_norm(computed - reference.field, reference.field),
        field_share=field_share,
        intensity_share=intensity_share,
        targets=probes.index.size,
    )


def _evaluate(
    wave: LensWave, kernel: KirchhoffKernel, targets: Targets, edge: int, accuracy: FieldAccuracy
) -> _Evaluation:
    """Rays plus edge at the targets; a dense grid is interpolated, because the sum is band-limited and smooth."""
    centre = wave.lens.centre
    x, y, z = targets.coordinates()
    nothing = _Evaluation(
        field=np.zeros(x.size, dtype=np.complex128), singular=np.ones(x.size, dtype=bool), zones=np.zeros(x.size)
    )
    if not one_ray_per_target(wave, z):
        return nothing
    tolerance = _SHARE * accuracy.tolerance
    # In a plane near a focus, Kirchhoff's integral computes some targets anyway, and all where that is faster.
    if z.min() == z.max() and fewest_zones(wave, float(z[0])) < LEAST_ZONES:
        if x.size * (edge + _RAY) > _AREA_NODE * nodes_for(wave, kernel, targets, accuracy).total:
            return nothing
    elif isinstance(targets, TargetGrid):
        smooth = _interpolated(wave, kernel, targets, edge, tolerance)
        if smooth is not None:
            path = wave.wavenumber * np.asarray(kernel.path(x - centre[0], y - centre[1], z))
            field = smooth.ravel() * unit_phasor(path)
            return _Evaluation(field=field, singular=np.zeros(field.size, dtype=bool), zones=np.ones(field.size))
    return _rays_and_edge(wave, kernel, x - centre[0], y - centre[1], z, edge, tolerance)


def _interpolated(
    wave: LensWave, kernel: KirchhoffKernel, grid: TargetGrid, edge: int, tolerance: float
) -> ComplexArray | None:
    """Field on a grid without the path from the centre, from fewer points; None if that saves none or one is singular.

    About the chief ray, the field changes little with the angle, so a few points on rings determine it. Elsewhere, and
    for fine grids, Chebyshev points of the rectangle do.
    """
    centre, z = wave.lens.centre, grid.distance
    # Without the path from the centre, light from the rim varies fastest over the targets, by k times its sine.
    rim = wave.wavenumber * wave.lens.radius / math.hypot(wave.lens.radius, z)
    coarse = chebyshev_grid(grid, wavenumber=rim, tolerance=tolerance)

    def freed(x: FloatArray, y: FloatArray) -> ComplexArray | None:
        x, y = x - centre[0], y - centre[1]
        height = np.full(x.size, z)
        points = _rays_and_edge(wave, kernel, x, y, height, edge, tolerance)
        if points.singular.any():
            return None
        return np.asarray(points.field * unit_phasor(-wave.wavenumber * np.asarray(kernel.path(x, y, height))))

    flat = coarse.points() if coarse else (np.tile(grid.x_axis, grid.y_count), np.repeat(grid.y_axis, grid.x_count))
    chief = land(wave, np.zeros(1), np.zeros(1), np.array([z]))
    middle = (float(chief[0][0]) + centre[0], float(chief[1][0]) + centre[1])
    farthest = float(np.hypot(np.abs(grid.x_axis - middle[0]).max(), np.abs(grid.y_axis - middle[1]).max()))
    polar = polar_field(
        freed,
        centre=middle,
        radius=farthest,
        wavenumber=rim,
        tolerance=_POLAR_SHARE * tolerance,
        most=math.ceil(_WORTHWHILE * flat[0].size) if flat[0].size > _FEW_POINTS else 0,
    )
    values = polar.at(*flat) if polar else freed(*flat) if coarse else None
    if values is None:
        return None
    return coarse.interpolate(values) if coarse else values.reshape(grid.shape)


def _rays_and_edge(
    wave: LensWave,
    kernel: KirchhoffKernel,
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    edge: int,
    tolerance: float,
) -> _Evaluation:
    """Rays and edge wave at flat targets relative to the centre of the lens; at most one ray reaches each."""
    rays = find_rays(wave, x, y, z, all_branches=False)
    zones = wave.lens.radius**2 * np.sqrt(np.abs(rays.determinant[0])) / wave.wavelength
    singular = _singular(wave, rays, zones, x, y, z, edge, tolerance)
    part = np.flatnonzero(~singular)
    field = np.zeros(x.size, dtype=np.complex128)
    if part.size:
        regular = replace(
            rays,
            u=rays.u[:, part],
            v=rays.v[:, part],
            found=rays.found[:, part],
            determinant=rays.determinant[:, part],
            trace=rays.trace[:, part],
        )
        from_edge, failed = edge_field(
            wave=wave,
            kernel=kernel,
            rays=regular,
            x=x[part],
            y=y[part],
            z=z[part],
            count=edge,
            tolerance=tolerance,
        )
        field[part] = ray_fields(wave, kernel, regular, x[part], y[part], z[part])[0] + from_edge
        singular[part] |= failed
    return _Evaluation(field=field, singular=singular, zones=zones)


def _singular(
    wave: LensWave,
    rays: Rays,
    zones: FloatArray,
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    edge: int,
    tolerance: float,
) -> BoolArray:
    """Targets at a focus, on a caustic, or lit by a ray that was not found.

    A ray far outside the aperture contributes neither light nor a pole, wherever its caustics lie. Far means beyond the
    reach of the pole and half a Fresnel zone from the edge: nearer, light of a caustic leaks past the edge.
    """
    off_axis = np.hypot(rays.u[0], rays.v[0]) / wave.lens.radius
    near = (off_axis <= math.exp(pole_reach(edge, tolerance))) | (zones * (off_axis - 1) ** 2 < LEAST_ZONES)
    singular = (~rays.found[0] | near) & (zones < LEAST_ZONES)
    lost = np.flatnonzero(~rays.found[0])
    singular[lost] |= within_rim(wave, x[lost], y[lost], z[lost])
    return np.asarray(singular)


def _filled(
    result: _Evaluation,
    wave: LensWave,
    kernel: KirchhoffKernel,
    targets: Targets,
    accuracy: FieldAccuracy,
    limits: Limits,
) -> tuple[ComplexArray, float]:
    """Fill in the singular targets by Kirchhoff's integral and return their fraction."""
    if not result.singular.any():
        return result.field, 0.0
    if result.singular.all():
        return _area_integral(wave, kernel, targets, accuracy, limits).field.ravel(), 1.0
    x, y, z = (c[result.singular] for c in targets.coordinates())
    field = result.field.copy()
    handed_over = TargetPoints(x=x, y=y, distance=z)
    field[result.singular] = _area_integral(wave, kernel, handed_over, accuracy, limits).field
    return field, float(result.singular.mean())


def _area_integral(
    wave: LensWave, kernel: KirchhoffKernel, targets: Targets, accuracy: FieldAccuracy, limits: Limits
) -> ApertureField:
    """Kirchhoff's integral at targets handed over."""
    return propagate_wave(
        sample=lambda n: sample_wave(wave, n),
        counts=lambda: nodes_for(wave, kernel, targets, accuracy),
        kernel=kernel,
        targets=targets,
        accuracy=accuracy,
        limits=limits,
    )
