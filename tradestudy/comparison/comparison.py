"""A comparison of runs, as text and as a page: its runs, and each difference between them as one line."""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import xarray as xr

from tradestudy.errors import escaped
from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import (
    Block,
    Bullets,
    Callout,
    Column,
    Heading,
    Paragraph,
    Picture,
    Report,
    Table,
    literal,
)
from tradestudy.results.views.groups import camera_titles
from tradestudy.units import (
    ANGLE,
    DATA,
    DURATION,
    ELECTRONS,
    EXPANSION,
    FRACTION,
    INVERSE_LENGTH,
    LENGTH,
    MASS,
    PIXELS,
    POWER,
    PRESSURE,
    SOLID_ANGLE,
    TEMPERATURE,
    UnitError,
    parse,
)
from tradestudy.wording import counted

ARROW = " → "


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A finished run: its name, the content of its ``run.json``, and its results."""

    name: str
    record: Mapping[str, Any]
    tree: xr.DataTree


@dataclass(frozen=True, kw_only=True)
class Difference:
    """One thing that differs between runs.

    Parameters
    ----------
    what
        What differs, in words.
    values
        Its value in each run, in words.
    where
        Distances and details, in words; may be empty.
    """

    what: str
    values: tuple[str, ...]
    where: str = ""

    @property
    def change(self) -> str:
        """The values one after the other, and where they differ."""
        return " ".join(filter(None, (ARROW.join(self.values), self.where)))

    def __str__(self) -> str:
        return f"{self.what}: {self.change}"


def same_or_each(texts: Sequence[str]) -> str:
    """The text if all are the same, else each different one once."""
    return " / ".join(dict.fromkeys(texts))


def titles_of(runs: Sequence[Run]) -> dict[str, str]:
    """Titles of the cameras of all runs by key; a camera with different titles has all of them.

    A camera with a title that another one has, in any run, as after a change of its key, also has its key.
    """
    by_run = [camera_titles(run.tree) if "cameras" in run.tree.children else {} for run in runs]
    of_key: dict[str, list[str]] = {}
    for key, title in itertools.chain.from_iterable(titles.items() for titles in by_run):
        of_key.setdefault(key, []).append(title)
    keys = Counter(title for titles in of_key.values() for title in set(titles))
    return {
        key: same_or_each(titles) + f" ({key})" * any(keys[title] > 1 for title in titles)
        for key, titles in of_key.items()
    }


def common_cameras(runs: Sequence[Run], group: str) -> tuple[str, ...]:
    """Keys of the cameras that a group contains in every run, in the order of the first run."""
    if not all(group in run.tree.children and "camera" in run.tree[group].coords for run in runs):
        return ()
    keys = [[str(key) for key in run.tree[group].to_dataset()["camera"].values] for run in runs]
    return tuple(key for key in keys[0] if all(key in others for others in keys[1:]))


_ROUNDING: Final = 1e-12  # relative, of values converted from calibration files
_NUMBER: Final = re.compile(r"[+-]?\d+(\.\d*)?(e[+-]?\d+)?")
_MARKS: Final = re.compile(r"([][{},:])")  # of lists and parts
_DIMENSIONS: Final = (
    LENGTH, ANGLE, FRACTION, PIXELS, ELECTRONS, DURATION, EXPANSION, INVERSE_LENGTH, TEMPERATURE, PRESSURE, MASS,
    POWER, DATA, SOLID_ANGLE,
)  # fmt: skip


def are_alike(first: str, second: str) -> bool:
    """Whether two declared values mean the same, such as 0.01 deg and 0.01°.

    Numbers may differ by rounding, relative to the largest of their dimension in a list or part, or to 1 rad.
    """
    meanings = [[_meaning(part.strip("' ")) for part in _MARKS.split(text)] for text in (first, second)]
    if [kind for kind, _ in meanings[0]] != [kind for kind, _ in meanings[1]]:
        return False
    scales = {ANGLE.name: 1.0}
    for kind, number in (*meanings[0], *meanings[1]):
        scales[kind] = max(scales.get(kind, 0.0), abs(number) if math.isfinite(number) else 0.0)
    pairs = zip(*meanings, strict=True)
    return all(a == b or abs(a - b) <= _ROUNDING * scales[kind] for (kind, a), (_, b) in pairs)


def _meaning(text: str) -> tuple[str, float]:
    """The meaning of a value for comparisons: its dimension and SI value if it is a quantity, else the text itself."""
    if _NUMBER.fullmatch(text):
        return FRACTION.name, float(text)
    for dimension in _DIMENSIONS:
        try:
            return dimension.name, parse(text, dimension)
        except UnitError:
            continue
    return text, 0.0


_MOST_LINES: Final = 10
_MOST_ROWS: Final = 40
_INPUTS: Final = "Inputs that differ"
_MODELS: Final = "Models chosen differently"
_RESULTS: Final = "Results that differ by more than their error"


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """What differs between runs, each value in the order of the runs, and how much is the same.

    Parameters
    ----------
    headline
        How the answer changes, in one sentence; empty if no run has an answer.
    names, labels
        Folder of each run, and its short name.
    notes
        Sentences on what the runs do not share: the study, the program, cameras, distances.
    conclusions
        Answers that changed: requirements, claims, questions, the best camera over distance, usable ranges.
    unchanged
        Conclusions that did not change, in words.
    inputs, models
        Declared values and chosen models that differ.
    same_inputs
        Number of declared values that do not differ.
    results
        Numbers that differ by more than their error, the largest difference first.
    same_results
        Number of results that do not differ.
    overlay
        The figure of the curves that changed; None if there is nothing to draw.
    without_overlay
        Why there is no figure, as a sentence.
    """

    headline: str
    names: tuple[str, ...]
    labels: tuple[str, ...]
    notes: tuple[str, ...]
    conclusions: tuple[Difference, ...]
    unchanged: tuple[str, ...]
    inputs: tuple[Difference, ...]
    same_inputs: int
    models: tuple[Difference, ...]
    results: tuple[Difference, ...]
    same_results: int
    overlay: Drawing | None = field(compare=False, repr=False)
    without_overlay: str

    def __repr__(self) -> str:
        return "\n".join(map(escaped, self._lines())).replace("\N{NO-BREAK SPACE}", " ")

    def _lines(self) -> Iterator[str]:
        if self.headline:
            yield self.headline
        yield ARROW.join(self.names)
        yield from self.sentences()
        yield from self.notes
        yield from _section(_INPUTS, self.inputs, self.same_inputs)
        if self.models:
            yield from _section(_MODELS, self.models)
        yield from _section(_RESULTS, self.results, self.same_results)

    def sentences(self) -> Iterator[str]:
        """The conclusions that changed, one sentence each, and those that did not."""
        for what, members in itertools.groupby(self.conclusions, key=lambda difference: difference.what):
            yield f"{what}: {'; '.join(difference.change for difference in members)}."
        if self.unchanged:
            yield f"Unchanged: {'; '.join(self.unchanged)}."
        elif not self.conclusions:
            yield "The runs contain no conclusions to compare."

    def page(self) -> Report:
        """The comparison as a document."""
        return Report(
            title=f"{counted(len(self.names), 'run')} side by side",
            subtitle=ARROW.join(self.names),
            headline=literal(self.headline),
            blocks=tuple(self._blocks()),
        )

    def html(self) -> bytes:
        """The comparison as one self-contained HTML file."""
        from tradestudy.figures.drawn import drawn_here
        from tradestudy.report.html import render_html

        pictures = drawn_here({} if self.overlay is None else {self.overlay.name: self.overlay})
        return render_html(self.page(), pictures)

    def _blocks(self) -> Iterator[Block]:
        yield Callout(title="What changed", blocks=(Bullets(tuple(self.sentences())),), tone="answer")
        for note in self.notes:
            yield Paragraph(note)
        yield Heading(text=_INPUTS, anchor="inputs")
        yield from self._table("differing-inputs", _INPUTS, self.inputs, self.same_inputs)
        if self.models:
            yield Heading(text=_MODELS, anchor="models")
            yield from self._table("differing-models", _MODELS, self.models)
        yield Heading(text=_RESULTS, anchor="results")
        if self.overlay is None:
            yield Paragraph(self.without_overlay)
        else:
            yield Picture(name=self.overlay.name, caption=self.overlay.caption, alt=self.overlay.alt)
        yield from self._table("differing-results", _RESULTS, self.results, self.same_results)

    def _table(
        self, name: str, title: str, differences: Sequence[Difference], same: int | None = None
    ) -> Iterator[Block]:
        shown = differences[:_MOST_ROWS]
        if not shown:
            yield Paragraph("None." if same is None else f"None of {same}.")
            return
        wide = any(difference.where for difference in shown)
        columns = [Column(title="What", weight=3), *(Column(title=label, weight=2) for label in self.labels)]
        rows = [(difference.what, *difference.values, *([difference.where] if wide else [])) for difference in shown]
        yield Table(
            name=name,
            caption=f"{_heading(title, differences, same)}.",
            columns=(*columns, *([Column(title="Where, and by how much", weight=2)] if wide else [])),
            rows=tuple(rows),
            notes=(_more(differences, _MOST_ROWS),) if len(differences) > _MOST_ROWS else (),
        )


def _section(title: str, differences: Sequence[Difference], same: int | None = None) -> Iterator[str]:
    """A heading with the number of differences, and the first of them, one per line."""
    if not differences:
        yield f"{title}: none{'' if same is None else f' of {same}'}"
        return
    yield f"{_heading(title, differences, same)}:"
    yield from (f"  {difference}" for difference in differences[:_MOST_LINES])
    if len(differences) > _MOST_LINES:
        yield f"  {_more(differences, _MOST_LINES)}"


def _heading(title: str, differences: Sequence[Difference], same: int | None) -> str:
    return title if same is None else f"{title}, {len(differences)} of {len(differences) + same}"


def _more(differences: Sequence[Difference], shown: int) -> str:
    return f"and {len(differences) - shown} more"
