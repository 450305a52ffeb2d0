"""The single table of results, `variables.tsv`: every variable with its dimensions, unit, symbol and source.

`results.nc` contains only variables that are declared there, each with a unit ("1" for a plain number).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    import xarray as xr  # only for types here, because plans use only the words of the results

FORMAT_VERSION: Final = 9
DISTANCE: Final = {"units": "m", "long_name": "object distance", "symbol": "a"}
"""Attributes of the coordinate ``distance``."""
PAPER: Final = "Diffraction model of a plenoptic camera for in-situ space exploration"
JUDGED: Final = ("depth_uncertainty", "depth_error_radius")
"""The larger of these variables judges a camera; see `judged_uncertainty`."""
UNCONVERGED: Final = "unconverged"
"""Attribute of the root: cameras whose calibrations for readings or designs did not converge, a line each."""
_SWEPT: Final = (
    "depth",
    "decision",
    "criteria",
    "refocusing",
    "requirements",
)  # groups with swept parameters as dimensions
_ALSO_IN: Final = "as in /"
_NOT_IN_WORDS: Final = re.compile("_(px|percent|by_error_source)$")  # units and dimensions, which plots show anyway
_SEE: Final = re.compile(r"see (\w+)(?! of /)\b")


@dataclass(frozen=True)
class Variable:
    """One variable of the results: a line of `variables.tsv`.

    Parameters
    ----------
    dims
        Dimensions, after those of the study's sweep.
    units
        SI unit, "1" for a plain number, "" for text.
    symbol, reference
        Its symbol, and the source of its equation.
    error
        The variable with its error estimate, or why it is exact. `compare` reads it, and the words "standard error" in
        the ``comment`` of that variable.
    long_name
        Its short name, as on the axis of a plot.
    comment
        What the variable is.
    described_in
        The group whose variable of the same name is the same but for its dimensions, and describes both.
    """

    dims: tuple[str, ...]
    units: str
    symbol: str
    reference: str
    error: str
    long_name: str
    comment: str
    described_in: str = ""


def _declared(table: str) -> Mapping[str, Mapping[str, Variable]]:
    """The variables of each group; a comment "as in /GROUP" stands for all texts of that group's variable.

    An empty long name is the name in words. Errors are named after their values.
    """
    groups: dict[str, dict[str, Variable]] = {}
    for line in table.splitlines()[1:]:
        group, name, dims, *texts = line.split("\t")
        variable = Variable(tuple(dims.split(", ")) if dims else (), *texts)
        value_name, in_group = name.removesuffix("_error"), groups.setdefault(group, {})
        if (other := variable.comment.removeprefix(_ALSO_IN)) in groups:
            variable = replace(groups[other][name], dims=variable.dims, described_in=other)
        elif not variable.long_name:
            is_error = value_name in in_group and variable.error.startswith("itself")
            words = (
                f"error of {in_group[value_name].long_name}"
                if is_error
                else _NOT_IN_WORDS.sub("", name).replace("_", " ")
            )
            variable = replace(variable, long_name=words)
        in_group[name] = variable
    return groups


GROUPS: Final = _declared(Path(__file__).with_name("variables.tsv").read_text(encoding="utf-8"))
"""The variables of each group of the results, by name."""


def dataset(
    group: str,
    values: Mapping[str, Any],
    coordinates: Mapping[str, Sequence[Any] | np.ndarray[Any, Any]],
    *,
    leading: tuple[str, ...] = (),
    attributes: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """Build one group of the results from arrays in the declared order of dimensions.

    Parameters
    ----------
    group
        Name of the group in `GROUPS`.
    values
        One array per variable; variables that the study does not ask for are left out.
    coordinates
        Labels along each dimension that has them.
    leading
        Dimensions of the study's sweep, before the declared ones.
    attributes
        Attributes of the group.
    """
    import xarray as xr

    declared = GROUPS[group]
    variables = {}
    for name, value in values.items():
        spec = declared[name]
        attrs = {key: getattr(spec, key) for key in ("units", "long_name", "comment")}
        attrs |= {key: text for key in ("symbol", "reference", "error") if (text := getattr(spec, key))}
        if (see := _SEE.match(spec.error)) and see[1] in values:
            attrs["ancillary_variables"] = see[1]
        array = np.asarray(value)
        # Values that no swept parameter changes come without the dimensions of the sweep.
        swept = leading if array.ndim == len(leading) + len(spec.dims) else ()
        variables[name] = (swept + spec.dims, array.astype(object) if array.dtype.kind == "U" else array, attrs)
    coords = {
        name: np.asarray(labels, dtype=object) if len(labels) > 0 and isinstance(labels[0], str) else labels
        for name, labels in coordinates.items()
    }
    result = xr.Dataset(variables, coords=coords, attrs=dict(attributes or {}))
    for name in map(str, result.coords):
        of_length = {"units": "m"} if name.endswith(("distance", "place")) else {}
        result[name].attrs = of_length | {"long_name": name.replace("_", " ")}
    if "distance" in result.coords:
        result["distance"].attrs = dict(DISTANCE)
    return result


def padded(rows: Sequence[Sequence[Any] | npt.NDArray[Any]], absent: Any = math.nan) -> npt.NDArray[Any]:
    """Rows as one array, each padded with `absent` to the length of the longest, and to at least one column."""
    width = max([1, *map(len, rows)])
    return np.array([[*row, *[absent] * (width - len(row))] for row in rows])


def padded_attributes(rows: Sequence[Sequence[Any]], absent: Mapping[str, Any]) -> dict[str, npt.NDArray[Any]]:
    """The attributes named in `absent` of the objects in these rows, each as one array, padded with its value there."""
    return {
        attribute: padded([[getattr(item, attribute) for item in row] for row in rows], empty)
        for attribute, empty in absent.items()
    }


def coordinate_names(paths: Sequence[str]) -> list[str]:
    """The names of swept parameters: the shortest end of each path that no other path, variable or dimension has.

    They are identifiers, so that ``sel(baseline=0.1)`` works: dots and hyphens become underscores.
    """
    taken = {text for group in _SWEPT for name, variable in GROUPS[group].items() for text in (name, *variable.dims)}
    identifiers = ["_" + re.sub(r"\W", "_", path) for path in paths]
    names = []
    for path in paths:
        words = path.split(".")
        ends = (re.sub(r"\W", "_", ".".join(words[k:])) for k in range(len(words) - 1, -1, -1))
        free = (
            end
            for end in ends
            if end not in taken and sum(identifier.endswith("_" + end) for identifier in identifiers) == 1
        )
        names.append(next(free, path))
    return names


def judged_uncertainty(depth: xr.Dataset, of: str = "") -> xr.DataArray:
    """What judges cameras: the larger of ``depth_uncertainty`` and ``depth_error_radius``.

    ``of`` is the end of the names of both variables: ``_error``, ``_by_error_source`` or ``_by_error_source_error``.
    """
    compared = of.removesuffix("_error")
    half_width, radius = (depth[name + compared] for name in JUDGED)
    of_half_width, of_radius = (depth[name + of] for name in JUDGED)
    # Negated, so that the half-width stays where the radius is NaN.
    return of_half_width.where(~(radius > half_width), of_radius)


def distances_without_decision(distance: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Four of a study's distances [m], from end to end, for tables of studies whose decision declares none."""
    evenly = np.geomspace(distance[0], distance[-1], 4)
    return np.asarray(distance[np.unique(np.abs(np.log(distance[:, None] / evenly)).argmin(axis=0))])
