"""The first page: the question answered in words and one figure."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.report.document import (
    Block,
    Bullets,
    Callout,
    Heading,
    Paragraph,
    Spans,
    say,
    with_subscripts,
)
from tradestudy.report.words import length, part_words, share
from tradestudy.results.views.conclusion_list import Conclusion, conclusions
from tradestudy.results.views.conclusions import (
    other_words,
    question_words,
)
from tradestudy.results.views.decision import (
    BestCameras,
    answer_title,
    best_cameras,
    shown_ends,
    solved_questions,
    tied,
)
from tradestudy.results.views.depth import (
    is_swept,
    least_broken,
)
from tradestudy.results.views.groups import (
    has,
    titles_in,
)
from tradestudy.results.views.requirement_conclusions import (
    VERDICTS,
    RequirementConclusion,
    requirement_conclusions,
    requirement_details,
)
from tradestudy.wording import distance, few, limit_words, listed, span

_MOST_REASONS = 3
_MOST_REQUIREMENTS: Final = 4
_ROOM: Final = 250  # characters of a sentence, so that the page has room for its figure
_ELSEWHERE: Final = ("headline", "designs", "requirement", "question", "answer", "claims", "origin", "best")
"""Kinds of conclusions that the first page has in another place, or the report in a section."""
_CLOSE = 0.1  # relative difference of two distances, across which the causes of errors hardly change
_WHICH: Final = "Which camera for which distance, with its depth uncertainty (68 %)"
_DECLARED: Final = " (study as declared)"


def describe_answer(tree: xr.DataTree) -> Iterator[Block]:
    """Say which requirements and designs are met, on what the answers rest, and what reverses them."""
    if has(tree, "decision", "best_camera") and has(tree, "depth"):
        yield Heading(text="The answer", anchor="answer")
    stated = conclusions(tree)
    for conclusion in stated:
        if conclusion.kind == "designs":
            yield Callout(title="Which design", blocks=(Paragraph(f"{conclusion}."),), tone="answer")
    yield from _requirements(requirement_conclusions(tree), _DECLARED if is_swept(tree) else "")
    others = tuple(f"{conclusion}." for conclusion in stated if conclusion.kind == "answer")
    for title, sentences in (("Inverse questions", tuple(_solved(tree))), ("Other answers", others)):
        if sentences:
            yield Callout(title=title, blocks=(Bullets(sentences),), tone="answer")
    qualified = [
        say("**{head}**: {rest}. ", head=conclusion.head, rest=conclusion.rest(_ROOM))
        if conclusion.head
        else say("{sentence}. ", sentence=str(conclusion))
        for conclusion in stated
        if conclusion.kind not in _ELSEWHERE
    ]
    if qualified:  # in one paragraph, so that the page has room for its figure
        yield Paragraph(tuple(itertools.chain(*qualified)))


def describe_stretches(tree: xr.DataTree) -> Iterator[Block]:
    """Say which camera to use from which distance to which, how uncertain it is there, and which cameras never lead."""
    if not has(tree, "decision", "best_camera") or not has(tree, "depth"):
        return
    yield Heading(text="Camera by distance", anchor="stretches")
    others = [
        f"{conclusion}."
        for conclusion in [Conclusion(kind="best", head="Others", says=tuple(other_words(tree)))]
        if conclusion.says
    ]
    yield Callout(
        title=_which(titles_in(tree, "depth")) + (_DECLARED if is_swept(tree) else ""),
        blocks=(Bullets((*_stretches(best_cameras(tree)), *others)),),
        tone="answer",
        name="answer-cameras",
    )


def describe_design(
    best: BestCameras | None, requirements: Sequence[RequirementConclusion], words: str
) -> Iterator[Callout]:
    """Write the part of the first page that is about one design of a sweep."""
    if best is not None:
        yield Callout(
            title=f"{_which({key: best.titles[key] for key in best.cameras})}, {words}",
            blocks=(Bullets(tuple(_stretches(best))),),
            tone="answer",
            name="answer-cameras",
        )
    yield from _requirements(requirements, f", {words}")


def _which(measuring: Mapping[str, str]) -> str:
    """The title of the answer, given the titles of the cameras that measure depth."""
    return f"Depth uncertainty of {listed(list(measuring.values()))}" if len(measuring) == 1 else _WHICH


def _requirements(requirements: Sequence[RequirementConclusion], design_words: str = "") -> Iterator[Callout]:
    """The verdict on each requirement, those that must hold first; `of` names the design in words."""
    if requirements:
        most = _MOST_REQUIREMENTS if len(requirements) > _MOST_REQUIREMENTS + 1 else len(requirements)
        missed = any(requirement.met is not True and requirement.priority == "must" for requirement in requirements)
        judged = [
            say(
                "**{verdict}**: {rest}.",
                verdict=requirement.verdict.capitalize(),
                rest=requirement_details(requirement),
            )
            for requirement in requirements[:most]
        ]
        yield Callout(
            title=f"Requirements{design_words}",
            blocks=(Bullets((*judged, *_counted(requirements[most:]))),),
            tone="warning" if missed else "answer",
            name="answer-requirements",
        )


def _counted(others: Sequence[RequirementConclusion]) -> Iterator[Spans]:
    """How many other requirements have which verdict."""
    verdicts = Counter(VERDICTS[requirement.met] for requirement in others)
    if others:
        yield say(
            "**{count} more requirements** (section “Requirements”): {verdicts}.",
            count=str(len(others)),
            verdicts=listed([f"{number} {verdict}" for verdict, number in verdicts.items()]),
        )


def _solved(tree: xr.DataTree) -> Iterator[Spans]:
    """The inverse questions with their answers, the value of each in bold."""
    for says, answer in solved_questions(tree):
        value, mark, beside = answer.partition("; ")
        question = with_subscripts(question_words(says))
        yield say("{question} **{value}**{beside}.", question=question, value=value, beside=mark + beside)


def _stretches(best: BestCameras) -> Iterator[Spans]:
    """One sentence per range of distances with the same best camera."""
    for (start, end, names), shown in zip(best.reported, shown_ends(best.reported), strict=True):
        where, camera = span(*shown), answer_title(best.titles, names)
        middle = float(np.sqrt(start * end))
        among = [best.cameras[key] for key in best.candidates or best.cameras if key in best.cameras]
        if not names and any(near <= middle <= far for candidate in among for near, far in candidate.usable):
            yield say("**{where}: no depth uncertainty has a bound**.", where=where)
        elif not names and len(best.cameras) == 1:
            yield say("**{where}: not usable**{why}.", where=where, why=_why_none(best, start, end))
        elif not names:
            yield say(
                "**{where}: no {which} is usable**{why}.",
                where=where,
                which="candidate" if best.candidates else "camera",
                why=_why_none(best, start, end) if best.cameras else "",
            )
        elif best.cameras:
            how = _how_sure(best, tied(names)[0], start, end)
            if len(best.cameras) == 1:
                yield say("**{where}**: {how}.", where=where, how=how)
            else:
                yield say("**{where}: {camera}**, {how}.", where=where, camera=camera, how=how)
        else:
            yield say("**{where}: {camera}**.", where=where, camera=camera)


def _why_none(best: BestCameras, start: float, end: float) -> str:
    """Why no candidate is usable in a range of distances [m], and which other cameras are usable there."""
    measuring = [key for key in best.titles if key in best.cameras]
    becomes_usable = end < best.distance[-1]  # the limit that is the last to fail there tells most
    inside = np.flatnonzero((best.distance > start) & (best.distance < end))
    if not inside.size:
        inside = np.array([best.nearest(float(np.sqrt(start * end)))])
    reasons: dict[str, list[str]] = {}
    for key in best.candidates or measuring:
        broken = best.cameras[key].broken[inside[::-1] if becomes_usable else inside]
        fewest = np.flatnonzero(broken[least_broken(broken)])
        words = listed([limit_words(best.limits[number]) for number in fewest])
        reasons.setdefault(words, []).append(best.titles[key])
    alone = len(measuring) == 1
    explained = [words if alone else f"{few(cameras)}: {words}" for words, cameras in reasons.items() if words][
        :_MOST_REASONS
    ]
    beside = [
        best.titles[key]
        for key in measuring
        if best.candidates
        and key not in best.candidates
        # An overlap whose ends read the same is too short to mention.
        and any(
            distance(max(near, start)) != distance(min(far, end))
            for near, far in best.cameras[key].usable
            if near < end and far > start
        )
    ]
    others = f"; usable in at least part of this range, but not a candidate: {listed(beside)}" if beside else ""
    return (f" ({'; '.join(explained)})" if explained else "") + others


def _how_sure(best: BestCameras, camera: str, start: float, end: float) -> str:
    """The uncertainty at both ends of a range, absolute and relative, and what decides it."""
    depth, places = best.cameras[camera], (start, end)
    valid = np.isfinite(depth.uncertainty) & (depth.uncertainty > 0.0)  # 0 at an entrance pupil among the distances
    logs = (np.log(best.of_curves[valid]), np.log(depth.uncertainty[valid]))  # interpolated along a smooth curve
    ends = [float(np.exp(np.interp(np.log(place), *logs))) for place in places]
    near, far = (f"{length(s)} ({share(s / z)})" for s, z in zip(ends, places, strict=True))
    ends_at = [best.nearest(place) for place in places]
    is_there = bool(np.all(np.abs(np.log(best.distance[ends_at] / places)) < _CLOSE))
    where = "" if is_there else " and at the nearest distances of the study"
    off = ""
    if depth.worst is not None:
        values = depth.worst[ends_at]
        most = [
            length(max(worst, on_axis)) if np.isfinite(worst) else "∞"
            for worst, on_axis in zip(values, ends, strict=True)
        ]
        off = f" on the axis, up to ±{most[0]} and ±{most[1]} at the places computed off it{where}"
    first, last = (part_words(depth.parts[index] or "nothing") for index in ends_at)
    cause = first if first == last else f"{first} at the near end and {last} at the far end"
    mostly = all(depth.largest_shares[index] > 0.5 for index in ends_at)
    return (
        f"±{near} to ±{far}{off}, {'mostly' if mostly else 'the largest part'} from {cause}{where.removeprefix(' and')}"
    )
