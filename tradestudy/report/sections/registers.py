"""Lists kept with every study: assumptions, contradictions, claims, requirements, trade criteria."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from tradestudy.report import facts
from tradestudy.report.document import Block, Column, Heading, Paragraph, Table, Text, say
from tradestudy.report.facts import quantity
from tradestudy.units import significant

if TYPE_CHECKING:
    import xarray as xr

_BASES = ("assumed", "derived", "datasheet", "measured", "paper")


def assumptions(tree: xr.DataTree) -> Iterator[Block]:
    """Write the register of assumptions: every value with a basis, what is assumed first."""
    rows = facts.records(tree, "assumptions", "assumption")
    if not rows:
        return
    yield Heading(text="Assumptions", anchor="assumptions")
    counts = Counter(str(row["basis"]) for row in rows)
    known = [basis for basis in _BASES if counts[basis]] + sorted(set(counts) - set(_BASES))
    yield Paragraph(
        say(
            "Every value that does not speak for itself carries its basis: {counts}. What is assumed comes first, "
            "because a verdict can rest on it.",
            counts=", ".join(f"{counts[basis]} {basis}" for basis in known),
        )
    )
    rows.sort(key=lambda row: known.index(str(row["basis"])))
    yield Table(
        name="assumption-register",
        caption="Assumptions register.",
        columns=(
            Column(title="Basis"),
            Column(title="Where", weight=3),
            Column(title="Value", weight=2),
            Column(title="Note", weight=4),
        ),
        rows=tuple((str(r["basis"]), str(r["path"]), str(r["value"]), str(r["note"])) for r in rows),
    )


def contradictions(tree: xr.DataTree) -> Iterator[Block]:
    """List where over-determined inputs contradict each other, and which reading is used."""
    rows = facts.records(tree, "contradictions", "contradiction")
    if not rows:
        return
    yield Heading(text="Contradictions found", anchor="contradictions")
    yield Paragraph(
        "Inputs that are given more than once were checked against each other. Where they disagree, nothing was "
        "resolved silently: this is what was stated, what the other inputs imply, and what this study uses."
    )
    columns = tuple(Column(title=t, weight=2) for t in ("Camera", "What", "Stated", "Implied", "Used"))
    titles = facts.titles(tree)
    yield Table(
        name="contradiction-table",
        caption="Contradictions between inputs.",
        columns=columns,
        rows=tuple(
            (
                titles.get(str(r["camera"]), str(r["camera"])),
                *(str(r[k]) for k in ("what", "stated", "implied", "used")),
            )
            for r in rows
        ),
    )


def claims(tree: xr.DataTree) -> Iterator[Block]:
    """Answer the declared claims one by one, under every reading."""
    rows = facts.records(tree, "claims", "claim")
    if not rows:
        return
    yield Heading(text="Claims", anchor="claims")
    yield Paragraph(
        "Claims were declared in the study file, with their tolerances, before anything was computed. Nothing was "
        "tuned to meet them."
    )
    yield Table(
        name="claim-verdicts",
        caption="The claims and their verdicts.",
        columns=(
            Column(title="Claim"),
            Column(title="Says", weight=4),
            Column(title="Expected", weight=2),
            Column(title="Verdict", weight=2),
            Column(title="Why", weight=5),
        ),
        rows=tuple(
            (
                str(r["claim"]),
                _with_source(r),
                str(r["expected"]),
                say("**{v}**", v=str(r["verdict"])),
                str(r["reason"]),
            )
            for r in rows
        ),
    )
    yield from _claim_values(tree, rows)


def _with_source(row: dict[str, Any]) -> Text:
    return say("{says} *({source})*", says=str(row["says"]), source=str(row["source"]))


def _claim_values(tree: xr.DataTree, rows: list[dict[str, Any]]) -> Iterator[Block]:
    """The value of every claim under every reading."""
    data = facts.dataset(tree, "claims")
    if not {"value", "met", "unit"} <= set(map(str, data.data_vars)) or "reading" not in data["value"].dims:
        return
    readings = [str(name) for name in data["reading"].values]

    def cell(claim: Any, unit: str, reading: Any) -> Text:
        value = float(data["value"].sel(claim=claim, reading=reading))
        if np.isnan(value):
            return "—"
        met = bool(data["met"].sel(claim=claim, reading=reading))
        return say("{value} {mark}", value=quantity(value, unit), mark="✓" if met else "✗")

    yield Table(
        name="claim-values",
        caption="The value found for each claim under each reading; ✓ met, ✗ not met, — not defined there.",
        columns=(
            Column(title="Reading", weight=2),
            *(Column(title=str(row["claim"]), align="right", weight=1) for row in rows),
        ),
        rows=tuple(
            (name, *(cell(row["claim"], str(row["unit"]), reading) for row in rows))
            for name, reading in zip(readings, data["reading"].values, strict=True)
        ),
    )


def requirements(tree: xr.DataTree) -> Iterator[Block]:
    """Answer the requirements of the study, with their margins."""
    rows = facts.records(tree, "requirements", "requirement")
    if not rows:
        return
    yield Heading(text="Requirements", anchor="requirements")
    yield Table(
        name="requirement-table",
        caption="Requirements of the study; a positive margin is room to spare.",
        columns=(
            Column(title="Requirement", weight=3),
            Column(title="Met"),
            Column(title="Margin", unit="%", align="right"),
            Column(title="Margin", unit="σ", align="right"),
            Column(title="Why", weight=4),
        ),
        rows=tuple(
            (
                str(r["says"]),
                say("**{met}**", met="yes" if bool(r["met"]) else "no"),
                _margin(r["margin_percent"]),
                _margin(r["margin_sigma"]),
                str(r["reason"]),
            )
            for r in rows
        ),
    )


def _margin(value: Any) -> str:
    number = float(value)
    return "—" if np.isnan(number) else "∞" if np.isinf(number) else significant(number)


def criteria(tree: xr.DataTree) -> Iterator[Block]:
    """Compare the cameras by what is not a curve: moving parts, images per scene, data volume."""
    if not facts.has(tree, "criteria", "value"):
        return
    data, titles = facts.dataset(tree, "criteria"), facts.titles(tree)
    shown = [key for key in titles if key in data["camera"].values]
    yield Heading(text="Trade criteria that are not curves", anchor="criteria", level=2)
    yield Table(
        name="criteria-table",
        caption="Attributes of the cameras, declared or derived.",
        columns=(Column(title="Criterion", weight=2), *(Column(title=titles[key], weight=2) for key in shown)),
        rows=tuple(
            (facts.in_words(str(name)), *(str(data["value"].sel(camera=key, criterion=name).item()) for key in shown))
            for name in data["criterion"].values
        ),
    )
