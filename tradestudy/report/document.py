"""What a report says, before it is HTML or PDF: frozen blocks of text, tables, figures and equations.

A plain ``str`` is always literal text, whoever wrote it; only :func:`say` reads markup, and only from its
template. So nothing that comes from a study file can turn into markup or code in any output format.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from string import ascii_uppercase
from typing import Literal, LiteralString

from tradestudy.figures.drawing import Drawing, ValueTable
from tradestudy.wording import with_unit_symbols

SpanStyle = Literal["plain", "strong", "emphasis", "code", "sub", "sup", "link"]
Tone = Literal["answer", "note", "warning"]
Align = Literal["left", "right", "center"]


@dataclass(frozen=True)
class Span:
    """A run of literal text in one style; a link points to the anchor or the figure named by `target`."""

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
# Characters that XML forbids, and direction overrides that could make a name read as something else.
_FORBIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]")
_BEFORE_UNIT = re.compile(r"(?<=[\d∞]) (?=(?:[nµmck]?m|[mµ]?s|min|h|[mk]?g|m?W|px|ppm|%)(?!\w))")


def literal(text: str) -> str:
    """Text safe to carry in any output format: forbidden characters become U+FFFD, line ends a space.

    Units are typeset: "0.2 deg" becomes "0.2°", and no line breaks between a number and its unit.
    """
    text = _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", re.sub(r"[\r\n\t]+", " ", text))
    return _BEFORE_UNIT.sub("\N{NO-BREAK SPACE}", with_unit_symbols(text))


def spans(text: Text) -> Spans:
    """Text as spans; a plain string is one literal span."""
    return (Span(literal(text)),) if isinstance(text, str) else text


_SYMBOL = re.compile(r"(?<!\w)([^\W\d_])_(\w+)")


def with_subscripts(text: str) -> Spans:
    """Text in which symbols such as ``b_L`` have subscripts."""
    parts = _SYMBOL.split(literal(text))
    styles: tuple[SpanStyle, ...] = ("plain", "emphasis", "sub")
    return tuple(Span(part, styles[place % 3]) for place, part in enumerate(parts) if part)


def plain_text(text: Text) -> str:
    """Text alone, for a terminal: no styles, no spaces that do not break."""
    return "".join(span.text for span in spans(text)).replace("\N{NO-BREAK SPACE}", " ")


def say(template: LiteralString, **values: Text) -> Spans:
    """Read light markup from `template` and put `values` into its ``{places}`` as literal text.

    ``**strong**``, ``*emphasis*``, ```code```, ``~subscript~``, ``^superscript^`` and ``[text](#target)``; an
    empty link text is replaced by the number of the figure or table (``Figure 3``) when the document is rendered.

    Parameters
    ----------
    template
        Written by the program's authors, never taken from a file.
    **values
        Literal strings, or spans made by another call.

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
    for index, part in enumerate(_PLACE.split(template)):
        if index % 2:
            value = values[part]
            yield from (Span(literal(value), style, target),) if isinstance(value, str) else value
        elif part:
            yield Span(part, style, target)


@dataclass(frozen=True, kw_only=True)
class Heading:
    """A numbered section heading; `anchor` is unique in the document."""

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
    """A table column; `weight` 0 takes the width that its content needs, others share the rest."""

    title: Text
    unit: str = ""
    align: Align = "left"
    weight: int = 0


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table with a caption above it and notes below; a row of one cell is a heading over the rows that follow."""

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
    """A figure of the run, shown by its name; `alt` says in words what a reader would see, `values` in numbers."""

    name: str
    caption: Text
    alt: str
    values: tuple[ValueTable, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Equation:
    """A displayed equation in Typst's mathematical notation; `alt` reads it aloud."""

    typst: str
    alt: str
    reference: str = ""


@dataclass(frozen=True)
class Contents:
    """The place of the table of contents in print (the HTML has it next to the text)."""


@dataclass(frozen=True)
class PageBreak:
    """A new page in print."""


@dataclass(frozen=True)
class Appendices:
    """The sections after this are for specialists: they begin on a new page in print and have letters for numbers."""


Block = Heading | Paragraph | Bullets | Callout | Table | Picture | Equation | Contents | PageBreak | Appendices


@dataclass(frozen=True, kw_only=True)
class Report:
    """A whole report."""

    title: str
    subtitle: str
    blocks: tuple[Block, ...]
    numbers: Mapping[str, str] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "numbers", _numbered(self.blocks))


def all_blocks(blocks: tuple[Block, ...]) -> Iterator[Block]:
    """All blocks in reading order, those inside callouts too."""
    for block in blocks:
        yield block
        if isinstance(block, Callout):
            yield from all_blocks(block.blocks)


def _numbered(blocks: tuple[Block, ...]) -> dict[str, str]:
    """The number of every heading, figure and table by its name; a name that occurs twice is an error."""
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
    """Show the figures of these names, in this order; those that the run does not have are left out."""
    for name in names:
        if name in drawings:
            shown = drawings[name]
            yield Picture(name=name, caption=shown.caption, alt=shown.alt, values=shown.values())
