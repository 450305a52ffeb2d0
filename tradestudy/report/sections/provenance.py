"""Where a report comes from: versions, machine, seconds. The only section that differs between two equal runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from tradestudy.report.document import Block, Column, Heading, Table


def provenance(run: Mapping[str, Any]) -> Iterator[Block]:
    """Write the content of ``run.json`` as a table."""
    rows = tuple(_rows(run, ""))
    if rows:
        yield Heading(text="Provenance", anchor="provenance")
        yield Table(
            name="provenance-table",
            caption="How this report was made; the rest of it depends on the study alone.",
            columns=(Column(title="What", weight=1), Column(title="Value", weight=2)),
            rows=rows,
        )


def _rows(content: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, str]]:
    for key, value in content.items():
        name = f"{prefix}{key}".replace("_", " ")
        if isinstance(value, Mapping):
            yield from _rows(value, f"{name}: ")
        else:
            text = ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
            yield name, f"{value:.3g}" if isinstance(value, float) else text
