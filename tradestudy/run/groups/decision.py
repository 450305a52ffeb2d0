"""/decision and /claims: answers to a study's questions under every reading of its assumptions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.analysis.causes import largest_cause
from tradestudy.analysis.claims import (
    claim_quantity,
    claim_value,
    claims_in_order,
    could_be_overturned,
    expectation,
    is_met,
    readings_of,
    verdict_over_readings,
)
from tradestudy.analysis.decision import PairVerdict, best_cameras, decide_pair, stated_error
from tradestudy.analysis.depth import ERROR_SOURCES
from tradestudy.analysis.inverse_questions import solve
from tradestudy.analysis.required_values import solve_requirement
from tradestudy.execution.steps import Progress
from tradestudy.results import dataset, judged_uncertainty
from tradestudy.run.groups.depth import depth_as_declared
from tradestudy.study.bases import input_words
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.claims import claim_dimension
from tradestudy.units import pretty


def decision_group(
    definition: StudyDefinition,
    readings: Mapping[str, StudyDefinition],
    depth: xr.Dataset,
    progress: Progress = lambda _step, _share: None,
) -> xr.Dataset:
    """/decision from /depth and from the study under each reading, without inverse questions."""
    file, case = definition.file, definition.case
    values: dict[str, Any] = {}
    coordinates: dict[str, Any] = {"distance": case.distance, "error_source": list(ERROR_SOURCES)}
    attributes: dict[str, Any] = {}
    nominal = depth if depth["depth_uncertainty"].ndim == 2 else depth_as_declared(definition)
    rows = {name: i for i, name in enumerate(case.cameras)}
    names = list(file.decision.candidates) if file.decision and file.decision.candidates else list(rows)
    attributes["candidates"] = ", ".join(names)
    usable = {name: nominal["usable"].values[rows[name]] for name in names}
    widths, errors = (judged_uncertainty(nominal, f"_by_error_source{of}").values for of in ("", "_error"))
    values["best_camera"] = np.stack(
        [
            best_cameras(
                usable,
                {name: widths[rows[name], :, w] for name in names},
                {name: stated_error(case.cameras[name], errors[rows[name], :, w]) for name in names},
            )
            for w in range(len(ERROR_SOURCES))
        ],
        axis=-1,
    )
    causes = {}
    for name, camera in case.cameras.items():
        used = nominal["usable"].values[rows[name]]
        causes[name] = largest_cause(camera, case.distance[used] if used.any() else case.distance)
    values["cause"] = [
        "" if one is None else input_words(definition, name, one.parameter) for name, one in causes.items()
    ]
    values["cause_share"] = [math.nan if one is None else one.share for one in causes.values()]
    coordinates["camera"] = list(case.cameras)
    if file.decision is not None:
        pair = (file.decision.between[0], file.decision.between[1])
        places = np.array(file.decision.at)
        verdicts: dict[str, PairVerdict] = {}
        known: dict[Any, PairVerdict] = {}  # by what a verdict depends on
        for done, (name, reading) in enumerate(readings.items()):
            progress("decision", done / len(readings))
            asked = (*(reading.case.cameras[one] for one in pair), reading.case.criteria)
            if asked not in known:
                known[asked] = decide_pair(reading.case, pair, places)
            verdicts[name] = known[asked]
        values |= _pair_arrays(verdicts, file.accuracy.asked().tolerances["depth_uncertainty"])
        values["reading_says"] = _in_words(definition, readings)
        coordinates |= {"reading": list(readings), "place": places}
        attributes |= {"first": pair[0], "second": pair[1]}
    return dataset("decision", values, coordinates, attributes=attributes)


def questions_group(definition: StudyDefinition, progress: Progress) -> xr.Dataset:
    """The part of /decision that answers inverse questions, for cameras of every kind."""
    questions = definition.file.solve
    solved = []
    for done, (name, question) in enumerate(questions.items()):
        progress("inverse questions", done / len(questions))
        solved.append((solve_requirement if question.requirement else solve)(definition.under(name), question))
    progress("inverse questions", 1.0)
    return dataset(
        "decision",
        {
            "solution_count": [len(answer.solutions) for answer in solved],
            "solved_value": [answer.value for answer in solved],
            "solved_error": [answer.error for answer in solved],
            "solved_units": [answer.dimension.unit for answer in solved],
            "solved_says": [question.says for question in questions.values()],
            "solved_answer": [answer.answer for answer in solved],
        },
        {"question": list(questions)},
    )


def _pair_arrays(verdicts: Mapping[str, PairVerdict], tolerance: float) -> dict[str, Any]:
    first = next(iter(verdicts.values()))
    readings = list(verdicts.values())
    changes = _padded(
        [v.changes for v in readings], ("distance", "error", "nearer", "farther"), (math.nan, math.nan, "", "")
    )
    crossings = _padded([v.crossings for v in readings], ("distance", "error", "nearer"), (math.nan, math.nan, ""))
    return {
        "winner": np.array([v.winner for v in verdicts.values()]),
        "more_certain": np.array([v.more_certain for v in verdicts.values()]),
        "uncertainty_ratio": np.stack([v.ratio for v in verdicts.values()]),
        "within_tolerance": np.stack([np.abs(np.asarray(v.ratio) - 1.0) <= tolerance for v in verdicts.values()]),
        "flips": np.array([v.winner for v in verdicts.values()]) != np.array(first.winner),
        "certainty_flips": np.array([v.more_certain for v in verdicts.values()]) != np.array(first.more_certain),
        **{f"change_{name}": values for name, values in changes.items()},
        **{f"crossover_{name}": values for name, values in crossings.items()},
    }


def _padded(
    rows: Sequence[Mapping[str, Sequence[Any]]], fields: Sequence[str], absent: Sequence[Any]
) -> dict[str, Any]:
    """Every field of the events, over (reading, error source, event), padded to equal length and at least one event."""
    most = max((len(events) for row in rows for events in row.values()), default=0)
    return {
        name: np.array(
            [
                [
                    [getattr(one, name) for one in row[error_source]]
                    + [empty] * (max(most, 1) - len(row[error_source]))
                    for error_source in ERROR_SOURCES
                ]
                for row in rows
            ]
        )
        for name, empty in zip(fields, absent, strict=True)
    }


def _in_words(definition: StudyDefinition, readings: Iterable[str]) -> list[str]:
    """What each reading assumes."""
    declared = definition.file.readings
    return [declared[name].says if name in declared else "the study as declared" for name in readings]


def claims_group(
    definition: StudyDefinition,
    readings: Mapping[str, StudyDefinition],
    progress: Progress = lambda _step, _share: None,
) -> xr.Dataset:
    """/claims: value and answer under each reading that a claim names, with the verdict."""
    claims = definition.file.claims
    titles = {name: part.title for name, part in definition.file.cameras.items()}
    names = list(readings)
    value = np.full((len(claims), len(names)), np.nan)
    met = np.full(value.shape, -1, dtype=np.int8)
    text, near = np.full(value.shape, "", dtype=object), np.zeros(value.shape)
    tolerance = definition.file.accuracy.tolerance
    rows, asked = list(claims), claims_in_order(claims, names)
    says = {name: reading.says for name, reading in definition.file.readings.items()}
    answers: dict[str, dict[str, bool | None]] = {key: {} for key in claims}
    for done, (key, name) in enumerate(asked):
        progress("claims", done / (len(asked) + len(definition.file.requirements)))
        row, column, claim, dimension = rows.index(key), names.index(name), claims[key], claim_dimension(claims[key])
        # A reading may also change what a claim asks, such as the blur that counts as sharp, but never what it expects.
        value[row, column] = claim_value(readings[name].file.claims[key], readings[name].case)
        text[row, column] = pretty(value[row, column], dimension)
        answers[key][name] = is_met(claim.expect, value[row, column], dimension)
        met[row, column] = -1 if answers[key][name] is None else int(bool(answers[key][name]))
        near[row, column] = could_be_overturned(claim.expect, value[row, column], dimension, tolerance)
    verdicts = [
        verdict_over_readings({name: answers[key][name] for name in readings_of(claim, names)}, says)
        for key, claim in claims.items()
    ]
    return dataset(
        "claims",
        {
            "value": value,
            "met": met,
            "value_text": text,
            "reading_says": _in_words(definition, names),
            "says": [claim.says for claim in claims.values()],
            "source": [claim.source for claim in claims.values()],
            "expected": [expectation(claim.expect) for claim in claims.values()],
            "quantity": [claim_quantity(claim, titles) for claim in claims.values()],
            "tolerance_reason": [claim.tolerance_reason for claim in claims.values()],
            "verdict": [verdict for verdict, _ in verdicts],
            "reason": [reason for _, reason in verdicts],
            "within_tolerance": near,
        },
        {"claim": list(claims), "reading": names},
    )
