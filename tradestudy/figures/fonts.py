"""The font of all figures and reports, and the characters that it has."""

from __future__ import annotations

import functools
from pathlib import Path

from matplotlib import font_manager, ft2font

from tradestudy.errors import escaped


def font_folder() -> str:
    """The folder with the font."""
    return str(_font_file().parent)


def _font_file() -> Path:
    return Path(font_manager.findfont("DejaVu Sans", fallback_to_default=False))


@functools.cache
def _characters() -> frozenset[int]:
    return frozenset(ft2font.FT2Font(str(_font_file())).get_charmap())


def printable(text: str) -> str:
    """Text with control characters escaped, and others that the font lacks as code points, ``⟨U+65E5⟩``."""
    characters = _characters()
    shown = escaped(text, lines=True)
    return "".join(letter if ord(letter) in characters else f"⟨U+{ord(letter):04X}⟩" for letter in shown)
