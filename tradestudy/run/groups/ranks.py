"""Ranks in /decision: the probability that one camera of a pair errs less than the other, over distance."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from tradestudy.analysis.ranks import RANK_ERROR_SOURCES, RankPoint, rank_at, rank_distances
from tradestudy.execution import Steps
from tradestudy.results import dataset
from tradestudy.study.definition import StudyDefinition


def ranks_group(definition: StudyDefinition, steps: Steps) -> xr.Dataset:
    """Ranks over (pair, error source, distance) for the pairs that the decision compares."""
    decision = definition.file.decision
    assert decision is not None  # the caller has checked
    pairs = decision.compare or (decision.between,)
    distance = rank_distances(definition.case.distance, decision.at)
    cameras = definition.case.cameras
    names = [f"{first} against {second}" for first, second in pairs]
    points = [
        RankPoint(first=cameras[first], second=cameras[second], distance=distance, error_source=error_source)
        for first, second in pairs
        for error_source in RANK_ERROR_SOURCES
    ]
    found = steps.map(
        "ranks", rank_at, points, [f"{name}, {error_source}" for name in names for error_source in RANK_ERROR_SOURCES]
    )

    def over_pairs(name: str) -> Any:
        return np.array([getattr(one, name) for one in found]).reshape(len(pairs), len(RANK_ERROR_SOURCES), -1)

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
