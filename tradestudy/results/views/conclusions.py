"""What a run concludes, ready to be said in a terminal, on a first page or as JSON."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.results.views.decision import answer_title, candidates, solved_questions, told_winners
from tradestudy.results.views.depth import nominal, nominal_is_declared, where_usable
from tradestudy.results.views.designs import (
    dimension_of,
    feasible_designs,
    feasible_words,
    interval_words,
    margin_words,
    path_words,
)
from tradestudy.results.views.groups import camera_titles, group, has, records
from tradestudy.results.views.trade_off import trade_off_conclusion
from tradestudy.units import FRACTION, pretty
from tradestudy.wording import counted, distance, listed

_SEVERAL: Final = 2
_NO_MARGIN: Final = 1e-6  # rounding
_ASSUMED: Final = ", assumed "


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """A stretch of distance [m] and the cameras, by title, that measure it best; none where none is usable."""

    near: float
    far: float
    cameras: tuple[str, ...]
    words: str


@dataclass(frozen=True, kw_only=True)
class MetFrom:
    """A stretch of the one swept parameter in which one camera keeps a requirement.

    Parameters
    ----------
    parameter
        In words, with its camera.
    low, high, error
        Its ends in SI, and how well they are known.
    camera
        The one that keeps it there.
    words
        "from 53.4 mm on".
    """

    parameter: str
    low: float
    high: float
    error: float
    camera: str
    words: str


@dataclass(frozen=True, kw_only=True)
class BoundAlone:
    """What would become of a requirement if matching reached its bound.

    Parameters
    ----------
    met
        None where it could not be decided.
    camera, reason
        As of `RequirementConclusion`.
    """

    met: bool | None
    camera: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class RequirementConclusion:
    """What became of a requirement.

    Parameters
    ----------
    name, says, priority
        As declared.
    met
        None where it cannot be decided.
    of
        The camera that it concerns, any or all.
    camera
        Title of the camera that comes nearest, or keeps it best; of all, the one that keeps it worst.
    margin
        By which share the worst value could be worse and still keep the bound; negative where it is broken.
    place
        Where the worst value lies [m].
    conformity
        Probability that the true worst value keeps the bound.
    reason
        The worst value and its place in words.
    rests_on, rests_on_share
        The input that decides that value most, with its basis, and its share of the variance; empty where none does.
    stretches
        Where along the one swept parameter it is met; None without such a sweep.
    designs
        In how many designs of a sweep it is met, and of how many; None without one.
    probability
        Share of the combinations of what is not known that meet it, all distances together; NaN where nothing is
        declared as not known.
    bound_alone
        The same, if matching reached its bound instead of what is declared of a matcher; None where nothing is.
    """

    name: str
    says: str
    priority: str
    met: bool | None
    of: str
    camera: str
    margin: float
    place: float
    conformity: float
    reason: str
    rests_on: str
    rests_on_share: float
    stretches: tuple[MetFrom, ...] | None
    designs: tuple[int, int] | None
    probability: float
    bound_alone: BoundAlone | None

    @property
    def verdict(self) -> str:
        """Of the study as declared."""
        return {True: "met", False: "not met", None: "cannot be decided"}[self.met]


def best_stretches(tree: xr.DataTree) -> tuple[Stretch, ...]:
    """Which camera is best over which distances, of the study as declared."""
    if not has(tree, "decision", "best_camera") or not has(tree, "depth"):
        return ()
    titles = camera_titles(tree)
    nobody = f"no {'candidate' if candidates(tree) else 'camera'} is usable"
    return tuple(
        Stretch(
            near=near,
            far=far,
            cameras=tuple(titles[name] for name in names.split(", ") if name),
            words=_breakable(f"{answer_title(titles, names, nobody)} from {distance(near)} to {distance(far)}"),
        )
        for near, far, names in told_winners(tree)
    )


def usable_words(tree: xr.DataTree) -> dict[str, str]:
    """Where each camera is usable, by its title, of the study as declared; empty for other results."""
    if not has(tree, "depth", "usable_near") or not nominal_is_declared(tree):
        return {}
    depth, titles = nominal(tree), camera_titles(tree)
    found = {}
    for name in depth["camera"].values:
        ranges = where_usable(depth, str(name))
        words = " and ".join(f"{distance(near)} to {distance(far)}" for near, far in ranges)
        found[titles[str(name)]] = _breakable(words) or "nowhere"
    return found


def _breakable(words: str) -> str:
    """Words with plain spaces, for terminals and other programs."""
    return words.replace("\N{NO-BREAK SPACE}", " ")


def requirement_conclusions(tree: xr.DataTree) -> tuple[RequirementConclusion, ...]:
    """Every requirement, those that must hold first, and of them the one with the least margin."""
    if not has(tree, "requirements"):
        return ()
    titles = camera_titles(tree)
    valued = has(tree, "value_of_information", "requirement_probability")
    chances = group(tree, "value_of_information")["requirement_probability"] if valued else None
    found = []
    for number, row in enumerate(records(tree, "requirements", "requirement")):
        met = int(row["met"])
        found.append(
            RequirementConclusion(
                name=str(row["requirement"]),
                says=str(row["says"]),
                priority=str(row["priority"]),
                met=None if met < 0 else bool(met),
                of=str(row["of"]),
                camera=titles[str(row["camera_deciding"])],
                margin=float(row["margin_percent"]) / 100.0,
                place=float(row["place"]),
                conformity=float(row["conformity"]),
                reason=str(row["reason"]),
                rests_on=str(row["rests_on"]),
                rests_on_share=float(row["rests_on_share"]),
                stretches=_met_from(tree, number),
                designs=_designs(tree, number),
                probability=np.nan if chances is None else float(chances.sel(requirement=row["requirement"])),
                bound_alone=_bound_alone(row, titles),
            )
        )
    return tuple(sorted(found, key=lambda one: (one.priority != "must", np.nan_to_num(one.margin, nan=-np.inf))))


def requirement_sentence(one: RequirementConclusion) -> str:
    """Whether a requirement is met, by whom, with what margin and where; along a sweep, from which value on."""
    return f"{one.verdict.capitalize()}: {requirement_details(one)}"


def requirement_details(one: RequirementConclusion) -> str:
    """A requirement without its verdict."""
    wish = " (should)" if one.priority == "should" else ""
    told = f"{one.says}{wish}, {decided_by(one)} ({'; '.join(filter(None, (one.reason, _margin_words(one))))})"
    if one.bound_alone is not None:
        told = f"{told}; {_bound_alone_words(one, one.bound_alone)}"
    if not np.isnan(one.probability):
        share = pretty(one.probability, FRACTION, digits=2)
        told = f"{told}; with what is not known, it holds in {share} of the combinations"
    if one.stretches is not None:
        return f"{told}; {_along_words(one)}"
    return told if one.designs is None else f"{told}; met in {one.designs[0]} of {one.designs[1]} designs"


def _bound_alone(row: Mapping[str, Any], titles: Mapping[str, str]) -> BoundAlone | None:
    camera = str(row.get("bound_alone_camera", ""))
    if not camera:
        return None
    met = int(row["bound_alone_met"])
    return BoundAlone(met=None if met < 0 else bool(met), camera=titles[camera], reason=str(row["bound_alone_reason"]))


def _bound_alone_words(one: RequirementConclusion, best: BoundAlone) -> str:
    """Whether the bound of matching alone would meet it, and with which worst value."""
    by = "" if best.camera == one.camera else f"{best.camera}: "
    if best.met is None:
        verdict = "undecided"
    elif best.met == one.met:
        verdict = "also met" if best.met else "not met even"
    else:
        verdict = "met" if best.met else "not met"
    return f"{verdict} if matching reached its bound ({by}{best.reason})"


def decided_by(one: RequirementConclusion) -> str:
    """The camera that decides, and how: "by A", "nearest is A"."""
    if one.met is None:
        return f"undecided for {one.camera}"
    if one.of == "all":
        return f"by all, tightest for {one.camera}" if one.met else f"not by {one.camera}"
    if one.met:
        return f"by {one.camera}"
    return f"nearest is {one.camera}" if one.of == "any" else f"not by {one.camera}"


def _margin_words(one: RequirementConclusion) -> str:
    if not np.isfinite(one.margin) or one.margin <= -1.0:  # nothing, or an unbounded value, which the reason tells
        return ""
    if abs(one.margin) < _NO_MARGIN:
        return ""
    told = margin_words(one.margin)
    return told if one.met or one.margin < 0.0 else f"{told}, less than its guard band"


def _along_words(one: RequirementConclusion) -> str:
    assert one.stretches is not None  # asked where there are some
    if not one.stretches:
        return "met by no design that was tried"
    several = len({stretch.camera for stretch in one.stretches}) > 1
    parts = [stretch.words + (f" by {stretch.camera}" if several else "") for stretch in one.stretches]
    return f"met with the {one.stretches[0].parameter} " + " and ".join(parts)


def _met_from(tree: xr.DataTree, number: int) -> tuple[MetFrom, ...] | None:
    data = group(tree, "requirements")
    if "met_from" not in data:
        return None
    (path,) = [str(name) for name in data["design_met"].dims if name != "requirement"]
    axis, row = data[path], data.isel(requirement=number)
    titles, values = camera_titles(tree), np.asarray(axis.values, dtype=np.float64)
    parameter = path_words(tree, path)
    found = []
    for low, high, error, camera in zip(
        *(row[name].values for name in ("met_from", "met_to", "met_to_within", "met_camera")), strict=True
    ):
        if np.isnan(low):
            continue
        found.append(
            MetFrom(
                parameter=parameter,
                low=float(low),
                high=float(high),
                error=float(error),
                camera=titles.get(str(camera), "all cameras"),
                words=interval_words(low, high, values, dimension_of(axis)),
            )
        )
    return tuple(found)


def _designs(tree: xr.DataTree, number: int) -> tuple[int, int] | None:
    data = group(tree, "requirements")
    if "design_met" not in data:
        return None
    met = data["design_met"].isel(requirement=number).values
    return int(np.sum(met == 1)), int(met.size)


def rests_on(tree: xr.DataTree) -> tuple[str, ...]:
    """The inputs that decide the answers most, with their bases and shares: of requirements, else of the best."""
    told = [(one.rests_on, one.rests_on_share) for one in requirement_conclusions(tree) if one.rests_on]
    if not told and has(tree, "decision", "cause"):
        titles = camera_titles(tree)
        best = {name for one in best_stretches(tree) for name in one.cameras}
        rows = records(tree, "decision", "camera")
        told = [
            (str(row["cause"]), float(row["cause_share"]))
            for row in rows
            if titles[str(row["camera"])] in best and row["cause"]
        ]
    shares: dict[str, float] = {}
    for words, share in told:
        shares[words] = max(share, shares.get(words, 0.0))
    return tuple(f"{words} ({pretty(share, FRACTION, digits=2)} of the variance)" for words, share in shares.items())


@dataclass(frozen=True, kw_only=True)
class AssumptionWorth:
    """What knowing one assumption is worth.

    Parameters
    ----------
    says, between
        The assumption and its range in words.
    worth, error
        Expected fall of depth uncertainty over distance, averaged over the distances, and its standard error.
    """

    says: str
    between: str
    worth: float
    error: float

    @property
    def is_clear(self) -> bool:
        """Whether it is above what chance explains: two standard errors."""
        return self.worth > 2.0 * self.error


def worths(tree: xr.DataTree) -> tuple[AssumptionWorth, ...]:
    """Assumptions by what knowing them is worth, the most valuable first."""
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
    """Its own words, or those of its path."""
    return says if " " in says else path_words(tree, says.removeprefix("scene.picture.").removeprefix("scene."))


def measure_first(tree: xr.DataTree) -> str:
    """What to measure next, as a sentence without its full stop; empty where nothing says so.

    By the worth of the assumptions where the study asks for that, else the input that decides the answers most, if it
    is assumed.
    """
    found = worths(tree)
    if not found:
        assumed = [words for words in rests_on(tree) if _ASSUMED in words]
        return f"Measure first: {assumed[0]}" if assumed else ""
    clear = [one for one in found if one.is_clear]
    if not clear:
        data = group(tree, "value_of_information")
        if data.sizes["candidate"] < _SEVERAL:
            return "There is one candidate, so nothing that is measured changes the choice"
        whole = float(data.attrs["worth_of_all"])
        if whole <= 0.0:
            return "Nothing that is assumed changes which camera is best"
        return (
            "No single assumption is clearly worth measuring; knowing all of them is worth "
            f"{pretty(whole, FRACTION, digits=2)} of the distance"
        )
    first = clear[0]
    words = f"Measure first: {first.says} ({first.between}), worth {pretty(first.worth, FRACTION, digits=2)}"
    others = [one.says for one in clear[1:3]]
    return f"{words} of the distance" + (f"; then {listed(others)}" if others else "")


def question_sentence(says: str, answer: str) -> str:
    """An inverse question and its answer."""
    return f"{says} {answer}" if says.endswith("?") else f"{says}: {answer}"


def _never_usable(tree: xr.DataTree) -> Iterator[str]:
    """Candidates that are usable nowhere, where another is usable somewhere."""
    usable = usable_words(tree)
    among = [camera_titles(tree)[name] for name in candidates(tree)] or list(usable)
    nowhere = [title for title in among if usable.get(title) == "nowhere"]
    if nowhere and len(nowhere) < len(among):
        yield f"{listed(nowhere)} {'is' if len(nowhere) == 1 else 'are'} usable nowhere"


def terminal_lines(tree: xr.DataTree, most: int = 5) -> Iterator[str]:
    """The conclusions of a run in so many lines, and how many more there are."""
    stretches, requirements, rests = best_stretches(tree), requirement_conclusions(tree), rests_on(tree)
    lines = []
    if stretches:
        designs = ", as declared" if has(tree, "requirements", "design_met") else ""
        lines.append(f"Best{designs}: {'; '.join([*(one.words for one in stretches), *_never_usable(tree)])}")
    # What one parameter does to one requirement stands beside that requirement.
    feasible = feasible_designs(tree)
    if feasible is not None and not (feasible.required == 1 and requirements[0].stretches is not None):
        lines.append(feasible_words(tree))
    lines += [requirement_sentence(one) for one in requirements]
    lines += [question_sentence(says, answer) for says, answer in solved_questions(tree)]
    if weighed := trade_off_conclusion(tree):
        lines.append(f"By all criteria: {weighed}")
    first = measure_first(tree)
    if rests and first == f"Measure first: {rests[0]}":
        last = [f"Rests on, so measure first: {'; '.join(rests)}"]
    else:
        last = [f"Rests on: {'; '.join(rests)}"] * bool(rests) + [first] * bool(first)
    room = most - len(last)
    if len(lines) > room:  # what it rests on is worth more than a fourth requirement
        hidden = lines[room - 1 :]
        missed = sum(one.startswith("Not met") for one in hidden)
        yield from lines[: room - 1]
        beside = f", {missed} of them a requirement not met" if missed else ""
        yield f"and {counted(len(hidden), 'more conclusion')} in the report{beside}"
    else:
        yield from lines
    yield from last
