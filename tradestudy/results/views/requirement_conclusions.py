"""The verdict on every requirement, in numbers and in words."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.results.views.depth import at_the_bound
from tradestudy.results.views.designs import (
    dimension_of,
    interval_words,
    margin_words,
    path_words,
)
from tradestudy.results.views.groups import camera_titles, dotted_path, group, has, records
from tradestudy.units import FRACTION, pretty
from tradestudy.wording import few

_WORST: Final = "worst "
_NO_MARGIN: Final = 1e-6  # rounding
_UNSURE: Final = 0.05  # the smallest probability of either verdict that is worth a word
_NAMED: Final = 2  # other cameras that a sentence names; of more, it gives the number
ANY, ALL = "any", "all"
"""What `RequirementConclusion.of` is if one camera suffices, and if every camera must meet it."""
_ON_LOWER_BOUND: Final = " if matching is as exact as the pictures allow"
_BY_MATCHING: Final = ("depth_uncertainty", "usable", "failed_fraction")  # quantities that depend on the matcher
VERDICTS: Final[Mapping[bool | None, str]] = {True: "met", False: "not met", None: "cannot be decided"}
"""Verdicts in words."""


@dataclass(frozen=True, kw_only=True)
class MetRange:
    """A range of the one swept parameter in which one camera meets a requirement.

    Parameters
    ----------
    parameter
        The parameter in words, with its camera.
    low, high, error
        The ends of the range in SI, and their error.
    camera
        Title of the camera that meets the requirement there.
    words
        The range in words, such as "from 53.4 mm on".
    """

    parameter: str
    low: float
    high: float
    error: float
    camera: str
    words: str


@dataclass(frozen=True, kw_only=True)
class OtherVerdict:
    """The verdict on a requirement for a camera that does not decide it, under a reading, or at the bound of matching.

    Parameters
    ----------
    met
        None where it cannot be decided.
    camera, reason, margin
        As in `RequirementConclusion`; NaN where the margin is not known.
    says
        The reading in words; empty for the study as declared.
    """

    met: bool | None
    camera: str
    reason: str
    margin: float = math.nan
    says: str = ""


@dataclass(frozen=True, kw_only=True)
class RequirementConclusion:
    """The verdict on a requirement.

    Parameters
    ----------
    name, says, priority
        As declared.
    met
        None where it cannot be decided.
    of
        The camera that must meet it, or "any" or "all".
    camera
        Title of the camera with the largest margin; of a requirement on all cameras, the one with the smallest.
    margin
        Fraction by which the worst value could worsen within its bound; negative where it violates the bound.
    place
        Distance [m] of the worst value.
    conformity
        Probability that the true worst value meets the bound.
    reason
        The worst value and its distance, in words.
    limited_by
        The limit of the usable or sharp range that decides; empty where the value does.
    rests_on, rests_on_basis, rests_on_share
        That limit, "" and NaN, or the uncertain input that decides the value most, with its basis, that basis alone
        ("" where the results do not store it), and its share of the variance; empty where none does.
    bound
        The bound in SI; NaN for designs of a sweep.
    met_ranges
        Ranges of the one swept parameter in which it is met; None without such a sweep.
    designs
        Number of designs of a sweep that meet it, and of all designs; None without a sweep.
    probability
        Share of the draws of uncertain assumptions that meet it, at all distances jointly; NaN where the study declares
        no such assumptions.
    bound_alone
        The verdict if matching reached its lower bound instead of the declared matcher's error; None where no matcher
        makes a difference.
    readings, other_verdicts
        Number of the other readings of the study, and those that change the verdict or, where any camera may meet it,
        which camera meets it best.
    others
        The other cameras that a requirement on any or all cameras concerns: first those that meet it, each kind by
        decreasing margin.
    at_lower_bound
        Whether the deciding camera has no declared matcher and a value that depends on one: it is a lower bound.
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
    limited_by: str
    rests_on: str
    rests_on_basis: str
    rests_on_share: float
    bound: float = math.nan
    met_ranges: tuple[MetRange, ...] | None = None
    designs: tuple[int, int] | None = None
    probability: float = math.nan
    bound_alone: OtherVerdict | None = None
    readings: int = 0
    other_verdicts: tuple[OtherVerdict, ...] = ()
    others: tuple[OtherVerdict, ...] = ()
    at_lower_bound: bool = False

    @property
    def verdict(self) -> str:
        """The verdict on the study as declared, in words."""
        return VERDICTS[self.met] + (_ON_LOWER_BOUND if self.met and self.at_lower_bound else "")


def requirement_conclusions(tree: xr.DataTree) -> tuple[RequirementConclusion, ...]:
    """The verdicts on all requirements: first those that must hold, each kind by increasing margin."""
    if not has(tree, "requirements"):
        return ()
    titles = camera_titles(tree)
    at_bound = at_the_bound(tree)
    valued = has(tree, "value_of_information", "requirement_probability")
    chances = group(tree, "value_of_information")["requirement_probability"] if valued else None
    return _in_order(
        _conclusion(
            row,
            titles,
            met_ranges=_met_ranges(tree, number),
            designs=_designs(tree, number),
            probability=np.nan if chances is None else float(chances.sel(requirement=row["requirement"])),
            bound_alone=_bound_alone(row, titles),
            others=_others(tree, number, titles),
            at_lower_bound=str(row["quantity"]) in _BY_MATCHING and titles[str(row["camera_deciding"])] in at_bound,
            **_under_readings(tree, number, titles),
        )
        for number, row in enumerate(records(tree, "requirements", "requirement"))
    )


def conclusions_of_design(
    rows: Iterable[Mapping[str, Any]], titles: Mapping[str, str]
) -> tuple[RequirementConclusion, ...]:
    """The verdicts on all requirements in one design of a sweep, from its rows."""
    return _in_order(_conclusion(row, titles) for row in rows)


def _in_order(conclusions: Iterable[RequirementConclusion]) -> tuple[RequirementConclusion, ...]:
    return tuple(
        sorted(
            conclusions,
            key=lambda conclusion: (conclusion.priority != "must", np.nan_to_num(conclusion.margin, nan=-np.inf)),
        )
    )


def _conclusion(row: Mapping[str, Any], titles: Mapping[str, str], **further: Any) -> RequirementConclusion:
    return RequirementConclusion(
        name=str(row["requirement"]),
        says=str(row["says"]),
        priority=str(row["priority"]),
        met=_met(int(row["met"])),
        of=str(row["of"]),
        camera=titles[str(row["camera_deciding"])],
        margin=float(row["margin_percent"]) / 100.0,
        place=float(row["place"]),
        conformity=float(row["conformity"]),
        reason=str(row["reason"]),
        limited_by=str(row["limited_by"]),
        rests_on=str(row["rests_on"]),
        rests_on_basis=str(row.get("rests_on_basis", "")),
        rests_on_share=float(row["rests_on_share"]),
        bound=float(row.get("bound", math.nan)),
        **further,
    )


def requirement_sentence(conclusion: RequirementConclusion) -> str:
    """Whether a requirement is met, by which camera, with what margin and where; in a sweep, by which designs."""
    return f"{conclusion.verdict.capitalize()}: {requirement_details(conclusion)}"


def requirement_details(conclusion: RequirementConclusion) -> str:
    """The sentence on a requirement without its verdict; it omits more than two others if all of them miss it."""
    wish = " (should)" if conclusion.priority == "should" else ""
    by = decided_by(conclusion)
    why = "; ".join(filter(None, (conclusion.reason, _margin_words(conclusion), _chance_words(conclusion))))
    words = f"{conclusion.says}{wish}{'; ' if by.startswith('closest') else ', '}{by} ({why})"
    words += "".join(f"; {part}" for part in _others_words(conclusion))
    if conclusion.bound_alone is not None and not (conclusion.met and conclusion.bound_alone.met):
        words = f"{words}; {_bound_alone_words(conclusion, conclusion.bound_alone)}"
    if conclusion.other_verdicts:
        words = f"{words}; {_reading_words(conclusion)}"
    if not np.isnan(conclusion.probability):
        share = pretty(conclusion.probability, FRACTION, digits=2)
        words = f"{words}; met in {share} of the draws of the uncertain assumptions"
    if conclusion.met_ranges is not None:
        return f"{words}; {_range_words(conclusion)}"
    if conclusion.designs is not None:
        return f"{words}; met in {conclusion.designs[0]} of {conclusion.designs[1]} designs"
    return words


def _others(tree: xr.DataTree, number: int, titles: Mapping[str, str]) -> tuple[OtherVerdict, ...]:
    """The cameras that a requirement on any or all cameras concerns, without the one that decides it."""
    data = group(tree, "requirements")
    if "camera_met" not in data:
        return ()
    columns = [data[f"camera_{field}"].values[number] for field in ("met", "margin_percent", "reason")]
    each = (
        OtherVerdict(met=_met(int(met)), camera=titles[str(key)], reason=str(reason), margin=float(margin) / 100.0)
        for key, met, margin, reason in zip(data["camera"].values, *columns, strict=True)
        if key != data["camera_deciding"].values[number]
    )
    concerned = [other for other in each if other.reason]  # the requirement does not concern the others
    return tuple(
        sorted(concerned, key=lambda other: (other.met is not True, -np.nan_to_num(other.margin, nan=-np.inf)))
    )


def _others_words(conclusion: RequirementConclusion) -> Iterator[str]:
    """What the other cameras do: those that meet the requirement with their margin, the rest with their values."""
    met = [
        other.camera + f" ({margin_words(other.margin)})" * math.isfinite(other.margin)
        for other in conclusion.others
        if other.met
    ]
    missed = [
        f"{other.camera} ({other.reason.removeprefix(_WORST)})" for other in conclusion.others if other.met is False
    ]
    if _NAMED < len(missed) == len(conclusion.others):
        missed = []  # the closest one tells
    silent = [f"{other.camera} ({other.reason})" for other in conclusion.others if other.met is None]
    if met:
        yield f"{'also' if conclusion.met else 'but'} by {few(met, _NAMED)}"
    if missed:
        yield f"{'not' if conclusion.met else 'nor'} by {few(missed, _NAMED)}"
    if silent:
        yield f"undecided for {few(silent, _NAMED)}"


def _bound_alone(row: Mapping[str, Any], titles: Mapping[str, str]) -> OtherVerdict | None:
    camera = str(row.get("bound_alone_camera", ""))
    if not camera:
        return None
    return OtherVerdict(
        met=_met(int(row["bound_alone_met"])), camera=titles[camera], reason=str(row["bound_alone_reason"])
    )


def _under_readings(tree: xr.DataTree, number: int, titles: Mapping[str, str]) -> dict[str, Any]:
    """The number of other readings, and those with another verdict or another camera that meets it best."""
    data = group(tree, "requirements")
    if "reading_met" not in data:
        return {}
    columns = [data[f"reading_{field}"].values[number] for field in ("met", "camera", "reason")]
    verdicts = [
        OtherVerdict(says=str(says), met=_met(int(met)), camera=titles[str(camera)], reason=str(reason))
        for says, met, camera, reason in zip(data["reading_says"].values, *columns, strict=True)
    ]
    declared, row = _met(int(data["met"].values[number])), data.isel(requirement=number)
    best = titles[str(row["camera_deciding"].item())] if declared and str(row["of"].item()) == ANY else ""
    differing = tuple(
        verdict for verdict in verdicts if verdict.met is not declared or (best and verdict.camera != best)
    )
    return {"readings": len(verdicts), "other_verdicts": differing}


def _reading_words(conclusion: RequirementConclusion) -> str:
    """How many readings change the verdict or who meets it best, and to what; a single one is named."""
    parts = []
    if by := [other for other in conclusion.other_verdicts if other.met is conclusion.met]:
        alone = f"by {by[0].camera} if instead “{by[0].says}”"
        parts = [
            alone if len(by) == 1 else f"by another camera under {len(by)} of the {conclusion.readings} alternatives"
        ]
    for met in (verdict for verdict in (True, False, None) if verdict is not conclusion.met):
        same = [other for other in conclusion.other_verdicts if other.met is met]
        if len(same) == conclusion.readings > 1:
            parts.append(f"{VERDICTS[met]} under every alternative assumption")
        elif len(same) == 1:
            parts.append(f"{VERDICTS[met]} if instead “{same[0].says}”")
        elif same:
            parts.append(f"{VERDICTS[met]} under {len(same)} of the {conclusion.readings} alternative assumptions")
    return " and ".join(parts)


def _met(verdict: int) -> bool | None:
    return None if verdict < 0 else bool(verdict)


def _bound_alone_words(conclusion: RequirementConclusion, best: OtherVerdict) -> str:
    """Whether the requirement would be met at the lower bound of matching, and with which worst value."""
    by = "" if best.camera == conclusion.camera else f"{best.camera}: "
    if best.met is None:
        verdict = "undecided"
    elif best.met == conclusion.met:
        verdict = "not met even"
    else:
        verdict = "met" if best.met else "not met"
    return f"{verdict} if matching reached its bound ({by}{best.reason})"


def decided_by(conclusion: RequirementConclusion) -> str:
    """The camera that decides the verdict: "by A" or "closest: A", for instance."""
    if conclusion.met is None:
        return f"undecided for {conclusion.camera}"
    if conclusion.of == ALL:
        return f"by all, tightest for {conclusion.camera}" if conclusion.met else f"not by {conclusion.camera}"
    if conclusion.met:
        return f"by {conclusion.camera}"
    return f"closest: {conclusion.camera}" if conclusion.of == ANY else f"not by {conclusion.camera}"


def _margin_words(conclusion: RequirementConclusion) -> str:
    # No margin, or an unbounded value, which the reason reports.
    if not np.isfinite(conclusion.margin) or conclusion.margin <= -1.0:
        return ""
    if conclusion.limited_by and conclusion.margin < 0.0:  # the reason reports where the camera is not usable
        return ""
    if abs(conclusion.margin) < _NO_MARGIN:
        return ""
    words = margin_words(conclusion.margin)
    return words if conclusion.met or conclusion.margin < 0.0 else f"{words}, less than its guard band"


def _chance_words(conclusion: RequirementConclusion) -> str:
    # NaN without an error; that of all cameras is not that of the tightest.
    if not _UNSURE < conclusion.conformity < 1.0 - _UNSURE or (conclusion.of == ALL and conclusion.others):
        return ""
    return f"met with a probability of {pretty(conclusion.conformity, FRACTION, digits=2)}, given its numerical error"


def _range_words(conclusion: RequirementConclusion) -> str:
    """The ranges of the swept parameter in which it is met; where any camera may, each camera's own."""
    ranges = conclusion.met_ranges
    if not ranges:
        return "met by no design that was tried"
    candidates = [conclusion.camera, *(other.camera for other in conclusion.others)] if conclusion.of == ANY else []
    several = len(candidates) > 1
    parts = [met_range.words + (f" by {met_range.camera}" if several else "") for met_range in ranges]
    words = f"met with the {ranges[0].parameter} " + " and ".join(parts)
    never = [title for title in candidates if title not in {met_range.camera for met_range in ranges}]
    return f"{words}; nowhere by {few(never, _NAMED)}" if never and several else words


def _met_ranges(tree: xr.DataTree, number: int) -> tuple[MetRange, ...] | None:
    data = group(tree, "requirements")
    if "met_from" not in data or not _concerns_the_sweep(tree, number):
        return None
    (path,) = [str(dim) for dim in data["design_met"].dims if dim != "requirement"]
    axis, row = data[path], data.isel(requirement=number)
    titles, values = camera_titles(tree), np.asarray(axis.values, dtype=np.float64)
    parameter = path_words(tree, path)
    ranges = []
    for low, high, error, camera in zip(
        *(row[column].values for column in ("met_from", "met_to", "met_to_within", "met_camera")), strict=True
    ):
        if np.isnan(low):
            continue
        ranges.append(
            MetRange(
                parameter=parameter,
                low=float(low),
                high=float(high),
                error=float(error),
                camera=titles.get(str(camera), "all cameras"),
                words=interval_words(float(low), float(high), values, dimension_of(axis), float(error)),
            )
        )
    return tuple(ranges)


def _concerns_the_sweep(tree: xr.DataTree, number: int) -> bool:
    """Whether the sweep varies a camera that the requirement is about, or something that all cameras share."""
    data, cameras = group(tree, "requirements"), camera_titles(tree)
    concerned = str(data["of"].isel(requirement=number).item())
    paths = [dotted_path(tree, str(dim)) for dim in data["design_met"].dims if dim != "requirement"]
    varied = {path.removeprefix("cameras.").partition(".")[0] for path in paths}
    return concerned not in cameras or concerned in varied or not varied <= set(cameras)


def _designs(tree: xr.DataTree, number: int) -> tuple[int, int] | None:
    data = group(tree, "requirements")
    if "design_met" not in data or not _concerns_the_sweep(tree, number):
        return None
    met = data["design_met"].isel(requirement=number).values
    return int(np.sum(met == 1)), int(met.size)
