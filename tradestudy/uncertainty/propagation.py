"""Propagation of errors to first order, and by draws."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.evaluation import (
    CAUSES,
    Model,
    Replicate,
    alignment_with,
    ranked,
)
from tradestudy.uncertainty.outputs import (
    POLE_MARGIN,
    TAIL_SHAPE_LIMIT,
    Propagated,
    ReplicateStatistics,
    RunningMean,
    RunningStatistics,
    replicate_statistics,
)
from tradestudy.uncertainty.sources import Sources

# Step of central differences in standard deviations: far above the rounding of the model, with a truncation error of a
# millionth of the third-order term.
_STEP = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Linear:
    """First-order estimate of each output; outputs are the last axis.

    ``estimate`` and ``standard_uncertainty`` are in the unit of the output; NaN where the model fails at a point of the
    difference quotient. ``sensitivity`` has shape (parameters, outputs).
    """

    estimate: FloatArray
    standard_uncertainty: FloatArray
    sensitivity: FloatArray


def linear(model: Model, sources: Sources) -> Linear:
    """Law of propagation of uncertainty, u² = cᵀ V c, with the sensitivities c by central differences.

    Parameters
    ----------
    model : Model
        Vectorised model; it is evaluated at 2 n + 1 points for n uncertain parameters (17 for eight).
    sources : Sources
        The uncertain sources; their full covariance V is used.

    Raises
    ------
    OutOfRangeError
        A source has no variance.

    Notes
    -----
    JCGM 100:2008, eq. 13.
    """
    covariance = sources.covariance()
    if covariance is None:
        raise OutOfRangeError(
            "linear propagation needs standard deviations",
            value=f"none for {', '.join(group.name for group in sources.active_groups if group.covariance is None)}",
            limit="sources with a finite variance",
            remedy="use Monte Carlo, whose quantiles exist",
        )
    deviation = np.sqrt(np.diag(covariance))
    uncertain = np.flatnonzero(deviation > 0.0)
    steps = np.zeros((uncertain.size, deviation.size))
    steps[np.arange(uncertain.size), uncertain] = _STEP * deviation[uncertain]
    offsets = np.concatenate([np.zeros((1, deviation.size)), steps, -steps])
    nominal = sources.nominal()
    parameters = {name: nominal[name] + offsets[:, [k]] for k, name in enumerate(sources.parameters)}
    values = ranked(model(parameters), inverse_depth=False, draws=offsets.shape[0])[0].T
    above, below = values[1 : 1 + uncertain.size], values[1 + uncertain.size :]
    sensitivity = np.zeros((deviation.size, values.shape[1]))
    sensitivity[uncertain] = (above - below) / (2.0 * _STEP * deviation[uncertain, None])
    variance = np.einsum("ko,kl,lo->o", sensitivity, covariance, sensitivity)
    # With a correlation of ±1, rounding can make the variance slightly negative.
    uncertainty = np.sqrt(np.maximum(variance, 0.0))
    return Linear(estimate=values[0], standard_uncertainty=uncertainty, sensitivity=sensitivity)


FEWEST_REPLICATES = 8
"""With fewer independent scrambles, the standard error would be unreliable."""

# The bias of a sample quantile of n draws is at most about 2.6/√n of its standard error (for the 97.5 % quantile of a
# normal distribution from independent draws; far less with Sobol points). In the mean of R such quantiles, the bias is
# below two thirds of the standard error of the mean if R <= n/16.
_DRAWS_PER_REPLICATE_NUMBER = 16

# Bytes per stored number: the number itself, its copy while a replicate is extended, and the sorted copies.
_BYTES_PER_DRAW = 4 * 8


@dataclass(frozen=True, kw_only=True)
class Sampling:
    """The number of draws, and the criteria for stopping.

    Parameters
    ----------
    absolute_tolerance : float or array, shape (outputs,)
        Allowed error of each quantile [unit of the output].
    relative_tolerance : float
        Allowed error relative to the magnitude of the quantile, added to the absolute one.
    budget_draws : int
        Largest number of draws over all replicates. If both tolerances are zero, the whole budget is used.
    replicates : int
        Independent scrambles, >= 8.
    first_draws : int
        Draws per replicate before the first convergence check, a power of two >= 64.
    batch_draws : int
        Draws per call of the model, a power of two; affects memory and speed, but not results. The arrays of one call
        come on top of ``memory_bytes``.
    memory_bytes : int
        Limit on the memory for stored draws. Replicates are not extended beyond it. Instead, more replicates of the
        same length are added, whose quantiles remain exact, until their bias could matter (status ``memory``).

    Raises
    ------
    OutOfRangeError
        A number is outside its range, or is not a power of two where one is needed.
    """

    absolute_tolerance: ArrayLike
    relative_tolerance: float
    budget_draws: int
    replicates: int = FEWEST_REPLICATES
    first_draws: int = 2**9
    batch_draws: int = 2**14
    memory_bytes: int = 2**29

    def __post_init__(self) -> None:
        for name, number, least in (
            ("first_draws", self.first_draws, 64),
            ("batch_draws", self.batch_draws, 1),
        ):
            if number < least or number & (number - 1):
                raise OutOfRangeError(
                    f"{name} of a Sobol sequence",
                    value=str(number),
                    limit=f"a power of two >= {least}",
                    remedy="use a power of two, for which Sobol points are balanced",
                )
        if self.replicates < FEWEST_REPLICATES:
            raise OutOfRangeError(
                "replicates",
                value=str(self.replicates),
                limit=f">= {FEWEST_REPLICATES}",
                remedy="use more replicates, whose scatter gives the standard error",
            )
        if self.budget_draws < self.replicates * self.first_draws:
            raise OutOfRangeError(
                "the budget of draws",
                value=str(self.budget_draws),
                limit=f">= replicates x first_draws = {self.replicates * self.first_draws}",
                remedy="raise the budget or lower first_draws",
            )
        tolerances = np.asarray(self.absolute_tolerance, float)
        if not (np.all(tolerances >= 0.0) and 0.0 <= self.relative_tolerance < np.inf):
            raise OutOfRangeError(
                "tolerances of the quantiles",
                value=f"absolute {tolerances}, relative {self.relative_tolerance}",
                limit=">= 0",
                remedy="give the largest allowed error of the result",
            )


def _longest(sampling: Sampling, outputs: int) -> int:
    """Draws per replicate that memory allows, a power of two."""
    needed = _BYTES_PER_DRAW * sampling.replicates * outputs
    if needed * sampling.first_draws > sampling.memory_bytes:
        raise UnaffordableError(
            "storing the first draws of all replicates",
            value=f"{needed * sampling.first_draws} bytes for {outputs} outputs",
            limit=f"{sampling.memory_bytes} bytes",
            remedy="propagate fewer outputs at a time, or raise memory_bytes",
        )
    return 1 << (sampling.memory_bytes // needed).bit_length() - 1


def _converged(running: RunningStatistics, sampling: Sampling) -> NDArray[np.bool_]:
    """Whether, for each output, t_0.975 times the standard error of every quantile is below the tolerance."""
    quantiles = running["quantiles"]
    error = float(stdtrit(quantiles.count - 1, 0.975)) * quantiles.standard_error
    # An infinite quantile has no relative error: it has converged once all replicates agree on it.
    size = np.where(np.isinf(quantiles.mean), 0.0, np.abs(quantiles.mean))
    allowed = np.asarray(sampling.absolute_tolerance, float) + sampling.relative_tolerance * size
    return np.asarray(np.all(error <= allowed, axis=0))


@dataclass(kw_only=True)
class _Progress:
    """Results so far: statistics over replicates of one length, and the draws that failed."""

    running: RunningStatistics
    failed: NDArray[np.int64]
    status: NDArray[np.str_]
    length: int

    @property
    def draws(self) -> int:
        return self.length * self.running["quantiles"].count

    @property
    def wants_more(self) -> bool:
        return bool(np.any(self.status == "budget"))


Begin = Callable[[int], Replicate]
Look = tuple[ReplicateStatistics, NDArray[np.int64]]


def _add(progress: _Progress, looks: Iterable[Look], sampling: Sampling) -> None:
    """Add replicates in their order and check convergence again."""
    for statistics, failures in looks:
        for name, running in progress.running.items():
            running.add(getattr(statistics, name))
        progress.failed = progress.failed + failures
    settled = np.where(_converged(progress.running, sampling), "converged", "budget")
    progress.status = np.where(np.sum(progress.failed, axis=0) == progress.draws, "unranked", settled)


def _run(begin: Begin, sampling: Sampling, *, outputs: int, depth: bool) -> _Progress:
    """Extend the replicates while memory allows, then add more, until convergence or the end of the budget."""

    def look(replicate: Replicate, length: int) -> Look:
        replicate.lengthen(length, sampling.batch_draws)
        return replicate_statistics(replicate.values, replicate.failures, depth=depth), replicate.failures

    def blank(length: int) -> _Progress:
        none = np.zeros((len(CAUSES), outputs), np.int64)
        return _Progress(
            running={field.name: RunningMean() for field in fields(ReplicateStatistics)},
            failed=none,
            status=np.empty(0, np.str_),
            length=length,
        )

    first = sampling.replicates
    longest = min(_longest(sampling, outputs), sampling.budget_draws // first)
    replicates = [begin(number) for number in range(first)]
    progress = blank(sampling.first_draws)
    _add(progress, (look(replicate, progress.length) for replicate in replicates), sampling)
    while progress.wants_more and 2 * progress.length <= longest:
        progress = blank(2 * progress.length)
        _add(progress, (look(replicate, progress.length) for replicate in replicates), sampling)
    replicates.clear()  # frees their draws: from here on, one replicate at a time is in memory
    done = first
    while progress.wants_more and 2 * progress.draws <= sampling.budget_draws:
        if _DRAWS_PER_REPLICATE_NUMBER * 2 * done > progress.length:
            progress.status[progress.status == "budget"] = "memory"
            break
        _add(progress, (look(begin(number), progress.length) for number in range(done, 2 * done)), sampling)
        done *= 2
    return progress


def propagate(
    model: Model,
    sources: Sources,
    sampling: Sampling,
    *,
    seed: int,
    point: str,
    inverse_depth: bool,
) -> Propagated:
    """Propagate uncertain inputs through a model to the distribution of its outputs.

    Replicates double in length until t₀.₉₇₅(replicates − 1) times the replicate-to-replicate standard error of every
    watched quantile (2.5, 15.9, 50, 84.1, 97.5 %) is within the tolerance, or the budget is used up.

    Parameters
    ----------
    model : Model
        Vectorised model: from parameters (draws, 1) to an outcome (draws, outputs).
    sources : Sources
        The uncertain sources.
    sampling : Sampling
        Tolerance and budget.
    seed : int
        Seed of the study, >= 0.
    point : str
        Identity of the study point; points have independent streams.
    inverse_depth : bool
        Whether the model returns inverse depth w [1/m]; results are then depths, and w <= 0 is +∞. Otherwise outputs
        are ranked directly.

    Returns
    -------
    Propagated
        Quantiles, moments where they exist, errors, and failures by cause.

    Raises
    ------
    UnaffordableError
        The first draws do not fit into ``memory_bytes``.
    OutOfRangeError
        The model returns an array of the wrong shape, or the seed is negative.

    Notes
    -----
    The estimate of a quantile is the mean of the replicates' sample quantiles, which are exact, without binning. Its
    bias stays below its standard error, because the number of replicates never exceeds a sixteenth of their length. The
    first coordinates of the points are aligned with the directions that change the outputs most
    (:func:`alignment_with`), at the cost of two evaluations per dimension. Results are bit-identical for any
    ``batch_draws``.
    """
    outputs = ranked(model(sources.nominal()), inverse_depth=inverse_depth, draws=1)[0].shape[0]
    alignment = alignment_with([model], sources)

    def begin(number: int) -> Replicate:
        return Replicate(
            model,
            sources,
            seed=seed,
            point=point,
            replicate=number,
            alignment=alignment,
            inverse_depth=inverse_depth,
        )

    progress = _run(begin, sampling, outputs=outputs, depth=inverse_depth)
    running = progress.running
    # Mean and standard deviation are stated only where second moments exist.
    exist = (
        (running["tail_shape"].mean < TAIL_SHAPE_LIMIT)
        & (running["pole_margin"].mean >= POLE_MARGIN)
        & (running["infinite_fraction"].mean == 0.0)
        & (sources.covariance() is not None)
    )
    mean, deviation = running["mean"], running["standard_deviation"]
    return Propagated(
        quantiles=running["quantiles"].mean,
        quantiles_error=running["quantiles"].standard_error,
        half_width=running["half_width"].mean,
        half_width_error=running["half_width"].standard_error,
        mean=np.where(exist, mean.mean, np.nan),
        mean_error=np.where(exist, mean.standard_error, np.nan),
        standard_deviation=np.where(exist, deviation.mean, np.nan),
        standard_deviation_error=np.where(exist, deviation.standard_error, np.nan),
        failed=progress.failed,
        status=progress.status,
        draws=progress.draws,
        replicates=running["quantiles"].count,
    )
