"""The ranking of candidates over all possible weights, and the Pareto front, in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.results.views.depth import declared_place
from tradestudy.results.views.designs import BY_UNIT, path_words, value_words
from tradestudy.results.views.groups import FloatArray, camera_titles, group, has
from tradestudy.uncertainty.trade_off import ValueScale
from tradestudy.units import FRACTION, NUMBER, pretty
from tradestudy.wording import listed

_ROUNDING: Final = 1e-9
_NEARLY_ALL: Final = 0.99
_ALWAYS: Final = 0.9995  # from here on, a share reads 100 %
_NUMBERS: Final = 3  # swept numbers; with as many or more, no figure shows the designs


@dataclass(frozen=True, kw_only=True)
class Ranked:
    """A candidate of a trade-off.

    Parameters
    ----------
    title
        Title of the camera.
    values
        Value of each criterion in words, with an asterisk if it is clipped.
    ranks
        Fraction of the possible weights that give the candidate each rank.
    first_error
        Standard error of its share of first ranks.
    central
        Mean of the weights that rank it first, in words, or why there are none.
    is_feasible
        Whether it meets every requirement that must hold.
    """

    title: str
    values: tuple[str, ...]
    ranks: tuple[float, ...]
    first_error: float
    central: str
    is_feasible: bool


def candidates_by_rank(tree: xr.DataTree) -> tuple[Ranked, ...]:
    """The candidates of a trade-off by their share of first ranks, the largest first; empty without a trade-off."""
    if not has(tree, "criteria", "rank_acceptability"):
        return ()
    data, titles = group(tree, "criteria"), camera_titles(tree)
    criteria = [str(criterion) for criterion in data["weighed"].values]
    candidates = []
    for camera in data["candidate"].values:
        candidate = data.sel(candidate=camera)
        declared = {dim: declared_place(candidate[dim]) or 0 for dim in candidate["feasible"].dims}
        central = [
            f"{criterion} {pretty(float(w), FRACTION, 2)}"
            for criterion, w in zip(criteria, candidate["central_weight"].values, strict=True)
        ]
        candidates.append(
            Ranked(
                title=titles[str(camera)],
                values=tuple(
                    value + "*" * bool(clipped)
                    for value, clipped in zip(
                        _in_words(data, candidate["weighed_value"].values), candidate["clipped"].values, strict=True
                    )
                ),
                ranks=tuple(candidate["rank_acceptability"].values.tolist()),
                first_error=float(candidate["rank_acceptability_error"].values[0]),
                central=str(candidate["central_weight_reason"].item()) or ", ".join(central),
                is_feasible=bool(candidate["feasible"].isel(declared)),
            )
        )
    return tuple(sorted(candidates, key=lambda candidate: tuple(-share for share in candidate.ranks)))


def trade_off_conclusion(tree: xr.DataTree) -> str:
    """The candidate that ranks first, and for which fraction of the possible weights; empty without a trade-off."""
    if not (candidates := candidates_by_rank(tree)):
        return ""
    data = group(tree, "criteria")
    best, share = candidates[0], candidates[0].ranks[0]
    is_fixed = bool((data["weight_low"].values == data["weight_high"].values).all())
    outside = "" if best.is_feasible else f" ({best.title} does not meet every requirement that must hold)"
    if share >= _ALWAYS:
        return f"{best.title} ranks first {'with these weights' if is_fixed else 'whatever the weights'}{outside}"
    alike = [candidate.title for candidate in candidates if abs(candidate.ranks[0] - share) < _ROUNDING]
    if is_fixed and len(alike) > 1 and not candidates[0].first_error > 0.0:
        return f"{listed(alike)} tie with these weights"
    among = "of the draws of uncertain values" if is_fixed else "of the possible weights"
    others = [
        f"{candidate.title} for {_share_words(candidate.ranks[0])}"
        for candidate in candidates[1:4]
        if candidate.ranks[0] > 1.0 - _ALWAYS
    ]
    suffix = f"; {listed(others)}" if others else ""
    return f"{best.title} ranks first for {_share_words(share)} {among}{suffix}{outside}"


def scale_words(tree: xr.DataTree) -> str:
    """The meaning of each criterion, with the values that score 0 and 1, in words."""
    data = group(tree, "criteria")
    ends = (_in_words(data, data[end].values) for end in ("worst", "best"))
    parts = [
        f"{criterion}{f' ({says})' if str(says) != str(criterion) else ''} from {worst} to {best}"
        for criterion, says, worst, best in zip(data["weighed"].values, data["weighed_says"].values, *ends, strict=True)
    ]
    return ", ".join(parts)


def _share_words(share: float) -> str:
    """A share in per cent, with enough digits to distinguish it from 100 %."""
    return pretty(share, FRACTION, 2 if share < _NEARLY_ALL else 3)


def weight_words(tree: xr.DataTree) -> str:
    """The declared order or ranges of the weights, in words."""
    data = group(tree, "criteria")
    places = sorted(
        (int(position), str(criterion))
        for criterion, position in zip(data["weighed"].values, data["weight_order"].values, strict=True)
    )
    if ordered := [criterion for position, criterion in places if position > 0]:
        return f"in this order of importance: {', '.join(ordered)}"
    ranges = []
    for criterion, low, high in zip(
        *(data[key].values for key in ("weighed", "weight_low", "weight_high")), strict=True
    ):
        ends = [pretty(float(end), FRACTION, 2) for end in (low, high)]
        if (low, high) != (0.0, 1.0):
            ranges.append(f"{criterion} {ends[0]}" if low == high else f"{criterion} {ends[0]} to {ends[1]}")
    return ", ".join(ranges) if ranges else "unknown"


@dataclass(frozen=True, kw_only=True)
class FrontDesign:
    """A design of a sweep on the Pareto front, in words."""

    swept: tuple[str, ...]
    title: str
    values: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Front:
    """The Pareto front of a sweep over three numbers or more.

    Parameters
    ----------
    swept
        The swept parameters in words.
    designs
        The designs on the front with the largest value at the mean of the possible weights.
    count
        Number of designs on the front; candidates that the sweep does not move count once.
    """

    swept: tuple[str, ...]
    designs: tuple[FrontDesign, ...]
    count: int


def pareto_front(tree: xr.DataTree, most: int) -> Front | None:
    """The front of a sweep over three numbers or more, with its `most` best designs; None for any other study.

    A candidate that the sweep does not move shows no swept values.
    """
    if not has(tree, "criteria", "design_value"):
        return None
    data, titles = group(tree, "criteria"), camera_titles(tree)
    dims = [str(dim) for dim in data["on_pareto_front"].dims if dim != "candidate"]
    if sum(data[dim].dtype.kind in "fiu" for dim in dims) < _NUMBERS:
        return None
    table = data["design_value"].transpose(*dims, "candidate", "weighed").values
    places = np.argwhere(data["on_pareto_front"].transpose(*dims, "candidate").values > 0.0)
    rows = np.array([table[tuple(place)] for place in places]).reshape(len(places), -1)
    flat = table.reshape(-1, *table.shape[-2:])
    moved = [
        not np.array_equal(values, np.broadcast_to(values[:1], values.shape), equal_nan=True)
        for values in flat.swapaxes(0, 1)
    ]
    _, once = np.unique(np.column_stack([places[:, -1], rows]), axis=0, return_index=True)
    best = sorted(once.tolist(), key=lambda k: (-_worth(data, rows[k]), k))
    designs = [
        FrontDesign(
            swept=tuple(
                value_words(data[dim], data[dim].values[place]) if moved[places[k][-1]] else "—"
                for dim, place in zip(dims, places[k][:-1], strict=True)
            ),
            title=titles[str(data["candidate"].values[places[k][-1]])],
            values=_in_words(data, rows[k]),
        )
        for k in best[:most]
    ]
    return Front(swept=tuple(path_words(tree, dim) for dim in dims), designs=tuple(designs), count=len(best))


def _worth(data: xr.Dataset, values: FloatArray) -> float:
    scales = [ValueScale(worst=a, best=b) for a, b in zip(data["worst"].values, data["best"].values, strict=True)]
    worth = [scale.value(np.asarray(value)) for scale, value in zip(scales, values, strict=True)]
    return float(np.dot(worth, data["weight_mean"].values))


def _in_words(data: xr.Dataset, values: FloatArray) -> tuple[str, ...]:
    units = [str(unit) for unit in data["weighed_units"].values]
    return tuple(pretty(float(v), BY_UNIT.get(unit, NUMBER)) for v, unit in zip(values, units, strict=True))
