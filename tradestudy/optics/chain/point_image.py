"""Image of one point source, or of one coherent disc: all microlenses at once, coherent, on every pixel.

The light of a microlens is split into the best-fitting sphere about the main lens's image and the rest, which is zero
if rays brought the light. The sphere has closed forms; the rest is left to Kirchhoff's integral. So is all light of
microlenses that the shadow of the pupil cuts, since no single edge surrounds it, and of those whose rays meet or cross
on the detector.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tradestudy.errors import NotConvergedError, UnaffordableError
from tradestudy.optics.arrays import ComplexArray, FloatArray, IndexArray, unit_phasor
from tradestudy.optics.chain.accuracy import MARGIN, ChainAccuracy, ChainImage, light_on_pixels, relative_change
from tradestudy.optics.chain.array_field import PupilWave, direct_field, leg_kernel, looser_for_edges
from tradestudy.optics.chain.arriving_light import (
    ArrivingLight,
    RayReach,
    RayWave,
    arriving_light,
    blur_radius,
    ray_reach,
)
from tradestudy.optics.chain.detector_patch import (
    FEWEST_NODES,
    DetectorPlan,
    MicrolensPlane,
    direct_detector_field,
    field_on_detector,
    microlens_plane,
    plan_detector,
    resolved_cycles,
)
from tradestudy.optics.chain.detector_transfer import Response, fading_length, response
from tradestudy.optics.chain.lit_part import lit_part, reached_pixels
from tradestudy.optics.chain.microlens_nodes import CellNodes, Disc, lit_share
from tradestudy.optics.chain.scene import LegMethod, LightPath
from tradestudy.optics.propagation.boundary_wave import one_ray_per_target
from tradestudy.optics.propagation.hybrid import LEAST_ZONES, unchecked_hybrid_field
from tradestudy.optics.propagation.kernels import KirchhoffKernel
from tradestudy.optics.propagation.lens import LensWave
from tradestudy.optics.propagation.paths import Array, SphericalPath
from tradestudy.optics.propagation.result import squared_magnitude
from tradestudy.optics.propagation.sampling import Limits
from tradestudy.optics.propagation.targets import TargetGrid


class _EvenWave(LensWave):
    """Spherical wave through a microlens, of amplitude 1 at every point."""

    def amplitude(self, x: Array, y: Array) -> Array:
        """Return 1."""
        return np.ones(np.broadcast(x, y).shape, dtype=np.complex128)


@dataclass(frozen=True, kw_only=True)
class Spheres:
    """Light of microlenses, split into spheres about one point and the rest.

    Attributes
    ----------
    which
        Microlenses whose sphere is propagated.
    strength
        Field of each sphere at the vertex of its microlens, shape (which,).
    rest
        Field on the nodes minus the spheres.
    power
        ∫ |U|² over the nodes.
    """

    which: IndexArray
    strength: ComplexArray
    rest: ComplexArray
    power: float


def split_spheres(
    path: LightPath, wave: PupilWave | RayWave, *, which: IndexArray, cell: CellNodes, field: ComplexArray
) -> Spheres:
    """Subtract the sphere of the source's image from the field, by least squares over each microlens.

    Parameters
    ----------
    path, wave
        Camera, and the wave of one source point.
    which
        Microlenses, shape (n,).
    cell
        Their nodes, shape (nodes,) or (n, nodes).
    field
        Field on the nodes, shape (n, nodes).
    """
    x, y = path.chief_point(wave.source)
    shadow = Disc(x=x, y=y, radius=blur_radius(path, wave.source))
    lit = np.flatnonzero(lit_share(path.microlenses, shadow)[which] == 1.0)
    rows = [row for row in lit if _has_rays(path, _through(path, wave, int(which[row])))]
    rest = field.copy()
    strength = np.zeros(len(rows), dtype=np.complex128)
    for n, row in enumerate(rows):
        u, v, weights, in_lens = (c[row] if c.ndim > 1 else c for c in (cell.x, cell.y, cell.weights, cell.in_lens))
        centre = path.object_before(int(which[row]), wave.source)
        arriving = SphericalPath(x=centre.x, y=centre.y, distance=centre.distance)
        sphere = np.where(in_lens, unit_phasor(2 * math.pi / wave.wavelength * arriving.value(u, v)), 0.0)
        strength[n] = np.sum(weights * np.conj(sphere) * field[row]) / np.sum(weights * in_lens)
        # Rays form exactly this sphere: subtracting it would leave its rounding to Kirchhoff's integral.
        rest[row] = 0.0 if isinstance(wave, RayWave) and in_lens.all() else field[row] - strength[n] * sphere
    power = float(np.sum(np.abs(field) ** 2 * cell.weights))
    return Spheres(which=which[rows], strength=strength, rest=rest, power=power)


def _through(path: LightPath, wave: PupilWave | RayWave, index: int) -> _EvenWave:
    """Sphere of the source's image behind a microlens."""
    return _EvenWave(
        source=path.object_before(index, wave.source),
        lens=path.microlenses.lens(index),
        wavelength=wave.wavelength,
        paraxial=False,
        obliquity="paper",
    )


def _has_rays(path: LightPath, through: _EvenWave) -> bool:
    """Whether the detector lies out of focus behind a microlens, and one ray leads to each of its points."""
    lens, b = through.lens, path.detector_distance
    defocus = abs(1 / through.source.distance + 1 / b - 1 / lens.focal_length)
    zones = lens.radius**2 / through.wavelength * defocus
    return zones >= LEAST_ZONES and one_ray_per_target(through, np.array([b]))


def add_spheres(
    canvas: ComplexArray,
    *,
    path: LightPath,
    wave: PupilWave | RayWave,
    spheres: Spheres,
    reach: RayReach,
    half_patch: float,
    spacing: float,
    accuracy: ChainAccuracy,
) -> float:
    """Add rays and boundary wave of every sphere to the samples on the detector, around where its rays land.

    Parameters
    ----------
    canvas
        Field on a grid of the detector without its constant phase, as in `detector_transfer.response`; changed in
        place.
    path, wave
        Camera, and the wave of one source point.
    spheres
        Spheres to propagate.
    reach
        Where rays land.
    half_patch
        Distance from there within which light is followed, along x and y [m].
    spacing
        Distance between samples [m]; the grid extends `MARGIN` samples beyond the pixels on every side.
    accuracy
        Tolerance of the image, and memory.

    Returns
    -------
    float
        Power of the spheres, minus that of points where rays are singular: these are left to Kirchhoff's integral.

    Raises
    ------
    NotConvergedError
        If Kirchhoff's integral misses the tolerance there.
    """
    start = np.asarray(path.pixels.corner) + (0.5 - MARGIN) * spacing
    vertex = unit_phasor(np.array(-2 * math.pi / wave.wavelength * path.detector_distance))
    carried = 0.0
    for index, strength in zip(spheres.which.tolist(), spheres.strength, strict=True):
        centre, middle = path.microlenses.centres[index], reach.image[index]
        low = np.maximum(np.ceil((middle - half_patch - start) / spacing), 0).astype(int)
        high = np.minimum(np.floor((middle + half_patch - start) / spacing) + 1, canvas.shape[::-1]).astype(int)
        power = math.pi / 4 * path.microlenses.aperture_width**2 * float(np.abs(strength) ** 2)
        if np.any(high <= low):  # no pixel sees this sphere, and no integral needs to compute it
            carried += power
            continue
        first = start + low * spacing - centre
        hybrid = unchecked_hybrid_field(
            wave=_through(path, wave, index),
            kernel=KirchhoffKernel(wavelength=wave.wavelength, obliquity="paper"),
            targets=TargetGrid(
                x_start=float(first[0]),
                y_start=float(first[1]),
                x_pitch=spacing,
                y_pitch=spacing,
                x_count=int(high[0] - low[0]),
                y_count=int(high[1] - low[1]),
                distance=path.detector_distance,
            ),
            tolerance=looser_for_edges(accuracy.tolerance),
            limits=Limits(memory_bytes=accuracy.memory_limit),
        )
        canvas[low[1] : high[1], low[0] : high[0]] += strength * vertex * hybrid.field
        carried += power * (1.0 - hybrid.handed_over)
    return carried


_SAFETY_OF_EDGES = 3.0  # Kirchhoff's coarser integral may err to the same side as a boundary wave
_SAFETY = 2.0  # the two computations share some of their error: measured by tests/benchmarks/chain_audit.py
_CHECK_POINTS = 16
_COUNT_OF_THREADS = 1000  # samples along a side beyond which threads save more time than they take to start
_GROSS = 0.2  # discrepancy from direct quadrature that is refused at any tolerance …
_GROSS_RATIO = 300.0  # … unless it is within this ratio to the stated error


def wave_point_image(
    wave: PupilWave | RayWave, *, to_detector: LegMethod, accuracy: ChainAccuracy, rng: np.random.Generator
) -> ChainImage:
    """Image by wave optics behind the array.

    Parameters
    ----------
    wave
        Camera, source, wavelength, and what the first leg makes of its light: waves or rays.
    to_detector
        Law behind the array. The boundary wave carries light of microlenses that forms one sphere, and leaves the rest
        to Kirchhoff's integral.
    accuracy
        Tolerance and sampling.
    rng
        Draws the points that are checked against direct quadrature.

    Raises
    ------
    UnaffordableError
        If nodes or samples need more memory than allowed.
    NotConvergedError
        If the fast path disagrees grossly with direct quadrature, or Kirchhoff's integral misses the tolerance
        where it replaces a boundary wave.
    """
    fine, terms = stated_point(wave, to_detector, accuracy)
    error = math.hypot(*terms.values())
    check = {} if isinstance(wave, RayWave) else {"field on the array": _field_check(wave, fine, rng)}
    check["intensity on the detector"] = _intensity_check(wave, fine, to_detector == "fresnel", accuracy, rng)
    if max(check.values()) > max(_GROSS, _GROSS_RATIO * error):
        raise NotConvergedError(
            "the chain disagrees with direct quadrature",
            value=", ".join(f"{name} {value:.2g}" for name, value in check.items()),
            limit=f"{max(_GROSS, _GROSS_RATIO * error):.2g}",
            remedy="refine pupil_nodes, microlens_nodes, field_sampling or diffraction_reach",
        )
    power = wave.power()
    behind = float(np.sum(np.abs(fine.field) ** 2 * fine.plan.plane.weights))
    return ChainImage(
        pixels=fine.pixels / power,
        numerical_error=error,
        error_terms=terms,
        direct_check=check,
        microlens_share=behind / power,
        effort={
            "microlens nodes": int(np.count_nonzero(fine.plan.plane.weights)),
            "detector samples": fine.samples.size,
            "array samples": fine.light.samples,
        },
        handed_over=max(fine.light.handed_over, fine.handed_over),
    )


@dataclass(frozen=True, kw_only=True)
class PointPlan:
    """Parts of the camera in which a point's light is followed.

    Attributes
    ----------
    wave
        Wave on a path with only the microlenses that it lights and the pixels on which it lands.
    rows, columns
        Rows and columns of those pixels on the whole detector.
    lost
        As in `LitPart`.
    reach, detector, plane
        Where rays land, the grid on the detector, and the nodes.
    """

    wave: PupilWave | RayWave
    rows: slice
    columns: slice
    lost: float
    reach: RayReach
    detector: DetectorPlan
    plane: MicrolensPlane


@dataclass(frozen=True, kw_only=True)
class PointComputation:
    """One pass through the chain, and what each step left behind; `pixels` are integrals of |U|², not yet shares."""

    plan: PointPlan
    light: ArrivingLight
    field: ComplexArray
    samples: ComplexArray
    pixels: FloatArray
    pixel_error: float
    handed_over: float


def stated_point(
    wave: PupilWave | RayWave, to_detector: LegMethod, accuracy: ChainAccuracy
) -> tuple[PointComputation, dict[str, float]]:
    """Compute a point image twice side by side, on different samples, and state the terms of its error.

    A boundary wave is compared with Kirchhoff's integral, so that the change includes what its leading term leaves out.
    """
    reference = wave.reference
    with ThreadPoolExecutor(2) as pool:
        fine, compared = pool.map(
            lambda arguments: compute_point(*arguments),
            ((wave, to_detector, accuracy), (reference, reference_law(to_detector), accuracy.compared())),
        )
    safety = _SAFETY_OF_EDGES if to_detector == "boundary_wave" or reference is not wave else _SAFETY
    size = float(np.linalg.norm(fine.pixels))
    terms = {
        "other sampling": safety * relative_change(fine.pixels, compared.pixels),
        "pixel integration": fine.pixel_error,
        "unlit microlenses": fine.plan.lost * wave.power() / size if fine.plan.lost > 0.0 else 0.0,
    }
    return fine, terms


def reference_law(to_detector: LegMethod) -> LegMethod:
    """Law behind the array for the comparison that gives the error: Kirchhoff's for a boundary wave, else the same."""
    return "kirchhoff" if to_detector == "boundary_wave" else to_detector


def plan_point(wave: PupilWave | RayWave, to_detector: LegMethod, accuracy: ChainAccuracy) -> PointPlan:
    """Choose the microlenses that are lit, the pixels that light reaches, and their sampling.

    Raises
    ------
    UnaffordableError
        If this takes too many nodes or samples.
    """
    lit = lit_part(wave, accuracy)
    path = lit.wave.path
    reach = ray_reach(path, wave.source, whole_pupil=wave.whole_pupil)
    plan_on = partial(
        plan_detector, reaches=[reach], wavelength=wave.wavelength, paraxial=to_detector == "fresnel", accuracy=accuracy
    )
    # The first plan tells how far light is followed, and thus which pixels it reaches; the second is for these alone.
    kept = plan_on(path).kept
    fading = fading_length(
        wave.wavelength, path.detector_distance, kept, paraxial=to_detector == "fresnel", tolerance=accuracy.tolerance
    )
    rows, columns = reached_pixels(path, kept + fading)
    part = replace(lit.wave, path=replace(path, pixels=path.pixels.part(rows, columns)))
    plan = plan_on(part.path)
    plane = _plane(part, plan, reach, accuracy.microlens_nodes, accuracy)
    return PointPlan(wave=part, rows=rows, columns=columns, lost=lit.lost, reach=reach, detector=plan, plane=plane)


def compute_point(wave: PupilWave | RayWave, to_detector: LegMethod, accuracy: ChainAccuracy) -> PointComputation:
    """Compute in turn the field of the main lens, the wave behind the microlenses, detector samples and pixels."""
    whole = wave.path.pixels
    point = plan_point(wave, to_detector, accuracy)
    wave, plan, plane = point.wave, point.detector, point.plane
    light = arriving_light(wave, accuracy)
    field = light.read(*plane.positions)
    samples, handed_over = over_detector(
        plane,
        wave,
        field,
        plane.transmission(wave.source),
        to_detector=to_detector,
        response=response(plan.transfer),
        reach=point.reach,
        half_side=plan.kept,
        accuracy=accuracy,
        threads=1 if plan.transfer.count < _COUNT_OF_THREADS else 0,
    )
    pixels = np.zeros(whole.shape)
    pixels[point.rows, point.columns], pixel_error = light_on_pixels(
        squared_magnitude(samples), wave.path.pixels, per_pixel=plan.per_pixel
    )
    return PointComputation(
        plan=point,
        light=light,
        field=field,
        samples=samples,
        pixels=pixels,
        pixel_error=pixel_error,
        handed_over=handed_over,
    )


def over_detector(
    plane: MicrolensPlane,
    wave: PupilWave | RayWave,
    field: ComplexArray,
    transmission: ComplexArray,
    *,
    to_detector: LegMethod,
    response: Response,
    reach: RayReach,
    half_side: float,
    accuracy: ChainAccuracy,
    threads: int,
) -> tuple[ComplexArray, float]:
    """Field of all microlenses over the whole detector at once, and the share left by a boundary wave to Kirchhoff.

    Parameters
    ----------
    plane, wave
        Nodes of the microlenses, and the wave of one source point.
    field, transmission
        Arriving field and `MicrolensPlane.transmission`, shape (lenses, nodes).
    to_detector, response
        Law of the leg, and its transfer function on the grid of the detector.
    reach, half_side
        Where rays land, and the distance from there within which boundary waves are followed, along x and y [m].
    accuracy, threads
        Tolerance and memory, and the threads of the Fourier transforms; 0 for all.
    """
    path, spheres = plane.path, None
    if to_detector == "boundary_wave":
        spheres = split_spheres(path, wave, which=np.arange(path.microlenses.count), cell=plane.cell, field=field)
        field = spheres.rest
    spacing = response.transfer.spacing
    samples = field_on_detector(
        plane,
        (field * transmission).astype(response.quadrant.dtype, copy=False),
        response=response,
        per_pixel=round(path.pixels.pitch / spacing),
        tolerance=accuracy.tolerance / 20,
        threads=threads,
    )
    if spheres is None or spheres.power == 0.0:
        return samples, 0.0
    carried = add_spheres(
        samples,
        path=path,
        wave=wave,
        spheres=spheres,
        reach=reach,
        half_patch=half_side,
        spacing=spacing,
        accuracy=accuracy,
    )
    return samples, 1.0 - carried / spheres.power


def _plane(
    wave: PupilWave | RayWave, plan: DetectorPlan, reach: RayReach, density: float, accuracy: ChainAccuracy
) -> MicrolensPlane:
    """Nodes for all pixels that light reaches, if memory allows."""
    cycles = resolved_cycles(
        wave.path,
        reach,
        wavelength=wave.wavelength,
        paraxial=plan.transfer.paraxial,
        target_reach=plan.target_reach,
        density=density,
    )
    lit = isinstance(wave, RayWave)  # one cell is resolved before its dark part is cut off
    least = FEWEST_NODES * cycles**2 * (1 if lit else wave.path.microlenses.count)
    _check_memory(plan, least, accuracy)
    plane = microlens_plane(
        wave.path,
        reach,
        wavelength=wave.wavelength,
        paraxial=plan.transfer.paraxial,
        target_reach=plan.target_reach,
        density=density,
        lit=wave.lit if isinstance(wave, RayWave) else None,
    )
    _check_memory(plan, plane.count, accuracy)
    return plane


def _check_memory(plan: DetectorPlan, nodes: float, accuracy: ChainAccuracy) -> None:
    """Refuse more nodes and samples than memory holds."""
    needed = plan.memory(nodes)
    if needed > accuracy.memory_limit:
        raise UnaffordableError(
            "microlens nodes and detector samples",
            value=f"{nodes:.0f} nodes, {plan.transfer.count}² samples, {needed / 1e9:.3g} GB",
            limit=f"{accuracy.memory_limit / 1e9:.3g} GB",
            remedy="use fewer microlenses or pixels or a larger tolerance, or raise the memory limit",
        )


def _field_check(wave: PupilWave, computed: PointComputation, rng: np.random.Generator) -> float:
    """Relative discrepancy of the field at random microlens nodes from direct quadrature."""
    x, y = (c.ravel() for c in computed.plan.plane.positions)
    field = computed.field.ravel()
    weights = computed.plan.plane.weights.ravel()
    power = np.abs(field) ** 2 * weights
    chance = _mixture(power, weights)
    pick = rng.choice(x.size, size=_CHECK_POINTS, p=chance)
    truth = direct_field(wave, x[pick], y[pick])
    wrong = np.mean(np.abs(truth - field[pick]) ** 2 * weights[pick] / chance[pick])
    return float(math.sqrt(wrong / power.sum()))


def _intensity_check(
    wave: PupilWave | RayWave,
    computed: PointComputation,
    paraxial: bool,
    accuracy: ChainAccuracy,
    rng: np.random.Generator,
) -> float:
    """Relative discrepancy of the intensity at random detector samples from direct quadrature on finer nodes."""
    plane, plan = computed.plan.plane, computed.plan.detector
    inside = np.abs(computed.samples[MARGIN:-MARGIN, MARGIN:-MARGIN]) ** 2
    if not inside.any():
        return 0.0
    finer = _plane(computed.plan.wave, plan, computed.plan.reach, 1.2 * max(1.0, accuracy.microlens_nodes), accuracy)
    chance = _mixture(inside.ravel() ** 2, np.ones(inside.size))
    pick = rng.choice(inside.size, size=_CHECK_POINTS, p=chance)
    row, column = np.unravel_index(pick, inside.shape)
    targets = np.asarray(plane.path.pixels.corner) + plan.transfer.spacing * (np.column_stack([column, row]) + 0.5)
    truth = direct_detector_field(
        finer,
        leg_kernel(wave.wavelength, paraxial),
        computed.light.read(*finer.positions),
        finer.transmission(wave.source),
        targets,
        images=computed.plan.reach.image,
        target_reach=plan.target_reach,
    )
    wrong = np.mean((np.abs(truth) ** 2 - inside[row, column]) ** 2 / chance[pick])
    return float(math.sqrt(wrong / np.sum(inside**2)))


def _mixture(weight: FloatArray, area: FloatArray) -> FloatArray:
    """Probability of drawing each point: half by weight, half by area."""
    # By weight alone, points that are dark by mistake would never be checked.
    return np.asarray(0.5 * weight / weight.sum() + 0.5 * area / area.sum())
