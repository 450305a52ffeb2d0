"""Which effects were simulated, which were left out, and the numbers that an expert can agree or disagree with."""

from __future__ import annotations

import math
from collections.abc import Iterator
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
    Column(title="Effect", weight=2),
    Column(title="Model", weight=2),
    Column(title="Of", weight=3),
    Column(title="Changes at most", weight=2),
    Column(title="Number", weight=3),
    Column(title="Because", weight=6),
)


def effects(tree: xr.DataTree) -> Iterator[Block]:
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
            "at the worst distance of the worst reading and design of the study. {wanted}",
            wanted=" ".join(_wanted(data)),
        )
    )
    yield Table(
        name="effects-that-act",
        caption="The model of each effect that acts, and what it leaves out.",
        columns=_COLUMNS,
        rows=tuple(_merged([row for row in rows if row["chosen"]], data)),
    )
    others = [row for row in rows if not row["chosen"]]
    if others:
        yield Table(
            name="effects-weighed",
            caption="Models that were weighed and not taken.",
            columns=(*_COLUMNS[:-1], Column(title="Verdict", weight=6)),
            rows=tuple(_merged(others, data)),
        )


def _wanted(data: xr.Dataset) -> Iterator[str]:
    """What was wanted of each quantity, what was kept, and what time it was foreseen to take."""
    for number, quantity in enumerate(data["quantity"].values):
        wanted = data["wanted"].values[:, number]
        if np.isnan(wanted).all():
            continue
        joint = np.nanmax(data["joint_bound"].values[:, number])
        yield (
            f"Wanted of the {_QUANTITIES[str(quantity)]}: {_share(float(np.nanmax(wanted)))}; "
            f"all omissions together change it by at most {_share(float(joint))}."
        )
    low, high = (float(data.attrs[f"predicted_seconds_{end}"]) for end in ("low", "high"))
    ends = [pretty(seconds, DURATION, digits=2) for seconds in (low, high)]
    yield f"The run was foreseen to take {' to '.join(dict.fromkeys(ends))}."


def _merged(rows: list[dict[str, Any]], data: xr.Dataset) -> Iterator[tuple[Text, ...]]:
    """One row for all pieces that treat an effect alike, numbers as ranges; effects in the order of the light."""
    titles = dict(zip(data["piece"].values, data["piece_title"].values, strict=True))
    groups: dict[tuple[str, str, str, str], list[dict[str, Any]]] = {}
    for row in rows:
        verdict = str(row["why"]).split(":")[0].split(";")[0]
        groups.setdefault((str(row["slot"]), str(row["model"]), verdict, str(row["reason"])), []).append(row)
    bounds = data["bound"].values
    position = {str(name): index for index, name in enumerate(data["decision"].values)}
    for (slot, model, verdict, reason), members in groups.items():
        changes = [float(np.nanmax(bounds[position[str(row["decision"])]])) for row in members]
        same_why = {str(row["why"]) for row in members}
        text = reason if verdict == "accepted" else same_why.pop() if len(same_why) == 1 else verdict
        yield (
            facts.in_words(slot),
            model,
            ", ".join(str(titles[row["situation"]]) for row in members) if len(members) < len(titles) else "all",
            _range([_share(change) for change in (min(changes), max(changes))]),
            _number([float(row["number"]) for row in members], str(members[0]["criterion"])),
            text,
        )


def _number(values: list[float], criterion: str) -> str:
    known = [value for value in values if not math.isnan(value)]
    if not known:
        return "—"
    return f"{criterion}: {_range([significant(min(known), 2), significant(max(known), 2)])}"


def _range(ends: list[str]) -> str:
    return ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}"


def _share(value: float) -> str:
    return "no bound" if math.isinf(value) else pretty(value, FRACTION, digits=2)
