"""One camera over the distances of a study: what a worker computes, and all the input that it needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tradestudy.analysis.depth import DepthEvaluation, distribution, evaluate_depth
from tradestudy.analysis.usable import Interval, all_met, evaluate_limits, usable_intervals
from tradestudy.cameras.depth_camera import DepthCamera, Limit, UsableCriteria
from tradestudy.cameras.depth_measurement import FieldPosition
from tradestudy.optics.arrays import BoolArray, FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthPoint:
    """A camera that measures depth, the limits of its usable range, and the distances [m] to evaluate."""

    camera: DepthCamera
    criteria: UsableCriteria
    distance: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthTable:
    """Depth errors and usable range of one camera."""

    evaluation: DepthEvaluation
    limits: Mapping[str, Limit]
    intervals: tuple[Interval, ...]
    virtual_depth: FloatArray
    usable: BoolArray


def depth_table(point: DepthPoint) -> DepthTable:
    """Evaluate the depth errors and the usable range of a camera."""
    camera, criteria, distance = point.camera, point.criteria, point.distance
    limits = dict(evaluate_limits(camera, criteria, distance, depth=distribution))
    return DepthTable(
        evaluation=evaluate_depth(camera, distance),
        limits=limits,
        intervals=usable_intervals(camera, criteria, distance),
        virtual_depth=camera.virtual_depth(distance),
        usable=all_met(limits, distance.shape),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldPoint:
    """A camera that measures depth, the positions in the picture and the distances [m] to evaluate."""

    camera: DepthCamera
    fields: tuple[FieldPosition, ...]
    distance: FloatArray


def depth_over_field(point: FieldPoint) -> list[DepthEvaluation]:
    """Evaluate a camera at each field position."""
    return [evaluate_depth(point.camera, point.distance, field) for field in point.fields]
