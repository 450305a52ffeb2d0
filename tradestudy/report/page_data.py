"""The numbers that the script of a page needs: curves of its figures, and values of the results."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from tradestudy.errors import escaped
from tradestudy.figures.drawing import Curve, Panel, Plotted
from tradestudy.report.curve_values import CurveValues
from tradestudy.report.designs import PageDesigns
from tradestudy.report.document import Block
from tradestudy.results.views.groups import FloatArray

_FARTHEST: Final = 1e9  # m
_DIGITS: Final = 3  # digits that the script shows
_NEAR_TIE: Final = 1e-3  # of the last digit: far above the rounding error of single floats


@dataclass(frozen=True)
class _Pool:
    """The arrays of a page, without repetition, as single floats in base64."""

    texts: list[str] = field(default_factory=list)
    places: dict[bytes, int] = field(default_factory=dict)

    def place(self, values: FloatArray | None) -> int | None:
        if values is None or not values.size:
            return None
        raw = _displayed_alike(values).tobytes()
        if raw not in self.places:
            self.places[raw] = len(self.texts)
            self.texts.append(base64.b64encode(raw).decode())
        return self.places[raw]

    def curve(self, one: CurveValues) -> list[int | str | None]:
        return [*(self.place(values) for values in (one.x, one.value, one.low, one.high)), one.beside]


def page_data(
    figures: Mapping[str, Plotted],
    values: Mapping[str, CurveValues],
    designs: PageDesigns | None = None,
    write: Callable[[Block], str] = str,
) -> str:
    """Write JSON for the script of a page, safe inside an HTML element.

    Parameters
    ----------
    figures
        Figures of the page, by name.
    values
        Results behind curves, by the name of the curve, such as ``depth_uncertainty/stereo``.
    designs
        Designs of a sweep.
    write
        Turns a block about a design into HTML.
    """
    pool = _Pool()
    data = {
        "figures": {name: [_panel(name, panel, values, pool) for panel in one.panels] for name, one in figures.items()},
        "values": {name: pool.curve(one) for name, one in values.items()},
        "designs": None if designs is None else _designs(designs, pool, write),
    }
    return json.dumps({**data, "arrays": pool.texts}, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")


def _panel(figure: str, panel: Panel, values: Mapping[str, CurveValues], pool: _Pool) -> dict[str, Any]:
    """A panel as the script reads it, with the identifiers of the page."""
    return {
        "id": f"{figure}-{panel.id}",
        "title": escaped(panel.title, lines=True),
        "box": [round(end, 2) for end in panel.box],
        "x": vars(panel.x),
        "y": vars(panel.y),
        "anchors": [[f"{figure}-{text}", *moves] for text, *moves in panel.anchors],
        "curves": [_curve(figure, curve, values, pool) for curve in panel.curves],
    }


def _curve(figure: str, curve: Curve, values: Mapping[str, CurveValues], pool: _Pool) -> dict[str, Any]:
    """A curve as the script reads it, without data if the results have its values."""
    fields = {name: escaped(getattr(curve, name), lines=True) for name in ("kind", "label", "name", "color")}
    own = () if "/".join(curve.name.split("/")[:2]) in values else ("x", "y", "top")
    return {
        **fields,
        "id": f"{figure}-{curve.id}",
        **{name: pool.place(np.frombuffer(getattr(curve, name))) for name in own},
    }


def _designs(every: PageDesigns, pool: _Pool, write: Callable[[Block], str]) -> dict[str, Any]:
    """The data of the sliders, with a list entry per design, and distances with as many digits as figures show."""
    return {
        "axes": [vars(axis) for axis in every.axes],
        "curves": {
            name: [pool.curve(design.curves[name])[1:4] for design in every.designs] for name in every.designs[0].curves
        },
        "usable": [
            {camera: [[_short(near), _short(far)] for near, far in found] for camera, found in design.usable.items()}
            for design in every.designs
        ],
        "best": [[[_short(start), _short(end), names] for start, end, names in one.best] for one in every.designs],
        "blocks": [{name: write(block) for name, block in design.blocks.items()} for design in every.designs],
    }


def _short(distance: float) -> float:
    return float(f"{min(distance, _FARTHEST):.5g}")  # JSON has no infinity


def _displayed_alike(values: FloatArray) -> npt.NDArray[np.float32]:
    """Single floats that the script writes with the same digits as the doubles; near a tie, the rounded number."""
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        single = values.astype("<f4")
        digits = np.abs(values) / 10.0 ** (np.floor(np.log10(np.abs(values))) - (_DIGITS - 1))
        close = np.flatnonzero(np.abs(digits % 1.0 - 0.5) < _NEAR_TIE)
    single[close] = [float(f"{value:.{_DIGITS - 1}e}") for value in values[close].tolist()]
    return single
