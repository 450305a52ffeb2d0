"""The typesetter: Typst with its own fonts and one more, but none of the machine's, for the same result everywhere."""

from __future__ import annotations

import functools
import importlib.resources
import json
from collections.abc import Mapping
from typing import Final, Literal

import typst

from tradestudy.errors import TradestudyError
from tradestudy.figures.fonts import font_folder

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
