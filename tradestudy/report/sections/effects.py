"""Effects simulated and left out, with the numbers that justify each choice."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.accuracy import IN_WORDS, QUANTITIES
from tradestudy.report.document import Block, Column, Heading, Paragraph, Table, say
from tradestudy.report.words import share
from tradestudy.results.views.groups import group, has, records
from tradestudy.wording import NO_MICROLENSES, distance, in_words, listed

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
            caption="The model of each effect that can change an answer, and the change due to what it leaves out.",
            columns=_COLUMNS,
            rows=tuple(_grouped(matter)),
            notes=(_EVIDENCE, *_nothing(tree, rows)),
        )
    else:
        yield from (Paragraph(say(text)) for text in _nothing(tree, rows))


def list_decisions(tree: xr.DataTree) -> Iterator[Block]:
    """List every model of each effect for which there was a choice."""
    rows = [row for row in _rows(tree) if not row["reason"]]
    if rows:
        yield Heading(text="Every model that was compared", anchor="every-model")
        yield Table(
            name="effects-all",
            caption="Every model of each effect that offers a choice. Change: how much an answer changes "
            "if this effect alone is simplified to this model. Quantity: the answer that changes most, relative to its "
            "tolerance. A dot marks the models in use.",
            columns=_COLUMNS,
            rows=tuple(_grouped(rows, marked=True)),
            notes=(_EVIDENCE,),
        )


def _rows(tree: xr.DataTree) -> list[dict[str, Any]]:
    """The decisions on models, each with the quantity that it changes most, relative to its tolerance."""
    rows = records(tree, "effects", "decision")
    if not rows:
        return []
    data = {name: array.values for name, array in group(tree, "effects").variables.items()}
    problems = list(map(str, data["problem"]))
    found = []
    for number, row in enumerate(rows):
        place = problems.index(str(row["problem_of"]))
        asked, change = data["tolerance"][place], data["change"][number]
        with np.errstate(invalid="ignore"):
            weight = np.where(np.isnan(asked) | np.isnan(change), -1.0, change / asked)
        worst = int(np.argmax(weight))
        found.append(
            row
            | {
                "title": str(data["problem_title"][place]),
                "change": float(change[worst]),
                "quantity": str(data["quantity"][worst]),
                "evidence": str(data["evidence"][number, worst]),
                "at": float(data["change_at"][number, worst]),
            }
        )
    return found


def _grouped(rows: list[dict[str, Any]], *, marked: bool = False) -> Iterator[tuple[str, ...]]:
    """Rows of a table, under a heading for each camera or picture."""
    for title in dict.fromkeys(str(row["title"]) for row in rows):
        yield (title,)
        yield from (_cells(row, marked=marked) for row in rows if row["title"] == title)


def _cells(row: Mapping[str, Any], *, marked: bool) -> tuple[str, ...]:
    mark = "● " if marked and row["chosen"] else ""
    model = f"{mark}{row['model']}" + (", forced by the study" if row["forced"] else "")
    quantity = IN_WORDS[row["quantity"]]
    if row["forced"]:
        return in_words(str(row["slot"])), model, "see above", "—", "—"
    if row["change"] == 0.0:
        return in_words(str(row["slot"])), model, _FULL, "—", "—"
    at = "" if math.isnan(row["at"]) else f"; worst at {distance(row['at'])}"
    if math.isinf(row["change"]):
        known = "—"
    elif row["evidence"] == "trial" and row["quantity"] == "pixel_intensity":
        known = f"trial at a few places{at}"
    else:
        known = f"{_HOW[str(row['evidence'])]}{at}"
    change = "unknown" if math.isinf(row["change"]) else _share(row["change"])
    return in_words(str(row["slot"])), model, change, quantity, known


def _nothing(tree: xr.DataTree, rows: list[dict[str, Any]]) -> Iterator[str]:
    """Name the effects without a choice of models, in one sentence for each reason."""
    by_reason: dict[str, dict[str, list[str]]] = {}
    everything = {str(row["title"]) for row in rows}
    for row in rows:
        if row["reason"] and row["reason"] != NO_MICROLENSES and not row["forced"]:
            of = by_reason.setdefault(str(row["reason"]), {})
            of.setdefault(str(row["title"]), []).append(in_words(str(row["slot"])))
    focus = has(tree, "depth", "limit_met") and bool((tree["depth/limit_met"].sel(limit="focus") >= 0).any())
    for reason, of in by_reason.items():
        effects = ", ".join(dict.fromkeys(effect for names in of.values() for effect in names))
        whom = f" ({'; '.join(of)})" if set(of) != everything else ""
        blur = " The limit “focus” uses the geometric blur nevertheless." if focus and "defocus blur" in effects else ""
        yield f"Not simulated, because {reason}: {effects}{whom}.{blur}"


def _together(tree: xr.DataTree) -> Iterator[str]:
    """Say how much all omissions together change each quantity with a tolerance, and how much forced models do."""
    data = group(tree, "effects")
    changes: list[str] = []
    unchanged: dict[str, list[str]] = {}
    for number in range(len(QUANTITIES)):
        asked, joint = data["tolerance"].values[:, number], data["joint_change"].values[:, number]
        if np.isnan(asked).all():
            shown = joint[~np.isnan(joint)]
            if shown.size and shown.max() > 0.0:
                changed = IN_WORDS[QUANTITIES[number]]
                yield f"The {changed} has no tolerance; it may be off by up to {_share(float(shown.max()))}."
            continue
        most = float(np.nanmax(np.where(np.isnan(asked), np.nan, joint)))
        changed = IN_WORDS[QUANTITIES[number]]
        tolerance = _share(float(np.nanmax(asked)))
        if most > 0.0:
            together = f"up to {_share(most)} (tolerance {tolerance})"
            changes.append(f"the {changed} by {together}")
        else:
            unchanged.setdefault(tolerance, []).append(f"the {changed}")
        forced = data["forced_change"].values[:, number]
        if not np.isnan(forced).all():
            worst = float(np.nanmax(forced))
            more = "more than" if worst > np.nanmax(asked) else "within"
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
