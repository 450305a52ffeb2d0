"""The conclusions of a sweep: feasible designs, the best camera in each, and how ranges and crossover move."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import xarray as xr

from tradestudy.results import judged_uncertainty
from tradestudy.results.views.decision import answer_title
from tradestudy.results.views.depth import declared_place, swept
from tradestudy.results.views.groups import FloatArray, camera_titles, dotted_path, group, has
from tradestudy.units import (
    ANGLE,
    DATA,
    DURATION,
    FRACTION,
    LENGTH,
    MASS,
    NUMBER,
    PIXELS,
    POWER,
    SOLID_ANGLE,
    Dimension,
    pretty,
    rounded_inwards,
    significant,
)
from tradestudy.wording import distance, in_words, listed, with_article

BY_UNIT: Final = {
    dimension.unit: dimension for dimension in (LENGTH, ANGLE, PIXELS, DURATION, MASS, POWER, DATA, SOLID_ANGLE)
}
_STRUCTURE: Final = frozenset(("lenses", "depth", "sensor"))  # parts of a path that its words leave out
_MANY_TIMES: Final = 1.0
_NEARLY_ONE: Final = 1.1  # a smaller factor reads better as a percentage
_BOTH: Final = 2
_HARDLY, _CLEARLY = 1.1, 1.5  # factors of the depth uncertainty over the values of a swept number
_SHORTEST_SPREAD: Final = 3  # parts of a path such as calibration.errors.yaw.standard_deviation


@dataclass(frozen=True, kw_only=True)
class Design:
    """One design of a sweep.

    Parameters
    ----------
    values
        Value of every swept parameter by its path, in SI or as text.
    words
        The same in words.
    margin
        Smallest margin over the requirements that must hold; see `RequirementConclusion`.
    """

    values: dict[str, float | str]
    words: str
    margin: float


@dataclass(frozen=True, kw_only=True)
class Feasible:
    """The feasible designs: those that meet every requirement that must hold; if none must hold, every requirement.

    Parameters
    ----------
    count, designs
        Number of feasible designs, and of all designs.
    best
        The feasible design whose smallest margin is largest, or if none is feasible, the design. Between equal ones,
        the next smallest decides, then how nearly they meet the requirements.
    alike
        Whether every design meets or misses each requirement by as much as the best one.
    misses
        The requirements that this design misses, in the words of the study, and its worst values; worst missed first.
    undecided
        The requirements that cannot be decided for this design, likewise, with the reason.
    region
        Values of each parameter among the feasible designs, in words; empty where none is feasible.
    required, wishes
        Number of requirements that decide feasibility, and of the others.
    by_any
        Whether a requirement that decides feasibility is met if any camera meets it.
    fills_region
        Whether every combination of those values is feasible.
    missed
        Requirements that designs miss, each with the number of designs that miss it, most often missed first.
    """

    count: int
    designs: int
    best: Design
    alike: bool
    misses: tuple[tuple[str, str], ...]
    undecided: tuple[tuple[str, str], ...]
    region: str
    required: int
    wishes: int
    by_any: bool
    fills_region: bool
    missed: tuple[tuple[str, int], ...]


def path_words(tree: xr.DataTree, path: str) -> str:
    """A path of the study in words: ``cameras.head.baseline`` becomes "baseline of Head A"."""
    words, title = _words_and_camera(tree, path)
    return f"{words} of {with_article(title)}" if title else words


def parameter_words(tree: xr.DataTree, paths: Iterable[str]) -> str:
    """Paths of the study in words, those of one camera together: "baseline and focal length of Head A"."""
    by_camera: dict[str, list[str]] = {}
    for path in paths:
        words, title = _words_and_camera(tree, path)
        by_camera.setdefault(title, []).append(words)
    return listed(
        [
            f"{listed(parameters)} of {with_article(title)}" if title else listed(parameters)
            for title, parameters in by_camera.items()
        ]
    )


def _words_and_camera(tree: xr.DataTree, path: str) -> tuple[str, str]:
    """A path or dimension in words, and the title of its camera; an empty title where it belongs to none."""
    parts = dotted_path(tree, path).removeprefix("cameras.").removeprefix("scene.picture.").split(".")
    title = camera_titles(tree).get(parts[0], "")
    words = [part for part in parts[1:] if part not in _STRUCTURE] if title else parts
    if words[:2] == ["calibration", "errors"] and len(words) > _SHORTEST_SPREAD:
        words = [words[2], "spread" if words[-1] == "standard deviation" else words[-1]]
    return " ".join(map(in_words, words)), title


def design_words(tree: xr.DataTree, values: Mapping[str, str]) -> str:
    """A design in words: "Stereo rig with baseline 131 mm and focal length 8 mm"."""
    by_camera: dict[str, list[str]] = {}
    for path, value in values.items():
        words, title = _words_and_camera(tree, path)
        by_camera.setdefault(title, []).append(f"{words} {value}")
    return listed(
        [
            f"{with_article(title)} with {listed(settings)}" if title else listed(settings)
            for title, settings in by_camera.items()
        ]
    )


def dimension_of(axis: xr.DataArray) -> Dimension:
    """The dimension of a swept coordinate."""
    if axis.attrs.get("measures", "") == FRACTION.name:
        return FRACTION
    return BY_UNIT.get(str(axis.attrs.get("units", "")), NUMBER)


def value_words(axis: xr.DataArray, value: Any) -> str:
    """One value of a swept coordinate with its unit."""
    return str(value) if isinstance(value, str) else pretty(float(value), dimension_of(axis))


def feasible_designs(tree: xr.DataTree) -> Feasible | None:
    """The designs of a sweep that meet every requirement that must hold; None without a sweep or a requirement."""
    if not has(tree, "requirements", "design_met"):
        return None
    data = group(tree, "requirements")
    must = must_hold(data)
    axes = [str(dim) for dim in data["design_met"].dims if dim != "requirement"]
    verdicts = data["design_met"].transpose(*axes, "requirement").values[..., must]
    met = verdicts == 1
    margins = _of_required(data, "design_margin_percent", axes, must)
    # Results of earlier versions lack it.
    closeness = _of_required(data, "design_closeness", axes, must) if "design_closeness" in data else margins
    feasible, least = np.all(met, axis=-1), np.min(margins, axis=-1)
    # Feasible designs come first: a guard band can make a design fail although its margin is positive. Of designs with
    # equal margins, as of those that are usable nowhere, the one that falls short by less comes first.
    margin_and_closeness = [np.sort(rating.reshape(feasible.size, -1)) for rating in (margins, closeness)]
    ratings = np.column_stack([feasible.ravel(), *margin_and_closeness])
    best_first = np.lexsort(-ratings.T[::-1])
    best = np.unravel_index(int(best_first[0]), least.shape)
    values = {axis: data[axis].values[k] for axis, k in zip(axes, best, strict=True)}
    # Each parameter is judged by the margins along it, through the best design.
    words = [
        _best_value_words(data[axis], int(k), least[(*best[:place], slice(None), *best[place + 1 :])])
        for place, (axis, k) in enumerate(zip(axes, best, strict=True))
    ]
    says, reasons = data["says"].values[must], data["design_reason"].transpose(*axes, "requirement").values[best][must]
    not_met, undecided = (
        tuple(
            (str(says[k]), str(reasons[k]))
            for k in np.argsort(margins[best], kind="stable")
            if verdicts[best][k] == verdict
        )
        for verdict in (0, -1)
    )
    return Feasible(
        count=int(feasible.sum()),
        designs=int(feasible.size),
        best=Design(
            values={
                dotted_path(tree, axis): value if isinstance(value, str) else float(value)
                for axis, value in values.items()
            },
            words=design_words(tree, dict(zip(axes, words, strict=True))),
            margin=float(margins[best].min()) / 100.0,
        ),
        alike=np.allclose(closeness, closeness[best], rtol=1e-9, atol=0.0) and bool((verdicts == verdicts[best]).all()),
        misses=not_met,
        undecided=undecided,
        region=_region_words(tree, data, axes, feasible),
        required=int(must.sum()),
        wishes=int((~must).sum()),
        by_any=bool(np.any(data["of"].values[must] == "any")),
        fills_region=_fills_region(feasible),
        missed=_missed(says, met),
    )


def _of_required(data: xr.Dataset, name: str, axes: list[str], must: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """A number of each design and each requirement that must hold; -inf where it is unknown."""
    values = data[name].transpose(*axes, "requirement").values[..., must]
    return np.nan_to_num(np.asarray(values, dtype=np.float64), nan=-np.inf, posinf=np.inf)


def _best_value_words(axis: xr.DataArray, number: int, margins: npt.NDArray[np.float64]) -> str:
    """A value of the best design; a longer sweep might have a better one if the margin still rises at its end."""
    words, value = value_words(axis, axis.values[number]), axis.values[number]
    # Where the margin does not depend on this parameter, a longer sweep would not raise it.
    if axis.dtype.kind not in "fiu" or np.allclose(margins, margins[number], rtol=1e-9, atol=0.0):
        return words
    swept = np.sort(axis.values[axis.values != axis.attrs.get("declared")])  # the declared value is one of the designs
    if swept.size < 4:  # of three, hardly one lies within
        return words
    edges = {swept[0]: " (where the sweep begins)", swept[-1]: " (where the sweep ends)"}
    return words + edges.get(value, "")


def _fills_region(feasible: npt.NDArray[np.bool_]) -> bool:
    """Whether every combination of the values that feasible designs have is feasible."""
    used = [np.unique(numbers) for numbers in np.argwhere(feasible).T]
    return bool(feasible[np.ix_(*used)].all()) if feasible.any() else False


def _missed(says: npt.NDArray[Any], met: npt.NDArray[np.bool_]) -> tuple[tuple[str, int], ...]:
    counts = (~met).reshape(-1, met.shape[-1]).sum(axis=0)
    order = np.argsort(-counts, kind="stable")
    return tuple((str(says[k]), int(counts[k])) for k in order if counts[k])


def must_hold(data: xr.Dataset) -> npt.NDArray[np.bool_]:
    """Which requirements decide feasibility: those that must hold or, if there are none, all."""
    must = np.asarray(data["priority"].values == "must")
    return must if must.any() else ~must


def common_ranges(data: xr.Dataset, must: npt.NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Ranges of the one swept parameter, in SI, in which every requirement that must hold is met."""
    common = [(-np.inf, np.inf)]
    for number in np.flatnonzero(must):
        row = data.isel(requirement=int(number))
        columns = (row[column].values.tolist() for column in ("met_from", "met_to", "met_to_within"))
        own_ranges = _joined([ends for ends in zip(*columns, strict=True) if not np.isnan(ends[0])])
        common = [(max(a, c), min(b, d)) for a, b in common for c, d in own_ranges if max(a, c) <= min(b, d)]
    return [(float(low), float(high)) for low, high in common if np.isfinite([low, high]).all()]


def _joined(ranges: list[tuple[float, float, float]]) -> list[tuple[float, float]]:
    """Join the ranges (from, to, error) of several cameras that overlap, or meet where one takes over from another.

    Two ranges meet there within their brackets, whose width is twice the error.
    """
    joined: list[tuple[float, float, float]] = []
    for low, high, error in sorted(ranges):
        if joined and low <= joined[-1][1] + 2.0 * (error + joined[-1][2]):
            joined[-1] = (joined[-1][0], *max(joined[-1][1:], (high, error)))
        else:
            joined.append((low, high, error))
    return [(low, high) for low, high, _ in joined]


def interval_words(low: float, high: float, values: FloatArray, dimension: Dimension, error: float = 0.0) -> str:
    """A range of a swept parameter: "from 53.4 mm on" where it reaches the last value of the sweep.

    Computed ends are rounded inwards, so that the written values lie within the range; `error` is that of both.
    """
    begins, ends = low <= values[0], high >= values[-1]
    first, last = rounded_inwards(low, high, dimension, error)
    first, last = pretty(low, dimension) if begins else first, pretty(high, dimension) if ends else last
    if begins and ends:
        return f"anywhere from {first} to {last}"
    if ends:
        return f"from {first} on (the sweep ends at {last})"
    if begins:
        return f"up to {last} (the sweep begins at {first})"
    return f"from {first} to {last}"


def _region_words(tree: xr.DataTree, data: xr.Dataset, axes: list[str], feasible: npt.NDArray[np.bool_]) -> str:
    """The values of each parameter among the feasible designs; for one swept number, its computed ranges."""
    if not feasible.any():
        return ""
    if "met_from" in data:
        axis = data[axes[0]]
        values = np.asarray(axis.values, dtype=np.float64)
        ends = common_ranges(data, must_hold(data))
        ranges = " and ".join(interval_words(low, high, values, dimension_of(axis)) for low, high in ends)
        return design_words(tree, {axes[0]: ranges})
    return design_words(
        tree, {axis: _values_words(data[axis], np.argwhere(feasible)[:, k]) for k, axis in enumerate(axes)}
    )


def _values_words(axis: xr.DataArray, numbers: npt.NDArray[np.intp]) -> str:
    """The values of one parameter at these indices: numbers from smallest to largest, choices by name."""
    used = np.unique(numbers)
    if axis.dtype.kind not in "fiu":
        return listed([str(axis.values[k]) for k in used])
    ends = [value_words(axis, axis.values[k]) for k in (used[0], used[-1])]
    return ends[0] if used.size == 1 else f"{ends[0]} to {ends[1]}"


def all_requirements(count: int) -> str:
    """So many requirements in words: "both requirements"."""
    return {1: "the requirement", 2: "both requirements"}.get(count, f"all {count} requirements")


def feasible_words(tree: xr.DataTree) -> str:
    """Which designs are feasible, as a clause; empty without a sweep or a requirement."""
    feasible = feasible_designs(tree)
    if feasible is None:
        return ""
    requirements = all_requirements(feasible.required)
    requirements += " that must hold" if feasible.wishes and feasible.required > 1 else ""
    requirements += " with one of the cameras" if feasible.by_any and len(camera_titles(tree)) > 1 else ""
    if not feasible.count:
        if not feasible.alike:
            closest = f"{feasible.best.words} comes closest"
        elif feasible.misses:
            closest = f"all miss {'it' if feasible.required == 1 else 'them'} alike"
        else:
            closest = f"{'it' if feasible.required == 1 else 'one of them'} cannot be decided for any"
        return f"none of {feasible.designs} designs meets {requirements}: {closest}"
    if feasible.count == feasible.designs:
        return f"every design meets {requirements}: {feasible.region}"
    counts = (
        f"{feasible.count} of {feasible.designs} designs {'meets' if feasible.count == 1 else 'meet'} {requirements}"
    )
    return (
        f"take {feasible.region}: {counts}"
        if feasible.fills_region
        else f"{counts}: {feasible.region} (not every combination)"
    )


def deciding_words(tree: xr.DataTree) -> str:
    """Which swept number decides a camera's depth uncertainty and which hardly matters, if one of several does."""
    if not has(tree, "decision", "design_best_camera"):
        return ""
    depth = group(tree, "depth")
    axes = [axis for axis in swept(depth) if depth[axis].dtype.kind in "fiu" and depth[axis].size > 1]
    owners = [dotted_path(tree, axis).removeprefix("cameras.").partition(".")[0] for axis in axes]
    if len(axes) < _BOTH or len(set(owners)) > 1 or (owner := owners[0]) not in depth["camera"].values:
        return ""
    place = float(group(tree, "decision")["design_place"].values[-1])
    here = depth.sel(camera=owner).sel(distance=place, method="nearest")
    uncertainty = judged_uncertainty(here).transpose(*axes, ...)
    factor = {axis: float((uncertainty.max(axis) / uncertainty.min(axis)).median()) for axis in axes}
    idle = [axis for axis in axes if factor[axis] < _HARDLY]
    busy = [axis for axis in axes if factor[axis] > _CLEARLY]
    # A number that neither clearly decides nor hardly matters fits neither half of the sentence.
    if not idle or len(idle) + len(busy) < len(axes):
        return ""
    declared = {axis: declared_place(depth[axis]) for axis in busy}
    held_at = {axis: depth[axis].size // 2 if k is None else k for axis, k in declared.items()}
    # With the deciding numbers held, what is left varies only with those that hardly matter.
    along = uncertainty.isel(held_at).values
    low, high = (pretty(float(end), LENGTH, digits=2) for end in (np.nanmin(along), np.nanmax(along)))
    words = {axis: path_words(tree, axis).partition(" of ")[0] for axis in axes}
    held = listed([f"{words[axis]} {value_words(depth[axis], depth[axis].values[k])}" for axis, k in held_at.items()])
    names = [listed([words[axis] for axis in chosen]) for chosen in (busy, idle)]
    spread = low if low == high else f"{low} to {high}"
    verbs = ["decides" if len(busy) == 1 else "decide", "hardly matters" if len(idle) == 1 else "hardly matter"]
    by = f" by {with_article(camera_titles(tree)[owner])}" if depth["camera"].size > 1 else ""
    return f"for depth{by} at {distance(place)}, {names[0]} {verbs[0]} and {names[1]} {verbs[1]}: ±{spread} with {held}"


def design_details(tree: xr.DataTree) -> str:
    """The margin of the best design and what the others miss, in sentences, without the last full stop."""
    feasible = feasible_designs(tree)
    if feasible is None:
        return ""
    if not feasible.count:
        which = "Every design" if feasible.alike else "The closest design"
        not_met, undecided = (
            listed([f"“{says}” ({reason})" for says, reason in requirements])
            for requirements in (feasible.misses, feasible.undecided)
        )
        said = f"misses {not_met}" * bool(not_met) + " and " * bool(not_met and undecided)
        return f"{which} {said}" + f"leaves undecided {undecided}" * bool(undecided)
    size = _margin_size(feasible.best.margin) if np.isfinite(feasible.best.margin) else ""
    if feasible.alike:
        return f"The margin of every design is {size}" if size else ""
    margin = f"Largest margin, {size}" if size else "Best"
    missed = [f"{count} {'misses' if count == 1 else 'miss'} “{says}”" for says, count in feasible.missed]
    # More misses than designs that miss anything: some designs miss several requirements.
    overlap = sum(count for _, count in feasible.missed) > feasible.designs - feasible.count
    some = f" (some miss {'both' if feasible.required == _BOTH else 'several'})" if overlap else ""
    others = f". Of the others, {listed(missed)}{some}" if len(missed) > 1 else ""
    return f"{margin}: {feasible.best.words}{others}"


def margin_words(margin: float) -> str:
    """By how much the worst value could worsen within its bound, or the factor by which it misses the bound."""
    if margin < 0.0:
        factor = 1.0 / (1.0 + margin)
        if factor < _NEARLY_ONE:
            return f"missed by {pretty(factor - 1.0, FRACTION, digits=2)}"
        return f"missed by a factor of {significant(factor, 3)}"
    return f"{_margin_size(margin)} to spare"


def _margin_size(margin: float) -> str:
    if margin >= _MANY_TIMES:
        return f"a factor of {significant(1.0 + margin, 2)}"
    return pretty(margin, FRACTION, digits=2)


def favoured_words(tree: xr.DataTree) -> Iterator[str]:
    """The best cameras over the designs of a sweep, at a few distances."""
    if not has(tree, "decision", "design_best_camera"):
        return
    data, titles = group(tree, "decision"), camera_titles(tree)
    best = data["design_best_camera"]
    axes = [str(dim) for dim in best.dims if dim != "design_place"]
    places: dict[str, list[str]] = {}
    for place in data["design_place"].values:
        names = best.sel(design_place=place).transpose(*axes).values
        places.setdefault(_favoured(titles, data, axes, names), []).append(distance(float(place)))
    for best_words, where in places.items():
        yield f"at {listed(where)}: {best_words}"


def _favoured(titles: dict[str, str], data: xr.Dataset, axes: list[str], names: npt.NDArray[Any]) -> str:
    every, counts = np.unique(names.astype(str), return_counts=True)
    order = np.argsort(-counts, kind="stable")
    if len(every) == 1:
        return f"{answer_title(titles, every[0])} in every design" if every[0] else "no camera in any design"
    axis = data[axes[0]]
    if len(axes) == 1 and axis.dtype.kind in "fiu":
        runs = np.flatnonzero(np.append(True, names[1:] != names[:-1]))
        ends = np.append(runs[1:], len(names)) - 1
        parts = []
        for first, last in zip(runs, ends, strict=True):
            low, high = (value_words(axis, axis.values[k]) for k in (first, last))
            where = f"with {low}" if first == last else f"from {low} to {high}"
            parts.append(f"{answer_title(titles, str(names[first]), 'no camera')} {where}")
        return ", ".join(parts)
    parts = [f"{answer_title(titles, every[k], 'no camera')} in {counts[k]}" for k in order]
    return f"{parts[0]} of {names.size} designs, {', '.join(parts[1:])}"
