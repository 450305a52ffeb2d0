"""Views of the group ``/decision``: the best camera by distance, readings that change it, and inverse questions."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from tradestudy.results.views.depth import nominal, nominal_is_declared
from tradestudy.results.views.groups import FloatArray, group, has, records, titles_in
from tradestudy.wording import distance

TIED = ", "
"""Separates the names of tied cameras, whose difference is below its stated error."""
_BOTH = "both"  # noise and calibration together
_SLIVER = 0.01  # of the study's range of distance
_BRIEF = 0.03  # of that range, on a logarithmic scale


def has_winners(tree: xr.DataTree) -> bool:
    """Whether the results name a best camera at every distance for the design that the curves show."""
    return has(tree, "decision", "best_camera") and nominal_is_declared(tree)


def tied(names: str) -> tuple[str, ...]:
    """The cameras of one answer: one, several that are tied, or none."""
    return tuple(name for name in names.split(TIED) if name)


def answer_title(titles: Mapping[str, str], names: str, nobody: str = "") -> str:
    """The words for one answer: a camera, several that are tied, or `nobody`."""
    found = [titles[name] for name in tied(names)]
    return f"{', and '.join(found)} (tied)" if len(found) > 1 else "".join(found) or nobody


def candidates(tree: xr.DataTree) -> tuple[str, ...]:
    """The cameras among which the decision chooses, in the order of the study; empty where all are candidates."""
    if not has(tree, "depth"):
        return ()
    declared = str(tree["decision"].attrs.get("candidates", "")).split(", ") if has(tree, "decision") else []
    every = titles_in(tree, "depth")
    chosen = tuple(key for key in every if key in declared)
    return chosen if len(chosen) < len(every) else ()


def winners(tree: xr.DataTree) -> Iterator[tuple[float, float, str]]:
    """Ranges of distance with one answer: (from, to, names) for `tied`; names are "" where no camera is usable.

    Between two computed distances, the boundary is the end of a usable range or the crossover that lies between them;
    without either, it is their geometric mean.
    """
    best = group(tree, "decision")["best_camera"].sel(error_source=_BOTH)
    every = np.asarray(best["distance"].values, dtype=np.float64)
    return merged_ranges([str(name) for name in best.values], every, _exact_ends(tree))


def merged_ranges(names: Sequence[str], every: FloatArray, exact: FloatArray) -> Iterator[tuple[float, float, str]]:
    """The ranges of `winners`, from the answer at every computed distance and the ``exact`` ends between them [m].

    A usable range that begins or ends with the study changes no answer.
    """
    exact = exact[(exact > every[0]) & (exact < every[-1])]
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


def reported_winners(tree: xr.DataTree) -> Iterator[tuple[float, float, str]]:
    """The ranges of `winners` that are worth reporting."""
    return worth_reporting(tuple(winners(tree)))


def worth_reporting(ranges: Sequence[tuple[float, float, str]]) -> Iterator[tuple[float, float, str]]:
    """The ranges of distance that are worth reporting.

    Leaves out slivers: at most 1 % of the study's range, with ends that read the same in three digits. Where two
    cameras tie only briefly, because of the error of their crossover, the boundary is the middle of the tie.
    """
    found = _without_brief_ties(list(ranges))
    whole = found[-1][1] - found[0][0]
    return (one for one in found if distance(one[0]) != distance(one[1]) or one[1] - one[0] > _SLIVER * whole)


def _without_brief_ties(found: list[tuple[float, float, str]]) -> list[tuple[float, float, str]]:
    """Ranges of distance with every brief tie divided between its neighbours, if these are the tied cameras."""
    longest = np.log(found[-1][1] / found[0][0]) * _BRIEF
    kept = list(found)
    for before, (start, end, names), after in zip(found, found[1:], found[2:], strict=False):
        neighbours = {*tied(before[2]), *tied(after[2])}
        between = len(tied(names)) > 1 and before[2] and after[2] and neighbours <= {*tied(names)}
        if between and np.log(end / start) <= longest:
            kept.remove((start, end, names))
    ends = [found[0][0], *(float(np.sqrt(a[1] * b[0])) for a, b in itertools.pairwise(kept)), found[-1][1]]
    moved = [(start, end, one[2]) for (start, end), one in zip(itertools.pairwise(ends), kept, strict=True)]
    return [
        (merged[0][0], merged[-1][1], names)
        for names, neighbours in itertools.groupby(moved, key=lambda one: one[2])
        for merged in [list(neighbours)]
    ]


def _exact_ends(tree: xr.DataTree) -> FloatArray:
    """Distances [m] where the best camera can change: ends of usable ranges, and crossovers of the declared reading."""
    ends = [np.empty(0)]
    if nominal_is_declared(tree):
        depth = nominal(tree)
        ends += [depth["usable_near"].values.ravel(), depth["usable_far"].values.ravel()]
    decision = group(tree, "decision")
    if "crossover_distance" in decision:
        ends.append(decision["crossover_distance"].sel(error_source=_BOTH).values[0].ravel())
    every = np.concatenate(ends).astype(np.float64)
    return np.asarray(every[np.isfinite(every)])


@dataclass(frozen=True, kw_only=True)
class Flips:
    """The verdict on the main pair at one declared distance, and the readings that change it.

    Parameters
    ----------
    place
        Distance [m].
    more_certain, winner
        The camera with lower uncertainty, and the better usable one, in the study as declared; names as for `tied`.
    ratio
        Uncertainty of the pair's first camera relative to that of the second, in the study as declared.
    within_tolerance
        Whether the two differ by no more than the tolerance.
    alternatives
        Number of other readings.
    flipped
        The readings with another winner, each with that winner ("" where neither camera is usable).
    """

    place: float
    more_certain: str
    winner: str
    ratio: float
    within_tolerance: bool
    alternatives: int
    flipped: tuple[tuple[str, str], ...]


def flips(tree: xr.DataTree) -> Iterator[Flips]:
    """The readings under which another camera wins, at every declared distance."""
    if not has(tree, "decision", "more_certain", "winner", "flips", "uncertainty_ratio"):
        return
    decision = group(tree, "decision").sel(error_source=_BOTH)
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


def readings_in_words(data: xr.Dataset) -> dict[str, str]:
    """What every reading of ``/decision`` or ``/claims`` assumes, by its name."""
    return dict(zip(map(str, data["reading"].values), map(str, data["reading_says"].values), strict=True))


def handovers(decision: xr.Dataset) -> Iterator[tuple[float, float]]:
    """Distances [m] where the better camera of the pair switches, with their errors.

    Expects ``/decision`` of one reading and one ``error_source``.
    """
    for place, error, nearer, farther in zip(
        *(decision[f"change_{name}"].values for name in ("distance", "error", "nearer", "farther")), strict=True
    ):
        if np.isfinite(place) and nearer and farther:
            yield float(place), float(error)


def solved_questions(tree: xr.DataTree) -> tuple[tuple[str, str], ...]:
    """The inverse questions of a study with their answers, in words."""
    if not has(tree, "decision", "solved_says", "solved_answer"):
        return ()
    return tuple((str(row["solved_says"]), str(row["solved_answer"])) for row in records(tree, "decision", "question"))
