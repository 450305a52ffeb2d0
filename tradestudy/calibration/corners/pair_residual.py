"""A pair with a left–right term per view, which explains why the pair fits worse than its single cameras."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from tradestudy.calibration.corners.bundle_adjustment import PairFit
from tradestudy.calibration.corners.corner_file import StereoCorners
from tradestudy.calibration.corners.marginal_views import (
    LAST_STEP,
    CompressedViews,
    ViewStates,
    compress_views,
    gyration_radius,
    settle_views,
)
from tradestudy.calibration.corners.scale_scoring import LocalLikelihood, maximise
from tradestudy.calibration.corners.view_blocks import (
    motion_columns,
    pair_blocks,
    shared_names,
)
from tradestudy.calibration.posterior.laplace import covariance_from_information
from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import FloatArray

_MOST_LINEARISATIONS = 20
_LEVER_DEVIATION = 1.0  # prior standard deviation of ln(lever / radius of gyration)
_SCALES_SETTLED = 1e-7  # gain of the log likelihood: half a thousandth of a standard deviation


@dataclass(frozen=True, kw_only=True)
class ViewMeans:
    """Mean residual of each view in both images, and their correlation.

    Parameters
    ----------
    left, right : array (V, 2)
        Mean residual vectors [px].
    correlation : float
        Correlation of all left with all right components; −1 if every view pulls the cameras apart.
    """

    left: FloatArray
    right: FloatArray
    correlation: float


@dataclass(frozen=True, kw_only=True)
class PairResidualFit:
    """The pair with a left–right term: scales by restricted maximum likelihood, other parameters for given scales.

    Parameters
    ----------
    shared : array (P,)
        Parameters in the order of ``view_blocks.shared_names``.
    covariance : array (P, P)
        Covariance of the shared parameters with poses and motions marginalised, for given scales and board shape.
    noise_px : float
        Standard deviation of one coordinate [px]; if views differ, their root mean square.
    motion_scale : float
        Standard deviation of the translation between the exposures, per axis [m].
    lever : float
        Ratio of the standard deviation of the translation to that of the rotation [m].
    states : ViewStates
        Most probable poses and motions.
    log_likelihood_gain : float
        Restricted log likelihood minus that of the fit without the term.
    left_rms_px, right_rms_px : float
        Root mean square length per corner of the remaining residuals [px].
    overconfidence : array (P,)
        Ratio of the standard deviation with the term to that without it.
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
    """Mean residuals per view, in which the noise of individual corners averages out.

    Parameters
    ----------
    fit : PairFit
        Bundle adjustment without a left–right term.
    corners : StereoCorners
        The observed corners.
    """
    shape = (len(corners.views), 2, -1, 2)
    total = fit.residuals_px.reshape(shape).sum(axis=2) / corners.present.sum(axis=1)[:, None, None]
    left, right = total[:, 0], total[:, 1]
    return ViewMeans(left=left, right=right, correlation=float(np.corrcoef(left.ravel(), right.ravel())[0, 1]))


def fit_pair_residual(fit: PairFit, corners: StereoCorners, start: PairResidualFit | None = None) -> PairResidualFit:
    """Fit the pair again with a small board motion between the exposures of each view.

    Parameters
    ----------
    fit : PairFit
        Bundle adjustment without the term.
    corners : StereoCorners
        The observed corners.
    start
        An earlier fit, to corners with another noise or another warp, from which to start.

    Returns
    -------
    PairResidualFit
        Scales by restricted maximum likelihood (D. Harville, J. Am. Stat. Assoc. 72 (1977) 320), so that the
        P + 6 V fitted parameters do not bias the noise. The lever, the ratio of shifts to rotations of the board, is
        fitted with them, under a log-normal prior about the board's radius of gyration.

    Raises
    ------
    NotConvergedError
        The fit does not converge.
    """
    begin = time.perf_counter()
    radius = gyration_radius(corners)
    if start is None:
        shared, noise, lever = fit.shared, fit.noise_px, radius
        states = ViewStates(poses=fit.poses, motions=np.zeros_like(fit.poses))
    else:
        shared, noise, lever, states = start.shared, start.noise_px, start.lever, start.states
    compressed = compress_views(shared, states, corners, lever)
    without = compressed.restricted_log_likelihood(fit.noise_px, 0.0)
    for _ in range(_MOST_LINEARISATIONS):
        noise, scale, factor = _best_scales(compressed, noise, lever / radius)
        compressed, lever = compressed.with_lever(factor), factor * lever
        information, gradient = compressed.information(noise, scale)
        step = np.linalg.solve(information, gradient)
        shared = shared + step
        states = replace(states, motions=states.motions * np.array([*[factor] * 3, *[1.0] * 3]))
        states = settle_views(shared, states, corners, lever, noise_px=noise, motion_scale=scale)
        compressed = compress_views(shared, states, corners, lever)
        if step @ information @ step < LAST_STEP:
            return _result(fit, corners, compressed, states, lever, noise, scale, without, begin)
    raise NotConvergedError(
        "the fit with a left–right term does not converge",
        value=f"{_MOST_LINEARISATIONS} linearisations",
        limit="a last step below 0.003 standard deviations",
        remedy="add views, because the shared parameters are too uncertain to linearise",
    )


def inverse_information(information: FloatArray) -> FloatArray:
    """Inverse of a regular information matrix, computed after scaling it to a unit diagonal."""
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
        log_likelihood_gain=compressed.restricted_log_likelihood(noise, scale) - without,
        left_rms_px=float(np.sqrt(np.sum(left**2) / corners.corner_count)),
        right_rms_px=float(np.sqrt(np.sum(right**2) / corners.corner_count)),
        overconfidence=np.sqrt(np.diag(covariance) / np.diag(fit.covariance)),
        seconds=time.perf_counter() - begin,
    )


def _best_scales(compressed: CompressedViews, noise_px: float, stretch: float) -> tuple[float, float, float]:
    """Noise and motion scale with the highest restricted likelihood, and the factor by which the lever changes.

    Starts from a noise [px], and from the motion scale that explains the rows that depend on motion: close to zero, no
    slope would lead away. The stretch is the current ratio of the lever to the radius of gyration.
    """
    explains = np.sqrt(np.mean(compressed.motion_rows[..., -1] ** 2 / compressed.motion_gains))

    def likelihood(logs: FloatArray) -> LocalLikelihood:
        noise, scale, factor = np.exp(logs)
        found = compressed.restricted_likelihood(noise, scale, factor)
        unusual = (np.log(stretch) + logs[2]) / _LEVER_DEVIATION
        return LocalLikelihood(
            value=found.value - 0.5 * float(unusual**2),
            gradient=found.gradient - np.array([0.0, 0.0, unusual / _LEVER_DEVIATION]),
            information=found.information + np.diag([0.0, 0.0, _LEVER_DEVIATION**-2]),
        )

    found = maximise(likelihood, np.array([np.log(noise_px), np.log(explains), 0.0]), _SCALES_SETTLED)
    noise, scale, factor = np.exp(found)
    return float(noise), float(scale), float(factor)
