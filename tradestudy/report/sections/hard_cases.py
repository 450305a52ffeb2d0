"""Hard cases, where formulas break down: the usual formula against that of this program."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import (
    Block,
    Callout,
    Column,
    Heading,
    Paragraph,
    Spans,
    Table,
    Text,
    pictures_of,
    say,
    with_subscripts,
)
from tradestudy.results.views.groups import records
from tradestudy.units import significant

_EXPONENT = re.compile(r"\b\d+\.?\d*e[-+]?\d+\b")
_FLOAT = re.compile(r"-?\b(?:\d+\.?\d*(?:e[-+]\d+)?|inf|nan)\b")


def describe_hard_cases(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write the verdict, the figure and, for each family, tables of the cases answered by numbers and by words."""
    rows = records(tree, "hard_cases", "case")
    if not rows:
        return
    yield Heading(text="Hard cases", anchor="hard-cases")
    yield Callout(
        title="Where formulas break down",
        blocks=(Paragraph(_verdict(rows)),),
        tone="answer" if all(row["met"] for row in rows) else "warning",
    )
    yield Paragraph(
        say(
            "Each case is computed with the usual formula and with the functions of this program, and both results are "
            "compared with one computed in 30-digit arithmetic. The bound on the relative error is 10^−12^. It is "
            "larger where the condition number κ magnifies rounding: 10 κ ε, with the machine epsilon ε. It is also "
            "larger where the program states a numerical error: that error, or six standard errors of a sampled value. "
            "κ is not used where it is infinite, or where the program computes the ill-conditioned step without "
            "rounding. A result without a finite relative error is “wrong”, and the result itself follows. One ulp is "
            "the distance between neighbouring floating-point numbers. Equation numbers are those of “Diffraction "
            "model of a plenoptic camera for in-situ space exploration”."
        )
    )
    yield from pictures_of(drawings, "hard_cases")
    for family in dict.fromkeys(str(row["family"]) for row in rows):
        yield from _family([row for row in rows if row["family"] == family], family)


def _verdict(rows: list[dict[str, Any]]) -> Spans:
    numbers = [row for row in rows if not row["outcome"]]
    beyond = sum(not row["naive_error"] <= row["bound"] for row in numbers)
    wrong = [str(row["case"]) for row in rows if not row["met"]]
    return say(
        "**The program gets {met} hard cases right.** In {beyond} of the {numbers} whose answer is a number, the "
        "error of the usual formula exceeds the bound.{wrong}",
        met=f"{len(rows) - len(wrong)} of {len(rows)}" if wrong else f"all {len(rows)}",
        numbers=str(len(numbers)),
        beyond=str(beyond),
        wrong=f" Not met: {'; '.join(wrong)}." if wrong else "",
    )


def _family(rows: list[dict[str, Any]], family: str) -> Iterator[Block]:
    title = str(rows[0]["family_title"])
    yield Heading(text=title, anchor=f"hard-cases-{family}", level=2)
    numbers, outcomes = ([row for row in rows if bool(row["outcome"]) is asked] for asked in (False, True))
    if numbers:
        yield Table(
            name=f"hard-cases-{family}-numbers",
            caption=f"{title}: relative errors of the usual formula and of this program.",
            columns=(
                Column(title="Case", weight=3),
                Column(title="Quantity", weight=3),
                Column(title="κ", align="right"),
                Column(title="Usual formula", align="right"),
                Column(title="This program", align="right"),
                Column(title="Bound", align="right"),
                Column(title="Verdict"),
            ),
            rows=tuple(
                (
                    _name(row),
                    with_subscripts(str(row["law"])),
                    _number(row["condition_number"]),
                    _wrong(row["naive_error"], str(row["naive_answer"])),
                    _wrong(row["our_error"], str(row["our_answer"])),
                    _number(row["bound"]),
                    _met(row),
                )
                for row in numbers
            ),
        )
    if outcomes:
        yield Table(
            name=f"hard-cases-{family}-outcomes",
            caption=f"{title}: cases whose correct answer is not a number.",
            columns=(
                Column(title="Case", weight=2),
                Column(title="Correct", weight=2),
                Column(title="Plain YAML reader" if family == "study-files" else "Usual formula", weight=3),
                Column(title="This program", weight=4),
                Column(title="Verdict"),
            ),
            rows=tuple(
                (
                    _name(row),
                    str(row["law"]),
                    _answer(str(row["naive_answer"])),
                    _answer(str(row["our_answer"])),
                    _met(row),
                )
                for row in outcomes
            ),
        )


def _name(row: Mapping[str, Any]) -> str:
    name = str(row["case"]).removeprefix(f"{row['family']}: ")
    return _EXPONENT.sub(lambda found: found[0] if np.isinf(float(found[0])) else _number(float(found[0])), name)


def _met(row: Mapping[str, Any]) -> Text:
    return "met" if row["met"] else say("**not met**")


def _wrong(error: float, answer: str) -> str:
    """Write an error, or the answer itself if its error is not finite."""
    return f"wrong: {_answer(answer)}" if np.isinf(error) else _number(error)


def _answer(text: str) -> str:
    """Write the numbers of an answer as reports do; a refusal stays as it is, because it quotes its input."""
    return text if text.startswith("refused: ") else _FLOAT.sub(lambda found: _number(float(found[0])), text)


def _number(value: float) -> str:
    return "NaN" if np.isnan(value) else significant(value, 3 if 1.0 <= value < 1e4 else 2)
