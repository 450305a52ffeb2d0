"""What a run concludes, ready to be said in a terminal, on a first page or as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import xarray as xr

from tradestudy.results.views.decision import answer_title, candidates, solved_questions, told_winners
from tradestudy.results.views.depth import nominal, nominal_is_declared, where_usable
from tradestudy.results.views.designs import (
    feasible_designs,
    feasible_words,
    path_words,
)
from tradestudy.results.views.groups import camera_titles, group, has, records
from tradestudy.results.views.measured_depth import measured_words
from tradestudy.results.views.requirement_conclusions import requirement_conclusions, requirement_sentence
from tradestudy.results.views.trade_off import trade_off_conclusion
from tradestudy.units import FRACTION, pretty
from tradestudy.wording import counted, distance, listed

_SEVERAL: Final = 2
_ASSUMED: Final = ", assumed "


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """A stretch of distance [m] and the cameras, by title, that measure it best; none where none is usable."""

    near: float
    far: float
    cameras: tuple[str, ...]
    words: str


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


def asked_words(says: str) -> str:
    """An inverse question as it stands before its answer."""
    return says if says.endswith("?") else f"{says}:"


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
    lines += [f"{asked_words(says)} {answer}" for says, answer in solved_questions(tree)]
    if weighed := trade_off_conclusion(tree):
        lines.append(f"By all criteria: {weighed}")
    lines += measured_words(tree)
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
