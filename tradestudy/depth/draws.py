"""A linear control variate for inverse depth: its quantiles are known, so its sampling error corrects that of depth."""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.calibration import Calibration, Propagation
from tradestudy.cameras.depth_camera import DepthCamera, false_match_share
from tradestudy.cameras.depth_measurement import PIXEL_NOISE, Field, FieldPosition, MeasuredInverseDepth
from tradestudy.depth.distribution import FARTHEST_SCORE, DepthDistribution, share_of_true_matches, without_rounding
from tradestudy.depth.remembered import remembered
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.distributions import Normal
from tradestudy.uncertainty.evaluation import Model, ScoreAlignment, alignment_with, depth_from_inverse
from tradestudy.uncertainty.joint import JointDraws
from tradestudy.uncertainty.outputs import order_quantile, quantiles_of, ranked_quantiles, valley_quantile
from tradestudy.uncertainty.sources import CALIBRATION, NOISE, ErrorClass, Group, Source, Sources
from tradestudy.uncertainty.streams import each_scramble, scramble_scores

_FIT_DRAWS: Final = 2**14  # draws used to fit the line
_ROWS: Final = 512  # quantiles that represent the rows of a posterior
_BISECTIONS: Final = 30
_WIDER: Final = 4.0  # times the largest sampled radius; the exact one is smaller
_ALIKE: Final = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class Drivers:
    """The variables that the line for inverse depth depends on.

    Parameters
    ----------
    scores
        Standard normal scores of each draw, shape (scores, draws).
    responses
        For each draw, the effect of its posterior row on inverse depth from near to far, shape (directions, draws);
        empty without a posterior.
    rows
        The same effect for every row of the posterior, shape (directions, rows).
    """

    scores: FloatArray
    responses: FloatArray
    rows: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class SamplingError:
    """Sampling errors, in each scramble, of the line's quantiles, share at or beyond infinity, and radius of error [m].

    Shapes (scrambles, probabilities, distances) for the quantiles, otherwise (scrambles, distances).
    """

    quantiles: FloatArray
    failed: FloatArray
    radius: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Within:
    """The share of draws that a radius about the true distances [m] contains."""

    distance: FloatArray
    share: float

    def radius(self, ascending: FloatArray) -> FloatArray:
        """Radius [m] of sorted draws of inverse depth (distances, draws); those without one are infinitely wrong."""
        if self.share >= 1.0:
            return np.full(self.distance.shape, np.inf)
        wrong = np.abs(depth_from_inverse(ascending) - self.distance[:, np.newaxis])
        return without_rounding(valley_quantile(np.where(np.isnan(wrong), np.inf, wrong), self.share), self.distance)


def sampling_error(
    inverse: FloatArray, drivers: Drivers, scrambles: int, probabilities: FloatArray, within: Within
) -> SamplingError:
    """Sampling error, in each scramble, of quantiles, failed share and radius of a line fitted to inverse depth.

    Parameters
    ----------
    inverse
        Inverse depths of all draws, shape (distances, draws); no line is fitted at distances with a NaN.
    drivers
        The variables of the line, which is fitted by least squares.
    scrambles
        Number of scrambles, which follow one another in the draws.
    probabilities
        Probabilities of the quantiles.
    within
        The true distances, and the share of draws within the radius.
    """
    variables = np.concatenate([drivers.scores, drivers.responses])
    # At zero inverse depth everywhere, the line has no slopes and corrects nothing.
    ranked = np.where(np.isnan(inverse).any(axis=1, keepdims=True), 0.0, inverse)
    slopes = _slopes(ranked, variables)
    of_scores, of_rows = slopes[:, : len(drivers.scores)], slopes[:, len(drivers.scores) :]
    deviation = np.linalg.norm(of_scores, axis=1)
    rows = of_rows @ drivers.rows
    exact, lines = _quantiles_of_line(rows, deviation, probabilities), np.split(slopes @ variables, scrambles, axis=1)
    # The line has slopes but no constant term: the means of the draws and of the line, which is not zero if that of a
    # posterior is not, place infinity and the true distance on it.
    middle = ranked.mean(axis=1, keepdims=True) - np.mean(lines, axis=(0, 2))[:, np.newaxis]
    infinity = -middle
    beyond = _share_below(rows, deviation, infinity)
    lines = [np.sort(line, axis=1) for line in lines]
    radii = np.stack([within.radius(middle + line) for line in lines])
    return SamplingError(
        quantiles=np.stack([order_quantile(line, probabilities) - exact for line in lines]),
        failed=np.stack([np.mean(line <= infinity, axis=1) - beyond for line in lines]),
        radius=_error_of_radii(radii, within, rows, deviation, middle),
    )


def _error_of_radii(
    radii: FloatArray, within: Within, rows: FloatArray, deviation: FloatArray, middle: FloatArray
) -> FloatArray:
    """Sampled radii (scrambles, distances) of a line about its middle [1/m], less the exact ones; 0 where infinite."""
    finite, distance = np.isfinite(radii), within.distance[:, np.newaxis]
    low, high = np.zeros(distance.shape), _WIDER * np.max(np.where(finite, radii, 0.0), axis=0)[:, np.newaxis]
    kept = rows if rows.shape[1] <= _ROWS else quantiles_of(rows, (np.arange(_ROWS) + 0.5) / _ROWS).T
    for _ in range(_BISECTIONS):
        radius = 0.5 * (low + high)
        with np.errstate(divide="ignore"):
            nearest = 1.0 / np.maximum(distance - radius, 0.0)  # infinite where the radius reaches the camera
        near, far = (_share_below(kept, deviation, end - middle) for end in (nearest, 1.0 / (distance + radius)))
        below = (near - far)[:, np.newaxis] < within.share
        low, high = np.where(below, radius, low), np.where(below, high, radius)
    return np.where(finite, radii, 0.0) - np.where(finite, 0.5 * (low + high)[:, 0], 0.0)


def _slopes(inverse: FloatArray, variables: FloatArray) -> FloatArray:
    fitted = slice(None, None, max(1, variables.shape[1] // _FIT_DRAWS))
    # Centred variables are orthogonal to constants, so that inverse depth need not be centred.
    centred = variables[:, fitted] - variables[:, fitted].mean(axis=1, keepdims=True)
    size = np.linalg.norm(centred, axis=1, keepdims=True)
    unit = centred / np.where(size > 0.0, size, 1.0)
    # Directions of a posterior are nearly parallel: in orthonormal combinations, rounding stays rounding, whichever
    # distances are computed together. Combinations that the draws cannot distinguish are left out.
    lengths, axes = np.linalg.eigh(unit @ unit.T)
    kept = lengths > _ALIKE * lengths.max(initial=0.0)
    combined = axes[:, kept] / np.sqrt(lengths[kept])
    return np.asarray((inverse[:, fitted] @ (combined.T @ unit).T) @ combined.T / np.where(size > 0.0, size, 1.0)[:, 0])


def _share_below(rows: FloatArray, deviation: FloatArray, limit: FloatArray) -> FloatArray:
    """Probability that a row plus a normal error is at most a limit; all ``rows`` (distances, rows) weigh the same."""
    from scipy.special import ndtr

    centres = rows if rows.shape[1] else np.zeros_like(limit)
    spread = deviation[:, None]
    smooth = ndtr((limit - centres) / np.where(spread > 0.0, spread, 1.0))
    return np.asarray(np.mean(np.where(spread > 0.0, smooth, centres <= limit), axis=1))


def _quantiles_of_line(rows: FloatArray, deviation: FloatArray, probabilities: FloatArray) -> FloatArray:
    """Quantiles (probabilities, distances) of a row plus a normal error; all ``rows`` weigh the same."""
    from scipy.special import ndtr, ndtri

    if not rows.shape[1]:
        return np.asarray(ndtri(probabilities)[:, None] * deviation)
    ascending = np.sort(rows, axis=1)
    if not np.any(deviation > 0.0):
        return order_quantile(ascending, probabilities)
    middle = order_quantile(ascending, (np.arange(_ROWS) + 0.5) / _ROWS)
    scale = np.where(deviation > 0.0, deviation, np.finfo(float).tiny)  # without a normal error, Φ becomes a step
    p = probabilities[:, None]
    low = np.broadcast_to(middle[0] - FARTHEST_SCORE * deviation, (probabilities.size, deviation.size))
    high = np.broadcast_to(middle[-1] + FARTHEST_SCORE * deviation, low.shape)
    for _ in range(_BISECTIONS):
        x = 0.5 * (low + high)
        below = np.mean(ndtr((x - middle[:, None]) / scale), axis=0) < p
        low, high = np.where(below, x, low), np.where(below, high, x)
    return np.asarray(0.5 * (low + high))


SCRAMBLES: Final = 8
"""With fewer independent scrambles the standard error would not be trustworthy."""
CLASSES: Final[Mapping[str, tuple[ErrorClass, ...]]] = {
    "noise": NOISE,
    "calibration": CALIBRATION,
    "both": (*NOISE, *CALIBRATION),
}
_FIRST_DRAWS: Final = 2**8  # of each scramble
_TRIAL_ROUNDS: Final = 4  # times as many draws as the first ones
_DIRECTIONS: Final = 6  # distances at which the effect of a posterior on depth is evaluated
_MANY_DRAWS: Final = 2**13  # per scramble; from here on scrambles are drawn on several threads
_AT_ONCE: Final = 2**14  # depths that fit into a processor's cache
_WORTH_THREADS: Final = 2**18  # depths; fewer are computed before a thread has started
_OF_FOCAL_LENGTH: Final = (10.0, 100.0, 1000.0)  # distances in focal lengths, if no judged one forms an image


class MeasuresDepth(Protocol):
    """What propagation needs from a camera."""

    def __hash__(self) -> int:
        """Hash of all properties of the camera; draws are cached by it."""

    @property
    def calibration(self) -> Calibration:
        """All that is uncertain about it, except noise."""

    @property
    def propagation(self) -> Propagation:
        """How these uncertainties are propagated."""

    @property
    def sample_pitch(self) -> float:
        """[m]."""

    def noise(self, distance: ArrayLike, field: FieldPosition = 0.0) -> FloatArray:
        """See `DepthCamera.noise`."""

    def measured_depth(
        self, distance: FloatArray, field: Field, values: Mapping[str, FloatArray]
    ) -> MeasuredInverseDepth:
        """See `DepthCamera.measured_depth`."""


def noise_group() -> Source:
    """The noise of one measurement, as a standard normal score in units of the camera's own noise."""
    score = Normal(mean=0.0, standard_deviation=1.0)
    return Source(name=PIXEL_NOISE, distribution=score, error_class=ErrorClass.MEASUREMENT)


def uncertain_groups(camera: MeasuresDepth, error_source: str) -> tuple[Group, ...]:
    """The errors to draw: noise, calibration, or both; those of a calibration and of its ageing never average out."""
    noise = (noise_group(),) if ErrorClass.MEASUREMENT in CLASSES[error_source] else ()
    return (*noise, *(camera.calibration.groups if error_source != "noise" else ()))


def fixed_errors(camera: MeasuresDepth, error_source: str) -> dict[str, FloatArray]:
    """The errors that are not drawn but have a mean other than zero."""
    held = camera.calibration.groups if error_source == "noise" else ()
    means = {name: mean for group in held for name, mean in zip(group.parameters, group.nominal, strict=True)}
    return {name: np.full((1, 1), mean) for name, mean in means.items() if mean != 0.0}


def read_draws(
    camera: MeasuresDepth,
    values: Mapping[str, FloatArray],
    distance: FloatArray,
    field: FieldPosition,
    noise: FloatArray,
) -> FloatArray:
    """Inverse depths [1/m] measured at distances [m] with drawn errors (draws, 1); NaN where a draw gives no depth.

    ``noise`` [m on the sensor] is the standard deviation of the disparity at each distance; the result has shape
    (draws, distances).
    """
    errors = dict(values)
    if PIXEL_NOISE in errors:
        errors[PIXEL_NOISE] = errors[PIXEL_NOISE] * noise
    measured = camera.measured_depth(distance, field, errors)
    return np.where(measured.no_overlap | measured.out_of_range, np.nan, measured.inverse_depth)


@lru_cache(maxsize=128)
def uncertain_sources(camera: DepthCamera, error_source: str, field: FieldPosition = 0.0) -> Sources:
    """See `uncertain_groups`; joint draws are ordered by their effect on depth at a field position."""
    groups = (
        replace(group, along=_responses(camera, group, field)[[0, -1]]) if isinstance(group, JointDraws) else group
        for group in uncertain_groups(camera, error_source)
    )
    return Sources(groups=tuple(groups))


def _responses(camera: DepthCamera, group: JointDraws, field: FieldPosition) -> FloatArray:
    """Change of inverse depth with each parameter of joint draws, from the nearest to the farthest visible distance."""
    judged = _judged(camera)
    seen = judged[np.isfinite(nominal_inverse(camera, judged, field))]
    seen = seen if seen.size else judged
    places = seen[np.linspace(0, seen.size - 1, _DIRECTIONS).round().astype(int)]
    deviation = np.std(group.draws, axis=0)
    steps = np.concatenate([np.diag(deviation), -np.diag(deviation)]) + group.nominal
    values = dict(zip(group.parameters, steps.T[:, :, None], strict=True))
    read = read_draws(camera, values, places, field, camera.noise(places, field))
    # Twice the change per deviation: the order of rows and a fitted line ignore a common factor.
    change = np.nan_to_num(read[: deviation.size] - read[deviation.size :]).T
    return np.asarray(np.where(deviation > 0.0, change / np.where(deviation > 0.0, deviation, 1.0), 0.0))


def _requested(camera: DepthCamera) -> FloatArray:
    """Distances [m] where convergence is judged and the camera forms an image."""
    judged = np.array(camera.propagation.judged, dtype=np.float64)
    return np.asarray(judged[camera.images(judged)])


def _judged(camera: DepthCamera) -> FloatArray:
    """The `_requested` distances [m]; if there are none, multiples of the camera's focal length."""
    judged = _requested(camera)
    return judged if judged.size else camera.gathering_lens.focal_length * np.array(_OF_FOCAL_LENGTH)


def _places(camera: DepthCamera) -> FloatArray:
    """The nearest, middle and farthest of the judged distances [m]."""
    judged = _judged(camera)
    return judged[[0, judged.size // 2, -1]]


def inverse_depth_model(
    camera: DepthCamera, distance: FloatArray, field: FieldPosition = 0.0, error_source: str = "both"
) -> Model:
    """The inverse depths [1/m] at distances [m] as a function of the errors, NaN where a draw gives no depth."""
    fixed, noise = fixed_errors(camera, error_source), camera.noise(distance, field)

    def model(values: Mapping[str, FloatArray]) -> FloatArray:
        draws = len(next(iter(values.values()))) if values else 1
        inverse = read_draws(camera, {**fixed, **values}, distance, field, noise)
        return np.broadcast_to(inverse, (draws, distance.size))

    return model


@lru_cache(maxsize=64)
def _alignment(camera: DepthCamera, error_source: str, field: FieldPosition) -> ScoreAlignment:
    return alignment_with(
        [inverse_depth_model(camera, _places(camera), field, error_source)],
        uncertain_sources(camera, error_source, field),
    )


@lru_cache(maxsize=32)
def _drawn(
    camera: DepthCamera, error_source: str, field: FieldPosition, draws: int
) -> tuple[Drivers, dict[str, FloatArray]]:
    """The errors (scrambles · draws, 1) of every scramble, and the variables that determine depth in them.

    The first coordinates of the draws affect depth most.
    """
    sources, alignment = uncertain_sources(camera, error_source, field), _alignment(camera, error_source, field)

    def of_scramble(scramble: int) -> tuple[FloatArray, dict[str, FloatArray]]:
        seed = camera.propagation.seed
        scores = scramble_scores(sources.dimensions, draws, seed=seed, point="depth", scramble=scramble)
        aligned = np.asarray(alignment.apply(scores.copy()))  # in place, while the cache keeps the scores
        return aligned, sources.draw(aligned)

    scrambles = (
        each_scramble(of_scramble, SCRAMBLES) if draws >= _MANY_DRAWS else [of_scramble(k) for k in range(SCRAMBLES)]
    )
    values = {name: np.concatenate([errors[name] for _, errors in scrambles]) for name in scrambles[0][1]}
    scores = np.concatenate([scores for scores, _ in scrambles], axis=1)
    return _drivers(camera, field, sources, scores, values), values


def _drivers(
    camera: DepthCamera, field: FieldPosition, sources: Sources, scores: FloatArray, values: Mapping[str, FloatArray]
) -> Drivers:
    """The scores, with those of a posterior replaced by the effect of its rows on depth."""
    posterior = next((group for group in sources.active_groups if isinstance(group, JointDraws)), None)
    if posterior is None:
        none = np.zeros((0, scores.shape[1]))
        return Drivers(scores=scores, responses=none, rows=np.zeros((0, 0)))
    # Which row a score selects is no smooth function of it, but depth is almost linear in what the row changes.
    drawn = np.concatenate([values[name] for name in posterior.parameters], axis=1)
    along = _responses(camera, posterior, field)
    return Drivers(
        scores=np.delete(scores, sources.coordinates()[posterior.name], axis=0),
        responses=along @ drawn.T,
        rows=along @ posterior.draws.T,
    )


def _read_all(
    camera: DepthCamera, distance: FloatArray, field: FieldPosition, error_source: str, values: Mapping[str, FloatArray]
) -> FloatArray:
    """Inverse depths [1/m] of all draws, (distances, draws); computed on several threads if there are many."""
    fixed, noise = fixed_errors(camera, error_source), camera.noise(distance, field)
    draws = len(next(iter(values.values())))
    inverse = np.empty((distance.size, draws))
    step = max(64, _AT_ONCE // max(distance.size, 1))

    def read(start: int) -> None:
        batch = {name: value[start : start + step] for name, value in values.items()}
        inverse[:, start : start + step] = read_draws(camera, batch | fixed, distance, field, noise).T

    starts = range(0, draws, step)
    if inverse.size < _WORTH_THREADS:
        for start in starts:
            read(start)
    else:
        with ThreadPoolExecutor(max_workers=os.cpu_count()) as threads:
            list(threads.map(read, starts))
    return inverse


def nominal_inverse(camera: DepthCamera, distance: FloatArray, field: FieldPosition) -> FloatArray:
    """The inverse depth [1/m] that the camera measures with every error at its mean; NaN where it measures none."""
    values = fixed_errors(camera, "noise")
    read = read_draws(camera, values, distance, field, camera.noise(distance, field))
    return np.asarray(np.broadcast_to(read, (1, distance.size))[0])


def trial_distribution(
    camera: DepthCamera, distance: FloatArray, field: FieldPosition, error_source: str
) -> DepthDistribution:
    """The distribution from a few draws, with its error, for checking a cheaper model."""
    return _of_draws(camera, distance, field, error_source, _TRIAL_ROUNDS * _FIRST_DRAWS)


def exact_distribution(
    camera: DepthCamera, distance: FloatArray, field: FieldPosition, error_source: str
) -> DepthDistribution:
    """The distribution of depth by draws through the exact model, as many as the tolerance requires."""
    return _of_draws(camera, distance, field, error_source, settled_draws(camera, field, error_source))


@remembered(4)  # a question at one distance settles the draws there and then reads them
def _of_draws(
    camera: DepthCamera, distance: FloatArray, field: FieldPosition, error_source: str, draws: int
) -> DepthDistribution:
    probabilities = camera.propagation.probabilities
    drivers, values = _drawn(camera, error_source, field, draws)
    inverse = _read_all(camera, distance, field, error_source, values)
    upper = 1.0 - np.array(probabilities)  # of inverse depth, which falls as depth rises
    false_matches = false_match_share(camera, error_source)
    within = Within(distance=distance, share=share_of_true_matches(false_matches))
    sampling = sampling_error(inverse, drivers, SCRAMBLES, upper, within)
    ascending = [np.sort(scramble, axis=1) for scramble in np.split(inverse, SCRAMBLES, axis=1)]
    quantiles = np.stack([ranked_quantiles(scramble, upper) for scramble in ascending])
    # Draws that give no depth are NaN, which is not positive either.
    counted = 1.0 - np.mean((inverse > 0.0).reshape(distance.size, SCRAMBLES, draws), axis=2).T
    failed = np.clip(counted - sampling.failed, 0.0, 1.0)
    radii = np.stack([within.radius(scramble) for scramble in ascending]) - sampling.radius
    seen = np.isfinite(nominal_inverse(camera, distance, field))
    return DepthDistribution(
        probabilities=probabilities,
        quantiles=np.where(seen, depth_from_inverse(quantiles - sampling.quantiles), np.nan),
        failures=lambda: np.where(seen, failed, np.nan),
        radii=lambda: np.where(seen, radii, np.nan),
        counting_step=1.0 / (SCRAMBLES * draws),
        false_matches=false_matches,
    )


@lru_cache(maxsize=1024)
def settled_draws(camera: DepthCamera, field: FieldPosition, error_source: str) -> int:
    """Draws per scramble, doubled until every judged half width is within the tolerance.

    Intervals narrower than their distance and intervals without a far end are judged; those in between are reported
    with their larger error.
    """
    propagation, judged, draws = camera.propagation, _requested(camera), _FIRST_DRAWS
    while judged.size and 2 * draws * SCRAMBLES <= propagation.max_draws:
        depth = _of_draws(camera, judged, field, error_source, draws)
        if np.max(depth.sampling_error(widest=judged)) <= propagation.tolerance:
            break
        draws *= 2
    return draws
