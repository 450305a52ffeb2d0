"""Uncertainty budgets: what each input contributes to the depth uncertainty of a camera, at each declared distance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
import numpy.typing as npt
import xarray as xr

from tradestudy.report.document import Block, Column, Heading, Paragraph, Table, Text, say
from tradestudy.report.words import interval, length, or_dash, share
from tradestudy.results.views.depth import false_matches_declared, table_depth
from tradestudy.results.views.designs import BY_UNIT
from tradestudy.results.views.finding import detailed_cameras
from tradestudy.results.views.groups import FloatArray, group, has, perfectly_calibrated, titles_in
from tradestudy.units import (
    NUMBER,
    PRESSURE_DIFFERENCE,
    TEMPERATURE_DIFFERENCE,
    pretty,
    significant,
)
from tradestudy.wording import counted, distance, in_words, listed, with_article

_MOST_ROWS: Final = 12  # per budget; of more, the inputs that make up almost all of the sum of their squares
_ALMOST_ALL: Final = 0.99
_NO_CELLS: Final = ("",) * 5  # from the distribution to the sensitivity coefficient
_DIMENSIONS: Final = {**BY_UNIT, "1": NUMBER, "K": TEMPERATURE_DIFFERENCE, "Pa": PRESSURE_DIFFERENCE}


def list_budgets(tree: xr.DataTree) -> Iterator[Block]:
    """Write one table per camera with its budgets at the declared distances where it is usable."""
    if not has(tree, "budget"):
        return
    data, depth = group(tree, "budget"), table_depth(tree)
    usable = depth["usable"].sel(distance=data["distance"], method="nearest")
    titles = {
        key: title for key, title in titles_in(tree, "budget").items() if bool(usable.sel(camera=key).values.any())
    }
    if not titles:
        return
    coverage = share(float(data["coverage"].max()))
    yield Heading(text="Uncertainty budgets", anchor="budgets")
    yield Paragraph(
        say(
            "The tables follow the GUM (JCGM 100:2008). *Type*: A where observations determine the distribution of the "
            "input, B where it is declared, derived or simulated. *u*: standard uncertainty of the input. *c*: "
            "sensitivity coefficient, the change of the measured depth per unit of the input. *|c| u*: contribution. "
            "*Share*: of the combined variance; the covariance of two correlated inputs has a row of its own, with "
            "their correlation *r* (many pairs share one row), so that shares sum to 100 %. *u*~c~: combined "
            "standard uncertainty. *U* = *k u*~c~: expanded uncertainty for {coverage} coverage. The coverage factor "
            "*k* is that of the t distribution with the effective degrees of freedom by Welch and Satterthwaite; only "
            "inputs with a Student-t distribution have finite degrees of freedom. Where *U* would differ from half the "
            "width of the {coverage} interval of depths by more than {tolerance}, depth is not linear enough in the "
            "inputs: the linear model is refused, and only the interval counts.{left_out}",
            coverage=coverage,
            tolerance=share(float(data.attrs["tolerance"])),
            left_out="".join(f" {sentence}" for sentence in _left_out(tree, data)),
        )
    )
    shown = detailed_cameras(tree, "budget")
    for key, title in shown.items():
        yield _budgets_of(data.sel(camera=key), usable.sel(camera=key).values.astype(bool), key, title)
    further = len(titles) - len(shown)
    yield Paragraph(
        say(
            "All budgets, also those of {further}distances at which a camera is not usable, are in "
            "`tables/budget_by_camera_distance.csv` and `tables/budget_by_camera_distance_source.csv`.",
            further=f"{counted(further, 'further camera')} and of " * bool(further),
        )
    )


def _left_out(tree: xr.DataTree, data: xr.Dataset) -> Iterator[str]:
    """What no budget contains, in sentences."""
    inputs = (data["distribution"] != "").any("distance").sum("source").values
    bare, perfect = dict(zip(data["camera"].values, inputs == 1, strict=True)), perfectly_calibrated(tree)
    noise_only = [title for key, title in titles_in(tree, "budget").items() if bare[key] and title not in perfect]
    if noise_only:
        yield f"The chosen models leave out the calibration errors of {listed(noise_only)}."
    if false_matches_declared(tree):
        yield "False matches are left out."


def _budgets_of(data: xr.Dataset, usable: npt.NDArray[np.bool_], key: str, title: str) -> Table:
    """The budgets of one camera, each under a line with its result."""
    rows: list[tuple[Text, ...]] = []
    for place in np.flatnonzero(usable):
        here = data.isel(distance=int(place))
        rows += [(_result(here),), *_rows(here)]
    finite = bool(np.isfinite(data["degrees_of_freedom"].values).any())  # a column of ∞ alone says nothing
    return Table(
        name=f"budget-{key}",
        caption=f"Uncertainty budgets of {with_article(title)}.",
        columns=(
            Column(title="Input", weight=1),
            Column(title="Distribution"),
            Column(title="Type", align="center"),
            *(Column(title="ν", align="right"),) * finite,
            Column(title="u", align="right"),
            Column(title="c", align="right"),
            Column(title="|c| u", align="right"),
            Column(title="Share", align="right"),
        ),
        rows=tuple(row if len(row) == 1 or finite else (*row[:3], *row[4:]) for row in rows),
    )


def _result(here: xr.Dataset) -> Text:
    """The combined and the expanded uncertainty at one distance, and the interval of depths."""
    number = {str(variable): float(array) for variable, array in here.data_vars.items() if not array.dims}
    freedom, expanded = number["effective_degrees_of_freedom"], number["expanded_uncertainty"]
    return say(
        "At {at}: {combined}{expanded}{coverage} interval {interval}",
        at=distance(float(here["distance"])),
        combined=()
        if np.isnan(number["combined_uncertainty"])
        else say("*u*~c~ = {combined}; ", combined=length(number["combined_uncertainty"])),
        expanded="linear model refused; "
        if np.isnan(expanded)
        else say(
            "*U* = {expanded} (*k* = {factor}{freedom}); ",
            expanded=length(expanded),
            factor=significant(number["coverage_factor"]),
            freedom=f", {significant(freedom)} effective degrees of freedom" * math.isfinite(freedom),
        ),
        coverage=share(number["coverage"]),
        interval=interval(number["interval_near"], number["interval_far"]),
    )


def _rows(here: xr.Dataset) -> Iterator[tuple[Text, ...]]:
    """The inputs at one distance, the largest shares first, and the correlated pairs; of many, only what matters."""
    shares = here["variance"].values / float(here["combined_uncertainty"]) ** 2
    inputs, pairs = here["distribution"].values != "", np.isfinite(here["correlation"].values)
    order = _largest_first(shares, inputs)
    few = int(np.sum(inputs | pairs)) <= _MOST_ROWS
    made_up = np.cumsum(shares[order]) / np.sum(shares[order])
    count = order.size if few else min(_MOST_ROWS, int(np.searchsorted(made_up, _ALMOST_ALL)) + 1)
    for number in order[:count]:
        yield _row(here.isel(source=int(number)), float(shares[number]))
    if few:
        for number in _largest_first(shares, pairs):
            yield _pair_row(here.isel(source=int(number)), float(shares[number]))
    for label, rest in (("other input", shares[order[count:]]), ("correlated pair", shares[pairs])):
        if rest.size and not few:
            yield counted(rest.size, label), *_NO_CELLS, "", or_dash(float(np.sum(rest)), share)


def _largest_first(shares: FloatArray, chosen: npt.NDArray[np.bool_]) -> npt.NDArray[np.intp]:
    """Places of these rows, by the magnitude of their shares."""
    places = np.flatnonzero(chosen)
    return places[np.argsort(-np.abs(np.nan_to_num(shares[places])), kind="stable")]


def _row(source: xr.Dataset, part: float) -> tuple[Text, ...]:
    unit, distribution = str(source["input_units"].values), str(source["distribution"].values)
    return (
        in_words(str(source["source"].values)),
        "draws" if distribution == "empirical" else distribution.replace("-", " "),
        str(source["evaluation"].values),
        significant(float(source["degrees_of_freedom"])),
        pretty(float(source["input_uncertainty"]), _DIMENSIONS[unit]).replace(" ", "\N{NO-BREAK SPACE}"),
        _coefficient(float(source["sensitivity_coefficient"]), unit),
        length(float(source["contribution"])),
        or_dash(part, share),
    )


def _pair_row(source: xr.Dataset, part: float) -> tuple[Text, ...]:
    pair = " with ".join(map(in_words, str(source["source"].values).split(" and ")))
    return pair, *_NO_CELLS[:3], f"r = {significant(float(source['correlation']))}", "", "", or_dash(part, share)


def _coefficient(value: float, unit: str) -> str:
    """Write a change of depth per unit of an input, of an angle per degree; of a length, it is a plain number."""
    if unit == "m" or np.isnan(value):
        return or_dash(value)
    per = {"rad": "/°", "1": ""}.get(unit, f"/{unit}")
    return length(value * (math.radians(1.0) if unit == "rad" else 1.0)) + per
