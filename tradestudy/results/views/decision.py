"""Views of decisions: the best camera by distance and design, readings that change it, and inverse questions."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import xarray as xr

from tradestudy.results import judged_uncertainty
from tradestudy.results.views.depth import by_design, largest_parts, nominal, nominal_is_declared, swept
from tradestudy.results.views.groups import FloatArray, camera_titles, group, has, ranges_of, records, titles_in
from tradestudy.wording import DECLARED_VALUE, distance, listed, within

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
    return tuple(camera for camera in names.split(TIED) if camera)


def answer_title(titles: Mapping[str, str], names: str, nobody: str = "") -> str:
    """The words for one answer: a camera, several that are tied, or `nobody`."""
    tied_titles = [titles[camera] for camera in tied(names)]
    return f"{listed(tied_titles)} (tied)" if len(tied_titles) > 1 else "".join(tied_titles) or nobody


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
    return merged_ranges([str(names) for names in best.values], every, _exact_ends(tree))


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
    divided = _without_brief_ties(list(ranges))
    whole = divided[-1][1] - divided[0][0]
    return (
        stretch
        for stretch in divided
        if distance(stretch[0]) != distance(stretch[1]) or stretch[1] - stretch[0] > _SLIVER * whole
    )


def shown_ends(ranges: Sequence[tuple[float, float, str]]) -> Iterator[tuple[float, float, int]]:
    """The ends of ranges as `span` writes them: rounded inwards, but to the nearest between two cameras."""
    names = [ranges[0][2], *(stretch[2] for stretch in ranges), ranges[-1][2]] if ranges else []
    # Inwards where the best camera follows none or gives way to none; the study ends as between two cameras.
    to = [round if bool(a) == bool(b) else math.floor if a else math.ceil for a, b in itertools.pairwise(names)]
    for number, (near, far, _) in enumerate(ranges):
        yield within(near, far, to[number], to[number + 1])


def _without_brief_ties(ranges: list[tuple[float, float, str]]) -> list[tuple[float, float, str]]:
    """Ranges of distance with every brief tie divided between its neighbours, if these are the tied cameras."""
    longest = np.log(ranges[-1][1] / ranges[0][0]) * _BRIEF
    kept = list(ranges)
    for before, (start, end, names), after in zip(ranges, ranges[1:], ranges[2:], strict=False):
        neighbours = {*tied(before[2]), *tied(after[2])}
        between = len(tied(names)) > 1 and before[2] and after[2] and neighbours <= {*tied(names)}
        if between and np.log(end / start) <= longest:
            kept.remove((start, end, names))
    # Neighbours of a removed tie meet in its middle; elsewhere, both have the same end already.
    ends = [ranges[0][0], *(float(np.sqrt(a[1] * b[0])) for a, b in itertools.pairwise(kept)), ranges[-1][1]]
    moved = [(start, end, stretch[2]) for (start, end), stretch in zip(itertools.pairwise(ends), kept, strict=True)]
    joined = [
        (merged[0][0], merged[-1][1], names)
        for names, neighbours in itertools.groupby(moved, key=lambda stretch: stretch[2])
        for merged in [list(neighbours)]
    ]
    # A tie of three between ties of two hides at first that all three are brief.
    return _without_brief_ties(joined) if len(joined) < len(ranges) else joined


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
    names = [str(reading) for reading in decision["reading"].values]
    for place in decision["place"].values:
        here = decision.sel(place=place)
        flipped = np.asarray(here["flips"].values, dtype=bool)
        yield Flips(
            place=float(place),
            more_certain=str(here["more_certain"].values[0]),
            winner=str(here["winner"].values[0]),
            ratio=float(here["uncertainty_ratio"].values[0]),
            within_tolerance=bool(here["within_tolerance"].values[0]),
            alternatives=len(names) - 1,
            flipped=tuple(
                (reading, str(winner))
                for reading, winner, flips_here in zip(names[1:], here["winner"].values[1:], flipped[1:], strict=True)
                if flips_here
            ),
        )


def reversing(tree: xr.DataTree) -> tuple[tuple[str, list[float]], ...] | None:
    """Each alternative that reverses the choice of the pair, in words, with the distances [m]; None if none was tried.

    Where neither is usable under a reading or in the study itself, or they are tied, nothing is reversed.
    """
    verdicts = [verdict for verdict in flips(tree) if verdict.alternatives]
    if not verdicts:
        return None
    says, reversed_at = readings_in_words(group(tree, "decision")), dict[str, list[float]]()
    for verdict in verdicts:
        for reading, winner in verdict.flipped:
            if len(tied(winner)) == len(tied(verdict.winner)) == 1:
                reversed_at.setdefault(reading, []).append(verdict.place)
    return tuple((says[reading], places) for reading, places in reversed_at.items())


def readings_in_words(data: xr.Dataset) -> dict[str, str]:
    """What every reading of ``/decision`` or ``/claims`` assumes, by its name."""
    return dict(zip(map(str, data["reading"].values), map(str, data["reading_says"].values), strict=True))


def solved_questions(tree: xr.DataTree) -> tuple[tuple[str, str], ...]:
    """The inverse questions of a study with their answers, in words, and then once what is true of all of them."""
    if not has(tree, "decision", "solved_says", "solved_answer"):
        return ()
    questions = [(str(row["solved_says"]), str(row["solved_answer"])) for row in records(tree, "decision", "question")]
    clauses = [answer.partition(DECLARED_VALUE)[2].split("; ")[1:] for _, answer in questions]
    shared = [clause for clause in clauses[0] if all(clause in others for others in clauses)] if clauses[1:] else []
    answers = [
        (says, "; ".join(clause for clause in answer.split("; ") if clause not in shared)) for says, answer in questions
    ]
    return (*answers, ("All answers", "; ".join(reversed(shared)))) if shared else tuple(answers)


Ranges = tuple[tuple[float, float, str], ...]
_OF_DESIGNS: Final = {
    "met": "design_met",
    "camera_deciding": "design_camera",
    "margin_percent": "design_margin_percent",
    "margin_sigma": "design_margin_sigma",
    "within_tolerance": "design_within_tolerance",
    "reason": "design_reason",
    "limited_by": "design_limited_by",
}
_OF_ALL: Final = ("says", "priority", "quantity", "of", "bound_text", "over_near", "over_far")
_UNKNOWN: Final = {"place": np.nan, "conformity": np.nan, "rests_on": "", "rests_on_share": np.nan}


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraDepth:
    """One camera of one design, over the distances of the study.

    Parameters
    ----------
    uncertainty
        The depth uncertainty that judges it [m], at the distances of the curves; see `judged_uncertainty`.
    parts, largest_shares
        The part with the largest share of its variance, if known, and this share.
    broken
        Which limits of the usable range it violates, shape (distance, limit).
    usable
        Usable ranges, as (near, far) [m].
    worst
        The largest depth uncertainty [m] at the places computed off the axis; None without such places, and where a
        map over the picture shows more.
    """

    uncertainty: FloatArray
    parts: tuple[str | None, ...]
    largest_shares: FloatArray
    broken: npt.NDArray[np.bool_]
    usable: tuple[tuple[float, float], ...]
    worst: FloatArray | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class BestCameras:
    """The best camera along the distance in one design.

    Parameters
    ----------
    ranges
        As given by `winners`.
    titles
        Titles of all cameras.
    candidates
        As given by `candidates`.
    distance
        The distances of the study [m].
    of_curves
        Distances of the curves of uncertainty [m].
    limits
        Names of the limits of the usable range.
    cameras
        The cameras that measure depth; none where the results contain no depth of the design that the ranges describe.
    """

    ranges: Ranges
    titles: Mapping[str, str]
    candidates: tuple[str, ...]
    distance: FloatArray
    of_curves: FloatArray
    limits: tuple[str, ...]
    cameras: Mapping[str, CameraDepth]

    @property
    def reported(self) -> Ranges:
        """The ranges that are worth reporting."""
        return tuple(worth_reporting(self.ranges))

    def nearest(self, place: float) -> int:
        """Index of the distance of the study nearest to a place [m]."""
        return int(np.argmin(np.abs(self.distance - place)))


def best_cameras(tree: xr.DataTree) -> BestCameras:
    """The best camera along the distance in the study as declared."""
    depth = nominal(tree)
    curves = group(tree, "decision")["judged_uncertainty"]
    of_cameras = camera_depths(depth)[0] if nominal_is_declared(tree) else {}
    cameras = {key: replace(camera, uncertainty=curves.sel(camera=key).values) for key, camera in of_cameras.items()}
    if cameras and has(tree, "depth_field", "depth_uncertainty"):
        off = judged_uncertainty(group(tree, "depth_field")).max(("field", "corner"))
        # A map shows worse places than these, which the first page names.
        mapped = group(tree, "depth_map")["camera"].values if has(tree, "depth_map", "depth_uncertainty") else ()
        cameras = {
            key: camera if key in mapped else replace(camera, worst=off.sel(camera=key).values)
            for key, camera in cameras.items()
        }
    places = np.asarray(curves["distance"].values, dtype=np.float64)
    return BestCameras(ranges=tuple(winners(tree)), cameras=cameras, of_curves=places, **_shared(tree, depth))


def best_cameras_of_designs(tree: xr.DataTree) -> Sequence[BestCameras | None]:
    """`best_cameras` of every design, the last parameter varying fastest; None where the run did not ask for it."""
    if not has(tree, "decision", "design_best_camera_along"):
        return [None for _ in design_places(tree)]
    depth, decision = group(tree, "depth"), group(tree, "decision")
    best = by_design(depth, decision["design_best_camera_along"], "design_distance")
    ends = [by_design(depth, depth[end], "camera", "interval") for end in ("usable_near", "usable_far")]
    if "design_crossover_distance" in decision:
        ends.append(by_design(depth, decision["design_crossover_distance"], "design_crossing"))
    every = np.concatenate([values.reshape(len(best), -1) for values in ends], axis=1)
    shared = _shared(tree, depth)
    return [
        BestCameras(
            ranges=tuple(merged_ranges(names, shared["distance"], changes[np.isfinite(changes)])),
            cameras=cameras,
            of_curves=shared["distance"],
            **shared,
        )
        for names, changes, cameras in zip(best.tolist(), every, camera_depths(depth), strict=True)
    ]


def _shared(tree: xr.DataTree, depth: xr.Dataset) -> dict[str, Any]:
    return {
        "titles": camera_titles(tree),
        "candidates": candidates(tree),
        "distance": np.asarray(depth["distance"].values, dtype=np.float64),
        "limits": tuple(map(str, depth["limit"].values)),
    }


def camera_depths(depth: xr.Dataset) -> list[dict[str, CameraDepth]]:
    """The cameras of every design of ``/depth``, by key."""
    uncertainty = by_design(depth, judged_uncertainty(depth), "camera", "distance")
    broken = by_design(depth, depth["limit_met"], "camera", "distance", "limit") == 0
    near, far = (by_design(depth, depth[end], "camera", "interval") for end in ("usable_near", "usable_far"))
    parts, shares = largest_parts(depth)
    return [
        {
            str(key): CameraDepth(
                uncertainty=uncertainty[design, k],
                parts=tuple(parts[design, k].tolist()),
                largest_shares=shares[design, k],
                broken=broken[design, k],
                usable=ranges_of(near[design, k], far[design, k]),
            )
            for k, key in enumerate(depth["camera"].values)
        }
        for design in range(len(uncertainty))
    ]


def requirements_of_designs(tree: xr.DataTree) -> Sequence[Sequence[Mapping[str, Any]]]:
    """The rows of ``/requirements`` of every design; what decides a worst value is known only for the declared one."""
    if not has(tree, "requirements", "design_reason"):
        return [[] for _ in design_places(tree)]
    depth, data = group(tree, "depth"), group(tree, "requirements")
    of_all = {variable: data[variable].values for variable in ("requirement", *_OF_ALL)}
    of_designs = {column: by_design(depth, data[variable], "requirement") for column, variable in _OF_DESIGNS.items()}
    return [
        [
            {column: values[k] for column, values in of_all.items()}
            | {column: values[design, k] for column, values in of_designs.items()}
            | _UNKNOWN
            for k in range(data.sizes["requirement"])
        ]
        for design in range(len(of_designs["met"]))
    ]


def design_places(tree: xr.DataTree) -> Iterator[dict[str, int]]:
    """Position of every design along the swept parameters, the last one varying fastest; none without a sweep."""
    if not has(tree, "depth") or not (dims := swept(depth := group(tree, "depth"))):
        return
    for places in itertools.product(*(range(depth.sizes[dim]) for dim in dims)):
        yield dict(zip(dims, places, strict=True))


def shown_place(tree: xr.DataTree) -> dict[str, int]:
    """Position of the design that figures show: the declared one, if it is among those swept."""
    depth, shown = group(tree, "depth"), nominal(tree)
    return {dim: int(np.flatnonzero(depth[dim].values == shown[dim].values)[0]) for dim in swept(depth)}
