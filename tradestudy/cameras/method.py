"""How depth follows from the pictures of a kind of camera, in words and equations that a report sets."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Formula:
    """An equation.

    Parameters
    ----------
    typst
        In the mathematics of typst.
    alt
        Read aloud.
    reference
        Where it is published; empty for a derivation of our own.
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
        Short, in letters and hyphens: what the report's section is linked by.
    title
        Of the section.
    statements
        Paragraphs, in the light markup of reports, and equations, in reading order.
    baseline_note
        Why the equivalent baseline of such a camera may differ from the declared one; empty where it cannot.
    """

    name: str
    title: str
    statements: tuple[str | Formula, ...]
    baseline_note: str = ""
