"""Depth measured in the pictures of the scene, compared with the prediction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Block, Column, Heading, Paragraph, Table, Text, pictures_of, say
from tradestudy.report.words import length, or_dash, share, with_error
from tradestudy.results.views.groups import camera_titles, group, has
from tradestudy.units import FRACTION, LENGTH, NUMBER, Dimension, significant

ScoreRow = tuple[tuple[Text, ...], xr.Dataset | None]
"""The first cells of a row, and the variables behind the others; None for a heading."""


def describe_depth_maps(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Show the depth maps and compare them with the prediction; nothing for a study without depth maps."""
    if not has(tree, "pictures", "map_depth"):
        return
    data, titles = group(tree, "pictures"), camera_titles(tree)
    yield Heading(text="Depth measured in the pictures", anchor="depth-maps", level=2)
    yield Paragraph(
        "Each camera measures depth in its pictures with its own estimator, as if its calibration were perfect. "
        "Calibration errors of the camera that takes the pictures, if any, therefore appear mainly as a bias; the "
        "predicted uncertainty includes them. Points that the estimator cannot see in two pictures do not count as "
        "failures; points without depth, or with a false depth, do."
    )
    yield from pictures_of(drawings, "depth_maps", "depth_achieved")
    rows = [data.isel(mapped_camera=k) for k in range(data.sizes["mapped_camera"])]
    yield from score_tables(
        name="depth-maps",
        first=(Column(title="Camera", weight=1),),
        rows=[((titles[str(one["mapped_camera"].item())],), one) for one in rows],
    )
    measured_by: dict[str, list[str]] = {}
    for one in rows:
        measured_by.setdefault(str(one["matcher"].item()), []).append(titles[str(one["mapped_camera"].item())])
    for matcher, cameras in measured_by.items():
        yield Paragraph(_matcher("; ".join(cameras), matcher))


def _matcher(title: str, text: str) -> Text:
    """Write the matcher as a study would declare it, or why there is none."""
    declared, _, errors = text.partition("  # ")
    if not errors:
        return say("**{title}.** {why}.", title=title, why=text[0].upper() + text[1:])
    return say("**{title}**: `{matcher}` ({errors}).", title=title, matcher=declared, errors=errors)


def score_tables(*, name: str, first: tuple[Column, ...], rows: Sequence[ScoreRow]) -> Iterator[Table]:
    """Tables that compare measured depth with its prediction: a row for each of `rows`, after its own first cells."""
    yield Table(
        name=f"{name}-depth-table",
        caption="Errors of measured depth, ± one standard error where it exceeds 1 %.",
        columns=(*first, *_columns("Bias", "Spread", "Predicted", "Within 3σ", "Filled", "Paired (predicted)")),
        rows=tuple(cells if one is None else (*cells, *_of_depth(one)) for cells, one in rows),
        notes=(
            "Bias and spread: median of the errors, and half their central 68.27 % interval. Predicted: the predicted "
            "depth uncertainty. Within 3σ: fraction of errors of at most three times the predicted uncertainty. "
            "Paired: fraction of all points on a surface that appear in two of the pictures that the estimator "
            "compares; in brackets, the predicted fraction. Filled: fraction of paired points that have a depth. In "
            "raw pictures, a point counts once in every micro-image that shows it; in the prediction, only once.",
        ),
    )
    yield Table(
        name=f"{name}-disparity-table",
        caption="Errors of measured disparity, ± one standard error where it exceeds 1 %.",
        columns=(
            *first,
            *_columns("Bias [px]", "Spread [px]", "Spread / noise", "Neighbours", "A window apart", "Windows"),
        ),
        rows=tuple(cells if one is None else (*cells, *_of_disparity(one)) for cells, one in rows),
        notes=(
            "Spread / noise: spread of the errors, each divided by the standard deviation that noise causes in its "
            "matching window (to first order). Neighbours, A window apart: correlation of the errors of adjacent "
            "points, and of points one window apart. Windows: number of non-overlapping windows measured.",
        ),
    )


def _columns(*titles: str) -> tuple[Column, ...]:
    return tuple(Column(title=title, align="right") for title in titles)


def _of_depth(one: xr.Dataset) -> Iterator[str]:
    yield _shown(one, "bias", LENGTH)
    yield _shown(one, "spread", LENGTH)
    yield or_dash(float(one["depth_predicted"].item()), length)
    yield _shown(one, "within", FRACTION)
    yield _shown(one, "filled", FRACTION)
    available, predicted = (float(one[key].item()) for key in ("depth_available", "predicted_availability"))
    yield f"{or_dash(available, share)} ({or_dash(predicted, share)})"


def _of_disparity(one: xr.Dataset) -> Iterator[str]:
    for name in ("bias_px", "spread_px", "over_bound", "neighbour_correlation", "window_correlation"):
        yield _shown(one, name, NUMBER)
    yield significant(float(one["depth_windows"].item()), 3)


def _shown(one: xr.Dataset, name: str, dimension: Dimension) -> str:
    """Write a variable with its error; a dash if it is unknown."""
    value, error = (float(one[key].item()) for key in (f"depth_{name}", f"depth_{name}_error"))
    return or_dash(value, lambda known: with_error(known, error, dimension))
