"""Parameters drawn together: joint normal, Gaussian copula, and the draws of a posterior.

One rule decides what is singular. Eigenvalues of the correlation matrix of k parameters between −k·1e-9 (the rounding
of a file with nine digits) and k·2.2e-14 mean exact dependence: they are set to zero and take no random coordinate, so
that correlations of ±1 are exact. More negative ones, which no distribution has, are refused. All larger positive ones
are kept, because a direction with little variance can be the one that changes depth.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cache, cached_property
from math import factorial
from typing import Self

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import Distribution, Empirical, FloatArray, Normal, at_scores
from tradestudy.uncertainty.sources import ErrorClass
from tradestudy.uncertainty.streams import fixed_order_product

_ROUNDING_OF_EIGENVALUES = 100.0 * np.finfo(float).eps
_ROUNDING_OF_FILES = 1e-9
_HERMITE_NODES = 64


def _square(what: str, matrix: FloatArray, size: int) -> FloatArray:
    """Return a copy, after checking that the matrix is finite and symmetric."""
    copy = np.array(matrix, float)
    if copy.shape != (size, size) or not np.all(np.isfinite(copy)):
        raise OutOfRangeError(
            f"the {what} matrix of {size} parameters",
            value=f"shape {copy.shape}, {int(np.sum(~np.isfinite(copy)))} entries not finite",
            limit=f"{size} x {size} finite numbers",
            remedy="give one row and one column per parameter",
        )
    spread = np.sqrt(np.abs(np.diag(copy)))
    asymmetry = np.abs(copy - copy.T)
    allowed = 10.0 * _ROUNDING_OF_FILES * np.outer(spread, spread)
    if np.any(asymmetry > allowed):
        i, j = (int(index) for index in np.unravel_index(int(np.argmax(asymmetry - allowed)), copy.shape))
        raise OutOfRangeError(
            f"the {what} matrix is not symmetric",
            value=f"entries ({i}, {j}) {copy[i, j]:.10g} and ({j}, {i}) {copy[j, i]:.10g}",
            limit="equal to 1e-8 of the two standard deviations",
            remedy="write both halves of the matrix",
        )
    return np.asarray(0.5 * (copy + copy.T))


def correlation_factor(correlation: FloatArray) -> FloatArray:
    """Factor a correlation matrix: L with L Lᵀ = correlation and one column per independent direction.

    Parameters
    ----------
    correlation : array, shape (k, k)
        Symmetric, ones on its diagonal.

    Returns
    -------
    array, shape (k, rank)
        Columns in order of decreasing variance, since the first coordinates of a quasi-random sequence are its best.
        Eigenvalues that are zero up to rounding (see the rule of this module) have no column.

    Raises
    ------
    OutOfRangeError
        An eigenvalue is more negative than rounding explains: no distribution has these correlations.
    """
    size = correlation.shape[0]
    values, vectors = np.linalg.eigh(correlation)
    smallest = float(values[0])
    if smallest < -size * _ROUNDING_OF_FILES:
        direction = ", ".join(f"{component:+.3f}" for component in vectors[:, 0])
        raise OutOfRangeError(
            "the correlation matrix is not positive semidefinite",
            value=f"smallest eigenvalue {smallest:.3e} along ({direction})",
            limit=f">= {-size * _ROUNDING_OF_FILES:.1e}, the rounding of a file with nine digits",
            remedy="give more digits, omit a parameter that the others determine, or provide joint draws",
        )
    kept = values > size * _ROUNDING_OF_EIGENVALUES
    # The sign of an eigenvector is arbitrary; fixing it gives the same draws with every linear algebra library.
    largest = np.argmax(np.abs(vectors), axis=0)
    vectors = vectors * np.sign(vectors[largest, np.arange(size)])
    factor = vectors[:, kept] * np.sqrt(values[kept])
    # Rows of unit length keep the variances exact although directions were dropped.
    norms = np.sqrt(np.sum(factor * factor, axis=1, keepdims=True))
    return np.asarray((factor / norms)[:, ::-1])


def _correlation_of(covariance: FloatArray) -> FloatArray:
    """Correlation matrix of a covariance; a constant is uncorrelated with everything."""
    spread = np.sqrt(np.diag(covariance))
    safe = np.where(spread > 0.0, spread, 1.0)
    correlation = np.asarray(covariance / np.outer(safe, safe))
    np.fill_diagonal(correlation, 1.0)
    return correlation


def _require_names(names: tuple[str, ...], size: int) -> None:
    if len(names) != size or len(set(names)) != size:
        raise OutOfRangeError(
            "the names of jointly distributed parameters",
            value=f"{len(names)} names for {size} parameters: {', '.join(names)}",
            limit="a distinct name for each parameter",
            remedy="name every parameter once",
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Joint:
    """What all jointly drawn parameters have: names, and how often they are redrawn."""

    name: str
    parameters: tuple[str, ...]
    error_class: ErrorClass

    @cached_property
    def _content(self) -> tuple[object, ...]:
        values = (getattr(self, member.name) for member in fields(self) if member.init)
        return tuple((value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value for value in values)

    def __eq__(self, other: object) -> bool:
        """Whether both are of one kind with equal numbers, so that equal cameras of two designs are recognised."""
        return isinstance(other, type(self)) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    def under(self, prefix: str) -> Self:
        """Return the same group, with a prefix before its name and the names of its parameters."""
        return replace(self, name=prefix + self.name, parameters=tuple(prefix + name for name in self.parameters))


@dataclass(frozen=True, kw_only=True, eq=False)
class JointNormal(_Joint):
    """Joint normal distribution with a full covariance, which may be singular.

    Parameters
    ----------
    name : str
        Name of the group.
    parameters : tuple of str, length k
        Names of the parameters.
    mean : array, shape (k,)
        Means, each in the unit of its parameter.
    covariance : array, shape (k, k)
        Covariance [product of the units]. A zero on the diagonal means a constant.
    error_class : ErrorClass
        How often the group is redrawn.

    Raises
    ------
    OutOfRangeError
        Shapes do not match, a value is not finite, a variance is negative, or the matrix is not symmetric or not
        positive semidefinite within rounding (see the rule of this module).
    """

    mean: FloatArray
    covariance: FloatArray
    _factor: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        mean = np.array(self.mean, float)
        _require_names(self.parameters, mean.size)
        covariance = _square("covariance", self.covariance, mean.size)
        variance = np.diag(covariance)
        spread = np.sqrt(np.maximum(variance, 0.0))
        constant = variance == 0.0
        if np.any(variance < 0.0) or np.any(covariance[constant] != 0.0) or not np.all(np.isfinite(mean)):
            raise OutOfRangeError(
                "means and variances of a joint normal distribution",
                value=f"means {mean}, variances {variance}",
                limit="finite means, variances >= 0, no covariance with a constant",
                remedy="correct the diagonal of the covariance",
            )
        correlation = _correlation_of(covariance)
        factor = np.zeros((mean.size, 0))
        if not np.all(constant):
            moving = np.flatnonzero(~constant)
            inner = correlation_factor(correlation[np.ix_(moving, moving)])
            factor = np.zeros((mean.size, inner.shape[1]))
            factor[moving] = inner * spread[moving, None]
        for key, value in (("mean", mean), ("covariance", covariance), ("_factor", factor)):
            value.setflags(write=False)
            object.__setattr__(self, key, value)

    @property
    def dimensions(self) -> int:
        """Number of independent directions."""
        return int(self._factor.shape[1])

    @property
    def nominal(self) -> FloatArray:
        """The means."""
        return self.mean

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix."""
        return _correlation_of(self.covariance)

    def draw(self, scores: FloatArray) -> FloatArray:
        """Map standard normal scores (dimensions, n) to draws (k, n)."""
        return np.asarray(self.mean[:, None] + fixed_order_product(self._factor, scores))

    def marginal(self, index: int) -> Distribution:
        """Return the normal distribution of one parameter alone."""
        variance = float(self.covariance[index, index])
        return Normal(mean=float(self.mean[index]), standard_deviation=float(np.sqrt(variance)))


def _correlation_matrix(correlation: FloatArray, size: int) -> FloatArray:
    matrix = _square("correlation", correlation, size)
    if np.any(np.abs(np.diag(matrix) - 1.0) > 10.0 * _ROUNDING_OF_FILES) or np.any(
        np.abs(matrix) > 1.0 + 10.0 * _ROUNDING_OF_FILES
    ):
        raise OutOfRangeError(
            "the correlation matrix",
            value=f"diagonal {np.diag(matrix)}, largest magnitude {np.max(np.abs(matrix)):.10g}",
            limit="ones on the diagonal, -1 to 1 elsewhere",
            remedy="give a covariance instead, or divide by the standard deviations",
        )
    return matrix


@dataclass(frozen=True, kw_only=True, eq=False)
class GaussianCopula(_Joint):
    """Any marginal distributions, coupled by a Gaussian copula: x_i = Q_i(Φ(z_i)), z jointly normal.

    Parameters
    ----------
    name : str
        Name of the group.
    parameters : tuple of str, length k
        Names of the parameters.
    marginals : tuple of Distribution, length k
        Distribution of each parameter.
    correlation : array, shape (k, k)
        Correlation of the normal scores z. A rank correlation ρ_S corresponds to 2 sin(π ρ_S/6); the
        correlation of the parameters themselves is slightly smaller in magnitude.
    error_class : ErrorClass
        How often the group is redrawn.

    Raises
    ------
    OutOfRangeError
        As for :class:`JointNormal`.
    """

    marginals: tuple[Distribution, ...]
    correlation: FloatArray
    _factor: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        _require_names(self.parameters, len(self.marginals))
        matrix = _correlation_matrix(self.correlation, len(self.marginals))
        matrix.setflags(write=False)
        object.__setattr__(self, "correlation", matrix)
        object.__setattr__(self, "_factor", correlation_factor(matrix))

    @property
    def dimensions(self) -> int:
        """Number of independent directions."""
        return int(self._factor.shape[1])

    @property
    def nominal(self) -> FloatArray:
        """Mean of each parameter, or its median if it has no mean."""
        return np.array([float(m.quantile(0.5)) if m.mean is None else m.mean for m in self.marginals])

    @cached_property
    def covariance(self) -> FloatArray | None:
        """Covariance of the parameters by Mehler's expansion in Hermite polynomials; None if a variance does not exist.

        The diagonal is exact, and the matrix is positive semidefinite. Off-diagonal entries are exact for normal and
        uniform marginals, and accurate to about 1e-4 of the two standard deviations for others.
        """
        deviations = [marginal.standard_deviation for marginal in self.marginals]
        if any(deviation is None for deviation in deviations):
            return None
        coefficients = np.stack([_hermite_coefficients(marginal) for marginal in self.marginals])
        powers = np.clip(self.correlation, -1.0, 1.0)[..., None] ** np.arange(1, coefficients.shape[1] + 1)
        spread = np.array(deviations, float)
        tied = np.einsum("ik,jk,ijk->ij", coefficients, coefficients, powers)
        covariance = np.asarray(tied * np.outer(spread, spread))
        covariance.setflags(write=False)  # the cached property shares it
        return covariance

    def draw(self, scores: FloatArray) -> FloatArray:
        """Map standard normal scores (dimensions, n) to draws (k, n)."""
        tied = fixed_order_product(self._factor, scores)
        return np.stack([at_scores(marginal, row) for marginal, row in zip(self.marginals, tied, strict=True)])

    def marginal(self, index: int) -> Distribution:
        """Return the distribution of one parameter alone."""
        return self.marginals[index]


@cache
def _hermite_rule() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nodes and weights of a Gauss–Hermite rule, and the orthonormal polynomials at the nodes (nodes, orders)."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(_HERMITE_NODES)
    norm = np.sqrt([float(factorial(order)) for order in range(_HERMITE_NODES)])
    return nodes, weights, np.polynomial.hermite_e.hermevander(nodes, _HERMITE_NODES - 1) / norm


def _hermite_coefficients(marginal: Distribution) -> FloatArray:
    """Coefficients of Q(Φ(z)) in orthonormal Hermite polynomials from the first degree on, scaled to unit length."""
    nodes, weights, polynomials = _hermite_rule()
    coefficients = (weights * at_scores(marginal, nodes) @ polynomials)[1:]
    length = float(np.linalg.norm(coefficients))
    return np.asarray(coefficients / length if marginal.standard_deviation else np.zeros(coefficients.size))


@dataclass(frozen=True, kw_only=True, eq=False)
class JointDraws(_Joint):
    """Equally weighted joint draws, as from a posterior sampler; one draw is one whole row.

    Rows are sorted into groups along one direction and, within each group, along a second, so that even a short
    quasi-random sequence covers both directions evenly. From n rows, n draws take each row once.

    Parameters
    ----------
    name : str
        Name of the group.
    parameters : tuple of str, length k
        Names of the parameters.
    draws : array, shape (n, k)
        Finite joint draws, each in the unit of its parameter; n >= 2.
    error_class : ErrorClass
        How often the group is redrawn.
    along : array, shape (2, k), optional
        Responses of two outputs to each parameter, along which rows are ordered; default: the first two principal
        components of the rows.

    Raises
    ------
    OutOfRangeError
        Shapes do not match, fewer than two rows, or a value is not finite.
    """

    draws: FloatArray
    along: FloatArray | None = None
    _ordered: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        draws = np.array(self.draws, float)
        if draws.ndim != 2 or draws.shape[0] < 2 or not np.all(np.isfinite(draws)):
            bad = int(np.sum(~np.all(np.isfinite(np.atleast_2d(draws)), axis=-1)))
            raise OutOfRangeError(
                "joint draws",
                value=f"shape {draws.shape}, {bad} rows not finite",
                limit="at least two rows of finite values, one column per parameter",
                remedy="remove draws that are not finite, if any, and note this in the study",
            )
        _require_names(self.parameters, draws.shape[1])
        first, second = _along_principal(draws) if self.along is None else (draws @ self.along.T).T
        stretches = np.array_split(np.argsort(first, kind="stable"), max(1, round(len(draws) ** 0.5)))
        order = np.concatenate([rows[np.argsort(second[rows], kind="stable")] for rows in stretches])
        ordered = np.ascontiguousarray(draws[order].T)
        for key, value in (("draws", draws), ("_ordered", ordered)):
            value.setflags(write=False)
            object.__setattr__(self, key, value)

    @property
    def dimensions(self) -> int:
        """Two: the group of rows, and the row within it."""
        return 2

    @property
    def nominal(self) -> FloatArray:
        """Means of the draws."""
        return np.asarray(np.mean(self.draws, axis=0))

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the draws as a complete distribution (divisor n)."""
        return np.atleast_2d(np.cov(self.draws, rowvar=False, bias=True))

    @property
    def correlation(self) -> FloatArray:
        """Correlation of the draws."""
        return _correlation_of(self.covariance)

    def draw(self, scores: FloatArray) -> FloatArray:
        """Map standard normal scores (2, n) to draws (k, n)."""
        from scipy.special import ndtr  # imported here, so that checking a study does not load it

        rows = self._ordered.shape[1]
        ends = np.cumsum([0, *map(len, np.array_split(np.arange(rows), max(1, round(rows**0.5))))])
        place = np.minimum((ndtr(scores[0]) * rows).astype(np.int64), rows - 1)
        stretch = np.searchsorted(ends, place, side="right") - 1
        size = ends[stretch + 1] - ends[stretch]
        within = np.minimum((ndtr(scores[1]) * size).astype(np.int64), size - 1)
        return np.asarray(self._ordered[:, ends[stretch] + within])

    def marginal(self, index: int) -> Distribution:
        """Return the draws of one parameter alone."""
        return Empirical(draws=self.draws[:, index])


def _along_principal(draws: FloatArray) -> FloatArray:
    """Coordinates of rows along the first two principal components of the standardised parameters, (2, rows)."""
    scale = np.std(draws, axis=0)
    standard = (draws - np.mean(draws, axis=0)) / np.where(scale > 0.0, scale, 1.0)
    components = np.linalg.svd(standard, full_matrices=False)[2]
    return np.asarray(components[[0, min(1, len(components) - 1)]] @ standard.T)
