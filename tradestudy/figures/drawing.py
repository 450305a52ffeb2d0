"""A figure that can be drawn: its name, what it shows in words, and how to draw it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tradestudy.figures.style import StudyFigure


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """One figure of a report.

    Parameters
    ----------
    name
        Of the file and of references to it.
    caption
        What is drawn and how to read it. Literal text.
    alt
        What a person who sees the figure would notice, with its numbers. Literal text.
    draw
        Makes the figure.
    """

    name: str
    caption: str
    alt: str
    draw: Callable[[], StudyFigure]
