"""The numbers behind the curves of depth, data sheets, and the decision under every reading."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Block, Bullets, Column, Heading, Paragraph, Table, Text, pictures_of, say
from tradestudy.report.words import distance_with_error, interval, length, or_dash, percent, share, with_error
from tradestudy.results import judged_uncertainty
from tradestudy.results.views.decision import readings_in_words
from tradestudy.results.views.depth import (
    declared_matchers,
    false_matches_declared,
    nominal,
    table_depth,
    table_distances,
)
from tradestudy.results.views.finding import detailed_cameras
from tradestudy.results.views.groups import camera_titles, depth_methods, group, has, titles_in
from tradestudy.units import ANGLE, pretty, significant
from tradestudy.wording import counted, distance, span, with_article, within

_LOCKING: Final = " Declared pixel locking is not temporal noise: it is the same in every repeated measurement."


def describe_datasheet(tree: xr.DataTree) -> Iterator[Block]:
    """Define the values, then write one table per camera."""
    if not has(tree, "datasheet", "z_accuracy"):
        return
    data, shown = group(tree, "datasheet"), detailed_cameras(tree, "datasheet")
    yield Heading(text="Data sheets", anchor="datasheets")
    yield Paragraph(
        say(
            "Values hold on the axis, for the declared scene and cameras; they follow no published test standard. "
            "Values in brackets are relative to the distance. *Z accuracy*: half the width of the central 68.27 % "
            "interval from calibration errors alone, which remain after averaging many pictures. "
            "*Temporal noise*: the same from noise alone. *Sub-pixel RMS*: standard deviation of one measured "
            "disparity. *Plane-fit RMS*: scatter about a plane fitted to a flat target, taken as the temporal "
            "noise; how calibration errors bend the plane is left out. *Fill rate*: the fraction of the picture seen "
            "by both cameras of a rig, or by enough microlenses, times the fraction of measurements that do not fail; "
            "0 where the camera is unusable. *Field*: width and height of the area that one camera sees.{locking}",
            locking=_LOCKING if declared_matchers(tree) else "",
        )
    )
    places = [float(place) for place in data["sheet_distance"].values]
    for key, title in shown.items():
        sheet = data.sel(camera=key)
        near, far = (float(sheet[limit]) for limit in ("near_limit", "far_limit"))
        usable = "usable nowhere" if math.isnan(near) else f"usable from {span(*within(near, far))}"
        across, down = (pretty(float(sheet[f"{axis}_field_of_view"]), ANGLE) for axis in ("horizontal", "vertical"))
        yield Table(
            name=f"datasheet-{key}",
            caption=f"{title}: {usable}; field of view at its focus setting, {across} × {down}.",
            columns=(
                Column(title="Value", weight=3),
                *(Column(title=f"At {distance(place)}", align="right", weight=2) for place in places),
            ),
            rows=(*_working(tree, key, places), *_rows(sheet)),
        )
    if further := data.sizes["camera"] - len(shown):
        where = "`tables/datasheet_by_camera.csv` and `tables/datasheet_by_camera_sheet_distance.csv`"
        yield Paragraph(say(f"The data sheets of {counted(further, 'further camera')} are in {where}."))


def _working(tree: xr.DataTree, key: str, places: Sequence[float]) -> Iterator[tuple[Text, ...]]:
    """The distances as counted from the front of the housing, if it is declared."""
    front = float(group(tree, "cameras")["front"].sel(camera=key)) if has(tree, "cameras", "front") else math.nan
    if math.isfinite(front):
        yield "Working distance, from the front", *(distance(place - front) for place in places)


def _rows(sheet: xr.Dataset) -> Iterator[tuple[Text, ...]]:
    yield "Z accuracy", *_lengths(sheet, "z_accuracy")
    yield "Temporal noise", *_lengths(sheet, "temporal_noise")
    yield "Sub-pixel RMS [px]", *(or_dash(float(v), lambda x: significant(x, 2)) for v in sheet["subpixel_rms"].values)
    yield "Plane-fit RMS", *_lengths(sheet, "plane_fit_rms")
    yield "Fill rate", *(share(float(value)) for value in sheet["fill_rate"].values)
    yield (
        "Field",
        *(
            f"{length(float(w))} × {length(float(h))}"
            for w, h in zip(sheet["field_width"].values, sheet["field_height"].values, strict=True)
        ),
    )


def _lengths(sheet: xr.Dataset, variable: str) -> Iterator[str]:
    for value, place in zip(sheet[variable].values, sheet["sheet_distance"].values, strict=True):
        if math.isfinite(float(value)):
            yield f"{length(float(value))} ({percent(float(value / place))})"
        else:
            yield "—" if math.isnan(float(value)) else "unbounded"


_NEGLIGIBLE_SHARE = 1e-6  # what the numerical error of a share amounts to
_ERROR_SOURCES = ("noise", "calibration", "both")


def list_depths(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write tables of discrimination, uncertainty, its largest part, equivalent baselines and failed measurements."""
    if has(tree, "depth"):
        declared = "place" in tree["decision"].coords if has(tree, "decision") else False
        yield Heading(text=f"Depth at {'the declared' if declared else 'selected'} distances", anchor="depth-numbers")
        yield _values_at_places(tree)
        yield from _over_places(tree)
        yield from pictures_of(drawings, "close_range", "mid_range")


def _values_at_places(tree: xr.DataTree) -> Table:
    """List the numbers behind the curves at the declared distances."""
    depth = table_depth(tree)
    rows: list[tuple[Text, ...]] = []
    quantiles = depth["quantile"].values
    content = share(float(quantiles[-1] - quantiles[0]))
    u = depth["depth_uncertainty_by_error_source"].sel(error_source=list(_ERROR_SOURCES))
    u_error = depth["depth_uncertainty_by_error_source_error"].sel(error_source=list(_ERROR_SOURCES))
    radius, radius_error = depth["depth_error_radius"], depth["depth_error_radius_error"]
    step = depth["depth_discrimination"].sel(side=["nearer", "farther"])
    ends = depth["depth_quantile"].sel(error_source="both").isel(quantile=[0, -1])
    shown_columns = (
        u,
        u_error,
        radius,
        radius_error,
        step,
        ends,
        judged_uncertainty(depth),
        depth["usable"],
        depth["converged"],
    )
    titles, places = titles_in(tree, "depth"), table_distances(tree)
    listed = [column.sel(distance=places, method="nearest").sel(camera=list(titles)) for column in shown_columns]
    at_places = [column.transpose("distance", "camera", ...).values.tolist() for column in listed]
    for place, *columns in zip(places, *at_places, strict=True):
        rows.append((f"At {distance(float(place))}",))
        for title, u_here, u_error_here, r, r_error, steps, (low, high), judged, usable, converged in zip(
            titles.values(), *columns, strict=True
        ):
            rows.append(
                (
                    title,
                    "yes" if usable else "no",
                    _step(*steps),
                    *map(with_error, u_here, u_error_here),
                    with_error(r, r_error),
                    share(judged / float(place)),
                    interval(low, high) + ("" if converged else " *"),
                )
            )
    shown = "".join(str(cell) for row in rows for cell in row)
    return Table(
        name="depth-table",
        caption="Depth discrimination and uncertainty.",
        columns=(
            Column(title="Camera", weight=1),
            Column(title="Usable"),
            Column(title="Discrim­ination", align="right"),
            *(Column(title=f"u {error_source}", align="right") for error_source in _ERROR_SOURCES),
            Column(title="r", align="right"),
            Column(title="Relative", align="right"),
            Column(title=f"{content} interval", align="right"),
        ),
        rows=tuple(rows),
        notes=(
            "Discrimination: the change of depth per declared step of disparity (nearer / farther where they "
            "differ). u: depth uncertainty, half the width of the interval that contains the central 68.27 % of single "
            "measurements, for noise only, calibration errors only, and both"
            + "; ± its error, where that exceeds 1 %"
            * ("±" in shown)
            + ". r: error radius, within which 68.27 % of all measurements lie about the true distance, failed ones "
            "counted as infinitely wrong. Relative: the larger of u both and r, by which cameras are judged, divided "
            f"by the distance. {content} interval: central {content} of single "
            "measurements."
            + " ∞: the interval has no far end." * ("∞" in shown)
            + " *: not converged; the sampling error exceeds the tolerance." * ("*" in shown)
            + _numerical_error(tree),
        ),
    )


def _numerical_error(tree: xr.DataTree) -> str:
    """Say how far the computed uncertainty may be from that of the exact model, where cameras are usable."""
    depth = nominal(tree)
    relative = (depth["depth_uncertainty_error"] / depth["depth_uncertainty"]).where(depth["usable"])
    values = relative.values[np.isfinite(relative.values)]
    return (
        f" Numerical error of u both, at all usable distances: at most {share(float(values.max()))}."
        if values.size
        else ""
    )


def _over_places(tree: xr.DataTree) -> Iterator[Table]:
    """List equivalent baselines and failed measurements, with one column per declared distance."""
    depth, places = table_depth(tree), table_distances(tree)

    def table(
        name: str, variable: str, caption: str, write: Callable[[float], str], notes: tuple[Text, ...] = ()
    ) -> Table:
        data = depth[variable].sel(error_source="both") if "error_source" in depth[variable].dims else depth[variable]
        data = data.sel(distance=places, method="nearest")
        return Table(
            name=name,
            caption=caption,
            columns=(
                Column(title="Camera", weight=1),
                *(Column(title=distance(float(place)), align="right") for place in places),
            ),
            rows=tuple(
                (title, *map(write, data.sel(camera=key).values.tolist()))
                for key, title in titles_in(tree, "depth").items()
            ),
            notes=notes,
        )

    if "equivalent_baseline" in depth:
        yield table(
            "baseline-table",
            "equivalent_baseline",
            "Equivalent baseline: the baseline of a stereo rig with the camera's focal length, pixel pitch and "
            "disparity error and the same u noise.",
            length,
            _baseline_note(tree, depth),
        )
    yield table(
        "failed-table",
        "failed_fraction",
        "Fraction of measurements that noise and calibration errors move beyond infinity"
        f"{', or that are false matches' * false_matches_declared(tree)}.",
        lambda value: "< 1 ppm" if value < _NEGLIGIBLE_SHARE else or_dash(value, share),
    )


def _baseline_note(tree: xr.DataTree, depth: xr.Dataset) -> tuple[Text, ...]:
    """Say why the equivalent baseline of a rig differs from its own, if it does."""
    notes: dict[str, None] = {}
    for key, method in depth_methods(tree).items():
        if note := method["baseline_note"]:
            values = depth["equivalent_baseline"].sel(camera=key)
            spread = values.max("distance") - values.min("distance")
            if bool((spread > _NEGLIGIBLE_SHARE * values.max("distance")).any()):
                notes[note] = None
    return tuple(say(note) for note in notes)


def _step(nearer: float, farther: float) -> str:
    """Write the steps nearer and farther, as one number if three digits do not distinguish them."""
    near, far = length(nearer), length(farther)
    if near == far:
        return near
    (number, _, unit), (_, _, other) = near.partition("\N{NO-BREAK SPACE}"), far.partition("\N{NO-BREAK SPACE}")
    return f"{number} / {far}" if unit == other else f"{near} / {far}"


def describe_decision(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write the verdict on the main pair under every reading, and where the two are equally uncertain."""
    if not has(tree, "decision", "uncertainty_ratio", "certainty_flips", "reading_says"):
        return
    decision, titles = group(tree, "decision"), camera_titles(tree)
    pair = {end: with_article(titles[decision.attrs[end]]) for end in ("first", "second")}
    others, says = decision.sizes["reading"] > 1, readings_in_words(decision)
    yield Heading(text="The decision under every reading", anchor="decision")
    yield Paragraph(
        say(
            "{open} The two cameras compared are {first} and {second}.",
            open="Each of the other readings changes only what its assumption names; the rest is as declared. Cameras "
            "keep their names under every reading, even where it changes the value in the name."
            if others
            else "The study declares no other reading (set of assumptions).",
            **pair,
        )
    )
    if others:
        yield Bullets(
            tuple(say("**{name}**: {says}.", name=reading, says=meaning) for reading, meaning in says.items())
        )
        yield from pictures_of(drawings, "readings")
    yield from _crossovers(decision)


def _crossovers(decision: xr.Dataset) -> Iterator[Block]:
    """Say where the uncertainties of the pair are equal, and how far readings move that."""
    if "crossover_distance" not in decision:
        return
    values = np.asarray(decision["crossover_distance"].sel(error_source="both").values, dtype=np.float64)
    errors = decision["crossover_error"].sel(error_source="both").values[0]
    crossovers = [
        distance_with_error(float(v), float(e)) for v, e in zip(values[0], errors, strict=True) if np.isfinite(v)
    ]
    others = values[1:][np.isfinite(values[1:])]
    declared = (
        f"the depth uncertainties of the two cameras are equal at {' and '.join(crossovers)}, whether or not the "
        "cameras are usable there"
        if crossovers
        else "the curves of the two depth uncertainties do not cross"
    )
    count, all_others = int(np.isfinite(values[1:]).any(axis=1).sum()), len(values) - 1
    if not others.size:
        yield Paragraph(say("In the study as declared, {declared}.", declared=declared))
        return
    nearer = set(map(str, decision["crossover_nearer"].sel(error_source="both").values[1:].ravel())) - {""}
    yield Paragraph(
        say(
            "In the study as declared, {declared}. Under {under}, the curves of their uncertainties cross between "
            "{low} and {high}{ways}. The assumptions cause this range; it is not a confidence interval.",
            declared=declared,
            under="the other reading" if count == all_others == 1 else f"{count} of the {all_others} other readings",
            low=distance(float(others.min())),
            high=distance(float(others.max())),
            ways=", not always in the same direction" if len(nearer) > 1 else "",
        )
    )
