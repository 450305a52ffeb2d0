"""Posterior of a pair: relative pose, intrinsic parameters, noise and left–right motion, board poses marginalised."""

from __future__ import annotations

import numpy as np

from tradestudy.calibration.corners.corner_file import StereoCorners
from tradestudy.calibration.corners.marginal_views import (
    CompressedViews,
    compress_views,
    exact_log_likelihood,
)
from tradestudy.calibration.corners.pair_residual import PairResidualFit
from tradestudy.calibration.corners.view_blocks import SHARED_NAMES
from tradestudy.calibration.posterior.laplace import (
    CHECKED_POINTS,
    LaplaceCheck,
    LaplaceFit,
    compare_log_posteriors,
)
from tradestudy.calibration.posterior.sampling import MINIMUM_ENSEMBLES, CheckedPosterior, sample_posterior
from tradestudy.optics.arrays import FloatArray

POSTERIOR_NAMES = (*SHARED_NAMES, "log_noise_px", "log_motion_scale")
_WALKERS = 2 * len(POSTERIOR_NAMES) + 2


def log_posterior(compressed: CompressedViews, parameters: FloatArray, *, largest_motion: float) -> FloatArray:
    """Log posterior with poses and motions marginalised, up to a constant.

    Parameters
    ----------
    compressed : CompressedViews
        The views, reduced.
    parameters : array (..., 20)
        In the order of ``POSTERIOR_NAMES``.
    largest_motion : float
        Upper end of the uniform prior of the motion scale [m].

    Returns
    -------
    array (...)
        Natural logarithm; −inf beyond ``largest_motion``. Priors: flat in the shared parameters and in ln σ, and
        flat in the motion scale (A. Gelman, Bayesian Analysis 1 (2006) 515), hence the Jacobian of its logarithm.
    """
    log_scale = parameters[..., 19]
    allowed = log_scale <= np.log(largest_motion)
    scale = np.exp(np.where(allowed, log_scale, np.log(largest_motion)))
    likelihood = compressed.log_likelihood(parameters[..., :18], np.exp(parameters[..., 18]), scale)
    return np.where(allowed, likelihood + log_scale, -np.inf)


def sample_relative_pose(
    fit: PairResidualFit,
    corners: StereoCorners,
    *,
    rng: np.random.Generator,
    maximum_steps: int = 20_000,
) -> CheckedPosterior:
    """Sample the pair's posterior with emcee and check its marginalisation at exact points.

    Parameters
    ----------
    fit : PairResidualFit
        Where to linearise and to start.
    corners : StereoCorners
        What was seen.
    rng : numpy.random.Generator
        Randomness of starts and chains.
    maximum_steps : int
        As for ``posterior.sample_posterior``.

    Returns
    -------
    CheckedPosterior
        Ask ``converged`` before using it.
    """
    compressed = compress_views(fit.shared, fit.states, corners, fit.lever)
    laplace = _joint_laplace(fit, corners)
    starts = laplace.draw(rng, MINIMUM_ENSEMBLES * _WALKERS)
    sample = sample_posterior(
        lambda parameters: log_posterior(compressed, parameters, largest_motion=fit.lever),
        starts.reshape(MINIMUM_ENSEMBLES, _WALKERS, -1),
        names=POSTERIOR_NAMES,
        rng=rng,
        proposal=laplace,
        maximum_steps=maximum_steps,
    )
    return CheckedPosterior(
        sample=sample, check=check_marginalisation(sample.thinned(CHECKED_POINTS), compressed, fit, corners)
    )


def check_marginalisation(
    draws: FloatArray, compressed: CompressedViews, fit: PairResidualFit, corners: StereoCorners
) -> LaplaceCheck:
    """Compare the linearised marginal posterior with the one whose poses are settled anew at each draw.

    Parameters
    ----------
    draws : array (K, 20)
        Posterior draws.
    compressed : CompressedViews
        The views, reduced.
    fit : PairResidualFit
        Where the poses start from.
    corners : StereoCorners
        What was seen.

    Returns
    -------
    LaplaceCheck
        Of the log ratios.
    """
    noises, scales = np.exp(draws[:, 18]), np.exp(draws[:, 19])
    exact = np.array(
        [
            exact_log_likelihood(
                draw[:18], fit.states, corners, fit.lever, noise_px=float(noise), motion_scale=float(scale)
            )
            for draw, noise, scale in zip(draws, noises, scales, strict=True)
        ]
    )
    approximate = compressed.log_likelihood(draws[:, :18], noises, scales)
    return compare_log_posteriors(exact, approximate)


def _joint_laplace(fit: PairResidualFit, corners: StereoCorners) -> LaplaceFit:
    """Normal approximation of all parameters: the scales by the number of coordinates and motions that inform them."""
    covariance = np.zeros((20, 20))
    covariance[:18, :18] = fit.covariance
    covariance[18, 18], covariance[19, 19] = 1.0 / (8.0 * corners.corner_count), 1.0 / (12.0 * len(corners.views))
    mean = np.concatenate([fit.shared, np.log([fit.noise_px, fit.motion_scale])])
    return LaplaceFit(names=POSTERIOR_NAMES, mean=mean, covariance=covariance)
