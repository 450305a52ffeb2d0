"""A document as one HTML file, which contains all styles, scripts, figures and equations."""

from __future__ import annotations

import base64
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from html import escape
from typing import Final

import jinja2
import markupsafe
import rjsmin

from tradestudy.errors import escaped
from tradestudy.figures.drawing import Plotted
from tradestudy.report.document import Equation, Heading, Picture, Report, all_blocks, spans
from tradestudy.report.page_data import CurveValues, PageDesigns, page_data
from tradestudy.report.pdf import template, typeset

_BEGINNING: Final = re.compile(r'.*?<svg[^>]*?viewBox="([^"]*)"[^>]*>', re.DOTALL)
_UNSEEN: Final = re.compile(r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->", re.DOTALL)
_NUMBER: Final = re.compile(r"(\d\.\d\d)\d+")
_PLACES: Final = re.compile(r'\b(?:d|x|y)="[^"]*"')
_GLYPH: Final = re.compile(r'<path id="(DejaVu[^"]*)"[^>]*/>')
_NAMED: Final = re.compile(r'(\bid="|href="#|url\(#)(?!DejaVu)')
_COLOR: Final = re.compile(r"#([0-9a-f]{6})\b")
_BETWEEN: Final = re.compile(r">\s+<")
_EMPTY: Final = re.compile(r"<defs>\s*</defs>")


def inlined(svg: bytes, name: str, alt: str, colors: Collection[str], letters: set[str]) -> str:
    """Prepare the SVG of a figure for use inside HTML.

    Parameters
    ----------
    svg
        The figure as matplotlib writes it.
    name
        Prefix that makes the identifiers of several figures differ.
    alt
        What the figure shows, in words.
    colors
        Colours (``0072b2``) for which the style sheet has a variable (``--c0072b2``); others stay as they are.
    letters
        Outlines of letters in earlier figures of the page, which this one uses again; its own are added.
    """
    text = svg.decode()
    start = _BEGINNING.match(text)
    if start is None:
        raise ValueError(f"figure {name} is not an SVG with a viewBox")
    text = _UNSEEN.sub("", text[start.end() :]).replace("xlink:href", "href")
    # Figures of a page share the outlines of letters; all other identifiers get the name of their figure.
    text = _GLYPH.sub(lambda match: _once(match[0], match[1], letters), text)
    text = _NAMED.sub(lambda match: f"{match[1]}{name}-", text)
    text = _PLACES.sub(lambda match: _NUMBER.sub(r"\1", match[0]).replace("\n", ""), text)
    text = _COLOR.sub(lambda match: f"var(--c{match[1]})" if match[1] in colors else match[0], text)
    text = _EMPTY.sub("", _BETWEEN.sub("><", text))
    return f'<svg viewBox="{start[1]}" role="img" aria-label="{escape(alt)}">{text}'


def _once(path: str, letter: str, letters: set[str]) -> str:
    if letter in letters:
        return ""
    letters.add(letter)
    return path


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


def _drawn_equations(equations: tuple[Equation, ...]) -> dict[Equation, _DrawnEquation]:
    """Draw every equation once, with the typesetter of the PDF, so that both formats look the same."""
    if not equations:
        return {}
    pages = typeset("equations.typ", {"equations": [vars(equation) for equation in equations]}, "svg")
    return {equation: _drawn(page) for equation, page in zip(equations, pages, strict=True)}


def _drawn(svg: bytes) -> _DrawnEquation:
    width = re.search(rb'width="([\d.]+)pt"', svg)
    if width is None:
        raise ValueError("the typesetter returned an equation without a width")
    return _DrawnEquation(
        uri=f"data:image/svg+xml;base64,{base64.b64encode(svg).decode()}",
        width_em=f"{float(width[1]) / _EQUATION_TEXT_SIZE_PT:.3f}",
    )
