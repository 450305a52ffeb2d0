"""What was computed: usable ranges, depth discrimination and uncertainty, their parts, the decision, swept designs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from tradestudy.report import facts
from tradestudy.report.document import Block, Column, Heading, Paragraph, Picture, Table, Text, say
from tradestudy.report.facts import distance, in_words, interval, length, quantity, share
from tradestudy.report.sections.registers import criteria
from tradestudy.units import significant

if TYPE_CHECKING:
    import xarray as xr

    from tradestudy.figures.drawing import Drawing

WAYS = {"noise": "noise only", "calibration": "calibration only", "both": "both"}


def results(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write the results, one part per question; parts without their group are left out."""
    if facts.has(tree, "depth"):
        yield Heading(text="Results", anchor="results")
        yield from _usable_range(tree)
        yield from _curves(tree, drawings)
        yield from _parts(drawings)
        yield from _decision(tree, drawings)
        yield from _sweeps(drawings)
        yield from criteria(tree)


def _pictures(drawings: Mapping[str, Drawing], *names: str) -> Iterator[Picture]:
    for name in names:
        if name in drawings:
            yield Picture(name=name, caption=drawings[name].caption, alt=drawings[name].alt)


def _usable_range(tree: xr.DataTree) -> Iterator[Block]:
    from tradestudy.figures.depth_data import nominal

    depth = nominal(tree)
    rows: list[tuple[Text, ...]] = []
    for key, title in facts.titles(tree).items():
        camera = depth.sel(camera=key)
        intervals = [
            (distance(float(near)), in_words(str(near_limit)), distance(float(far)), in_words(str(far_limit)))
            for near, far, near_limit, far_limit in zip(
                camera["usable_near"].values,
                camera["usable_far"].values,
                camera["near_limit"].values,
                camera["far_limit"].values,
                strict=True,
            )
            if np.isfinite(near) and not np.isnan(far)
        ]
        rows += [(title, *interval) for interval in intervals] or [(title, "nowhere", "", "", "")]
    yield Heading(text="Where each camera is usable", anchor="usable-range", level=2)
    yield Table(
        name="usable-range-table",
        caption="Usable distances, and the limit that sets each end.",
        columns=(
            Column(title="Camera", weight=3),
            Column(title="From", align="right"),
            Column(title="set by", weight=2),
            Column(title="To", align="right"),
            Column(title="set by", weight=2),
        ),
        rows=tuple(rows),
        notes=("An end without a limit is the end of the distances that were computed.",),
    )


def _curves(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    yield Heading(text="Depth discrimination and uncertainty", anchor="depth", level=2)
    yield from _pictures(drawings, "close-range", "mid-range")
    yield _values_at_places(tree)


def _values_at_places(tree: xr.DataTree) -> Table:
    """Numbers behind the curves at the declared distances."""
    from tradestudy.figures.depth_data import nominal

    depth = nominal(tree)
    rows: list[tuple[Text, ...]] = []
    for place in facts.places(tree):
        there = depth.sel(distance=place, method="nearest")
        rows.append((f"At {distance(float(place))}",))
        for key, title in facts.titles(tree).items():
            camera = there.sel(camera=key)
            sigma = {way: float(camera["depth_uncertainty_way"].sel(way=way)) for way in WAYS}
            nearer, farther = (float(camera["depth_discrimination"].sel(side=side)) for side in ("nearer", "farther"))
            low, high = (float(camera["depth_quantile"].sel(way="both", quantile=q)) for q in (0.025, 0.975))
            rows.append(
                (
                    title,
                    "yes" if bool(camera["usable"]) else "no",
                    length(nearer) if length(nearer) == length(farther) else f"{length(nearer)} / {length(farther)}",
                    *(length(sigma[way]) for way in WAYS),
                    share(sigma["both"] / float(place)),
                    interval(low, high),
                )
            )
    return Table(
        name="depth-table",
        caption="Depth discrimination and uncertainty at the declared distances.",
        columns=(
            Column(title="Camera", weight=1),
            Column(title="Usable"),
            Column(title="Discrim­ination", align="right"),
            *(Column(title=f"σ {title}", align="right") for title in WAYS.values()),
            Column(title="relative", align="right"),
            Column(title="95 % interval", align="right"),
        ),
        rows=tuple(rows),
        notes=(
            "Discrimination: the change of depth per declared step of disparity (nearer / farther where they "
            "differ). σ: half the central 68.27 % interval of one measurement, for noise only, calibration only, "
            "and both. ∞: the interval has no far end.",
        ),
    )


def _parts(drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    if "uncertainty-parts" in drawings:
        yield Heading(text="What the uncertainty is made of", anchor="parts", level=2)
        yield from _pictures(drawings, "uncertainty-parts")


def _decision(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """The verdict under every reading, the crossovers, and the inverse questions."""
    if not facts.has(tree, "decision", "decision_winner", "decision_ratio", "reading_says"):
        return
    decision, titles = facts.dataset(tree, "decision"), facts.titles(tree) | {"": "none usable"}
    both = decision.sel(way="both")
    yield Heading(text="The decision under every reading", anchor="decision", level=2)
    yield Paragraph(
        "The sources leave questions open. Each reading below answers one of them differently from the study's own "
        "(the first row); everything else stays."
    )
    yield from _pictures(drawings, "readings")
    place_columns = tuple(
        column
        for place in decision["place"].values
        for column in (
            Column(title=f"Best at {distance(float(place))}", weight=2),
            Column(title="ratio", align="right"),
        )
    )
    rows: list[tuple[Text, ...]] = []
    for reading in decision["reading"].values:
        cells: list[Text] = []
        for place in decision["place"].values:
            at = both.sel(reading=reading, place=place)
            winner = titles[str(at["decision_winner"].item())]
            cells += [
                say("**{w}**", w=winner) if bool(at["decision_flips"]) else winner,
                _ratio(float(at["decision_ratio"])),
            ]
        rows.append(
            (
                say("{name}: {says}", name=str(reading), says=str(both["reading_says"].sel(reading=reading).item())),
                *cells,
            )
        )
    ratio = decision["decision_ratio"].attrs
    yield Table(
        name="reading-table",
        caption="The camera with the smallest uncertainty (noise and calibration) under every reading; bold where "
        "it differs from the first row.",
        columns=(Column(title="Reading", weight=4), *place_columns),
        rows=tuple(rows),
        notes=(f"Ratio: uncertainty of {ratio['numerator']} over that of {ratio['denominator']}.",),
    )
    yield from _crossovers(decision)
    yield from _solved(tree)


def _ratio(value: float) -> str:
    return "—" if np.isnan(value) else "∞" if np.isinf(value) else significant(value)


def _crossovers(decision: xr.Dataset) -> Iterator[Block]:
    if "crossover_distance" not in decision:
        return
    values = np.asarray(decision["crossover_distance"].values, dtype=float)
    finite = values[np.isfinite(values)]
    if finite.size:
        own = [distance(float(v)) for v in values[0] if np.isfinite(v)]
        yield Paragraph(
            say(
                "In the study's own reading the better family changes at {own}. Over all readings the crossovers "
                "lie between {low} and {high}; this is a range of assumptions, not a confidence interval.",
                own=" and ".join(own) or "no distance",
                low=distance(float(finite.min())),
                high=distance(float(finite.max())),
            )
        )


def _solved(tree: xr.DataTree) -> Iterator[Block]:
    if not facts.has(tree, "decision", "solved_value", "solved_unit", "solved_says"):
        return
    rows = facts.records(tree, "decision", "question")
    yield Table(
        name="solved-table",
        caption="Questions turned round: which value would change the verdict.",
        columns=(Column(title="Question", weight=3), Column(title="Answer", align="right")),
        rows=tuple((str(r["solved_says"]), quantity(float(r["solved_value"]), str(r["solved_unit"]))) for r in rows),
    )


def _sweeps(drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    pictures = tuple(_pictures(drawings, "sweep-map", "pareto"))
    if pictures:
        yield Heading(text="Swept designs", anchor="sweeps", level=2)
        yield from pictures
