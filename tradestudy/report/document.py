"""The content of a report before it becomes HTML or PDF: frozen blocks of text, tables, figures and equations.

A plain ``str`` is always literal text; only :func:`say` reads markup, and only from its template. Therefore nothing
that comes from a study file can turn into markup or code in any output format.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from string import ascii_uppercase
from typing import Literal, LiteralString

from tradestudy.errors import escaped
from tradestudy.figures.drawing import Drawing, ValueTable
from tradestudy.wording import with_unit_symbols

SpanStyle = Literal["plain", "strong", "emphasis", "code", "sub", "sup", "link"]
Tone = Literal["answer", "note", "warning"]
Align = Literal["left", "right", "center"]


@dataclass(frozen=True)
class Span:
    """Literal text in one style; a link points to the anchor or the figure named by `target`."""

    text: str
    style: SpanStyle = "plain"
    target: str = ""


Spans = tuple[Span, ...]
Text = str | Spans

_MARKUP = re.compile(
    r"\*\*(?P<strong>.+?)\*\*|\*(?P<emphasis>.+?)\*|`(?P<code>.+?)`|~(?P<sub>.+?)~|\^(?P<sup>.+?)\^"
    r"|\[(?P<link>.*?)\]\(#(?P<target>[\w.-]+)\)"
)
_PLACE = re.compile(r"\{(\w+)\}")
_BEFORE_UNIT = re.compile(r"(?<=[\d∞]) (?=(?:[nµmck]?m|[mµ]?s|min|h|[mk]?g|m?W|px|ppm|%)(?!\w))")


def literal(text: str) -> str:
    """Make text safe for every output format: control characters are escaped, and line ends become a space.

    Units are typeset: "0.2 deg" becomes "0.2°", and no line breaks between a number and its unit.
    """
    text = escaped(re.sub(r"[\r\n\t]+", " ", text))
    return _BEFORE_UNIT.sub("\N{NO-BREAK SPACE}", with_unit_symbols(text))


def spans(text: Text) -> Spans:
    """Turn text into spans; a plain string becomes one literal span."""
    return (Span(literal(text)),) if isinstance(text, str) else text


_SYMBOL = re.compile(r"(?<!\w)([^\W\d_])_(\w+)")


def with_subscripts(text: str) -> Spans:
    """Give symbols such as ``b_L`` subscripts."""
    parts = _SYMBOL.split(literal(text))
    # The pattern has two groups, so the parts are text, symbol and subscript in turn.
    styles: tuple[SpanStyle, ...] = ("plain", "emphasis", "sub")
    return tuple(Span(part, styles[index % 3]) for index, part in enumerate(parts) if part)


def plain_text(text: Text) -> str:
    """Reduce text to plain characters for a terminal: no styles, no no-break spaces."""
    return "".join(span.text for span in spans(text)).replace("\N{NO-BREAK SPACE}", " ")


def say(template: LiteralString, **values: Text) -> Spans:
    """Read light markup from `template`, and insert `values` at its ``{places}`` as literal text.

    ``**strong**``, ``*emphasis*``, ```code```, ``~subscript~``, ``^superscript^`` and ``[text](#target)``; an
    empty link text is replaced by the number of the figure or table (``Figure 3``) when the document is rendered.

    Parameters
    ----------
    template
        Text by the program's authors, never from a file.
    **values
        Literal strings, or spans from another call.

    Raises
    ------
    KeyError
        If the template names a place that has no value.
    """
    return tuple(_parsed(template, values))


def _parsed(template: str, values: Mapping[str, Text]) -> Iterator[Span]:
    position = 0
    for match in _MARKUP.finditer(template):
        yield from _filled(template[position : match.start()], "plain", "", values)
        style: SpanStyle = next(s for s in _STYLES if match[s] is not None)
        yield from _filled(match[style], style, match["target"] or "", values)
        if style == "link" and not match["link"]:
            yield Span("", "link", match["target"])
        position = match.end()
    yield from _filled(template[position:], "plain", "", values)


_STYLES: tuple[SpanStyle, ...] = ("strong", "emphasis", "code", "sub", "sup", "link")


def _filled(template: str, style: SpanStyle, target: str, values: Mapping[str, Text]) -> Iterator[Span]:
    # Every second part is the name of a place.
    for index, part in enumerate(_PLACE.split(template)):
        if index % 2:
            value = values[part]
            yield from (Span(literal(value), style, target),) if isinstance(value, str) else value
        elif part:
            yield Span(_BEFORE_UNIT.sub("\N{NO-BREAK SPACE}", part), style, target)


@dataclass(frozen=True, kw_only=True)
class Heading:
    """A numbered heading; `anchor` is unique in the document."""

    text: Text
    anchor: str
    level: int = 1


@dataclass(frozen=True)
class Paragraph:
    """A paragraph."""

    text: Text


@dataclass(frozen=True)
class Bullets:
    """A list of short items."""

    items: tuple[Text, ...]


@dataclass(frozen=True, kw_only=True)
class Callout:
    """A box that stands out from the text around it: the answer, a note, or a warning.

    `name` identifies a box that differs between the designs of a sweep.
    """

    title: Text
    blocks: tuple[Block, ...]
    tone: Tone = "note"
    name: str = ""


@dataclass(frozen=True, kw_only=True)
class Column:
    """A column of a table; one of `weight` 0 is as wide as its content, the others share the rest by weight."""

    title: Text
    unit: str = ""
    align: Align = "left"
    weight: int = 0


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table with a caption above and notes below; a row of one cell is a heading for the rows that follow."""

    name: str
    caption: Text
    columns: tuple[Column, ...]
    rows: tuple[tuple[Text, ...], ...]
    notes: tuple[Text, ...] = ()

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) not in (1, len(self.columns)):
                raise ValueError(f"table {self.name}: a row has {len(row)} cells, not {len(self.columns)}")


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure of the run, by name; `alt` says in words, and `values` in numbers, what it shows."""

    name: str
    caption: Text
    alt: str
    values: tuple[ValueTable, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Equation:
    """A displayed equation in Typst's mathematical notation; `alt` is the equation as read aloud."""

    typst: str
    alt: str
    reference: str = ""


@dataclass(frozen=True)
class Contents:
    """The place of the table of contents in print; HTML shows it beside the text."""


@dataclass(frozen=True)
class PageBreak:
    """A new page in print."""


@dataclass(frozen=True)
class Appendices:
    """The start of the sections for specialists, which have letters as numbers and, in print, begin on a new page."""


Block = Heading | Paragraph | Bullets | Callout | Table | Picture | Equation | Contents | PageBreak | Appendices


@dataclass(frozen=True, kw_only=True)
class Report:
    """A whole report, opened by its `headline`, the answer in one sentence."""

    title: str
    subtitle: str
    blocks: tuple[Block, ...]
    headline: str = ""
    numbers: Mapping[str, str] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "numbers", _numbered(self.blocks))


def all_blocks(blocks: tuple[Block, ...]) -> Iterator[Block]:
    """All blocks in reading order, including those inside callouts."""
    for block in blocks:
        yield block
        if isinstance(block, Callout):
            yield from all_blocks(block.blocks)


def _numbered(blocks: tuple[Block, ...]) -> dict[str, str]:
    """The number of each heading, figure and table, by name; no name may occur twice."""
    numbers: dict[str, str] = {}
    section = [0, 0, 0]
    figures = tables = 0
    lettered = False
    for block in all_blocks(blocks):
        match block:
            case Heading():
                section[block.level - 1] += 1
                section[block.level :] = [0] * (len(section) - block.level)
                first = ascii_uppercase[section[0] - 1] if lettered else str(section[0])
                name, number = block.anchor, ".".join([first, *map(str, section[1 : block.level])])
            case Picture():
                figures += 1
                name, number = block.name, f"Figure {figures}"
            case Table():
                tables += 1
                name, number = block.name, f"Table {tables}"
            case Appendices():
                section, lettered = [0, 0, 0], True
                continue
            case _:
                continue
        if name in numbers:
            raise ValueError(f"two parts of the report are called {name!r}")
        numbers[name] = number
    return numbers


def pictures_of(drawings: Mapping[str, Drawing], *names: str) -> Iterator[Picture]:
    """Show the figures with these names, in this order, except those that the run does not have."""
    for name in names:
        if name in drawings:
            shown = drawings[name]
            yield Picture(name=name, caption=shown.caption, alt=shown.alt, values=shown.values())
