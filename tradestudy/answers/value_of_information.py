"""/value_of_information: the worth of knowing each assumption, and how certain the best camera and the answers are."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.answers.decision import is_usable
from tradestudy.answers.requirements import is_kept
from tradestudy.depth.evaluation import distribution, judged_at
from tradestudy.execution.steps import Progress
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset, distances_without_decision
from tradestudy.study.document import Entry
from tradestudy.study.prepared import Case, PreparedStudy
from tradestudy.study.schema.questions import AssumptionPart, ValueOfInformationPart
from tradestudy.study.varying import AnyReading, Varying, assumed
from tradestudy.uncertainty.decision import worth_of_all, worth_of_one
from tradestudy.uncertainty.streams import scrambled_sobol

STEP: Final = "value of information"
NAME: Final = "value_of_information"


def value_of_information_group(study: PreparedStudy, part: ValueOfInformationPart, progress: Progress) -> xr.Dataset:
    """/value_of_information over assumptions, candidates and distances."""
    study = study.under(NAME)
    file, case = study.file, study.case
    names = list(file.decision.candidates) if file.decision and file.decision.candidates else list(case.cameras)
    places = np.array(part.at or (file.decision.at if file.decision else distances_without_decision(case.distance)))
    own_seed = hashlib.sha256(f"{file.propagation.seed} {NAME}".encode()).digest()[:16]  # of this group alone
    rng = np.random.default_rng(int.from_bytes(own_seed))
    scaled = scrambled_sobol(len(part.assumptions), rng)(part.draws)
    assumptions = [assumed(study, assumption) for assumption in part.assumptions.values()]
    values = np.array(
        [
            [assumption.at_share(share) for share in row]
            for assumption, row in zip(assumptions, scaled.tolist(), strict=True)
        ]
    )
    outcomes = []
    for number in range(part.draws):
        progress(STEP, number / part.draws)
        changed = study.with_values(_changes(assumptions, values[:, number]))
        outcomes.append(_outcome(changed.case, names, places, part, changed))
    progress(STEP, 1.0)
    utility = np.array([outcome.utility for outcome in outcomes])
    worths = [worth_of_one(utility, row, rng) for row in values]
    whole = worth_of_all(utility)
    requirements = list(file.requirements)
    return dataset(
        NAME,
        {
            "worth": [min(worth.value, whole.value) for worth in worths],  # one assumption is never worth more than all
            "worth_error": [worth.error for worth in worths],
            "worth_bias": [worth.bias for worth in worths],
            "says": [
                assumption.says or (assumption.paths[0] if assumption.paths else name)
                for name, assumption in part.assumptions.items()
            ],
            "varied": [
                ", ".join(assumption.paths or assumption.readings or ()) for assumption in part.assumptions.values()
            ],
            "between": [_between(study, assumption) for assumption in part.assumptions.values()],
            "expected_utility": utility.mean(axis=0),
            "expected_utility_error": utility.std(axis=0, ddof=1) / math.sqrt(part.draws),
            "best_overall": np.mean(np.argmax(utility, axis=1)[:, np.newaxis] == np.arange(len(names)), axis=0),
            "best_probability": np.mean([outcome.best for outcome in outcomes], axis=0),
            "requirement_probability": np.mean([outcome.met for outcome in outcomes], axis=0),
        },
        {"assumption": list(part.assumptions), "candidate": names, "place": places, "requirement": requirements},
        attributes={
            "worth_of_all": whole.value,
            "worth_of_all_error": whole.error,
            "unusable": part.unusable,
            "draws": part.draws,
        },
    )


def _changes(assumptions: Sequence[Varying | AnyReading], values: FloatArray) -> dict[str, Entry]:
    changed: dict[str, Entry] = {}
    for assumption, value in zip(assumptions, values.tolist(), strict=True):
        changed |= assumption.changes(value)
    return changed


def _between(study: PreparedStudy, part: AssumptionPart) -> str:
    """The range of an assumption, in words."""
    if part.readings is None:
        return f"{part.low} to {part.high}"
    return "; ".join(["as declared", *(study.file.readings[reading].says for reading in part.readings)])


@dataclass(frozen=True, kw_only=True)
class _Outcome:
    """One draw: utility of every candidate, the best candidate at every distance, and which requirements are met.

    Requirements are met (1), missed (0), or undecided (NaN).
    """

    utility: FloatArray
    best: FloatArray
    met: list[float]


def _outcome(
    case: Case, names: Sequence[str], places: FloatArray, part: ValueOfInformationPart, study: PreparedStudy
) -> _Outcome:
    loss = np.array([_loss(case, camera_name, places, part.unusable) for camera_name in names])
    best = np.zeros(loss.shape)
    usable = loss.min(axis=0) < part.unusable
    best[np.argmin(loss, axis=0)[usable], np.flatnonzero(usable)] = 1.0
    verdicts = [is_kept(requirement, case) for requirement in study.file.requirements.values()]
    met = [math.nan if kept is None else float(kept) for kept in verdicts]
    return _Outcome(utility=-loss.mean(axis=1), best=best, met=met)


def _loss(case: Case, camera_name: str, places: FloatArray, unusable: float) -> FloatArray:
    """Relative depth uncertainty over distance, capped at the loss that the study assigns to an unusable camera."""
    camera = case.cameras[camera_name]
    relative = judged_at(camera, places) / places
    counted = is_usable(case, camera_name, places, distribution) & np.isfinite(relative)
    return np.where(counted, np.minimum(relative, unusable), unusable)
