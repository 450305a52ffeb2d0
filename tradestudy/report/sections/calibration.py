"""Calibration: sources, convergence of inferences, the benefit of averaging, and which camera errs less."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Block, Column, Heading, Table, Text, pictures_of
from tradestudy.report.sections.posterior import describe_posteriors, lens_words
from tradestudy.report.sections.uncertain_decision import describe_ranks
from tradestudy.results.views.depth import decided_by_calibration, nominal, table_depth, table_distances
from tradestudy.results.views.groups import group, has, titles_in
from tradestudy.units import significant
from tradestudy.wording import counted, distance, in_words

_TWO_DIGITS = 100.0
_SOURCES = ("corners", "target", "posterior")


def describe_calibration(tree: xr.DataTree, run: Mapping[str, Any], drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write the calibrations of the cameras and their effect on depth; nothing for a study without depth."""
    if not has(tree, "depth"):
        return
    inputs = run.get("inputs", {})
    yield Heading(text="Calibration", anchor="calibration")
    yield _sources(tree, inputs if isinstance(inputs, Mapping) else {})
    yield from describe_posteriors(tree, drawings)
    yield Heading(text="How far averaging helps", anchor="averaging", level=2)
    yield _averaging(tree)
    if has(tree, "sensitivity", "source_uncertainty"):
        yield Heading(text="Uncertainty from each source alone", anchor="sensitivity", level=2)
        yield from pictures_of(drawings, "tornado", "sobol-indices")
        yield from _refusals(tree)
    if has(tree, "decision", "rank_first"):
        yield Heading(text="Which camera has the smaller error", anchor="ranks", level=2)
        yield from describe_ranks(tree)
        yield from pictures_of(drawings, "rank-probability")


def _sources(tree: xr.DataTree, inputs: Mapping[str, str]) -> Table:
    """List where each calibration comes from, and which of its errors are declared."""
    rows: list[tuple[Text, ...]] = []
    on_board = False
    for key, title in titles_in(tree, "depth").items():
        start = f"cameras.{key}.calibration."
        own = {path.removeprefix(start): str(value) for path, value in inputs.items() if path.startswith(start)}
        names = list(dict.fromkeys(path.split(".")[1] for path in own if path.startswith("errors.")))
        on_board |= bool(names) and any(path.split(".")[0] in ("target", "corners") for path in own)
        since = dict.fromkeys(path.split(".")[1] for path in own if path.startswith("stability."))
        since = {name: None for name in since if name in _SINCE}
        rows.append(
            (
                title,
                _source(tree, key, own, names),
                ", ".join(map(in_words, names)) or "none",
                ", ".join(map(in_words, since)) or "none",
            )
        )
    return Table(
        name="calibration-source-table",
        caption="Sources of the calibrations."
        + (
            " Where a board was used, the declared errors are priors, or errors that the board cannot reveal."
            if on_board
            else ""
        ),
        columns=(
            Column(title="Camera", weight=2),
            Column(title="Source", weight=2),
            Column(title="Declared errors", weight=4),
            Column(title="Drift", weight=2),
        ),
        rows=tuple(rows),
    )


_SINCE = ("temperature", "pressure", "color", "ageing")


def _source(tree: xr.DataTree, key: str, own: Mapping[str, str], errors: list[str]) -> str:
    """Describe the source of one calibration."""
    found = next((name for name in _SOURCES if any(path.split(".")[0] == name for path in own)), "")
    if found == "target":
        return (
            f"a simulated board, {counted(int(own['target.views']), 'view')}"
            if "target.views" in own
            else "a simulated board"
        )
    if found == "corners":
        where = f"corners of a board, {own.get('corners.file', '')}".removesuffix(", ")
        data = group(tree, "calibration") if has(tree, "calibration", "posterior_lens_model") else None
        if data is None or key not in data["posterior"].values:
            return where
        return f"{where}; lens model {lens_words(str(data['posterior_lens_model'].sel(posterior=key).item()))}"
    if found == "posterior":
        return f"a saved posterior, {own.get('posterior.file', '')}".removesuffix(", ")
    if errors:
        return "declared errors"
    return "unknown" if decided_by_calibration(nominal(tree), key) else "assumed perfect"


def _averaging(tree: xr.DataTree) -> Table:
    """List how many measurements it takes until noise equals calibration error, at the declared distances."""
    places = table_distances(tree)
    there = table_depth(tree)["depth_uncertainty_by_error_source"].sel(distance=places, method="nearest")
    noise, calibration = (there.sel(error_source=error_source) for error_source in ("noise", "calibration"))
    rows = tuple(
        (
            title,
            *map(_readings_worth, noise.sel(camera=key).values.tolist(), calibration.sel(camera=key).values.tolist()),
        )
        for key, title in titles_in(tree, "depth").items()
    )
    meanings = {
        "< 1": "< 1: the noise of one measurement is already below the calibration error.",
        "∞": "∞: calibration errors have no effect there, or one too small to be simulated.",
    }
    notes = " ".join(says for sign, says in meanings.items() if any(sign in row[1:] for row in rows))
    return Table(
        name="averaging-table",
        caption="Number of measurements of one point whose mean has as much noise as the calibration error. Averaging "
        "more gains little, because calibration errors do not average out.",
        columns=(
            Column(title="Camera", weight=1),
            *(Column(title=distance(float(place)), align="right") for place in places),
        ),
        rows=rows,
        notes=(notes,) if notes else (),
    )


def _readings_worth(noise: float, calibration: float) -> str:
    """Write the number of measurements with two digits; a dash if noise or calibration error has no bound."""
    if not np.isfinite([noise, calibration]).all():
        return "—"
    if calibration == 0.0:
        return "∞"
    worth = (noise / calibration) ** 2
    return "< 1" if worth < 1.0 else f"{worth:.0f}" if worth < _TWO_DIGITS else significant(worth, 2)


def _refusals(tree: xr.DataTree) -> Iterator[Block]:
    """List results that are withheld because they would mislead, with the reason for each."""
    data, rows = group(tree, "sensitivity"), []
    for key, title in titles_in(tree, "sensitivity").items():
        reason = str(data["parameter_refused"].sel(camera=key).item())
        if reason:
            rows.append((title, "one bar for each parameter", reason.replace(" -", " −")))
        why = sorted({str(text) for text in data["index_refused"].sel(camera=key, field=0.0).values} - {""})
        if why:
            rows.append((title, "Sobol indices at some distances", "; ".join(why)))
    if rows:
        yield Table(
            name="refused-table",
            caption="Results withheld because they would mislead.",
            columns=(
                Column(title="Camera", weight=1),
                Column(title="Result", weight=1),
                Column(title="Reason", weight=4),
            ),
            rows=tuple(rows),
        )
