"""Ranks in /decision: the probability that one camera of a pair errs less than the other, over distance."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.analysis.ranks import RANK_WAYS, rank
from tradestudy.execution.steps import Progress
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.study.definition import StudyDefinition

_MOST_DISTANCES: Final = 25


def ranks_group(definition: StudyDefinition, progress: Progress) -> xr.Dataset:
    """Ranks over (pair, way, distance) for the pairs that the decision compares."""
    decision = definition.file.decision
    assert decision is not None  # the caller has checked
    pairs = decision.compare or (decision.between,)
    distance = _distances(definition.case.distance, decision.at)
    cameras = definition.case.cameras
    found = []
    for number, (first, second) in enumerate(pairs):
        progress("ranks", number / len(pairs))
        found.append([rank(cameras[first], cameras[second], distance, way) for way in RANK_WAYS])
    progress("ranks", 1.0)

    def over_pairs(name: str) -> Any:
        return np.array([[getattr(way, name) for way in pair] for pair in found])

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
            "pair": [f"{first} against {second}" for first, second in pairs],
            "rank_way": list(RANK_WAYS),
            "rank_distance": distance,
        },
    )


def _distances(distance: FloatArray, asked: tuple[float, ...]) -> FloatArray:
    """A sample of the distances [m] of the study, with those of the decision."""
    some = distance[np.unique(np.linspace(0, distance.size - 1, _MOST_DISTANCES).round().astype(int))]
    return np.union1d(some, asked)
