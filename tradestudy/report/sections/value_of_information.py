"""What to measure next: how much knowing each assumption improves the choice of a camera."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Block, Column, Heading, Paragraph, Table, pictures_of, say
from tradestudy.report.words import plus_minus, share
from tradestudy.results.views.conclusions import worths
from tradestudy.results.views.groups import camera_titles, group, has
from tradestudy.units import FRACTION
from tradestudy.wording import distance

_MOST_ROWS = 10


def describe_value_of_information(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Rank the assumptions by the worth of knowing them, and list how often each camera is best."""
    if not has(tree, "value_of_information", "worth"):
        return
    data, titles = group(tree, "value_of_information"), camera_titles(tree)
    yield Heading(text="What to measure next", anchor="value-of-information")
    yield Paragraph(
        say(
            "In each of {draws} combinations every assumption takes a value from its range. The best camera has the "
            "lowest relative depth uncertainty, averaged over {places}; a distance at which it is not "
            "usable counts {unusable}. Knowing an assumption before choosing a camera lowers that average by the "
            "worth of the assumption. Knowing all of them is worth {whole}.",
            draws=str(int(data.attrs["draws"])),
            places=", ".join(distance(float(place)) for place in data["place"].values),
            unusable=share(float(data.attrs["unusable"])),
            whole=plus_minus(float(data.attrs["worth_of_all"]), float(data.attrs["worth_of_all_error"]), FRACTION),
        )
    )
    ranked = worths(tree)
    yield Table(
        name="assumption-worths",
        caption="Worth of knowing each assumption, with its standard error; the bias from the maximum over "
        "cameras is subtracted." + (f" The first {_MOST_ROWS} of {len(ranked)}." if len(ranked) > _MOST_ROWS else ""),
        columns=(
            Column(title="Assumption", weight=4),
            Column(title="Range", weight=3),
            Column(title="Worth", align="right"),
        ),
        rows=tuple((one.says, one.between, plus_minus(one.worth, one.error, FRACTION)) for one in ranked[:_MOST_ROWS]),
    )
    yield from pictures_of(drawings, "assumption_worths")
    yield Table(
        name="best-probability",
        caption="Fraction of the combinations in which each candidate is usable and has the lowest depth uncertainty.",
        columns=(
            Column(title="Camera", weight=3),
            *(Column(title=f"At {distance(float(place))}", align="right") for place in data["place"].values),
            Column(title="Overall", align="right"),
        ),
        rows=tuple(
            (
                titles[str(name)],
                *(share(float(one), digits=2) for one in data["best_probability"].sel(candidate=name).values),
                share(float(data["best_overall"].sel(candidate=name)), digits=2),
            )
            for name in data["candidate"].values
        ),
    )
    if data.sizes.get("requirement", 0):
        says = group(tree, "requirements")["says"]
        yield Table(
            name="requirement-probability",
            caption="Fraction of the combinations in which each requirement is met at all its distances at once.",
            columns=(Column(title="Requirement", weight=4), Column(title="Probability", align="right")),
            rows=tuple(
                (
                    str(says.sel(requirement=name).item()),
                    share(float(data["requirement_probability"].sel(requirement=name)), digits=2),
                )
                for name in data["requirement"].values
            ),
        )
