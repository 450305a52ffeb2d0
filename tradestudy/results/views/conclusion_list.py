"""Every conclusion of a run in words, once, for terminals and the first pages of reports."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.results.views.conclusions import (
    BestRange,
    best_ranges,
    lower_bounds,
    measure_first,
    other_words,
    question_words,
    ranked_by_bias,
    rests_on,
)
from tradestudy.results.views.decision import reversing, solved_questions
from tradestudy.results.views.depth import lower_bound_words, off_axis_words, offset_words
from tradestudy.results.views.designs import design_details
from tradestudy.results.views.groups import (
    camera_titles,
    consequences,
    group,
    has,
    left_out,
    origin_words,
    perfectly_calibrated,
    records,
    titles_in,
    unconverged,
)
from tradestudy.results.views.headline import answers, says_stretches
from tradestudy.results.views.requirement_conclusions import requirement_conclusions, requirement_details
from tradestudy.results.views.trade_off import trade_off_conclusion
from tradestudy.units import LENGTH, pretty, significant
from tradestudy.wording import distance, few, listed, with_article

_ROOM: Final = 400  # characters
_COUNTING: Final = 30  # of them for the number of clauses left out
_WRONG: Final = "so the depth uncertainty may be wrong"
ANSWERS: Final = ("designs", "requirement", "question", "weights", "answer", "claims")
"""Kinds of conclusions that answer the study; the others say on what the answers rest and where they hold."""


@dataclass(frozen=True, kw_only=True)
class Conclusion:
    """One conclusion of a run.

    Parameters
    ----------
    kind
        "headline"; one of `ANSWERS`; or what else it is about.
    head
        The words before its colon, or a question; may be empty.
    says
        Its clauses, without a full stop.
    """

    kind: str
    head: str
    says: tuple[str, ...]

    def rest(self, room: int = _ROOM) -> str:
        """As many clauses as have room [characters], and the number of the others."""
        lengths = np.cumsum([len(clause) + 2 for clause in self.says])
        shown = len(self.says) if lengths[-1] <= room else max(1, int(np.sum(lengths < room - _COUNTING)))
        left = [f"and {len(self.says) - shown} more in the report"] * (shown < len(self.says))
        return "; ".join([*self.says[:shown], *left])

    def __str__(self) -> str:
        return f"{question_words(self.head)} {self.rest()}" if self.head else self.rest()


def conclusions(tree: xr.DataTree, seconds: Mapping[str, float] = MappingProxyType({})) -> tuple[Conclusion, ...]:
    """The conclusions of a run: the headline, the other answers, what they rest on, and where they hold.

    ``seconds`` of the run's steps give the pictures of a light spot their computing times.
    """
    said, rests, first = answers(tree, seconds), rests_on(tree), measure_first(tree)
    requirements, perfect, failed = requirement_conclusions(tree), perfectly_calibrated(tree), unconverged(tree)
    judged = [
        ("requirement", requirement.verdict.capitalize(), [requirement_details(requirement)])
        for requirement in requirements
    ]
    where = reversing(tree)
    together = rests and first == f"Measure first: {rests[0]}"
    # Verdicts that are judged at the lower bound already say so, and need no remark about their camera.
    met = {requirement.camera for requirement in requirements if requirement.at_lower_bound and requirement.met}
    parts: list[tuple[str, str, Sequence[str]]] = [
        ("headline", "", said[:1]),
        ("designs", "", [design_details(tree)]),
        *judged[:1],
        *(("question", says, [answer]) for says, answer in solved_questions(tree)),
        *judged[1:],
        ("weights", "Weighing all criteria", [trade_off_conclusion(tree)]),
        *(("answer", "", [answer.removesuffix(".")]) for answer in said[1:]),
        ("claims", "Claims", list(_claim_words(tree))),
        ("reversed" if where else "not reversed", "", list(_reading_words(tree, where))),
        ("unconverged", "Not converged", [f"the calibration of {few(failed)}, {_WRONG}"] if failed else []),
        ("rests on", _rest_words(tree) + " (measure first)" * bool(together), rests),
        ("measure first", "", [] if together else [first]),
        ("off axis", "On the optical axis, unless a place is named; off it", off_axis_words(tree)),
        ("lower bound", *lower_bound_words([title for title in lower_bounds(tree) if title not in met])),
        ("biased", "Biased", offset_words(tree)),
        *(("doubted", "", [sentence]) for sentence in _doubted_words(tree)),
        ("partly used", "Used only in part", left_out(tree)),
        ("perfect", "Assumed perfect", [_perfect_words(tree, perfect)] if perfect else []),
        *(("origin", "", [clause]) for clause in origin_words(tree)),
        *(("contradictory", f"Contradictory inputs of {title}", [why]) for title, why in consequences(tree)),
        ("best", *_best_words(tree, "".join(said[:1]))),
    ]
    return tuple(Conclusion(kind=kind, head=head, says=tuple(says)) for kind, head, says in parts if any(says))


def _claim_words(tree: xr.DataTree) -> Iterator[str]:
    """The claims of each verdict."""
    named: dict[str, list[str]] = {}
    for row in records(tree, "claims", "claim"):
        named.setdefault(str(row["verdict"]), []).append(str(row["claim"]))
    for verdict in sorted(named, key=lambda verdict: (verdict != "met", verdict != "not met")):
        yield f"{verdict} – {listed(named[verdict])}"


def _rest_words(tree: xr.DataTree) -> str:
    """What rests on the inputs: the answers or, without any that do, the depth of the best cameras."""
    solved = has(tree, "decision", "solved_rests_on") and any(group(tree, "decision")["solved_rests_on"].values)
    is_answer = requirement_conclusions(tree) or solved or ranked_by_bias(tree)
    return "Rests on" if is_answer else "Predicted depth rests on"


def _perfect_words(tree: xr.DataTree, perfect: Sequence[str]) -> str:
    """Whose calibration is perfect, and that this is unfair where other cameras have errors."""
    favours = f", which favours {'it' if len(perfect) == 1 else 'them'} over the others"
    return f"the calibration of {few(perfect)}" + favours * (len(perfect) < len(titles_in(tree, "depth")))


def _best_words(tree: xr.DataTree, said: str) -> tuple[str, list[str]]:
    """The best cameras with their ranges, unless the headline says them, and the cameras that are best nowhere."""
    ranges, others = best_ranges(tree), list(other_words(tree))
    if not ranges or says_stretches(tree, said):
        return "Others", others if ranges else []
    designs = ", as declared" if has(tree, "requirements", "design_met") else ""
    nobody: dict[str, list[BestRange]] = {}
    for best_range in ranges:
        if not best_range.cameras:
            nobody.setdefault(best_range.words.removesuffix(f"from {best_range.where}"), []).append(best_range)
    none = [why + listed([f"from {gap.where}" for gap in gaps]) for why, gaps in nobody.items()]
    head = "Best" if len(camera_titles(tree)) > 1 else "Usable"
    return head + designs, [*(best_range.words for best_range in ranges if best_range.cameras), *none, *others]


def _doubted_words(tree: xr.DataTree) -> Iterator[str]:
    """Rigs whose calibration claims more than its views support, at the distance where the two differ most."""
    if not has(tree, "calibration", "rig_claimed"):
        return
    titles, data = camera_titles(tree), group(tree, "calibration")
    for camera in map(str, data["posterior"].values):
        rig = data.sel(posterior=camera)
        ratio = rig["rig_halves_difference"].values / rig["rig_halves_claim"].values
        if not np.any(ratio > 1.0):  # or no views were compared
            continue
        worst = int(np.nanargmax(ratio))
        claimed = float(rig["rig_claimed"].values[worst])
        good, claims = (pretty(uncertainty, LENGTH) for uncertainty in (float(ratio[worst]) * claimed, claimed))
        yield (
            f"The calibration of {with_article(titles[camera])} is good to {good} at "
            f"{distance(float(rig['rig_distance'].values[worst]))}, although it claims {claims}: depths from random "
            f"halves of its views differ by {significant(float(ratio[worst]), 3)} times as much as claimed; the "
            "numbers here use the claim"
        )


def _reading_words(tree: xr.DataTree, where: Sequence[tuple[str, list[float]]] | None) -> Iterator[str]:
    """The readings, which sentences call alternatives, under which the other camera of the pair wins (`reversing`)."""
    if where is None:
        return
    decision, titles = group(tree, "decision"), camera_titles(tree)
    alike = len({tuple(places) for _, places in where}) <= 1
    shared = [distance(place) for place in next((places for _, places in where), [])]
    at = f" at {listed(shared or ['any declared distance'])}" if alike else ""
    pair = " and ".join(with_article(titles[decision.attrs[which]]) for which in ("first", "second"))
    each = few(
        [f"“{says}”" + (not alike) * f" (at {listed(list(map(distance, places)))})" for says, places in where],
        2,
    )
    several = f"The alternatives {each} each reverse"
    who = {0: "No alternative assumption reverses", 1: f"The alternative {each} reverses"}.get(len(where), several)
    yield f"{who} the choice between {pair}{at}"
