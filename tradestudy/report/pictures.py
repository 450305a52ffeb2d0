"""Figures of a run as blocks of its report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Picture


def pictures_of(drawings: Mapping[str, Drawing], *names: str) -> Iterator[Picture]:
    """Show the figures of these names, in this order; those that the run does not have are left out."""
    for name in names:
        if name in drawings:
            yield Picture(name=name, caption=drawings[name].caption, alt=drawings[name].alt)
