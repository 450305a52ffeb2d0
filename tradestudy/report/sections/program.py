"""What was simulated and what was not, what accuracy costs in time, and how cases with known answers come out."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.accuracy import IN_WORDS, QUANTITIES
from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import (
    Block,
    Bullets,
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
from tradestudy.report.words import percent, share
from tradestudy.results.views.finding import detailed_cameras
from tradestudy.results.views.groups import group, has, records, titles_in
from tradestudy.units import DURATION, pretty, significant
from tradestudy.wording import NO_MICROLENSES, counted, distance, in_words, listed


def describe_cost(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write what accuracy costs; nothing if that was not measured."""
    if "cost" not in tree.children:
        return
    yield Heading(text="What accuracy costs", anchor="what-accuracy-costs")
    if has(tree, "depth"):
        yield Paragraph(
            say(
                "The error of a camera is the largest relative difference of its depth uncertainty from that of the "
                "most complete models (the reference), at up to nine usable distances. The notes of [](#depth-table) "
                "give the program's own estimate, which may be smaller than the error of the reference. “Linear "
                "calibration” and “exact calibration” say how calibration errors are propagated."
            )
        )
    yield Paragraph(
        "“At most” marks an error below that of the reference itself. Where nothing else is said, more complete models "
        "give the same result within the error."
    )
    yield Bullets(tuple(answers(group(tree, "cost"))))
    yield from pictures_of(drawings, "cost")


def answers(cost: xr.Dataset) -> Iterator[Spans]:
    """Say, for each camera and picture of a study, the time and error of its models and the cost of another digit."""
    for problem in cost["problem"].values:
        rows = cost.isel(entry=cost["problem_of"].values == problem)
        yield _answer(cost.sel(problem=problem), rows.drop_dims("problem").to_dataframe().to_dict("records"))


def _answer(problem: xr.Dataset, entries: list[dict[Any, Any]]) -> Spans:
    left_out = str(problem["left_out"].item()).splitlines()
    chosen = [entry for entry in entries if entry["chosen"]]
    if not chosen:
        return say("**{title}**: {why}.", title=str(problem["title"].item()), why="; ".join(left_out))
    used, error, floor = chosen[0], float(chosen[0]["relative_error"]), float(problem["reference_error"])
    finer = [entry for entry in entries if entry["next_digit"]]
    if finer:
        more = f"; ten times the accuracy takes {_seconds(finer[0])} ({finer[0]['models']})"
    elif error <= floor:
        more = ""
    else:
        more = "; no measured set of models is ten times as accurate"
    return say(
        "**{title}**: {seconds} for {models}; error {most}{error}{more}.{left_out}",
        title=str(problem["title"].item()),
        models=str(used["models"]),
        seconds=_seconds(used),
        most="at most " if error <= floor else "",
        error=percent(error),
        more=more,
        left_out=f" Left out: {listed(left_out)}." if left_out else "",
    )


def _seconds(entry: Mapping[Any, Any]) -> str:
    return pretty(float(entry["seconds"]), DURATION, digits=2)


_EXPONENT = re.compile(r"\b\d+\.?\d*e[-+]?\d+\b")
_FLOAT = re.compile(r"-?\b(?:\d+\.?\d*(?:e[-+]\d+)?|inf|nan)\b")


def describe_hard_cases(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write the verdict, how a case is judged, and the figure."""
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


def list_hard_cases(tree: xr.DataTree) -> Iterator[Block]:
    """Tabulate, for each family, the cases answered by numbers and those answered by words."""
    rows = records(tree, "hard_cases", "case")
    if rows:
        yield Heading(text="Every hard case", anchor="every-hard-case")
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
    numbers, outcomes = ([row for row in rows if bool(row["outcome"]) is in_text] for in_text in (False, True))
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
                    _case_answer(str(row["naive_answer"])),
                    _case_answer(str(row["our_answer"])),
                    _met(row),
                )
                for row in outcomes
            ),
        )


def _name(row: Mapping[str, Any]) -> str:
    case = str(row["case"]).removeprefix(f"{row['family']}: ")
    return _EXPONENT.sub(lambda match: match[0] if np.isinf(float(match[0])) else _number(float(match[0])), case)


def _met(row: Mapping[str, Any]) -> Text:
    return "met" if row["met"] else say("**not met**")


def _wrong(error: float, answer: str) -> str:
    """Write an error, or the answer itself if its error is not finite."""
    return f"wrong: {_case_answer(answer)}" if np.isinf(error) else _number(error)


def _case_answer(text: str) -> str:
    """Write the numbers of an answer as reports do; a refusal stays as it is, because it quotes its input."""
    return text if text.startswith("refused: ") else _FLOAT.sub(lambda match: _number(float(match[0])), text)


def _number(value: float) -> str:
    return "NaN" if np.isnan(value) else significant(value, 3 if 1.0 <= value < 1e4 else 2)


_HOW: Final = {
    "computed": "computed",
    "rule": "formula",
    "trial": "trial at a few distances",
}
_EVIDENCE: Final = (
    "Evidence: how the change was found. Computed: by running with and without what the model leaves out. Trial: "
    "the same, but at a few distances or places only. Formula: estimated without the more complete model. "
    "Changes found in a trial or by a formula include a safety margin."
)
_FULL: Final = "none"
_COLUMNS: Final = (
    Column(title="Effect", weight=4),
    Column(title="Model", weight=4),
    Column(title="Change", align="right", weight=3),
    Column(title="Quantity", weight=4),
    Column(title="Evidence", weight=4),
)


def describe_effects(tree: xr.DataTree) -> Iterator[Block]:
    """Write the tolerances, the models in use, and the change that all omissions cause together."""
    rows = _rows(tree)
    if not rows:
        return
    yield Heading(text="What was simulated, and what was not", anchor="effects")
    yield Paragraph(
        say(
            "Effects have several models each, from `off` to the most complete one; the tables call them by their "
            "names in study files. The program chose the cheapest models that together keep the answers within the "
            "tolerance at every distance, under every reading and, in a sweep, in every design. {together}",
            together=" ".join(_together(tree)),
        )
    )
    changing = (row for row in rows if row["chosen"] and (row["forced"] or not row["reason"]))
    matter = [row for row in changing if row["change"] > 0.0 or row["model"] != "off" or row["forced"]]
    if matter:
        yield Table(
            name="effects-that-matter",
            caption=say(
                "The model of each effect that can change an answer, and the change due to what it leaves out. "
                "`tables/effects_by_decision.csv` lists every model that was compared."
            ),
            columns=_COLUMNS,
            rows=tuple(_grouped(_detailed(tree, matter))),
            notes=(_EVIDENCE, *_nothing(tree, rows), *_further(tree, matter)),
        )
    else:
        yield from (Paragraph(say(text)) for text in _nothing(tree, rows))


def _rows(tree: xr.DataTree) -> list[dict[str, Any]]:
    """The decisions on models, each with the quantity that it changes most, relative to its tolerance."""
    rows = records(tree, "effects", "decision")
    if not rows:
        return []
    data = {variable: array.values for variable, array in group(tree, "effects").variables.items()}
    problems = list(map(str, data["problem"]))
    decisions = []
    for number, row in enumerate(rows):
        place = problems.index(str(row["problem_of"]))
        tolerance, change = data["tolerance"][place], data["change"][number]
        # Quantities without a tolerance or a known change come last.
        with np.errstate(invalid="ignore"):
            weight = np.where(np.isnan(tolerance) | np.isnan(change), -1.0, change / tolerance)
        worst = int(np.argmax(weight))
        decisions.append(
            row
            | {
                "title": str(data["problem_title"][place]),
                "change": float(change[worst]),
                "quantity": str(data["quantity"][worst]),
                "evidence": str(data["evidence"][number, worst]),
                "at": float(data["change_at"][number, worst]),
            }
        )
    return decisions


def _detailed(tree: xr.DataTree, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows of pictures and of the cameras of which appendices show every number."""
    if not has(tree, "depth"):
        return rows
    left_out = titles_in(tree, "depth").keys() - detailed_cameras(tree, "depth").keys()
    return [row for row in rows if row["problem_of"] not in left_out]


def _further(tree: xr.DataTree, rows: list[dict[str, Any]]) -> Iterator[Spans]:
    """How many cameras a table of models leaves out, and where they are."""
    further = {row["problem_of"] for row in rows} - {row["problem_of"] for row in _detailed(tree, rows)}
    if further:
        where = "`tables/effects_by_decision.csv` and `tables/effects_by_decision_quantity.csv`"
        yield say(f"The models of {counted(len(further), 'further camera')} are in {where}.")


def _grouped(rows: list[dict[str, Any]]) -> Iterator[tuple[str, ...]]:
    """Rows of a table, under a heading for each camera or picture."""
    for title in dict.fromkeys(str(row["title"]) for row in rows):
        yield (title,)
        yield from (_cells(row) for row in rows if row["title"] == title)


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    model = str(row["model"]) + (", forced by the study" if row["forced"] else "")
    quantity = IN_WORDS[row["quantity"]]
    if row["forced"]:
        return in_words(str(row["slot"])), model, "see above", "—", "—"
    if row["change"] == 0.0:
        return in_words(str(row["slot"])), model, _FULL, "—", "—"
    at = "" if math.isnan(row["at"]) else f"; worst at {distance(row['at'])}"
    if math.isinf(row["change"]):
        evidence = "—"
    elif row["evidence"] == "trial" and row["quantity"] == "pixel_intensity":
        evidence = f"trial at a few places{at}"
    else:
        evidence = f"{_HOW[str(row['evidence'])]}{at}"
    change = "unknown" if math.isinf(row["change"]) else _share(row["change"])
    return in_words(str(row["slot"])), model, change, quantity, evidence


def _nothing(tree: xr.DataTree, rows: list[dict[str, Any]]) -> Iterator[str]:
    """Name the effects without a choice of models, in one sentence for each reason."""
    by_reason: dict[str, dict[str, list[str]]] = {}
    everything = {str(row["title"]) for row in rows}
    for row in rows:
        if row["reason"] and row["reason"] != NO_MICROLENSES and not row["forced"]:
            of_reason = by_reason.setdefault(str(row["reason"]), {})
            of_reason.setdefault(str(row["title"]), []).append(in_words(str(row["slot"])))
    focus = has(tree, "depth", "limit_met") and bool((tree["depth/limit_met"].sel(limit="focus") >= 0).any())
    for reason, of_reason in by_reason.items():
        effects = ", ".join(dict.fromkeys(effect for names in of_reason.values() for effect in names))
        whom = f" ({'; '.join(of_reason)})" if set(of_reason) != everything else ""
        blur = " The limit “focus” uses the geometric blur nevertheless." if focus and "defocus blur" in effects else ""
        yield f"Not simulated, because {reason}: {effects}{whom}.{blur}"


def _together(tree: xr.DataTree) -> Iterator[str]:
    """Say how much all omissions together change each quantity with a tolerance, and how much forced models do."""
    data = group(tree, "effects")
    changes: list[str] = []
    unchanged: dict[str, list[str]] = {}
    for number, quantity in enumerate(QUANTITIES):
        changed = IN_WORDS[quantity]
        tolerances, joint = data["tolerance"].values[:, number], data["joint_change"].values[:, number]
        if np.isnan(tolerances).all():
            shown = joint[~np.isnan(joint)]
            if shown.size and shown.max() > 0.0:
                yield f"The {changed} has no tolerance; it may be off by up to {_share(float(shown.max()))}."
            continue
        most = float(np.nanmax(np.where(np.isnan(tolerances), np.nan, joint)))
        tolerance = _share(float(np.nanmax(tolerances)))
        if most > 0.0:
            changes.append(f"the {changed} by up to {_share(most)} (tolerance {tolerance})")
        else:
            unchanged.setdefault(tolerance, []).append(f"the {changed}")
        forced = data["forced_change"].values[:, number]
        if not np.isnan(forced).all():
            worst = float(np.nanmax(forced))
            more = "more than" if worst > np.nanmax(tolerances) else "within"
            yield f"Models that the study forces change the {changed} by up to {_share(worst)}, {more} the tolerance."
    if changes:
        yield f"All that the chosen models leave out changes {listed(changes)}."
    subject = "It does" if changes else "What the chosen models leave out does"
    for tolerance, names in unchanged.items():
        yield f"{subject} not change {' or '.join(names)} (tolerance {tolerance})."


def _share(value: float) -> str:
    if math.isinf(value):
        return "an unknown amount"
    return share(value, digits=2)
