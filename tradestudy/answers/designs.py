"""The verdict of one design, from its curves in /depth where it needs no more: cheap enough for many designs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.answers.decision import Crossing, best_cameras, stated_error
from tradestudy.answers.depth import DepthTable, DepthTables, over_designs
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.depth.evaluation import finite, judged_at
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import distances_without_decision, padded_attributes
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.varying import sweep_axes

_BOTH: Final = -1  # index of noise and calibration together among the error sources
_ROUNDING: Final = 1e-9  # of a distance


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """Depth uncertainty that judges one camera (`judged_uncertainty`) over distance.

    Parameters
    ----------
    distance
        [m], increasing.
    uncertainty, error
        Uncertainty from noise and calibration [m], and its stated error.
    usable
        Intervals where the camera is usable (near, far) [m].
    """

    distance: FloatArray
    uncertainty: FloatArray
    error: FloatArray
    usable: Sequence[tuple[float, float]]

    @classmethod
    def of(cls, camera: DepthCamera, table: DepthTable) -> Curve:
        """The curve of a camera from its table."""
        depth = table.evaluation
        return cls(
            distance=depth.distance,
            uncertainty=depth.judged[_BOTH],
            error=stated_error(camera, depth.judged_error[_BOTH]),
            usable=[(interval.near, interval.far) for interval in table.intervals],
        )

    def usable_at(self, places: FloatArray) -> np.ndarray:
        """Whether the camera is usable at each place [m]."""
        inside = [
            (near * (1.0 - _ROUNDING) <= places) & (places <= far * (1.0 + _ROUNDING)) for near, far in self.usable
        ]
        return np.any(inside, axis=0) if inside else np.zeros(places.shape, dtype=bool)

    def relative_error(self, places: FloatArray) -> FloatArray:
        """Stated error of the uncertainty at places [m], relative to it."""
        with np.errstate(divide="ignore", invalid="ignore"):  # unbounded intervals are valid
            relative = np.nan_to_num(self.error / self.uncertainty)
        return np.interp(np.log(places), np.log(self.distance), relative)

    def between(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Uncertainty at places between the distances, and its error; both [m].

        Interpolates linearly in logarithms; half the second difference bounds the interpolation error.
        """
        logs = np.log(self.distance)
        with np.errstate(divide="ignore", invalid="ignore"):  # unbounded intervals are valid
            values = np.log(self.uncertainty)
            between = np.interp(np.log(places), logs, values)
            bent = np.abs(np.diff(values, 2, prepend=values[:1], append=values[-1:]))
        missed = np.interp(np.log(places), logs, _widened(bent)) / 2.0
        on_grid = np.min(np.abs(np.log(places)[:, None] - logs), axis=1) < _ROUNDING
        uncertainty = np.exp(between)
        share = self.relative_error(places) + np.where(on_grid, 0.0, np.nan_to_num(missed))
        with np.errstate(over="ignore"):  # the error is infinite next to an unbounded interval
            return uncertainty, np.multiply(share, uncertainty, out=np.zeros_like(share), where=share > 0.0)


def _widened(values: FloatArray) -> FloatArray:
    """The largest of each value and its two neighbours; the ends have no second difference of their own."""
    values = np.concatenate([values[1:2], values[1:-1], values[-2:-1]])
    padded = np.pad(values, 1, mode="edge")
    return np.asarray(np.fmax(np.fmax(padded[:-2], padded[2:]), values))


def best_at(curves: Mapping[str, Curve], places: FloatArray, uncertainty: Mapping[str, FloatArray]) -> list[str]:
    """The usable camera with the lowest uncertainty [m] at each place [m], named as `best_cameras` does."""
    return best_cameras(
        {name: curve.usable_at(places) for name, curve in curves.items()},
        uncertainty,
        {name: finite(uncertainty[name]) * curve.relative_error(places) for name, curve in curves.items()},
    )


def crossings(first: Curve, second: Curve, names: tuple[str, str]) -> tuple[Crossing, ...]:
    """Where two cameras are equally uncertain, usable or not, by linear interpolation in logarithms.

    The error is the combined error of both curves there, interpolation included, divided by the slope of their ratio.
    """
    logs = np.log(first.distance)
    with np.errstate(divide="ignore", invalid="ignore"):  # unbounded intervals are valid
        ratio = np.log(first.uncertainty) - np.log(second.uncertainty)
    known = np.isfinite(ratio[:-1]) & np.isfinite(ratio[1:])
    crossed = []
    for k in np.flatnonzero(known & (np.sign(ratio[:-1]) * np.sign(ratio[1:]) < 0.0)):
        slope = (ratio[k + 1] - ratio[k]) / (logs[k + 1] - logs[k])
        place = float(np.exp(logs[k] - ratio[k] / slope))
        read = (curve.between(np.array([place])) for curve in (first, second))
        shares = [error[0] / uncertainty[0] for uncertainty, error in read]
        error = place * float(np.hypot(*shares)) / abs(float(slope))
        crossed.append(Crossing(distance=place, error=error, nearer=names[0] if ratio[k] < 0.0 else names[1]))
    return tuple(crossed)


def design_verdicts(study: PreparedStudy, designs: Sequence[PreparedStudy], tables: DepthTables) -> xr.Dataset:
    """Variables of /decision over the swept parameters; the designs are those of `sweep_points`."""
    axes, decision = sweep_axes(study), study.file.decision
    places = np.array(decision.at if decision else distances_without_decision(study.case.distance))
    at_places = cache(lambda camera: judged_at(camera, places))  # many designs share a camera
    best, along, crossed = [], [], []
    for design in designs:
        case = design.case
        curves = {name: Curve.of(camera, tables[camera, case.criteria]) for name, camera in case.cameras.items()}
        candidates = decision.candidates if decision and decision.candidates else curves
        chosen = {name: curves[name] for name in candidates}
        best.append(best_at(chosen, places, {name: at_places(case.cameras[name]) for name in chosen}))
        along.append(best_at(chosen, case.distance, {name: curve.uncertainty for name, curve in chosen.items()}))
        if decision is not None:
            pair = (decision.between[0], decision.between[1])
            crossed.append(crossings(curves[pair[0]], curves[pair[1]], pair))
    shape = tuple(len(axis.labels) for axis in axes)
    values: dict[str, Any] = {
        "design_best_camera": np.array(best, dtype=object).reshape(*shape, len(places)),
        "design_best_camera_along": np.array(along, dtype=object).reshape(*shape, -1),
    }
    if decision is not None:
        crossovers = padded_attributes(crossed, {"distance": math.nan, "error": math.nan, "nearer": ""})
        values |= {f"design_crossover_{name}": rows.reshape(*shape, -1) for name, rows in crossovers.items()}
    return over_designs("decision", values, {"design_place": places, "design_distance": study.case.distance}, axes)
