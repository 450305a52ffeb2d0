"""The posterior of a pair calibrated from corners: its density, draws from it by emcee, and their check."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tradestudy.calibration.corners.board_warp import WARP_NAMES, views_with_warp, warped
from tradestudy.calibration.corners.marginal_views import CompressedViews, exact_log_likelihood
from tradestudy.calibration.corners.pair_residual import PairResidualFit
from tradestudy.calibration.corners.real_rig import RigFit
from tradestudy.calibration.corners.view_blocks import shared_names
from tradestudy.calibration.posterior.laplace import (
    CHECKED_POINTS,
    LaplaceCheck,
    LaplaceFit,
    compare_log_posteriors,
)
from tradestudy.calibration.posterior.sampling import MINIMUM_ENSEMBLES, CheckedPosterior, sample_posterior
from tradestudy.execution.point_progress import part_of_point, tell
from tradestudy.optics.arrays import FloatArray

_SAMPLED, _CHAINS = 0.5, 0.27
"""Fraction of the time that sampling takes, before the check, and of sampling that the first round of steps takes."""


def posterior_names(free: Sequence[str]) -> tuple[str, ...]:
    """Names of the sampled parameters of a pair whose lenses have these free coefficients."""
    return (*shared_names(free), *WARP_NAMES, "log_noise_px", "motion_scale")


def linearised_rig(fit: RigFit) -> CompressedViews:
    """The views of a fit, linearised in the shared parameters and the warp of the board."""
    return views_with_warp(fit.explained, fit.corners, fit.warp)


def log_posterior(compressed: CompressedViews, parameters: FloatArray, *, largest_motion: float) -> FloatArray:
    """Log posterior with poses and motions marginalised, up to a constant.

    Parameters
    ----------
    compressed : CompressedViews
        The reduced views.
    parameters : array (..., P + 5)
        Parameters in the order of ``posterior_names``.
    largest_motion : float
        Upper limit of the uniform prior of the motion scale [m].

    Returns
    -------
    array (...)
        Natural logarithm; −inf beyond ``largest_motion``. The prior is flat in the shared parameters, the warp, ln σ,
        and the motion scale (A. Gelman, Bayesian Analysis 1 (2006) 515), which can therefore reach zero if there is no
        motion.
    """
    scale = parameters[..., -1]
    allowed = (scale > 0.0) & (scale <= largest_motion)
    likelihood = compressed.log_likelihood(parameters[..., :-2], np.exp(parameters[..., -2]), np.abs(scale))
    return np.where(allowed, likelihood, -np.inf)


def sample_rig(fit: RigFit, *, rng: np.random.Generator, maximum_steps: int = 20_000) -> CheckedPosterior:
    """Sample the posterior of a pair with emcee, and check its marginalisation against the exact one.

    Parameters
    ----------
    fit : RigFit
        The fit at which views are linearised and chains start.
    rng : numpy.random.Generator
        Random-number generator for starts and chains.
    maximum_steps : int
        Steps of each ensemble; see ``posterior.sample_posterior``.

    Returns
    -------
    CheckedPosterior
        Check ``converged`` before using it.
    """
    views, largest_motion = linearised_rig(fit), fit.explained.lever
    laplace = _joint_laplace(fit, views)
    walkers = 2 * len(laplace.names) + 2
    starts = laplace.draw(rng, MINIMUM_ENSEMBLES * walkers)
    starts[:, -1] = np.minimum(np.abs(starts[:, -1]), largest_motion)
    with part_of_point(0.0, _SAMPLED):
        sample = sample_posterior(
            lambda parameters: log_posterior(views, parameters, largest_motion=largest_motion),
            starts.reshape(MINIMUM_ENSEMBLES, walkers, -1),
            names=laplace.names,
            rng=rng,
            proposal=laplace,
            maximum_steps=maximum_steps,
            chains_fraction=_CHAINS,
        )
    with part_of_point(_SAMPLED, 1.0):
        check = check_marginalisation(sample.thinned(CHECKED_POINTS), views, fit)
    return CheckedPosterior(sample=sample, check=check)


def check_marginalisation(draws: FloatArray, views: CompressedViews, fit: RigFit) -> LaplaceCheck:
    """Compare the linearised marginal posterior with that for poses refitted at each draw.

    Parameters
    ----------
    draws : array (K, P + 5)
        Posterior draws.
    views : CompressedViews
        The linearised views, with the warp.
    fit : RigFit
        The corners, and starting values of the poses.

    Returns
    -------
    LaplaceCheck
        The check of the log ratios.
    """
    noises, scales = np.exp(draws[:, -2]), draws[:, -1]
    exact = np.empty(len(draws))
    for k, (draw, noise, scale) in enumerate(zip(draws, noises, scales, strict=True)):
        exact[k] = exact_log_likelihood(
            draw[:-5],
            fit.explained.states,
            warped(fit.corners, draw[-5:-2]),
            fit.explained.lever,
            noise_px=float(noise),
            motion_scale=float(scale),
        )
        tell((k + 1) / len(draws))
    return compare_log_posteriors(exact, views.log_likelihood(draws[:, :-2], noises, scales))


def _joint_laplace(fit: RigFit, views: CompressedViews) -> LaplaceFit:
    """Normal approximation for all parameters; the number of coordinates determines the uncertainty of the noise."""
    explained, names = fit.explained, posterior_names(fit.corners.lens.free)
    covariance = np.zeros((len(names), len(names)))
    covariance[:-2, :-2] = fit.joint_covariance
    covariance[-2, -2] = 1.0 / (8.0 * fit.corners.corner_count)
    covariance[-1, -1] = _motion_deviation(explained, views) ** 2
    mean = np.concatenate([views.centre, [np.log(explained.noise_px), explained.motion_scale]])
    return LaplaceFit(names=names, mean=mean, covariance=covariance)


def _motion_deviation(fit: PairResidualFit, views: CompressedViews) -> float:
    """Distance above the best motion scale at which the restricted log likelihood is lower by one half [m]."""
    from scipy.optimize import brentq

    best = views.restricted_log_likelihood(fit.noise_px, fit.motion_scale)

    def excess(step: float) -> float:
        return best - 0.5 - views.restricted_log_likelihood(fit.noise_px, fit.motion_scale + step)

    far = fit.motion_scale / np.sqrt(12.0 * len(fit.states.poses))
    while excess(far) < 0.0 and far < fit.lever:
        far *= 2.0
    return float(brentq(excess, 0.0, far, rtol=0.01)) if far < fit.lever else fit.lever
