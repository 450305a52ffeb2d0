"""The conclusions of a run as lines for terminals and as JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.results.views.conclusions import (
    BestRange,
    best_ranges,
    lower_bounds,
    measure_first,
    never_best,
    never_best_words,
    never_usable,
    question_words,
    rests_on,
    worths,
)
from tradestudy.results.views.decision import solved_questions
from tradestudy.results.views.depth import measured_numbers, off_axis_words, offset_words
from tradestudy.results.views.designs import design_details, feasible_designs
from tradestudy.results.views.groups import (
    camera_titles,
    consequences,
    has,
    origin_words,
    perfectly_calibrated,
    records,
    unconverged,
)
from tradestudy.results.views.headline import answers, headline, says_stretches
from tradestudy.results.views.requirement_conclusions import (
    RequirementConclusion,
    requirement_conclusions,
    requirement_sentence,
)
from tradestudy.results.views.trade_off import candidates_by_rank, trade_off_conclusion
from tradestudy.results.views.wave_optics import fresnel_numbers, hard_case_numbers, light_numbers
from tradestudy.wording import counted, few, listed, with_unit_symbols

_SEVERAL: Final = 2
_LONGEST_LINE: Final = 400  # characters
_COUNTING: Final = 30  # of them for the number of clauses left out


def _range_words(ranges: Sequence[BestRange]) -> Iterator[str]:
    """The best cameras with their ranges, and then the ranges in which none is usable, by the reason."""
    yield from (one.words for one in ranges if one.cameras)
    nobody: dict[str, list[str]] = {}
    for one in ranges:
        if not one.cameras:
            where = f"from {one.where}"
            nobody.setdefault(one.words.removesuffix(where), []).append(where)
    yield from (why + listed(where) for why, where in nobody.items())


def _line(head: str, clauses: Sequence[str]) -> str:
    """A line of clauses, as many as it has room for, and the number of the others."""
    lengths = np.cumsum([len(head), *(len(clause) + 2 for clause in clauses)])[1:]
    shown = len(clauses) if lengths[-1] <= _LONGEST_LINE else max(1, int(np.sum(lengths < _LONGEST_LINE - _COUNTING)))
    left = [f"and {len(clauses) - shown} more in the report"] * (shown < len(clauses))
    return f"{head}: {'; '.join([*clauses[:shown], *left])}"


def _claim_words(tree: xr.DataTree) -> Iterator[str]:
    """One sentence, without a full stop, on the verdicts of all claims."""
    named: dict[str, list[str]] = {}
    for row in records(tree, "claims", "claim"):
        named.setdefault(str(row["verdict"]), []).append(str(row["claim"]))
    best_first = sorted(named, key=lambda verdict: (verdict != "met", verdict != "not met"))
    if best_first:
        yield f"Claims: {'; '.join(f'{verdict} – {listed(named[verdict])}' for verdict in best_first)}"


def terminal_lines(
    tree: xr.DataTree, most: int = 6, seconds: Mapping[str, float] = MappingProxyType({})
) -> Iterator[str]:
    """The answer in one sentence and the other conclusions of a run, in at most `most` lines.

    One of them counts the conclusions left out. Every question of the study gets its answer, even if that takes more
    lines.
    """
    return map(with_unit_symbols, _terminal_lines(tree, most, seconds))


def _terminal_lines(tree: xr.DataTree, most: int, seconds: Mapping[str, float]) -> Iterator[str]:
    ranges, requirements, rests = best_ranges(tree), requirement_conclusions(tree), rests_on(tree)
    said = answers(tree, seconds)
    yield from said[:1]
    most -= 1
    lines = []
    # For one swept parameter and one requirement, the sentence of the requirement already says this.
    feasible = feasible_designs(tree)
    if feasible is not None and not (feasible.required == 1 and requirements[0].met_ranges is not None):
        lines.append(design_details(tree))
    sentences = [(requirement_sentence(one), requirement_sentence(one, brief=True)) for one in requirements]
    judged = [full if len(full) <= _LONGEST_LINE else brief for full, brief in sentences]
    lines += judged[:1]
    solved = [f"{question_words(says)} {answer}" for says, answer in solved_questions(tree)]
    lines += solved
    needed = len(lines) if solved else 0
    lines += judged[1:]  # fewer lines may leave out a lesser requirement, but no answer to a question
    if weighed := trade_off_conclusion(tree):
        lines.append(f"Weighing all criteria: {weighed}")
    lines += [*(one.removesuffix(".") for one in said[1:]), *_claim_words(tree)]
    first = measure_first(tree)
    if rests and first == f"Measure first: {rests[0]}":
        last = [_line("Rests on (measure first)", rests)]
    else:
        last = ([_line("Rests on", rests)] if rests else []) + [first] * bool(first)
    if worse := off_axis_words(tree):
        unless = ", unless a place is named" if requirements else ""
        last.append(f"On the optical axis{unless}; off it, {few(worse)}")
    named = {one.camera for one in requirements if one.at_lower_bound and one.met}
    if bounds := [title for title in lower_bounds(tree) if title not in named]:
        last.append(f"Lower bound, as no matcher is declared: the disparity error of {few(bounds)}")
    if biased := offset_words(tree):
        last.append(f"Biased: {few(biased)}")
    if failed := unconverged(tree):
        last.append(f"Not converged: the calibration of {few(failed)}")
    if perfect := perfectly_calibrated(tree):
        last.append(f"Assumed perfect: the calibration of {few(perfect)}")
    last += origin_words(tree)
    last += [f"Contradictory inputs of {one}" for one in consequences(tree)]
    if ranges:
        designs = ", as declared" if has(tree, "requirements", "design_met") else ""
        nowhere = [f"{title} is usable nowhere ({why})" for title, why in never_usable(tree)]
        head = f"{'Best' if len(camera_titles(tree)) >= _SEVERAL else 'Usable'}{designs}"
        told, others = says_stretches(tree, "".join(said[:1])), [*never_best_words(tree), *nowhere]
        clauses = others if told else [*_range_words(ranges), *others]
        if clauses:
            last.append(_line("Others" if told else head, clauses))
    lines = [one for one in lines if f"{one}." not in said[:1]]
    room = max(most - len(last), needed + 1)
    if len(lines) > room:  # the assumptions behind the answers matter more than a fourth requirement
        hidden = lines[room - 1 :]
        missed = sum(one.startswith("Not met") for one in hidden)
        yield from lines[: room - 1]
        of = " by the study as declared" if feasible else ""
        suffix = f", including {counted(missed, 'requirement')} not met{of}" if missed else ""
        yield f"and {counted(len(hidden), 'more conclusion')} in the report{suffix}"
    else:
        yield from lines
    yield from last


JSON_FORMAT: Final = 1


def conclusions_as_json(tree: xr.DataTree) -> dict[str, Any]:
    """The conclusions of a run with numbers in SI; see `Result.conclusions` for the keys."""
    return {
        "format": JSON_FORMAT,
        **{name: str(tree.attrs.get(name, "")) for name in ("study", "title", "question")},
        "headline": headline(tree),
        "best": [{"near": one.near, "far": one.far, "cameras": list(one.cameras)} for one in best_ranges(tree)],
        "best_nowhere": [{"camera": title, "at_least": ratio} for title, ratio in never_best(tree)],
        "lower_bounds": list(lower_bounds(tree)),
        "requirements": [_requirement_as_json(one) for one in requirement_conclusions(tree)],
        **_designs_as_json(tree),
        "questions": _questions_as_json(tree),
        "trade_off": [
            {"camera": one.title, "first": one.ranks[0], "error": one.first_error} for one in candidates_by_rank(tree)
        ],
        "measured": _rows_as_json(measured_numbers(tree)),
        "light_spot": _rows_as_json(light_numbers(tree)),
        "fresnel_validity": _rows_as_json(fresnel_numbers(tree)),
        "hard_cases": hard_case_numbers(tree),
        "rests_on": list(rests_on(tree)),
        "measure_first": measure_first(tree),
        "assumptions": [
            {"assumption": one.says, "between": one.between, "worth": one.worth, "error": one.error}
            for one in worths(tree)
        ],
    }


def _rows_as_json(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    return [{key: value if isinstance(value, str) else _number(value) for key, value in one.items()} for one in rows]


def _requirement_as_json(one: RequirementConclusion) -> dict[str, Any]:
    found: dict[str, Any] = {
        name: getattr(one, name) for name in ("name", "says", "priority", "met", "camera", "reason", "rests_on")
    }
    found |= {name: _number(getattr(one, name)) for name in ("margin", "place", "conformity", "probability")}
    found["on_lower_bound"] = one.at_lower_bound
    if one.others:
        found["others"] = [
            {"camera": other.camera, "met": other.met, "margin": _number(other.margin), "reason": other.reason}
            for other in one.others
        ]
    if (best := one.bound_alone) is not None:
        found["bound_alone"] = {"met": best.met, "camera": best.camera, "reason": best.reason}
    if one.readings:
        found |= {
            "readings": one.readings,
            "other_verdicts": [
                {"reading": other.says, "met": other.met, "camera": other.camera, "reason": other.reason}
                for other in one.other_verdicts
            ],
        }
    if one.designs is not None:
        found |= {"designs_met": one.designs[0], "designs": one.designs[1]}
    if one.met_ranges is not None:
        found["met_with"] = [
            {
                "parameter": along.parameter,
                "from": along.low,
                "to": along.high,
                "error": along.error,
                "camera": along.camera,
            }
            for along in one.met_ranges
        ]
    return found


def _questions_as_json(tree: xr.DataTree) -> list[dict[str, Any]]:
    if not has(tree, "decision", "solved_answer"):
        return []
    return [
        {
            "name": str(row["question"]),
            "says": str(row["solved_says"]),
            "answer": str(row["solved_answer"]),
            "value": _number(float(row["solved_value"])),
            "error": _number(float(row["solved_error"])),
            "units": str(row["solved_units"]),
            "solutions": int(row["solution_count"]),
        }
        for row in records(tree, "decision", "question")
    ]


def _designs_as_json(tree: xr.DataTree) -> dict[str, Any]:
    found = feasible_designs(tree)
    if found is None:
        return {}
    best = {"values": found.best.values, "margin": _number(found.best.margin)}
    return {"designs": {"count": found.designs, "feasible": found.count, "best": best}}


def _number(value: float) -> float | None:
    """The value, or None for NaN and infinity, which JSON lacks."""
    return value if np.isfinite(value) else None
