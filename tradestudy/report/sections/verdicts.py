"""The camera that noise and calibration favour, and the verdict on the main pair under other readings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr

from tradestudy.report.document import Block, Bullets, Column, Heading, Spans, Table, Text, say
from tradestudy.results.views.decision import Flips, answer_title, flips, readings_in_words
from tradestudy.results.views.groups import camera_titles, group, has
from tradestudy.units import significant
from tradestudy.wording import counted, distance, with_article


def describe_verdicts(tree: xr.DataTree) -> Iterator[Block]:
    """Say which camera noise and calibration favour on their own, and list the verdict under other readings."""
    favoured, table = tuple(_favoured_cameras(tree)), tuple(_stability(tree))
    if table:
        yield Heading(text="Which camera each error source favours", anchor="verdicts")
        yield Bullets(favoured)
        yield from table


def _favoured_cameras(tree: xr.DataTree) -> Iterator[Spans]:
    """Say which camera matching noise and calibration errors favour, each alone, and at how many distances."""
    if not has(tree, "decision", "more_certain", "uncertainty_ratio"):
        return
    decision, titles = group(tree, "decision"), camera_titles(tree)
    pair, declared = [str(decision.attrs[end]) for end in ("first", "second")], decision.isel(reading=0)
    yield say(
        "Between {first} and {second}, {noise}; {calibration}.",
        first=with_article(titles[pair[0]]),
        second=with_article(titles[pair[1]]),
        noise=f"matching noise alone {_favoured(declared.sel(error_source='noise'), pair, titles, 's')}",
        calibration=f"calibration errors alone {_favoured(declared.sel(error_source='calibration'), pair, titles, '')}",
    )


def _favoured(decision: xr.Dataset, pair: list[str], titles: Mapping[str, str], s: str) -> str:
    """Count the wins, ties and undecided distances of one error source; `s` ends the verbs of one in the singular.

    Equal uncertainties are ties.
    """
    names = [str(name) for name in decision["more_certain"].values]
    neither = np.asarray(decision["uncertainty_ratio"].values, dtype=np.float64)[[not name for name in names]]
    undecided = int(np.isnan(neither).sum())
    wins = {key: names.count(key) for key in pair}
    parts = [
        f"favour{s} {with_article(titles[key])} at {wins[key]}"
        for key in sorted(pair, key=lambda key: -wins[key])
        if wins[key] > 0
    ]
    parts += [f"leave{s} a tie at {neither.size - undecided}"] if neither.size > undecided else []
    parts += [f"decide{s} nothing at {undecided}"] if undecided else []
    if len(parts) == 1 and len(names) > 1:
        parts = [f"{parts[0].rpartition(' at ')[0]} at all {len(names)} declared distances"]
    else:
        parts[0] += f" of {counted(len(names), 'declared distance')}"
    return ", ".join(parts)


def _stability(tree: xr.DataTree) -> Iterator[Block]:
    """List the verdict on the main pair under the other readings, at each declared distance."""
    found = tuple(flips(tree))
    if not found:
        return
    titles, decision = camera_titles(tree), group(tree, "decision")
    says = readings_in_words(decision)
    others = any(one.alternatives for one in found)  # readings
    pair = f"{titles[decision.attrs['first']]} against {with_article(titles[decision.attrs['second']])}"
    changed = ", and the other readings that change this, each with the camera that is then better" if others else ""
    yield Table(
        name="verdict-table",
        caption=f"{pair}: the better camera of those that are usable{changed}. On the right: the camera with the "
        "smaller depth uncertainty, usable or not, and the ratio of the two uncertainties.",
        columns=(
            Column(title="At", align="right"),
            Column(title="Better, where usable", weight=0 if others else 1),
            *((Column(title="Other readings that change this", weight=1),) if others else ()),
            Column(title="More certain", weight=0 if others else 1),
            Column(title="By a factor of", align="right"),
        ),
        rows=tuple(
            (
                distance(one.place),
                answer_title(titles, one.winner, "neither"),
                *((_flipped(one, titles, says),) if others else ()),
                answer_title(titles, one.more_certain, "neither" if np.isnan(one.ratio) else "tied"),
                _factor(one.ratio) + (", within the tolerance" if one.within_tolerance else ""),
            )
            for one in found
        ),
    )


def _factor(ratio: float) -> str:
    """Write the factor by which the better camera is more certain, from a ratio in either direction."""
    if np.isnan(ratio):
        return "—"
    if not 0.0 < ratio < np.inf:
        return "∞"
    factor = max(ratio, 1.0 / ratio)
    written = (significant(factor, digits) for digits in range(2, 5))
    return next((words for words in written if words != "1"), "1" if factor == 1.0 else "about 1")


def _flipped(one: Flips, titles: Mapping[str, str], says: Mapping[str, str]) -> Text:
    return say(
        "**{count} of {all}**{names}",
        count=str(len(one.flipped)),
        all=str(one.alternatives),
        names=(": " if one.flipped else "")
        + "; ".join(f"“{says[name]}” ({answer_title(titles, winner, 'neither')})" for name, winner in one.flipped),
    )
