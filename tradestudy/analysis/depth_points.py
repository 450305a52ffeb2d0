"""All cameras of a study at one point of its sweep: what a worker computes, and all that it needs for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tradestudy.analysis.depth import DepthEvaluation, evaluate_depth
from tradestudy.analysis.usable import Interval, all_met, evaluate_limits, usable_intervals
from tradestudy.cameras.depth_camera import DepthCamera, Limit, UsableCriteria
from tradestudy.optics.arrays import BoolArray, FloatArray

if TYPE_CHECKING:  # a worker needs no reader of study files
    from tradestudy.study.definition import Case


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthPoint:
    """Cameras that measure depth, the limits of their usable range, and distances [m]."""

    cameras: Mapping[str, DepthCamera]
    criteria: UsableCriteria
    distance: FloatArray

    @classmethod
    def of(cls, case: Case) -> DepthPoint:
        """What /depth needs of a case."""
        return cls(cameras=dict(case.cameras), criteria=case.criteria, distance=case.distance)


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthTable:
    """What the cameras of one point know about depth, camera by camera; ``parts`` are the names of all error parts."""

    evaluations: tuple[DepthEvaluation, ...]
    limits: tuple[Mapping[str, Limit], ...]
    intervals: tuple[tuple[Interval, ...], ...]
    virtual_depth: tuple[FloatArray, ...]
    usable: tuple[BoolArray, ...]
    parts: tuple[str, ...]


def depth_table(point: DepthPoint) -> DepthTable:
    """Evaluate all cameras of one point."""
    cameras, distance = list(point.cameras.values()), point.distance
    evaluations = tuple(evaluate_depth(camera, distance) for camera in cameras)
    limits = tuple(dict(evaluate_limits(camera, point.criteria, distance)) for camera in cameras)
    return DepthTable(
        evaluations=evaluations,
        limits=limits,
        intervals=tuple(usable_intervals(camera, point.criteria, distance) for camera in cameras),
        virtual_depth=tuple(camera.virtual_depth(distance) for camera in cameras),
        usable=tuple(all_met(limit, distance.shape) for limit in limits),
        parts=tuple(dict.fromkeys(name for evaluation in evaluations for name in evaluation.parts)),
    )
