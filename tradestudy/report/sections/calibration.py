"""Calibration errors: how sure each camera is, what drives that, whether the inferences converged, and the decision."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from tradestudy.report import facts
from tradestudy.report.document import (
    Block,
    Callout,
    Column,
    Heading,
    Paragraph,
    Picture,
    Table,
    Text,
    say,
)
from tradestudy.report.facts import distance, in_words, interval, length, share
from tradestudy.report.sections.posterior import posteriors
from tradestudy.units import significant

if TYPE_CHECKING:
    import xarray as xr

    from tradestudy.figures.drawing import Drawing

_FIELDS = {"axis": "on the axis", "edge": "at the edge of the field"}
_WAYS = {"noise": "per measurement", "calibration": "per rig and session", "both": "together"}
_CAUSES = {
    "nonfinite": "no number",
    "no_overlap": "not seen",
    "out_of_range": "no camera left",
}


def calibration(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write what a study found by drawing its calibration errors; nothing for a study that draws none."""
    if not facts.has(tree, "calibration", "depth_quantile"):
        return
    yield Heading(text="Calibration errors through the exact models", anchor="calibration")
    yield _how(tree)
    yield from posteriors(tree, drawings)
    yield Heading(text="What one reading is worth", anchor="calibration-depth", level=2)
    yield from _picture(drawings, "calibration-bands")
    yield _intervals(tree)
    yield _classes(tree)
    yield _moments(tree)
    yield from _picture(drawings, "failure-share")
    yield _failures(tree)
    yield Heading(text="Which method was good enough", anchor="calibration-tiers", level=2)
    yield _tiers(tree)
    if facts.has(tree, "sensitivity", "source_uncertainty"):
        yield Heading(text="What drives depth", anchor="sensitivity", level=2)
        yield from _picture(drawings, "tornado")
        yield from _picture(drawings, "sobol-indices")
        yield from _refusals(tree)
    if facts.has(tree, "decision", "rank_first"):
        yield Heading(text="Who errs less, with what probability", anchor="ranks", level=2)
        yield from _picture(drawings, "rank-probability")
        yield _ranks(tree)
        yield from _crossovers(tree)
    yield from _stability(tree)


def _picture(drawings: Mapping[str, Drawing], name: str) -> Iterator[Picture]:
    if name in drawings:
        yield Picture(name=name, caption=drawings[name].caption, alt=drawings[name].alt)


def _how(tree: xr.DataTree) -> Paragraph:
    data = facts.dataset(tree, "calibration")
    return Paragraph(
        say(
            "Every error is drawn from its distribution, correlated ones together, and every draw goes through the "
            "exact model of its camera: nothing is linearised. Points are scrambled Sobol sequences, eight of them "
            "independent; sampling stops where the quantiles are known to {accuracy} (t~0.975~ times their scatter "
            "from sequence to sequence), or after {budget} draws. The edge of the field lies {edge} of the way to the "
            "corner of the sensor. Where mean and standard deviation of depth do not exist none is given.",
            accuracy=share(float(data.attrs["accuracy"])),
            budget=f"{int(data.attrs['budget']):,}".replace(",", "\N{NO-BREAK SPACE}"),
            edge=share(float(data.attrs["edge"])),
        )
    )


def _places(tree: xr.DataTree) -> list[float]:
    """Computed distances nearest to the declared ones, each once."""
    grid = np.asarray(facts.dataset(tree, "calibration")["distance"].values, dtype=np.float64)
    nearest = [float(grid[np.argmin(np.abs(np.log(grid / place)))]) for place in facts.places(tree)]
    return list(dict.fromkeys(nearest))


def _titles(tree: xr.DataTree) -> dict[str, str]:
    titles = facts.titles(tree)
    return {str(key): titles[str(key)] for key in facts.dataset(tree, "calibration")["camera"].values}


def _intervals(tree: xr.DataTree) -> Table:
    data = facts.dataset(tree, "calibration").sel(way="both")
    rows: list[tuple[Text, ...]] = []
    for place in _places(tree):
        rows.append((f"At {distance(place)}",))
        for key, title in _titles(tree).items():
            for field, where in _FIELDS.items():
                there = data.sel(camera=key, field=field, distance=place)
                rows.append((title, where, *_interval_cells(there)))
    return Table(
        name="calibration-table",
        caption="Depth read at a true distance, one reading by one rig: quantiles first, moments where they exist.",
        columns=(
            Column(title="Camera", weight=1),
            Column(title="where"),
            Column(title="Median", align="right"),
            Column(title="Central 95 %", align="right"),
            Column(title="Shortest 95 %", align="right"),
            Column(title="u (68 %)", align="right"),
            Column(title="Bias", align="right"),
            Column(title="St. dev.", align="right"),
            Column(title="Linear u", align="right"),
        ),
        rows=tuple(rows),
        notes=(
            "u: half the central 68.27 % interval. —: the moment does not exist, or the point is not seen. ∞: no far "
            "end. Linear u in brackets where its 95 % interval fails JCGM 101, clause 8, at two digits.",
        ),
    )


def _interval_cells(there: xr.Dataset) -> tuple[Text, ...]:
    if str(there["status"].item()) == "unranked":
        return ("not seen", *[""] * 6)
    quantile = there["depth_quantile"].values
    low, high = (float(value) for value in there["shortest_interval"].values)
    linear = length(float(there["linear_uncertainty"]))
    valid = str(there["linear_verdict"].item()) == "valid"
    return (
        distance(float(quantile[2])),
        interval(float(quantile[0]), float(quantile[4])),
        "none bounded" if np.isinf(high) else interval(low, high),
        length(float(there["depth_uncertainty"])),
        _moment(float(there["bias"])),
        _moment(float(there["standard_deviation"])),
        linear if valid else f"({linear})",
    )


def _moment(value: float) -> str:
    return "—" if np.isnan(value) else length(value)


def _classes(tree: xr.DataTree) -> Table:
    """Noise, calibration and both at the declared distances, on the axis."""
    data = facts.dataset(tree, "calibration").sel(field="axis")
    places = _places(tree)
    return Table(
        name="class-table",
        caption="Depth uncertainty (half the central 68.27 % interval) on the axis, by how often an error is drawn "
        "anew: per measurement (averaging shrinks it), per rig and session (averaging never does), and together.",
        columns=(
            Column(title="Camera", weight=1),
            Column(title="drawn"),
            *(Column(title=distance(place), align="right") for place in places),
        ),
        rows=tuple(
            (
                title,
                words,
                *(
                    _moment(float(data["depth_uncertainty"].sel(camera=key, way=way, distance=place)))
                    for place in places
                ),
            )
            for key, title in _titles(tree).items()
            for way, words in _WAYS.items()
        ),
    )


def _moments(tree: xr.DataTree) -> Table:
    data = facts.dataset(tree, "calibration")["moments_end"]

    def words(value: float) -> str:
        return "nowhere" if np.isnan(value) else "beyond the range" if np.isinf(value) else distance(value)

    return Table(
        name="moments-table",
        caption="Up to where mean and standard deviation of depth exist: where infinity is six standard deviations of "
        "inverse depth away. Beyond, they would be set by how many draws happened to be taken.",
        columns=(
            Column(title="Camera", weight=1),
            *(
                Column(title=f"{words_of_way}, {where}", align="right")
                for words_of_way in _WAYS.values()
                for where in ("axis", "edge")
            ),
        ),
        rows=tuple(
            (
                title,
                *(
                    words(float(data.sel(camera=key, way=way, field=field)))
                    for way in _WAYS
                    for field in ("axis", "edge")
                ),
            )
            for key, title in _titles(tree).items()
        ),
    )


def _failures(tree: xr.DataTree) -> Table:
    data = facts.dataset(tree, "calibration").sel(way="both")
    rows: list[tuple[Text, ...]] = []
    for key, title in _titles(tree).items():
        for field, where in _FIELDS.items():
            one = data.sel(camera=key, field=field)
            failed = one["failed_fraction"].max("distance")
            infinite = float(np.nanmax(np.append(one["infinite_fraction"].values, 0.0)))
            rows.append((title, where, _small(infinite), *(_small(float(failed.sel(cause=c))) for c in _CAUSES)))
    return Table(
        name="failure-table",
        caption="Largest probability over the distances, noise and calibration: a reading at or beyond infinity, which "
        "stays in the quantiles, and no reading at all, by cause; the quantiles are conditional on there being one.",
        columns=(
            Column(title="Camera", weight=1),
            Column(title="where"),
            Column(title="beyond infinity", align="right"),
            *(Column(title=words, align="right") for words in _CAUSES.values()),
        ),
        rows=tuple(rows),
    )


def _small(value: float) -> str:
    return "0" if value == 0.0 else share(value)


def _tiers(tree: xr.DataTree) -> Table:
    data = facts.dataset(tree, "calibration").sel(way="both")
    rows: list[tuple[Text, ...]] = []
    for key, title in _titles(tree).items():
        one = data.sel(camera=key, field="axis")
        chosen = [str(name) for name in one["tier"].values if str(name)]
        rows.append(
            (
                title,
                *(
                    f"{_relative(float(one['tier_error'].sel({'method': method})))}, "
                    f"{_count(float(one['tier_evaluations'].sel({'method': method})))}, "
                    f"{_milliseconds(float(one['tier_seconds'].sel({'method': method})))}"
                    for method in data["method"].values
                ),
                ", ".join(f"{chosen.count(name)} × {name}" for name in dict.fromkeys(chosen)),
            )
        )
    return Table(
        name="tier-table",
        caption="The methods on the axis, noise and calibration: largest error of an end of the 95 % interval over the "
        "distance, evaluations of the model, and seconds, for all distances at once.",
        columns=(
            Column(title="Camera", weight=1),
            *(Column(title=in_words(str(method))) for method in data["method"].values),
            Column(title="Cheapest that does, by distances", weight=1),
        ),
        rows=tuple(rows),
        notes=(
            "The numbers of this section are those of the Sobol draws. The last column counts the distances at which "
            "each method would have been the cheapest with the accuracy asked for.",
        ),
    )


def _relative(value: float) -> str:
    return "—" if np.isnan(value) else share(value)


def _count(value: float) -> str:
    return f"{int(value):,}".replace(",", "\N{NO-BREAK SPACE}")


def _milliseconds(seconds: float) -> str:
    return f"{significant(1e3 * seconds, 2)}\N{NO-BREAK SPACE}ms"


def _refusals(tree: xr.DataTree) -> Iterator[Block]:
    """What was refused because it would mislead, with the reason."""
    data, titles = facts.dataset(tree, "sensitivity"), _titles(tree)
    for key, title in titles.items():
        reason = str(data["parameter_refused"].sel(camera=key).item())
        if reason:
            yield Paragraph(say("No tornado by parameter for {title}: {reason}.", title=title, reason=reason))
        why = {str(text) for text in data["index_refused"].sel(camera=key, field="axis").values if str(text)}
        if why:
            yield Paragraph(
                say("No Sobol indices for {title} at some distances: {why}.", title=title, why="; ".join(sorted(why))),
            )


def _ranks(tree: xr.DataTree) -> Table:
    data, titles = facts.dataset(tree, "decision"), facts.titles(tree)
    places = _places(tree)

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


def _crossovers(tree: xr.DataTree) -> Iterator[Block]:
    data, titles = facts.dataset(tree, "decision"), facts.titles(tree)
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


def _stability(tree: xr.DataTree) -> Iterator[Block]:
    if not facts.has(tree, "decision", "stability_answer"):
        return
    rows = facts.records(tree, "decision", "stability")
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
