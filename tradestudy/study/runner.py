"""From a study definition to the results tree: depth, decision, claims, registers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.cameras.focused_plenoptic import FocusedPlenoptic
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import FORMAT_VERSION, dataset
from tradestudy.study.claims import (
    answer_requirement,
    claim_dimension,
    claim_quantity,
    claim_value,
    expectation,
    is_met,
    verdict_over_readings,
)
from tradestudy.study.contradictions import find_contradictions
from tradestudy.study.decision import PairVerdict, best_cameras, decide_pair, solve
from tradestudy.study.definition import Case, StudyDefinition
from tradestudy.study.depth import QUANTILES, WAYS, DepthEvaluation, evaluate_depth
from tradestudy.study.properties import camera_properties
from tradestudy.study.sweep import sweep_axes, sweep_points
from tradestudy.study.usable import LIMIT_NAMES, Interval, all_met, evaluate_limits, usable_intervals
from tradestudy.units import pretty

NOMINAL = "as declared"
Progress = Callable[[str, float], None]


def compute(definition: StudyDefinition, progress: Progress = lambda _step, _share: None) -> xr.DataTree:
    """Compute everything that a study asks for.

    Parameters
    ----------
    definition
        The study.
    progress
        Called with the name of the step and the share done, 0 … 1.

    Returns
    -------
    xarray.DataTree
        As declared in `tradestudy.results`.
    """
    file = definition.file
    readings = {NOMINAL: definition} | {
        name: definition.with_values(reading.set) for name, reading in file.readings.items()
    }
    progress("depth", 0.0)
    groups: dict[str, xr.Dataset] = {
        "/": xr.Dataset(
            attrs={
                "format_version": FORMAT_VERSION,
                "study": file.study,
                "title": file.title,
                "question": file.question,
                "wavelength": file.scene.wavelength,
            }
        ),
        "/cameras": _cameras(definition),
        "/depth": _depth(definition, progress),
        "/assumptions": _assumptions(definition),
        "/contradictions": _contradictions(definition),
    }
    progress("decision", 0.5)
    groups["/decision"] = _decision(definition, readings, groups["/depth"])
    progress("claims", 0.9)
    if file.claims:
        groups["/claims"] = _claims(definition, readings)
    if file.requirements:
        groups["/requirements"] = _requirements(definition)
    progress("results", 1.0)
    return xr.DataTree.from_dict(groups)


def _cameras(definition: StudyDefinition) -> xr.Dataset:
    parts, cameras = definition.file.cameras, definition.case.cameras
    properties = [(name, *item) for name, camera in cameras.items() for item in camera_properties(camera)]
    return dataset(
        "cameras",
        {
            "title": [part.title for part in parts.values()],
            "kind": [part.kind for part in parts.values()],
            "family": [camera.family for camera in cameras.values()],
            "note": [part.note or "" for part in parts.values()],
            "property_camera": [item[0] for item in properties],
            "property_name": [item[1] for item in properties],
            "property_value": [item[2] for item in properties],
        },
        {"camera": list(cameras)},
    )


def _depth(definition: StudyDefinition, progress: Progress) -> xr.Dataset:
    axes = sweep_axes(definition)
    points = sweep_points(definition, axes)
    tables = []
    for number, point in enumerate(points):
        progress("depth", 0.5 * number / len(points))
        tables.append(_depth_of_case(point.case))
    part_names = list(dict.fromkeys(name for table in tables for name in table["parts"]))
    intervals = max(len(rows) for table in tables for rows in table["intervals"])
    shape = tuple(len(axis.labels) for axis in axes)
    arrays = [_depth_arrays(table, part_names, max(intervals, 1)) for table in tables]
    stacked = {
        name: np.stack([array[name] for array in arrays]).reshape(shape + np.shape(arrays[0][name]))
        for name in arrays[0]
    }
    leading = tuple(axis.path for axis in axes)
    coordinates: dict[str, Any] = {axis.path: axis.labels for axis in axes}
    coordinates |= {
        "camera": list(definition.case.cameras),
        "distance": definition.case.distance,
        "side": ["nearer", "farther"],
        "way": list(WAYS),
        "quantile": list(QUANTILES),
        "part": part_names,
        "limit": list(LIMIT_NAMES),
    }
    result = dataset("depth", stacked, coordinates, leading=leading)
    for axis in axes:
        result[axis.path].attrs = {"units": axis.units, "long_name": axis.path}
    return result


def _depth_of_case(case: Case) -> dict[str, Any]:
    """Evaluate all cameras of one case; ragged things stay lists."""
    evaluations = {name: evaluate_depth(camera, case.distance) for name, camera in case.cameras.items()}
    limits = [evaluate_limits(camera, case.criteria, case.distance) for camera in case.cameras.values()]
    return {
        "evaluations": list(evaluations.values()),
        "limits": limits,
        "parts": list(dict.fromkeys(name for e in evaluations.values() for name in e.parts)),
        "intervals": [usable_intervals(camera, case.criteria, case.distance) for camera in case.cameras.values()],
        "virtual_depth": [
            camera.virtual_depth(case.distance)
            if isinstance(camera, FocusedPlenoptic)
            else np.full_like(case.distance, np.nan)
            for camera in case.cameras.values()
        ],
        "usable": [all_met(limit, case.distance.shape) for limit in limits],
    }


def _depth_arrays(table: Mapping[str, Any], part_names: list[str], most_intervals: int) -> dict[str, Any]:
    """The variables of /depth for one case, camera first."""
    evaluations: list[DepthEvaluation] = table["evaluations"]
    distance = evaluations[0].distance
    missing = np.full_like(distance, np.nan)

    def over_limits(attribute: str, absent: float) -> FloatArray:
        rows = [
            [
                np.broadcast_to(
                    np.asarray(getattr(limits[name], attribute) if name in limits else absent, dtype=np.float64),
                    distance.shape,
                )
                for name in LIMIT_NAMES
            ]
            for limits in table["limits"]
        ]
        return np.moveaxis(np.array(rows), 1, 2)

    def over_intervals(attribute: str, absent: Any) -> Any:
        return np.array([_padded(rows, attribute, absent, most_intervals) for rows in table["intervals"]])

    uncertainty = np.stack([e.uncertainty for e in evaluations])
    return {
        "depth_discrimination": np.stack([e.discrimination.T for e in evaluations]),
        "depth_uncertainty": uncertainty[:, WAYS.index("both")],
        "depth_uncertainty_error": np.stack([e.uncertainty_error for e in evaluations]),
        "depth_uncertainty_way": np.moveaxis(uncertainty, 1, 2),
        "depth_uncertainty_part": np.stack(
            [np.stack([e.parts.get(name, missing) for name in part_names], axis=-1) for e in evaluations]
        ),
        "depth_quantile": np.stack([np.moveaxis(e.quantile, 0, 1) for e in evaluations]),
        "failed_fraction": np.stack([e.failed_fraction.T for e in evaluations]),
        "equivalent_baseline": np.stack([e.equivalent_baseline for e in evaluations]),
        "disparity_px": np.stack([e.disparity_px for e in evaluations]),
        "virtual_depth": np.stack(table["virtual_depth"]),
        "usable": np.stack(table["usable"]),
        "limit_value": over_limits("value", math.nan),
        "limit_met": over_limits("met", -1.0).astype(np.int8),
        "limit_bound": over_limits("bound", math.nan)[:, 0],
        "usable_near": over_intervals("near", math.nan),
        "usable_far": over_intervals("far", math.nan),
        "near_limit": over_intervals("near_limit", ""),
        "far_limit": over_intervals("far_limit", ""),
    }


def _padded(rows: tuple[Interval, ...], attribute: str, absent: Any, length: int) -> list[Any]:
    return [getattr(row, attribute) for row in rows] + [absent] * (length - len(rows))


def _decision(definition: StudyDefinition, readings: Mapping[str, StudyDefinition], depth: xr.Dataset) -> xr.Dataset:
    file, case = definition.file, definition.case
    values: dict[str, Any] = {}
    coordinates: dict[str, Any] = {"distance": case.distance, "way": list(WAYS)}
    attributes: dict[str, Any] = {}
    nominal = depth if depth["depth_uncertainty"].ndim == 2 else _depth_without_sweep(definition)
    names = list(case.cameras)
    usable = {name: nominal["usable"].values[i] for i, name in enumerate(names)}
    values["best_camera"] = np.stack(
        [
            np.array(
                best_cameras(usable, {n: nominal["depth_uncertainty_way"].values[i, :, w] for i, n in enumerate(names)})
            )
            for w in range(len(WAYS))
        ],
        axis=-1,
    )
    if file.decision is not None:
        pair = (file.decision.between[0], file.decision.between[1])
        places = np.array(file.decision.at)
        verdicts = {name: decide_pair(reading.case, pair, places) for name, reading in readings.items()}
        values |= _pair_arrays(verdicts)
        values["reading_says"] = ["the study as declared", *(reading.says for reading in file.readings.values())]
        coordinates |= {"reading": list(readings), "place": places}
        attributes |= {"first": pair[0], "second": pair[1]}
    if file.solve:
        solved = [solve(definition, question) for question in file.solve.values()]
        values |= {
            "solved_value": [answer.value for answer in solved],
            "solved_units": [answer.dimension.unit for answer in solved],
            "solved_says": [question.says for question in file.solve.values()],
            "solved_answer": [answer.answer for answer in solved],
        }
        coordinates["question"] = list(file.solve)
    return dataset("decision", values, coordinates, attributes=attributes)


def _depth_without_sweep(definition: StudyDefinition) -> xr.Dataset:
    """Depth of the study as declared, for decisions in a study that also sweeps."""
    table = _depth_of_case(definition.case)
    return dataset("depth", _depth_arrays(table, table["parts"], 1 + max(map(len, table["intervals"]))), {})


def _pair_arrays(verdicts: Mapping[str, PairVerdict]) -> dict[str, Any]:
    first = next(iter(verdicts.values()))
    most = max((len(c) for v in verdicts.values() for c in v.crossings.values()), default=0)
    crossings = [
        [[*v.crossings[way], *[(math.nan, "")] * (max(most, 1) - len(v.crossings[way]))] for way in WAYS]
        for v in verdicts.values()
    ]
    return {
        "winner": np.array([v.winner for v in verdicts.values()]),
        "more_certain": np.array([v.more_certain for v in verdicts.values()]),
        "uncertainty_ratio": np.stack([v.ratio for v in verdicts.values()]),
        "flips": np.array([v.more_certain for v in verdicts.values()]) != np.array(first.more_certain),
        "crossover_distance": np.array([[[c[0] for c in way] for way in reading] for reading in crossings]),
        "crossover_nearer": np.array([[[c[1] for c in way] for way in reading] for reading in crossings]),
    }


def _claims(definition: StudyDefinition, readings: Mapping[str, StudyDefinition]) -> xr.Dataset:
    claims = definition.file.claims
    names = list(readings)
    value = np.full((len(claims), len(names)), np.nan)
    met = np.full(value.shape, -1, dtype=np.int8)
    text = np.full(value.shape, "", dtype=object)
    verdicts = []
    for row, claim in enumerate(claims.values()):
        dimension = claim_dimension(claim)
        answers: dict[str, bool | None] = {}
        for name in (NOMINAL, *claim.under):
            column = names.index(name)
            value[row, column] = claim_value(claim, readings[name].case)
            text[row, column] = pretty(value[row, column], dimension)
            answers[name] = is_met(claim.expect, value[row, column], dimension)
            met[row, column] = -1 if answers[name] is None else int(bool(answers[name]))
        verdicts.append(verdict_over_readings(answers))
    return dataset(
        "claims",
        {
            "value": value,
            "met": met,
            "value_text": text,
            "says": [claim.says for claim in claims.values()],
            "source": [claim.source for claim in claims.values()],
            "expected": [expectation(claim.expect) for claim in claims.values()],
            "quantity": [claim_quantity(claim) for claim in claims.values()],
            "tolerance_reason": [claim.tolerance_reason for claim in claims.values()],
            "verdict": [verdict for verdict, _ in verdicts],
            "reason": [reason for _, reason in verdicts],
        },
        {"claim": list(claims), "reading": names},
    )


def _requirements(definition: StudyDefinition) -> xr.Dataset:
    requirements = definition.file.requirements
    answers = [answer_requirement(requirement, definition.case) for requirement in requirements.values()]
    return dataset(
        "requirements",
        {
            "says": [requirement.says for requirement in requirements.values()],
            "met": [answer.met for answer in answers],
            "camera": [answer.camera for answer in answers],
            "margin_percent": [answer.margin_percent for answer in answers],
            "reason": [answer.reason for answer in answers],
        },
        {"requirement": list(requirements)},
    )


def _assumptions(definition: StudyDefinition) -> xr.Dataset:
    document = definition.document
    rows = [(path, note) for path, note in document.annotations.items()]
    return dataset(
        "assumptions",
        {
            "value": [document.text_of(path) for path, _ in rows],
            "basis": [note.basis for _, note in rows],
            "note": [note.note or "" for _, note in rows],
        },
        {"path": [".".join(str(key) for key in path) for path, _ in rows]},
    )


def _contradictions(definition: StudyDefinition) -> xr.Dataset:
    found = find_contradictions(definition)
    fields = ("camera", "what", "stated", "implied", "used")
    return dataset("contradictions", {name: [getattr(row, name) for row in found] for name in fields}, {})
