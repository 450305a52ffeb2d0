"""The wave directly behind the microlens array, on quadrature nodes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.arriving_light import RayReach
from tradestudy.optics.chain.detector_transfer import sine_towards
from tradestudy.optics.chain.microlens_nodes import CellNodes, cell_nodes, lit_nodes, lit_share, padded
from tradestudy.optics.chain.microlenses import Microlenses
from tradestudy.optics.chain.regions import Disc
from tradestudy.optics.chain.scene import LightPath
from tradestudy.optics.phasors import ComplexArray, unit_phasor
from tradestudy.optics.propagation.direct import ApertureSamples, direct_sum
from tradestudy.optics.propagation.kernels import Kernel
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
            each = [self._lens_path(i, _ANY_POINT) for i in first]
            phases = [each[j] for j in which]
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
    at: FloatArray,
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
    at
        Points (x, y) [m], shape (points, 2).
    images, target_reach
        Where the ray through the centre of each lens lands [m], shape (lenses, 2), and the distance from there up to
        which the nodes resolve points [m].
    """
    x, y = plane.positions
    lenses = plane.path.microlenses
    total = np.zeros(at.shape[0], dtype=np.complex128)
    for index in range(lenses.count):
        nodes = QuadratureNodes(
            x=x[index],
            y=y[index],
            weights=np.ones(x.shape[1]),
            centre=(float(lenses.centres[index, 0]), float(lenses.centres[index, 1])),
            half_extent=lenses.cell_reach,
        )
        samples = ApertureSamples(nodes=nodes, field=field[index] * transmission[index])
        seen = np.linalg.norm(at - images[index], axis=1) <= target_reach
        distance = np.full(seen.sum(), plane.path.detector_distance)
        total[seen] += direct_sum(samples, kernel, at[seen, 0], at[seen, 1], distance)
    return total
