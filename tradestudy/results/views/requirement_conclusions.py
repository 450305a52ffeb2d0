"""What became of every requirement, and how it is told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.results.views.designs import (
    dimension_of,
    interval_words,
    margin_words,
    path_words,
)
from tradestudy.results.views.groups import camera_titles, group, has, records
from tradestudy.units import FRACTION, pretty

_NO_MARGIN: Final = 1e-6  # rounding


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
