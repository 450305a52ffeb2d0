"""What accuracy costs: what one more digit would, the figure, and every entry; or how to find out."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from tradestudy.report import facts
from tradestudy.report.document import (
    Block,
    Bullets,
    Callout,
    Column,
    Heading,
    Paragraph,
    Picture,
    Spans,
    Table,
    Text,
    say,
)
from tradestudy.units import DURATION, pretty, significant

if TYPE_CHECKING:
    import xarray as xr

    from tradestudy.figures.drawing import Drawing

_HAS_PRICES: Final = ("depth", "depth_of_field", "calibration", "images", "point_spread")
_NO_ANSWER: Final = 10.0
_LEVELS: Final = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)


def cost(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write the last measured cost of the study on this machine, or say how to measure it."""
    if not any(group in tree.children for group in _HAS_PRICES):
        return
    yield Heading(text="What accuracy costs", anchor="what-accuracy-costs")
    if not facts.has(tree, "cost", "relative_error"):
        yield Paragraph(
            say(
                "Not measured on this machine for this study as it stands. `python -m tradestudy cost STUDY`, with the "
                "same folder for its output, measures error against seconds for every model and setting; the next "
                "report shows it here."
            )
        )
        return
    data = facts.dataset(tree, "cost")
    yield Callout(title="What would one more digit cost?", blocks=(Bullets(tuple(_answers(data))),), tone="answer")
    yield Paragraph(_circumstances(data, str(tree.attrs.get("code_hash", ""))))
    if "cost" in drawings:
        drawing = drawings["cost"]
        yield Picture(name=drawing.name, caption=drawing.caption, alt=drawing.alt)
    yield _digits(data)
    for name in (str(key) for key in data["cost_quantity"].values):
        yield from _quantity(data, name)


def _answers(data: xr.Dataset) -> Iterator[Spans]:
    for name in (str(key) for key in data["cost_quantity"].values):
        one, entries = data.sel(cost_quantity=name), _entries(data, name)
        if math.isfinite(float(one["chosen_seconds"])):
            yield _answer(one)
        elif measured := _best(entries):
            yield _not_chosen(one, measured)
        else:
            yield say(
                "**{title}:** nothing was measured within the {budget} of this measurement. Left out: {why}. "
                "`python -m tradestudy cost STUDY --budget SECONDS` allows more time.",
                title=str(one["title"].item()),
                budget=_duration(float(data.attrs["budget"])),
                why=str(one["left_out"].item()).replace("\n", "; "),
            )


def _best(entries: xr.Dataset) -> tuple[str, float, float] | None:
    """Words, error and seconds of the most accurate entry on the frontier."""
    on = entries.isel(entry=np.flatnonzero(entries["frontier"].values & np.isfinite(entries["relative_error"].values)))
    if not on.sizes["entry"]:
        return None
    best = on.isel(entry=int(np.argmin(on["relative_error"].values)))
    return _words(best), float(best["relative_error"]), float(best["seconds"])


def _words(entry: xr.Dataset) -> str:
    return ", ".join(filter(None, (str(entry["model"].item()), str(entry["setting"].item()))))


def _not_chosen(one: xr.Dataset, best: tuple[str, float, float]) -> Spans:
    """What was measured where a run's own model is not among it."""
    words, error, seconds = best
    return say(
        "**{title}:** what a run computes is not among what was measured{why}; the best that was, {words}, errs by "
        "{error} in {seconds}.",
        title=str(one["title"].item()),
        why=" (see what is left out below; a larger --budget measures more)" if str(one["left_out"].item()) else "",
        words=words,
        error=_least(error, float(one["reference_error"])),
        seconds=_duration(seconds),
    )


def _answer(one: xr.Dataset) -> Spans:
    error, seconds = float(one["chosen_error"]), float(one["chosen_seconds"])
    if error == 0.0:
        return say(
            "**{title}:** a run takes the most complete model that there is, in {seconds}; there is no digit to buy.",
            title=str(one["title"].item()),
            seconds=_duration(seconds),
        )
    return say(
        "**{title}:** a run errs by {error} in {seconds}; {then}.",
        title=str(one["title"].item()),
        error=_least(error, float(one["reference_error"])),
        seconds=_duration(seconds),
        then=_digit(one, error, seconds),
    )


def _digit(one: xr.Dataset, error: float, seconds: float) -> str:
    """The price of a tenth of the error; where that is not measured, of a tenth of what the study asks for."""
    needed, floor = float(one["next_seconds"]), float(one["reference_error"])
    if math.isfinite(needed):
        return _costs("a tenth of that", needed, seconds)
    if float(one["next_error"]) < floor:
        why = f"a tenth of that is less than the {_error(floor)} by which the reference may err"
    else:
        least, took = float(one["best_error"]), float(one["best_seconds"])
        why = f"a tenth of that was not reached: the best measured errs by {_error(least)} in {_duration(took)}"
    asked, tenth = float(one["asked_error"]), float(one["asked_tenth_seconds"])
    if math.isfinite(tenth) and asked / 10.0 < error:
        return f"{_costs(f'a tenth of the {_error(asked)} that the study asks for', tenth, seconds)}; {why}"
    if (best := float(one["best_error"])) < error / 2.0:
        took = float(one["best_seconds"])
        return f"the best measured errs by {_error(best)} at most, and {_costs('that', took, seconds)}; {why}"
    if float(one["next_error"]) < floor:
        took, finer = float(one["reference_seconds"]), floor / float(one["next_error"])
        return (
            f"{why}, which itself took {_duration(took)}; where errors fall as the inverse of time, or of its root, it "
            f"costs about {_duration(finer * took)} to {_duration(finer**2 * took)}"
        )
    more = "; a larger --budget measures what is left out below" if str(one["left_out"].item()) else ""
    return f"{why}{more}"


def _costs(what: str, needed: float, seconds: float) -> str:
    if needed <= seconds:
        return f"{what} can be had in no more time, {_duration(needed)}, by another model on the frontier"
    return f"{what} costs {_duration(needed)}, {significant(needed / seconds, 2)} times as long"


def _least(error: float, floor: float) -> str:
    """An error; at most that of the reference where that is all that can be told."""
    return f"at most {_error(floor)}" if error < floor else _error(error)


def _circumstances(data: xr.Dataset, code_hash: str) -> Spans:
    machine = json.loads(str(data.attrs["machine"]))
    load, cores = float(data.attrs["load_average"]), int(machine["cores"])
    busy = " It was busy with other work, which lengthens the times." if load > cores else ""
    other = "" if data.attrs.get("code_hash") == code_hash else " An earlier state of this program was measured."
    return say(
        "Measured on {date} on {cores} cores of {processor}, load average {load} at the end.{busy}{other} Every "
        "computation starts afresh, its caches emptied: first while its memory is traced (tracemalloc), then again for "
        "its time; seconds are medians over the repeats. What takes 5 s and more, or what the time left allowed no "
        "more of, was run once: its time is that of the traced run, which tracing lengthens, or of a single run after "
        "it. Memory is the most that Python and numpy held at once; what compiled libraries allocate for themselves is "
        "not in it.",
        date=str(data.attrs["measured"])[:10],
        cores=str(cores),
        processor=str(machine["processor"]),
        load="unknown" if math.isnan(load) else f"{load:.1f}",
        busy=busy,
        other=other,
    )


def _digits(data: xr.Dataset) -> Table:
    """Seconds by wanted error along every frontier."""
    names = [str(name) for name in data["cost_quantity"].values]
    return Table(
        name="cost-digits",
        caption="What each digit costs: seconds along the frontier for a relative error, log–log between measured "
        "entries.",
        columns=(
            Column(title="Quantity", weight=1),
            *(Column(title=f"{100 * level:g} %", align="right") for level in _LEVELS),
        ),
        rows=tuple((str(data.sel(cost_quantity=name)["title"].item()), *_levels(data, name)) for name in names),
        notes=("—: nothing measured is that accurate. ?: below the error of the reference, so that nobody can tell.",),
    )


def _levels(data: xr.Dataset, name: str) -> Iterator[str]:
    one = _entries(data, name)
    one = one.isel(entry=np.flatnonzero(one["frontier"].values))
    floor = float(data.sel(cost_quantity=name)["reference_error"])
    error = np.maximum(np.asarray(one["relative_error"].values, dtype=float), floor)
    seconds = np.asarray(one["seconds"].values, dtype=float)
    order = np.argsort(-error)
    error, seconds = error[order], seconds[order]
    for level in _LEVELS:
        if error.size == 0 or not math.isfinite(floor):
            yield "—"
        elif level < floor:
            yield "?"
        elif level < error[-1]:
            yield "—"
        elif level >= error[0]:
            yield _duration(float(seconds[0]))
        elif error[-1] == 0.0:  # an exact entry is there or it is not
            yield _duration(float(seconds[int(np.argmax(error <= level))]))
        else:
            yield _duration(float(np.exp(np.interp(-np.log(level), -np.log(error), np.log(seconds)))))


def _entries(data: xr.Dataset, name: str) -> xr.Dataset:
    return data.isel(entry=np.flatnonzero(data["quantity"].values == name))


def _quantity(data: xr.Dataset, name: str) -> Iterator[Block]:
    one, entries = data.sel(cost_quantity=name), _entries(data, name)
    title, floor = str(one["title"].item()), float(one["reference_error"])
    yield Heading(text=title, anchor=f"cost-{name}", level=2)
    yield Paragraph(
        say(
            "{says} Reference: {reference}{within}.",
            says=str(one["says"].item()),
            reference=str(one["reference"].item()),
            within=f", itself within {_error(floor)}" if floor > 0.0 else "",
        )
    )
    notes = [line for line in str(one["notes"].item()).split("\n") if line]
    if notes:
        yield Bullets(tuple(notes))
    if entries.sizes["entry"]:
        yield _table(entries, name, title, floor)
    left_out = [line for line in str(one["left_out"].item()).split("\n") if line]
    if left_out:
        yield Paragraph(say("Left out: {what}.", what="; ".join(left_out)))


def _table(entries: xr.Dataset, name: str, title: str, floor: float) -> Table:
    rows: list[tuple[Text, ...]] = []
    names = [str(name) for name, array in entries.data_vars.items() if array.dims == ("entry",)]
    for place in range(entries.sizes["entry"]):
        entry: dict[str, Any] = {key: entries[key].values[place] for key in names}
        words = _words(entries.isel(entry=place))
        marks = [word for word, given in (("frontier", entry["frontier"]), ("chosen", entry["chosen"])) if given]
        rows.append(
            (
                say("**{words}**", words=words) if entry["chosen"] else words,
                _told(float(entry["relative_error"]), floor),
                _told(float(entry["typical_error"]), floor),
                _duration(float(entry["seconds"])),
                f"{significant(float(entry['peak_memory']) / 1e6, 2)}",
                "once" if int(entry["repeats"]) == 1 else str(int(entry["repeats"])),
                ", ".join(marks),
            )
        )
    return Table(
        name=f"cost-{name}-table",
        caption=f"{title}: every model and setting that was measured.",
        columns=(
            Column(title="Model and setting", weight=1),
            Column(title="Error", align="right"),
            Column(title="Typical", align="right"),
            Column(title="Time", align="right"),
            Column(title="Memory", unit="MB", align="right"),
            Column(title="Repeats", align="right"),
            Column(title=""),
        ),
        rows=tuple(rows),
        notes=(
            "Error: the worst over cameras and places, of random methods its root mean square over the repeats. "
            "Typical: the median over them. ≤: less than the reference itself may err. Frontier: nothing else is as "
            "accurate in less time. Once: timed a single time, of 5 s and more while the memory was traced, which "
            "lengthens it.",
        ),
    )


def _told(error: float, floor: float) -> str:
    """An error as a cell of a table."""
    return f"≤\N{NO-BREAK SPACE}{_error(floor)}" if error < floor else _error(error)


def _error(value: float) -> str:
    if math.isnan(value):
        return "—"
    if value > _NO_ANSWER:
        return "no answer"
    return f"{significant(100.0 * value, 2)}\N{NO-BREAK SPACE}%"


def _duration(seconds: float) -> str:
    return pretty(seconds, DURATION, digits=2).replace(" ", "\N{NO-BREAK SPACE}")
