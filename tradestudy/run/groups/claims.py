"""/claims and /requirements: the study's declared expectations, answered."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from tradestudy.analysis.claims import (
    answer_requirement,
    claim_quantity,
    claim_value,
    expectation,
    is_met,
    verdict_over_readings,
)
from tradestudy.execution.steps import Progress
from tradestudy.results import dataset
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.expectations import claim_dimension
from tradestudy.units import pretty


def claims_group(
    definition: StudyDefinition,
    readings: Mapping[str, StudyDefinition],
    progress: Progress = lambda _step, _share: None,
) -> xr.Dataset:
    """/claims: value and answer under each reading that a claim names, and the verdict."""
    claims = definition.file.claims
    names = list(readings)
    declared = names[0]
    value = np.full((len(claims), len(names)), np.nan)
    met = np.full(value.shape, -1, dtype=np.int8)
    text = np.full(value.shape, "", dtype=object)
    verdicts = []
    for row, (key, claim) in enumerate(claims.items()):
        progress("claims", row / len(claims))
        dimension = claim_dimension(claim)
        answers: dict[str, bool | None] = {}
        own = claim.reading or declared
        others = [name for name in names if name != own] if claim.under == "all" else claim.under
        for name in (own, *others):
            column = names.index(name)
            # A reading may change what is asked too, such as the blur that counts as sharp; never what is expected.
            value[row, column] = claim_value(readings[name].file.claims[key], readings[name].case)
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


def requirements_group(definition: StudyDefinition) -> xr.Dataset:
    """/requirements: met or not, and by what margin."""
    requirements = definition.file.requirements
    answers = [answer_requirement(requirement, definition.case) for requirement in requirements.values()]
    return dataset(
        "requirements",
        {
            "says": [requirement.says for requirement in requirements.values()],
            "met": [answer.met for answer in answers],
            "camera": [answer.camera for answer in answers],
            "margin_percent": [answer.margin_percent for answer in answers],
            "margin_sigma": [answer.margin_sigma for answer in answers],
            "reason": [answer.reason for answer in answers],
        },
        {"requirement": list(requirements)},
    )
