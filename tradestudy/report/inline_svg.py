"""A figure's SVG as part of a page: with its own identifiers, colours that follow the page, and nothing invisible."""

from __future__ import annotations

import re
from collections.abc import Collection
from html import escape
from typing import Final

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
    text = _GLYPH.sub(lambda found: _once(found[0], found[1], letters), text)
    text = _NAMED.sub(lambda found: f"{found[1]}{name}-", text)
    text = _PLACES.sub(lambda found: _NUMBER.sub(r"\1", found[0]).replace("\n", ""), text)
    text = _COLOR.sub(lambda found: f"var(--c{found[1]})" if found[1] in colors else found[0], text)
    text = _EMPTY.sub("", _BETWEEN.sub("><", text))
    return f'<svg viewBox="{start[1]}" role="img" aria-label="{escape(alt)}">{text}'


def _once(path: str, letter: str, letters: set[str]) -> str:
    if letter in letters:
        return ""
    letters.add(letter)
    return path
