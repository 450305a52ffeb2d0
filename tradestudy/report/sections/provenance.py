"""Where a report comes from: versions, machine, seconds. The only section that differs between two equal runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from tradestudy.report.document import Block, Column, Heading, Table
from tradestudy.units import significant


def describe_provenance(run: Mapping[str, Any]) -> Iterator[Block]:
    """Write the content of ``run.json`` as a table; what the study declares stands in the sections before it."""
    rows = tuple(_rows({key: value for key, value in run.items() if key != "inputs"}))
    if rows:
        yield Heading(text="Provenance", anchor="provenance")
        yield Table(
            name="provenance-table",
            caption="How this report was made; the rest of it depends on the study alone.",
            columns=(Column(title="What", weight=1), Column(title="Value", weight=2)),
            rows=rows,
        )


def _rows(content: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Plain values first, then every group of values under its name."""
    groups = {key: value for key, value in content.items() if isinstance(value, Mapping)}
    for key, value in content.items():
        if key not in groups:
            yield _words(key), _shown(value)
    for key, group in groups.items():
        if group:
            yield (_words(key).capitalize(),)
            yield from _rows(group)


def _words(key: str) -> str:
    return key.replace("_", " ")


def _shown(value: Any) -> str:
    if value is None:
        return "—"
    if isinstance(value, float):
        return significant(value)
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
