"""A pair with a left–right term per view, which explains why the pair fits worse than its cameras; its posterior."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tradestudy.calibration.corners.bundle_adjustment import PairFit
from tradestudy.calibration.corners.corner_file import StereoCorners
from tradestudy.calibration.corners.marginal_views import (
    CompressedViews,
    ViewStates,
    compress_views,
    exact_log_likelihood,
    gyration_radius,
    settle_views,
)
from tradestudy.calibration.corners.view_blocks import (
    motion_columns,
    pair_blocks,
    shared_names,
)
from tradestudy.calibration.posterior.laplace import (
    CHECKED_POINTS,
    LaplaceCheck,
    LaplaceFit,
    compare_log_posteriors,
    covariance_from_information,
)
from tradestudy.calibration.posterior.sampling import MINIMUM_ENSEMBLES, CheckedPosterior, sample_posterior
from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import FloatArray

_MOST_LINEARISATIONS = 20
_LEVER_DEVIATION = 1.0  # prior, of the logarithm of the lever over the radius of gyration
_FIRST_STEPS = (0.05, 0.3, 0.3)  # of the logarithms of noise, motion scale and lever


def posterior_names(free: Sequence[str]) -> tuple[str, ...]:
    """Sampled parameters of a pair of lenses with these free coefficients."""
    return (*shared_names(free), "log_noise_px", "motion_scale")


@dataclass(frozen=True, kw_only=True)
class ViewMeans:
    """Mean residual of each view in both images, and their correlation.

    Parameters
    ----------
    left, right : array (V, 2)
        Mean residual vectors [px].
    correlation : float
        Of all left with all right components: −1 if every view pulls the cameras apart.
    """

    left: FloatArray
    right: FloatArray
    correlation: float


@dataclass(frozen=True, kw_only=True)
class PairResidualFit:
    """The pair with a left–right term: scales by restricted maximum likelihood, the other parameters given these.

    Parameters
    ----------
    shared : array (P,)
        In the order of ``view_blocks.shared_names``.
    covariance : array (P, P)
        Of the shared parameters, poses and motions marginalised, given both scales.
    noise_px : float
        Standard deviation of one coordinate [px]; root mean square over the views where these differ.
    motion_scale : float
        Standard deviation of the translation between the exposures, per axis [m].
    lever : float
        Standard deviation of the translation over that of the rotation [m].
    states : ViewStates
        Most probable poses and motions.
    log_likelihood_gain : float
        Restricted log likelihood above that of the fit without the term.
    left_rms_px, right_rms_px : float
        Root mean square length per corner of the residuals that remain [px].
    overconfidence : array (P,)
        Standard deviation with the term over that without it.
    seconds : float
        Wall time.
    """

    shared: FloatArray
    covariance: FloatArray
    noise_px: float
    motion_scale: float
    lever: float
    states: ViewStates
    log_likelihood_gain: float
    left_rms_px: float
    right_rms_px: float
    overconfidence: FloatArray
    seconds: float


def view_means(fit: PairFit, corners: StereoCorners) -> ViewMeans:
    """Mean residuals per view, in which the noise of single corners averages out.

    Parameters
    ----------
    fit : PairFit
        Bundle adjustment without a left–right term.
    corners : StereoCorners
        What was seen.
    """
    shape = (len(corners.views), 2, -1, 2)
    total = fit.residuals_px.reshape(shape).sum(axis=2) / corners.present.sum(axis=1)[:, None, None]
    left, right = total[:, 0], total[:, 1]
    return ViewMeans(left=left, right=right, correlation=float(np.corrcoef(left.ravel(), right.ravel())[0, 1]))


def fit_pair_residual(fit: PairFit, corners: StereoCorners) -> PairResidualFit:
    """Fit the pair again with a small board motion between the exposures of each view.

    Parameters
    ----------
    fit : PairFit
        Bundle adjustment without the term.
    corners : StereoCorners
        What was seen.

    Returns
    -------
    PairResidualFit
        Scales by restricted maximum likelihood (D. Harville, J. Am. Stat. Assoc. 72 (1977) 320), so that the
        P + 6 V fitted parameters do not bias the noise. The lever, which sets how much boards shift for how much they
        rotate, is fitted with them, under a log-normal prior about the radius of gyration of the board.

    Raises
    ------
    NotConvergedError
        The fit does not converge.
    """
    begin = time.perf_counter()
    radius = lever = gyration_radius(corners)
    shared = fit.shared
    states = ViewStates(poses=fit.poses, motions=np.zeros_like(fit.poses))
    compressed = compress_views(shared, states, corners, lever)
    without = _restricted(compressed, fit.noise_px, 0.0)
    # Start at the motion scale that would explain the rows that depend on motion.
    scale = float(np.sqrt(np.mean(compressed.motion_rows[..., -1] ** 2 / compressed.motion_gains)))
    noise = fit.noise_px
    for _ in range(_MOST_LINEARISATIONS):
        noise, scale, factor = _best_scales(compressed, noise, scale, lever / radius)
        compressed, lever = compressed.with_lever(factor), factor * lever
        information, gradient = compressed.information(noise, scale)
        step = np.linalg.solve(information, gradient)
        shared = shared + step
        states = replace(states, motions=states.motions * np.array([*[factor] * 3, *[1.0] * 3]))
        states = settle_views(shared, states, corners, lever, noise_px=noise, motion_scale=scale)
        compressed = compress_views(shared, states, corners, lever)
        if step @ information @ step < 1e-8:
            return _result(fit, corners, compressed, states, lever, noise, scale, without, begin)
    raise NotConvergedError(
        "the fit with a left–right term does not converge",
        value=f"{_MOST_LINEARISATIONS} linearisations",
        limit="steps below 1e-4 standard deviations",
        remedy="add views: the shared parameters are too uncertain to linearise",
    )


def extended_step(fit: PairResidualFit, corners: StereoCorners, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Generalised least-squares step of the shared and additional parameters, with its covariance.

    Parameters
    ----------
    fit, corners
        The fit and its data.
    columns : array (V, 4 N, E)
        Derivatives by the additional parameters, which are zero at the fit, whitened like the residuals.

    Returns
    -------
    step : array (P + E,)
    covariance : array (P + E, P + E)
    """
    extended = compress_views(fit.shared, fit.states, corners, fit.lever, extra=columns)
    information, gradient = extended.information(fit.noise_px, fit.motion_scale)
    covariance = inverse_information(information)
    return covariance @ gradient, covariance


def inverse_information(information: FloatArray) -> FloatArray:
    """Inverse of a regular information matrix, scaled to a unit diagonal first."""
    size = 1.0 / np.sqrt(np.diag(information))
    return np.asarray(size[:, None] * np.linalg.inv(information * np.outer(size, size)) * size)


def _result(
    fit: PairFit,
    corners: StereoCorners,
    compressed: CompressedViews,
    states: ViewStates,
    lever: float,
    noise: float,
    scale: float,
    without: float,
    begin: float,
) -> PairResidualFit:
    """The fit with its remaining residuals."""
    covariance = covariance_from_information(compressed.information(noise, scale)[0], shared_names(corners.lens.free))
    as_seen = replace(corners, noise=None)
    motion = motion_columns(compressed.centre, states.poses, as_seen, lever)
    left_over = pair_blocks(compressed.centre, states.poses, as_seen).residuals
    left_over = left_over - np.einsum("vmk,vk->vm", motion, states.motions)
    left, right = np.split(left_over, 2, axis=1)
    return PairResidualFit(
        shared=compressed.centre,
        covariance=covariance,
        noise_px=noise,
        motion_scale=scale,
        lever=lever,
        states=states,
        log_likelihood_gain=_restricted(compressed, noise, scale) - without,
        left_rms_px=float(np.sqrt(np.sum(left**2) / corners.corner_count)),
        right_rms_px=float(np.sqrt(np.sum(right**2) / corners.corner_count)),
        overconfidence=np.sqrt(np.diag(covariance) / np.diag(fit.covariance)),
        seconds=time.perf_counter() - begin,
    )


def _restricted(compressed: CompressedViews, noise_px: float, motion_scale: float) -> float:
    """Log likelihood of the scales with the shared parameters integrated out under a flat prior."""
    information, gradient = compressed.information(noise_px, motion_scale)
    best = compressed.centre + np.linalg.solve(information, gradient)
    peak = compressed.log_likelihood(best, np.asarray(noise_px), np.asarray(motion_scale))
    return float(peak) - 0.5 * float(np.linalg.slogdet(information)[1])


def _best_scales(
    compressed: CompressedViews, noise_px: float, motion_scale: float, stretch: float
) -> tuple[float, float, float]:
    """Noise and motion scale of highest restricted likelihood, and the factor by which the lever changes.

    The stretch is the present ratio of the lever to the radius of gyration.
    """
    from scipy.optimize import minimize  # slow to import, needed only for corners

    def cost(logs: FloatArray) -> float:
        noise, scale, factor = np.exp(logs)
        unusual = (np.log(stretch) + logs[2]) / _LEVER_DEVIATION
        return 0.5 * float(unusual**2) - _restricted(compressed.with_lever(factor), float(noise), float(scale))

    start = np.array([np.log(noise_px), np.log(motion_scale), 0.0])
    found = minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={
            "initial_simplex": np.concatenate([start[None], start + np.diag(_FIRST_STEPS)]),
            "xatol": 1e-4,
            "fatol": 1e-6,
            "maxiter": 1000,
        },
    )
    noise, scale, factor = np.exp(found.x)
    return float(noise), float(scale), float(factor)


def log_posterior(compressed: CompressedViews, parameters: FloatArray, *, largest_motion: float) -> FloatArray:
    """Log posterior with poses and motions marginalised, up to a constant.

    Parameters
    ----------
    compressed : CompressedViews
        The views, reduced.
    parameters : array (..., P + 2)
        In the order of ``posterior_names``.
    largest_motion : float
        Upper end of the uniform prior of the motion scale [m].

    Returns
    -------
    array (...)
        Natural logarithm; −inf beyond ``largest_motion``. Priors: flat in the shared parameters and in ln σ, and
        flat in the motion scale (A. Gelman, Bayesian Analysis 1 (2006) 515), which therefore can reach zero where views
        do not move.
    """
    scale = parameters[..., -1]
    allowed = (scale > 0.0) & (scale <= largest_motion)
    likelihood = compressed.log_likelihood(parameters[..., :-2], np.exp(parameters[..., -2]), np.abs(scale))
    return np.where(allowed, likelihood, -np.inf)


def sample_relative_pose(
    fit: PairResidualFit,
    corners: StereoCorners,
    *,
    rng: np.random.Generator,
    maximum_steps: int = 20_000,
) -> CheckedPosterior:
    """Sample the pair's posterior with emcee, and check its marginalisation against the exact one.

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
        Check ``converged`` before using it.
    """
    compressed = compress_views(fit.shared, fit.states, corners, fit.lever)
    laplace = _joint_laplace(fit, compressed, corners)
    walkers = 2 * len(laplace.names) + 2
    starts = laplace.draw(rng, MINIMUM_ENSEMBLES * walkers)
    starts[:, -1] = np.minimum(np.abs(starts[:, -1]), fit.lever)
    sample = sample_posterior(
        lambda parameters: log_posterior(compressed, parameters, largest_motion=fit.lever),
        starts.reshape(MINIMUM_ENSEMBLES, walkers, -1),
        names=laplace.names,
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
    """Compare the linearised marginal posterior with the one whose poses are refitted at each draw.

    Parameters
    ----------
    draws : array (K, P + 2)
        Posterior draws.
    compressed : CompressedViews
        The views, reduced.
    fit : PairResidualFit
        Starting values of the poses.
    corners : StereoCorners
        What was seen.

    Returns
    -------
    LaplaceCheck
        Of the log ratios.
    """
    noises, scales = np.exp(draws[:, -2]), draws[:, -1]
    exact = np.array(
        [
            exact_log_likelihood(
                draw[:-2], fit.states, corners, fit.lever, noise_px=float(noise), motion_scale=float(scale)
            )
            for draw, noise, scale in zip(draws, noises, scales, strict=True)
        ]
    )
    approximate = compressed.log_likelihood(draws[:, :-2], noises, scales)
    return compare_log_posteriors(exact, approximate)


def _joint_laplace(fit: PairResidualFit, compressed: CompressedViews, corners: StereoCorners) -> LaplaceFit:
    """Normal approximation of all parameters, with the noise from the number of coordinates."""
    names = posterior_names(corners.lens.free)
    covariance = np.zeros((len(names), len(names)))
    covariance[:-2, :-2] = fit.covariance
    covariance[-2, -2] = 1.0 / (8.0 * corners.corner_count)
    covariance[-1, -1] = _motion_deviation(fit, compressed) ** 2
    mean = np.concatenate([fit.shared, [np.log(fit.noise_px), fit.motion_scale]])
    return LaplaceFit(names=names, mean=mean, covariance=covariance)


def _motion_deviation(fit: PairResidualFit, compressed: CompressedViews) -> float:
    """Distance above the best motion scale at which the restricted log likelihood is lower by a half [m]."""
    from scipy.optimize import brentq

    best = _restricted(compressed, fit.noise_px, fit.motion_scale)

    def excess(step: float) -> float:
        return best - 0.5 - _restricted(compressed, fit.noise_px, fit.motion_scale + step)

    far = fit.motion_scale / np.sqrt(12.0 * len(fit.states.poses))
    while excess(far) < 0.0 and far < fit.lever:
        far *= 2.0
    return float(brentq(excess, 0.0, far, rtol=0.01)) if far < fit.lever else fit.lever
