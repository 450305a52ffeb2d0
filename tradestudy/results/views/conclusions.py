"""The conclusions of a run, as facts with their words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.results.views.decision import answer_title, candidates, reported_winners, shown_ends, tied
from tradestudy.results.views.depth import (
    at_the_bound,
    least_broken,
    nominal,
    nominal_is_declared,
    scene_by_error,
    where_usable,
)
from tradestudy.results.views.designs import (
    path_words,
)
from tradestudy.results.views.groups import camera_titles, group, has, records
from tradestudy.results.views.requirement_conclusions import (
    requirement_conclusions,
)
from tradestudy.units import FRACTION, pretty, rounded, significant
from tradestudy.wording import limit_words, listed, plain_span, range_words, with_article

_ROUNDING: Final = 1e-6  # of a ratio of uncertainties
_ASSUMED: Final = "assumed"  # a basis
_CLEAR: Final = 2.0  # standard errors


@dataclass(frozen=True, kw_only=True)
class BestRange:
    """A range of distance [m] and the titles of the cameras that measure best in it; none where none is usable.

    Sentences give its ends as `where` does.
    """

    near: float
    far: float
    where: str
    cameras: tuple[str, ...]
    words: str


def best_ranges(tree: xr.DataTree) -> tuple[BestRange, ...]:
    """Ranges of distance with their best cameras, for the study as declared."""
    if not has(tree, "decision", "best_camera") or not has(tree, "depth"):
        return ()
    titles = camera_titles(tree)

    def nobody(near: float, far: float) -> str:
        depth, middle = nominal(tree), math.sqrt(near * far)
        ends = depth[["usable_near", "usable_far"]].sel(camera=list(_compared(tree, depth)))
        usable = (ends["usable_near"] <= middle) & (middle <= ends["usable_far"])
        # Usable, yet no camera is the best: none has a finite uncertainty there.
        if nominal_is_declared(tree) and usable.any():
            return "no depth uncertainty has a bound"
        return f"no {'candidate' if candidates(tree) else 'camera'} is usable"

    ranges = tuple(reported_winners(tree))
    spans = [plain_span(*ends) for ends in shown_ends(ranges)]
    return tuple(
        BestRange(
            near=near,
            far=far,
            where=span,
            cameras=tuple(titles[camera] for camera in tied(names)),
            words=f"{answer_title(titles, names) or nobody(near, far)} from {span}",
        )
        for (near, far, names), span in zip(ranges, spans, strict=True)
    )


def _compared(tree: xr.DataTree, depth: xr.Dataset) -> tuple[str, ...]:
    """The cameras among which the decision chooses."""
    return candidates(tree) or tuple(map(str, depth["camera"].values))


def rests_on(tree: xr.DataTree, *, only_assumed: bool = False) -> tuple[str, ...]:
    """What decides the requirements most or, without requirements, the depth of the best cameras; assumptions first.

    Either a limit of a camera's range, or an uncertain input with its basis, its share of the variance, and where it
    has that share. Results that store no bases of inputs, as earlier versions wrote them, have no known assumptions.
    """
    deciding = [
        (
            conclusion.rests_on,
            conclusion.rests_on_basis,
            conclusion.rests_on_share,
            f" {range_words(conclusion.place, conclusion.place)}",
        )
        for conclusion in requirement_conclusions(tree)
        if conclusion.rests_on
    ]
    if has(tree, "decision", "solved_rests_on"):
        deciding += [
            (
                str(row["solved_rests_on"]),
                str(row.get("solved_rests_on_basis", "")),
                float(row["solved_rests_on_share"]),
                f" due to calibration {range_words(row['solved_place'], row['solved_place'])}",
            )
            for row in records(tree, "decision", "question")
            if row["solved_rests_on"]
        ]
    if not deciding and (ranked := ranked_by_bias(tree)) is not None:
        biased, instead = ranked
        drawn = f"bias of {with_article(biased)}, one random draw of its calibration errors"
        return () if only_assumed else (f"{drawn} (without it, the camera would measure {instead})",)
    if not deciding and has(tree, "decision", "cause"):
        titles = camera_titles(tree)
        best = {title for best_range in best_ranges(tree) for title in best_range.cameras}
        where = ", averaged over usable distances"
        deciding = [
            (str(row["cause"]), str(row.get("cause_basis", "")), float(row["cause_share"]), where)
            for row in records(tree, "decision", "camera")
            if titles[str(row["camera"])] in best and row["cause"]
        ]
    # What decides several answers is named once, with its largest share.
    shares: dict[tuple[str, str], tuple[float, str]] = {}
    for words, basis, share, where in deciding:
        shares[words, basis] = max((share, where), shares.get((words, basis), (0.0, "")))
    return tuple(
        words + (f" ({_share_of_variance(share)}{where})" if math.isfinite(share) else "")
        for (words, basis), (share, where) in sorted(shares.items(), key=lambda entry: entry[0][1] != _ASSUMED)
        if basis == _ASSUMED or not only_assumed
    )


def ranked_by_bias(tree: xr.DataTree) -> tuple[str, str] | None:
    """The camera that only its drawn calibration keeps from measuring the scene as well as the best one.

    Its title, and how well it would measure without its bias: best, or as well as the best, where the standard errors
    of both leave that open. The best camera has the smallest root sum of squares of spread and bias.
    """
    rows = scene_by_error(tree)
    for row in rows[1:]:
        # Without its bias, its error would be its spread.
        lead = rows[0]["error"] - row["spread"]
        if lead > 0.0 and row["predicted_bias"] > 0.0:
            clear = lead > _CLEAR * math.hypot(rows[0]["spread_error"], rows[0]["bias_error"], row["spread_error"])
            best = with_article(rows[0]["camera"])
            return str(row["camera"]), "best" if clear else f"as well as {best}"
    return None


def _share_of_variance(share: float) -> str:
    # Two digits would make this 100 %.
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
    assumptions = [
        AssumptionWorth(
            # An assumption without words of its own is named by its path.
            says=says if " " in says else path_words(tree, says.removeprefix("scene.picture.").removeprefix("scene.")),
            between=str(row["between"]),
            worth=float(row["worth"]),
            error=float(row["worth_error"]),
        )
        for row in records(tree, "value_of_information", "assumption")
        for says in [str(row["says"])]
    ]
    return tuple(sorted(assumptions, key=lambda assumption: -assumption.worth))


def measure_first(tree: xr.DataTree) -> str:
    """What to measure next, without a full stop; empty where the results do not tell.

    Where the study asks for the value of information, the assumption most worth knowing; otherwise the input that
    decides the answers most, if it is assumed.
    """
    assumptions = worths(tree)
    if not assumptions:
        if not requirement_conclusions(tree) and (ranked := ranked_by_bias(tree)) is not None:
            return f"Measure first: the calibration of {with_article(ranked[0])}"
        assumed = rests_on(tree, only_assumed=True)
        return f"Measure first: {assumed[0]}" if assumed else ""
    clear = [assumption for assumption in assumptions if assumption.is_clear]
    if not clear:
        data = group(tree, "value_of_information")
        if data.sizes["candidate"] <= 1:
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
    others = [assumption.says for assumption in clear[1:3]]
    return f"Measure first: {first.says} ({first.between}), {gain}" + (f"; then {listed(others)}" if others else "")


def question_words(says: str) -> str:
    """An inverse question, punctuated to be followed by its answer."""
    return says if says.endswith("?") else f"{says}:"


def never_usable(tree: xr.DataTree, *, even_all: bool = False) -> Iterator[tuple[str, str]]:
    """Titles of the candidates that are usable nowhere, with what prevents it; none if all are, unless `even_all`."""
    if not has(tree, "depth", "usable_near") or not nominal_is_declared(tree):
        return
    depth, titles = nominal(tree), camera_titles(tree)
    among = _compared(tree, depth)
    nowhere = [camera for camera in among if not where_usable(depth, camera)]
    if len(nowhere) == len(among) and not even_all:
        return
    for camera in nowhere:
        broken = depth["limit_met"].sel(camera=camera).transpose("distance", "limit").values == 0
        fewest = depth["limit"].values[broken[least_broken(broken)]]
        yield titles[camera], listed([limit_words(str(limit)) for limit in fewest])


def never_best(tree: xr.DataTree) -> Iterator[tuple[str, float]]:
    """Titles of the candidates that are usable but nowhere best, and how many times as uncertain each is at least."""
    if not has(tree, "decision", "judged_uncertainty") or not has(tree, "depth", "usable_near"):
        return
    if not nominal_is_declared(tree):
        return
    depth, decision, titles = nominal(tree), group(tree, "decision"), camera_titles(tree)
    places = np.asarray(decision["distance"].values, dtype=np.float64)
    best = {title for best_range in best_ranges(tree) for title in best_range.cameras}
    among = _compared(tree, depth)
    uncertainty = {}
    for camera in among:
        inside = [(near <= places) & (places <= far) for near, far in where_usable(depth, camera)]
        usable = np.any([np.zeros(places.shape, dtype=np.bool_), *inside], axis=0)
        judged = decision["judged_uncertainty"].sel(camera=camera).values
        uncertainty[camera] = np.where(usable & np.isfinite(judged), judged, np.inf)
    smallest = np.min(list(uncertainty.values()), axis=0)
    for camera in among:
        bounded = np.isfinite(uncertainty[camera])
        if titles[camera] not in best and bounded.any():
            yield titles[camera], float((uncertainty[camera][bounded] / smallest[bounded]).min())


def other_words(tree: xr.DataTree) -> Iterator[str]:
    """The candidates that are nowhere best, the closest first, without factors that round to 1, or nowhere usable."""
    for title, ratio in sorted(never_best(tree), key=lambda entry: entry[1]):
        factor = at_least(ratio)
        why = f" (at least {factor} times as uncertain)" if factor != "1" else ""
        yield f"{title} is best nowhere{why}"
    yield from (f"{title} is usable nowhere ({why})" for title, why in never_usable(tree))


def at_least(ratio: float) -> str:
    """A factor with two digits that is not larger than the ratio, but for rounding."""
    return significant(rounded(ratio, 2, math.floor, _ROUNDING * ratio), 2)


def lower_bounds(tree: xr.DataTree) -> tuple[str, ...]:
    """Titles of the cameras that are best or meet a requirement with a disparity error that no matcher surpasses."""
    named = {title for best_range in best_ranges(tree) for title in best_range.cameras}
    named |= {conclusion.camera for conclusion in requirement_conclusions(tree) if conclusion.met}
    return tuple(title for title in at_the_bound(tree) if title in named)
