"""The main lens's field in the array plane, computed once on a grid and interpolated where it is needed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import ndimage

from tradestudy.errors import UnaffordableError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.microlens_nodes import plane_wave_degree, tapered_disc_nodes
from tradestudy.optics.chain.scene import LightPath, WaveMethod
from tradestudy.optics.propagation.direct import ApertureSamples, ComplexArray, direct_sum, unit_phasor
from tradestudy.optics.propagation.fast_sum import fast_sum
from tradestudy.optics.propagation.hybrid import unchecked_hybrid_field
from tradestudy.optics.propagation.kernels import FresnelKernel, Kernel, KirchhoffKernel
from tradestudy.optics.propagation.lens import LensWave, PointSource
from tradestudy.optics.propagation.paths import Array, SphericalPath
from tradestudy.optics.propagation.sampling import Limits, TargetGrid, TargetPoints, net_phase, outline
from tradestudy.optics.quadrature import QuadratureNodes, disc_nodes

_SPLINE_ORDER: Literal[5] = 5
_END = 12  # grid points beyond each side, where the spline's end effect dies
_LOOSER = 10.0  # boundary waves err by a hundredth of their tolerance in the intensity: a tenth of the image's remains
_LEAST_FRESNEL_NUMBER = 1.0  # of the blur on the array, from which on its spherical wave is taken out


@dataclass(frozen=True, kw_only=True)
class PupilWave:
    """Wave behind the main lens and the law that carries it to the array.

    Attributes
    ----------
    path
        The camera.
    source
        Point source before the main lens.
    wavelength
        [m].
    method
        Law of this leg; the boundary wave computes Kirchhoff's field in another way.
    coherent_radius
        > 0: the source is a coherent disc of this radius about `source`, of one phase in its plane [m].
    """

    path: LightPath
    source: PointSource
    wavelength: float
    method: WaveMethod
    coherent_radius: float = 0.0

    @property
    def paraxial(self) -> bool:
        """Whether paths are taken to second order."""
        return self.method == "fresnel"

    @property
    def reference(self) -> PupilWave:
        """Wave whose image is compared to estimate the error: Kirchhoff's for a boundary wave, else the same."""
        return replace(self, method="kirchhoff") if self.method == "boundary_wave" else self

    @property
    def whole_pupil(self) -> bool:
        """Whether light from every pupil point may reach every array point."""
        return self.coherent_radius > 0

    @property
    def kernel(self) -> Kernel:
        """Propagation to the array."""
        return leg_kernel(self.wavelength, self.paraxial)

    @property
    def wave(self) -> LensWave:
        """Wave directly behind the main lens."""
        return LensWave(
            source=self.source,
            lens=self.path.main_lens,
            wavelength=self.wavelength,
            paraxial=self.paraxial,
            obliquity="paper",
        )

    def samples(self, nodes: QuadratureNodes) -> ApertureSamples:
        """Wave on quadrature nodes of the pupil."""
        field = self.wave.field(nodes.x, nodes.y)
        if self.coherent_radius > 0:
            field = field / self._point_wave(nodes) * self._disc_wave(nodes)
        return ApertureSamples(nodes=nodes, field=field)

    def power(self) -> float:
        """∫ |U|² over the pupil."""
        if self.coherent_radius > 0:
            nodes = self.nodes((np.zeros(1), np.zeros(1)), density=1.0)
            passed = self.path.main_lens.transmission(nodes.x, nodes.y)
            return float(nodes.weights @ np.abs(self._disc_wave(nodes) * passed) ** 2)
        return self.wave.power()

    def _point_wave(self, nodes: QuadratureNodes) -> ComplexArray:
        """Wave of the middle of the source before the main lens, in the units of the disc's."""
        one = QuadratureNodes(
            x=np.array([self.source.x]),
            y=np.array([self.source.y]),
            weights=np.ones(1),
            centre=(self.source.x, self.source.y),
            half_extent=self.wavelength,
        )
        samples = ApertureSamples(nodes=one, field=np.ones(1, dtype=complex))
        return direct_sum(samples, self.kernel, nodes.x, nodes.y, np.full(nodes.count, self.source.distance))

    def _disc_wave(self, nodes: QuadratureNodes) -> ComplexArray:
        """Wave of the whole coherent disc before the main lens (eq. 10)."""
        radius, reach = self.coherent_radius, self.path.main_lens.radius + self.coherent_radius
        reach += math.hypot(self.source.x, self.source.y)
        degree = plane_wave_degree(
            2 * math.pi / self.wavelength * radius * reach / math.hypot(reach, self.source.distance)
        )
        disc = disc_nodes(
            radius=radius,
            radial_count=degree // 4 + 2,
            angular_count=degree + 1,
            centre=(self.source.x, self.source.y),
        )
        targets = TargetPoints(x=nodes.x, y=nodes.y, distance=self.source.distance)
        samples = ApertureSamples(nodes=disc, field=np.ones(disc.count, dtype=complex))
        return fast_sum(samples, self.kernel, targets, low_rank_tolerance=1e-7, nufft_tolerance=1e-7).field

    def nodes(self, region: tuple[FloatArray, FloatArray], *, density: float) -> QuadratureNodes:
        """Pupil nodes that resolve the net phase from the source to every point of a region of the array.

        Around the rim and along the radius apart: a defocused wave turns fast along the radius alone.
        """
        radius, z = self.path.main_lens.radius, self.path.array_distance
        # Every point of a coherent disc arrives at its own slope, which is as good as targets farther out.
        wider = z * self.coherent_radius / math.hypot(self.coherent_radius, self.source.distance)
        low_x, low_y = (np.min(c) - wider for c in region)
        high_x, high_y = (np.max(c) + wider for c in region)
        box = outline(np.array([low_x, high_x]), np.array([low_y, high_y]), np.array([z, z]))
        half_range, turns = net_phase(self.wave.paths, self.kernel, radius=radius, x=box[0], y=box[1], z=box[2])
        return self.path.main_lens.without_obscuration(
            lambda part: tapered_disc_nodes(
                radius=part, radial_phase=2 * density * half_range, angular_phase=density * turns
            )
        )


def leg_kernel(wavelength: float, paraxial: bool) -> Kernel:
    """Propagation law of a leg."""
    if paraxial:
        return FresnelKernel(wavelength=wavelength)
    return KirchhoffKernel(wavelength=wavelength, obliquity="paper")


@dataclass(frozen=True, kw_only=True)
class FieldTable:
    """Field on a grid with its fast phase taken out, ready to be interpolated.

    Coordinates are relative to the chief ray's point; `fast_phase` is added back where the field is read.

    Attributes
    ----------
    start
        First grid point (x, y) [m].
    spacing
        [m].
    coefficients
        Spline coefficients of real and imaginary part, shape (2, rows, columns).
    handed_over
        Share of the grid that a boundary wave left to Kirchhoff's integral; 0 for the other methods.
    """

    start: tuple[float, float]
    spacing: float
    coefficients: FloatArray
    handed_over: float = 0.0

    def slow_part(self, x: FloatArray, y: FloatArray) -> ComplexArray:
        """Field without its fast phase at points relative to the origin; zero outside the grid."""
        at = np.stack([(y - self.start[1]) / self.spacing, (x - self.start[0]) / self.spacing])
        real, imaginary = (
            ndimage.map_coordinates(part, at, order=_SPLINE_ORDER, mode="constant", prefilter=False)
            for part in self.coefficients
        )
        return np.asarray(real + 1j * imaginary)


def fast_phase(wave: PupilWave, x: Array, y: Array) -> FloatArray:
    """Phase of the sphere about the main lens's image, plus that of the chief ray: what the table leaves out [rad].

    No sphere is taken out where the array lies so near the image that the blur has less than a Fresnel zone.
    """
    a, z = wave.source.distance, wave.path.array_distance
    chief_x, chief_y = wave.path.chief_point(wave.source)
    k = 2 * math.pi / wave.wavelength
    off = math.hypot(wave.source.x, wave.source.y)
    if wave.paraxial:
        chief = abs(a) + off**2 / (2 * abs(a)) + z + (chief_x**2 + chief_y**2) / (2 * z)
    else:
        chief = math.hypot(a, off) + math.hypot(z, chief_x, chief_y)
    sphere = _sphere(wave)
    if sphere is None:
        return np.full(np.broadcast(x, y).shape, k * chief)
    # The chief ray's phase is a constant; turns of a far source would leave no digits to the sphere.
    return np.asarray(math.fmod(k * chief, 2 * math.pi) + k * sphere.value(x - chief_x, y - chief_y))


def _sphere(wave: PupilWave) -> SphericalPath | None:
    """Spherical path about the image, in coordinates relative to the chief ray's point."""
    x, y, depth = wave.path.image_at_array(wave.source)
    b = wave.path.array_distance - depth
    blur = wave.path.main_lens.radius * abs(depth / b)
    pupil = wave.path.main_lens.pupil
    if pupil is not None and (pupil.aberrated or not pupil.evenly_lit):
        return None  # light of one array point then comes from all over the pupil, or from an edge within it
    if wave.coherent_radius > 0 or blur**2 <= _LEAST_FRESNEL_NUMBER * wave.wavelength * abs(depth):
        return None
    chief_x, chief_y = wave.path.chief_point(wave.source)
    return SphericalPath(x=x - chief_x, y=y - chief_y, distance=depth)


def field_table(
    wave: PupilWave,
    *,
    low: tuple[float, float],
    high: tuple[float, float],
    spacing: float,
    node_density: float,
    tolerance: float,
    memory_limit: float,
    edge_tolerance: float = 0.1,
) -> FieldTable:
    """Compute the field on a grid over a rectangle.

    Parameters
    ----------
    wave
        Wave behind the main lens.
    low, high
        Opposite corners (x, y) of the rectangle, relative to the chief ray's point [m].
    spacing
        Distance of grid points [m].
    node_density
        Factor on the phase that the pupil nodes resolve.
    tolerance
        Of the low-rank factor and the nonuniform FFT.
    memory_limit
        [bytes].
    edge_tolerance
        Tolerance of the image; nodes, poles and interpolation of the boundary wave take a tenth of it. Its difference
        from Kirchhoff's integral does not depend on sampling; the comparison of images covers it.

    Raises
    ------
    UnaffordableError
        If grid and pupil nodes need more memory than allowed.
    NotConvergedError
        If Kirchhoff's integral misses the tolerance where it replaces the boundary wave.
    """
    chief = wave.path.chief_point(wave.source)
    start = tuple(c - _END * spacing for c in low)
    counts = tuple(math.ceil((b - a) / spacing) + 1 + 2 * _END for a, b in zip(low, high, strict=True))
    grid = TargetGrid(
        x_start=chief[0] + start[0],
        y_start=chief[1] + start[1],
        x_pitch=spacing,
        y_pitch=spacing,
        x_count=counts[0],
        y_count=counts[1],
        distance=wave.path.array_distance,
    )
    x, y = grid.x_axis[None, :], grid.y_axis[:, None]
    if wave.method == "boundary_wave":
        hybrid = unchecked_hybrid_field(
            wave=wave.wave,
            kernel=KirchhoffKernel(wavelength=wave.wavelength, obliquity="paper"),
            targets=grid,
            tolerance=looser_for_edges(edge_tolerance),
            limits=Limits(memory_bytes=memory_limit),
        )
        return FieldTable(
            start=(start[0], start[1]),
            spacing=spacing,
            coefficients=_spline(hybrid.field * unit_phasor(-fast_phase(wave, x, y))),
            handed_over=hybrid.handed_over,
        )
    edge_x, edge_y = grid.x_axis[[0, -1, 0, -1]], grid.y_axis[[0, -1, -1, 0]]
    nodes = wave.nodes((edge_x, edge_y), density=node_density)
    points = counts[0] * counts[1]
    needed = 16.0 * (30 * (nodes.count + points) + 8 * points)  # rank 30 at most; a grid upsampled twice each way
    if needed > memory_limit:
        raise UnaffordableError(
            "main-lens field on the array",
            value=f"{nodes.count} pupil nodes, {counts[0]} × {counts[1]} points, {needed / 1e9:.3g} GB",
            limit=f"{memory_limit / 1e9:.3g} GB",
            remedy="use fewer microlenses or a coarser field sampling, or raise the memory limit",
        )
    result = fast_sum(wave.samples(nodes), wave.kernel, grid, low_rank_tolerance=tolerance, nufft_tolerance=tolerance)
    slow = result.field.reshape(grid.shape) * unit_phasor(-fast_phase(wave, x, y))
    return FieldTable(start=(start[0], start[1]), spacing=spacing, coefficients=_spline(slow))


def looser_for_edges(tolerance: float) -> float:
    """Tolerance required of a boundary wave for a given tolerance of the image."""
    return min(_LOOSER * tolerance, 0.1)


def blended(tables: list[FieldTable], weights: FloatArray) -> FieldTable:
    """Weighted sum of tables on one grid: interpolation over the source position."""
    first = tables[0]
    coefficients = sum(w * table.coefficients for w, table in zip(weights, tables, strict=True))
    return replace(
        first,
        coefficients=np.asarray(coefficients),
        handed_over=max(table.handed_over for table in tables),
    )


def direct_field(wave: PupilWave, x: FloatArray, y: FloatArray) -> ComplexArray:
    """Field at a few points by direct summation over more nodes than the fast path uses, as a reference."""
    nodes = wave.nodes((x, y), density=1.5)
    return direct_sum(wave.samples(nodes), wave.kernel, x, y, np.full_like(x, wave.path.array_distance))


def _spline(field: ComplexArray) -> FloatArray:
    """Spline coefficients of real and imaginary part."""
    return np.stack([ndimage.spline_filter(part, order=_SPLINE_ORDER) for part in (field.real, field.imag)])
