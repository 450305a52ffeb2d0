"""The conclusions of a run, in words for terminals and first pages and in numbers for JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.results.views.decision import answer_title, candidates, reported_winners, solved_questions
from tradestudy.results.views.depth import (
    at_the_bound,
    least_broken,
    measured_numbers,
    measured_words,
    nominal,
    nominal_is_declared,
    off_axis_words,
    offset_words,
    where_usable,
)
from tradestudy.results.views.designs import (
    feasible_designs,
    feasible_words,
    path_words,
)
from tradestudy.results.views.groups import camera_titles, consequences, group, has, perfectly_calibrated, records
from tradestudy.results.views.requirement_conclusions import (
    RequirementConclusion,
    requirement_conclusions,
    requirement_sentence,
)
from tradestudy.results.views.trade_off import candidates_by_rank, trade_off_conclusion
from tradestudy.results.views.wave_optics import fresnel_numbers, hard_case_numbers, light_numbers, wave_words
from tradestudy.units import FRACTION, pretty, significant
from tradestudy.wording import counted, distance, limit_words, listed, plain_span, with_unit_symbols

_SEVERAL: Final = 2
_ROUNDING: Final = 1e-6  # of a ratio of uncertainties
_ASSUMED: Final = ", assumed "


@dataclass(frozen=True, kw_only=True)
class BestRange:
    """A range of distance [m] and the titles of the cameras that measure best in it; none where none is usable."""

    near: float
    far: float
    cameras: tuple[str, ...]
    words: str


def best_ranges(tree: xr.DataTree) -> tuple[BestRange, ...]:
    """Ranges of distance with their best cameras, for the study as declared."""
    if not has(tree, "decision", "best_camera") or not has(tree, "depth"):
        return ()
    titles, depth = camera_titles(tree), nominal(tree)
    among = candidates(tree) or tuple(map(str, depth["camera"].values))
    usable = [ends for name in among for ends in where_usable(depth, name)]

    def nobody(near: float, far: float) -> str:
        if nominal_is_declared(tree) and any(start <= math.sqrt(near * far) <= end for start, end in usable):
            return "no depth uncertainty has a bound"
        return f"no {'candidate' if candidates(tree) else 'camera'} is usable"

    return tuple(
        BestRange(
            near=near,
            far=far,
            cameras=tuple(titles[name] for name in names.split(", ") if name),
            words=f"{answer_title(titles, names, nobody(near, far))} from {plain_span(near, far)}",
        )
        for near, far, names in reported_winners(tree)
    )


def rests_on(tree: xr.DataTree) -> tuple[str, ...]:
    """What decides the requirements most or, without requirements, the depth of the best cameras.

    Either a limit of a camera's range, or an uncertain input with its basis, its share of the variance, and where it
    has that share.
    """
    found = [
        (one.rests_on, one.rests_on_share, " at " + distance(one.place).replace("\N{NO-BREAK SPACE}", " "))
        for one in requirement_conclusions(tree)
        if one.rests_on
    ]
    if not found and has(tree, "decision", "cause"):
        titles = camera_titles(tree)
        best = {name for one in best_ranges(tree) for name in one.cameras}
        rows = records(tree, "decision", "camera")
        found = [
            (str(row["cause"]), float(row["cause_share"]), ", averaged over usable distances")
            for row in rows
            if titles[str(row["camera"])] in best and row["cause"]
        ]
    shares: dict[str, tuple[float, str]] = {}
    for words, share, where in found:
        shares[words] = max((share, where), shares.get(words, (0.0, "")))
    return tuple(
        words + (f" ({_share_of_variance(share)}{where})" if math.isfinite(share) else "")
        for words, (share, where) in shares.items()
    )


def _share_of_variance(share: float) -> str:
    words = ">\N{NO-BREAK SPACE}99\N{NO-BREAK SPACE}%" if 0.995 <= share < 1.0 else pretty(share, FRACTION, digits=2)
    return f"{words} of the variance"


@dataclass(frozen=True, kw_only=True)
class AssumptionWorth:
    """The value of knowing one assumption exactly.

    Parameters
    ----------
    says, between
        The assumption and its range in words.
    worth, error
        Expected reduction of the relative depth uncertainty, averaged over the distances, and its standard error.
    """

    says: str
    between: str
    worth: float
    error: float

    @property
    def is_clear(self) -> bool:
        """Whether the worth exceeds two standard errors."""
        return self.worth > 2.0 * self.error


def worths(tree: xr.DataTree) -> tuple[AssumptionWorth, ...]:
    """The worth of knowing each assumption, the largest first."""
    found = [
        AssumptionWorth(
            says=_assumption_words(tree, str(row["says"])),
            between=str(row["between"]),
            worth=float(row["worth"]),
            error=float(row["worth_error"]),
        )
        for row in records(tree, "value_of_information", "assumption")
    ]
    return tuple(sorted(found, key=lambda one: -one.worth))


def _assumption_words(tree: xr.DataTree, says: str) -> str:
    """The study's words for an assumption; where it only names a path, the words of that path."""
    return says if " " in says else path_words(tree, says.removeprefix("scene.picture.").removeprefix("scene."))


def measure_first(tree: xr.DataTree) -> str:
    """What to measure next, without a full stop; empty where the results do not tell.

    Where the study asks for the value of information, the assumption most worth knowing; otherwise the input that
    decides the answers most, if it is assumed.
    """
    found = worths(tree)
    if not found:
        assumed = [words for words in rests_on(tree) if _ASSUMED in words]
        return f"Measure first: {assumed[0]}" if assumed else ""
    clear = [one for one in found if one.is_clear]
    if not clear:
        data = group(tree, "value_of_information")
        if data.sizes["candidate"] < _SEVERAL:
            return "With only one candidate, no measurement changes the choice"
        whole = float(data.attrs["worth_of_all"])
        if whole <= 0.0:
            return "No assumption changes which camera is best"
        return (
            "No single assumption is clearly worth measuring; knowing all of them would lower the depth uncertainty by "
            f"{pretty(whole, FRACTION, digits=2)} of the distance"
        )
    first = clear[0]
    gain = f"expected to lower the depth uncertainty by {pretty(first.worth, FRACTION, digits=2)} of the distance"
    others = [one.says for one in clear[1:3]]
    return f"Measure first: {first.says} ({first.between}), {gain}" + (f"; then {listed(others)}" if others else "")


def question_words(says: str) -> str:
    """An inverse question, punctuated to be followed by its answer."""
    return says if says.endswith("?") else f"{says}:"


def never_usable(tree: xr.DataTree) -> Iterator[tuple[str, str]]:
    """Titles of the candidates that are usable nowhere, each with what prevents it, unless none is usable anywhere."""
    if not has(tree, "depth", "usable_near") or not nominal_is_declared(tree):
        return
    depth, titles = nominal(tree), camera_titles(tree)
    among = candidates(tree) or tuple(map(str, depth["camera"].values))
    nowhere = [name for name in among if not where_usable(depth, name)]
    if len(nowhere) == len(among):
        return
    for name in nowhere:
        broken = depth["limit_met"].sel(camera=name).transpose("distance", "limit").values == 0
        fewest = depth["limit"].values[broken[least_broken(broken)]]
        yield titles[name], listed([limit_words(str(one)) for one in fewest])


def never_best(tree: xr.DataTree) -> Iterator[tuple[str, float]]:
    """Titles of the candidates that are usable but nowhere best, and how many times as uncertain each is at least."""
    if not has(tree, "decision", "judged_uncertainty") or not has(tree, "depth", "usable_near"):
        return
    if not nominal_is_declared(tree):
        return
    depth, decision, titles = nominal(tree), group(tree, "decision"), camera_titles(tree)
    places = np.asarray(decision["distance"].values, dtype=np.float64)
    best = {title for one in best_ranges(tree) for title in one.cameras}
    among = candidates(tree) or tuple(map(str, depth["camera"].values))
    uncertainty = {}
    for name in among:
        inside = [(near <= places) & (places <= far) for near, far in where_usable(depth, name)]
        usable = np.any([np.zeros(places.shape, dtype=np.bool_), *inside], axis=0)
        uncertainty[name] = np.where(usable, decision["judged_uncertainty"].sel(camera=name).values, np.inf)
    smallest = np.min(list(uncertainty.values()), axis=0)
    for name in among:
        known = np.isfinite(uncertainty[name])
        if titles[name] not in best and known.any():
            yield titles[name], float((uncertainty[name][known] / smallest[known]).min())


def never_best_words(tree: xr.DataTree) -> Iterator[str]:
    """The candidates that are usable but nowhere best, in words; within rounding of the best, without a factor."""
    for title, ratio in never_best(tree):
        step = 10.0 ** (math.floor(math.log10(ratio)) - 1)  # of the second digit
        factor = significant(step * math.floor(ratio / step * (1.0 + _ROUNDING)), 2)  # "at least": never rounded up
        why = f" (at least {factor} times as uncertain)" if factor != "1" else ""
        yield f"{title} is best nowhere{why}"


def lower_bounds(tree: xr.DataTree) -> tuple[str, ...]:
    """Titles of the cameras that are best or meet a requirement with a disparity error that no matcher surpasses."""
    named = {title for one in best_ranges(tree) for title in one.cameras}
    named |= {one.camera for one in requirement_conclusions(tree) if one.met}
    return tuple(title for title in at_the_bound(tree) if title in named)


def _range_words(ranges: Sequence[BestRange]) -> Iterator[str]:
    """The best cameras with their ranges, and then the ranges in which none is usable, by the reason."""
    yield from (one.words for one in ranges if one.cameras)
    nobody: dict[str, list[str]] = {}
    for one in ranges:
        if not one.cameras:
            where = f"from {plain_span(one.near, one.far)}"
            nobody.setdefault(one.words.removesuffix(where), []).append(where)
    yield from (why + listed(where) for why, where in nobody.items())


def _claim_words(tree: xr.DataTree) -> Iterator[str]:
    """One sentence, without a full stop, on the verdicts of all claims."""
    named: dict[str, list[str]] = {}
    for row in records(tree, "claims", "claim"):
        named.setdefault(str(row["verdict"]), []).append(str(row["claim"]))
    best_first = sorted(named, key=lambda verdict: (verdict != "met", verdict != "not met"))
    if best_first:
        yield f"Claims: {'; '.join(f'{verdict} – {listed(named[verdict])}' for verdict in best_first)}"


def terminal_lines(tree: xr.DataTree, most: int = 5) -> Iterator[str]:
    """The conclusions of a run in at most `most` lines; one of them counts the conclusions left out.

    Every question of the study gets its answer, even if that takes more lines.
    """
    return map(with_unit_symbols, _terminal_lines(tree, most))


def _terminal_lines(tree: xr.DataTree, most: int) -> Iterator[str]:
    ranges, requirements, rests = best_ranges(tree), requirement_conclusions(tree), rests_on(tree)
    lines = []
    if ranges:
        designs = ", as declared" if has(tree, "requirements", "design_met") else ""
        nowhere = [f"{title} is usable nowhere ({why})" for title, why in never_usable(tree)]
        head = "Best" if len(camera_titles(tree)) >= _SEVERAL else "Usable"
        lines.append(f"{head}{designs}: {'; '.join([*_range_words(ranges), *never_best_words(tree), *nowhere])}")
    # For one swept parameter and one requirement, the sentence of the requirement already says this.
    feasible = feasible_designs(tree)
    if feasible is not None and not (feasible.required == 1 and requirements[0].met_ranges is not None):
        lines.append(feasible_words(tree))
    judged = [requirement_sentence(one) for one in requirements]
    lines += judged[:1]
    solved = [f"{question_words(says)} {answer}" for says, answer in solved_questions(tree)]
    lines += solved
    needed = len(lines) if solved else 0
    lines += judged[1:]  # fewer lines may leave out a lesser requirement, but no answer to a question
    if weighed := trade_off_conclusion(tree):
        lines.append(f"Weighing all criteria: {weighed}")
    lines += [*measured_words(tree), *wave_words(tree), *_claim_words(tree)]
    first = measure_first(tree)
    if rests and first == f"Measure first: {rests[0]}":
        last = [f"Rests on (measure first): {'; '.join(rests)}"]
    else:
        last = [f"Rests on: {'; '.join(rests)}"] * bool(rests) + [first] * bool(first)
    if worse := off_axis_words(tree):
        unless = ", unless a place is named" if requirements else ""
        last.append(f"On the optical axis{unless}; off it, {listed(worse)}")
    said = {one.camera for one in requirements if one.at_lower_bound and one.met}
    if bounds := [title for title in lower_bounds(tree) if title not in said]:
        last.append(f"Lower bound, as no matcher is declared: the disparity error of {listed(bounds)}")
    if biased := offset_words(tree):
        last.append(f"Biased: {listed(biased)}")
    if perfect := perfectly_calibrated(tree):
        last.append(f"Assumed perfect: the calibration of {listed(perfect)}")
    last += [f"Contradictory inputs of {one}" for one in consequences(tree)]
    room = max(most - len(last), needed + 1)
    if len(lines) > room:  # the assumptions behind the answers matter more than a fourth requirement
        hidden = lines[room - 1 :]
        missed = sum(one.startswith("Not met") for one in hidden)
        yield from lines[: room - 1]
        suffix = f", including {counted(missed, 'requirement')} not met" if missed else ""
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
