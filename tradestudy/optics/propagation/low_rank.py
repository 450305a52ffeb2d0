"""The slow part of a propagation kernel as a sum of few products of a function of the node and one of the target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.phasors import ComplexArray, scaled_phasor
from tradestudy.optics.propagation.direct import ApertureSamples
from tradestudy.optics.propagation.kernels import FresnelKernel, Kernel
from tradestudy.optics.propagation.paths import Array
from tradestudy.optics.propagation.upsampling import apply_along_rows, chebyshev_points, lagrange

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
        return _constant(problem, box)
    rng = np.random.default_rng(0)  # fixed: the same request gives the same digits
    shuffled = rng.permutation(count)
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


def _constant(problem: SumProblem, box: tuple[FloatArray, FloatArray, FloatArray]) -> SlowFactor:
    """Exact factor of Fresnel's law on a plane, 1/z: there, the nonlinear path is the same from every node."""
    return SlowFactor(
        node=np.ones((problem.samples.nodes.count, 1), dtype=np.complex128),
        coefficients=np.full((1, 1, 1, 1), 1 / box[2][0], dtype=np.complex128),
        error=0.0,
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
