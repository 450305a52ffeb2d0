"""Lists kept with every study: cameras, assumptions, contradictions, claims, requirements, criteria, provenance."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.report.document import (
    Block,
    Bullets,
    Callout,
    Column,
    Heading,
    Paragraph,
    Table,
    Text,
    say,
    with_subscripts,
)
from tradestudy.report.words import length, or_dash
from tradestudy.results import PAPER
from tradestudy.results.storage import CHECKSUM, PICTURES
from tradestudy.results.views.decision import readings_in_words
from tradestudy.results.views.designs import BY_UNIT
from tradestudy.results.views.groups import camera_families, camera_titles, group, has, origin_words, records
from tradestudy.results.views.requirement_conclusions import ALL, ANY, VERDICTS, requirement_conclusions
from tradestudy.units import ANGLE, NUMBER, pretty, significant
from tradestudy.wording import distance, in_words, span

_MARKS = "abcdefgh"  # of the bases in the table of criteria
_BASES: Final[Mapping[str, str]] = {
    "set for this run": "set for this run",
    "assumed": "assumed",
    "": "without a stated basis",
    "derived": "derived",
    "datasheet": "from data sheets",
    "measured": "measured",
    "paper": "from the paper",
}
_PAIR: Final = re.compile(r"\[(\d+), (\d+)\]")  # width and height of a sensor
_LIST: Final = re.compile(r"^\[([^\[\]]+)\]$")  # without lists in it


def describe_cameras(tree: xr.DataTree) -> Iterator[Block]:
    """Introduce the cameras in one table."""
    rows = records(tree, "cameras", "camera")
    if not rows:
        return
    columns: list[tuple[Column, Callable[[Mapping[str, Any]], str]]] = [
        (Column(title="Camera", weight=3), lambda row: str(row["title"])),
        (Column(title="Kind", weight=2), lambda row: str(row["kind"]).replace("-", " ")),
        (Column(title="Focal length", align="right"), lambda row: length(float(row["focal_length"]))),
        (Column(title="f-number", align="right"), lambda row: f"f/{significant(float(row['f_number']))}"),
        (Column(title="Baseline", align="right"), lambda row: or_dash(float(row["baseline"]), length)),
        (Column(title="Pixels", align="right"), lambda row: f"{row['pixels_across']:.0f} × {row['pixels_down']:.0f}"),
        (Column(title="Pixel pitch", align="right"), lambda row: length(float(row["pixel_pitch"]))),
        (Column(title="Field of view", align="right"), lambda row: pretty(float(row["field_of_view"]), ANGLE)),
    ]
    yield Heading(text="Cameras", anchor="cameras")
    yield Table(
        name="camera-table",
        caption="The cameras. Baseline: between the lenses of a stereo rig, across the pupil of a plenoptic camera. "
        "Field of view: horizontal, at the focus of the camera (at infinity if it can focus there).",
        columns=tuple(column for column, _ in columns),
        rows=tuple(tuple(cell(row) for _, cell in columns) for row in rows),
    )
    if origins := origin_words(tree):
        yield Paragraph(f"{'. '.join(origins)}.")


def _camera_notes(tree: xr.DataTree) -> Iterator[Block]:
    """What the study says about each camera."""
    noted = [row for row in records(tree, "cameras", "camera") if row.get("note")]
    if noted:
        yield Bullets(tuple(say("**{title}**. {note}", title=str(r["title"]), note=str(r["note"])) for r in noted))
    if any(row["basis"] == "paper" for row in records(tree, "assumptions", "path")):
        yield Paragraph(f"“The paper” is “{PAPER}”.")


def describe_properties(tree: xr.DataTree) -> Iterator[Block]:
    """Write the derived properties of the cameras, with one table per family."""
    families = camera_families(tree) if has(tree, "cameras", "property_camera") else {}
    tables = [
        table
        for family in dict.fromkeys(families.values())
        for table in _properties(tree, family, [key for key, other in families.items() if other == family])
    ]
    notes = tuple(_camera_notes(tree))
    if tables or notes:
        yield Heading(text="Notes on the cameras, and derived properties", anchor="properties")
        yield from (*notes, *tables)


def _properties(tree: xr.DataTree, family: str, keys: list[str]) -> Iterator[Table]:
    """Write the derived properties of the cameras of one family side by side."""
    titles = camera_titles(tree)
    values = {
        (str(row["property_camera"]), str(row["property_name"])): str(row["property_words"])
        or pretty(row["property_value"], BY_UNIT.get(row["property_units"], NUMBER), 4)
        for row in records(tree, "cameras", "property")
    }
    names = list(dict.fromkeys(name for camera, name in values if camera in keys))
    if names:
        yield Table(
            name=f"properties-{family}",
            caption=f"Derived properties of the {family} cameras.",
            columns=(Column(title="Property", weight=3), *(Column(title=titles[key], weight=2) for key in keys)),
            rows=tuple((with_subscripts(name), *(values.get((key, name), "—") for key in keys)) for name in names),
        )


def describe_assumptions(tree: xr.DataTree) -> Iterator[Block]:
    """Write the register of assumptions: the values of cameras and scene, unsupported ones first."""
    rows, warned = records(tree, "assumptions", "path"), records(tree, "assumptions", "warned")
    if not rows and not warned:
        return
    yield Heading(text="Assumptions", anchor="assumptions")
    if warned:
        yield Callout(
            title="Unusual values",
            blocks=(Bullets(tuple(str(row["warning"]) for row in warned)),),
            tone="warning",
        )
    if not rows:
        return
    counts = Counter(str(row["basis"]) for row in rows)
    bases = [basis for basis in _BASES if counts[basis]] + sorted(set(counts) - set(_BASES))
    yield Table(
        name="assumption-register",
        caption="Assumptions register: first values set for this run alone, then those that no source supports. A "
        "value that several cameras share is listed once."
        + " Sections, tables and figures in the notes are those of the paper."
        * bool(counts["paper"]),
        columns=(
            Column(title="Camera", weight=3),
            Column(title="Input", weight=4),
            Column(title="Value", weight=2),
            Column(title="Note", weight=4),
        ),
        rows=tuple(_by_basis(rows, bases, tree)),
    )


def _by_basis(rows: list[dict[str, Any]], bases: list[str], tree: xr.DataTree) -> Iterator[tuple[Text, ...]]:
    """Rows of the register, under a heading for every basis."""
    for basis in bases:
        of_basis = [row for row in rows if str(row["basis"]) == basis]
        yield (f"{_BASES.get(basis, basis).capitalize()} ({len(of_basis)})",)
        for row in of_basis:
            input_words = in_words(str(row["path"]).replace(".", " › "))
            owners = [key for key in str(row["cameras"]).split(", ") if key]
            value = _value_words(_PAIR.sub(r"\1 × \2", str(row["value"])))
            yield _shared(owners, tree) or "study", input_words, value, str(row["note"])


def _value_words(value: str) -> str:
    """Write a declared value as people do: no underscores or brackets, infinity in full, degrees with their sign."""
    if value == "inf":
        return "infinity"
    value = _LIST.sub(r"\1", value)
    return in_words(value) if value.isidentifier() else value.replace(" degC", " °C")


def _shared(owners: list[str], tree: xr.DataTree) -> str:
    """Name the cameras that share a value; a family of more than two counts as one."""
    titles, families = camera_titles(tree), camera_families(tree)
    left, parts = list(owners), []
    for family in dict.fromkeys(families.values()):
        members = [key for key, other in families.items() if other == family]
        if len(members) > 2 and set(members) <= set(left):
            parts.append(f"all {family} cameras")
            left = [key for key in left if key not in members]
    return "; ".join([*(titles.get(key, key) for key in left), *parts])  # titles may contain commas


def describe_contradictions(tree: xr.DataTree) -> Iterator[Block]:
    """List contradictions between redundant inputs, and the value used."""
    rows = records(tree, "contradictions", "contradiction")
    if not rows:
        return
    yield Heading(text="Contradictions found", anchor="contradictions")
    yield Paragraph(
        "The program compares inputs that determine the same quantity. Where they disagree, the table "
        "shows the stated value, what the other inputs imply, and what this study uses."
    )
    weights = {"Camera": 4, "What": 5, "Stated": 4, "Implied": 7, "Used": 9}
    titles = camera_titles(tree)
    yield Table(
        name="contradiction-table",
        caption="Contradictions between inputs.",
        columns=tuple(Column(title=title, weight=weight) for title, weight in weights.items()),
        rows=tuple(
            (
                titles.get(str(r["camera"]), str(r["camera"])),
                *(str(r[k]) for k in ("what", "stated", "implied", "used")),
            )
            for r in rows
        ),
    )


def describe_claims(tree: xr.DataTree) -> Iterator[Block]:
    """Write the verdict on each declared claim."""
    rows = records(tree, "claims", "claim")
    if not rows:
        return
    yield Heading(text="Claims", anchor="claims")
    yield Table(
        name="claim-verdicts",
        caption="The claims and their verdicts. In brackets: where the claim was published. Expected: the value or "
        "bound that would confirm the claim; the section “Claims under every reading” names the quantity. A reading is "
        "one set of assumptions.",
        columns=(
            Column(title="Claim"),
            Column(title="Says", weight=4),
            Column(title="Expected", weight=2),
            Column(title="Verdict", weight=3),
            Column(title="Why", weight=5),
        ),
        rows=tuple(
            (
                str(r["claim"]),
                say("{says} *({source})*", says=str(r["says"]), source=str(r["source"])),
                str(r["expected"]),
                say("**{v}**", v=str(r["verdict"])),
                str(r["reason"]),
            )
            for r in rows
        ),
    )


def list_claim_values(tree: xr.DataTree) -> Iterator[Block]:
    """Write the value of every claim under every tested reading, and the reason for its tolerance."""
    rows = records(tree, "claims", "claim")
    if not rows or not has(tree, "claims", "value_text", "met"):
        return
    data = group(tree, "claims")
    names = [variable for variable in ("met", "value_text", "within_tolerance") if variable in data]
    values = [data[variable].transpose("reading", "claim").values.tolist() for variable in names]

    def cell(met: int, text: str, within_tolerance: float = 0.0) -> Text:
        return f"{text} {'✓' if met == 1 else '✗'}{' ≈' if within_tolerance else ''}" if met >= 0 else text

    cells = [[cell(*entries) for entries in zip(*row, strict=True)] for row in zip(*values, strict=True)]
    tested = [(reading, row) for reading, row in zip(data["reading"].values, cells, strict=True) if any(row)]
    says = readings_in_words(data)
    yield Heading(text="Claims under every reading", anchor="claim-readings")
    yield Table(
        name="claim-values",
        caption="Value found for each claim under each tested reading: "
        + ", ".join(_marks_in([row for _, row in tested]))
        + ".",
        columns=(
            Column(title="Reading", weight=1),
            *(Column(title=str(row["claim"]), align="right") for row in rows),
        ),
        rows=tuple((says[str(reading)], *row) for reading, row in tested),
        notes=tuple(
            say(
                "**{claim}**: {quantity}. Why this expectation: {why}.",
                claim=str(r["claim"]),
                quantity=str(r["quantity"]),
                why=str(r["tolerance_reason"]),
            )
            for r in rows
        ),
    )


def _marks_in(cells: list[list[Text]]) -> Iterator[str]:
    """Explain the marks that a table of claims contains."""
    written = [str(cell) for row in cells for cell in row]
    yield "✓ met, ✗ not met"
    if any("≈" in text[-1:] for text in written):
        yield "≈ so close that a change within the study's tolerance could reverse the verdict"
    if "" in written:
        yield "empty: not tested"


_NEAR: Final = ", though a change within the tolerances could reverse this"


def describe_requirements(tree: xr.DataTree) -> Iterator[Block]:
    """Answer the requirements of the study, with their margins."""
    if rows := records(tree, "requirements", "requirement"):
        yield Heading(text="Requirements", anchor="requirements")
        yield requirement_table(rows, camera_titles(tree))
        yield from _under_other_readings(tree)


def _under_other_readings(tree: xr.DataTree) -> Iterator[Table]:
    """List the readings that change the verdict on a requirement or who meets it best."""
    changed = [
        (requirement, other) for requirement in requirement_conclusions(tree) for other in requirement.other_verdicts
    ]
    if changed:
        yield Table(
            name="requirement-readings-table",
            caption="Readings under which the verdict on a requirement differs from that for the study as declared, or "
            "under which another camera meets it best.",
            columns=(
                Column(title="Requirement", weight=2),
                Column(title="Reading", weight=3),
                Column(title="Verdict"),
                Column(title="Camera", weight=2),
                Column(title="Why", weight=3),
            ),
            rows=tuple(
                (requirement.says, other.says, VERDICTS[other.met], other.camera, other.reason)
                for requirement, other in changed
            ),
        )


def requirement_table(rows: Iterable[Mapping[str, Any]], titles: Mapping[str, str]) -> Table:
    """The answers to all requirements in one design, from the rows of ``/requirements``."""
    return Table(
        name="requirement-table",
        caption="Requirements of the study, each with the camera that decides it: the one with the largest margin or, "
        "where every camera must meet it, with the smallest. A positive margin is room to spare, in % of the worst "
        "value; “margin / error” is the margin as a multiple of the estimated numerical error of that value. A camera "
        "that is unusable over 30 % of the range, on a logarithmic scale, has a margin of −30 % or less.",
        columns=(
            Column(title="Requirement", weight=3),
            Column(title="Bound", weight=2),
            Column(title="Met", weight=2),
            Column(title="Camera", weight=2),
            Column(title="Margin", unit="%", align="right"),
            Column(title="Margin / error", align="right"),
            Column(title="Why", weight=3),
        ),
        rows=tuple(
            (
                str(r["says"]) + (" (should)" if r["priority"] == "should" else ""),
                _bound_over(r, titles),
                say(
                    "**{met}**{near}",
                    met={1: "yes", 0: "no", -1: "cannot be decided"}[int(r["met"])],
                    near=_NEAR if r["within_tolerance"] else "",
                ),
                titles.get(str(r["camera_deciding"]), str(r["camera_deciding"])),
                or_dash(float(r["margin_percent"]), lambda percent: significant(percent, 2)),
                _times_the_error(float(r["margin_sigma"])),
                str(r["reason"]),
            )
            for r in rows
        ),
    )


def _bound_over(row: Mapping[str, Any], titles: Mapping[str, str]) -> str:
    """The cameras that must meet a requirement, its bound, and the distances over which it must hold."""
    who = {ANY: "any one camera", ALL: "every camera"}.get(str(row["of"]), titles.get(str(row["of"]), ""))
    text, near, far = str(row["bound_text"]), float(row["over_near"]), float(row["over_far"])
    if math.isnan(near):
        return f"{who}: {text}"
    return f"{who}: {text}, at " + (f"all distances from {span(near, far)}" if near < far else distance(near))


def _times_the_error(margin: float) -> str:
    """Write a margin as a multiple of its numerical error; beyond a thousand, only "> 1000"."""
    if not math.isfinite(margin):
        return "—"
    if abs(margin) > 1000.0:
        return "> 1000" if margin > 0.0 else "< −1000"
    return significant(margin, 2)


def describe_criteria(tree: xr.DataTree) -> Iterator[Block]:
    """Compare the cameras by scalar criteria, such as moving parts, images per scene and data volume."""
    if not has(tree, "criteria", "value"):
        return
    data, titles = group(tree, "criteria"), camera_titles(tree)
    shown = [key for key in titles if key in data["camera"].values]

    stated = data["basis"].values if "basis" in data else np.empty(0)
    bases = [str(basis) for basis in np.unique(stated.astype(str)) if str(basis) not in ("", "derived")]
    says = data["says"].values if "says" in data else np.empty(0)

    def cell(key: str, criterion: Any) -> Text:
        attribute = data.sel(camera=key, criterion=criterion)
        text = str(attribute["value"].item())
        basis = str(attribute["basis"].item()) if "basis" in attribute else ""
        return say("{text}^{mark}^", text=text, mark=_MARKS[bases.index(basis)]) if basis in bases else text

    yield Heading(text="Attributes of the cameras", anchor="criteria", level=2)
    yield Table(
        name="criteria-table",
        caption="Attributes of the cameras. Those without a mark are derived from other inputs.",
        columns=(Column(title="Criterion", weight=3), *(Column(title=titles[key], weight=2) for key in shown)),
        rows=tuple(
            (in_words(str(criterion)), *(cell(key, criterion) for key in shown))
            for criterion in data["criterion"].values
        ),
        notes=(
            *(
                say("**{name}**: {says}.", name=in_words(str(criterion)), says=str(text))
                for criterion, text in zip(data["criterion"].values, says, strict=False)
            ),
            *(
                say("^{mark}^ declared, {basis}.", mark=mark, basis=_BASES.get(basis, basis))
                for mark, basis in zip(_MARKS, bases, strict=False)
            ),
        ),
    )


def describe_provenance(run: Mapping[str, Any]) -> Iterator[Block]:
    """Write the content of ``run.json`` as a table.

    It lacks the inputs, which earlier sections show, and what only the file has: the checksum and the pictures' folder.
    """
    plain = {key: value for key, value in run.items() if key not in ("inputs", "points", CHECKSUM, PICTURES)}
    rows = (*_recorded(plain), *_reused(run.get("points", {})))
    if rows:
        yield Heading(text="Provenance", anchor="provenance")
        yield Table(
            name="provenance-table",
            caption="How this report was made.",
            columns=(Column(title="What", weight=1), Column(title="Value", weight=2)),
            rows=rows,
        )


def _recorded(content: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Rows of plain values first, then those of every group of values under its name."""
    groups = {key: value for key, value in content.items() if isinstance(value, Mapping)}
    yield from (_plain(key, value) for key, value in content.items() if key not in groups)
    for key, values in groups.items():
        if values:
            yield (in_words(key).capitalize(),)
            yield from _recorded(values)


def _plain(key: str, value: Any) -> tuple[str, str]:
    """The row of a plain value; a number of seconds is a time."""
    if key.endswith("_seconds") and value is not None:
        return in_words(key.removesuffix("_seconds")) + " time", f"{_shown(value)} s"
    return in_words(key), _shown(value)


def _reused(points: Mapping[str, Mapping[str, int]]) -> Iterator[tuple[str, ...]]:
    """How many points of each step come from an interrupted run; nothing if none do."""
    taken = {step: counts for step, counts in points.items() if counts.get("taken up", 0)}
    if taken:
        yield ("Reused from an interrupted run",)
    for step, counts in taken.items():
        yield in_words(step), f"{counts['taken up']} of {counts['taken up'] + counts['computed']}"


def _shown(value: Any) -> str:
    if value is None:
        return "—"
    if isinstance(value, float):
        return significant(value)
    return ", ".join(map(str, value)) or "none" if isinstance(value, list | tuple) else str(value)
