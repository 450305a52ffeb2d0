"""How a kind of camera measures depth from its pictures, in words and equations for reports."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Formula:
    """An equation.

    Parameters
    ----------
    typst
        The equation in typst's mathematics.
    alt
        The equation as one would read it aloud.
    reference
        Publication; empty for equations derived in this program.
    """

    typst: str
    alt: str
    reference: str = ""


@dataclass(frozen=True, kw_only=True)
class Method:
    """The method of a kind of camera.

    Parameters
    ----------
    name
        Anchor of the report's section: short, in letters and hyphens.
    title
        Title of the section.
    statements
        Paragraphs, in the light markup of reports, and equations, in reading order.
    matching
        Paragraphs and equations on the pictures that are compared, where the disparity error is derived from them.
    baseline_note
        Why the equivalent baseline of such a camera can differ from the declared one; empty where it cannot.
    """

    name: str
    title: str
    statements: tuple[str | Formula, ...]
    matching: tuple[str | Formula, ...] = ()
    baseline_note: str = ""
