"""The group ``/decision``: the best camera along the distance, other readings under which that changes, questions."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr

from tradestudy.results.views.depth import nominal, nominal_is_declared
from tradestudy.results.views.groups import FloatArray, group, has, records, titles_in
from tradestudy.wording import distance

TIED = ", "
"""Between cameras whose difference is below its stated error: one answer."""
_WAY = "both"  # noise and calibration together
_SLIVER = 0.01  # of the range of the study
_BRIEF = 0.03  # of it, in logarithm


def has_winners(tree: xr.DataTree) -> bool:
    """Whether the results name a best camera for every distance, of the design that the curves show."""
    return has(tree, "decision", "best_camera") and nominal_is_declared(tree)


def tied(names: str) -> tuple[str, ...]:
    """The cameras of one answer: one, several that are alike, or none."""
    return tuple(name for name in names.split(TIED) if name)


def answer_title(titles: Mapping[str, str], names: str, nobody: str = "") -> str:
    """What one answer is called: a camera, or several that are alike."""
    found = [titles[name] for name in tied(names)]
    return f"{', and '.join(found)}, alike" if len(found) > 1 else "".join(found) or nobody


def candidates(tree: xr.DataTree) -> tuple[str, ...]:
    """The cameras among which a decision names the best, in the order of the study; none where all are candidates."""
    if not has(tree, "depth"):
        return ()
    declared = str(tree["decision"].attrs.get("candidates", "")).split(", ") if has(tree, "decision") else []
    every = titles_in(tree, "depth")
    chosen = tuple(key for key in every if key in declared)
    return chosen if len(chosen) < len(every) else ()


def winners(tree: xr.DataTree) -> Iterator[tuple[float, float, str]]:
    """Stretches of distance with one answer: (from, to, names), as `tied` reads them, "" where none is usable.

    Between two computed distances the stretch ends at the end of a usable range or at the crossover that lies there;
    where neither does, half way (in logarithm).
    """
    best = group(tree, "decision")["best_camera"].sel(way=_WAY)
    names = [str(name) for name in best.values]
    every = np.asarray(best["distance"].values, dtype=np.float64)
    exact = _exact_ends(tree)
    start, start_distance = 0, float(every[0])
    for index in range(1, len(names) + 1):
        if index == len(names):
            yield start_distance, float(every[-1]), names[start]
        elif names[index] != names[start]:
            low, high = float(every[index - 1]), float(every[index])
            between = exact[(exact >= low) & (exact <= high)]
            end = float(between[0]) if between.size else float(np.sqrt(low * high))
            yield start_distance, end, names[start]
            start, start_distance = index, end


def told_winners(tree: xr.DataTree) -> Iterator[tuple[float, float, str]]:
    """The stretches of `winners` without slivers: hundredths of the range whose ends read the same in three digits.

    Where the error of a crossover alone makes two cameras alike for a little, they change hands in its middle.
    """
    found = _without_brief_ties(list(winners(tree)))
    whole = found[-1][1] - found[0][0]
    return (one for one in found if distance(one[0]) != distance(one[1]) or one[1] - one[0] > _SLIVER * whole)


def _without_brief_ties(found: list[tuple[float, float, str]]) -> list[tuple[float, float, str]]:
    """Stretches of distance with every brief tie shared between its neighbours, if their cameras are those tied."""
    longest = np.log(found[-1][1] / found[0][0]) * _BRIEF
    kept = list(found)
    for before, (start, end, names), after in zip(found, found[1:], found[2:], strict=False):
        beside = {*tied(before[2]), *tied(after[2])}
        between = len(tied(names)) > 1 and before[2] and after[2] and beside <= {*tied(names)}
        if between and np.log(end / start) <= longest:
            kept.remove((start, end, names))
    ends = [found[0][0], *(float(np.sqrt(a[1] * b[0])) for a, b in itertools.pairwise(kept)), found[-1][1]]
    told = [(start, end, one[2]) for (start, end), one in zip(itertools.pairwise(ends), kept, strict=True)]
    return [
        (stretch[0][0], stretch[-1][1], names)
        for names, group in itertools.groupby(told, key=lambda one: one[2])
        for stretch in [list(group)]
    ]


def _exact_ends(tree: xr.DataTree) -> FloatArray:
    """Distances [m] at which the best camera can change: ends of usable ranges, and crossovers of the own reading."""
    ends = [np.empty(0)]
    if nominal_is_declared(tree):
        depth = nominal(tree)
        ends += [depth["usable_near"].values.ravel(), depth["usable_far"].values.ravel()]
    decision = group(tree, "decision")
    if "crossover_distance" in decision:
        ends.append(decision["crossover_distance"].sel(way=_WAY).values[0].ravel())
    every = np.concatenate(ends).astype(np.float64)
    return np.asarray(every[np.isfinite(every)])


@dataclass(frozen=True, kw_only=True)
class Flips:
    """The verdict on the headline pair at one declared distance, and the readings under which it differs.

    Parameters
    ----------
    place
        Distance [m].
    more_certain, winner
        The camera of lower uncertainty, and the better usable one, in the study's own reading; as `tied` reads them.
    ratio
        Uncertainty of the pair's first camera over that of the second, in the study's own reading.
    within_tolerance
        Whether they differ by no more than the tolerance.
    alternatives
        How many other readings there are.
    flipped
        Those in which the winner is another one, and which (may be empty).
    """

    place: float
    more_certain: str
    winner: str
    ratio: float
    within_tolerance: bool
    alternatives: int
    flipped: tuple[tuple[str, str], ...]


def flips(tree: xr.DataTree) -> Iterator[Flips]:
    """Count the readings under which another camera wins, for every declared distance."""
    if not has(tree, "decision", "more_certain", "winner", "flips", "uncertainty_ratio"):
        return
    decision = group(tree, "decision").sel(way=_WAY)
    names = [str(name) for name in decision["reading"].values]
    for place in decision["place"].values:
        there = decision.sel(place=place)
        flipped = np.asarray(there["flips"].values, dtype=bool)
        yield Flips(
            place=float(place),
            more_certain=str(there["more_certain"].values[0]),
            winner=str(there["winner"].values[0]),
            ratio=float(there["uncertainty_ratio"].values[0]),
            within_tolerance=bool(there["within_tolerance"].values[0]),
            alternatives=len(names) - 1,
            flipped=tuple(
                (name, str(winner))
                for name, winner, flips_here in zip(names[1:], there["winner"].values[1:], flipped[1:], strict=True)
                if flips_here
            ),
        )


def handovers(decision: xr.Dataset) -> Iterator[tuple[float, float]]:
    """Distances [m] where one camera of the pair takes over from the other, with their errors; one reading, one way."""
    for place, error, nearer, farther in zip(
        *(decision[f"change_{name}"].values for name in ("distance", "error", "nearer", "farther")), strict=True
    ):
        if np.isfinite(place) and nearer and farther:
            yield float(place), float(error)


def solved_questions(tree: xr.DataTree) -> tuple[tuple[str, str], ...]:
    """Read the inverse questions of a study with their answers, in words."""
    if not has(tree, "decision", "solved_says", "solved_answer"):
        return ()
    return tuple((str(row["solved_says"]), str(row["solved_answer"])) for row in records(tree, "decision", "question"))
