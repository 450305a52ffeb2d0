"""A document as one HTML file: styles, figures and equations inside, no script, nothing fetched."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping
from dataclasses import dataclass

import jinja2
import markupsafe

from tradestudy.report.document import Equation, Heading, Report, all_blocks, spans
from tradestudy.report.typesetting import template, typeset

_EQUATION_TEXT_SIZE_PT = 11.0  # as in templates/equations.typ


@dataclass(frozen=True, kw_only=True)
class _DrawnEquation:
    uri: str
    width_em: str


def render_html(document: Report, pictures: Mapping[str, bytes]) -> bytes:
    """Write a document as HTML.

    Figures and equations are images of their own (data URIs), so identifiers inside them cannot collide.

    Parameters
    ----------
    document
        What to say.
    pictures
        SVG bytes of every figure that the document shows, by name.
    """
    blocks = tuple(all_blocks(document.blocks))
    drawn = _drawn_equations(tuple(block for block in blocks if isinstance(block, Equation)))
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, keep_trailing_newline=True)
    page = environment.from_string(template("report.html.jinja")).render(
        document=document,
        numbers=document.numbers,
        headings=[block for block in blocks if isinstance(block, Heading)],
        style=markupsafe.Markup(template("report.css")),
        spans=spans,
        zip=zip,
        equation=drawn.__getitem__,
        picture_uri=lambda name: _data_uri(pictures[name]),
    )
    return page.encode()


def _data_uri(svg: bytes) -> str:
    return "data:image/svg+xml;base64," + base64.b64encode(svg).decode()


def _drawn_equations(equations: tuple[Equation, ...]) -> dict[Equation, _DrawnEquation]:
    """Every equation drawn once by the typesetter of the PDF, so that both formats show the same."""
    if not equations:
        return {}
    pages = typeset("equations.typ", {"equations": [vars(one) for one in equations]}, "svg")
    return {one: _drawn(page) for one, page in zip(equations, pages, strict=True)}


def _drawn(svg: bytes) -> _DrawnEquation:
    width = re.search(rb'width="([\d.]+)pt"', svg)
    if width is None:
        raise ValueError("the typesetter gave an equation without a width")
    return _DrawnEquation(uri=_data_uri(svg), width_em=f"{float(width[1]) / _EQUATION_TEXT_SIZE_PT:.3f}")
