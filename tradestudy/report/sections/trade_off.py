"""The weights of the criteria that favour each camera, and what knowing each assumption is worth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Block, Column, Heading, Paragraph, Table, pictures_of, say
from tradestudy.report.words import share, with_error
from tradestudy.results.views.conclusions import worths
from tradestudy.results.views.groups import camera_titles, group, has
from tradestudy.results.views.trade_off import (
    candidates_by_rank,
    pareto_front,
    scale_words,
    trade_off_conclusion,
    weight_words,
)
from tradestudy.units import FRACTION
from tradestudy.wording import distance

_MOST_ROWS = 10


def describe_trade_off(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Say which camera ranks first, list the candidates and, for sweeps, the designs on the Pareto front."""
    candidates = candidates_by_rank(tree)
    if not candidates:
        return
    data = group(tree, "criteria")
    yield Heading(text="Trade-off of the criteria", anchor="trade-off")
    yield Paragraph(say("**{conclusion}.**", conclusion=trade_off_conclusion(tree)))
    clipped, outside = (
        bool((data["clipped"].values > 0.0).any()),
        not all(candidate.is_feasible for candidate in candidates),
    )
    yield Table(
        name="trade-off-table",
        caption="How often each candidate ranks first: the fraction of the possible weights that rank it first, with "
        f"its standard error, and the mean of these weights. Limits of the weights: {weight_words(tree)}."
        + (f" The first {_MOST_ROWS} of {len(candidates)}." if len(candidates) > _MOST_ROWS else ""),
        columns=(
            Column(title="Camera", weight=3),
            *(Column(title=str(criterion), align="right") for criterion in data["weighed"].values),
            Column(title="Ranks first", align="right"),
            Column(title="Mean of these weights", weight=3),
        ),
        rows=tuple(
            (
                candidate.title + ("" if candidate.is_feasible else " †"),
                *candidate.values,
                with_error(candidate.ranks[0], candidate.first_error, FRACTION, negligible=0.0),
                candidate.central,
            )
            for candidate in candidates[:_MOST_ROWS]
        ),
        notes=(
            f"Each criterion scores from 0 at its worst to 1 at its best value: {scale_words(tree)}. The weighted sum "
            "of the scores ranks the candidates.",
            *(("*: beyond the declared worst or best value, and scored as that value.",) if clipped else ()),
            *(("†: does not meet every requirement that must hold.",) if outside else ()),
        ),
    )
    yield from pictures_of(drawings, "rank_acceptability")
    yield from _front(tree)


def _front(tree: xr.DataTree) -> Iterator[Block]:
    front = pareto_front(tree, _MOST_ROWS)
    if front is None:
        return
    if not front.designs:
        yield Paragraph("No design of the sweep meets every requirement that must hold.")
        return
    only_best = f" The {_MOST_ROWS} of {front.count} that score highest at the mean of the weights."
    yield Table(
        name="pareto-front",
        caption="Pareto-optimal designs: they meet every requirement that must hold, and no other such design is at "
        "least as good in every criterion and better in one." + (only_best if front.count > _MOST_ROWS else ""),
        columns=(
            *(Column(title=parameter, align="right") for parameter in front.swept),
            Column(title="Camera", weight=2),
            *(Column(title=str(criterion), align="right") for criterion in group(tree, "criteria")["weighed"].values),
        ),
        rows=tuple((*design.swept, design.title, *design.values) for design in front.designs),
    )


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
            whole=with_error(float(data.attrs["worth_of_all"]), float(data.attrs["worth_of_all_error"]), FRACTION, 0.0),
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
        rows=tuple(
            (
                assumption.says,
                assumption.between,
                with_error(assumption.worth, assumption.error, FRACTION, negligible=0.0),
            )
            for assumption in ranked[:_MOST_ROWS]
        ),
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
                titles[str(candidate)],
                *(
                    share(float(fraction), digits=2)
                    for fraction in data["best_probability"].sel(candidate=candidate).values
                ),
                share(float(data["best_overall"].sel(candidate=candidate)), digits=2),
            )
            for candidate in data["candidate"].values
        ),
    )
