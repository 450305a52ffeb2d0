"""matplotlib figures of results: which ones a results tree allows, each drawn on demand.

matplotlib is imported when the first figure is drawn, never by importing this package.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from tradestudy.errors import OutOfRangeError

if TYPE_CHECKING:
    import xarray as xr

    from tradestudy.figures.drawing import Drawing
    from tradestudy.figures.style import StudyFigure


def build(tree: xr.DataTree) -> Mapping[str, Drawing]:
    """List the figures that a results tree allows, in the order of a report; nothing is drawn yet.

    Parameters
    ----------
    tree
        The content of ``results.nc``.

    Returns
    -------
    mapping of str to Drawing
        Call a drawing to get its matplotlib figure; it also carries caption and alternative text.
    """
    from tradestudy.figures.gallery import all_drawings

    return all_drawings(tree)


def figure(tree: xr.DataTree, name: str) -> StudyFigure:
    """Draw one figure of a results tree.

    Raises
    ------
    OutOfRangeError
        If the results have no such figure; the names that exist are listed.
    """
    drawings = build(tree)
    if name not in drawings:
        raise OutOfRangeError("these results have no such figure", value=name, limit=", ".join(drawings))
    return drawings[name].draw()
