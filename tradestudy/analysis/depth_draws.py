"""Exact propagation: everything that is uncertain about one camera, drawn once and read at any distance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np

from tradestudy.analysis.depth_distribution import DepthDistribution
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.error_vocabulary import PIXEL_NOISE
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.distributions import Normal
from tradestudy.uncertainty.error_class import CALIBRATION, NOISE, ErrorClass
from tradestudy.uncertainty.evaluation import Model, Outcome, ScoreAlignment, alignment_with, depth_from_inverse
from tradestudy.uncertainty.quantiles import quantiles_of
from tradestudy.uncertainty.scores import each_scramble, scramble_scores
from tradestudy.uncertainty.sources import Group, Source, Sources

SCRAMBLES: Final = 8
"""Fewer independent scrambles do not give a trustworthy standard error."""
CLASSES: Final[Mapping[str, tuple[ErrorClass, ...]]] = {
    "noise": NOISE,
    "calibration": CALIBRATION,
    "both": (*NOISE, *CALIBRATION),
}
_FIRST_DRAWS: Final = 2**8  # of each scramble
_AT_ONCE: Final = 2**14  # readings that fit into a processor's cache
_OF_FOCAL_LENGTH: Final = (10.0, 100.0, 1000.0)  # distances that the first coordinates are aligned with


def noise_group() -> Source:
    """The noise of one measurement, as a standard normal score that the camera's own noise scales."""
    score = Normal(mean=0.0, standard_deviation=1.0)
    return Source(name=PIXEL_NOISE, distribution=score, error_class=ErrorClass.MEASUREMENT)


def uncertain_groups(camera: DepthCamera, way: str) -> tuple[Group, ...]:
    """What is drawn: noise, calibration, or both; calibrations and their ageing never average."""
    noise = (noise_group(),) if ErrorClass.MEASUREMENT in CLASSES[way] else ()
    return (*noise, *(camera.calibration.groups if way != "noise" else ()))


def fixed_errors(camera: DepthCamera, way: str) -> dict[str, FloatArray]:
    """The errors that are not drawn but have a mean other than zero."""
    held = camera.calibration.groups if way == "noise" else ()
    means = {name: mean for group in held for name, mean in zip(group.parameters, group.nominal, strict=True)}
    return {name: np.full((1, 1), mean) for name, mean in means.items() if mean != 0.0}


def read_draws(
    camera: DepthCamera, values: Mapping[str, FloatArray], distance: FloatArray, field: float, noise: FloatArray
) -> FloatArray:
    """Inverse depths [1/m] that draws (draws, 1) read at distances [m]; NaN where a draw has no rank.

    ``noise`` [m on the sensor] is the standard deviation of the disparity at each distance; shape (draws, distances).
    """
    errors = dict(values)
    if PIXEL_NOISE in errors:
        errors[PIXEL_NOISE] = errors[PIXEL_NOISE] * noise
    found = camera.reading(distance, field, errors)
    return np.where(found.no_overlap | found.out_of_range, np.nan, found.inverse_depth)


@lru_cache(maxsize=128)
def uncertain_sources(camera: DepthCamera, way: str) -> Sources:
    """See `uncertain_groups`."""
    return Sources(groups=uncertain_groups(camera, way))


def outcome_model(camera: DepthCamera, distance: FloatArray, field: float = 0.0, way: str = "both") -> Model:
    """Inverse depths at distances [m] as the engine of propagation asks for them."""
    fixed, noise = fixed_errors(camera, way), camera.noise(distance)

    def model(values: Mapping[str, FloatArray]) -> Outcome:
        draws = len(next(iter(values.values()))) if values else 1
        found = read_draws(camera, {**fixed, **values}, distance, field, noise)
        return Outcome(values=np.broadcast_to(found, (draws, distance.size)))

    return model


@lru_cache(maxsize=64)
def _scores(camera: DepthCamera, way: str, scramble: int, draws: int) -> FloatArray:
    """Standard normal scores (dimensions, draws) of one scramble, what moves depth most in the first coordinates."""
    sources = uncertain_sources(camera, way)
    scores = scramble_scores(sources.dimensions, draws, seed=camera.propagation.seed, point="depth", scramble=scramble)
    return np.asarray(_alignment(camera, way).apply(scores.copy()))


@lru_cache(maxsize=64)
def _alignment(camera: DepthCamera, way: str) -> ScoreAlignment:
    places = camera.gathering_lens.focal_length * np.array(_OF_FOCAL_LENGTH)
    return alignment_with([outcome_model(camera, places, 0.0, way)], uncertain_sources(camera, way))


def exact_depths(
    camera: DepthCamera, distance: FloatArray, field: float, way: str, scramble: int, draws: int
) -> FloatArray:
    """Depths [m] that the draws of one scramble read; shape (distances, draws), +inf beyond infinity, NaN unranked."""
    sources, fixed = uncertain_sources(camera, way), fixed_errors(camera, way)
    if not sources.dimensions:  # nothing is uncertain: one reading stands for all
        return depth_from_inverse(
            np.broadcast_to(nominal_inverse(camera, distance, field).T[:, None], (distance.size, 1))
        )
    values = sources.draw(_scores(camera, way, scramble, draws))
    noise = camera.noise(distance)
    found = np.empty((distance.size, draws))
    step = max(64, _AT_ONCE // max(distance.size, 1))
    for start in range(0, draws, step):
        batch = {name: value[start : start + step] for name, value in values.items()}
        found[:, start : start + step] = read_draws(camera, batch | fixed, distance, field, noise).T
    return depth_from_inverse(found)


def nominal_inverse(camera: DepthCamera, distance: FloatArray, field: float) -> FloatArray:
    """The inverse depth [1/m] that the camera reads with every error at its mean; NaN where it reads none."""
    values = fixed_errors(camera, "noise")
    return np.broadcast_to(read_draws(camera, values, distance, field, camera.noise(distance)), (1, distance.size))[0]


def exact_distribution(camera: DepthCamera, distance: FloatArray, field: float, way: str) -> DepthDistribution:
    """The distribution of depth by draws through the exact reading."""
    return _of_draws(camera, distance, field, way, settled_draws(replace_scramble(camera, None), field, way))


def replace_scramble(camera: DepthCamera, scramble: int | None) -> DepthCamera:
    """The same camera with the draws of one scramble; None: of all."""
    if camera.propagation.scramble == scramble:
        return camera
    return replace(camera, propagation=replace(camera.propagation, scramble=scramble))


def _of_draws(camera: DepthCamera, distance: FloatArray, field: float, way: str, draws: int) -> DepthDistribution:
    _alignment(camera, way)  # known before threads ask for it

    def of_scramble(scramble: int) -> tuple[FloatArray, FloatArray]:
        depths = exact_depths(camera, distance, field, way, scramble, draws)
        return _quantiles(depths, camera.propagation.probabilities), 1.0 - np.mean(np.isfinite(depths), axis=1)

    own = camera.propagation.scramble
    found = each_scramble(of_scramble, SCRAMBLES) if own is None else [of_scramble(own)]
    seen = np.isfinite(nominal_inverse(camera, distance, field))
    return DepthDistribution(
        probabilities=camera.propagation.probabilities,
        quantiles=np.where(seen, np.stack([quantiles for quantiles, _ in found]), np.nan),
        failed=np.where(seen, np.stack([failed for _, failed in found]), np.nan),
    )


def _quantiles(depths: FloatArray, probabilities: tuple[float, ...]) -> FloatArray:
    """Quantiles (probabilities, distances) of the draws that have a rank."""
    unranked = np.isnan(depths)
    if not unranked.any():
        return quantiles_of(depths, probabilities)
    found = np.full((len(probabilities), len(depths)), np.nan)
    for row, (values, missing) in enumerate(zip(depths, unranked, strict=True)):
        if not missing.all():
            found[:, row] = quantiles_of(values[None, ~missing], probabilities)[:, 0]
    return found


@lru_cache(maxsize=1024)
def settled_draws(camera: DepthCamera, field: float, way: str) -> int:
    """How many draws each scramble takes: doubled until every judged half width is known to the tolerance.

    Judged are intervals that are narrower than their distance, and those that have no far end; what lies between is
    reported with its larger error.
    """
    propagation = camera.propagation
    judged = np.array(propagation.judged, dtype=np.float64)
    judged = judged[camera.images(judged)]
    draws = _FIRST_DRAWS
    while judged.size and 2 * draws * SCRAMBLES <= propagation.max_draws:
        if np.all(_of_draws(camera, judged, field, way, draws).converged(propagation.tolerance, widest=judged)):
            break
        draws *= 2
    return draws
