"""/decision: the best camera over distance, crossovers of pairs, readings that reverse them, and the largest causes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_measurement import FieldPosition
from tradestudy.depth.distribution import DepthDistribution
from tradestudy.depth.evaluation import ERROR_SOURCES, Reading, distribution, finite, imaged
from tradestudy.depth.linear import linearised_depth
from tradestudy.depth.table import distribution_between, judged_uncertainty, judged_uncertainty_error
from tradestudy.depth.usable import (
    END_OF_STUDY,
    Interval,
    all_met,
    boundaries,
    evaluate_limits,
    margin,
    places_around,
    scramble_error,
    sought,
    usable_intervals,
)
from tradestudy.errors import OutOfRangeError
from tradestudy.execution.steps import Progress
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.results import dataset, padded_attributes
from tradestudy.study.bases import NamedInput, uncertain_input
from tradestudy.study.prepared import Case, PreparedStudy

NOISE: Final = "noise"


@dataclass(frozen=True, kw_only=True)
class Cause:
    """An uncertain parameter of a camera, or the noise of a measurement, and its share of the variance of depth."""

    parameter: str
    share: float


def largest_cause(camera: DepthCamera, distance: FloatArray, field: FieldPosition = 0.0) -> Cause | None:
    """The parameter that contributes most to the depth uncertainty, on average over distances [m].

    If inverse depth is linear in the errors, with sensitivities s and covariance C, its variance is Σ sᵢ (C s)ᵢ. Each
    term, divided by that sum, is the share of one parameter with its correlations; noise accounts for the rest.
    None if an uncertain parameter has no variance, or if nothing is measured.
    """
    seen = distance[camera.images(distance)]
    try:
        line = linearised_depth(camera, seen, field, "noise" if camera.propagation.model == "off" else "both")
    except OutOfRangeError:
        return None
    contributed = line.sensitivity * (line.covariance @ line.sensitivity)
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = contributed / contributed.sum(axis=0)
    measured = np.isfinite(shares).all(axis=0)
    if not measured.any():
        return None
    mean = shares[:, measured].mean(axis=1)
    declared = {name for group in camera.calibration.groups for name in group.parameters}
    by_noise = float(sum(share for name, share in zip(line.parameters, mean, strict=True) if name not in declared))
    causes = {name: float(share) for name, share in zip(line.parameters, mean, strict=True) if name in declared} | {
        NOISE: by_noise
    }
    largest = max(causes, key=lambda name: causes[name])
    return Cause(parameter=largest, share=causes[largest])


_OFFSET: Final = 2e-7  # relative offset for looking just nearer and just farther than a distance, such as a crossing
_ROUNDING: Final = 2e-7  # relative difference of two uncertainties that interpolation may cause; a lead must exceed it
_CROSSED_TO: Final = 1e-7  # relative accuracy of a crossing
_CHANGED_TO: Final = 1e-5  # relative accuracy of a distance where the best camera changes


TIED: Final = ", "
"""Separates the names of tied cameras, whose difference is below its stated error."""
# A difference must exceed this many standard errors to decide. With eight scrambles, chance alone exceeds it once in a
# thousand. With a lower limit, answers over many distances would alternate between equal cameras.
_SURE: Final = 5.4


@dataclass(frozen=True, kw_only=True)
class Crossing:
    """Distance [m] at which two cameras are equally uncertain, its standard error, and which is better before it."""

    distance: float
    error: float
    nearer: str


@dataclass(frozen=True, kw_only=True)
class Change:
    """Distance [m] where the winner changes, its standard error, and the winners before and beyond it; "" for none."""

    distance: float
    error: float
    nearer: str
    farther: str


@dataclass(frozen=True, kw_only=True)
class PairVerdict:
    """Comparison of the study's main pair of cameras under one reading of the assumptions.

    Parameters
    ----------
    winner, more_certain
        Names by place and error source, shape (place, error source); ``winner`` considers only usable cameras, is empty
        if none is, and names both if they are tied.
    ratio
        Uncertainty of the first camera relative to the second, shape (place, error source).
    crossings, changes
        For each error source, where the two are equally uncertain, usable or not, and where the winner changes.
    """

    winner: list[list[str]]
    more_certain: list[list[str]]
    ratio: FloatArray
    crossings: Mapping[str, tuple[Crossing, ...]]
    changes: Mapping[str, tuple[Change, ...]]


def is_usable(case: Case, camera_name: str, distance: FloatArray, depth: Reading = distribution_between) -> BoolArray:
    """Whether a camera meets every limit of the study at distances [m], where its depth is read by ``depth``."""
    return all_met(evaluate_limits(case.cameras[camera_name], case.criteria, distance, depth=depth), distance.shape)


def stated_error(camera: DepthCamera, error: FloatArray) -> FloatArray:
    """Largest plausible error of a depth uncertainty [m], from the standard error of draws or the error of a model."""
    return _SURE * error if camera.propagation.model == "exact" else error


def best_cameras(
    usable: Mapping[str, BoolArray], uncertainty: Mapping[str, FloatArray], error: Mapping[str, FloatArray]
) -> list[str]:
    """The usable camera with the lowest uncertainty at each distance; empty if none is usable.

    A camera whose difference from the best is within their combined stated errors (`stated_error`) shares the win. The
    error of the larger uncertainty counts relative to it: ±300 m, known to ±300 m, does not tie with ±15 mm.
    """
    table = np.stack([np.where(usable[name], uncertainty[name], np.inf) for name in usable])
    table = np.where(np.isnan(table), np.inf, table)
    errors = np.stack([np.nan_to_num(error[name]) for name in usable])
    best = np.argmin(table, axis=0)
    lowest, of_lowest = (np.take_along_axis(rows, best[None], axis=0) for rows in (table, errors))
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # ∞ − ∞: neither is usable; 0 / 0: both exact
        tied = table - lowest <= np.hypot(errors * np.nan_to_num(lowest / table), of_lowest)
    tied[best, np.arange(best.size)] = True
    return [
        TIED.join(name for name, shares in zip(usable, tied[:, k], strict=True) if shares)
        if math.isfinite(lowest[0, k])
        else ""
        for k in range(best.size)
    ]


def best_along(case: Case, camera_names: Sequence[str]) -> tuple[FloatArray, list[list[str]]]:
    """Distances [m] that show where the best of some cameras changes, and the best there, for each error source.

    They are the distances of the study, those at which usable ranges are sought, both sides of the ends of these, and
    more around each change for noise and calibration together, which lies between two of them 1e-5 of a distance apart.
    """
    cameras = {name: case.cameras[name] for name in camera_names}
    ends = np.array([end for name in cameras for end in _ends_of_use(case, name)])
    sides = np.clip([ends * (1.0 - _OFFSET), ends * (1.0 + _OFFSET)], case.distance[0], case.distance[-1])
    grid = np.unique(np.concatenate([sides.ravel(), *(sought(camera, case.distance) for camera in cameras.values())]))
    # The error of a model is estimated for many distances together, and changes slowly between them.
    errors = {
        (name, error_source): _relative_error(camera, grid, error_source)
        for name, camera in cameras.items()
        for error_source in ERROR_SOURCES
    }

    def best(places: FloatArray, error_source: str) -> list[str]:
        usable = {
            name: _within(usable_intervals(camera, case.criteria, case.distance), places)
            for name, camera in cameras.items()
        }
        uncertainty = {name: judged_uncertainty(camera, places, error_source) for name, camera in cameras.items()}
        error = {
            name: finite(uncertainty[name]) * np.interp(places, grid, errors[name, error_source]) for name in cameras
        }
        return best_cameras(usable, uncertainty, error)

    places, winners = grid, np.array(best(grid, ERROR_SOURCES[-1]), dtype=object)
    while True:
        change = (winners[1:] != winners[:-1]) & (places[1:] > places[:-1] * (1.0 + _CHANGED_TO))
        if not change.any():
            return places, [best(places, error_source) for error_source in ERROR_SOURCES]
        after = np.flatnonzero(change) + 1
        middles = np.sqrt(places[after - 1] * places[after])
        places = np.insert(places, after, middles)
        winners = np.insert(winners, after, best(middles, ERROR_SOURCES[-1]))


def _relative_error(camera: DepthCamera, distance: FloatArray, error_source: str) -> FloatArray:
    """Stated error of a depth uncertainty, and what interpolation may add to it, relative to it."""
    error = stated_error(camera, judged_uncertainty_error(camera, distance, error_source))
    with np.errstate(invalid="ignore", divide="ignore"):  # unbounded or not measured
        return np.nan_to_num(error / judged_uncertainty(camera, distance, error_source)) + _ROUNDING


def _within(intervals: Sequence[Interval], distance: FloatArray) -> BoolArray:
    inside = ((interval.near <= distance) & (distance <= interval.far) for interval in intervals)
    return np.asarray(np.any([distance < 0.0, *inside], axis=0))  # nowhere if there is no interval


def decide_pair(case: Case, pair: tuple[str, str], places: FloatArray) -> PairVerdict:
    """Which of two cameras is more certain, and which wins among the usable ones, at places [m], by error source."""
    cameras = {name: case.cameras[name] for name in pair}
    usable = {name: is_usable(case, name, places, distribution) for name in pair}
    winners, certain, ratios = [], [], []
    for error_source in ERROR_SOURCES:
        uncertainty, error = {}, {}
        for name, camera in cameras.items():
            uncertainty[name] = distribution(camera, imaged(camera, places), error_source).judged
            estimated = judged_uncertainty_error(camera, places, error_source, depth=distribution)
            error[name] = stated_error(camera, estimated)
        winners.append(best_cameras(usable, uncertainty, error))
        everywhere = {name: np.ones(places.shape, dtype=bool) for name in pair}
        # Two tied names are not one of the pair: then neither is more certain.
        certain.append([best if best in pair else "" for best in best_cameras(everywhere, uncertainty, error)])
        with np.errstate(divide="ignore", invalid="ignore"):  # unbounded intervals are valid
            ratios.append(uncertainty[pair[0]] / uncertainty[pair[1]])
    crossings = {error_source: _crossings(case, pair, error_source) for error_source in ERROR_SOURCES}
    ends = {place: 0.0 for name in pair for place in _ends_of_use(case, name)}
    possible = {
        error_source: ends | {crossing.distance: crossing.error for crossing in crossings[error_source]}
        for error_source in ERROR_SOURCES
    }
    return PairVerdict(
        winner=[list(row) for row in zip(*winners, strict=True)],
        more_certain=[list(row) for row in zip(*certain, strict=True)],
        ratio=np.stack(ratios, axis=-1),
        crossings=crossings,
        changes=_changes(case, pair, possible),
    )


def _depths(
    cameras: tuple[DepthCamera, DepthCamera], distance: FloatArray, error_source: str
) -> tuple[DepthDistribution, DepthDistribution]:
    first, second = (distribution_between(camera, distance, error_source) for camera in cameras)
    return first, second


def _log_ratios(first: DepthDistribution, second: DepthDistribution) -> FloatArray:
    """ln(u₁/u₂) of each scramble; ±∞ where one is unbounded, NaN where both are; shape (scrambles, distances)."""
    with np.errstate(divide="ignore", invalid="ignore"):  # unbounded intervals are valid
        return np.asarray(np.log(first.judged_widths) - np.log(second.judged_widths))


def _below_one(first: DepthDistribution, second: DepthDistribution) -> FloatArray:
    """Margin by which u₁/u₂ is below one; where both are unbounded, it counts as not below, whichever is the first."""
    with np.errstate(divide="ignore", invalid="ignore"):  # unbounded intervals are valid
        ratio = first.judged / second.judged
    return margin(ratio < 1.0, ratio - 1.0)


def _ends_of_use(case: Case, camera_name: str) -> tuple[float, ...]:
    """Distances [m] where a camera becomes usable or ceases to be usable, within the range of the study."""
    intervals = usable_intervals(case.cameras[camera_name], case.criteria, case.distance)
    return tuple(
        end
        for interval in intervals
        for end, limit in ((interval.near, interval.near_limit), (interval.far, interval.far_limit))
        if limit != END_OF_STUDY
    )


def _changes(
    case: Case, pair: tuple[str, str], places: Mapping[str, Mapping[float, float]]
) -> dict[str, tuple[Change, ...]]:
    """Where the winner changes, by error source: where a usable range ends or the uncertainties are equal.

    ``places`` are these distances [m] with their errors. The winner is the usable camera with the lower uncertainty,
    regardless of its error.
    """
    # The places of all error sources are searched together, because usable ranges are the same for each.
    ordered = np.array(sorted({place for errors in places.values() for place in errors}))
    beside = np.concatenate([ordered * (1.0 - _OFFSET), ordered * (1.0 + _OFFSET)])
    cameras = {name: case.cameras[name] for name in pair}
    usable = {
        name: _within(usable_intervals(camera, case.criteria, case.distance), beside)
        for name, camera in cameras.items()
    }
    sure, changes = {name: np.zeros(beside.shape) for name in pair}, {}
    for error_source, errors in places.items():
        uncertainty = {name: judged_uncertainty(camera, beside, error_source) for name, camera in cameras.items()}
        winners = [best.split(TIED)[0] for best in best_cameras(usable, uncertainty, sure)]
        of_source: list[Change] = []
        for place, nearer, farther in zip(ordered.tolist(), winners, winners[ordered.size :], strict=False):
            # Changes of both cameras at the same place, up to rounding, are reported once.
            once = not of_source or place > of_source[-1].distance * (1.0 + _OFFSET)
            if place in errors and nearer != farther and once:
                of_source.append(Change(distance=place, error=errors[place], nearer=nearer, farther=farther))
        changes[error_source] = tuple(of_source)
    return changes


def _crossings(case: Case, pair: tuple[str, str], error_source: str) -> tuple[Crossing, ...]:
    """Where the lead passes from one camera to the other, between distances where it is significant."""
    cameras = case.cameras[pair[0]], case.cameras[pair[1]]
    distance = np.union1d(*(sought(camera, case.distance) for camera in cameras))
    depths = _depths(cameras, distance, error_source)
    ratios, below_one = _log_ratios(*depths), _below_one(*depths)
    lead = _sure_lead(ratios)
    decided = np.flatnonzero(lead)
    turns = np.flatnonzero(lead[decided[1:]] != lead[decided[:-1]])
    stretches = list(zip(decided[turns], decided[turns + 1], strict=True))
    if not stretches:
        return ()
    # The lead does not change from the end of one stretch to the beginning of the next, so they are searched together,
    # with one more distance on either side, which shows how the ratio bends.
    sides = [np.arange(max(before - 1, 0), min(after + 2, distance.size)) for before, after in stretches]
    between = np.unique(np.concatenate(sides))
    ends = boundaries(
        lambda places: _below_one(*_depths(cameras, places, error_source)),
        distance[between],
        below_one[between],
        to=_CROSSED_TO,
    )
    crossings = []
    for before, after in stretches:
        # Of several, the middle one.
        passed = [
            end.distance
            for end in ends
            if distance[before] <= end.distance <= distance[after] and end.begins == (lead[before] > 0)
        ]
        if passed:
            place, error = passed[len(passed) // 2], 0.0
            if len(ratios) > 1:  # drawn: each scramble has a root of its own
                around = _depths(cameras, places_around(place), error_source)
                error = scramble_error(_log_ratios(*around), place)
            crossings.append(Crossing(distance=place, error=error, nearer=pair[0] if lead[before] < 0 else pair[1]))
    return tuple(crossings)


def _sure_lead(ratios: FloatArray) -> FloatArray:
    """−1 where the first camera is significantly more certain, +1 where the second is, 0 where undecided."""
    with np.errstate(invalid="ignore"):  # NaN: both are unbounded
        mean = np.mean(ratios, axis=0)
        spread = np.std(ratios, axis=0, ddof=1) / math.sqrt(len(ratios)) if len(ratios) > 1 else np.zeros_like(mean)
    sure = np.isinf(mean) | (np.abs(mean) > np.maximum(_SURE * np.nan_to_num(spread), _ROUNDING))
    return np.where(sure & ~np.isnan(mean), np.sign(mean), 0.0)


def decision_group(
    study: PreparedStudy,
    readings: Mapping[str, PreparedStudy],
    progress: Progress = lambda _step, _share: None,
) -> xr.Dataset:
    """/decision from the study under each reading, without inverse questions."""
    file, case = study.file, study.case
    values: dict[str, Any] = {}
    coordinates: dict[str, Any] = {"error_source": list(ERROR_SOURCES)}
    attributes: dict[str, Any] = {}
    candidates = list(file.decision.candidates) if file.decision and file.decision.candidates else list(case.cameras)
    attributes["candidates"] = ", ".join(candidates)
    distance, best = best_along(case, candidates)
    coordinates["distance"] = distance
    values["best_camera"] = np.stack(best, axis=-1)
    values["judged_uncertainty"] = [judged_uncertainty(camera, distance) for camera in case.cameras.values()]
    causes = {}
    for camera_name, camera in case.cameras.items():
        intervals = usable_intervals(camera, case.criteria, case.distance)
        grids = (case.distance, sought(camera, case.distance))  # the denser one where the study's shows no usable place
        usable = (grid[_within(intervals, grid)] for grid in grids)
        causes[camera_name] = largest_cause(camera, next((places for places in usable if places.size), case.distance))
    inputs = [
        NamedInput() if cause is None else uncertain_input(study, camera_name, cause.parameter)
        for camera_name, cause in causes.items()
    ]
    values["cause"] = [named.words for named in inputs]
    values["cause_basis"] = [named.basis for named in inputs]
    values["cause_share"] = [math.nan if cause is None else cause.share for cause in causes.values()]
    coordinates["camera"] = list(case.cameras)
    if file.decision is not None:
        pair = (file.decision.between[0], file.decision.between[1])
        places = np.array(file.decision.at)
        verdicts: dict[str, PairVerdict] = {}
        known: dict[Any, PairVerdict] = {}  # by what a verdict depends on, which a reading may leave unchanged
        for done, (name, reading) in enumerate(readings.items()):
            progress("decision", done / len(readings))
            case_of_reading = reading.case
            cameras = (case_of_reading.cameras[camera_name] for camera_name in pair)
            compared = (*cameras, case_of_reading.criteria, case_of_reading.distance.tobytes())
            if compared not in known:
                known[compared] = decide_pair(case_of_reading, pair, places)
            verdicts[name] = known[compared]
        values |= _pair_arrays(list(verdicts.values()), file.accuracy.asked().tolerances["depth_uncertainty"])
        values["reading_says"] = readings_say(study, readings)
        coordinates |= {"reading": list(readings), "place": places}
        attributes |= {"first": pair[0], "second": pair[1]}
    return dataset("decision", values, coordinates, attributes=attributes)


def _pair_arrays(verdicts: Sequence[PairVerdict], tolerance: float) -> dict[str, Any]:
    first = verdicts[0]
    by_reading = (len(verdicts), len(ERROR_SOURCES), -1)
    changes = padded_attributes(
        [verdict.changes[error_source] for verdict in verdicts for error_source in ERROR_SOURCES],
        {"distance": math.nan, "error": math.nan, "nearer": "", "farther": ""},
    )
    crossings = padded_attributes(
        [verdict.crossings[error_source] for verdict in verdicts for error_source in ERROR_SOURCES],
        {"distance": math.nan, "error": math.nan, "nearer": ""},
    )
    return {
        "winner": np.array([verdict.winner for verdict in verdicts]),
        "more_certain": np.array([verdict.more_certain for verdict in verdicts]),
        "uncertainty_ratio": np.stack([verdict.ratio for verdict in verdicts]),
        "within_tolerance": np.stack([np.abs(verdict.ratio - 1.0) <= tolerance for verdict in verdicts]),
        "flips": np.array([verdict.winner for verdict in verdicts]) != np.array(first.winner),
        "certainty_flips": np.array([verdict.more_certain for verdict in verdicts]) != np.array(first.more_certain),
        **{f"change_{name}": values.reshape(by_reading) for name, values in changes.items()},
        **{f"crossover_{name}": values.reshape(by_reading) for name, values in crossings.items()},
    }


def readings_say(study: PreparedStudy, readings: Iterable[str]) -> list[str]:
    """What each reading assumes."""
    declared = study.file.readings
    return [declared[name].says if name in declared else "the study as declared" for name in readings]
