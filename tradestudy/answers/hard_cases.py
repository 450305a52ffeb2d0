"""/hard_cases: the catalogue of hard cases, recomputed."""

from __future__ import annotations

import xarray as xr

from tradestudy.execution.steps import Progress, mixed
from tradestudy.results import dataset
from tradestudy.study.schema.root import HardCasesPart
from tradestudy.verification import all_families
from tradestudy.verification.case import OutcomeCase, Verdict, judge, references


def hard_cases_group(part: HardCasesPart, progress: Progress) -> xr.Dataset:
    """/hard_cases over every case of the requested families."""
    families = [family for family in all_families() if family.name in part.families]
    cases = [(family, case) for family in families for case in family.cases]
    by_place: dict[int, Verdict] = {}
    for done, place in enumerate(mixed(len(cases))):
        progress("hard cases", done / len(cases))
        family, case = cases[place]
        by_place[place] = judge(family, case, references().get(family.name, {}))
    verdicts = [by_place[place] for place in range(len(cases))]
    progress("hard cases", 1.0)
    fields = ("family", "law", "naive_answer", "our_answer", "naive_error", "our_error", "bound", "condition_number")
    return dataset(
        "hard_cases",
        {field: [getattr(verdict, field) for verdict in verdicts] for field in (*fields, "met")}
        | {
            "family_title": [family.title for family, _ in cases],
            "expected": [verdict.reference for verdict in verdicts],
            "outcome": [isinstance(case, OutcomeCase) for _, case in cases],
        },
        # Names are unique only within a family.
        {"case": [f"{family.name}: {case.name}" for family, case in cases]},
    )
