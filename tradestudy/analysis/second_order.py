"""How far a linear model of normal errors misses the exact distribution of depth, from the model's curvature."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.analysis.depth_distribution import DepthDistribution
from tradestudy.analysis.depth_draws import fixed_errors, read_draws, uncertain_groups
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.distributions import Normal
from tradestudy.uncertainty.evaluation import depth_from_inverse
from tradestudy.uncertainty.joint import GaussianCopula, JointDraws, JointNormal
from tradestudy.uncertainty.sources import Source, Sources

_STEP: Final = 1e-2  # standard deviations, for the gradient
_FARTHEST: Final = 9.0  # standard deviations; the probability beyond is below 1e-18
_SECTIONS: Final = 16
_ROUNDS: Final = 2  # to 0.07 standard deviations, with linear interpolation within these
# Quantiles shift by more than the curvature's change of mean and variance; draws show up to 2.6 times that.
_MARGIN: Final = 3.0

Reader = Callable[[FloatArray], FloatArray]
"""Inverse depth [1/m] at scores (dimensions, points, distances or 1), shape (points, distances)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SecondOrder:
    """The distribution to second order, over distances.

    Parameters
    ----------
    steepest
        Quantiles of depth along the steepest direction of all errors, evaluated exactly; a single scramble.
    across
        Share of a half width by which the curvature across that direction could widen or narrow it.
    """

    steepest: DepthDistribution
    across: FloatArray


def second_order(
    camera: DepthCamera, distance: FloatArray, field: float, way: str, *, any_shape: bool = False
) -> SecondOrder | None:
    """Evaluate depth exactly along the direction of the errors that moves it most, and its curvature across.

    In standard deviations of independent normal errors, inverse depth is ``h(z) = h₀ + g·z + ½ zᵀKz``. Its quantiles
    are those along g (first-order reliability); the curvature K across g shifts them by ``½ tr K`` and adds
    ``½ ‖K‖²`` to the variance, and mixed curvature along and across adds ``Σ d²``.

    Parameters
    ----------
    camera
        The camera with its exact model and its errors.
    distance
        True distances [m] where the camera forms an image.
    field
        Field position.
    way
        The errors considered: ``noise``, ``calibration`` or ``both``.
    any_shape
        Whether to treat errors of other shapes through their normal scores; the result then only distinguishes a large
        error of the linear model from a small one.

    Returns
    -------
    SecondOrder | None
        None if an error is not normal: then only draws give the error.
    """
    groups = uncertain_groups(camera, way)
    if not all(_is_normal(group) or (any_shape and not isinstance(group, JointDraws)) for group in groups):
        return None
    sources = Sources(groups=groups)
    count = sources.dimensions

    def read(scores: FloatArray) -> FloatArray:
        spread = np.broadcast_to(scores, (count, scores.shape[1], distance.size))
        drawn = sources.draw(spread.reshape(count, -1))
        values = {name: one.reshape(spread.shape[1:]) if one.size > 1 else one for name, one in drawn.items()}
        return read_draws(
            camera, {**fixed_errors(camera, way), **values}, distance, field, camera.noise(distance, field)
        )

    axes = np.eye(count)[:, :, np.newaxis]
    above, below = _read_together(read, _STEP * axes, -_STEP * axes)
    gradient = (above - below) / (2.0 * _STEP)
    length = np.linalg.norm(gradient, axis=0)
    steepest = np.divide(gradient, length, out=np.zeros_like(gradient), where=length > 0.0)
    return SecondOrder(
        steepest=_along(camera, read, steepest),
        across=_across(read, steepest, length) if count > 1 else np.zeros(distance.shape),
    )


def all_normal(camera: DepthCamera) -> bool:
    """Whether every error of a camera is normal, so that second order describes its depth."""
    return all(map(_is_normal, uncertain_groups(camera, "both")))


def _is_normal(group: object) -> bool:
    if isinstance(group, GaussianCopula):
        return all(isinstance(one, Normal) for one in group.marginals)
    return isinstance(group, JointNormal) or (isinstance(group, Source) and isinstance(group.distribution, Normal))


def _read_together(read: Reader, *scores: FloatArray) -> list[FloatArray]:
    """Evaluate several sets of scores in one call, which takes hardly longer than one set alone."""
    ends = np.cumsum([one.shape[1] for one in scores])
    return np.split(read(np.concatenate(scores, axis=1)), ends[:-1])


def _along(camera: DepthCamera, read: Reader, steepest: FloatArray) -> DepthDistribution:
    from scipy.special import ndtr, ndtri

    probabilities = camera.propagation.probabilities
    scores = -ndtri(np.array(probabilities))
    inverse = read(scores[np.newaxis, :, np.newaxis] * steepest[:, np.newaxis])
    depths = np.where(np.isnan(inverse).any(axis=0), np.nan, depth_from_inverse(inverse))

    def failures() -> FloatArray:
        place = np.arange(steepest.shape[1])
        low, high = np.full((2, place.size), [[-_FARTHEST], [_FARTHEST]])
        for _ in range(_ROUNDS):
            searched = low + np.linspace(0.0, 1.0, _SECTIONS + 1)[:, np.newaxis] * (high - low)
            found = read(searched * steepest[:, np.newaxis])
            # Inverse depth rises along the steepest direction, so failures lie below one score.
            last = np.sum(~(found > 0.0), axis=0) - 1
            row = np.clip(last, 0, _SECTIONS - 1)
            low, high = searched[row, place], searched[row + 1, place]
        below, above = found[row, place], found[row + 1, place]
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.nan_to_num(np.clip(-below / (above - below), 0.0, 1.0))
        score = low + share * (high - low)
        lost = np.where(last < 0, 0.0, np.where(last >= _SECTIONS, 1.0, ndtr(score)))
        return np.asarray(np.where(np.isnan(inverse).any(axis=0), np.nan, lost)[np.newaxis])

    return DepthDistribution(probabilities=probabilities, quantiles=depths[np.newaxis], failures=failures)


def _across(read: Reader, steepest: FloatArray, length: FloatArray) -> FloatArray:
    # Orthonormal vectors perpendicular to each direction, shape (dimensions, others, distances).
    basis = np.moveaxis(np.linalg.svd(steepest.T[:, np.newaxis])[2][:, 1:], 0, 2).swapaxes(0, 1)
    first, second = np.triu_indices(basis.shape[1], k=1)
    ahead = steepest[:, np.newaxis]
    origin, along, above, below, both, pairs = _read_together(
        read, np.zeros_like(ahead), ahead, basis, -basis, basis + ahead, basis[:, first] + basis[:, second]
    )
    curvature = above + below - 2.0 * origin
    bent = both - above - along + origin
    mixed = pairs - above[first] - above[second] + origin
    with np.errstate(invalid="ignore", divide="ignore"):
        squares = 0.5 * np.sum(curvature**2, axis=0) + np.sum(mixed**2, axis=0) + np.sum(bent**2, axis=0)
        wider = squares / length**2 / 2.0
        shifted = np.abs(np.sum(curvature, axis=0)) / np.abs(origin[0])  # an interval of depth goes with 1/h²
    return np.asarray(np.nan_to_num(_MARGIN * (wider + shifted), nan=np.inf, posinf=np.inf))
