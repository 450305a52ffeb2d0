"""The cameras in the terms of data sheets, with the conditions and definition of each value."""

from __future__ import annotations

import math
from collections.abc import Iterator

import xarray as xr

from tradestudy.report.document import Block, Column, Heading, Paragraph, Table, Text, say
from tradestudy.report.words import length, or_dash, percent, share
from tradestudy.results.views.depth import at_the_bound, best_of_any_matcher, declared_matchers
from tradestudy.results.views.groups import camera_titles, group, has
from tradestudy.units import ANGLE, pretty, significant
from tradestudy.wording import distance, span


def describe_datasheet(tree: xr.DataTree) -> Iterator[Block]:
    """Define the values, then write one table per camera."""
    if not has(tree, "datasheet", "z_accuracy"):
        return
    data, titles = group(tree, "datasheet"), camera_titles(tree)
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
            "0 where the camera is unusable. *Field*: width and height of the area that one camera sees.{matching}",
            matching=_of_matching(tree),
        )
    )
    places = [float(place) for place in data["sheet_distance"].values]
    for name in data["camera"].values:
        one = data.sel(camera=name)
        usable = f"usable {_usable(*(float(one[name]) for name in ('near_limit', 'far_limit')))}"
        across, down = (pretty(float(one[f"{axis}_field_of_view"]), ANGLE) for axis in ("horizontal", "vertical"))
        yield Table(
            name=f"datasheet-{name}",
            caption=f"{titles[str(name)]}: {usable}; field of view at its focus setting, {across} × {down}.",
            columns=(
                Column(title="Value", weight=3),
                *(Column(title=f"At {distance(place)}", align="right", weight=2) for place in places),
            ),
            rows=tuple(_rows(one)),
        )


def _of_matching(tree: xr.DataTree) -> str:
    """Name the cameras whose disparity error is a bound, and say why pixel locking is not temporal noise."""
    text = best_of_any_matcher(at_the_bound(tree))
    if declared_matchers(tree):
        text += " Declared pixel locking is not temporal noise: it is the same in every repeated measurement."
    return f" {text.strip()}" if text else ""


def _rows(one: xr.Dataset) -> Iterator[tuple[Text, ...]]:
    yield "Z accuracy", *_lengths(one, "z_accuracy")
    yield "Temporal noise", *_lengths(one, "temporal_noise")
    yield "Sub-pixel RMS [px]", *(or_dash(float(v), lambda x: significant(x, 2)) for v in one["subpixel_rms"].values)
    yield "Plane-fit RMS", *_lengths(one, "plane_fit_rms")
    yield "Fill rate", *(share(float(value)) for value in one["fill_rate"].values)
    yield (
        "Field",
        *(
            f"{length(float(w))} × {length(float(h))}"
            for w, h in zip(one["field_width"].values, one["field_height"].values, strict=True)
        ),
    )


def _lengths(one: xr.Dataset, name: str) -> Iterator[str]:
    for value, place in zip(one[name].values, one["sheet_distance"].values, strict=True):
        if math.isfinite(float(value)):
            yield f"{length(float(value))} ({percent(float(value / place))})"
        else:
            yield "—" if math.isnan(float(value)) else "unbounded"


def _usable(near: float, far: float) -> str:
    return "nowhere" if math.isnan(near) else f"from {span(near, far)}"
