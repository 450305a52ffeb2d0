"""The numbers that bars, arrows, maps and pictures show, as tables of texts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import ValueTable
from tradestudy.light_methods import short_title
from tradestudy.results.views.depth import by_first_criterion, field_words, sharp_ranges
from tradestudy.results.views.groups import FloatArray, camera_titles, group, titles_in
from tradestudy.results.views.trade_off import candidates_by_rank
from tradestudy.results.views.wave_optics import reference_method
from tradestudy.units import FRACTION, LENGTH, NUMBER, Dimension, pretty
from tradestudy.wording import distance, in_words, span, within

Tables = tuple[ValueTable, ...]


def worded(value: float, dimension: Dimension = NUMBER) -> str:
    """Write a number with its unit; a dash if there is none."""
    return "—" if np.isnan(value) else pretty(float(value), dimension)


def grid(
    caption: str,
    columns: Sequence[str],
    names: Sequence[str],
    values: FloatArray,
    dimension: Dimension = NUMBER,
) -> ValueTable:
    """Make a table of numbers; `columns` names all columns, `names` the rows of `values`."""
    rows = [(name, *(worded(value, dimension) for value in row)) for name, row in zip(names, values, strict=True)]
    return ValueTable(caption=caption, columns=tuple(columns), rows=tuple(rows))


def source_tables(tree: xr.DataTree, place: float) -> Tables:
    """List depth uncertainty from each source alone at a distance [m] of ``/sensitivity``, the largest first."""
    data = group(tree, "sensitivity").sel(distance=place)
    fields = [field_words(float(field)) for field in data["field"].values]
    return tuple(_sources(title, fields, data.sel(camera=key)) for key, title in titles_in(tree, "sensitivity").items())


def _sources(title: str, fields: list[str], data: xr.Dataset) -> ValueTable:
    values = data["source_uncertainty"].transpose("source", "field").values
    size = np.max(np.where(np.isfinite(values), values, 0.0), axis=1)
    order = np.argsort(-size, kind="stable")[: int(np.count_nonzero(size))]
    names = [in_words(str(source)) for source in data["source"].values[order]]
    return grid(title, ["Source", *fields], names, values[order], LENGTH)


def reading_tables(tree: xr.DataTree, titles: dict[str, str]) -> Tables:
    """List the ratio of the uncertainties of a pair in every reading: a table for each error source in `titles`."""
    data = group(tree, "decision")
    columns = ["Reading", *(f"at {distance(float(place))}" for place in data["place"].values)]
    names = [str(reading) for reading in data["reading"].values]
    return tuple(
        grid(
            title,
            columns,
            names,
            data["uncertainty_ratio"].sel(error_source=error_source).transpose("reading", "place").values,
        )
        for error_source, title in titles.items()
    )


def focus_tables(tree: xr.DataTree) -> Tables:
    """List the distances that each camera keeps sharp by the first criterion, and the detail that it resolves."""
    data = by_first_criterion(tree)
    equal = "resolved_near" in data
    columns = ["Camera", "Sharp", "Coarsest resolution of the scene"]
    if equal:
        columns.append(f"Resolves {pretty(float(data.attrs['equal_resolution']), LENGTH)}")
    rows = []
    for key, title in camera_titles(tree).items():
        camera = data.sel(camera=key)
        row = [title, _where(camera, "sharp"), worded(float(camera["scene_resolution"]), LENGTH)]
        rows.append((*row, _where(camera, "resolved")) if equal else tuple(row))
    return (ValueTable(caption="Distances from the lens", columns=tuple(columns), rows=tuple(rows)),)


def _where(camera: xr.Dataset, kind: str) -> str:
    return " and ".join(span(*within(*ends)) for ends in sharp_ranges(camera, kind)) or "nowhere"


def rank_tables(tree: xr.DataTree) -> Tables:
    """List the fraction of the possible weights under which each candidate takes each rank."""
    candidates = candidates_by_rank(tree)
    columns = ["Candidate", *(f"rank {rank + 1}" for rank in range(len(candidates[0].ranks)))]
    ranks = np.array([ranked.ranks for ranked in candidates])
    return (
        grid("Fraction of the possible weights", columns, [ranked.title for ranked in candidates], ranks, FRACTION),
    )


def light_tables(tree: xr.DataTree) -> Tables:
    """List the light on the pixels by every method, and its difference from the reference."""
    data = group(tree, "images")
    reference = reference_method(data)
    image, exact = data["image"], data["image"].sel(propagator=reference)
    pixels = ("row", "column")
    values = {
        "brightest pixel": image.max(pixels) / float(exact.max()),
        "mean pixel": image.mean(pixels) / float(exact.max()),
        "largest difference": abs(image - exact).max(pixels) / float(exact.max()),
        "summed difference": data["difference"].sel(against=reference),
    }
    names = [short_title(str(method)) for method in data["propagator"].values]
    numbers = np.stack([column.values for column in values.values()], axis=1)
    title = f"Relative to {short_title(reference)}: its brightest pixel, and in the last column all of its light"
    return (grid(title, ["Method", *values], names, numbers, FRACTION),)


def picture_tables(tree: xr.DataTree, shown: Sequence[int]) -> Tables:
    """List the ranges of true depth and brightness of the pictures with these numbers."""
    data, titles = group(tree, "pictures"), camera_titles(tree)
    names = [titles[str(data["camera_of"].values[k])] for k in shown]
    depth, light = (data[variable].isel(picture=list(shown)).values for variable in ("true_depth", "brightness"))
    return (
        _summary("True depth", "Camera", names, list(depth), LENGTH),
        _summary("Brightness, mean = 1", "Camera", names, [picture / np.nanmean(picture) for picture in light]),
    )


def depth_map_tables(tree: xr.DataTree) -> Tables:
    """List the ranges of measured depth, of its error, and of the hidden fraction of the surface."""
    data, titles = group(tree, "pictures"), camera_titles(tree)
    names = [titles[str(key)] for key in data["mapped_camera"].values]
    shown: tuple[tuple[str, str, Dimension], ...] = (
        ("map_depth", "Measured depth", LENGTH),
        ("map_depth_error", "Error of depth", LENGTH),
        ("map_hidden", "Hidden share", FRACTION),
    )
    return tuple(_summary(title, "Camera", names, list(data[key].values), dimension) for key, title, dimension in shown)


def uncertainty_map_tables(places: Sequence[float], ratios: Sequence[FloatArray]) -> Tables:
    """List, for each distance [m], the range over the picture of the uncertainty relative to that in its middle."""
    names = [distance(float(place)) for place in places]
    return (_summary("Times the uncertainty in the middle", "Distance", names, ratios),)


def _summary(
    caption: str, what: str, names: Sequence[str], pictures: Sequence[FloatArray], dimension: Dimension = NUMBER
) -> ValueTable:
    """List the smallest value, median and largest value of each picture, and the fraction of it that is known."""
    columns = [what, "smallest", "median", "largest"]
    return grid(caption, columns, names, np.array([_range(picture) for picture in pictures]), dimension)


def _range(values: FloatArray) -> tuple[float, float, float]:
    finite = values[np.isfinite(values)]
    low, middle, high = np.percentile(finite, (0, 50, 100)) if finite.size else (np.nan,) * 3
    return float(low), float(middle), float(high)


def corner_tables(names: Sequence[str], data: xr.Dataset, draws: FloatArray) -> Tables:
    """List widths of the marginals of a posterior, and correlations of its `draws`, with one column per parameter."""
    words = [in_words(name) for name in names]
    ratio = np.asarray(data["laplace_deviation"].values / data["posterior_deviation"].values, dtype=np.float64)
    return (
        grid("Marginals", ["Parameter", "Laplace over posterior deviation"], words, ratio[:, None]),
        grid("Correlations", ["Parameter", *words], words, np.atleast_2d(np.corrcoef(draws.T))),
    )


def trace_tables(names: Sequence[str], scores: FloatArray) -> Tables:
    """List means and deviations of walks of shape (ensemble, step, parameter), in the posterior's deviations."""
    columns = ["Parameter", *(f"ensemble {number + 1}" for number in range(len(scores)))]
    words = [in_words(name) for name in names]
    statistics = {
        "Mean of the walk": np.nanmean(scores, axis=1),
        "Standard deviation of the walk": np.nanstd(scores, axis=1),
    }
    return tuple(
        grid(f"{title}, in standard deviations of the posterior", columns, words, values.T)
        for title, values in statistics.items()
    )


def residual_tables(residual: FloatArray) -> Tables:
    """List mean residuals of shape (picture, row, column, 2) as x and y of every cell."""
    columns = ("Cell", *(f"column {number + 1}" for number in range(residual.shape[2])))
    return tuple(
        ValueTable(
            caption=f"Mean residuals in cells of the {side} picture: x, y [px]",
            columns=columns,
            rows=tuple(
                (
                    f"row {number + 1}",
                    *("—" if np.isnan(x) else f"{worded(x)}, {worded(y)}" for x, y in row),
                )
                for number, row in enumerate(cells)
            ),
        )
        for side, cells in zip(("left", "right"), residual, strict=True)
    )
