"""The probability that one of two cameras errs less than the other."""

from __future__ import annotations

from collections.abc import Iterator

import xarray as xr

from tradestudy.report.document import Block, Column, Paragraph, Table, Text, say
from tradestudy.report.words import share
from tradestudy.results.views.depth import table_distances
from tradestudy.results.views.groups import camera_titles, group
from tradestudy.wording import distance, with_article


def describe_ranks(tree: xr.DataTree) -> Iterator[Block]:
    """Say how likely the first camera of the main pair errs less, for a rig and a measurement; then list all pairs."""
    decision, titles, places = group(tree, "decision"), camera_titles(tree), table_distances(tree)
    pair = decision.isel(pair=0)
    first, second = (with_article(titles[str(pair[name].item())]) for name in ("pair_first", "pair_second"))

    def between(error_source: str) -> str:
        there = (
            pair["rank_first"].sel(rank_error_source=error_source).sel(rank_distance=places, method="nearest").values
        )
        low, high = share(float(there.min())), share(float(there.max()))
        return low if low == high else f"{low} to {high}"

    yield Paragraph(
        say(
            "From {near} to {far}, the probability that a given unit of **{first}** has a smaller depth error than a "
            "given unit of {second} is **{rig}** if all noise is averaged out, and **{reading}** in a single "
            "measurement.",
            first=first,
            second=second,
            rig=between("calibration"),
            reading=between("both"),
            near=distance(float(places.min())),
            far=distance(float(places.max())),
        )
    )
    yield _rank_table(tree)


def _rank_table(tree: xr.DataTree) -> Table:
    """List the probabilities of the ranks of every pair at the declared distances."""
    data, titles = group(tree, "decision"), camera_titles(tree)
    places = [float(place) for place in table_distances(tree)]

    def cell(there: xr.Dataset, place: float) -> str:
        at = there.sel(rank_distance=place, method="nearest")
        first, error = float(at["rank_first"]), 2.0 * float(at["rank_first_error"])
        if first + float(at["rank_second"]) == 0.0:
            return "—"
        return f"{100 * first:.1f} ± {100 * error:.1f}\N{NO-BREAK SPACE}%"

    rows: list[tuple[Text, ...]] = []
    for error_source in data["rank_error_source"].values:
        rows.append(
            ("Calibration alone" if error_source == "calibration" else "Single measurements, noise and calibration",)
        )
        for pair in data["pair"].values:
            there = data.sel(pair=pair, rank_error_source=error_source)
            names = [titles[str(there[name].item())] for name in ("pair_first", "pair_second")]
            rows.append((*names, *(cell(there, place) for place in places)))
    return Table(
        name="rank-table",
        caption="Probability that the depth error of the first camera is smaller than that of the second; ± twice the "
        "standard error of this probability. A camera that does not see the point loses.",
        columns=(
            Column(title="First", weight=1),
            Column(title="Second", weight=1),
            *(Column(title=distance(place), align="right") for place in places),
        ),
        rows=tuple(rows),
    )
