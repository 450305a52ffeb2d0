"""Which error sources dominate a result: tornado and Sobol indices of independent groups of sources."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import Final

import numpy as np
from scipy.special import ndtri, stdtrit

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.evaluation import Model, Replicate, alignment_with, ranked
from tradestudy.uncertainty.joint import correlation_factor
from tradestudy.uncertainty.outputs import RunningMean, ranked_quantiles
from tradestudy.uncertainty.sources import Group, Source, Sources
from tradestudy.uncertainty.streams import BATCH_DRAWS, point_generator, scrambled_sobol
from tradestudy.wording import in_words

MOST_PARTS: Final = 12
"""The explained variance is computed for every subset of the parts; 2¹² subsets take half a second."""

# Directions of a subset that are shorter than this fraction of one standard deviation depend on the others. Rounding
# leaves 1e-9; the shortest that `correlation_factor` keeps is 1.5e-7.
_NO_DIRECTION = 1e-8
# Errors cancel exactly if only this fraction of their sum remains, which is its rounding.
_CANCELLED = 1e-14


def shapley_shares(sensitivity: FloatArray, covariance: FloatArray, parts: Sequence[Sequence[int]]) -> FloatArray:
    """Share of the variance of each output that is due to each part; shares sum to 1 even if parts are correlated.

    The worth of a part is what it adds to the explained variance Var(E[w | X_S]), averaged over all orders in which the
    parts can become known. For independent parts, this is their share of the sum of variances.

    Parameters
    ----------
    sensitivity : array, shape (parameters, outputs)
        Derivative of each output with respect to each parameter [unit of the output per unit of the parameter].
    covariance : array, shape (parameters, parameters)
        Covariance of the parameters, taken as jointly normal; it may be singular, with zeros on the diagonal.
    parts : sequence of sequences of int
        The rows that belong to each part; each row belongs to exactly one part. At most 12 parts.

    Returns
    -------
    array, shape (parts, outputs)
        From 0 to 1; NaN where the output has no variance or its sensitivity is not finite.

    Raises
    ------
    OutOfRangeError
        There are too many parts, a parameter belongs to none or to two of them, or no distribution has the covariance.

    Notes
    -----
    E. Song, B. L. Nelson and J. Staum, "Shapley effects for global sensitivity analysis: theory and computation", 2016;
    A. B. Owen and C. Prieur, "On Shapley value for measuring importance of dependent inputs", 2017.
    """
    if len(parts) > MOST_PARTS:
        raise OutOfRangeError(
            "number of parts among which a variance is divided",
            value=str(len(parts)),
            limit=f"at most {MOST_PARTS}",
            remedy="combine parts that belong together",
        )
    rows = sorted(row for part in parts for row in part)
    if rows != list(range(len(sensitivity))):
        raise OutOfRangeError(
            "assignment of parameters to the parts of a variance",
            value=f"rows {rows}",
            limit=f"each of the {len(sensitivity)} once",
            remedy="assign every parameter to exactly one part",
        )
    deviation = np.sqrt(np.diag(covariance))
    scaled = np.where(np.isfinite(sensitivity), sensitivity, np.nan) * deviation[:, None]
    factor = _factor(covariance, deviation)
    explained = _explained(factor, factor.T @ scaled, parts)
    total = explained[-1]
    varies = total > (_CANCELLED * np.sum(np.abs(scaled), axis=0)) ** 2
    subsets = np.arange(len(explained))
    size = np.bitwise_count(subsets)
    weight = np.array([1.0 / (len(parts) * comb(len(parts) - 1, k)) for k in range(len(parts))])
    shares = np.full((len(parts), sensitivity.shape[1]), np.nan)
    for part, share in enumerate(shares):
        without = subsets[subsets & (1 << part) == 0]
        gained = explained[without | (1 << part)] - explained[without]
        np.divide(weight[size[without]] @ gained, total, out=share, where=varies)
    return shares


def _factor(covariance: FloatArray, deviation: FloatArray) -> FloatArray:
    """Standardised parameters as rows, with independent directions as columns; a constant is a row of zeros."""
    moving = np.flatnonzero(deviation > 0.0)
    if moving.size == 0:
        return np.zeros((deviation.size, 0))
    scale = deviation[moving]
    inner = correlation_factor(covariance[np.ix_(moving, moving)] / np.outer(scale, scale))
    factor = np.zeros((deviation.size, inner.shape[1]))
    factor[moving] = inner
    return factor


def _explained(factor: FloatArray, response: FloatArray, parts: Sequence[Sequence[int]]) -> FloatArray:
    """Var(E[w | X_S]) of every subset S of the parts, indexed by its bit mask, shape (2**parts, outputs).

    Knowing X_S means knowing the directions that its rows span, so the explained variance is the squared length of the
    projection of the response onto them.
    """
    explained = np.zeros((1 << len(parts), response.shape[1]))
    for subset in range(1, len(explained)):
        rows = [row for part, members in enumerate(parts) if subset >> part & 1 for row in members]
        _, length, directions = np.linalg.svd(factor[rows], full_matrices=False)
        explained[subset] = np.sum(np.square(directions[length > _NO_DIRECTION] @ response), axis=0)
    return explained


_REPLICATES: Final = 8  # with fewer independent scrambles, the standard error would be unreliable
_FIRST_DRAWS: Final = 2**9  # of each replicate
_MOST_DRAWS: Final = 2**14  # of all replicates
_TOLERANCE: Final = 0.01  # readers need bars to two digits
_CONFIDENCE: Final = 0.975
_ENDS: Final = np.array([0.15865525393145707, 0.8413447460685429])  # Φ(−1) and Φ(1)

LARGEST_CORRELATION = 0.3
"""For more strongly correlated parameters, varying one alone describes cameras that the calibration rules out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tornado:
    """Half widths of the outputs' central 68.27 % intervals, each with the sources of one bar drawn and others nominal.

    ``half_width`` and its standard error ``half_width_error`` have shape (bars, outputs), with bars in the order of the
    sources, and the unit of the output. A half width is infinite where the far end of the interval is, and NaN where no
    draw has an output.
    """

    names: tuple[str, ...]
    half_width: FloatArray
    half_width_error: FloatArray


def tornado(
    model: Model, sources: Sources, *, seed: int, point: str, inverse_depth: bool, batch_draws: int = BATCH_DRAWS
) -> Tornado:
    """Vary each independent group alone, with its correlated parameters together; others stay nominal.

    No bar contains interactions between groups; the total Sobol index does. The draws of a bar are doubled until each
    of its half widths is known to within 1 % at 95 % confidence, or to 2¹⁴ draws.

    Parameters
    ----------
    model : Model
        Vectorised model of the outputs.
    sources : Sources
        Independent groups.
    seed, point
        Identity of the random streams.
    inverse_depth : bool
        Whether the model returns inverse depth w [1/m]; the outputs are then depths, and w <= 0 is +∞.
    batch_draws : int
        Draws per call of the model, a power of two; affects memory and speed, but not results.

    Raises
    ------
    OutOfRangeError
        The model returns an array of the wrong shape, or the seed is negative.
    """
    names = tuple(group.name for group in sources.active_groups)
    bars = [
        _half_width(
            model,
            sources.only([name]),
            seed=seed,
            point=f"{point}/{name}",
            inverse_depth=inverse_depth,
            batch_draws=batch_draws,
        )
        for name in names
    ]
    return Tornado(
        names=names,
        half_width=np.stack([bar.mean for bar in bars]),
        half_width_error=np.stack([bar.standard_error for bar in bars]),
    )


def _half_width(
    model: Model, sources: Sources, *, seed: int, point: str, inverse_depth: bool, batch_draws: int
) -> RunningMean:
    """Half widths of the outputs over replicates, which double in length until their mean is known well enough."""
    alignment = alignment_with([model], sources)
    replicates = [
        Replicate(
            model, sources, seed=seed, point=point, replicate=number,
            alignment=alignment, inverse_depth=inverse_depth,
        )
        for number in range(_REPLICATES)
    ]  # fmt: skip
    draws = _FIRST_DRAWS
    while True:
        half_width = RunningMean()
        for replicate in replicates:
            replicate.lengthen(draws, batch_draws)
            near, far = ranked_quantiles(np.sort(replicate.values, axis=-1), _ENDS)
            # Where the far end is infinite, whatever the near one is.
            half_width.add(np.where(np.isinf(far), np.inf, 0.5 * (far - np.where(np.isinf(near), 0.0, near))))
        allowed = _TOLERANCE * np.where(np.isinf(half_width.mean), 0.0, half_width.mean)
        precise = float(stdtrit(_REPLICATES - 1, _CONFIDENCE)) * half_width.standard_error <= allowed
        if np.all(precise | np.isnan(half_width.mean)) or 2 * draws * _REPLICATES > _MOST_DRAWS:
            return half_width
        draws *= 2


def parameter_tornado(
    model: Model, sources: Sources, *, seed: int, point: str, inverse_depth: bool, batch_draws: int = BATCH_DRAWS
) -> Tornado:
    """Vary each parameter alone over its own marginal distribution; parameters are those of `tornado`.

    Raises
    ------
    OutOfRangeError
        Two parameters are correlated by more than 0.3, so that moving one alone would describe rigs that the
        calibration rules out. (With a correlation of 0.996, a stereo yaw and principal point would inflate depth errors
        31-fold.)
    """
    for group in sources.active_groups:
        _require_weak_correlation(group)
    alone = Sources(
        groups=tuple(
            Source(name=name, distribution=group.marginal(index), error_class=group.error_class)
            for group in sources.active_groups
            for index, name in enumerate(group.parameters)
        )
    )
    # `alone` has no inactive groups, but the model needs all parameters.
    held = {name: value for name, value in sources.nominal().items() if name not in alone.parameters}
    return tornado(
        lambda values: model({**held, **values}),
        alone,
        seed=seed,
        point=point,
        inverse_depth=inverse_depth,
        batch_draws=batch_draws,
    )


def _require_weak_correlation(group: Group) -> None:
    if len(group.parameters) == 1:
        return
    correlation = group.correlation - np.eye(len(group.parameters))
    i, j = np.unravel_index(int(np.argmax(np.abs(correlation))), correlation.shape)
    if abs(correlation[i, j]) > LARGEST_CORRELATION:
        first, second = (in_words(group.parameters[k]) for k in (i, j))
        raise OutOfRangeError(
            "parameters are too strongly correlated for separate bars",
            value=f"{correlation[i, j]:+.3f} between {first} and {second}",
            limit=f"at most {LARGEST_CORRELATION} in magnitude",
            remedy="use the bar of the whole group, which moves them together",
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class SobolIndices:
    """First-order and total Sobol indices, shape (groups, outputs), with standard errors over replicates.

    For each output, ``refused`` gives the reason if its indices are NaN; otherwise it is empty.
    """

    names: tuple[str, ...]
    first: FloatArray
    first_error: FloatArray
    total: FloatArray
    total_error: FloatArray
    refused: tuple[str, ...]
    evaluations: int


def sobol_indices(
    model: Model, sources: Sources, *, draws: int, seed: int, point: str, batch_draws: int = BATCH_DRAWS
) -> SobolIndices:
    """Shares of the variance of each output due to each independent group, alone and with its interactions.

    A group of correlated parameters is one input: its share is meaningful, but the shares of its members are not.

    Parameters
    ----------
    model : Model
        Vectorised model. For depth, let it return inverse depth, which is finite where depth is infinite, and has a
        variance where depth has none.
    sources : Sources
        Independent groups.
    draws : int
        Base draws of each of 8 replicates, a power of two; the model is evaluated (groups + 2) times as often.
    seed, point
        Identity of the random streams.
    batch_draws : int
        Draws per call of the model, a power of two; affects memory and speed, but not results.

    Returns
    -------
    SobolIndices
        NaN, with a reason, for outputs with draws that are not finite, and for outputs that do not vary.

    Raises
    ------
    OutOfRangeError
        ``draws`` is not a power of two, no group is uncertain, or a source has no variance.

    Notes
    -----
    Estimator of Saltelli et al. (2010) in ``scipy.stats.sobol_indices``. Outputs are checked first, because scipy
    returns zeros instead of an error if a single output is NaN.
    """
    names = tuple(group.name for group in sources.active_groups if group.dimensions > 0)
    if draws < 2 or draws & (draws - 1):
        raise OutOfRangeError(
            "number of base draws of Sobol indices",
            value=str(draws),
            limit="a power of two",
            remedy="use a power of two, for which Sobol points are balanced",
        )
    if not names:
        raise OutOfRangeError(
            "Sobol indices without an uncertain source",
            value="no active group",
            limit="at least one group with a spread",
            remedy="declare an uncertainty",
        )
    if sources.covariance() is None:
        raise OutOfRangeError(
            "Sobol indices need sources with a variance",
            value="a source has none",
            limit="sources with a finite variance",
            remedy="use the tornado, whose quantiles exist",
        )
    first, total = RunningMean(), RunningMean()
    lost: dict[int, str] = {}
    for replicate in range(_REPLICATES):
        matrices = _saltelli_outputs(
            model, sources, names, draws=draws, seed=seed, point=point, replicate=replicate, batch_draws=batch_draws
        )
        _record_undefined(matrices, lost)
        indices = _indices(matrices)
        first.add(indices[0])
        total.add(indices[1])
    keep = np.array([column not in lost for column in range(first.mean.shape[1])])
    return SobolIndices(
        names=names,
        first=np.where(keep, first.mean, np.nan),
        first_error=np.where(keep, first.standard_error, np.nan),
        total=np.where(keep, total.mean, np.nan),
        total_error=np.where(keep, total.standard_error, np.nan),
        refused=tuple(lost.get(column, "") for column in range(keep.size)),
        evaluations=(len(names) + 2) * draws * _REPLICATES,
    )


def _saltelli_outputs(
    model: Model,
    sources: Sources,
    names: tuple[str, ...],
    *,
    draws: int,
    seed: int,
    point: str,
    replicate: int,
    batch_draws: int,
) -> FloatArray:
    """Outputs of the matrices A, B and A with each group from B, shape (2 + groups, outputs, draws)."""
    size, coordinates = sources.dimensions, sources.coordinates()
    rng = point_generator(seed=seed, point=point, replicate=replicate)
    # One sequence of twice the dimensions, so that A and B are evenly distributed also as pairs.
    stream = scrambled_sobol(2 * size, rng)
    blocks = []
    for start in range(0, draws, batch_draws):
        count = min(batch_draws, draws - start)
        scores = ndtri(stream(count))
        base, redrawn = scores[:size], scores[size:]
        designs = [base, redrawn]
        for name in names:
            mixed = base.copy()
            mixed[coordinates[name]] = redrawn[coordinates[name]]
            designs.append(mixed)
        blocks.append(
            np.stack([ranked(model(sources.draw(design)), inverse_depth=False, draws=count) for design in designs])
        )
    return np.concatenate(blocks, axis=-1)


def _record_undefined(matrices: FloatArray, lost: dict[int, str]) -> None:
    """Record the outputs that have no meaningful indices, with the reason."""
    unranked = np.sum(~np.isfinite(matrices), axis=(0, 2))
    for column in np.flatnonzero(unranked):
        share = unranked[column] / (matrices.shape[0] * matrices.shape[2])
        lost[int(column)] = f"{share:.2g} of the draws are not finite; analyse inverse depth"
    constant = np.ptp(np.where(np.isfinite(matrices), matrices, 0.0), axis=(0, 2)) == 0.0
    for column in np.flatnonzero(constant & (unranked == 0)):
        lost.setdefault(int(column), "the output does not vary, so there is no variance to divide")


def _indices(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First and total indices, each (groups, outputs), of one replicate."""
    from scipy.stats import sobol_indices as saltelli  # takes a second to import; only this analysis needs it

    finite = np.where(np.isfinite(matrices), matrices, 0.0)
    designs, outputs, draws = finite.shape
    if designs == 3:  # scipy does not support a single input: pass it twice and keep one
        first, total = _indices(finite[[0, 1, 2, 2]])
        return first[:1], total[:1]
    # One output at a time, because scipy centres all outputs on a common mean, which costs digits if sizes differ.
    pairs = [
        saltelli(func={"f_A": finite[0, [k]], "f_B": finite[1, [k]], "f_AB": finite[2:, [k]]}, n=draws)
        for k in range(outputs)
    ]
    first = np.stack([np.reshape(pair.first_order, designs - 2) for pair in pairs], axis=1)
    total = np.stack([np.reshape(pair.total_order, designs - 2) for pair in pairs], axis=1)
    return first, total
