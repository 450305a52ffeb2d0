"""Calibration errors: how sure each camera is, what drives that, whether the inferences converged, and the decision."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import (
    Block,
    Column,
    Heading,
    Paragraph,
    Table,
    Text,
    pictures_of,
    say,
)
from tradestudy.report.sections.posterior import describe_posteriors
from tradestudy.report.sections.uncertain_decision import (
    computed_places,
    describe_crossovers,
    describe_ranks,
    describe_stability,
    describe_verdict,
)
from tradestudy.report.words import in_words, interval, length, or_dash, share
from tradestudy.results.views.groups import group, has, titles_in
from tradestudy.units import significant
from tradestudy.wording import distance

_FIELDS = {"axis": "on the axis", "edge": "at the edge of the field"}
_WAYS = {"noise": "per measurement", "calibration": "per rig and session", "both": "together"}
_CAUSES = {
    "nonfinite": "no number",
    "no_overlap": "not seen",
    "out_of_range": "no camera left",
}


def describe_calibration(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write what a study found by drawing its calibration errors; nothing for a study that draws none."""
    if not has(tree, "calibration", "depth_quantile"):
        return
    yield Heading(text="Calibration errors through the exact models", anchor="calibration")
    yield from describe_verdict(tree)
    yield _how(tree)
    yield from describe_posteriors(tree, drawings)
    yield Heading(text="What one reading is worth", anchor="calibration-depth", level=2)
    yield from pictures_of(drawings, "calibration-bands")
    yield _intervals(tree)
    yield _classes(tree)
    yield _moments(tree)
    yield from pictures_of(drawings, "failure-share")
    yield _failures(tree)
    yield Heading(text="Which method was good enough", anchor="calibration-tiers", level=2)
    yield _tiers(tree)
    if has(tree, "sensitivity", "source_uncertainty"):
        yield Heading(text="What drives depth", anchor="sensitivity", level=2)
        yield from pictures_of(drawings, "tornado", "sobol-indices")
        yield from _refusals(tree)
    if has(tree, "decision", "rank_first"):
        yield Heading(text="Who errs less, with what probability", anchor="ranks", level=2)
        yield from pictures_of(drawings, "rank-probability")
        yield describe_ranks(tree)
        yield from describe_crossovers(tree)
    yield from describe_stability(tree)


def _how(tree: xr.DataTree) -> Paragraph:
    data = group(tree, "calibration")
    return Paragraph(
        say(
            "Every error is drawn from its distribution, correlated ones together, and every draw goes through the "
            "exact model of its camera: nothing is linearised. Points are scrambled Sobol sequences, eight of them "
            "independent; sampling stops where the quantiles are known to {accuracy} (t~0.975~ times their scatter "
            "from sequence to sequence), or after {budget} draws. The edge of the field lies {edge} of the way to the "
            "corner of the sensor. Where mean and standard deviation of depth do not exist none is given.",
            accuracy=share(float(data.attrs["accuracy"])),
            budget=_count(float(data.attrs["budget"])),
            edge=share(float(data.attrs["edge"])),
        )
    )


def _intervals(tree: xr.DataTree) -> Table:
    """One stretch of rows per camera and place in the field; distances that it does not see are left out."""
    data = group(tree, "calibration").sel(way="both")
    rows: list[tuple[Text, ...]] = []
    for key, title in titles_in(tree, "calibration").items():
        for field, where in _FIELDS.items():
            one = data.sel(camera=key, field=field)
            seen = [
                place for place in computed_places(tree) if str(one["status"].sel(distance=place).item()) != "unranked"
            ]
            rows.append((f"{title}, {where}" + ("" if seen else ": sees none of these distances"),))
            rows += [(distance(place), *_interval_cells(one.sel(distance=place))) for place in seen]
    return Table(
        name="calibration-table",
        caption="Depth read at a true distance, one reading by one rig: quantiles first, moments where they exist.",
        columns=(
            Column(title="True distance", align="right"),
            Column(title="Median", align="right", weight=1),
            Column(title="Central 95 %", align="right", weight=2),
            Column(title="Shortest 95 %", align="right", weight=2),
            Column(title="u (68 %)", align="right", weight=1),
            Column(title="Bias", align="right", weight=1),
            Column(title="St. dev.", align="right", weight=1),
            Column(title="Linear u", align="right", weight=1),
        ),
        rows=tuple(rows),
        notes=(
            "u: half the central 68.27 % interval. —: the moment does not exist. ∞: no far end. *: the quantiles did "
            "not reach the accuracy asked for within the budget. Linear u stands in brackets unless its 95 % interval "
            "passes JCGM 101, clause 8, at two digits. Distances at which the camera does not see the point are left "
            "out.",
        ),
    )


def _interval_cells(there: xr.Dataset) -> tuple[Text, ...]:
    quantile = there["depth_quantile"].values
    low, high = (float(value) for value in there["shortest_interval"].values)
    linear = length(float(there["linear_uncertainty"]))
    valid = str(there["linear_verdict"].item()) == "valid"
    return (
        distance(float(quantile[2])),
        interval(float(quantile[0]), float(quantile[4])) + ("" if str(there["status"].item()) == "converged" else " *"),
        "none bounded" if np.isinf(high) else interval(low, high),
        length(float(there["depth_uncertainty"])),
        or_dash(float(there["bias"]), length),
        or_dash(float(there["standard_deviation"]), length),
        linear if valid else f"({linear})",
    )


def _classes(tree: xr.DataTree) -> Table:
    """Noise, calibration and both at the declared distances, on the axis."""
    data = group(tree, "calibration").sel(field="axis")
    places = computed_places(tree)
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
                    or_dash(float(data["depth_uncertainty"].sel(camera=key, way=way, distance=place)), length)
                    for place in places
                ),
            )
            for key, title in titles_in(tree, "calibration").items()
            for way, words in _WAYS.items()
        ),
    )


def _moments(tree: xr.DataTree) -> Table:
    every = group(tree, "calibration")
    data, last = every["moments_end"], float(every["distance"].values[-1])

    def words(value: float) -> str:
        return "nowhere" if np.isnan(value) else f"> {distance(last)}" if np.isinf(value) else distance(value)

    return Table(
        name="moments-table",
        caption="Up to where mean and standard deviation of depth exist: where infinity is six standard deviations of "
        "inverse depth away. Beyond, they would be set by how many draws happened to be taken.",
        columns=(
            Column(title="Camera", weight=2),
            *(Column(title=f"{way}, {where}", align="right", weight=1) for way in _WAYS for where in ("axis", "edge")),
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
            for key, title in titles_in(tree, "calibration").items()
        ),
    )


def _failures(tree: xr.DataTree) -> Table:
    data = group(tree, "calibration").sel(way="both")
    rows: list[tuple[Text, ...]] = []
    for key, title in titles_in(tree, "calibration").items():
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
    data = group(tree, "calibration").sel(way="both")
    rows: list[tuple[Text, ...]] = []
    for key, title in titles_in(tree, "calibration").items():
        one = data.sel(camera=key, field="axis")
        chosen = [str(name) for name in one["tier"].values if str(name)]
        rows.append(
            (
                title,
                *(
                    f"{or_dash(float(there['tier_error']), share)}, {_count(float(there['tier_evaluations']))}, "
                    f"{significant(1e3 * float(there['tier_seconds']), 2)}\N{NO-BREAK SPACE}ms"
                    for there in (one.sel({"method": method}) for method in data["method"].values)
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


def _count(value: float) -> str:
    return f"{int(value):,}".replace(",", "\N{NO-BREAK SPACE}")


def _refusals(tree: xr.DataTree) -> Iterator[Block]:
    """What was refused because it would mislead, with the reason."""
    data, rows = group(tree, "sensitivity"), []
    status = group(tree, "calibration")["status"].sel(way="both", field="axis")
    for key, title in titles_in(tree, "calibration").items():
        reason = str(data["parameter_refused"].sel(camera=key).item())
        if reason:
            rows.append((title, "tornado by parameter", reason))
        seen = status.sel(camera=key).values != "unranked"
        why = sorted({str(text) for text in data["index_refused"].sel(camera=key, field="axis").values[seen]} - {""})
        if why:
            rows.append((title, "Sobol indices at some distances", "; ".join(why)))
    if rows:
        yield Table(
            name="refused-table",
            caption="What was refused because it would mislead.",
            columns=(Column(title="Camera", weight=1), Column(title="What", weight=1), Column(title="Why", weight=4)),
            rows=tuple(rows),
        )
