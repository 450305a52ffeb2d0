"""Image of one point source, or of one coherent disc: all microlenses at once, coherent, on every pixel."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from tradestudy.errors import NotConvergedError, UnaffordableError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.array_field import PupilWave, direct_field, leg_kernel
from tradestudy.optics.chain.arriving_light import ArrivingLight, arriving_light
from tradestudy.optics.chain.detector_transfer import (
    Transfer,
    choose_transfer,
    fading_length,
    half_band,
    propagate,
    response,
)
from tradestudy.optics.chain.microlens_edges import add_spheres, split_spheres
from tradestudy.optics.chain.microlens_plane import MicrolensPlane, direct_detector_field, microlens_plane
from tradestudy.optics.chain.pixels import MARGIN, light_on_pixels, samples_per_pixel
from tradestudy.optics.chain.ray_wave import RayWave
from tradestudy.optics.chain.rays import RayReach, ray_reach
from tradestudy.optics.chain.scene import LegMethod, LightPath
from tradestudy.optics.propagation.direct import ComplexArray

_SAFETY_OF_EDGES = 3.0  # the coarser Kirchhoff of a boundary wave may err to the same side as the wave
_SAFETY = 2.0  # the two computations share some of their error: measured by tests/benchmarks/chain_audit.py
_CHECK_POINTS = 16
_GROSS = 0.2  # discrepancy from direct quadrature that no tolerance excuses …
_GROSS_RATIO = 300.0  # … or that is out of all proportion to the error stated
_UPSAMPLING = 4.0  # memory of a nonuniform FFT over that of its modes


@dataclass(frozen=True, kw_only=True)
class WavePlan:
    """Sizes of everything that one source point needs."""

    reach: RayReach
    kept: float
    per_pixel: int
    spacing: float
    transfer: Transfer


def wave_point_image(
    wave: PupilWave | RayWave, *, to_detector: LegMethod, accuracy: ChainAccuracy, rng: np.random.Generator
) -> ChainImage:
    """Image by wave optics behind the array.

    Parameters
    ----------
    wave
        Camera, source, wavelength, and what the first leg makes of its light: waves or rays.
    to_detector
        Law behind the array. The boundary wave carries light of microlenses that is one sphere, and leaves the rest to
        Kirchhoff's integral.
    accuracy
        What to aim at.
    rng
        Draws the points that are checked against direct quadrature.

    Raises
    ------
    UnaffordableError
        If nodes or samples need more memory than allowed.
    NotConvergedError
        If the fast path disagrees grossly with direct quadrature, or Kirchhoff's integral misses the tolerance
        where a boundary wave is left to it.
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
    behind = float(np.sum(np.abs(fine.field) ** 2 * fine.plane.weights))
    return ChainImage(
        pixels=fine.pixels / power,
        numerical_error=error,
        error_terms=terms,
        direct_check=check,
        microlens_share=behind / power,
        effort={
            "microlens nodes": int(np.count_nonzero(fine.plane.weights)),
            "detector samples": fine.samples.size,
            "array samples": fine.light.samples,
        },
        handed_over=max(fine.light.handed_over, fine.handed_over),
    )


@dataclass(frozen=True, kw_only=True)
class PointComputation:
    """One pass through the chain, and what each step left behind; `pixels` are integrals of |U|², not yet shares."""

    plan: WavePlan
    plane: MicrolensPlane
    light: ArrivingLight
    field: ComplexArray
    samples: ComplexArray
    pixels: FloatArray
    pixel_error: float
    handed_over: float


def stated_point(
    wave: PupilWave | RayWave, to_detector: LegMethod, accuracy: ChainAccuracy
) -> tuple[PointComputation, dict[str, float]]:
    """Computation and the terms of its stated error: a second one on other samples, side by side.

    The second one of a boundary wave is Kirchhoff's, so that the change holds what its leading term leaves out.
    """
    reference = wave.reference if isinstance(wave, PupilWave) else wave
    with ThreadPoolExecutor(2) as pool:
        fine, other = pool.map(
            lambda each: compute_point(*each),
            ((wave, to_detector, accuracy), (reference, reference_law(to_detector), accuracy.compared())),
        )
    size = min(float(np.linalg.norm(one.pixels)) for one in (fine, other))  # starved nodes invent light
    change = float(np.linalg.norm(fine.pixels - other.pixels))
    safety = _SAFETY_OF_EDGES if to_detector == "boundary_wave" or reference is not wave else _SAFETY
    terms = {
        "other sampling": safety * change / size if change > 0 else 0.0,  # no light, no change: all is shadow
        "pixel integration": fine.pixel_error,
    }
    return fine, terms


def reference_law(to_detector: LegMethod) -> LegMethod:
    """Law behind the array whose image shows the error of another: Kirchhoff's for a boundary wave, else the same."""
    return "kirchhoff" if to_detector == "boundary_wave" else to_detector


def compute_point(wave: PupilWave | RayWave, to_detector: LegMethod, accuracy: ChainAccuracy) -> PointComputation:
    """Table of the main-lens field, microlenses, detector samples, pixels."""
    paraxial = to_detector == "fresnel"
    plan = plan_waves(wave, paraxial, accuracy)
    plane = _plane(wave, plan, paraxial, accuracy.microlens_nodes, accuracy)
    light = arriving_light(wave, accuracy)
    field = light.read(*plane.positions)
    spheres = None
    if to_detector == "boundary_wave":
        which = np.arange(wave.path.microlenses.count)
        spheres = split_spheres(wave.path, wave, which=which, cell=plane.cell, field=field)
    rest = spheres.rest if spheres else field
    samples = _detector_samples(plane, plan, rest * plane.transmission(wave.source), accuracy)
    handed_over = 0.0
    if spheres and spheres.power > 0.0:
        carried = add_spheres(
            samples,
            path=wave.path,
            wave=wave,
            spheres=spheres,
            reach=plan.reach,
            half_patch=plan.kept,
            spacing=plan.spacing,
            accuracy=accuracy,
        )
        handed_over = 1.0 - carried / spheres.power
    pixels, pixel_error = light_on_pixels(np.abs(samples) ** 2, wave.path.pixels, per_pixel=plan.per_pixel)
    return PointComputation(
        plan=plan,
        plane=plane,
        light=light,
        field=field,
        samples=samples,
        pixels=pixels,
        pixel_error=pixel_error,
        handed_over=handed_over,
    )


def plan_waves(wave: PupilWave | RayWave, paraxial: bool, accuracy: ChainAccuracy) -> WavePlan:
    """Follow light from where rays land to a margin of Fresnel lengths that grows as the tolerance shrinks."""
    path = wave.path
    reach = ray_reach(path, wave.source, whole_pupil=wave.whole_pupil)
    fresnel_length = math.sqrt(wave.wavelength * path.detector_distance)
    margin = accuracy.fresnel_lengths * fresnel_length
    kept = min(float(reach.travel.max()) + margin, _farthest(path))
    pixels = path.pixels
    band = half_band(wave.wavelength, path.detector_distance, kept, paraxial=paraxial, tolerance=accuracy.tolerance)
    per_pixel = samples_per_pixel(pixels, accuracy.pixel_sampling * 2 * band * pixels.pitch)
    spacing = pixels.pitch / per_pixel
    nodes, targets = _half_side(path)
    return WavePlan(
        reach=reach,
        kept=kept,
        per_pixel=per_pixel,
        spacing=spacing,
        transfer=choose_transfer(
            wavelength=wave.wavelength,
            distance=path.detector_distance,
            paraxial=paraxial,
            node_reach=nodes,
            target_reach=targets + MARGIN * spacing,
            kept_reach=kept,
            spacing=spacing,
            tolerance=accuracy.tolerance,
        ),
    )


def _farthest(path: LightPath) -> float:
    """Farthest pixel from any point of a microlens: light that lands beyond is nobody's [m]."""
    corners = np.array([[x, y] for x in path.pixels.edges_x[[0, -1]] for y in path.pixels.edges_y[[0, -1]]])
    apart = np.linalg.norm(path.microlenses.centres[:, None] - corners, axis=-1)
    return float(apart.max()) + path.microlenses.cell_reach


def _half_side(path: LightPath) -> tuple[float, float]:
    """Half sides of the squares about the detector's centre that hold all nodes and all pixels."""
    centre = np.asarray(path.pixels.centre)
    nodes = float(np.max(np.abs(path.microlenses.centres - centre))) + path.microlenses.cell_reach
    return nodes, max(path.pixels.shape) * path.pixels.pitch / 2


def _plane(
    wave: PupilWave | RayWave, plan: WavePlan, paraxial: bool, density: float, accuracy: ChainAccuracy
) -> MicrolensPlane:
    """Nodes for all pixels that light reaches, if they can be afforded."""
    path = wave.path
    corners = np.array([[x, y] for x in path.pixels.edges_x[[0, -1]] for y in path.pixels.edges_y[[0, -1]]])
    farthest = float(np.linalg.norm(plan.reach.image[:, None] - corners, axis=-1).max())
    fading = fading_length(
        wave.wavelength, path.detector_distance, plan.kept, paraxial=paraxial, tolerance=accuracy.tolerance
    )
    plane = microlens_plane(
        path,
        plan.reach,
        wavelength=wave.wavelength,
        paraxial=paraxial,
        target_reach=min(farthest, plan.kept + fading + float(plan.reach.travel.max())),
        density=density,
        lit=wave.lit if isinstance(wave, RayWave) else None,
    )
    count = plan.transfer.count
    needed = 16.0 * (12 * plane.weights.size + (_UPSAMPLING + 4) * count**2)
    if needed > accuracy.memory_limit:
        raise UnaffordableError(
            "microlens nodes and detector samples",
            value=f"{plane.weights.size} nodes, {count}² samples, {needed / 1e9:.1f} GB",
            limit=f"{accuracy.memory_limit / 1e9:.1f} GB",
            remedy="take fewer microlenses or pixels, a larger tolerance, or raise the memory limit",
        )
    return plane


def _detector_samples(
    plane: MicrolensPlane, plan: WavePlan, strengths: ComplexArray, accuracy: ChainAccuracy
) -> ComplexArray:
    """Field on the fine grid of the detector, three samples more on every side."""
    pixels = plane.path.pixels
    held = strengths != 0  # a shadow leaves some lenses fewer nodes than others, and a sphere leaves nothing
    x, y = plane.positions
    rows, columns = (n * plan.per_pixel + 2 * MARGIN for n in pixels.shape)
    if not held.any():
        return np.zeros((rows, columns), dtype=np.complex128)
    first = np.asarray(pixels.corner) - pixels.centre + (0.5 - MARGIN) * plan.spacing
    fields = propagate(
        plan.transfer,
        x=x[held] - pixels.centre[0],
        y=y[held] - pixels.centre[1],
        strengths=strengths[held][None],
        response=response(plan.transfer),
        carriers=np.zeros((1, 2), dtype=int),
        start=first[None],
        shape=(rows, columns),
        tolerance=accuracy.tolerance / 20,
    )
    return np.asarray(fields[0])


def _field_check(wave: PupilWave, done: PointComputation, rng: np.random.Generator) -> float:
    """Relative discrepancy of the field at random microlens nodes from direct quadrature."""
    x, y = (c.ravel() for c in done.plane.positions)
    field = done.field.ravel()
    weights = done.plane.weights.ravel()
    power = np.abs(field) ** 2 * weights
    chance = _mixture(power, weights)
    pick = rng.choice(x.size, size=_CHECK_POINTS, p=chance)
    truth = direct_field(wave, x[pick], y[pick])
    wrong = np.mean(np.abs(truth - field[pick]) ** 2 * weights[pick] / chance[pick])
    return float(math.sqrt(wrong / power.sum()))


def _intensity_check(
    wave: PupilWave | RayWave, done: PointComputation, paraxial: bool, accuracy: ChainAccuracy, rng: np.random.Generator
) -> float:
    """Relative discrepancy of the intensity at random detector samples from direct quadrature on finer nodes."""
    plane, plan = done.plane, done.plan
    inside = np.abs(done.samples[MARGIN:-MARGIN, MARGIN:-MARGIN]) ** 2
    if not inside.any():
        return 0.0
    finer = _plane(wave, plan, paraxial, 1.2 * max(1.0, accuracy.microlens_nodes), accuracy)
    chance = _mixture(inside.ravel() ** 2, np.ones(inside.size))
    pick = rng.choice(inside.size, size=_CHECK_POINTS, p=chance)
    row, column = np.unravel_index(pick, inside.shape)
    at = np.asarray(plane.path.pixels.corner) + plan.spacing * (np.column_stack([column, row]) + 0.5)
    truth = direct_detector_field(
        finer,
        leg_kernel(wave.wavelength, paraxial),
        done.light.read(*finer.positions),
        finer.transmission(wave.source),
        at,
    )
    wrong = np.mean((np.abs(truth) ** 2 - inside[row, column]) ** 2 / chance[pick])
    return float(math.sqrt(wrong / np.sum(inside**2)))


def _mixture(weight: FloatArray, area: FloatArray) -> FloatArray:
    """Chance of drawing each point: half by weight, half by area."""
    return np.asarray(0.5 * weight / weight.sum() + 0.5 * area / area.sum())
