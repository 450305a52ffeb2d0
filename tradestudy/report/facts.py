"""What the sections say with numbers, read from a results tree: registers, places, winners and how often they flip."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tradestudy.units import FRACTION, LENGTH, pretty
from tradestudy.wording import distance

if TYPE_CHECKING:
    import xarray as xr


def has(tree: xr.DataTree, group: str, *variables: str) -> bool:
    """Whether a group exists and holds all these variables."""
    return group in tree.children and all(name in tree[group].data_vars for name in variables)


def dataset(tree: xr.DataTree, group: str) -> xr.Dataset:
    """Get a group as a dataset."""
    return tree[group].to_dataset()


def records(tree: xr.DataTree, group: str, dim: str) -> list[dict[str, Any]]:
    """Read the one-dimensional variables of a group row by row; the row's own name is under `dim`."""
    if group not in tree.children:
        return []
    data = dataset(tree, group)
    columns = [str(name) for name, array in data.data_vars.items() if array.dims == (dim,)]
    return [
        {dim: data[dim].values[index]} | {name: data[name].values[index] for name in columns}
        for index in range(data.sizes.get(dim, 0))
    ]


def attribute(tree: xr.DataTree, name: str) -> str:
    """Get an attribute of the root as text."""
    return str(tree.attrs.get(name, ""))


def in_words(name: str) -> str:
    """Write a name of the results as words."""
    return name.replace("_", " ")


def length(value: float) -> str:
    """Write a length with the unit a person expects, not broken between number and unit."""
    return pretty(value, LENGTH).replace(" ", "\N{NO-BREAK SPACE}")


def interval(low: float, high: float) -> str:
    """Write the ends of an interval of distances [m], in one unit, with the digits that tell them apart."""
    if not np.isfinite([low, high]).all():
        return f"{distance(low)} – {distance(high)}"
    size, unit = (1.0, "m") if high >= 0.1 else (1e-3, "mm")
    width = (high - low) / size
    finest = min(width, low / size)
    decimals = max(0, 1 - int(np.floor(np.log10(finest)))) if finest > 0 else 3
    return f"{low / size:.{decimals}f} – {high / size:.{decimals}f}\N{NO-BREAK SPACE}{unit}"


def share(value: float) -> str:
    """Write a fraction in per cent."""
    return pretty(value, FRACTION).replace(" ", "\N{NO-BREAK SPACE}")


def titles(tree: xr.DataTree) -> dict[str, str]:
    """Get the titles of the cameras by their keys, in the order of the study."""
    group = dataset(tree, "cameras")
    return {str(k): str(t) for k, t in zip(group["camera"].values, group["title"].values, strict=True)}


def depth_titles(tree: xr.DataTree) -> dict[str, str]:
    """Get the titles of the cameras that measure depth."""
    measured = {str(key) for key in dataset(tree, "depth")["camera"].values}
    return {key: title for key, title in titles(tree).items() if key in measured}


def method_of_cameras(tree: xr.DataTree) -> dict[str, dict[str, Any]]:
    """Get how each camera that measures depth finds it, by its key."""
    cameras = dataset(tree, "cameras")
    written = zip(cameras["camera"].values, cameras["method"].values, strict=True)
    return {str(key): json.loads(str(method)) for key, method in written if method}


def families(tree: xr.DataTree) -> dict[str, str]:
    """Get the families of the cameras by their keys."""
    group = dataset(tree, "cameras")
    return {str(k): str(f) for k, f in zip(group["camera"].values, group["family"].values, strict=True)}


def places(tree: xr.DataTree) -> npt.NDArray[np.float64]:
    """Get the declared distances [m]; without a decision, a few from end to end of the range."""
    from tradestudy.results.depth import distances_without_decision

    if has(tree, "decision") and "place" in tree["decision"].coords:
        return np.asarray(dataset(tree, "decision")["place"].values, dtype=float)
    return distances_without_decision(np.asarray(dataset(tree, "depth")["distance"].values, dtype=float))


@dataclass(frozen=True, kw_only=True)
class Flips:
    """The verdict on the headline pair at one declared distance, and the readings under which it differs.

    Parameters
    ----------
    place
        Distance [m].
    more_certain, winner
        The camera of lower uncertainty, and the better usable one (may be empty), in the study's own reading.
    ratio
        Uncertainty of the pair's first camera over that of the second, in the study's own reading.
    alternatives
        How many other readings there are.
    flipped
        Those in which the winner is another one, and which (may be empty).
    """

    place: float
    more_certain: str
    winner: str
    ratio: float
    alternatives: int
    flipped: tuple[tuple[str, str], ...]


def flips(tree: xr.DataTree, way: str = "both") -> Iterator[Flips]:
    """Count the readings under which another camera wins, for every declared distance."""
    if not has(tree, "decision", "more_certain", "winner", "flips", "uncertainty_ratio"):
        return
    decision = dataset(tree, "decision").sel(way=way)
    names = [str(name) for name in decision["reading"].values]
    for place in decision["place"].values:
        there = decision.sel(place=place)
        flipped = np.asarray(there["flips"].values, dtype=bool)
        yield Flips(
            place=float(place),
            more_certain=str(there["more_certain"].values[0]),
            winner=str(there["winner"].values[0]),
            ratio=float(there["uncertainty_ratio"].values[0]),
            alternatives=len(names) - 1,
            flipped=tuple(
                (name, str(winner))
                for name, winner, flips_here in zip(names[1:], there["winner"].values[1:], flipped[1:], strict=True)
                if flips_here
            ),
        )


def handovers(decision: xr.Dataset) -> Iterator[float]:
    """Distances [m] where one camera of the pair takes over from the other, for one reading and one way."""
    for place, nearer, farther in zip(
        decision["change_distance"].values,
        decision["change_nearer"].values,
        decision["change_farther"].values,
        strict=True,
    ):
        if np.isfinite(place) and nearer and farther:
            yield float(place)


@dataclass(frozen=True, kw_only=True)
class Solved:
    """An inverse question with its answer in words; `found` says whether there is a value."""

    says: str
    answer: str
    found: bool


def solved(tree: xr.DataTree) -> tuple[Solved, ...]:
    """Read the inverse questions of a study."""
    if not has(tree, "decision", "solved_value", "solved_says", "solved_answer"):
        return ()
    return tuple(
        Solved(
            says=str(row["solved_says"]),
            answer=str(row["solved_answer"]),
            found=bool(np.isfinite(float(row["solved_value"]))),
        )
        for row in records(tree, "decision", "question")
    )
