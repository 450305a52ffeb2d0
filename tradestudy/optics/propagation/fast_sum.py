"""The sum of `direct_sum` by one nonuniform Fourier transform per term of a low-rank factor.

Seen from a base target B in the middle of the targets, the path from node q to target P is

    s(q, P) = s(q, B) + e(q)·(P − B) + rest(q, P),

with e the transverse direction cosines from the node to B. The first two terms, linear in the target, are one
NUFFT; the rest, and the amplitude, vary slowly: exp(i k rest) · amplitude is a sum of a few products of a function
of the node and a function of the target, found by a pivoted factorisation on Chebyshev points of the targets' box.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import finufft
import numpy as np

from tradestudy.optics.arrays import ComplexArray, FloatArray, scaled_phasor, unit_phasor
from tradestudy.optics.propagation.kernels import ApertureSamples, FresnelKernel, Kernel, check_cosine, direct_sum
from tradestudy.optics.propagation.paths import Array
from tradestudy.optics.propagation.targets import (
    TargetGrid,
    Targets,
    Upsampling,
    apply_along_rows,
    chebyshev_points,
    lagrange,
    upsampling,
)

_MAX_RANK = 30  # a larger factor means that the targets are better split in two
_SAMPLE_NODES = 120  # rows on which the low-rank factor is found; ≥ 4 per unit of rank
_PAIRS_AT_ONCE = 16_000  # of a node and a term: a few blocks of this size stay in the cache
_DEGREES = (3, 5, 8, 12, 17, 24)  # Chebyshev points per axis that are tried in turn


@dataclass(frozen=True, kw_only=True)
class SumProblem:
    """A wave, a law, and the tolerances of the sum, relative to the largest field that the nodes could give."""

    samples: ApertureSamples
    kernel: Kernel
    low_rank: float
    nufft: float


@dataclass(frozen=True, kw_only=True)
class SlowFactor:
    """exp(i k rest) amplitude ≈ Σ_t node(q, t) · target(P, t) · common(P)."""

    node: ComplexArray  # (n, rank)
    coefficients: ComplexArray  # (rank, nx, ny, nz) on Chebyshev points
    error: float


class TooWide(Exception):  # noqa: N818  (a signal to the caller to split, not an error)
    """The targets are too far apart for a small factor."""


def slow_factor(
    problem: SumProblem, base: tuple[float, float, float], box: tuple[FloatArray, FloatArray, FloatArray]
) -> SlowFactor:
    """Interpolative low-rank factor of the slow part over the nodes and the box of the targets.

    Raises
    ------
    TooWide
        The box needs more terms than are worth their transforms: split it.
    """
    count = problem.samples.nodes.count
    if isinstance(problem.kernel, FresnelKernel) and not np.ptp(box[2]):
        # Exact, 1/z: on a plane, the nonlinear path of Fresnel's law is the same from every node.
        node, coefficients = np.ones((count, 1), dtype=np.complex128), np.full((1, 1, 1, 1), 1 / box[2][0] + 0j)
        return SlowFactor(node=node, coefficients=coefficients, error=0.0)
    rng = np.random.default_rng(0)  # fixed: the same request gives the same digits
    shuffled = rng.permutation(count)
    # The error is measured between random targets and, where there are enough nodes, nodes that are not fitted.
    fit, held = shuffled[:_SAMPLE_NODES], shuffled[-_SAMPLE_NODES // 2 :]
    probes = tuple(c.min() + np.ptp(c) * rng.random(32) for c in box)
    exact = _slow(problem, base, fit, probes)
    _refuse_wide(problem, base, fit, box)
    for degree in _DEGREES:
        counts = tuple(degree if np.ptp(c) > 0 else 1 for c in box)
        axes = [chebyshev_points(c, n) for c, n in zip(box, counts, strict=True)]
        mesh = tuple(m.ravel() for m in np.meshgrid(*axes, indexing="ij"))
        onto = _tensor_lagrange(probes, box, counts)
        sampled = _slow(problem, base, fit, mesh)
        error = _relative(apply_along_rows(onto.T, sampled.T).T - exact, exact)
        if error <= problem.low_rank:
            break
    else:
        raise TooWide
    columns, mixing = _interpolative(sampled, problem.low_rank)
    if columns.size > _MAX_RANK:
        raise TooWide
    chosen = tuple(m[columns] for m in mesh)
    node = np.empty((count, columns.size), dtype=np.complex128)
    rows = max(1, _PAIRS_AT_ONCE // columns.size)
    for start in range(0, count, rows):
        part = slice(start, start + rows)
        node[part] = _slow(problem, base, part, chosen)
    apart = node[held] @ apply_along_rows(onto.T, mixing.T).T
    apart -= _slow(problem, base, held, probes)
    return SlowFactor(
        node=node,
        coefficients=mixing.reshape(columns.size, *counts),
        error=_relative(apart, exact),
    )


def _slow(
    problem: SumProblem,
    base: tuple[float, float, float],
    rows: Array | slice,
    targets: tuple[FloatArray, ...],
) -> ComplexArray:
    """iλ exp(i k (rest(q, P) − rest(centre, P))) · amplitude(q, P) between some nodes and some targets."""
    rest, spreading = _beyond_linear(problem, base, rows, targets)
    centre = np.zeros(1)
    away = _away(base, targets)
    # What is common to all nodes may vary fast; the callers apply it to the sums, as a phasor for each target.
    rest -= problem.kernel.beyond_linear(centre, centre, np.ones(1), base, *away)[0]
    rest *= problem.kernel.wavenumber
    return scaled_phasor(rest, spreading)


def _beyond_linear(
    problem: SumProblem, base: tuple[float, float, float], rows: Array | slice, targets: tuple[FloatArray, ...]
) -> tuple[Array, Array]:
    """`Kernel.beyond_linear` between some nodes and some targets."""
    nodes = problem.samples.nodes
    u, v = (nodes.x[rows] - nodes.centre[0])[:, None], (nodes.y[rows] - nodes.centre[1])[:, None]
    cosine = None if problem.samples.axial_cosine is None else problem.samples.axial_cosine[rows][:, None]
    return problem.kernel.beyond_linear(u, v, cosine, base, *_away(base, targets))


def _away(base: tuple[float, float, float], targets: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
    return tuple(c - b for c, b in zip(targets, base, strict=True))


def _refuse_wide(
    problem: SumProblem, base: tuple[float, float, float], rows: Array, box: tuple[FloatArray, ...]
) -> None:
    """Split at once where the slow phase at the corners of the box is plainly too large for a small factor."""
    corners = np.meshgrid(*(np.asarray([c.min(), c.max()]) for c in box), indexing="ij")
    rest, _ = _beyond_linear(problem, base, rows, tuple(c.ravel() for c in corners))
    if problem.kernel.wavenumber * np.ptp(rest, axis=0).max() > 2.5 * _DEGREES[-1]:
        raise TooWide


def _interpolative(matrix: ComplexArray, tolerance: float) -> tuple[Array, ComplexArray]:
    """Columns of a matrix, and the mixing that rebuilds all columns from them to a tolerance.

    Gram–Schmidt with column pivots, each direction orthogonalised twice. A threaded LAPACK factorisation of so small a
    matrix takes a millisecond alone and hundreds where cores are shared.
    """
    rest = matrix.T.copy()  # a row for each column of the matrix: sums along rows are faster
    plain = rest.view(np.float64)
    size = np.einsum("ji,ji->j", plain, plain)
    stop = tolerance**2 * size.max()
    columns: list[int] = []
    basis = np.empty((min(_MAX_RANK + 1, *matrix.shape), matrix.shape[0]), dtype=np.complex128)
    for rank, direction in enumerate(basis):
        pivot = int(np.argmax(size))
        if size[pivot] <= stop:
            break
        direction[:] = rest[pivot]
        direction -= np.einsum("r,ri->i", np.vecdot(basis[:rank], direction), basis[:rank])
        direction /= np.sqrt(np.vdot(direction, direction).real)
        rest -= np.multiply.outer(np.vecdot(direction, rest), direction)
        size = np.einsum("ji,ji->j", plain, plain)
        columns.append(pivot)
    weights = np.vecdot(basis[: len(columns), None], matrix.T)
    return np.asarray(columns), _back_substituted(weights[:, columns], weights)


def _back_substituted(triangle: ComplexArray, right: ComplexArray) -> ComplexArray:
    """Solution X of R X = B for an upper triangle R of a few rows."""
    solution = right.copy()
    for i in range(len(triangle) - 1, -1, -1):
        solution[i] -= np.einsum("j,jk->k", triangle[i, i + 1 :], solution[i + 1 :])
        solution[i] /= triangle[i, i]
    return solution


def _relative(difference: ComplexArray, to: ComplexArray) -> float:
    return float(np.abs(difference).max() / np.abs(to).max())


def _tensor_lagrange(
    points: tuple[FloatArray, ...], box: tuple[FloatArray, ...], counts: tuple[int, ...]
) -> FloatArray:
    """Interpolation from the tensor of Chebyshev points to scattered points, shape (tensor, points)."""
    a, b, c = (lagrange(p, n, over) for p, n, over in zip(points, counts, box, strict=True))
    return np.asarray(np.einsum("mi,mj,mk->ijkm", a, b, c).reshape(-1, points[0].size))


_DIRECT_PAIRS = 60_000  # below this many node–target pairs direct summation is faster
_THREAD_WORTH = 1_000_000  # terms × (nodes + targets) from which a second thread pays
_VALUES_AT_ONCE = 30_000  # complex values of a block that stays in the second-level cache
_SINGLE_FROM = 2e-5  # tolerance of a transform from which on 32-bit numbers add no more than a tenth to its error
_FEW_TARGETS = 100  # a factor of many terms costs as much as that many targets summed directly


@dataclass(frozen=True, kw_only=True)
class FastField:
    """Field on flat targets, and the effort.

    Attributes
    ----------
    field
        Complex field, shape (m,).
    rank
        Largest rank of the low-rank factor over the tiles; 0 where every tile was summed directly.
    tiles
        Number of parts into which the targets were split.
    low_rank_error
        Largest error of the factor on nodes and targets that it was not built from, relative to its size.
    doubt
        Squared error expected of the field up to a factor, shape (m,); of shape () for a single part. Parts that are
        summed directly have none, and others differ by orders of magnitude.
    """

    field: ComplexArray
    rank: int
    tiles: int
    low_rank_error: float
    doubt: FloatArray

    def doubts(self) -> FloatArray:
        """Doubt of every target, shape (m,)."""
        return np.broadcast_to(self.doubt, self.field.shape)


def fast_sum(
    samples: ApertureSamples,
    kernel: Kernel,
    targets: Targets,
    *,
    low_rank_tolerance: float,
    nufft_tolerance: float,
) -> FastField:
    """Field of every node at every target, to the tolerances given.

    Parameters
    ----------
    samples
        Field on the aperture.
    kernel
        `KirchhoffKernel` or `FresnelKernel`.
    targets
        Points or a grid.
    low_rank_tolerance, nufft_tolerance
        Tolerances relative to the largest field that the nodes would give in phase, in 1e-14 … 0.1.

    Returns
    -------
    FastField
        Field in the order of ``targets.coordinates()``.

    Raises
    ------
    OutOfRangeError
        The kernel needs directions that `samples` does not have.
    """
    check_cosine(samples, kernel)
    problem = SumProblem(samples=samples, kernel=kernel, low_rank=low_rank_tolerance, nufft=max(nufft_tolerance, 1e-14))
    if isinstance(targets, TargetGrid):
        return _grid_tiles(problem, targets)
    return _point_tiles(problem, *targets.coordinates())


def _grid_tiles(problem: SumProblem, grid: TargetGrid) -> FastField:
    """Sum over a grid, halved along its longer side until each part has a small factor."""
    try:
        return _grid(problem, grid)
    except TooWide:
        if grid.x_count * grid.y_count <= _FEW_TARGETS:
            return _direct(problem, *grid.coordinates())
        along_x = grid.x_count * grid.x_pitch >= grid.y_count * grid.y_pitch
        count = grid.x_count if along_x else grid.y_count
        cut = count // 2
        parts = [_grid_tiles(problem, _subgrid(grid, along_x, *ends)) for ends in ((0, cut), (cut, count))]
        columns = cut if along_x else grid.x_count
        shapes = [(-1, columns), (-1, count - cut if along_x else columns)]
        axis = 1 if along_x else 0
        field = np.concatenate(
            [part.field.reshape(shape) for part, shape in zip(parts, shapes, strict=True)], axis=axis
        )
        doubt = np.concatenate(
            [part.doubts().reshape(shape) for part, shape in zip(parts, shapes, strict=True)], axis=axis
        )
        return _merged(field.ravel(), doubt.ravel(), parts)


def _subgrid(grid: TargetGrid, along_x: bool, start: int, stop: int) -> TargetGrid:
    return TargetGrid(
        x_start=grid.x_start + (start * grid.x_pitch if along_x else 0.0),
        y_start=grid.y_start + (0.0 if along_x else start * grid.y_pitch),
        x_pitch=grid.x_pitch,
        y_pitch=grid.y_pitch,
        x_count=stop - start if along_x else grid.x_count,
        y_count=grid.y_count if along_x else stop - start,
        distance=grid.distance,
    )


def _point_tiles(problem: SumProblem, x: FloatArray, y: FloatArray, z: FloatArray) -> FastField:
    """Sum over points, halved at the median of their widest coordinate until each part has a small factor."""
    try:
        return _points(problem, x, y, z)
    except TooWide:
        if x.size <= _FEW_TARGETS:
            return _direct(problem, x, y, z)
        axes = (x, y, z)
        order = np.argsort(axes[int(np.argmax([np.ptp(c) for c in axes]))], kind="stable")
        halves = np.array_split(order, 2)
        parts = [_point_tiles(problem, x[h], y[h], z[h]) for h in halves]
        field, doubt = np.empty(x.size, dtype=np.complex128), np.empty(x.size)
        for half, part in zip(halves, parts, strict=True):
            field[half], doubt[half] = part.field, part.doubt
        return _merged(field, doubt, parts)


def _merged(field: ComplexArray, doubt: FloatArray, parts: list[FastField]) -> FastField:
    return FastField(
        field=field,
        rank=max(p.rank for p in parts),
        tiles=sum(p.tiles for p in parts),
        low_rank_error=max(p.low_rank_error for p in parts),
        doubt=doubt,
    )


def _direct(problem: SumProblem, x: FloatArray, y: FloatArray, z: FloatArray) -> FastField:
    field = direct_sum(problem.samples, problem.kernel, x, y, z)
    return FastField(field=field, rank=0, tiles=1, low_rank_error=0.0, doubt=np.zeros(()))


def _grid(problem: SumProblem, grid: TargetGrid) -> FastField:
    """Sum over one grid: NUFFT of type 1, from nodes to regular targets, on a pitch no finer than the field needs."""
    if grid.x_count * grid.y_count * problem.samples.nodes.count <= _DIRECT_PAIRS:
        return _direct(problem, *grid.coordinates())
    centre = problem.samples.nodes.centre
    x, y, z = grid.x_axis - centre[0], grid.y_axis - centre[1], np.asarray(grid.distance)
    middle = np.asarray(x[x.size // 2]), np.asarray(y[y.size // 2])
    columns, rows = _axis_plans(problem, grid, middle)
    coarse = TargetGrid(
        x_start=grid.x_start + (columns.first * grid.x_pitch if columns else 0.0),
        y_start=grid.y_start + (rows.first * grid.y_pitch if rows else 0.0),
        x_pitch=grid.x_pitch * (columns.step if columns else 1),
        y_pitch=grid.y_pitch * (rows.step if rows else 1),
        x_count=columns.count if columns else grid.x_count,
        y_count=rows.count if rows else grid.y_count,
        distance=grid.distance,
    )
    total, rank, error = _grid_without_common_phase(problem, coarse, middle)
    # The phasors along x come before the rows in between are interpolated, while there are fewer values.
    if columns:
        total = columns.apply(total.T).T
    along_x, along_y = _common_paths(problem.kernel, x, y, z, middle)
    total *= unit_phasor(problem.kernel.wavenumber * along_x)
    if rows:
        total = rows.apply(total)
    total *= unit_phasor(problem.kernel.wavenumber * along_y)[:, None]
    doubt = np.asarray(error**2 + problem.nufft**2)
    return FastField(field=total.ravel(), rank=rank, tiles=1, low_rank_error=error, doubt=doubt)


def _common_paths(
    kernel: Kernel, x: FloatArray, y: FloatArray, z: Array, middle: tuple[Array, Array]
) -> tuple[FloatArray, FloatArray]:
    """Path from the centre of the aperture along the middle row, and along the middle column minus that to the middle.

    The sum of both differs slowly from the path to a target, and needs one phasor for each row and column only.
    """
    return kernel.path(x, middle[1], z), kernel.path(middle[0], y, z) - kernel.path(*middle, z)


def _axis_plans(
    problem: SumProblem, grid: TargetGrid, middle: tuple[Array, Array]
) -> tuple[Upsampling | None, Upsampling | None]:
    """Oversampled axes along x and y for the field without the common paths."""
    kernel, centre = problem.kernel, problem.samples.nodes.centre
    u, v, _ = problem.samples.local()
    origin, z = np.zeros(1), grid.distance
    # The direction cosines from the nodes, minus the slopes of the common paths, at the corners of the grid bound the
    # band.
    widest = np.zeros(2)
    for x, y in product(grid.x_axis[[0, -1]] - centre[0], grid.y_axis[[0, -1]] - centre[1]):
        to = kernel.slope_at_target(u, v, x, y, z)
        common_x, _, _ = kernel.slope_at_target(origin, origin, x, float(middle[1]), z)
        _, common_y, _ = kernel.slope_at_target(origin, origin, float(middle[0]), y, z)
        widest = np.maximum(widest, [np.abs(to[0] - common_x).max(), np.abs(to[1] - common_y).max()])
    oversampling = np.pi / (kernel.wavenumber * np.asarray([grid.x_pitch, grid.y_pitch]) * widest)
    plans = [
        upsampling(fine_count=n, oversampling=float(o), tolerance=problem.nufft)
        for n, o in zip((grid.x_count, grid.y_count), oversampling, strict=True)
    ]
    return plans[0], plans[1]


def _grid_without_common_phase(
    problem: SumProblem, grid: TargetGrid, middle: tuple[Array, Array]
) -> tuple[ComplexArray, int, float]:
    """Field on a grid without the phase of the common paths, the rank, and the error of the factor."""
    centre = problem.samples.nodes.centre
    x, y = grid.x_axis - centre[0], grid.y_axis - centre[1]
    z = np.asarray([grid.distance])
    base = (float(x[x.size // 2]), float(y[y.size // 2]), grid.distance)  # finufft's mode 0
    factor = slow_factor(problem, base, (x, y, z))
    strength, (along_x, along_y) = _node_side(problem, base, factor)
    k = problem.kernel.wavenumber
    real, kind = (np.float32, np.complex64) if problem.nufft >= _SINGLE_FROM else (np.float64, np.complex128)
    sums = finufft.nufft2d1(
        (k * grid.y_pitch * along_y).astype(real),
        (k * grid.x_pitch * along_x).astype(real),
        strength.astype(kind),
        (y.size, x.size),
        eps=problem.nufft,
        isign=1,
        nthreads=_threads(strength, x.size * y.size),
    )
    on_x, on_y = (lagrange(c, factor.coefficients.shape[i + 1]) for i, c in enumerate((x, y)))
    total = np.zeros((y.size, x.size), dtype=np.complex128)
    for coefficients, term in zip(factor.coefficients[..., 0], sums.reshape(-1, y.size, x.size), strict=True):
        along = apply_along_rows(on_x, coefficients).T  # term by term: all together would leave the cache
        total += apply_along_rows(on_y, along) * term
    along_x, along_y = _common_paths(problem.kernel, x, y, z, middle)
    total *= unit_phasor(k * (problem.kernel.path(x, y[:, None], z) - along_x - along_y[:, None]))
    return total, strength.shape[0], factor.error


def _points(problem: SumProblem, x: FloatArray, y: FloatArray, z: FloatArray) -> FastField:
    """Sum over scattered points: NUFFT of type 3, from nodes to nonuniform targets."""
    if x.size * problem.samples.nodes.count <= _DIRECT_PAIRS:
        return _direct(problem, x, y, z)
    centre = problem.samples.nodes.centre
    x, y = x - centre[0], y - centre[1]
    base = (_middle(x), _middle(y), _middle(z))
    factor = slow_factor(problem, base, (x, y, z))
    strength, (along_x, along_y) = _node_side(problem, base, factor)
    k = problem.kernel.wavenumber
    sums = finufft.nufft2d3(
        k * along_x,
        k * along_y,
        strength,
        x - base[0],
        y - base[1],
        eps=problem.nufft,
        isign=1,
        nthreads=_threads(strength, x.size),
    ).reshape(strength.shape[0], -1)
    return FastField(
        field=_weighted(factor.coefficients, (x, y, z), sums) * unit_phasor(k * problem.kernel.path(x, y, z)),
        rank=strength.shape[0],
        tiles=1,
        low_rank_error=factor.error,
        doubt=np.asarray(factor.error**2 + problem.nufft**2),
    )


def _weighted(
    coefficients: ComplexArray, points: tuple[FloatArray, FloatArray, FloatArray], sums: ComplexArray
) -> ComplexArray:
    """Σ_t of the target's side of a factor, interpolated to points, times the transforms, shape (terms, points).

    In blocks that stay in the cache: for all points at once, the values between the axes would take gigabytes.
    """
    rank, *counts = coefficients.shape
    on_x, on_y, on_z = (lagrange(c, n) for c, n in zip(points, counts, strict=True))
    by_x = np.ascontiguousarray(np.moveaxis(coefficients, 1, 0).reshape(counts[0], -1))
    total = np.empty(sums.shape[1], dtype=np.complex128)
    size = max(1, _VALUES_AT_ONCE // by_x.shape[1])
    for start in range(0, total.size, size):
        part = slice(start, start + size)
        lines = apply_along_rows(on_x[part], by_x).reshape(-1, rank, counts[1] * counts[2])
        across = np.einsum("mb,mc->mbc", on_y[part], on_z[part]).reshape(-1, counts[1] * counts[2])
        slow = np.einsum("mtk,mk->tm", lines, across.astype(np.complex128))  # cast here once, not for every term
        total[part] = np.einsum("tm,tm->m", slow, sums[:, part])
    return total


def _node_side(
    problem: SumProblem, base: tuple[float, float, float], factor: SlowFactor
) -> tuple[ComplexArray, tuple[FloatArray, FloatArray]]:
    """Strengths of the nodes, one row per term, and their direction cosines minus those of the centre."""
    u, v, strength = problem.samples.local()
    kernel = problem.kernel
    to_base, _ = kernel.path_and_spreading(u, v, problem.samples.axial_cosine, *(np.asarray(c) for c in base))
    origin = np.zeros(1)
    along_x, along_y, _ = kernel.slope_at_target(u, v, *base)
    centre_x, centre_y, _ = kernel.slope_at_target(origin, origin, *base)
    carrier = -1j / kernel.wavelength * strength * unit_phasor(kernel.wavenumber * to_base)
    return np.ascontiguousarray(factor.node.T * carrier), (along_x - centre_x, along_y - centre_y)


def _threads(strength: ComplexArray, targets: int) -> int:
    """One thread for small transforms, where starting more costs more than they save; 0 lets finufft decide."""
    return 1 if strength.shape[0] * (strength.shape[1] + targets) < _THREAD_WORTH else 0


def _middle(values: FloatArray) -> float:
    return float(0.5 * (values.min() + values.max()))
