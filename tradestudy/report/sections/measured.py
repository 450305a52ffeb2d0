"""Measured depth errors beside the predicted ones, and what they imply about the camera."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Block, Column, Heading, Paragraph, Table, literal, pictures_of, say
from tradestudy.results.views.measured import NAMES, Measured, implied_values, locking_words, measured_tables
from tradestudy.wording import counted, listed


def describe_measurements(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Show each table on its prediction, and what it implies; nothing for a study without measurements."""
    tables = measured_tables(tree)
    if not tables:
        return
    yield Heading(text="Measured beside predicted", anchor="measurements")
    for measured in tables:
        sentence = measured.finding()
        source = str(measured.table["source"].item())
        yield Paragraph(
            say(
                "**{name}.** {finding}. Source: {source}.{left}",
                name=measured.name,
                finding=f"{sentence[0].upper()}{sentence[1:]}",
                source=source,
                left=_left_out(measured),
            )
        )
        yield from pictures_of(drawings, f"measured_{measured.name}")
        yield _table(measured)
        yield Paragraph(literal(f"{locking_words(measured)}.{_other_ratios(measured)}"))
    if any(str(measured.table["fitted_camera"].item()) for measured in tables):
        yield Paragraph(
            say(
                "The folder `fitted` beside this report contains each camera with the fitted values, marked as fitted; "
                "`from: fitted/NAME.yaml` starts a camera of another study from it."
            )
        )


def _left_out(measured: Measured) -> str:
    missed = np.asarray(measured.rows["line"].values)[measured.values("used") == 0.0]
    if not missed.size:
        return ""
    few = ", ".join(str(int(line)) for line in missed[:5]) + (", …" if missed.size > 5 else "")
    where = f"line{'s' if missed.size > 1 else ''} {few}"
    return (
        f" At {counted(int(missed.size), 'distance')} ({where} of the file), the camera as declared measures nothing; "
        "fits leave these out."
    )


def _other_ratios(measured: Measured) -> str:
    """The median ratios of the columns that the first sentence does not name."""
    others = [
        f"{words} for the {NAMES[column]}"
        for column in NAMES
        if column != measured.spread and (words := measured.ratio_words(column))
    ]
    return f" Measured over predicted, median and range: {listed(others)}." if others else ""


def _table(measured: Measured) -> Table:
    return Table(
        name=f"measured-{measured.name}-table",
        caption="What the points imply, with 95 % intervals from their scatter by Student's t.",
        columns=(
            Column(title="Quantity", weight=4),
            Column(title="Implied", weight=2, align="right"),
            Column(title="95 % interval", align="right", weight=2),
            Column(title="Declared", align="right"),
            Column(title="Verdict", weight=3),
        ),
        rows=tuple(
            (row.name, row.value, row.interval, row.declared or "—", row.verdict or "—")
            for row in implied_values(measured)
        ),
        notes=(
            "Noise s and floor u are those of σ² = (s/g)² + u², with the change g of disparity with depth. Offset and "
            "scale are those of the mean disparity error. An interval that begins at 0 means that the points show no "
            "such part. The points count as independent.",
        ),
    )
