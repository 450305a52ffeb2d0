"""A document as PDF: A4, vector figures, tagged for screen readers, the same bytes every time."""

from __future__ import annotations

import functools
import importlib.resources
import json
from collections.abc import Mapping
from typing import Any, Final, Literal

import typst

from tradestudy.errors import TradestudyError
from tradestudy.figures.fonts import font_folder, printable
from tradestudy.report.document import Block, Bullets, Callout, Heading, Picture, Report, Table, Text, spans

PDF_STANDARD: Final = "ua-1"  # accessible PDF: tagged, with alternative texts for all figures and equations


def template(name: str) -> str:
    """The text of a template of this package."""
    return importlib.resources.files("tradestudy.report").joinpath("templates", name).read_text(encoding="utf-8")


@functools.cache
def _fonts() -> typst.Fonts:
    return typst.Fonts(include_system_fonts=False, font_paths=[font_folder()])


def typeset(name: str, inputs: Mapping[str, object], output: Literal["pdf", "svg"]) -> list[bytes]:
    """Compile a template with data: strings as they are, anything else as JSON.

    Returns
    -------
    list of bytes
        One PDF, or one SVG per page.

    Raises
    ------
    TradestudyError
        If the typesetter refuses the document; this is a defect of the program, not of a study.
    """
    data = {key: value if isinstance(value, str) else json.dumps(value) for key, value in inputs.items()}
    compiler = typst.Compiler(input=template(name).encode(), font_paths=_fonts(), sys_inputs=data)
    try:
        result = compiler.compile(format=output, pdf_standards=PDF_STANDARD if output == "pdf" else [])
    except typst.TypstError as error:
        raise TradestudyError(f"the typesetter refused {name}", value=error.message) from error
    if result is None:
        raise TradestudyError(f"the typesetter returned nothing for {name}")
    return result if isinstance(result, list) else [result]


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
        "headline": printable(document.headline),
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
            inner = [_block(child, numbers) for child in block.blocks]
            content |= {"title": _text(block.title, numbers), "blocks": inner, "tone": block.tone}
        case Bullets():
            content["items"] = [_text(item, numbers) for item in block.items]
        case Table():
            content |= {
                "name": block.name,
                "number": numbers[block.name],
                "caption": _text(block.caption, numbers),
                "columns": [
                    vars(column) | {"title": _text(column.title, numbers), "unit": printable(column.unit)}
                    for column in block.columns
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
