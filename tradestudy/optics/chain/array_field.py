"""The main lens's field in the array plane, computed once on a grid and interpolated where it is needed.

The kernel is a prolate wave function made for waves of a known band. It follows them close to the sampling limit, where
splines fail, and finufft evaluates it several times faster. As with splines, coefficients reproduce the table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import finufft
import numpy as np
import scipy.fft

from tradestudy.errors import UnaffordableError
from tradestudy.optics.arrays import ComplexArray, FloatArray, unit_phasor
from tradestudy.optics.chain.microlens_nodes import plane_wave_degree, tapered_disc_count, tapered_disc_nodes
from tradestudy.optics.chain.scene import LightPath, WaveMethod
from tradestudy.optics.propagation.fast_sum import fast_sum
from tradestudy.optics.propagation.hybrid import unchecked_hybrid_field
from tradestudy.optics.propagation.kernels import ApertureSamples, FresnelKernel, Kernel, KirchhoffKernel, direct_sum
from tradestudy.optics.propagation.lens import LensWave, PointSource
from tradestudy.optics.propagation.paths import Array
from tradestudy.optics.propagation.sampling import Limits, net_phase, outline
from tradestudy.optics.propagation.targets import TargetGrid, TargetPoints
from tradestudy.optics.quadrature import QuadratureNodes, disc_nodes

_WIDEST = 16  # half width of the widest kernel [samples]
_FINEST, _COARSEST = 1e-7, 1e-3
_SINGLE_FROM = 2e-5  # tolerance from which on 32-bit numbers are exact enough
_SETTLING = 128  # samples within which coefficients settle


@dataclass(frozen=True)
class TableKernel:
    """Kernel for one band and tolerance.

    Attributes
    ----------
    oversampling
        Oversampling of the waves relative to Nyquist's rate, > 1.
    tolerance
        Error allowed relative to the waves, in 1e-7 … 1e-3.
    """

    oversampling: float
    tolerance: float

    @classmethod
    def within(cls, oversampling: float, tolerance: float) -> TableKernel:
        """Kernel made for the tolerance nearest to the one requested."""
        return cls(oversampling, min(max(tolerance, _FINEST), _COARSEST))

    @property
    def single(self) -> bool:
        """Whether 32-bit numbers are exact enough."""
        return self.tolerance >= _SINGLE_FROM

    @property
    def end_effect(self) -> int:
        """Samples at each end of a table where the coefficients have not settled to the tolerance."""
        settled = np.abs(np.fft.ifft(1 / _response(self, 2 * math.pi * np.arange(_SETTLING) / _SETTLING)))
        return int(np.argmax(settled[: _SETTLING // 2] <= self.tolerance * settled[0]))

    def coefficients(self, table: ComplexArray) -> ComplexArray:
        """Coefficients with which the kernel reproduces a table, mirrored at its ends."""
        along = [_response(self, math.pi * np.arange(count) / (count - 1)) for count in table.shape]
        spectrum = scipy.fft.dctn(table, type=1)
        spectrum /= np.multiply.outer(*along)
        coefficients = scipy.fft.idctn(spectrum, type=1, overwrite_x=True)
        return np.asarray(coefficients.astype(np.complex64 if self.single else np.complex128))

    def interpolated(self, coefficients: ComplexArray, rows: FloatArray, columns: FloatArray) -> ComplexArray:
        """Values at positions counted in samples from the first one; zero outside the table."""
        last_row, last_column = (count - 1 for count in coefficients.shape)
        turns = [
            2 * math.pi / count * positions.ravel() - math.pi
            for count, positions in zip(coefficients.shape, (rows, columns), strict=True)
        ]
        values = _summed(self, coefficients, *turns).reshape(rows.shape)
        beyond = (np.minimum(rows, columns) < 0) | (rows > last_row) | (columns > last_column)
        if beyond.any():
            values[beyond] = 0.0
        return values


def fast_count(least: float) -> int:
    """Smallest side of a table, in samples, that is no less than `least` and whose coefficients are found fast.

    It spans at least two of the widest kernels, without which no position can be read.
    """
    return int(scipy.fft.next_fast_len(max(math.ceil(least) - 1, 2 * _WIDEST), real=True)) + 1


def _summed(kernel: TableKernel, coefficients: ComplexArray, y: FloatArray, x: FloatArray) -> ComplexArray:
    """Sum of the kernel times the coefficients about each position, given in radians of a turn about the middle."""
    real = np.float32 if coefficients.dtype == np.complex64 else np.float64
    return np.asarray(
        finufft.nufft2d2(
            y.astype(real),
            x.astype(real),
            coefficients,
            eps=kernel.tolerance,
            upsampfac=kernel.oversampling,
            spreadinterponly=1,
            spread_sort=0,  # positions are sorted
            nthreads=1,
        )
    )


def _response(kernel: TableKernel, phases: FloatArray) -> FloatArray:
    """Factor by which the kernel changes waves of a given phase per sample."""
    whole = _at_whole_samples(kernel)
    turns = np.multiply.outer(phases, np.arange(1, whole.size))
    return np.asarray(whole[0] + 2.0 * np.cos(turns) @ whole[1:])


@lru_cache(maxsize=16)
def _at_whole_samples(kernel: TableKernel) -> FloatArray:
    """Kernel at whole samples from its middle outwards, along one axis."""
    unit = np.zeros((4 * _WIDEST, 4 * _WIDEST), dtype=np.complex64 if kernel.single else np.complex128)
    unit[2 * _WIDEST, 2 * _WIDEST] = 1.0
    away = 2 * math.pi / len(unit) * np.arange(_WIDEST, dtype=np.float64)
    along = _summed(kernel, unit, away, np.zeros_like(away)).real.astype(np.float64)
    return np.asarray(along / math.sqrt(along[0]))


_SHARE_OF_READING = 0.1  # fraction of a table's tolerance that its interpolation may use
_SHARE_OF_FACTOR = 0.2  # the same for its low-rank factor; two computations share most of that error
_OVERSAMPLING = 1.5  # of tables with a tolerance of 1e-3 or more …
_FINER = 0.3  # … plus this much for each decade below
_AROUND = 32  # points on the edge of a disc that represent all of it
_MOST_DISC_NODES = 1e8  # four times the nodes on a coherent disc
_LOOSER = 10.0  # a boundary wave's intensity errs by 1 % of its tolerance: a tenth of the image's


@dataclass(frozen=True, kw_only=True)
class PupilWave:
    """Wave behind the main lens and the law that carries it to the array.

    Attributes
    ----------
    path
        The camera.
    source
        Point source in front of the main lens.
    wavelength
        λ [m].
    method
        Law of this leg; the boundary wave computes Kirchhoff's field in another way.
    coherent_radius
        Radius of a coherent disc about `source`, with one phase throughout its plane [m]; 0 for a point.
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
        """Wave that is compared to estimate the error: Kirchhoff's for a boundary wave, else this one."""
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
            # The lens adds the same phase and amplitude to every wave: only the wave in front of it is exchanged.
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
        """Wave from the middle of the source in front of the main lens, in the units of `_disc_wave`."""
        point = QuadratureNodes(
            x=np.array([self.source.x]),
            y=np.array([self.source.y]),
            weights=np.ones(1),
            centre=(self.source.x, self.source.y),
            half_extent=self.wavelength,
        )
        samples = ApertureSamples(nodes=point, field=np.ones(1, dtype=complex))
        return direct_sum(samples, self.kernel, nodes.x, nodes.y, np.full(nodes.count, self.source.distance))

    def _disc_wave(self, nodes: QuadratureNodes) -> ComplexArray:
        """Wave of the whole coherent disc in front of the main lens (eq. 10)."""
        radius, reach = self.coherent_radius, self.path.main_lens.radius + self.coherent_radius
        reach += math.hypot(self.source.x, self.source.y)
        # The phase over the disc is steepest on the way to the farthest point of the lens.
        degree = plane_wave_degree(
            2 * math.pi / self.wavelength * radius * reach / math.hypot(reach, self.source.distance)
        )
        if degree**2 > _MOST_DISC_NODES:
            raise UnaffordableError(
                "nodes on a coherent disc",
                value=f"about {degree**2 / 4:.2g}",
                limit=f"{_MOST_DISC_NODES / 4:.2g}",
                remedy="use a smaller disc, or an incoherent one",
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

    def nodes(
        self,
        region: tuple[FloatArray, FloatArray],
        *,
        density: float,
        only_disc: bool = False,
        memory_limit: float = math.inf,
    ) -> QuadratureNodes:
        """Pupil nodes that resolve the net phase from the source to every point of a rectangle around the region.

        With `only_disc`, they resolve it only for the points of the disc within the rectangle. Counts around the rim
        and along the radius are chosen separately: the phase of a defocused wave changes fast only along the radius.

        Raises
        ------
        UnaffordableError
            If the nodes, and what `field_table` computes with them, need more memory [bytes].
        """
        radius, z = self.path.main_lens.radius, self.path.array_distance
        # Light from every point of a coherent disc arrives at its own slope, as if targets lay farther out.
        wider = z * self.coherent_radius / math.hypot(self.coherent_radius, self.source.distance)
        sides = [np.array([np.min(c) - wider, np.max(c) + wider]) for c in region]
        x, y = _outline(sides[0], sides[1], only_disc=only_disc)
        half_range, turns = net_phase(self.wave.paths, self.kernel, radius=radius, x=x, y=y, z=np.full_like(x, z))
        # Before they are placed: there may be too many to hold.
        _check_memory(tapered_disc_count(2 * density * half_range, density * turns), 0, memory_limit)
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
    """Field on a grid, with its fast phase removed, ready to be interpolated.

    Coordinates are relative to where the chief ray meets the array; `fast_phase` is added back where the field is read.

    Attributes
    ----------
    start
        First grid point (x, y) [m].
    spacing
        Distance between grid points [m].
    coefficients
        Interpolation coefficients, shape (rows, columns).
    kernel
        Kernel that interpolates with these coefficients.
    handed_over
        Fraction of the grid that a boundary wave left to Kirchhoff's integral; 0 for the other methods.
    """

    start: tuple[float, float]
    spacing: float
    coefficients: ComplexArray
    kernel: TableKernel
    handed_over: float = 0.0

    def slow_part(self, x: FloatArray, y: FloatArray) -> ComplexArray:
        """Field without its fast phase at points relative to the origin; zero outside the grid."""
        rows, columns = (
            (position - start) / self.spacing for position, start in ((y, self.start[1]), (x, self.start[0]))
        )
        return self.kernel.interpolated(self.coefficients, rows, columns)


def fast_phase(wave: PupilWave, x: Array, y: Array) -> FloatArray:
    """Phase of the path from the middle of the main lens, plus that of the chief ray in front of it [rad].

    Without it, the field contains only waves whose slope is at most that from the middle of the lens to its rim.
    """
    a, z = wave.source.distance, np.asarray(wave.path.array_distance)
    chief_x, chief_y = (np.asarray(c) for c in wave.path.chief_point(wave.source))
    off = math.hypot(wave.source.x, wave.source.y)
    before = abs(a) + off**2 / (2 * abs(a)) if wave.paraxial else math.hypot(a, off)
    k, behind = wave.kernel.wavenumber, float(wave.kernel.path(chief_x, chief_y, z))
    # The many full turns of a distant source would leave no digits for the rest.
    return np.asarray(math.fmod(k * (before + behind), 2 * math.pi) + k * (wave.kernel.path(x, y, z) - behind))


def reading_kernel(tolerance: float) -> TableKernel:
    """Interpolation kernel for tables of this tolerance: a smaller one needs a wider kernel and finer samples."""
    return TableKernel.within(
        _OVERSAMPLING + _FINER * max(0.0, math.log10(1e-3 / tolerance)), _SHARE_OF_READING * tolerance
    )


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
    only_disc: bool = False,
) -> FieldTable:
    """Compute the field on a grid over a rectangle.

    Parameters
    ----------
    wave
        Wave behind the main lens.
    low, high
        Opposite corners (x, y) of the rectangle, relative to the chief ray's point [m].
    spacing
        Distance between grid points [m].
    node_density
        Factor on the phase that the pupil nodes resolve.
    tolerance
        Tolerance of the low-rank factor and of the nonuniform FFT.
    memory_limit
        Memory allowed [bytes].
    edge_tolerance
        Tolerance of the image; nodes, poles and interpolation of a boundary wave use a tenth of it. The difference
        between a boundary wave and Kirchhoff's integral does not depend on sampling; the comparison of images covers
        it.
    only_disc
        Whether only the disc within the rectangle is read; beyond it, the field may be wrong.

    Raises
    ------
    UnaffordableError
        If grid and pupil nodes need more memory than allowed.
    NotConvergedError
        If Kirchhoff's integral misses the tolerance where it replaces the boundary wave.
    """
    chief = wave.path.chief_point(wave.source)
    end = reading_kernel(tolerance).end_effect
    start = tuple(c - end * spacing for c in low)
    counts = tuple(fast_count((b - a) / spacing + 1 + 2 * end) for a, b in zip(low, high, strict=True))
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
        slow = hybrid.field * unit_phasor(-fast_phase(wave, x, y))
        table = tabulated(slow, start=(start[0], start[1]), spacing=spacing, tolerance=tolerance)
        return replace(table, handed_over=hybrid.handed_over)
    # Points outside the rectangle only shape the ends of the table, for which too few nodes suffice.
    sides = tuple(chief[axis] + np.array([low[axis], high[axis]]) for axis in (0, 1))
    points = counts[0] * counts[1]
    _check_memory(0, points, memory_limit)
    nodes = wave.nodes((sides[0], sides[1]), density=node_density, only_disc=only_disc, memory_limit=memory_limit)
    _check_memory(nodes.count, points, memory_limit)
    result = fast_sum(
        wave.samples(nodes),
        wave.kernel,
        grid,
        low_rank_tolerance=_SHARE_OF_FACTOR * tolerance,
        nufft_tolerance=tolerance,
    )
    slow = result.field.reshape(grid.shape) * unit_phasor(-fast_phase(wave, x, y))
    return tabulated(slow, start=(start[0], start[1]), spacing=spacing, tolerance=tolerance)


def _check_memory(nodes: float, points: float, limit: float) -> None:
    """Refuse pupil nodes and points on the array that need more memory than allowed."""
    needed = 16.0 * (30 * (nodes + points) + 8 * points)  # rank 30 at most; a grid upsampled twice each way
    if needed > limit:
        raise UnaffordableError(
            "main-lens field on the array",
            value=", ".join(
                [f"{n:.3g} {what}" for n, what in ((nodes, "pupil nodes"), (points, "points")) if n]
                + [f"{needed / 1e9:.3g} GB"]
            ),
            limit=f"{limit / 1e9:.3g} GB",
            remedy="use fewer microlenses, a coarser field sampling or a smaller main lens, or raise the memory limit",
        )


def _outline(x: FloatArray, y: FloatArray, *, only_disc: bool) -> tuple[FloatArray, FloatArray]:
    """Middle and outermost points of the rectangle spanned by positions along two axes, or of the disc within it."""
    if not only_disc:
        corners_x, corners_y, _ = outline(x, y, np.zeros(1))
        return corners_x, corners_y
    angle = 2 * math.pi * np.arange(_AROUND) / _AROUND
    across, along = np.ptp(x) / 2, np.ptp(y) / 2
    return np.r_[0.0, across * np.cos(angle)] + np.mean(x), np.r_[0.0, along * np.sin(angle)] + np.mean(y)


def tabulated(slow: ComplexArray, *, start: tuple[float, float], spacing: float, tolerance: float) -> FieldTable:
    """Table of a field without its fast phase."""
    kernel = reading_kernel(tolerance)
    return FieldTable(start=start, spacing=spacing, coefficients=kernel.coefficients(slow), kernel=kernel)


def looser_for_edges(tolerance: float) -> float:
    """Tolerance required of a boundary wave for a given tolerance of the image."""
    return min(_LOOSER * tolerance, 0.1)


def blended(tables: list[FieldTable], weights: FloatArray) -> FieldTable:
    """Weighted sum of tables on one grid: interpolation over the source position."""
    first = tables[0]
    total = np.zeros_like(first.coefficients)
    for weight, table in zip(weights, tables, strict=True):
        total += weight.astype(total.real.dtype) * table.coefficients
    return replace(
        first,
        coefficients=total,
        handed_over=max(table.handed_over for table in tables),
    )


def direct_field(wave: PupilWave, x: FloatArray, y: FloatArray) -> ComplexArray:
    """Field at a few points by direct summation over more nodes than the fast path uses, as a reference."""
    nodes = wave.nodes((x, y), density=1.5)
    return direct_sum(wave.samples(nodes), wave.kernel, x, y, np.full_like(x, wave.path.array_distance))
