"""A document as one HTML file, which contains all styles, scripts, figures and equations."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import jinja2
import markupsafe
import rjsmin

from tradestudy.errors import escaped
from tradestudy.figures.drawing import Plotted
from tradestudy.report.curve_values import CurveValues
from tradestudy.report.designs import PageDesigns
from tradestudy.report.document import Equation, Heading, Picture, Report, all_blocks, spans
from tradestudy.report.inline_svg import inlined
from tradestudy.report.page_data import page_data
from tradestudy.report.typesetting import template, typeset

SCRIPTS: Final = ("numbers.js", "panels.js", "figures.js", "tables.js", "designs.js", "contents.js")
_EQUATION_TEXT_SIZE_PT = 11.0  # as in templates/equations.typ
_COLOR_VARIABLE = re.compile(r"--c([0-9a-f]{6}):")


@dataclass(frozen=True, kw_only=True)
class _DrawnEquation:
    uri: str
    width_em: str


def render_html(
    document: Report,
    pictures: Mapping[str, Plotted],
    values: Mapping[str, CurveValues] | None = None,
    designs: PageDesigns | None = None,
) -> bytes:
    """Write a document as HTML.

    Figures are part of the page, each with its own identifiers; equations are images (data URIs).

    Parameters
    ----------
    document
        The content.
    pictures
        Every figure that the document shows, by name.
    values
        Results behind curves of the figures, by the name of the curve.
    designs
        The designs of a sweep, for the reader to step through.
    """
    blocks = tuple(all_blocks(document.blocks))
    drawn = _drawn_equations(tuple(block for block in blocks if isinstance(block, Equation)))
    style = template("report.css")
    colors, letters = frozenset(_COLOR_VARIABLE.findall(style)), set[str]()
    shown = {block.name: pictures[block.name] for block in blocks if isinstance(block, Picture)}
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(template),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=lambda value: escaped(value, lines=True) if type(value) is str else value,
    )
    environment.globals.update(
        numbers=document.numbers,
        spans=spans,
        zip=zip,
        equation=drawn.__getitem__,
        picture=lambda block: markupsafe.Markup(
            inlined(pictures[block.name].svg, block.name, escaped(block.alt), colors, letters)
        ),
    )
    write = environment.get_template("blocks.html.jinja").module.render  # type: ignore[attr-defined]  # a macro
    page = environment.get_template("report.html.jinja").render(
        document=document,
        headings=[block for block in blocks if isinstance(block, Heading)],
        style=markupsafe.Markup(style),
        script=markupsafe.Markup(script()),
        data=markupsafe.Markup(page_data(shown, values or {}, designs, write)),
    )
    return page.encode()


def script() -> str:
    """The script of a page: its parts in one scope, without comments and needless spaces."""
    return str(rjsmin.jsmin("(() => {" + "\n".join(map(template, SCRIPTS)) + "})();"))


def _data_uri(svg: bytes) -> str:
    return "data:image/svg+xml;base64," + base64.b64encode(svg).decode()


def _drawn_equations(equations: tuple[Equation, ...]) -> dict[Equation, _DrawnEquation]:
    """Draw every equation once, with the typesetter of the PDF, so that both formats look the same."""
    if not equations:
        return {}
    pages = typeset("equations.typ", {"equations": [vars(one) for one in equations]}, "svg")
    return {one: _drawn(page) for one, page in zip(equations, pages, strict=True)}


def _drawn(svg: bytes) -> _DrawnEquation:
    width = re.search(rb'width="([\d.]+)pt"', svg)
    if width is None:
        raise ValueError("the typesetter returned an equation without a width")
    return _DrawnEquation(uri=_data_uri(svg), width_em=f"{float(width[1]) / _EQUATION_TEXT_SIZE_PT:.3f}")
