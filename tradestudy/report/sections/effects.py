"""Which effects were simulated, which were left out, and the numbers that an expert can agree or disagree with."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.report.document import Block, Column, Heading, Paragraph, Table, Text, say
from tradestudy.report.words import in_words
from tradestudy.results.effects import OF_NOISE_ALONE, TIMES_WITH_A_MODEL, WHERE_NUMBERS_ARE_TAKEN
from tradestudy.results.views.groups import camera_titles, group, has, records
from tradestudy.units import DURATION, FRACTION, pretty, significant
from tradestudy.wording import distance

_QUANTITIES = {
    "depth_uncertainty": "depth uncertainty, at every distance",
    "depth_of_field": "ends of the depth of field",
    "pixel_intensity": "pixel intensities, as relative L2 over the pixels of the picture, √(Σ ΔI²/Σ I²)",
    "psf_width": "width of a point's image, the radius that holds half its light",
}
_OF = Column(title="Of", weight=5)
_NUMBER = Column(title="Number", weight=4)
_TAKES = Column(title="Takes", align="right")
_VERDICT = Column(title="Verdict, and the rule that it follows", weight=13)
_NOTHING = "nothing is left out"
_LITTLE = 0.5  # of the variance: below that, what changes noise changes the whole by less than half as much


def describe_effects(tree: xr.DataTree, run: Mapping[str, Any]) -> Iterator[Block]:
    """Write the section on effects: what was asked for, what acts, and what was weighed and not taken."""
    rows = records(tree, "effects", "decision")
    if not rows:
        return
    data = group(tree, "effects")
    changes = data["bound"].max("quantity").values
    rows = [row | {"change": float(change)} for row, change in zip(rows, changes, strict=True)]
    yield Heading(text="What was simulated, and what was not", anchor="effects")
    yield Paragraph(
        say(
            "Every effect has models, from leaving it out to the most complete one, and each states beforehand how far "
            "it can move a result. The cheapest set was taken whose bounds add up to no more than the accuracy wanted, "
            "at the worst of the distances, readings and designs of the sweep that were looked at. {wanted}",
            wanted=" ".join((*_wanted(data), *_foreseen(run))),
        )
    )
    yield Table(
        name="effects-that-act",
        caption="The model of each effect that acts, and what it leaves out.",
        columns=(_OF, replace(_NUMBER, weight=7), _VERDICT),
        rows=tuple(_cells([row | {"predicted_seconds": math.nan} for row in rows if row["chosen"]], data)),
        notes=tuple(_of_depth(tree, rows)),
    )
    others = [row for row in rows if not row["chosen"]]
    if others:
        yield Table(
            name="effects-weighed",
            caption="Models that were weighed and not taken.",
            columns=(_OF, _NUMBER, _TAKES, _VERDICT),
            rows=tuple(_cells(others, data)),
            notes=(f"Takes: {TIMES_WITH_A_MODEL}; —: it can be combined with nothing. {_taken(data)}",),
        )
    yield from _formulas(rows)


def _of_depth(tree: xr.DataTree, rows: list[dict[str, Any]]) -> Iterator[str]:
    """What the bounds on depth hold for, and where their numbers are taken; nothing where none is of a distance."""
    data = group(tree, "effects")
    if np.isfinite(data["wanted"].sel(quantity="depth_uncertainty")).any():
        yield " ".join((OF_NOISE_ALONE, *_noise_shares(tree, rows), WHERE_NUMBERS_ARE_TAKEN))
    elif np.isfinite(data["number_at"]).any():
        yield WHERE_NUMBERS_ARE_TAKEN


def _noise_shares(tree: xr.DataTree, rows: list[dict[str, Any]]) -> Iterator[str]:
    """How little noise makes of the depth uncertainty of cameras whose picture was weighed."""
    if not has(tree, "depth"):
        return
    pictured = {str(row["situation"]) for row in rows if row["slot"] == "sensor_noise" and row["change"] > 0.0}
    depth = group(tree, "depth")
    for name, title in camera_titles(tree).items():
        if name not in pictured:
            continue
        own = depth.sel(camera=name)
        largest = float(own["variance_share"].sel(part="noise").where(own["usable"] > 0).max())
        if largest < _LITTLE:
            most = _share(largest)
            yield f"Of the variance of inverse depth of {title}, noise makes at most {most} where it is usable."


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
    yield (
        f"The run was foreseen to take {' to '.join(ends)}, report included; what computing took stands under "
        "provenance."
    )


def _taken(data: xr.Dataset) -> str:
    """What the models that act take, to compare with."""
    pieces: dict[str, list[str]] = {}
    for title, seconds in zip(data["piece_title"].values, data["piece_seconds"].values, strict=True):
        pieces.setdefault(_duration(float(seconds)), []).append(str(title))
    taken = ", ".join(f"{time} ({'; '.join(names)})" for time, names in pieces.items())
    return f"The models that act take {taken}."


def _formulas(rows: list[dict[str, Any]]) -> Iterator[Table]:
    """What the numbers are, each once."""
    shown = {str(row["criterion"]): str(row["definition"]) for row in rows if _number(row)}
    if shown:
        yield Table(
            name="effects-numbers",
            caption="What the numbers of both tables are.",
            columns=(Column(title="Number", weight=4), Column(title="Formula", weight=12)),
            rows=tuple(shown.items()),
        )


@dataclass(frozen=True, kw_only=True)
class _Row:
    """Pieces of the study that treat an effect alike, down to the last digit that is shown."""

    effects: tuple[str, ...]
    model: str
    pieces: str
    numbers: tuple[tuple[str, str], ...]
    takes: str
    why: str
    rule: str

    @property
    def told(self) -> tuple[str, ...]:
        """What is said of its effects."""
        return self.model, self.takes, self.why, self.rule

    @property
    def heading(self) -> str:
        """Effects and model, and the name of the number if they have one."""
        named = ", ".join(self.effects)
        number = f" — {self.numbers[0][0]}" if len(self.numbers) == 1 else ""
        return f"{named[:1].upper()}{named[1:]}: {self.model}{number}"

    def cells(self, *, ruled: bool) -> tuple[Text, ...]:
        """In the order of the columns; a rule that the row above says is not said again."""
        alone = len(self.numbers) == 1
        number = "; ".join(value if alone else f"{name} {value}" for name, value in self.numbers)
        told = f"{self.why}. {self.rule[:1].upper()}{self.rule[1:]}" if self.rule and ruled else self.why
        taken = (self.takes,) if self.takes else ()
        return self.pieces, number or "—", *taken, told.replace(" %", "\N{NO-BREAK SPACE}%")


def _cells(rows: list[dict[str, Any]], data: xr.Dataset) -> Iterator[tuple[Text, ...]]:
    """Under a heading for every model, a row for all pieces that are alike in everything."""
    above = None
    for row in _merged(rows, data):
        if above is None or above.heading != row.heading:
            yield (row.heading,)
            above = None
        yield row.cells(ruled=above is None or above.rule != row.rule)
        above = row


def _merged(rows: list[dict[str, Any]], data: xr.Dataset) -> list[_Row]:
    """One row for all pieces that are alike, down to the last digit that is shown; models in their order."""
    titles = dict(zip(data["piece"].values, data["piece_title"].values, strict=True))
    pieces: dict[_Row, list[str]] = {}
    for name in titles:
        for row in _of_a_piece([row for row in rows if row["situation"] == name]):
            pieces.setdefault(row, []).append(str(name))
    found = [replace(row, pieces=_of(names, titles)) for row, names in pieces.items()]
    models, order = [(row.effects, row.model) for row in found], [row.heading for row in found]
    return sorted(found, key=lambda row: (models.index((row.effects, row.model)), order.index(row.heading)))


def _of_a_piece(rows: list[dict[str, Any]]) -> list[_Row]:
    """Models of one piece; all effects that one reason keeps from mattering are one row."""
    found: list[_Row] = []
    for row in map(_row, rows):
        harmless = row.why in ("changes nothing", _NOTHING)
        twin = next((k for k, other in enumerate(found) if harmless and other.told == row.told), None)
        if twin is None:
            found.append(row)
        else:
            other = found[twin]
            found[twin] = replace(other, effects=(*other.effects, *row.effects), numbers=(*other.numbers, *row.numbers))
    return found


def _row(row: dict[str, Any]) -> _Row:
    number = _number(row)
    return _Row(
        effects=(in_words(str(row["slot"])),),
        model=str(row["model"]),
        pieces="",
        numbers=(number,) if number else (),
        takes=_duration(float(row["predicted_seconds"])),
        why=_why(row),
        rule="" if row["reason"] == _NOTHING else str(row["reason"]),
    )


def _why(row: dict[str, Any]) -> str:
    """The verdict in the words of the plan, which tells no number of what acts and changes nothing."""
    if row["chosen"] and not row["forced"] and row["change"] == 0.0:
        return _NOTHING if row["reason"] == _NOTHING else "changes nothing"
    return str(row["why"])


def _of(members: list[str], titles: dict[str, str]) -> str:
    """Name some pieces of the study in few words."""
    others = [str(title) for name, title in titles.items() if name not in members]
    if len(others) < min(len(members), 2):
        return f"all but {others[0]}" if others else "all"
    return "; ".join(str(titles[name]) for name in members)  # titles may hold commas


def _number(row: dict[str, Any]) -> tuple[str, str] | None:
    """The number of a model: its name, and its value with where it is the worst."""
    value, at = float(row["number"]), float(row["number_at"])
    if math.isnan(value) or row["reason"] == _NOTHING:
        return None
    return str(row["criterion"]), significant(value) + ("" if math.isnan(at) else f" at {distance(at)}")


def _duration(seconds: float) -> str:
    """Seconds in words; nothing where they are not asked for."""
    if math.isnan(seconds):
        return ""
    return "—" if math.isinf(seconds) else pretty(seconds, DURATION, digits=2).replace(" ", "\N{NO-BREAK SPACE}")


def _share(value: float) -> str:
    return "no bound" if math.isinf(value) else pretty(value, FRACTION, digits=2).replace(" ", "\N{NO-BREAK SPACE}")
