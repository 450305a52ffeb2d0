"""Nodes on the microlenses, and the grid on the detector, over all of it or on a patch for each microlens.

Patches are fast, but only the amount of light beyond a patch is known. The whole detector misses nothing. It is
used where it costs no more than patches. For tolerances that patches do not meet, it may cost more by the ratio of the
two tolerances, if the source points computed side by side fit into memory.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tradestudy.optics.arrays import ComplexArray, FloatArray, unit_phasor
from tradestudy.optics.chain.accuracy import MARGIN, ChainAccuracy, samples_per_pixel
from tradestudy.optics.chain.arriving_light import RayReach, blur_radius
from tradestudy.optics.chain.detector_transfer import (
    PatchPlan,
    Response,
    Transfer,
    choose_transfer,
    detector_field,
    fading_length,
    fresnel_reach,
    half_band,
    sine_towards,
)
from tradestudy.optics.chain.microlens_nodes import (
    CellNodes,
    Disc,
    cell_node_count,
    cell_nodes,
    lit_nodes,
    lit_share,
    padded,
)
from tradestudy.optics.chain.scene import LightPath, Microlenses
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.kernels import ApertureSamples, Kernel, direct_sum
from tradestudy.optics.propagation.lens import PointSource, lens_paths
from tradestudy.optics.propagation.paths import ParabolicPath, SphericalPath
from tradestudy.optics.quadrature import QuadratureNodes

_ANY_POINT = PointSource(distance=1.0)  # parabolic and stigmatic lenses do not depend on the source


@dataclass(frozen=True, kw_only=True)
class MicrolensPlane:
    """Nodes on every cell and the phase of every lens.

    Attributes
    ----------
    path
        The camera.
    wavelength
        Wavelength [m].
    paraxial
        Whether the leg behind the array is Fresnel's.
    cell
        Nodes relative to each centre, shape (nodes,); or (lenses, nodes) where a shadow gives every lens its own nodes.
    """

    path: LightPath
    wavelength: float
    paraxial: bool
    cell: CellNodes

    @property
    def positions(self) -> tuple[FloatArray, FloatArray]:
        """Absolute node positions, shape (lenses, nodes) [m]."""
        centres = self.path.microlenses.centres
        return centres[:, 0, None] + self.cell.x, centres[:, 1, None] + self.cell.y

    @property
    def count(self) -> int:
        """Nodes of all microlenses."""
        return self.cell.x.size * (1 if self.cell.x.ndim > 1 else self.path.microlenses.count)

    @property
    def weights(self) -> FloatArray:
        """Area weights [m²], shape (lenses, nodes)."""
        return np.broadcast_to(self.cell.weights, self.positions[0].shape)

    def transmission(self, source: PointSource) -> ComplexArray:
        """Area weight times the phasor and amplitude of each lens, shape (lenses, nodes)."""
        lenses = self.path.microlenses
        if lenses.lens_phase == "perfect" and not self.paraxial:
            phases = [self._lens_path(i, self.path.object_before(i, source)) for i in range(lenses.count)]
        elif self.cell.x.ndim > 1:
            phases = [self._lens_path(i, _ANY_POINT) for i in range(lenses.count)]
        else:
            kinds, which = np.unique(lenses.focal_lengths, return_inverse=True)
            first = [int(np.flatnonzero(which == j)[0]) for j in range(kinds.size)]
            paths = [self._lens_path(i, _ANY_POINT) for i in first]
            phases = [paths[j] for j in which]
        phase = np.where(self.cell.in_lens, 2 * math.pi / self.wavelength * np.array(phases), 0.0)
        passed = np.where(self.cell.in_lens, lenses.lens(0).transmission(self.cell.x, self.cell.y), 1.0)
        return np.asarray(unit_phasor(phase) * (passed * self.cell.weights))

    def _lens_path(self, index: int, arriving: PointSource) -> FloatArray:
        """Path that a lens adds, relative to its vertex [m]."""
        lens = self.path.microlenses.lens(index)
        kind = ParabolicPath if self.paraxial else SphericalPath
        before = kind(x=arriving.x, y=arriving.y, distance=arriving.distance)
        total = lens_paths(arriving, lens, paraxial=self.paraxial)
        x, y = (c[index] if c.ndim > 1 else c for c in (self.cell.x, self.cell.y))
        return np.asarray(total.value(x, y) - before.value(x, y))


def microlens_plane(
    path: LightPath,
    reach: RayReach,
    *,
    wavelength: float,
    paraxial: bool,
    target_reach: float,
    density: float,
    lit: Disc | None = None,
) -> MicrolensPlane:
    """Choose the nodes so that every target up to `target_reach` from a lens's ray image is resolved.

    The slope of the path to such a target differs from that of the ray by the distance between the two over the
    distance to the detector; across the lens, this adds up to the phase that the nodes resolve. Where light has a sharp
    shadow, only the `lit` part gets nodes.
    """
    cycles = resolved_cycles(
        path, reach, wavelength=wavelength, paraxial=paraxial, target_reach=target_reach, density=density
    )
    cell = cell_nodes(path.microlenses, cycles=cycles)
    if lit is not None:
        cell = padded([shadowed(path.microlenses, cell, lit, index, cycles) for index in range(path.microlenses.count)])
    return MicrolensPlane(path=path, wavelength=wavelength, paraxial=paraxial, cell=cell)


def resolved_cycles(
    path: LightPath, reach: RayReach, *, wavelength: float, paraxial: bool, target_reach: float, density: float
) -> float:
    """Cycles over a half aperture of the phase that nodes must resolve; parameters as for `microlens_plane`.

    The slope of Fresnel's path to a target is a tangent, that of the exact path a sine: behind fast microlenses,
    Fresnel's law needs many more nodes.
    """
    offset = target_reach + float(reach.spread.max())
    sine = sine_towards(offset, path.detector_distance, paraxial=paraxial)
    return density * path.microlenses.aperture_width / 2 * sine / wavelength


def shadowed(lenses: Microlenses, whole: CellNodes, lit: Disc, index: int, cycles: float) -> CellNodes:
    """Nodes of one microlens beside a shadow: all, those of the lit part, or none."""
    if lit_share(lenses.only(index), lit)[0] == 1.0:
        return whole
    x, y = lenses.centres[index]
    return lit_nodes(lenses, Disc(x=lit.x - x, y=lit.y - y, radius=lit.radius), cycles=cycles)


def direct_detector_field(
    plane: MicrolensPlane,
    kernel: Kernel,
    field: ComplexArray,
    transmission: ComplexArray,
    targets: FloatArray,
    *,
    images: FloatArray,
    target_reach: float,
) -> ComplexArray:
    """Field at a few detector points by plain summation over every node of every lens, as a reference.

    A lens counts only at points that its nodes resolve: farther from where its rays land, too few nodes would invent
    light.

    Parameters
    ----------
    plane, kernel
        Nodes and propagation law of the leg.
    field, transmission
        Arriving field and `MicrolensPlane.transmission`, shape (lenses, nodes).
    targets
        Points (x, y) [m], shape (points, 2).
    images, target_reach
        Where the ray through the centre of each lens lands [m], shape (lenses, 2), and the distance from there up to
        which the nodes resolve points [m].
    """
    x, y = plane.positions
    lenses = plane.path.microlenses
    total = np.zeros(targets.shape[0], dtype=np.complex128)
    for index in range(lenses.count):
        nodes = QuadratureNodes(
            x=x[index],
            y=y[index],
            weights=np.ones(x.shape[1]),
            centre=(float(lenses.centres[index, 0]), float(lenses.centres[index, 1])),
            half_extent=lenses.cell_reach,
        )
        samples = ApertureSamples(nodes=nodes, field=field[index] * transmission[index])
        resolved = np.linalg.norm(targets - images[index], axis=1) <= target_reach
        distance = np.full(resolved.sum(), plane.path.detector_distance)
        total[resolved] += direct_sum(samples, kernel, targets[resolved, 0], targets[resolved, 1], distance)
    return total


_UPSAMPLING = 4.0  # memory of a nonuniform FFT relative to that of its modes
POINTS_AT_ONCE = 2  # source points followed side by side, with one thread each
SINGLE_PRECISION_FROM = 1e-3  # tolerance from which on 32-bit floats add nothing to the error
_NODE = 10.0  # cost of a microlens node, in detector samples
FEWEST_NODES = 6.0  # least number of nodes of a microlens, per square of the cycles that they resolve
# Tolerance that patches meet: behind microlenses in focus, which interfere beyond the patches, points err by 5e-4 to
# 7e-3. Below it, the whole detector may cost more by the ratio of the tolerances.
_MET_BY_PATCHES = 1e-2


@dataclass(frozen=True, kw_only=True)
class DetectorPlan:
    """Extents and sampling that source points need on the detector.

    Attributes
    ----------
    kept
        Light is kept if it lands within this distance of where it passed the array [m].
    target_reach
        Largest distance from a ray image at which nodes must resolve a target [m].
    per_pixel
        Samples along a pixel.
    transfer
        Grid and propagation law of the leg.
    """

    kept: float
    target_reach: float
    per_pixel: int
    transfer: Transfer

    def memory(self, nodes: float, *, single: bool = False) -> float:
        """Memory that nodes and samples take together, in single or double precision [bytes]."""
        return (8.0 if single else 16.0) * (12 * nodes + (_UPSAMPLING + 4) * self.transfer.count**2)


def plan_detector(
    path: LightPath,
    reaches: Sequence[RayReach],
    *,
    wavelength: float,
    paraxial: bool,
    accuracy: ChainAccuracy,
    everywhere: bool = False,
) -> DetectorPlan:
    """Follow light beyond where rays land by a margin of Fresnel lengths that grows as the tolerance shrinks.

    Parameters
    ----------
    path
        The camera.
    reaches
        Rays of the source points whose light is to be followed; for a disc, those of its centre and of its rim.
    wavelength, paraxial
        Wavelength [m], and whether the leg to the detector follows Fresnel's law.
    accuracy
        Tolerance and sampling.
    everywhere
        Whether light is followed to the farthest pixel and a margin beyond, wherever rays land.
    """
    travel = max(float(reach.travel.max()) for reach in reaches)
    margin = accuracy.fresnel_lengths * math.sqrt(wavelength * path.detector_distance)
    kept = (_farthest(path) if everywhere else min(travel, _farthest(path))) + margin
    pixels = path.pixels
    band = half_band(wavelength, path.detector_distance, kept, paraxial=paraxial, tolerance=accuracy.tolerance)
    per_pixel = samples_per_pixel(pixels, accuracy.pixel_sampling * 2 * band * pixels.pitch)
    spacing = pixels.pitch / per_pixel
    # Half sides of the squares about the detector's centre that contain all nodes and all pixels.
    nodes = float(np.max(np.abs(path.microlenses.centres - np.asarray(pixels.centre)))) + path.microlenses.cell_reach
    targets = max(pixels.shape) * pixels.pitch / 2
    # The farthest pixel from any ray image of a source point; those of a disc's points lie between centre and rim.
    first, last = reaches[0].image, reaches[-1].image
    farthest = float(np.linalg.norm(first[:, None] - _corners(path), axis=-1).max())
    farthest += float(np.linalg.norm(last - first, axis=1).max())
    fading = fading_length(wavelength, path.detector_distance, kept, paraxial=paraxial, tolerance=accuracy.tolerance)
    # Besides its rays, a microlens sends light from the main lens's edge; too few nodes fold it back into small
    # windows.
    beside_rays = math.sqrt(2.0) * (max(float(reach.spread.max()) for reach in reaches) + margin)
    return DetectorPlan(
        kept=kept,
        target_reach=max(min(farthest, kept + fading + travel), beside_rays),
        per_pixel=per_pixel,
        transfer=choose_transfer(
            wavelength=wavelength,
            distance=path.detector_distance,
            paraxial=paraxial,
            node_reach=nodes,
            target_reach=targets + MARGIN * spacing,
            kept_reach=kept,
            spacing=spacing,
            tolerance=accuracy.tolerance,
        ),
    )


def field_on_detector(
    plane: MicrolensPlane,
    strengths: ComplexArray,
    *,
    response: Response,
    per_pixel: int,
    tolerance: float,
    threads: int = 0,
) -> ComplexArray:
    """Field on the fine grid of the detector, with three more samples on every side.

    Parameters
    ----------
    plane
        Nodes of all microlenses.
    strengths
        Field behind the lenses times area weight, shape (lenses, nodes).
    response
        Grid and transfer function.
    per_pixel
        Samples along a pixel.
    tolerance
        Tolerance of the nonuniform FFT.
    threads
        Threads that it may use; 0 for all.
    """
    pixels = plane.path.pixels
    held = strengths != 0  # lenses in a shadow have fewer nodes; a subtracted sphere leaves nothing
    x, y = plane.positions
    rows, columns = (n * per_pixel + 2 * MARGIN for n in pixels.shape)
    if not held.any():
        return np.zeros((rows, columns), dtype=strengths.dtype)
    first = np.asarray(pixels.corner) - pixels.centre + (0.5 - MARGIN) * pixels.pitch / per_pixel
    return detector_field(
        response,
        x=x[held] - pixels.centre[0],
        y=y[held] - pixels.centre[1],
        strengths=strengths[held],
        start=first,
        shape=(rows, columns),
        tolerance=tolerance,
        threads=threads,
    )


def _farthest(path: LightPath) -> float:
    """Distance from any point of a microlens to the farthest pixel [m]: light that lands beyond misses all pixels."""
    apart = np.linalg.norm(path.microlenses.centres[:, None] - _corners(path), axis=-1)
    return float(apart.max()) + path.microlenses.cell_reach


def _corners(path: LightPath) -> FloatArray:
    """Corners of the detector [m], shape (4, 2)."""
    return np.array([[x, y] for x in path.pixels.edges_x[[0, -1]] for y in path.pixels.edges_y[[0, -1]]])


@dataclass(frozen=True, kw_only=True)
class DetectorPatch:
    """Part of the detector on which the light of one source point is followed behind one microlens.

    Attributes
    ----------
    half_side
        Distance from its ray image within which the light of a microlens is followed, along x and y [m].
    side
        Samples along a side of the area that is followed, at most those of the detector.
    cycles
        Cycles over a half aperture that the nodes of a microlens resolve.
    per_pixel
        Samples along a pixel.
    grid
        Samples of the leg: of a patch, or of the whole detector.
    nodes
        Number of nodes of one microlens.
    """

    half_side: float
    side: float
    cycles: float
    per_pixel: int
    grid: PatchPlan | Transfer
    nodes: int

    @property
    def whole_detector(self) -> bool:
        """Whether all microlenses are followed over the whole detector at once."""
        return isinstance(self.grid, Transfer)

    def work(self, path: LightPath, *, lit: float) -> float:
        """Work for one source point that lights this many microlenses, in detector samples."""
        if self.whole_detector:
            return self.grid.count**2 + _NODE * self.nodes * path.microlenses.count
        return lit * (self.grid.count**2 + _NODE * self.nodes)


def detector_patch(
    path: LightPath,
    source: DiscSource,
    reaches: Sequence[RayReach],
    *,
    wavelength: float,
    paraxial: bool,
    accuracy: ChainAccuracy,
) -> DetectorPatch:
    """Choose patches or the whole detector; `reaches` are those of the disc's centre and of its outermost node."""
    patch = _patch(path, reaches, wavelength, paraxial, accuracy)
    within = lit_radius(path, source.centre, wavelength, accuracy)
    chief = np.asarray(path.chief_point(source.centre))
    lit = max(1, int(np.sum(np.linalg.norm(path.microlenses.centres - chief, axis=1) <= within)))
    affordable = max(1.0, _MET_BY_PATCHES / accuracy.tolerance) * patch.work(path, lit=lit)
    best, limit = patch, affordable
    for plan, cycles, least in _plans(path, reaches, wavelength, paraxial, accuracy):
        # Judged without the nodes: there may be too many to hold.
        if least > limit:
            break
        whole = DetectorPatch(
            half_side=_detector_side(path),
            side=_detector_side(path) / plan.transfer.spacing,
            cycles=cycles,
            per_pixel=plan.per_pixel,
            grid=plan.transfer,
            nodes=cell_node_count(path.microlenses, cycles=cycles),
        )
        single = accuracy.tolerance >= SINGLE_PRECISION_FROM
        needed = POINTS_AT_ONCE * plan.memory(whole.nodes * path.microlenses.count, single=single)
        work = whole.work(path, lit=lit)
        if needed <= accuracy.memory_limit and work <= limit:
            best, limit = whole, work
    return best


def _plans(
    path: LightPath, reaches: Sequence[RayReach], wavelength: float, paraxial: bool, accuracy: ChainAccuracy
) -> list[tuple[DetectorPlan, float, float]]:
    """Plans for the whole detector, sorted by their least work, with it and the cycles that their nodes resolve.

    A plan that follows light only to a margin is tried only where patches do not meet the tolerance: the light that it
    loses is not restored, unlike light beyond patches.
    """
    plans = []
    for everywhere in (True, False) if accuracy.tolerance < _MET_BY_PATCHES else (True,):
        plan = plan_detector(
            path, reaches, wavelength=wavelength, paraxial=paraxial, accuracy=accuracy, everywhere=everywhere
        )
        cycles = resolved_cycles(
            path,
            reaches[-1],
            wavelength=wavelength,
            paraxial=paraxial,
            target_reach=plan.target_reach,
            density=accuracy.microlens_nodes,
        )
        least = plan.transfer.count**2 + _NODE * FEWEST_NODES * cycles**2 * path.microlenses.count
        plans.append((plan, cycles, least))
    return sorted(plans, key=lambda entry: entry[2])


def _detector_side(path: LightPath) -> float:
    return max(path.pixels.shape) * path.pixels.pitch


def _patch(
    path: LightPath, reaches: Sequence[RayReach], wavelength: float, paraxial: bool, accuracy: ChainAccuracy
) -> DetectorPatch:
    """Patch and samples that contain the light of all points, from the rays of centre and rim of the disc."""
    margin = accuracy.fresnel_lengths * math.sqrt(wavelength * path.detector_distance)
    half = max(float(reach.spread.max()) for reach in reaches) + margin
    node_reach = path.microlenses.cell_reach
    band = half_band(
        wavelength, path.detector_distance, node_reach + half, paraxial=paraxial, tolerance=accuracy.tolerance
    )
    # The traced rim point may lie across the direction of a microlens, and another one along it: both distances add up.
    added = np.linalg.norm(reaches[-1].image - reaches[0].image, axis=1).max()
    landing = np.linalg.norm(reaches[0].image - path.microlenses.centres, axis=1).max()
    farthest = float(landing + added) + path.pixels.pitch
    reach = None
    if not paraxial:
        reach = fresnel_reach(
            wavelength=wavelength,
            distance=path.detector_distance,
            half_side=half,
            node_reach=node_reach,
            farthest=farthest,
            tolerance=accuracy.tolerance,
        )
        band = max(band, reach.band(node_reach, wavelength, path.detector_distance))
    per_pixel = samples_per_pixel(path.pixels, accuracy.pixel_sampling * 2 * band * path.pixels.pitch)
    spacing = path.pixels.pitch / per_pixel
    cycles = resolved_cycles(
        path,
        reaches[-1],
        wavelength=wavelength,
        paraxial=paraxial,
        target_reach=math.sqrt(2.0) * half,  # to its corners
        density=accuracy.microlens_nodes,
    )
    return DetectorPatch(
        half_side=half,
        side=min(2.0 * half, _detector_side(path)) / spacing,
        cycles=cycles,
        per_pixel=per_pixel,
        grid=PatchPlan(
            wavelength=wavelength,
            distance=path.detector_distance,
            spacing=spacing,
            half=math.ceil(half / spacing),
            reach=reach,
            farthest=farthest,
        ),
        nodes=cell_node_count(path.microlenses, cycles=cycles),
    )


def lit_radius(path: LightPath, point: PointSource, wavelength: float, accuracy: ChainAccuracy) -> float:
    """Radius about the chief ray of a point within which its light may reach the middle of a microlens [m]."""
    depth = abs(path.image_at_array(point)[2])
    beyond = accuracy.fresnel_lengths * math.sqrt(wavelength * max(depth, path.detector_distance))
    return blur_radius(path, point) + beyond + path.microlenses.cell_reach
