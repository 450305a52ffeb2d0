"""Draw the figures of a report."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from tradestudy.figures.drawing import Drawing, Plotted


def drawn_here(
    drawings: Mapping[str, Drawing], progress: Callable[[float], None] = lambda _share: None
) -> Mapping[str, Plotted]:
    """Draw figures, which keep their names."""
    from tradestudy.figures.plotted import plotted

    figures = {}
    for name, drawing in drawings.items():
        figures[name] = plotted(drawing.draw())
        progress(len(figures) / len(drawings))
    return figures
