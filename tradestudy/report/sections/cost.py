"""What accuracy costs: what one more digit would, the figure, and every entry; or how to find out."""

from __future__ import annotations

import itertools
import json
import math
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr

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
)
from tradestudy.results.cost import NO_ANSWER
from tradestudy.results.views.groups import group, has
from tradestudy.units import DURATION, pretty, significant

_HAS_PRICES: Final = ("depth", "depth_of_field", "calibration", "images", "point_spread")
_WITHIN_DOUBLE_QUOTES: Final = frozenset('$`\\"!')  # what a shell reads there


@dataclass(frozen=True, kw_only=True)
class Measuring:
    """How the costs of a run are measured, and what is known of it.

    Parameters
    ----------
    file
        The study, as whoever ran it named it.
    folder
        Where the run is; a report, which may be moved, does not know.
    options
        What was set from outside, as options of the command line.
    seconds
        What computing the run took [s]; NaN where that is not known.
    not_shown
        Why a cost that lies in the folder is none of this run, in words; empty where none does.
    """

    file: str
    folder: str = "DIR"
    options: tuple[str, ...] = ()
    seconds: float = math.nan
    not_shown: str = ""

    @classmethod
    def of(cls, run: Mapping[str, Any], *, not_shown: str) -> Measuring:
        """Of a run with this record, which in older ones does not name the file."""
        return cls(
            file=str(run.get("file", "STUDY")),
            options=tuple(run.get("options", ())),
            seconds=float(run.get("seconds", {}).get("compute", math.nan)),
            not_shown=not_shown,
        )

    def command(self, *more: str) -> str:
        """Measures what this run computes, set from outside as it was."""
        words = (self.file, *self.options, "--out", self.folder, *more)
        return " ".join(["python -m tradestudy cost", *map(_in_a_shell, words)])


def describe_cost(tree: xr.DataTree, drawings: Mapping[str, Drawing], measuring: Measuring) -> Iterator[Block]:
    """Write the last measured cost of the study on this machine, or say how to measure it."""
    if not any(group in tree.children for group in _HAS_PRICES):
        return
    yield Heading(text="What accuracy costs", anchor="what-accuracy-costs")
    if not has(tree, "cost", "relative_error"):
        yield Paragraph(
            say(
                "Not measured on this machine for this study as it stands. `{command}` measures error against seconds "
                "for every model and setting; DIR is the folder of this report, where the next report shows it.{other}",
                command=measuring.command(),
                other=f" A cost.json that lies there now {measuring.not_shown}." if measuring.not_shown else "",
            )
        )
        return
    data = group(tree, "cost")
    yield Callout(
        title="What would one more digit cost?", blocks=(Bullets(tuple(answers(data, measuring))),), tone="answer"
    )
    yield Paragraph(_circumstances(data, str(tree.attrs.get("code_hash", ""))))
    yield from pictures_of(drawings, "cost")
    yield _digits(data)
    for name in (str(key) for key in data["cost_quantity"].values):
        yield from _quantity(data, name)


def _in_a_shell(text: str) -> str:
    """Quoted as a person would."""
    apostrophes_alone = "'" in text and not _WITHIN_DOUBLE_QUOTES & set(text)
    return f'"{text}"' if apostrophes_alone else shlex.quote(text)


@dataclass(frozen=True, kw_only=True)
class _Found:
    """One of the entries: its words, error and time, how it is asked for, and the error that the reference has."""

    words: str
    error: float
    seconds: float
    floor: float
    way: str

    @property
    def least(self) -> str:
        """Its error; at most that of the reference where that is all that can be told."""
        return f"at most {_error(self.floor)}" if self.error < self.floor else _error(self.error)

    @property
    def told(self) -> float:
        """The smallest error that it can be said to have."""
        return max(self.error, self.floor)

    @property
    def took(self) -> str:
        """Its time in words."""
        return _duration(self.seconds)


def _found(one: xr.Dataset, which: str) -> _Found | None:
    """The entry of a quantity that results name so; None where there is none."""
    words = str(one[f"{which}_entry"].item())
    error, seconds = float(one[f"{which}_error"]), float(one[f"{which}_seconds"])
    if not words:
        return None
    floor, way = float(one["reference_error"]), _way(one, words)
    return _Found(words=words, error=error, seconds=seconds, floor=floor, way=way)


def _ways(one: xr.Dataset) -> dict[str, str]:
    """By what a study asks for a model; nothing where that was not measured, or by an earlier program."""
    return dict(json.loads(str(one.attrs.get("ways", "{}"))).get(str(one["cost_quantity"].item()), {}))


def _way(one: xr.Dataset, words: str) -> str:
    """How a study asks for the entry of these words; empty where that is not known."""
    if not (ways := _ways(one)):
        return ""
    entries = _entries(one, str(one["cost_quantity"].item()))
    named = zip(entries["model"].values, entries["setting"].values, strict=True)
    model = next(str(model) for model, setting in named if _in_words(str(model), str(setting)) == words)
    return f"asked for by {ways[model]}" if model in ways else "for comparison only: no option asks for it"


def _in_words(model: str, setting: str) -> str:
    return ", ".join(filter(None, (model, setting)))


def answers(data: xr.Dataset, measuring: Measuring) -> Iterator[Spans]:
    """Say of every quantity what a tenth of its error would cost.

    Parameters
    ----------
    data
        The group ``/cost``.
    measuring
        How it was measured.
    """
    for name in (str(key) for key in data["cost_quantity"].values):
        one = data.sel(cost_quantity=name)
        if (own := _found(one, "chosen")) is not None:
            yield _answer(one, own, measuring.seconds)
        elif (best := _found(one, "best")) is not None:
            yield _not_chosen(one, best)
        else:
            yield say(
                "**{title}:** nothing was measured within the {budget} of this measurement. Left out: {why}. "
                "`{command}` allows more time.",
                title=str(one["title"].item()),
                budget=_duration(float(data.attrs["budget"])),
                why=str(one["left_out"].item()).replace("\n", "; "),
                command=measuring.command("--budget", "SECONDS"),
            )


def _not_chosen(one: xr.Dataset, best: _Found) -> Spans:
    """What was measured where a run's own model is not among it."""
    of_a_run = str(one["cost_quantity"].item()) not in json.loads(str(one.attrs.get("not_of_a_run", "[]")))
    left_out = " (see what is left out below; a larger --budget measures more)" if str(one["left_out"].item()) else ""
    return say(
        "**{title}:** {why}; the best that was measured, {words}, errs by {error} in {seconds}.",
        title=str(one["title"].item()),
        why=f"what a run computes is not among what was measured{left_out}"
        if of_a_run
        else "no run computes it by itself, so that none of its models is chosen",
        words=best.words,
        error=best.least,
        seconds=best.took,
    )


def _answer(one: xr.Dataset, own: _Found, whole: float) -> Spans:
    title = str(one["title"].item())
    if own.error == own.floor == 0.0:
        return say(
            "**{title}:** a run takes the most complete model that there is ({words}), in {seconds}; there is no digit "
            "to buy.",
            title=title,
            words=own.words,
            seconds=own.took,
        )
    beside = [] if math.isnan(whole) else [f"all that the run computed took {_duration(whole)}, its report apart"]
    return say(
        "**{title}:** a run ({words}) errs by {error} in {seconds}; {then}.",
        title=title,
        words=own.words,
        error=own.least,
        seconds=own.took,
        then="; ".join((*_digit(one, own), *beside)),
    )


def _digit(one: xr.Dataset, own: _Found) -> Iterator[str]:
    """The price of a tenth of the error; where nothing measured reaches it, what does come next, and why not that."""
    found, quicker = _found(one, "next"), _found(one, "quicker")
    if found is not None:
        yield _costs("a tenth of that", found, own)
    else:
        yield from _instead(one, own, quicker)
    if quicker is not None and (found is None or found.words != quicker.words):
        said = f"{quicker.words} errs less than that run, by {quicker.least}, and takes no more time, {quicker.took}"
        yield ", ".join(filter(None, (said, quicker.way)))


def _instead(one: xr.Dataset, own: _Found, quicker: _Found | None) -> Iterator[str]:
    """Where a tenth of the error was not reached: a tenth of what the study asks for, or the best that was."""
    best, wanted = _found(one, "best"), float(one["next_wanted"])
    assert best is not None  # what is chosen was measured
    asked, tenth = float(one["asked_error"]), _found(one, "asked_tenth")
    better = best.told < own.told
    if tenth is not None and asked / 10.0 < own.told:
        better = True
        yield _costs(f"a tenth of the {_error(asked)} that the study asks for", tenth, own)
    elif better and (quicker is None or quicker.words != best.words):
        yield f"the best measured errs by {best.least}: {_price(best, own)}" + (f" ({best.way})" if best.way else "")
    if wanted >= own.floor:
        more = "; a larger --budget measures what is left out below" if str(one["left_out"].item()) else ""
        yield f"a tenth of that run's error was not reached{'' if better else ', and nothing measured errs less'}{more}"
        return
    why = f"a tenth of that run's error is less than the {_error(own.floor)} by which the reference may err"
    if not better:
        took, finer = float(one["reference_seconds"]), own.floor / wanted
        why += (
            f", which itself took {_duration(took)}; where errors fall as the inverse of time, or of its root, it "
            f"costs about {_duration(finer * took)} to {_duration(finer**2 * took)}"
        )
    yield why


def _costs(what: str, found: _Found, own: _Found) -> str:
    """What an entry costs beside what is chosen."""
    if found.seconds <= own.seconds:
        said = f"{what} costs nothing more: {found.words} takes {found.took} and errs by {found.least}"
        return ", ".join(filter(None, (said, found.way)))
    return f"{what}: {_price(found, own)} ({'; '.join(filter(None, (f'it errs by {found.least}', found.way)))})"


def _price(found: _Found, own: _Found) -> str:
    """What an entry takes, as a factor of what is chosen, and how much more that is."""
    times, more = significant(found.seconds / own.seconds, 2), _duration(found.seconds - own.seconds)
    return f"{found.words}, {found.took}, {times} times as long, {more} more"


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
    """The cheapest entry within each error, quantity by quantity."""
    return Table(
        name="cost-digits",
        caption="What each digit costs: the cheapest of what was measured that errs by no more than is wanted. Nothing "
        "is read between entries.",
        columns=(
            Column(title="Wanted", weight=3),
            Column(title="Cheapest model and setting", weight=6),
            Column(title="Time", align="right", weight=2),
            Column(title="It errs by", align="right", weight=3),
        ),
        rows=tuple(row for name in data["cost_quantity"].values for row in _levels(data.sel(cost_quantity=str(name)))),
        notes=("—: nothing measured is that accurate. ?: below the error of the reference, so that nobody can tell.",),
    )


def _levels(one: xr.Dataset) -> Iterator[tuple[Text, ...]]:
    """A heading, and a row for neighbouring errors that one entry is the cheapest within."""
    yield (str(one["title"].item()),)
    for row, alike in itertools.groupby(one["digit"].values.tolist(), key=lambda level: _level(one, level)):
        levels = list(alike)
        yield (" to ".join(map(_error, dict.fromkeys((levels[0], levels[-1])))), *row)


def _level(one: xr.Dataset, level: float) -> tuple[str, str, str]:
    """The cheapest entry within an error, its time and its error."""
    found, floor = _found(one.sel(digit=level), "digit"), float(one["reference_error"])
    if found is None:
        return "?" if level < floor else "—", "", ""
    return found.words, found.took, _told(found.error, floor)


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
    if notes := tuple(filter(None, str(one["notes"].item()).split("\n"))):
        yield Bullets(notes)
    if entries.sizes["entry"]:
        yield _table(entries, one, floor)
        yield from _asked_for(entries, one)
    if left_out := "; ".join(filter(None, str(one["left_out"].item()).split("\n"))):
        yield Paragraph(say("Left out: {what}.", what=left_out))


def _asked_for(entries: xr.Dataset, one: xr.Dataset) -> Iterator[Paragraph]:
    """By what a study asks for the models of a table, those of one way together."""
    if not (ways := _ways(one)):
        return
    models: dict[str, list[str]] = {}
    for model in dict.fromkeys(map(str, entries["model"].values)):
        models.setdefault(ways.get(model, ""), []).append(model)
    compared = models.pop("", [])
    said = [f"{'; '.join(names)} → {way}" for way, names in models.items()]
    if compared:
        said.append(f"{'; '.join(compared)} → nothing, measured for comparison only")
    yield Paragraph(say("What a study asks for them by: {said}.", said=". ".join(said)))


def _table(entries: xr.Dataset, one: xr.Dataset, floor: float) -> Table:
    name, title, next_digit = (str(one[key].item()) for key in ("cost_quantity", "title", "next_entry"))
    rows: list[tuple[Text, ...]] = []
    names = [str(name) for name, array in entries.data_vars.items() if array.dims == ("entry",)]
    for place in range(entries.sizes["entry"]):
        entry: dict[str, Any] = {key: entries[key].values[place] for key in names}
        words = _in_words(str(entry["model"]), str(entry["setting"]))
        marked = {"frontier": entry["frontier"], "chosen": entry["chosen"], "next digit": words == next_digit}
        rows.append(
            (
                say("**{words}**", words=words) if entry["chosen"] else words,
                _told(float(entry["relative_error"]), floor),
                _told(float(entry["typical_error"]), floor),
                _duration(float(entry["seconds"])),
                f"{significant(float(entry['peak_memory']) / 1e6, 2)}",
                "once" if int(entry["repeats"]) == 1 else str(int(entry["repeats"])),
                ", ".join(word for word, given in marked.items() if given),
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
            "accurate in less time. Next digit: the cheapest within a tenth of the chosen one's error. Once: timed "
            "a single time, of 5 s and more while the memory was traced, which lengthens it.",
        ),
    )


def _told(error: float, floor: float) -> str:
    """An error as a cell of a table."""
    return f"≤\N{NO-BREAK SPACE}{_error(floor)}" if error < floor else _error(error)


def _error(value: float) -> str:
    """In per cent, with the digits that tell an entry from a tenth of another."""
    if value > NO_ANSWER:
        return "no answer"
    return "—" if math.isnan(value) else f"{significant(100.0 * value, 3)}\N{NO-BREAK SPACE}%"


def _duration(seconds: float) -> str:
    return pretty(seconds, DURATION, digits=2).replace(" ", "\N{NO-BREAK SPACE}")
