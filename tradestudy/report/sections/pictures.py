"""Pictures of the scene, the depth measured in them, and whether it agrees with the prediction."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Block, Column, Heading, Paragraph, Table, Text, pictures_of, say
from tradestudy.report.words import length, or_dash, share, with_error
from tradestudy.results.views.groups import camera_titles, group, has
from tradestudy.units import ELECTRONS, FRACTION, LENGTH, NUMBER, Dimension, pretty, significant
from tradestudy.wording import counted


def describe_pictures(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Show the pictures of the scene, and say how they were made; nothing for a study without any."""
    if not has(tree, "pictures", "brightness"):
        return
    data, titles = group(tree, "pictures"), camera_titles(tree)
    yield Heading(text="Pictures of the scene", anchor="pictures")
    yield Paragraph(
        say(
            "The pictures are rendered through every lens, with diffraction where that effect is simulated. "
            "The folder `pictures` beside this report contains them in full, with the true depth in each pixel and the "
            "parameters of each camera."
        )
    )
    yield from pictures_of(drawings, "scene_pictures")
    yield Table(
        name="scene-pictures-table",
        caption="The pictures. Sampling error: relative root-mean-square difference from a picture with 16 times as "
        "many rays and, with diffraction, with four times as many point-spread functions; both without noise.",
        columns=(
            Column(title="Camera", weight=3),
            Column(title="Picture", weight=2),
            Column(title="Pixels", align="right"),
            Column(title="Pixel pitch", align="right"),
            Column(title="Saturated pixels", align="right"),
            Column(title="Sampling error", align="right"),
        ),
        rows=tuple(
            (
                titles[str(camera)],
                str(picture).removeprefix(f"{camera} "),
                f"{int(columns)} × {int(rows)}",
                length(float(pitch)),
                str(int(full)),
                share(float(error), digits=2),
            )
            for picture, camera, columns, rows, pitch, full, error in zip(
                data["picture"].values,
                *(
                    data[column].values
                    for column in ("camera_of", "columns", "rows", "pixel_pitch", "saturated", "sampling_error")
                ),
                strict=True,
            )
        ),
    )


ScoreRow = tuple[tuple[Text, ...], xr.Dataset | None]
"""The first cells of a row, and the variables behind the others; None for a heading."""

Scores = tuple[tuple[Column, ...], Sequence[ScoreRow]]
"""The first columns of a table of scores, and its rows."""


def describe_depth_maps(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Show the depth maps and compare them with the prediction; nothing for a study without depth maps."""
    if not has(tree, "pictures", "map_depth"):
        return
    data, titles = group(tree, "pictures"), camera_titles(tree)
    yield Heading(text="Depth measured in the pictures", anchor="depth-maps")
    yield Paragraph(
        "Each camera measures depth in its pictures with its own estimator, as if its calibration were perfect. "
        "Calibration errors of the camera that takes the pictures, if any, therefore appear mainly as a bias. Points "
        "that the estimator cannot see in two pictures do not count as "
        "failures; points without depth, or with a false depth, do."
    )
    yield _depth_table("depth-maps", *_scores_of_maps(data, titles))
    yield from pictures_of(drawings, "depth_achieved", "depth_maps")
    measured_by: dict[str, list[str]] = {}
    for k in range(data.sizes["mapped_camera"]):
        camera = data.isel(mapped_camera=k)
        measured_by.setdefault(str(camera["matcher"].item()), []).append(titles[str(camera["mapped_camera"].item())])
    for matcher, cameras in measured_by.items():
        yield Paragraph(_matcher("; ".join(cameras), matcher))


def _matcher(title: str, text: str) -> Text:
    """Write the matcher as a study would declare it, or why there is none."""
    declared, _, errors = text.partition("  # ")
    if not errors:
        return say("**{title}.** {why}.", title=title, why=text[0].upper() + text[1:])
    return say("**{title}**: `{matcher}` ({errors}).", title=title, matcher=declared, errors=errors)


def list_disparity_scores(tree: xr.DataTree) -> Iterator[Block]:
    """Tabulate the errors of the disparity behind measured depth; nothing for a study that measures none."""
    tables = list[Table]()
    if has(tree, "pictures", "map_depth"):
        scores = _scores_of_maps(group(tree, "pictures"), camera_titles(tree))
        tables.append(_disparity_table("depth-maps", *scores))
    if has(tree, "depth_loop", "depth_spread"):
        scores = _scores_of_planes(group(tree, "depth_loop"), camera_titles(tree))
        tables.append(_disparity_table("depth-loop", *scores))
    if tables:
        yield Heading(text="Disparity measured in the pictures", anchor="disparity-scores")
        yield from tables


def _scores_of_maps(data: xr.Dataset, titles: Mapping[str, str]) -> Scores:
    each = [data.isel(mapped_camera=k) for k in range(data.sizes["mapped_camera"])]
    return (Column(title="Camera", weight=1),), [
        ((titles[str(camera["mapped_camera"].item())],), camera) for camera in each
    ]


def _scores_of_planes(data: xr.Dataset, titles: Mapping[str, str]) -> Scores:
    varied = [title for title, dim in (("Contrast", "contrast"), ("Light", "electrons")) if data.sizes[dim] > 1]
    return tuple(Column(title=title) for title in ("Distance", *varied)), list(_rows(data, titles))


def _depth_table(name: str, first: tuple[Column, ...], rows: Sequence[ScoreRow]) -> Table:
    """Compare measured depth with its prediction: a row for each of `rows`, after its own first cells."""
    return Table(
        name=f"{name}-depth-table",
        caption="Errors of measured depth, ± one standard error where it exceeds 1 %.",
        columns=(*first, *_columns("Bias", "Spread", "Predicted", "Within 3σ", "Filled", "Paired (predicted)")),
        rows=tuple(cells if measured is None else (*cells, *_of_depth(measured)) for cells, measured in rows),
        notes=(
            "Bias and spread: median of the errors, and half their central 68.27 % interval. Predicted: the depth "
            "uncertainty from noise; in brackets, that from the errors of the calibration, if the pictures have them. "
            "Within 3σ: fraction of errors of at most three times the predicted uncertainty from both. "
            "Paired: fraction of all points on a surface that appear in two of the pictures that the estimator "
            "compares; in brackets, the predicted fraction. Filled: fraction of paired points that have a depth. In "
            "raw pictures, a point counts once in every micro-image that shows it; in the prediction, only once.",
        ),
    )


def _disparity_table(name: str, first: tuple[Column, ...], rows: Sequence[ScoreRow]) -> Table:
    """Compare measured disparity with its prediction: a row for each of `rows`, after its own first cells."""
    return Table(
        name=f"{name}-disparity-table",
        caption="Errors of measured disparity, ± one standard error where it exceeds 1 %.",
        columns=(
            *first,
            *_columns("Bias [px]", "Spread [px]", "Spread / noise", "Neighbours", "A window apart", "Windows"),
        ),
        rows=tuple(cells if measured is None else (*cells, *_of_disparity(measured)) for cells, measured in rows),
        notes=(
            "Spread / noise: spread of the errors, each divided by the standard deviation that noise causes in its "
            "matching window (to first order). Neighbours, A window apart: correlation of the errors of adjacent "
            "points, and of points one window apart. Windows: number of non-overlapping windows measured.",
        ),
    )


def _columns(*titles: str) -> tuple[Column, ...]:
    return tuple(Column(title=title, align="right") for title in titles)


def _of_depth(measured: xr.Dataset) -> Iterator[str]:
    yield _shown(measured, "bias", LENGTH)
    yield _shown(measured, "spread", LENGTH)
    noise, shift = (float(measured[variable].item()) for variable in ("depth_predicted", "depth_predicted_bias"))
    yield or_dash(noise, length) + (f" ({length(shift)})" if shift > 0.0 else "")
    yield _shown(measured, "within", FRACTION)
    yield _shown(measured, "filled", FRACTION)
    available, predicted = (
        float(measured[variable].item()) for variable in ("depth_available", "predicted_availability")
    )
    yield f"{or_dash(available, share)} ({or_dash(predicted, share)})"


def _of_disparity(measured: xr.Dataset) -> Iterator[str]:
    for quantity in ("bias_px", "spread_px", "over_bound", "neighbour_correlation", "window_correlation"):
        yield _shown(measured, quantity, NUMBER)
    yield significant(float(measured["depth_windows"].item()), 3)


def _shown(measured: xr.Dataset, quantity: str, dimension: Dimension) -> str:
    """Write a variable with its error; a dash if it is unknown."""
    value, error = (float(measured[variable].item()) for variable in (f"depth_{quantity}", f"depth_{quantity}_error"))
    return or_dash(value, lambda number: with_error(number, error, dimension))


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
    for k, key in enumerate(data["camera"].values):
        yield Paragraph(_fitted_matcher(data.isel(camera=k), titles[str(key)]))
    yield Paragraph(
        say(
            "In these matchers, `factor` multiplies the Cramér–Rao bound on the disparity error, `floor` adds to it in "
            "quadrature, and `false_matches` is the fraction of wrong matches. The file matchers.yaml beside this "
            "report contains them, ready for the cameras of a study."
        )
    )
    yield _depth_table("depth-loop", *_scores_of_planes(data, titles))


def _scaling(run: Mapping[str, Any]) -> str:
    """Say that the texture grows with distance, where it does."""
    start = run.get("inputs", {}).get("depth_loop.texture_scaled_from")
    if start is None:
        return ""
    return (
        f" The texture has its declared size at {start} and grows in proportion to distance. The predictions in this "
        "section allow for this; elsewhere in this report, its size is the same at all distances."
    )


def _fitted_matcher(camera: xr.Dataset, title: str) -> Text:
    """Describe the fitted matcher of one camera, or say why there is none."""
    declared = str(camera["matcher"].item())
    if np.isnan(camera["matcher_factor"].item()):
        return say("**{title}**: {why}.", title=title, why=declared)
    over = camera["over_matcher"].values[camera["fitted"].values == 0.0]
    over = over[np.isfinite(over)]
    text = say("**{title}**: the fit gives `{matcher}`.", title=title, matcher=declared.partition("  # ")[0])
    factor = with_error(camera["matcher_factor"].item(), camera["matcher_factor_error"].item(), NUMBER)
    text += say(" Its factor is {factor}.", factor=factor)
    if over.size:
        text += say(
            " On {count} outside the fit, the matcher predicts {low} to {high} of the errors' standard deviation.",
            count=counted(over.size, "plane"),
            low=share(float(1.0 / over.max())),
            high=share(float(1.0 / over.min())),
        )
    return text


def _rows(data: xr.Dataset, titles: Mapping[str, str]) -> Iterator[ScoreRow]:
    """A heading for each camera, and all planes that it measured, in the order of the results."""
    for k, key in enumerate(data["camera"].values):
        yield (titles[str(key)],), None
        for place in itertools.product(*(range(data.sizes[dim]) for dim in _PLANES)):
            plane = data.isel(camera=k).isel(dict(zip(_PLANES, place, strict=True)))
            if not plane["depth_measured"].item():
                continue
            cells: list[Text] = [length(float(plane["distance"].item()))]
            if data.sizes["contrast"] > 1:
                cells.append(share(float(plane["contrast"].item())))
            if data.sizes["electrons"] > 1:
                cells.append(pretty(float(plane["electrons"].item()), ELECTRONS))
            yield tuple(cells), plane
