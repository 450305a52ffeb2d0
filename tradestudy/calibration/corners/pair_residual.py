"""A pair with a left–right term per view, which explains why the pair fits worse than its single cameras.

The board moves a little between the two exposures of a view (or something else has the same effect): the right camera
sees the corners displaced by a small rigid motion, with translations N(0, τ²) per axis and rotations N(0, (τ/lever)²).
If the lever is the board's radius of gyration, both displace the corners equally.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tradestudy.calibration.corners.bundle_adjustment import PairFit
from tradestudy.calibration.corners.corner_file import StereoCorners
from tradestudy.calibration.corners.corner_noise import LocalLikelihood, average_information, maximise
from tradestudy.calibration.corners.view_blocks import (
    pair_blocks,
    shared_names,
    state_blocks,
)
from tradestudy.calibration.laplace import covariance_from_information, triangular_factor
from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import FloatArray, IndexArray

_MOST_STEPS: Final = 20
LAST_STEP: Final = 1e-5
"""Square of the last Gauss–Newton step, in standard deviations; another would be far shorter."""


@dataclass(frozen=True, kw_only=True)
class ViewStates:
    """Parameters of each view: the pose of its board, and its left–right motion.

    Parameters
    ----------
    poses : array (V, 6)
        Poses from board to left camera [rad, m].
    motions : array (V, 6)
        Rotation × lever and translation between the exposures, in the right camera's frame [m].
    """

    poses: FloatArray
    motions: FloatArray


@dataclass(frozen=True, kw_only=True)
class CompressedViews:
    """Linearised views, reduced to the numbers that the likelihood needs, with poses and motions integrated out.

    Parameters
    ----------
    centre : array (P,)
        Shared parameters at which the views were linearised.
    motion_rows : array (V, 6, P + 1)
        Rows that depend on the motion: derivatives with respect to the shared parameters, followed by the residual.
    motion_gains : array (V, 6)
        Variance of each of these rows for unit motion scale [px²/m²].
    motion_columns : array (V, 6, 6)
        Derivatives of these rows with respect to the motion [px/m].
    view_rests : array (V, P + 1, P + 1)
        Triangular factor of all other rows of each view, with the same columns.
    rest : array (P + 1, P + 1)
        The same for all views together.
    view_counts : int array (V,)
        Number of other rows of each view.
    """

    centre: FloatArray
    motion_rows: FloatArray
    motion_gains: FloatArray
    motion_columns: FloatArray
    view_rests: FloatArray
    rest: FloatArray
    view_counts: IndexArray

    @property
    def rest_count(self) -> int:
        """Number of other rows of all views."""
        return int(self.view_counts.sum())

    def of(self, views: IndexArray) -> CompressedViews:
        """A selection of the views."""
        return CompressedViews(
            centre=self.centre,
            motion_rows=self.motion_rows[views],
            motion_gains=self.motion_gains[views],
            motion_columns=self.motion_columns[views],
            view_rests=self.view_rests[views],
            rest=_stacked(self.view_rests[views]),
            view_counts=self.view_counts[views],
        )

    def with_lever(self, factor: float) -> CompressedViews:
        """The same views with the lever multiplied by a factor; a longer lever means less rotation."""
        columns = self.motion_columns / np.array([*[factor] * 3, *[1.0] * 3])
        turn, gains, _ = np.linalg.svd(columns)
        back = np.swapaxes(turn, -1, -2)
        return replace(self, motion_rows=back @ self.motion_rows, motion_gains=gains**2, motion_columns=back @ columns)

    def log_likelihood(self, shared: FloatArray, noise_px: FloatArray, motion_scale: FloatArray) -> FloatArray:
        """Log of the marginal likelihood, up to a constant.

        Parameters
        ----------
        shared : array (..., P)
            Shared parameters.
        noise_px : array (...)
            Standard deviation of one coordinate [px].
        motion_scale : array (...)
            Standard deviation of the motion [m]; zero switches the term off.

        Returns
        -------
        array (...)
            Natural logarithm.
        """
        step = np.concatenate([self.centre - shared, np.ones_like(shared[..., :1])], axis=-1)
        rows = self.motion_rows.reshape(-1, step.shape[-1])
        variance = noise_px[..., None] ** 2 + motion_scale[..., None] ** 2 * self.motion_gains.ravel()
        # residual(θ) = r₀ + A (centre − θ)
        by_motion = np.sum((step @ rows.T) ** 2 / variance + np.log(variance), axis=-1)
        rest = np.sum((step @ self.rest.T) ** 2, axis=-1) / noise_px**2
        total: FloatArray = -0.5 * (by_motion + rest) - self.rest_count * np.log(noise_px)
        return total

    def restricted_log_likelihood(self, noise_px: float, motion_scale: float) -> float:
        """Log likelihood of the scales, up to a constant, with the shared parameters integrated out under a flat prior.

        Parameters
        ----------
        noise_px, motion_scale : float
            Standard deviations of a coordinate [px] and of the motion [m]; a motion of zero switches the term off.
        """
        return self.restricted_likelihood(noise_px, motion_scale).value

    def restricted_likelihood(self, noise_px: float, motion_scale: float, stretch: float = 1.0) -> LocalLikelihood:
        """That log likelihood, with derivatives by the logarithms of noise, motion scale and stretch.

        Parameters
        ----------
        noise_px, motion_scale : float
            As for `restricted_log_likelihood`.
        stretch : float
            Factor by which the lever is multiplied, as for `with_lever`.
        """
        columns = self.motion_columns * (motion_scale / np.array([*[stretch] * 3, *[1.0] * 3]))
        moved, turned = (part @ np.swapaxes(part, -1, -2) for part in (columns, columns[..., :3]))
        independent = noise_px**2 * np.eye(6)
        factor = np.linalg.cholesky(moved + independent)
        whitening = np.linalg.inv(factor)
        rows = (whitening @ self.motion_rows).reshape(-1, self.rest.shape[-1])
        table = np.concatenate([rows, self.rest / noise_px])
        basis, triangle = np.linalg.qr(table[:, :-1])
        residual = table[:, -1] - basis @ (basis.T @ table[:, -1])
        volume = np.log(np.abs(np.diagonal(triangle))).sum() + np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum()
        # The whitened covariance of the remaining rows, of which only the noise changes the scale, is the identity.
        changes = 2.0 * (
            whitening @ np.stack(np.broadcast_arrays(independent, moved, -turned)) @ np.swapaxes(whitening, -1, -2)
        )
        of_rest = np.array([2.0, 0.0, 0.0])
        traces = np.trace(changes, axis1=-2, axis2=-1).sum(axis=-1) + of_rest * self.rest_count

        def changed(values: FloatArray) -> FloatArray:
            seen = changes @ values[: len(rows)].reshape(-1, 6, values.shape[-1])
            rest = of_rest[:, None, None] * values[len(rows) :]
            return np.concatenate([seen.reshape(3, len(rows), -1), rest], axis=1)

        transformed = changed(np.concatenate([basis, residual[:, None]], axis=1))
        free = traces - np.einsum("rp,irp->i", basis, transformed[..., :-1])
        return LocalLikelihood(
            value=float(-volume - 0.5 * residual @ residual - self.rest_count * np.log(noise_px)),
            gradient=-0.5 * (free - transformed[..., -1] @ residual),
            information=average_information(basis[None], transformed[:, None, :, -1]),
        )

    def information(self, noise_px: float, motion_scale: float) -> tuple[FloatArray, FloatArray]:
        """Information matrix of the shared parameters, and its product with the step to their optimum.

        Parameters
        ----------
        noise_px, motion_scale : float
            Standard deviations of a coordinate [px] and of the motion [m].

        Returns
        -------
        information : array (P, P)
            Inverse covariance of the shared parameters, given both scales.
        gradient : array (P,)
            Solve ``information @ step = gradient`` for the step from ``centre`` to the optimum.
        """
        weight = 1.0 / (noise_px**2 + motion_scale**2 * self.motion_gains)
        full = np.einsum("vk,vki,vkj->ij", weight, self.motion_rows, self.motion_rows)
        full = full + self.rest.T @ self.rest / noise_px**2
        return full[:-1, :-1], full[:-1, -1]


def gyration_radius(corners: StereoCorners) -> float:
    """Root mean square distance of the corners from the board's centre [m], averaged over the views."""
    weight = corners.present[..., None] / corners.present.sum(axis=1)[:, None, None]
    centre = (corners.board * weight).sum(axis=1, keepdims=True)
    return float(np.sqrt(((corners.board - centre) ** 2 * weight).sum() / len(corners.views)))


def compress_views(
    shared: FloatArray,
    states: ViewStates,
    corners: StereoCorners,
    lever: float,
    *,
    extra: FloatArray | None = None,
) -> CompressedViews:
    """Linearise the views and reduce them by orthogonal transformations, view by view.

    Parameters
    ----------
    shared : array (P,)
        Shared parameters at which to linearise, in the order of ``view_blocks.shared_names``.
    states : ViewStates
        Poses and motions at which to linearise (see ``settle_views``).
    corners : StereoCorners
        The observed corners.
    lever : float
        Radius that converts rotations into displacements [m].
    extra : array (V, 4 N, E)
        Derivatives with respect to additional parameters, whose values are zero where the views are linearised.

    Returns
    -------
    CompressedViews
        Exact for the linearised model: the QR factorisation of [poses | motions | shared | residual] preserves all
        inner products, and the rows of the poses drop out when poses are integrated out under a flat prior.
    """
    residuals, by_states = state_blocks(shared, states.poses, corners, lever)
    by_shared = pair_blocks(shared, states.poses, corners).by_shared
    if extra is not None:
        by_shared = np.concatenate([by_shared, extra], axis=-1)
        shared = np.concatenate([shared, np.zeros(extra.shape[-1])])
    table = np.concatenate([by_states, by_shared, residuals[..., None]], axis=-1)
    triangle = triangular_factor(table)
    # Only the first six rows depend on the pose of a view, which fits them exactly: they tell nothing else.
    motion, rows = triangle[:, 6:12, 6:12], triangle[:, 6:12, 12:]
    turn, gains, _ = np.linalg.svd(motion)
    back = np.swapaxes(turn, -1, -2)
    return CompressedViews(
        centre=shared,
        motion_rows=back @ rows,
        motion_gains=gains**2,
        motion_columns=back @ motion,
        view_rests=triangle[:, 12:, 12:],
        rest=_stacked(triangle[:, 12:, 12:]),
        view_counts=4 * corners.present.sum(axis=1) - 12,
    )


def _stacked(triangles: FloatArray) -> FloatArray:
    """Triangular factor of the rows of all these triangular matrices."""
    return triangular_factor(triangles.reshape(-1, triangles.shape[-1]))


def settle_views(
    shared: FloatArray,
    states: ViewStates,
    corners: StereoCorners,
    lever: float,
    *,
    noise_px: float,
    motion_scale: float,
) -> ViewStates:
    """Most probable poses and motions of all views for given shared parameters, by Gauss–Newton steps.

    Parameters
    ----------
    shared : array (P,)
        Shared parameters.
    states : ViewStates
        Starting values.
    corners : StereoCorners
        The observed corners.
    lever : float
        Radius that converts rotations into displacements [m].
    noise_px, motion_scale : float
        Standard deviations of a coordinate [px] and of the motion [m], both > 0.

    Returns
    -------
    ViewStates
        Poses and motions, converged to less than 1e-3 standard deviations in every view.

    Raises
    ------
    NotConvergedError
        A view does not converge.
    """
    for _ in range(_MOST_STEPS):
        residuals, by_states = _moved_blocks(shared, states, corners, lever)
        hessian, gradient = _state_equations(residuals, by_states, states, noise_px, motion_scale)
        step = np.linalg.solve(hessian, gradient[..., None])[..., 0]
        states = ViewStates(poses=states.poses + step[:, :6], motions=states.motions + step[:, 6:])
        if np.max(np.einsum("vi,vij,vj->v", step, hessian, step)) < LAST_STEP:
            return states
    raise NotConvergedError(
        "the board pose of a view does not converge",
        value=f"{_MOST_STEPS} steps",
        limit="a last step below 0.003 standard deviations",
        remedy="remove views that contradict the others, or that show few corners",
    )


def exact_log_likelihood(
    shared: FloatArray,
    states: ViewStates,
    corners: StereoCorners,
    lever: float,
    *,
    noise_px: float,
    motion_scale: float,
) -> float:
    """Log of the Laplace marginal likelihood, with poses and motions refitted for these parameters, up to a constant.

    The constant differs from that of ``CompressedViews.log_likelihood`` by the volume of the poses, so that only
    differences between parameters are comparable.

    Parameters
    ----------
    shared, states, corners, lever, noise_px, motion_scale
        As for ``settle_views``.

    Returns
    -------
    float
        Natural logarithm: −χ²/2 − n ln σ − 6 V ln τ − ½ ln det H, with H the Gauss–Newton Hessian per view.
    """
    states = settle_views(shared, states, corners, lever, noise_px=noise_px, motion_scale=motion_scale)
    residuals, by_states = _moved_blocks(shared, states, corners, lever)
    hessian, _ = _state_equations(residuals, by_states, states, noise_px, motion_scale)
    square = np.sum(residuals**2) / noise_px**2 + np.sum(states.motions**2) / motion_scale**2
    volume = np.linalg.slogdet(hessian)[1].sum()
    scales = 4 * corners.corner_count * np.log(noise_px) + states.motions.size * np.log(motion_scale)
    return float(-0.5 * (square + volume) - scales)


def _moved_blocks(
    shared: FloatArray, states: ViewStates, corners: StereoCorners, lever: float
) -> tuple[FloatArray, FloatArray]:
    """Residuals with the motions of the views, and their derivatives with respect to (pose, motion)."""
    residuals, by_states = state_blocks(shared, states.poses, corners, lever)
    return residuals - (by_states[..., 6:] @ states.motions[..., None])[..., 0], by_states


def _state_equations(
    residuals: FloatArray,
    by_states: FloatArray,
    states: ViewStates,
    noise_px: float,
    motion_scale: float,
) -> tuple[FloatArray, FloatArray]:
    """Normal equations for (pose, motion) of every view, including the prior of the motion."""
    transposed = np.swapaxes(by_states, -1, -2)
    hessian = transposed @ by_states / noise_px**2
    hessian[:, range(6, 12), range(6, 12)] += 1.0 / motion_scale**2
    gradient = (transposed @ residuals[..., None])[..., 0] / noise_px**2
    gradient[:, 6:] -= states.motions / motion_scale**2
    return hessian, gradient


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
        # Rotations are stored as displacements at the lever, which has changed.
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
    left, right = np.split(_moved_blocks(compressed.centre, states, as_seen, lever)[0], 2, axis=1)
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
        restricted = compressed.restricted_likelihood(noise, scale, factor)
        unusual = (np.log(stretch) + logs[2]) / _LEVER_DEVIATION
        return LocalLikelihood(
            value=restricted.value - 0.5 * float(unusual**2),
            gradient=restricted.gradient - np.array([0.0, 0.0, unusual / _LEVER_DEVIATION]),
            information=restricted.information + np.diag([0.0, 0.0, _LEVER_DEVIATION**-2]),
        )

    best = maximise(likelihood, np.array([np.log(noise_px), np.log(explains), 0.0]), _SCALES_SETTLED)
    noise, scale, factor = np.exp(best)
    return float(noise), float(scale), float(factor)
