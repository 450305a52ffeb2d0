"""Posterior draws by several independent ensembles of walkers, with diagnostics of their convergence.

Vehtari, Gelman, Simpson, Carpenter, Bürkner, "Rank-normalization, folding, and localization: an improved R-hat",
Bayesian Analysis 16 (2021) 667, as ArviZ computes them. Here, a chain is a whole ensemble, (steps, walkers): its
walkers are merged, because walkers of one ensemble move along each other's differences and are not independent chains.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from tradestudy.calibration.laplace import LaplaceCheck, LaplaceFit
from tradestudy.errors import OutOfRangeError
from tradestudy.execution.executor import tell
from tradestudy.optics.arrays import FloatArray


def rank_normalised_split_r_hat(chains: FloatArray) -> float:
    """The larger of the bulk and the folded rank-normalised split R-hat of one parameter (eqs. 3, 4, 14).

    Parameters
    ----------
    chains : array (ensembles, steps, walkers)
        Draws; one walker gives an ordinary chain.

    Returns
    -------
    float
        1 for chains that agree; inf if each chain is stuck at its own value; NaN for a constant.
    """
    from arviz_stats.base.array import array_stats

    merged = np.concatenate(_halves(chains), axis=1).reshape(len(chains), -1)
    with np.errstate(divide="ignore", invalid="ignore"):  # chains without any spread
        return float(array_stats.rhat(merged, method="rank"))


def bulk_effective_size(chains: FloatArray) -> float:
    """Effective sample size of the merged ensembles for the centre of one parameter's distribution.

    Parameters
    ----------
    chains : array (ensembles, steps, walkers)
        Draws.
    """
    from scipy.stats import rankdata  # takes a second to import; only chains need it

    halves = np.concatenate(_halves(chains))
    ranks = rankdata(halves, axis=None).reshape(halves.shape)
    return _effective_size(ndtri((ranks - 0.375) / (ranks.size + 0.25)))


def tail_effective_size(chains: FloatArray) -> float:
    """The smaller of the effective sample sizes for the 5 % and 95 % quantiles (section 4.3 of the paper).

    Parameters
    ----------
    chains : array (ensembles, steps, walkers)
        Draws.
    """
    halves = np.concatenate(_halves(chains))
    ends = np.quantile(halves, [0.05, 0.95])
    return min(_effective_size((halves <= end).astype(float)) for end in ends)


def _halves(chains: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First and second half of each chain."""
    half = chains.shape[1] // 2
    return chains[:, :half], chains[:, -half:]


def _effective_size(chains: FloatArray) -> float:
    """Effective sample size of merged chains, from the autocorrelation of the walkers' average.

    This average includes the correlation between walkers; its effective sample size is scaled to the variance of a
    single draw.
    """
    from arviz_stats.base.array import array_stats

    single = _pooled_variance(chains.reshape(len(chains), -1))
    if single == 0.0:
        return float("nan")
    average = chains.mean(axis=2)
    return float(array_stats.ess(average, method="identity")) * single / _pooled_variance(average)


def _pooled_variance(chains: FloatArray) -> float:
    """Variance of a draw over all chains, between and within them (eq. 2)."""
    size = chains.shape[1]
    within = chains.var(axis=1, ddof=1).mean() * (size - 1.0) / size
    return float(within + chains.mean(axis=1).var(ddof=1))


LogProbability = Callable[[FloatArray], FloatArray]
"""Takes parameters (N, P) and returns log probabilities (N,); −inf where the parameters are impossible."""

MINIMUM_ENSEMBLES = 4
MINIMUM_LENGTHS = 50.0  # in autocorrelation times; shorter chains cannot determine the autocorrelation time
R_HAT_LIMIT = 1.01
WALKER_R_HAT_LIMIT = 1.1  # walkers of one ensemble are short and correlated; stuck walkers give 2 and more
MINIMUM_EFFECTIVE_SIZE = 400.0
ACCEPTANCE_LIMITS = (0.2, 0.5)
FIRST_ROUND = 500
"""Steps of each ensemble, after which most posteriors have converged."""
_ACCEPTANCE = "acceptance"

_WARM_UP_TIMES = 10.0  # autocorrelation times dropped at the start
_PROPOSAL_DIMENSIONS = 5
_PROPOSAL_SHARE = 1.0 / 40.0  # of the steps, per parameter; keeps acceptance within its limits
_PROPOSAL_FREEDOM = 10.0  # degrees of freedom of the t distribution
_R_HAT_DRAWS = 4000  # steps kept for ranks; more of them do not change the verdict at 1.01


@dataclass(frozen=True, kw_only=True)
class SamplerDiagnostics:
    """Convergence diagnostics of the chains.

    Parameters
    ----------
    autocorrelation_steps : array (P,)
        Integrated autocorrelation time [steps]; the largest value over the ensembles.
    lengths : float
        Number of steps after the warm-up, divided by the longest autocorrelation time.
    r_hat : array (P,)
        Rank-normalised split R-hat across ensembles.
    walker_r_hat : array (P,)
        The same with the walkers of one ensemble as chains; the largest value over the ensembles.
    bulk_effective_size, tail_effective_size : array (P,)
        Effective sample sizes over all ensembles.
    acceptance : array (ensembles,)
        Mean accepted fraction.
    stuck_ensembles : tuple of int
        Ensembles, each of which alone causes the disagreement; empty if there is none.
    failures : tuple of str
        Limits that are not met, in words; empty if the chains converged.
    """

    autocorrelation_steps: FloatArray
    lengths: float
    r_hat: FloatArray
    walker_r_hat: FloatArray
    bulk_effective_size: FloatArray
    tail_effective_size: FloatArray
    acceptance: FloatArray
    stuck_ensembles: tuple[int, ...]
    failures: tuple[str, ...]

    @property
    def converged(self) -> bool:
        """Whether every limit is met."""
        return not self.failures

    @property
    def final(self) -> bool:
        """Whether more steps cannot help: nothing fails, or only the acceptance rate does."""
        return all(failure.startswith(_ACCEPTANCE) for failure in self.failures)


@dataclass(frozen=True, kw_only=True)
class PosteriorSample:
    """Draws from a posterior, with diagnostics and computing time.

    Parameters
    ----------
    names : tuple of str, length P
        Names of the parameters.
    chains : array (ensembles, steps, walkers, P)
        Kept draws, after the warm-up.
    warm_up_steps : int
        Steps discarded at the start.
    diagnostics : SamplerDiagnostics
        Convergence of the chains.
    evaluations : int
        Number of log probabilities computed, including the warm-up.
    seconds : float
        Wall time.
    """

    names: tuple[str, ...]
    chains: FloatArray
    warm_up_steps: int
    diagnostics: SamplerDiagnostics
    evaluations: int
    seconds: float

    @property
    def draws(self) -> FloatArray:
        """All kept draws as joint vectors, shape (N, P)."""
        return self.chains.reshape(-1, self.chains.shape[-1])

    def thinned(self, count: int) -> FloatArray:
        """Joint draws spread evenly over ensembles, steps and walkers, shape (count, P).

        Parameters
        ----------
        count : int
            Number of draws, at most as many as were sampled.
        """
        draws = self.draws
        if not 0 < count <= len(draws):
            raise OutOfRangeError(
                "the requested number of posterior draws is out of range",
                value=str(count),
                limit=f"1 to {len(draws)}",
                remedy="sample longer, or request fewer draws",
            )
        return draws[(np.arange(count) * len(draws)) // count]


@dataclass(frozen=True, kw_only=True)
class CheckedPosterior:
    """Posterior draws of a calibration's parameters with poses marginalised, and both checks.

    Parameters
    ----------
    sample : PosteriorSample
        Draws.
    check : LaplaceCheck
        Check of the marginalisation by Laplace's approximation.
    """

    sample: PosteriorSample
    check: LaplaceCheck

    @property
    def converged(self) -> bool:
        """Whether the chains converged and the marginalisation passed its check."""
        return self.sample.diagnostics.converged and self.check.passed


def sample_posterior(
    log_probability: LogProbability,
    starts: FloatArray,
    *,
    names: tuple[str, ...],
    rng: np.random.Generator,
    proposal: LaplaceFit | None = None,
    maximum_steps: int = 20_000,
    chains_fraction: float = 0.7,
) -> PosteriorSample:
    """Sample with independent affine-invariant ensembles until all diagnostics pass or the steps are used up.

    Parameters
    ----------
    log_probability : callable
        Log probabilities of many parameter vectors at once.
    starts : array (ensembles, walkers, P)
        First positions, spread over plausible values; at least four ensembles with an even number of walkers >= 2 P.
    names : tuple of str
        Names of the parameters.
    rng : numpy.random.Generator
        Generator of an independent seed for every ensemble.
    proposal : LaplaceFit, optional
        A normal approximation of the posterior. For each parameter, one step in forty (in total, at most every second
        step) then proposes a draw from a multivariate t distribution about it, which the exact posterior accepts or
        rejects. This shortens the autocorrelation time twentyfold in twenty dimensions. Below five parameters it is not
        used, because other moves are as fast.
    maximum_steps : int
        Number of steps of each ensemble after which sampling ends, converged or not.
    chains_fraction : float
        Expected fraction of the time until the first round of steps is done, for progress; the diagnosis takes the
        rest.

    Returns
    -------
    PosteriorSample
        The sample without the warm-up; ``diagnostics.converged`` states whether it converged.

    Raises
    ------
    OutOfRangeError
        Too few ensembles or walkers, names that do not match, or a start where the log probability is not finite.

    Notes
    -----
    Stretch and differential-evolution moves of emcee: D. Foreman-Mackey et al., PASP 125 (2013) 306; J. Goodman,
    J. Weare, Comm. App. Math. Comp. Sci. 5 (2010) 65; C. ter Braak, Stat. Comput. 16 (2006) 239.
    """
    _check_starts(log_probability, starts, names)
    begin = time.perf_counter()
    samplers = [_sampler(log_probability, start, rng, proposal) for start in starts]
    tell(0.0)
    steps, first = 0, min(FIRST_ROUND, maximum_steps)
    while True:
        steps = min(max(FIRST_ROUND, steps * 3 // 2), maximum_steps)
        for sampler, start in zip(samplers, starts, strict=True):
            finished = sampler.iteration
            sampler.run_mcmc(start if finished == 0 else None, steps - finished, skip_initial_state_check=True)
            tell(chains_fraction * min(1.0, sum(sampler.iteration for sampler in samplers) / (len(samplers) * first)))
        walks = np.stack([sampler.get_chain() for sampler in samplers])
        # The second half shows the autocorrelation without the drift from the starts.
        half = walks.shape[1] // 2
        warm_up = int(min(half, np.ceil(_WARM_UP_TIMES * autocorrelation_times(walks[:, half:]).max())))
        kept = walks[:, warm_up:]
        times = autocorrelation_times(kept)
        if steps == maximum_steps or kept.shape[1] >= MINIMUM_LENGTHS * times.max():
            # including the warm-up, because walkers start within the spread of the posterior
            acceptance = np.array([sampler.acceptance_fraction.mean() for sampler in samplers])
            diagnostics = diagnose(kept, acceptance, names, times=times)
            if diagnostics.final or steps == maximum_steps:
                break
    return PosteriorSample(
        names=names,
        chains=kept,
        warm_up_steps=warm_up,
        diagnostics=diagnostics,
        evaluations=int(walks.shape[0] * walks.shape[1] * walks.shape[2]),
        seconds=time.perf_counter() - begin,
    )


def diagnose(
    chains: FloatArray, acceptance: FloatArray, names: tuple[str, ...], *, times: FloatArray | None = None
) -> SamplerDiagnostics:
    """Judge chains by autocorrelation, agreement between ensembles, effective size and acceptance.

    Parameters
    ----------
    chains : array (ensembles, steps, walkers, P)
        Draws after the warm-up.
    acceptance : array (ensembles,)
        Mean accepted fraction.
    names : tuple of str
        Names of the parameters, for ``failures``.
    times : array (P,), optional
        Autocorrelation times, if already known [steps].

    Returns
    -------
    SamplerDiagnostics
        ``failures`` names the limits that are not met.
    """
    times = autocorrelation_times(chains) if times is None else times
    lengths = float(chains.shape[1] / times.max())
    few = chains[:, :: -(-chains.shape[1] // _R_HAT_DRAWS)]
    columns = np.moveaxis(chains, -1, 0)
    r_hat = np.array([rank_normalised_split_r_hat(column) for column in np.moveaxis(few, -1, 0)])
    walker_r_hat = np.array(
        [max(rank_normalised_split_r_hat(chain.T[..., None]) for chain in column) for column in np.moveaxis(few, -1, 0)]
    )
    bulk = np.array([bulk_effective_size(column) for column in columns])
    tail = np.array([tail_effective_size(column) for column in columns])
    failures = [
        *_failure("chains too short for their autocorrelation time τ: steps/τ", lengths, MINIMUM_LENGTHS, "below"),
        *_worst("ensembles disagree: split R-hat", r_hat, R_HAT_LIMIT, "above", names),
        *_worst("walkers of one ensemble stay apart: R-hat", walker_r_hat, WALKER_R_HAT_LIMIT, "above", names),
        *_worst("bulk effective size", bulk, MINIMUM_EFFECTIVE_SIZE, "below", names),
        *_worst("tail effective size", tail, MINIMUM_EFFECTIVE_SIZE, "below", names),
        *_failure(_ACCEPTANCE, float(acceptance.min()), ACCEPTANCE_LIMITS[0], "below"),
        *_failure(_ACCEPTANCE, float(acceptance.max()), ACCEPTANCE_LIMITS[1], "above"),
    ]
    return SamplerDiagnostics(
        autocorrelation_steps=times,
        lengths=lengths,
        r_hat=r_hat,
        walker_r_hat=walker_r_hat,
        bulk_effective_size=bulk,
        tail_effective_size=tail,
        acceptance=acceptance,
        stuck_ensembles=_stuck_ensembles(few, r_hat),
        failures=tuple(failures),
    )


def autocorrelation_times(chains: FloatArray) -> FloatArray:
    """Integrated autocorrelation time of each parameter, shape (P,) [steps]; the largest value over the ensembles.

    Parameters
    ----------
    chains : array (ensembles, steps, walkers, P)
        Draws.
    """
    from emcee.autocorr import integrated_time

    times: FloatArray = np.max([integrated_time(chain, tol=0) for chain in chains], axis=0)
    # a walker that never moved has no autocorrelation time and counts as fully correlated
    return np.where(np.isfinite(times), times, float(chains.shape[1]))


def _check_starts(log_probability: LogProbability, starts: FloatArray, names: tuple[str, ...]) -> None:
    """Refuse too few ensembles or walkers, and starts where the posterior is zero."""
    ensembles, walkers, dimensions = starts.shape
    if ensembles < MINIMUM_ENSEMBLES:
        raise OutOfRangeError(
            "too few independent ensembles to compare",
            value=str(ensembles),
            limit=f">= {MINIMUM_ENSEMBLES}",
            remedy="start more",
        )
    if walkers < 2 * dimensions or walkers % 2:
        raise OutOfRangeError(
            "too few walkers",
            value=f"{walkers} for {dimensions} parameters",
            limit=f"an even number >= {2 * dimensions}",
            remedy="start more walkers",
        )
    if len(names) != dimensions:
        raise OutOfRangeError(
            "names and parameters do not match",
            value=f"{len(names)} names, {dimensions} parameters",
            limit="one name per parameter",
            remedy="name every parameter",
        )
    bad = ~np.isfinite(log_probability(starts.reshape(-1, dimensions)))
    if np.any(bad):
        raise OutOfRangeError(
            "walkers start where the log posterior is not finite",
            value=f"{int(bad.sum())} of {bad.size}",
            limit="none",
            remedy="start inside the bounds of the prior",
        )


def _sampler(  # type: ignore[no-untyped-def]  # emcee ships no types
    log_probability: LogProbability, start: FloatArray, rng: np.random.Generator, proposal: LaplaceFit | None
):
    """One ensemble with its own random stream."""
    import emcee

    moves = [(emcee.moves.StretchMove(), 0.3), (emcee.moves.DEMove(), 0.7)]
    if proposal is not None and start.shape[1] >= _PROPOSAL_DIMENSIONS:
        share = min(0.5, _PROPOSAL_SHARE * start.shape[1])
        moves = [(move, weight * (1.0 - share)) for move, weight in moves]
        moves.append((emcee.moves.MHMove(_independent_move(proposal)), share))
    sampler = emcee.EnsembleSampler(*start.shape, log_probability, moves=moves, vectorize=True)
    legacy = np.random.RandomState(int(rng.integers(2**32)))  # the only generator that emcee accepts
    sampler.random_state = legacy.get_state()
    return sampler


def _independent_move(
    proposal: LaplaceFit,
) -> Callable[[FloatArray, np.random.RandomState], tuple[FloatArray, FloatArray]]:
    """Proposals from a multivariate t distribution about a Laplace fit, whose tails keep the chain ergodic."""
    deviation = proposal.standard_deviation
    factor = np.linalg.cholesky(proposal.correlation)

    def log_density(parameters: FloatArray) -> FloatArray:
        scores = np.linalg.solve(factor, ((parameters - proposal.mean) / deviation).T)
        freedom = _PROPOSAL_FREEDOM + len(deviation)
        density: FloatArray = -0.5 * freedom * np.log1p(np.sum(scores**2, axis=0) / _PROPOSAL_FREEDOM)
        return density

    def propose(parameters: FloatArray, rng: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        widths = np.sqrt(_PROPOSAL_FREEDOM / rng.chisquare(_PROPOSAL_FREEDOM, len(parameters)))
        scores = rng.standard_normal(parameters.shape) @ factor.T
        proposed = proposal.mean + deviation * widths[:, None] * scores
        return proposed, log_density(parameters) - log_density(proposed)

    return propose


def _stuck_ensembles(chains: FloatArray, r_hat: FloatArray) -> tuple[int, ...]:
    """Ensembles whose removal alone makes the others agree."""
    if not np.any(r_hat > R_HAT_LIMIT):
        return ()
    count = chains.shape[0]
    worst = chains[..., int(np.nanargmax(r_hat))]
    return tuple(
        index for index in range(count) if rank_normalised_split_r_hat(worst[np.arange(count) != index]) <= R_HAT_LIMIT
    )


def _failure(what: str, value: float, limit: float, side: str) -> list[str]:
    """Text for a limit if it is not met; NaN meets no limit."""
    broken = not (value >= limit if side == "below" else value <= limit)
    return [f"{what} {value:.4g} (allowed {'>=' if side == 'below' else '<='} {limit:g})"] if broken else []


def _worst(what: str, values: FloatArray, limit: float, side: str, names: tuple[str, ...]) -> list[str]:
    """Text for the worst parameter if it does not meet the limit."""
    signed = values if side == "above" else -values
    index = int(np.argmax(np.where(np.isnan(signed), np.inf, signed)))
    return _failure(f"{names[index]}: {what}", float(values[index]), limit, side)
