"""The probability that one of two cameras errs less than the other in one measurement."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_measurement import SESSION_PARAMETERS
from tradestudy.depth.draws import inverse_depth_model, uncertain_groups
from tradestudy.execution import Steps
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.study.prepared import PreparedStudy
from tradestudy.uncertainty.decision import RankProbability, rank_probability
from tradestudy.uncertainty.distributions import Normal
from tradestudy.uncertainty.evaluation import Model
from tradestudy.uncertainty.sources import ErrorClass, Group, Source, Sources

RANK_ERROR_SOURCES: Final = ("calibration", "both")
"""Calibration errors alone, as after averaging all noise away, and single measurements."""
_DRAWS, _SCRAMBLES = 2**11, 8
_MOST_DISTANCES: Final = 25
_PREFIXES: Final = ("first/", "second/")
# Drawn for two cameras without errors, which both ignore it: draws need a source.
_NOTHING: Final = Source(
    name="nothing", distribution=Normal(mean=0.0, standard_deviation=1.0), error_class=ErrorClass.RIG
)


@dataclass(frozen=True, kw_only=True)
class RankPoint:
    """Two cameras to compare at distances [m] with one of `RANK_ERROR_SOURCES`."""

    first: DepthCamera
    second: DepthCamera
    distance: FloatArray
    error_source: str


def rank_distances(distance: FloatArray, places: tuple[float, ...]) -> FloatArray:
    """A sample of the distances [m] of a study, with those of its decision."""
    sample = distance[np.unique(np.linspace(0, distance.size - 1, _MOST_DISTANCES).round().astype(int))]
    return np.union1d(sample, places)


def rank_at(point: RankPoint) -> RankProbability:
    """See `rank`."""
    return rank(point.first, point.second, point.distance, point.error_source)


def rank(first: DepthCamera, second: DepthCamera, distance: FloatArray, error_source: str) -> RankProbability:
    """Probability that the depth error of the first camera is smaller than that of the second, over distances [m].

    A change of temperature or pressure that both declare identically is one event, drawn once for both.
    """
    cameras = (first, second)
    groups = [uncertain_groups(camera, error_source) for camera in cameras]
    shared = [group for group in groups[0] if group.name in SESSION_PARAMETERS and group in groups[1]]
    own_groups = [
        group.under(prefix)
        for prefix, camera_groups in zip(_PREFIXES, groups, strict=True)
        for group in camera_groups
        if group not in shared
    ]
    models = [
        _model(camera, prefix, camera_groups, distance)
        for camera, prefix, camera_groups in zip(cameras, _PREFIXES, groups, strict=True)
    ]
    drawn = (*own_groups, *shared) or (_NOTHING,)
    return rank_probability(
        models[0],
        models[1],
        Sources(groups=drawn),
        distance,
        draws=_DRAWS,
        replicates=_SCRAMBLES,
        seed=first.propagation.seed,
        point="rank",
        # As many draws as keep a batch within 2¹⁴ depths, but no fewer than 2⁸.
        batch_draws=max(2**8, 2**14 >> max(distance.size - 1, 0).bit_length()),
    )


def _model(camera: DepthCamera, prefix: str, groups: tuple[Group, ...], distance: FloatArray) -> Model:
    """The depth measurement of one of two cameras, whose own parameters have a prefix."""
    names = [parameter for group in groups for parameter in group.parameters]
    alone = inverse_depth_model(camera, distance)

    def evaluate(values: Mapping[str, FloatArray]) -> FloatArray:
        own_values = {name: values[prefix + name] if prefix + name in values else values[name] for name in names}
        inverse = alone(own_values)
        if own_values:
            return inverse
        draws = len(next(iter(values.values())))  # only the other camera has draws; this one reads the same in each
        return np.repeat(inverse, draws, axis=0)

    return evaluate


def ranks_group(study: PreparedStudy, steps: Steps) -> xr.Dataset:
    """Ranks over (pair, error source, distance) for the pairs that the decision compares."""
    decision = study.file.decision
    assert decision is not None  # the caller has checked
    pairs = decision.compare or (decision.between,)
    distance = rank_distances(study.case.distance, decision.at)
    cameras = study.case.cameras
    names = [f"{first} against {second}" for first, second in pairs]
    points = [
        RankPoint(first=cameras[first], second=cameras[second], distance=distance, error_source=error_source)
        for first, second in pairs
        for error_source in RANK_ERROR_SOURCES
    ]
    probabilities = steps.map(
        "ranks", rank_at, points, [f"{name}, {error_source}" for name in names for error_source in RANK_ERROR_SOURCES]
    )

    def over_pairs(attribute: str) -> Any:
        return np.array([getattr(probability, attribute) for probability in probabilities]).reshape(
            len(pairs), len(RANK_ERROR_SOURCES), -1
        )

    return dataset(
        "decision",
        {
            "rank_first": over_pairs("first"),
            "rank_first_error": over_pairs("first_error"),
            "rank_second": over_pairs("second"),
            "pair_first": [first for first, _ in pairs],
            "pair_second": [second for _, second in pairs],
        },
        {
            "pair": names,
            "rank_error_source": list(RANK_ERROR_SOURCES),
            "rank_distance": distance,
        },
    )
