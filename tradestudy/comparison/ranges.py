"""Compare the ranges in which cameras are usable or sharp: which moved, appeared or vanished."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.comparison.difference import ARROW, Difference, Run, common_cameras, titles_of
from tradestudy.comparison.stated_errors import ROUNDING, SURE, left_out_share
from tradestudy.results.views.depth import by_first_criterion, nominal, nominal_is_declared, sharp_ranges, swept
from tradestudy.results.views.groups import FloatArray, group
from tradestudy.wording import counted, listed, span

NOWHERE: Final = "nowhere"


@dataclass(frozen=True, kw_only=True)
class UsableStretch:
    """Distances [m] between which a camera is usable, the errors of these ends, and the limits that set them."""

    ends: tuple[float, float]
    errors: tuple[float, float]
    limits: tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class Ranges:
    """Ranges that moved, and the number of cameras whose ranges did not."""

    changed: tuple[Difference, ...]
    unchanged: int


def compare_usable(runs: Sequence[Run]) -> Ranges:
    """Compare usable ranges in the declared design; for sweeps without one, count the designs where they moved."""
    keys, titles = common_cameras(runs, "depth"), titles_of(runs)
    if not keys:
        return Ranges(changed=(), unchanged=0)
    if not all(nominal_is_declared(run.tree) for run in runs):
        found = [_over_designs(runs, key, titles[key]) for key in keys]
    else:
        ends = _common_ends([group(run.tree, "depth")["distance"].values for run in runs])
        found = [
            _compared(
                f"Usable range of {titles[key]}",
                [_within(_usable(nominal(run.tree), key, _share(run, key, "usable_range")), ends) for run in runs],
            )
            for key in keys
        ]
    changed = tuple(one for one in found if one is not None)
    return Ranges(changed=changed, unchanged=len(keys) - len(changed))


def compare_sharp(runs: Sequence[Run]) -> Ranges:
    """Compare the ranges where cameras are sharp by the first blur criterion."""
    keys, titles = common_cameras(runs, "depth_of_field"), titles_of(runs)
    found = []
    for key in keys:
        stretches = []
        for run in runs:
            share = _share(run, key, "depth_of_field")
            ends = sharp_ranges(by_first_criterion(run.tree).sel(camera=key), "sharp")
            stretches.append(
                [
                    UsableStretch(
                        ends=one, errors=(_error(one[0], 0.0, share), _error(one[1], 0.0, share)), limits=("", "")
                    )
                    for one in ends
                ]
            )
        found.append(_compared(f"Sharp range of {titles[key]}", stretches))
    changed = tuple(one for one in found if one is not None)
    return Ranges(changed=changed, unchanged=len(keys) - len(changed))


def _share(run: Run, key: str, quantity: str) -> float:
    return left_out_share(run.tree, key, quantity)


def _usable(depth: xr.Dataset, key: str, share: float) -> list[UsableStretch]:
    one = depth.sel(camera=key)
    columns = ("usable_near", "usable_far", "usable_near_error", "usable_far_error", "near_limit", "far_limit")
    return [
        UsableStretch(
            ends=(float(near), float(far)),
            errors=(_error(near, near_error, share), _error(far, far_error, share)),
            limits=(str(begins), str(ends)),
        )
        for near, far, near_error, far_error, begins, ends in zip(*(one[name].values for name in columns), strict=True)
        if np.isfinite(near)
    ]


def _error(end: float, error: float, share: float) -> float:
    """Error of an end [m]; an unknown error counts as zero."""
    return SURE * float(np.nan_to_num(error, posinf=np.inf)) + (share + ROUNDING) * (end if np.isfinite(end) else 0.0)


def _common_ends(distances: Sequence[FloatArray]) -> tuple[float, float]:
    return max(float(one[0]) for one in distances), min(float(one[-1]) for one in distances)


def _within(stretches: Sequence[UsableStretch], ends: tuple[float, float]) -> list[UsableStretch]:
    """The parts of stretches between two ends [m], such as those of the distances that all runs share."""
    low, high = ends
    return [
        UsableStretch(ends=(max(one.ends[0], low), min(one.ends[1], high)), errors=one.errors, limits=one.limits)
        for one in stretches
        if one.ends[0] < high and one.ends[1] > low
    ]


def _moved(first: Sequence[UsableStretch], other: Sequence[UsableStretch]) -> list[int]:
    """Which ends differ by more than both errors, 0 near and 1 far; both where the number of stretches differs."""
    if len(first) != len(other):
        return [0, 1]
    return [
        end
        for end in (0, 1)
        if any(
            a.ends[end] != b.ends[end] and abs(a.ends[end] - b.ends[end]) > np.hypot(a.errors[end], b.errors[end])
            for a, b in zip(first, other, strict=True)
        )
    ]


def _compared(what: str, found: Sequence[Sequence[UsableStretch]]) -> Difference | None:
    moved = sorted({end for other in found[1:] for end in _moved(found[0], other)})
    if not moved:
        return None
    values = tuple(listed([span(*one.ends) for one in stretches]) or NOWHERE for stretches in found)
    limits = [
        f"{name} end set by {limit}"
        for end, name in enumerate(("near", "far"))
        if end in moved and (limit := _limit_words(found, end))
    ]
    return Difference(what=what, values=values, where=f"({'; '.join(limits)})" if limits else "")


def _limit_words(found: Sequence[Sequence[UsableStretch]], end: int) -> str:
    """The limit that sets an end in every run, if each run has a single range."""
    if any(len(stretches) != 1 for stretches in found):
        return ""
    limits = dict.fromkeys(stretches[0].limits[end].replace("_", " ") for stretches in found)
    return ARROW.join(f"the {one}" for one in limits if one)


def _over_designs(runs: Sequence[Run], key: str, title: str) -> Difference | None:
    """In how many of the shared designs the usable range of a camera moved."""
    columns = ["usable_near", "usable_far", "usable_near_error", "usable_far_error", "near_limit", "far_limit"]
    tables = [group(run.tree, "depth") for run in runs]
    names = swept(tables[0])
    if any(swept(table) != names for table in tables):
        return None
    aligned = xr.align(*(table[columns].sel(camera=[key]) for table in tables), join="inner", exclude=("interval",))
    designs = [one.stack(design=names) for one in aligned]
    count = designs[0].sizes["design"]
    shares = [_share(run, key, "usable_range") for run in runs]
    moved = 0
    for index in range(count):
        found = [_usable(one.isel(design=index), key, share) for one, share in zip(designs, shares, strict=True)]
        moved += any(_moved(found[0], other) for other in found[1:])
    if not moved:
        return None
    return Difference(what=f"Usable range of {title}", values=(f"moved in {moved} of {counted(count, 'design')}",))
