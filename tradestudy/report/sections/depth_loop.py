"""Whether cameras measure the depth of rendered planes as predicted."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Block, Column, Heading, Paragraph, Text, pictures_of, say
from tradestudy.report.sections.depth_maps import ScoreRow, score_tables
from tradestudy.report.words import length, share, with_error
from tradestudy.results.views.groups import camera_titles, group, has
from tradestudy.units import ELECTRONS, NUMBER, pretty
from tradestudy.wording import counted

_PLANES = ("distance", "contrast", "electrons")


def describe_depth_loop(tree: xr.DataTree, run: Mapping[str, Any], drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Compare depth measured in pictures of planes with the prediction; nothing for a study without a depth loop."""
    if not has(tree, "depth_loop", "depth_spread"):
        return
    data, titles = group(tree, "depth_loop"), camera_titles(tree)
    yield Heading(text="Depth measured in pictures of planes", anchor="depth-loop")
    yield Paragraph(
        "The program rendered each camera's pictures of planes perpendicular to the optical axis, with a different "
        "texture and noise for each plane, and measured depth in them. The cameras have no calibration errors. The "
        "search for a disparity started near the true one, so false matches far from it do not occur." + _scaling(run)
    )
    yield from pictures_of(drawings, "depth_loop")
    for k, name in enumerate(data["camera"].values):
        yield Paragraph(_fitted_matcher(data.isel(camera=k), titles[str(name)]))
    yield Paragraph(
        say(
            "In these matchers, `factor` multiplies the Cramér–Rao bound on the disparity error, `floor` adds to it in "
            "quadrature, and `false_matches` is the fraction of wrong matches. The file matchers.yaml beside this "
            "report contains them, ready for the cameras of a study."
        )
    )
    yield from score_tables(name="depth-loop", first=_first_columns(data), rows=list(_rows(data, titles)))


def _scaling(run: Mapping[str, Any]) -> str:
    """Say that the texture grows with distance, where it does."""
    start = run.get("inputs", {}).get("depth_loop.texture_scaled_from")
    if start is None:
        return ""
    return (
        f" The texture has its declared size at {start} and grows in proportion to distance. The predictions in this "
        "section allow for this; elsewhere in this report, its size is the same at all distances."
    )


def _fitted_matcher(one: xr.Dataset, title: str) -> Text:
    """Describe the fitted matcher of one camera, or say why there is none."""
    declared = str(one["matcher"].item())
    if np.isnan(one["matcher_factor"].item()):
        return say("**{title}**: {why}.", title=title, why=declared)
    over = one["over_matcher"].values[one["fitted"].values == 0.0]
    over = over[np.isfinite(over)]
    text = say("**{title}**: the fit gives `{matcher}`.", title=title, matcher=declared.partition("  # ")[0])
    factor = with_error(one["matcher_factor"].item(), one["matcher_factor_error"].item(), NUMBER)
    text += say(" Its factor is {factor}.", factor=factor)
    if over.size:
        text += say(
            " On {count} outside the fit, the matcher predicts {low} to {high} of the errors' standard deviation.",
            count=counted(over.size, "plane"),
            low=share(float(1.0 / over.max())),
            high=share(float(1.0 / over.min())),
        )
    return text


def _first_columns(data: xr.Dataset) -> tuple[Column, ...]:
    titles = [("Distance", "distance"), ("Contrast", "contrast"), ("Light", "electrons")]
    return tuple(Column(title=title) for title, name in titles if name == "distance" or data.sizes[name] > 1)


def _rows(data: xr.Dataset, titles: Mapping[str, str]) -> Iterator[ScoreRow]:
    """A heading for each camera, and all planes that it measured, in the order of the results."""
    for k, name in enumerate(data["camera"].values):
        yield (titles[str(name)],), None
        for place in itertools.product(*(range(data.sizes[dim]) for dim in _PLANES)):
            one = data.isel(camera=k).isel(dict(zip(_PLANES, place, strict=True)))
            if not one["depth_measured"].item():
                continue
            cells: list[Text] = [length(float(one["distance"].item()))]
            if data.sizes["contrast"] > 1:
                cells.append(share(float(one["contrast"].item())))
            if data.sizes["electrons"] > 1:
                cells.append(pretty(float(one["electrons"].item()), ELECTRONS))
            yield tuple(cells), one
