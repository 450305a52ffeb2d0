"""The decision under calibration errors: who errs less with what probability, where two are equal, what it takes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

from tradestudy.report.document import Block, Bullets, Callout, Column, Heading, Table, Text, say
from tradestudy.report.words import in_words, length, share
from tradestudy.results.views.depth import largest_source, told_places
from tradestudy.results.views.groups import camera_titles, group, has, records
from tradestudy.units import significant
from tradestudy.wording import distance


def computed_places(tree: xr.DataTree) -> list[float]:
    """Computed distances nearest to the declared ones, each once."""
    grid = np.asarray(group(tree, "calibration")["distance"].values, dtype=np.float64)
    nearest = [float(grid[np.argmin(np.abs(np.log(grid / place)))]) for place in told_places(tree)]
    return list(dict.fromkeys(nearest))


def describe_verdict(tree: xr.DataTree) -> Iterator[Block]:
    """For each declared distance who errs less with what probability, and what drives it; then what would change it."""
    if not has(tree, "decision", "rank_first"):
        return
    decision, titles = group(tree, "decision"), camera_titles(tree)
    pair = decision.isel(pair=0).sel(field="axis")
    first, second = (str(pair[name].item()) for name in ("pair_first", "pair_second"))
    items = [
        say(
            "At {place} **{first}** errs less than {second} with a probability of **{rig}** over calibrations alone "
            "and **{reading}** in single readings; {first} is driven by {of_first}, {second} by {of_second}.",
            place=distance(place),
            first=titles[first],
            second=titles[second],
            rig=share(float(pair["rank_first"].sel(rank_way="calibration", rank_distance=place))),
            reading=share(float(pair["rank_first"].sel(rank_way="both", rank_distance=place))),
            of_first=in_words(largest_source(tree, first, place) or "nothing seen"),
            of_second=in_words(largest_source(tree, second, place) or "nothing seen"),
        )
        for place in computed_places(tree)
    ]
    if has(tree, "decision", "stability_answer"):
        items += [
            say("{says} **{answer}**.", says=str(row["stability_says"]), answer=str(row["stability_answer"]))
            for row in records(tree, "decision", "stability")
        ]
    yield Callout(title="The verdict under calibration errors", blocks=(Bullets(tuple(items)),), tone="answer")


def describe_ranks(tree: xr.DataTree) -> Table:
    """Probabilities of the ranks of every pair at the declared distances."""
    data, titles = group(tree, "decision"), camera_titles(tree)
    places = computed_places(tree)

    def cell(there: xr.Dataset, place: float) -> str:
        at = there.sel(rank_distance=place)
        first, error = float(at["rank_first"]), 2.0 * float(at["rank_first_error"])
        if first + float(at["rank_second"]) == 0.0:
            return "—"
        return f"{100 * first:.1f} ± {100 * error:.1f}\N{NO-BREAK SPACE}%"

    rows: list[tuple[Text, ...]] = []
    for way in data["rank_way"].values:
        rows.append(("Calibration alone" if way == "calibration" else "Single readings, noise and calibration",))
        for pair in data["pair"].values:
            there = data.sel(pair=pair, rank_way=way, field="axis")
            names = [titles[str(there[name].item())] for name in ("pair_first", "pair_second")]
            rows.append((*names, *(cell(there, place) for place in places)))
    return Table(
        name="rank-table",
        caption="Probability that the depth error of the first camera is smaller than that of the second, on the axis, "
        "with two Monte Carlo standard errors. A camera that does not see the point loses.",
        columns=(
            Column(title="First", weight=1),
            Column(title="Second", weight=1),
            *(Column(title=distance(place), align="right") for place in places),
        ),
        rows=tuple(rows),
    )


def describe_crossovers(tree: xr.DataTree) -> Iterator[Block]:
    """Distances at which the cameras of a pair are equally uncertain, with their Monte Carlo error."""
    data, titles = group(tree, "decision"), camera_titles(tree)
    rows: list[tuple[Text, ...]] = []
    for pair in data["pair"].values:
        one = data.sel(pair=pair)
        names = [titles[str(one[name].item())] for name in ("pair_first", "pair_second")]
        cells = [
            _crossing(one.sel(rank_way=way, field=field))
            for way in data["rank_way"].values
            for field in data["field"].values
        ]
        rows.append((*names, *cells))
    yield Table(
        name="equal-table",
        caption="Distances at which both are equally uncertain by the exact models, with twice the Monte Carlo "
        "standard error. How far readings of the sources move a crossover is a range of assumptions, and stands "
        "apart with the decision under every reading.",
        columns=(
            Column(title="First", weight=1),
            Column(title="Second", weight=1),
            *(
                Column(title=f"{'calibration alone' if way == 'calibration' else 'both'}, {field}", weight=1)
                for way in data["rank_way"].values
                for field in data["field"].values
            ),
        ),
        rows=tuple(rows),
    )


def _crossing(there: xr.Dataset) -> str:
    values, errors = there["equal_distance"].values, there["equal_distance_error"].values
    found = [
        f"{significant(float(v), 4)} ± {significant(2.0 * float(e), 1)}\N{NO-BREAK SPACE}m"
        for v, e in zip(values, errors, strict=True)
        if np.isfinite(v)
    ]
    return ", ".join(found) or "nowhere"


def describe_stability(tree: xr.DataTree) -> Iterator[Block]:
    """The inverse questions and their answers; nothing where none was asked."""
    if not has(tree, "decision", "stability_answer"):
        return
    rows = records(tree, "decision", "stability")
    yield Heading(text="What stability it takes", anchor="stability", level=2)
    yield Callout(
        title="Solved, not read off a chart",
        blocks=(
            Table(
                name="stability-table",
                caption="Which spread of one error gives the uncertainty asked for, all other errors as declared.",
                columns=(
                    Column(title="Question", weight=2),
                    Column(title="Answer", weight=2),
                    Column(title="Wanted", align="right"),
                    Column(title="As declared", align="right"),
                    Column(title="Without it", align="right"),
                ),
                rows=tuple(
                    (
                        str(row["stability_says"]),
                        str(row["stability_answer"]),
                        *(length(float(row[f"stability_{name}"])) for name in ("wanted", "as_declared", "without")),
                    )
                    for row in rows
                ),
            ),
        ),
    )
