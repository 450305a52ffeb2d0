"""Which effects were simulated, which were left out, and the numbers that an expert can agree or disagree with."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tradestudy.report import facts
from tradestudy.report.document import Block, Column, Heading, Paragraph, Table, Text, say
from tradestudy.units import DURATION, FRACTION, pretty, significant

if TYPE_CHECKING:
    import xarray as xr

_QUANTITIES = {
    "depth_uncertainty": "depth uncertainty",
    "depth_of_field": "ends of the depth of field",
    "pixel_intensity": "pixel intensities",
    "psf_width": "width of a point's image",
}
_COLUMNS = (
    Column(title="Effect", weight=4),
    Column(title="Model", weight=5),
    Column(title="Of", weight=4),
    Column(title="Changes at most", weight=3),
    Column(title="Number", weight=5),
    Column(title="Because", weight=8),
)


def effects(tree: xr.DataTree, run: Mapping[str, Any]) -> Iterator[Block]:
    """Write the section on effects: what was asked for, what acts, and what was weighed and not taken."""
    rows = facts.records(tree, "effects", "decision")
    if not rows:
        return
    data = facts.dataset(tree, "effects")
    yield Heading(text="What was simulated, and what was not", anchor="effects")
    yield Paragraph(
        say(
            "Every effect has models, from leaving it out to the most complete one, and each states beforehand how far "
            "it can move a result. The cheapest set was taken whose bounds add up to no more than the accuracy wanted, "
            "at the worst of the distances, readings and ends of the sweep that were looked at. {wanted}",
            wanted=" ".join((*_wanted(data), *_foreseen(run))),
        )
    )
    yield Table(
        name="effects-that-act",
        caption="The model of each effect that acts, and what it leaves out.",
        columns=_COLUMNS,
        rows=tuple(_merged([row for row in rows if row["chosen"]], data)),
        notes=_blur_note(rows),
    )
    others = [row for row in rows if not row["chosen"]]
    if others:
        yield Table(
            name="effects-weighed",
            caption="Models that were weighed and not taken.",
            columns=(*_COLUMNS[:-1], Column(title="Verdict", weight=8)),
            rows=tuple(_merged(others, data)),
        )


def _wanted(data: xr.Dataset) -> Iterator[str]:
    """What was wanted of each quantity, and what was kept."""
    for number, quantity in enumerate(data["quantity"].values):
        wanted = data["wanted"].values[:, number]
        if np.isnan(wanted).all():
            continue
        joint, least = float(np.nanmax(data["joint_bound"].values[:, number])), float(np.nanmax(wanted))
        yield (
            f"Wanted of the {_QUANTITIES[str(quantity)]}: {_share(least)}; "
            f"all omissions together change it by at most {_share(joint)}."
        )
        if joint > least * (1.0 + 1e-9):
            yield (
                "That is more than is wanted: the study forces models, and what it leaves free was chosen as if they "
                "changed nothing."
            )


def _foreseen(run: Mapping[str, Any]) -> Iterator[str]:
    """How long the run was foreseen to take."""
    if (foreseen := run.get("predicted_seconds")) is None:
        return
    ends = dict.fromkeys(pretty(float(seconds), DURATION, digits=2) for seconds in foreseen)
    yield f"The run was foreseen to take {' to '.join(ends)}, report included; what it took stands under provenance."


def _blur_note(rows: list[dict[str, Any]]) -> tuple[str, ...]:
    """What the number beside defocus is, for studies whose cameras measure depth in a picture."""
    if not any(str(row["criterion"]) == "blur over pixel" for row in rows):
        return ()
    return (
        "Blur over pixel: diameter of the geometric blur circle on the sensor; diffraction is not in it and has a row "
        "of its own. It is the largest over the distances at which effects were weighed, which reach a tenth beyond "
        "the usable range; where the disparity error is declared, that at the nearest of them.",
    )


@dataclass(frozen=True, kw_only=True)
class _Row:
    """Pieces of the study that treat an effect alike, numbers as ranges."""

    effect: str
    model: str
    pieces: str
    changes: tuple[float, float]
    number: str
    because: str

    def cells(self) -> tuple[Text, ...]:
        """In the order of the columns."""
        ends = [_share(change) for change in self.changes]
        return self.effect, self.model, self.pieces, _range(ends), self.number or "—", self.because


def _merged(rows: list[dict[str, Any]], data: xr.Dataset) -> Iterator[tuple[Text, ...]]:
    """One row for all pieces that treat an effect alike, and for all effects that one reason keeps from mattering."""
    found: list[_Row] = []
    for row in _rows(rows, data):
        twin = next(
            (
                k
                for k, other in enumerate(found)
                if row.changes[1] == other.changes[1] == 0.0
                and (row.model, row.pieces, row.because) == (other.model, other.pieces, other.because)
            ),
            None,
        )
        if twin is None:
            found.append(row)
        else:
            other = found[twin]
            numbers = [text for text in (other.number, row.number) if text]
            found[twin] = replace(other, effect=f"{other.effect}, {row.effect}", number="; ".join(numbers))
    return (row.cells() for row in found)


def _rows(rows: list[dict[str, Any]], data: xr.Dataset) -> Iterator[_Row]:
    """Effects in the order of the light."""
    titles = dict(zip(data["piece"].values, data["piece_title"].values, strict=True))
    groups: dict[tuple[str, str, str, str], list[dict[str, Any]]] = {}
    for row in rows:
        verdict = str(row["why"]).split(":")[0].split(";")[0]
        groups.setdefault((str(row["slot"]), str(row["model"]), verdict, str(row["reason"])), []).append(row)
    position = {str(name): index for index, name in enumerate(data["decision"].values)}
    for (slot, model, verdict, reason), members in groups.items():
        changes = [float(np.nanmax(data["bound"].values[position[str(row["decision"])]])) for row in members]
        same_why = {str(row["why"]) for row in members}
        told = same_why.pop() if len(same_why) == 1 else verdict
        if verdict.startswith("forced"):
            told = f"{verdict}; {reason}"
        elif verdict == "refused" and slot != "sampling":
            told = f"{told}; {reason}"
        yield _Row(
            effect=facts.in_words(slot),
            model=model,
            pieces=_of([str(row["situation"]) for row in members], titles),
            changes=(min(changes), max(changes)),
            number="" if reason == "nothing is left out" else _number(members),
            because=reason if verdict == "accepted" else told,
        )


def _of(members: list[str], titles: dict[str, str]) -> str:
    """Name some pieces of the study in few words."""
    others = [str(title) for name, title in titles.items() if name not in members]
    if len(others) < min(len(members), 2):
        return f"all but {others[0]}" if others else "all"
    return ", ".join(str(titles[name]) for name in members)


def _number(members: list[dict[str, Any]]) -> str:
    known = [value for row in members if not math.isnan(value := float(row["number"]))]
    if not known:
        return ""
    return f"{members[0]['criterion']}: {_range([significant(min(known), 2), significant(max(known), 2)])}"


def _range(ends: list[str]) -> str:
    return ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}"


def _share(value: float) -> str:
    return "no bound" if math.isinf(value) else pretty(value, FRACTION, digits=2)
