"""The conclusions of a run as lines for terminals and as JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.results.views.conclusion_list import ANSWERS, conclusions
from tradestudy.results.views.conclusions import (
    best_ranges,
    lower_bounds,
    measure_first,
    never_best,
    rests_on,
    worths,
)
from tradestudy.results.views.decision import reversing
from tradestudy.results.views.depth import measured_numbers
from tradestudy.results.views.designs import feasible_designs
from tradestudy.results.views.groups import (
    has,
    records,
)
from tradestudy.results.views.headline import headline
from tradestudy.results.views.requirement_conclusions import (
    RequirementConclusion,
    requirement_conclusions,
)
from tradestudy.results.views.trade_off import candidates_by_rank
from tradestudy.results.views.wave_optics import fresnel_numbers, hard_case_numbers, light_numbers
from tradestudy.wording import counted, with_unit_symbols


def terminal_lines(
    tree: xr.DataTree, most: int = 6, seconds: Mapping[str, float] = MappingProxyType({})
) -> Iterator[str]:
    """The answer in one sentence and the other conclusions of a run, in at most `most` lines.

    One of them counts the conclusions left out. Every question of the study gets its answer, even if that takes more
    lines.
    """
    stated = conclusions(tree, seconds)
    said = [str(conclusion) for conclusion in stated if conclusion.kind == "headline"]
    # For one swept parameter and one requirement, the sentence of the requirement already says which designs meet it.
    feasible, judged = feasible_designs(tree), requirement_conclusions(tree)
    told = (
        ["designs"]
        if feasible and feasible.count and feasible.required == 1 and judged[0].met_ranges is not None
        else []
    )
    answering = [
        conclusion
        for conclusion in stated
        if conclusion.kind in ANSWERS and conclusion.kind not in told and f"{conclusion}." not in said
    ]
    last = [str(conclusion) for conclusion in stated if conclusion.kind not in (*ANSWERS, "headline", "not reversed")]
    asked = [number for number, conclusion in enumerate(answering, start=1) if conclusion.kind == "question"]
    # The assumptions behind the answers matter more than a fourth requirement, but no question goes unanswered.
    room = max(most - 1 - len(last), max(asked, default=0) + 1)
    shown = answering if len(answering) <= room else answering[: room - 1]
    lines = [*said, *map(str, shown)]
    if hidden := answering[len(shown) :]:
        missed = sum(conclusion.kind == "requirement" and conclusion.head == "Not met" for conclusion in hidden)
        suffix = f", including {counted(missed, 'requirement')} not met" if missed else ""
        suffix += " by the study as declared" * bool(suffix and feasible)
        lines.append(f"and {counted(len(hidden), 'more conclusion')} in the report{suffix}")
    return map(with_unit_symbols, [*lines, *last])


JSON_FORMAT: Final = 1


def conclusions_as_json(tree: xr.DataTree, seconds: Mapping[str, float] = MappingProxyType({})) -> dict[str, Any]:
    """The conclusions of a run with numbers in SI; see `Result.conclusions` for the keys, `headline` for `seconds`."""
    return {
        "format": JSON_FORMAT,
        **{name: str(tree.attrs.get(name, "")) for name in ("study", "title", "question")},
        "headline": headline(tree, seconds),
        "best": [
            {"near": stretch.near, "far": stretch.far, "cameras": list(stretch.cameras)}
            for stretch in best_ranges(tree)
        ],
        "best_nowhere": [{"camera": title, "at_least": ratio} for title, ratio in never_best(tree)],
        "lower_bounds": list(lower_bounds(tree)),
        "requirements": [_requirement_as_json(requirement) for requirement in requirement_conclusions(tree)],
        **_designs_as_json(tree),
        "questions": _questions_as_json(tree),
        "trade_off": [
            {"camera": candidate.title, "first": candidate.ranks[0], "error": candidate.first_error}
            for candidate in candidates_by_rank(tree)
        ],
        "measured": _rows_as_json(measured_numbers(tree)),
        "light_spot": _rows_as_json(light_numbers(tree)),
        "fresnel_validity": _rows_as_json(fresnel_numbers(tree)),
        "hard_cases": hard_case_numbers(tree),
        "rests_on": list(rests_on(tree)),
        "measure_first": measure_first(tree),
        "reversed_by": [{"reading": says, "at": places} for says, places in reversing(tree) or ()],
        "assumptions": [
            {
                "assumption": assumption.says,
                "between": assumption.between,
                "worth": assumption.worth,
                "error": assumption.error,
            }
            for assumption in worths(tree)
        ],
    }


def _rows_as_json(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    return [{key: value if isinstance(value, str) else _number(value) for key, value in row.items()} for row in rows]


def _requirement_as_json(requirement: RequirementConclusion) -> dict[str, Any]:
    entries: dict[str, Any] = {
        field: getattr(requirement, field)
        for field in ("name", "says", "priority", "met", "camera", "reason", "rests_on")
    }
    entries |= {
        field: _number(getattr(requirement, field)) for field in ("margin", "place", "conformity", "probability")
    }
    entries["on_lower_bound"] = requirement.at_lower_bound
    if requirement.others:
        entries["others"] = [
            {"camera": other.camera, "met": other.met, "margin": _number(other.margin), "reason": other.reason}
            for other in requirement.others
        ]
    if (best := requirement.bound_alone) is not None:
        entries["bound_alone"] = {"met": best.met, "camera": best.camera, "reason": best.reason}
    if requirement.readings:
        entries |= {
            "readings": requirement.readings,
            "other_verdicts": [
                {"reading": other.says, "met": other.met, "camera": other.camera, "reason": other.reason}
                for other in requirement.other_verdicts
            ],
        }
    if requirement.designs is not None:
        entries |= {"designs_met": requirement.designs[0], "designs": requirement.designs[1]}
    if requirement.met_ranges is not None:
        entries["met_with"] = [
            {
                "parameter": met_range.parameter,
                "from": met_range.low,
                "to": met_range.high,
                "error": met_range.error,
                "camera": met_range.camera,
            }
            for met_range in requirement.met_ranges
        ]
    return entries


def _questions_as_json(tree: xr.DataTree) -> list[dict[str, Any]]:
    if not has(tree, "decision", "solved_answer"):
        return []
    return [
        {
            "name": str(row["question"]),
            "says": with_unit_symbols(str(row["solved_says"])),
            "answer": with_unit_symbols(str(row["solved_answer"])),
            "value": _number(float(row["solved_value"])),
            "error": _number(float(row["solved_error"])),
            "units": str(row["solved_units"]),
            "solutions": int(row["solution_count"]),
        }
        for row in records(tree, "decision", "question")
    ]


def _designs_as_json(tree: xr.DataTree) -> dict[str, Any]:
    feasible = feasible_designs(tree)
    if feasible is None:
        return {}
    best = {"values": feasible.best.values, "margin": _number(feasible.best.margin)}
    return {"designs": {"count": feasible.designs, "feasible": feasible.count, "best": best}}


def _number(value: float) -> float | None:
    """The value, or None for NaN and infinity, which JSON lacks."""
    return value if np.isfinite(value) else None
