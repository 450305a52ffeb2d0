"""A document as PDF: A4, vector figures, tagged for screen readers, the same bytes every time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tradestudy.figures.fonts import printable
from tradestudy.report.document import (
    Block,
    Bullets,
    Callout,
    Heading,
    Picture,
    Report,
    Table,
    Text,
    spans,
)
from tradestudy.report.typesetting import typeset

Json = dict[str, Any]


def render_pdf(document: Report, pictures: Mapping[str, bytes]) -> bytes:
    """Typeset a document.

    Parameters
    ----------
    document
        The content.
    pictures
        SVG bytes of every figure that the document shows, by name.

    Returns
    -------
    bytes
        A PDF/UA-1 file without dates; equal inputs give equal bytes.
    """
    content = {
        "title": printable(document.title),
        "subtitle": printable(document.subtitle),
        "blocks": [_block(block, document.numbers) for block in document.blocks],
    }
    inputs: dict[str, object] = {"document": content}
    inputs |= {f"picture:{name}": svg.decode() for name, svg in pictures.items()}
    return typeset("report.typ", inputs, "pdf")[0]


def _text(text: Text, numbers: Mapping[str, str]) -> list[Json]:
    return [
        {
            "text": printable(span.text or numbers.get(span.target, "").replace(" ", "\N{NO-BREAK SPACE}")),
            "style": span.style,
            "target": span.target,
        }
        for span in spans(text)
    ]


def _block(block: Block, numbers: Mapping[str, str]) -> Json:
    content: Json = {"kind": type(block).__name__}
    match block:
        case Callout():
            inner = [_block(one, numbers) for one in block.blocks]
            content |= {"title": _text(block.title, numbers), "blocks": inner, "tone": block.tone}
        case Bullets():
            content["items"] = [_text(item, numbers) for item in block.items]
        case Table():
            content |= {
                "name": block.name,
                "number": numbers[block.name],
                "caption": _text(block.caption, numbers),
                "columns": [
                    vars(one) | {"title": _text(one.title, numbers), "unit": printable(one.unit)}
                    for one in block.columns
                ],
                "rows": [[_text(cell, numbers) for cell in row] for row in block.rows],
                "notes": [_text(note, numbers) for note in block.notes],
            }
        case Picture():
            content |= {
                "name": block.name,
                "number": numbers[block.name],
                "caption": _text(block.caption, numbers),
                "alt": printable(block.alt),
            }
        case Heading():
            content |= vars(block) | {"number": numbers[block.anchor], "text": _text(block.text, numbers)}
        case _:
            content |= vars(block)
            if "text" in content:
                content["text"] = _text(content["text"], numbers)
    return content
