"""Answers that changed: verdicts on requirements and claims, and the answers to inverse questions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tradestudy.comparison.difference import ARROW, Difference, Run, same_or_each
from tradestudy.comparison.stated_errors import SURE
from tradestudy.results.views.groups import has, records
from tradestudy.results.views.requirement_conclusions import (
    MetRange,
    RequirementConclusion,
    decided_by,
    requirement_conclusions,
)
from tradestudy.results.views.trade_off import candidates_by_rank
from tradestudy.units import FRACTION, pretty
from tradestudy.wording import counted

NOT_ASKED = "not asked"
_NOWHERE = "at no value that was tried"
_WORST = "worst "


@dataclass(frozen=True, kw_only=True)
class Answers:
    """The questions of one kind that are answered differently, and the number of those answered the same."""

    changed: tuple[Difference, ...]
    unchanged: int


def compare_requirements(runs: Sequence[Run]) -> Answers:
    """Compare verdicts on requirements, the cameras that decide them, and, in sweeps, the designs that meet them."""
    found = [{one.name: one for one in requirement_conclusions(run.tree)} for run in runs]
    bounds = [
        {row["requirement"]: row["bound"] for row in records(run.tree, "requirements", "requirement")} for run in runs
    ]
    changed: list[Difference] = []
    names = list(dict.fromkeys(name for one in found for name in one))
    unchanged = 0
    for name in names:
        ones = [one.get(name) for one in found]
        same_bound = len({one[name] for one in bounds if name in one}) == 1
        differences = list(_of_requirement(ones, same_bound=same_bound))
        changed += differences
        unchanged += not differences
    return Answers(changed=tuple(changed), unchanged=unchanged)


def _of_requirement(ones: Sequence[RequirementConclusion | None], *, same_bound: bool) -> Iterator[Difference]:
    there = [one for one in ones if one is not None]
    what = f'Requirement "{same_or_each([one.says for one in there])}"'
    verdicts = tuple(NOT_ASKED if one is None else one.verdict for one in ones)
    deciding = [decided_by(one) for one in there]
    if len(set(verdicts)) > 1:
        details = [_reasons(there), "" if same_bound else "its bound differs"]
        yield Difference(what=what, values=verdicts, where=f"({'; '.join(filter(None, details))})")
    elif len(set(deciding)) > 1:
        yield Difference(
            what=what, values=tuple(f"{one.verdict}, {by}" for one, by in zip(there, deciding, strict=True))
        )
    if len(there) == len(ones):
        yield from _of_designs(what, there)


def _reasons(ones: Sequence[RequirementConclusion]) -> str:
    """The worst value in each run, with its camera and distance; what the runs share is stated once."""
    cameras = [one.camera for one in ones]
    if len(set(cameras)) > 1:
        return ARROW.join(f"{one.camera}: {one.reason}" for one in ones)
    reasons = list(dict.fromkeys(one.reason for one in ones))
    heads, places = zip(*(one.rpartition(" at ")[::2] for one in reasons), strict=True)
    if len(reasons) > 1 and len(set(places)) == 1 and all(head.startswith(_WORST) for head in heads):
        values = ARROW.join(head.removeprefix(_WORST) for head in heads)
        return f"{cameras[0]}: {_WORST}{values} at {places[0]}"
    return f"{cameras[0]}: {ARROW.join(reasons)}"


def _of_designs(what: str, ones: Sequence[RequirementConclusion]) -> Iterator[Difference]:
    """The ranges of a single swept number in which the requirement is met; else the number of designs."""
    ranges = [one.met_ranges for one in ones if one.met_ranges is not None]
    parameters = {one.parameter for found in ranges for one in found}
    designs = [one.designs for one in ones if one.designs is not None]
    if len(ranges) == len(ones):
        if len(parameters) == 1 and any(_moved(ranges[0], other) for other in ranges[1:]):
            values = tuple("met " + (" and ".join(_range_words(found)) or _NOWHERE) for found in ranges)
            yield Difference(what=f"{what}, over the {parameters.pop()}", values=values)
    elif len(designs) == len(ones) and len(set(designs)) > 1:
        yield Difference(
            what=f"{what}, over all designs",
            values=tuple(f"met by {met} of {counted(every, 'design')}" for met, every in designs),
        )


def _range_words(found: Sequence[MetRange]) -> list[str]:
    several = len({one.camera for one in found}) > 1
    return [one.words + (f" by {one.camera}" if several else "") for one in found]


def _moved(first: Sequence[MetRange], other: Sequence[MetRange]) -> bool:
    """Whether ranges differ in number, in their cameras, or in an end by more than both errors."""
    return [one.camera for one in first] != [one.camera for one in other] or any(
        abs(a - b) > one.error + two.error
        for one, two in zip(first, other, strict=True)
        for a, b in ((one.low, two.low), (one.high, two.high))
    )


def compare_ranks(runs: Sequence[Run]) -> Answers:
    """Compare the candidates that rank first for most of the possible weights."""
    first = [next(iter(candidates_by_rank(run.tree)), None) for run in runs]
    there = [one for one in first if one is not None]
    if len(there) < len(runs):
        return Answers(changed=(), unchanged=0)
    if len({one.title for one in there}) == 1:
        return Answers(changed=(), unchanged=1)
    values = tuple(f"{one.title} (for {pretty(one.ranks[0], FRACTION, digits=2)} of the weights)" for one in there)
    return Answers(changed=(Difference(what="Ranked first by all criteria", values=values),), unchanged=0)


def compare_claims(runs: Sequence[Run]) -> Answers:
    """Compare verdicts on the claims that every run tests."""
    verdicts = [
        {str(row["claim"]): (str(row["says"]), str(row["verdict"])) for row in records(run.tree, "claims", "claim")}
        for run in runs
    ]
    shared = [name for name in verdicts[0] if all(name in one for one in verdicts)]
    changed = [
        Difference(what=f'Claim "{verdicts[0][name][0]}"', values=tuple(one[name][1] for one in verdicts))
        for name in shared
        if len({one[name][1] for one in verdicts}) > 1
    ]
    return Answers(changed=tuple(changed), unchanged=len(shared) - len(changed))


def compare_questions(runs: Sequence[Run]) -> Answers:
    """Compare answers to inverse questions that every run asks; only shifts beyond their errors count as changes."""
    if not all(has(run.tree, "decision", "solved_says", "solved_answer", "solved_value") for run in runs):
        return Answers(changed=(), unchanged=0)
    rows = [{str(row["solved_says"]): row for row in records(run.tree, "decision", "question")} for run in runs]
    shared = [says for says in rows[0] if all(says in one for one in rows)]
    changed = []
    for says in shared:
        ones = [one[says] for one in rows]
        values = [float(one["solved_value"]) for one in ones]
        errors = [SURE * float(np.nan_to_num(one["solved_error"])) for one in ones]
        if any(
            value != values[0] and not abs(value - values[0]) <= np.hypot(error, errors[0])
            for value, error in zip(values[1:], errors[1:], strict=True)
            if not (np.isnan(value) and np.isnan(values[0]))
        ):
            answers = tuple(str(one["solved_answer"]) for one in ones)
            changed.append(Difference(what=f'Question "{says}"', values=answers))
    return Answers(changed=tuple(changed), unchanged=len(shared) - len(changed))
