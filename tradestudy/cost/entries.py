"""Measured entries of a cost table, the frontier of those that nothing beats, and the price of the next digit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.optics.arrays import BoolArray

NEXT_FACTOR: Final = 10.0


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One model at one setting.

    Parameters
    ----------
    model, setting
        In words.
    evaluations
        Draws, nodes or other evaluations that the work is counted in; NaN where it is not.
    error
        Relative error against the reference, the worst over cameras and places.
    typical_error
        The median over cameras and places.
    seconds, least_seconds
        Median and least wall time over the repeats [s]; of 5 s and more that of the one traced run.
    peak_memory
        Largest memory that Python and numpy held at once during the computation [bytes].
    repeats
        How often it was timed.
    chosen
        Whether a run of the study computes it so.
    """

    model: str
    setting: str
    evaluations: float
    error: float
    typical_error: float
    seconds: float
    least_seconds: float
    peak_memory: float
    repeats: int
    chosen: bool = False


@dataclass(frozen=True, kw_only=True)
class Measured:
    """All entries for one quantity of a study.

    Parameters
    ----------
    name, title
        Name in the results, and words.
    says
        What error and seconds are of.
    reference
        What the error is against.
    reference_error
        Relative error of the reference itself; no error below it means anything.
    reference_seconds
        What the reference took [s].
    entries
        Model by model.
    left_out
        What could be asked and was not measured, and why.
    notes
        What else follows from the measurements.
    asked
        Relative error that the study asks for; NaN where it asks for none.
    """

    name: str
    title: str
    says: str
    reference: str
    reference_error: float
    reference_seconds: float
    entries: tuple[Entry, ...]
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    asked: float = math.nan


def on_frontier(errors: Sequence[float], seconds: Sequence[float], floor: float) -> BoolArray:
    """Which entries no other beats: as small an error in as little time, and less of one.

    Parameters
    ----------
    errors, seconds
        Of the entries; an error that is no finite number is beaten by every other.
    floor
        Error of the reference: errors below it count as equal.
    """
    error = np.maximum(np.where(np.isfinite(errors), errors, np.inf), floor)
    took = np.asarray(seconds, dtype=np.float64)
    no_worse = (error[:, None] <= error) & (took[:, None] <= took)
    better = (error[:, None] < error) | (took[:, None] < took)
    return np.asarray(~np.any(no_worse & better, axis=0) & np.isfinite(error))


@dataclass(frozen=True, kw_only=True)
class NextDigit:
    """What a tenth of an error costs.

    Parameters
    ----------
    error, seconds
        Of what is chosen.
    wanted
        A tenth of that error.
    needed
        Seconds along the frontier [s]; infinite where nothing measured is that accurate.
    best, best_seconds
        The smallest error on the frontier and its time.
    below_reference
        Whether the wanted error is below that of the reference, so that nobody can tell.
    """

    error: float
    seconds: float
    wanted: float
    needed: float
    best: float
    best_seconds: float
    below_reference: bool


def seconds_for(error: float, frontier: Sequence[tuple[float, float]]) -> float:
    """Seconds that an error costs along a frontier of (error, seconds), log–log between its entries.

    The seconds of its cheapest entry where the error is larger than all, infinite where it is smaller than all.
    """
    falling = sorted(frontier, reverse=True)
    errors, seconds = (np.array(column, dtype=np.float64) for column in zip(*falling, strict=True))
    if error >= errors[0]:
        return float(seconds[0])
    if error < errors[-1] * (1.0 - 1e-12):
        return math.inf
    if errors[-1] <= 0.0:  # an exact entry is as far away as any: it is there or it is not
        first = int(np.argmax(errors <= error))
        return float(seconds[first])
    place = np.interp(-math.log(error), -np.log(errors), np.log(seconds))
    return float(math.exp(place))


def next_digit(measured: Measured) -> NextDigit | None:
    """What a tenth of the error of the most accurate chosen entry costs; None where nothing is chosen."""
    chosen = [entry for entry in measured.entries if entry.chosen and math.isfinite(entry.error)]
    if not chosen:
        return None
    floor = measured.reference_error
    own = min(chosen, key=lambda entry: (max(entry.error, floor), entry.seconds))
    frontier = _frontier(measured)
    best, best_seconds = min(frontier)
    wanted = max(own.error, floor) / NEXT_FACTOR
    return NextDigit(
        error=own.error,
        seconds=own.seconds,
        wanted=wanted,
        needed=seconds_for(wanted, frontier),
        best=best,
        best_seconds=best_seconds,
        below_reference=wanted < floor,
    )


def seconds_for_a_tenth_of_what_is_asked(measured: Measured) -> float:
    """Seconds along the frontier; infinite where nothing measured is that accurate, NaN where nothing is asked."""
    frontier = _frontier(measured)
    if math.isnan(measured.asked) or not frontier:
        return math.nan
    return seconds_for(measured.asked / NEXT_FACTOR, frontier)


def _frontier(measured: Measured) -> list[tuple[float, float]]:
    """Errors, none below that of the reference, and seconds of the entries that nothing beats."""
    floor, entries = measured.reference_error, measured.entries
    kept = on_frontier([e.error for e in entries], [e.seconds for e in entries], floor) if entries else ()
    return [(max(entry.error, floor), entry.seconds) for entry, on in zip(entries, kept, strict=True) if on]


NOWHERE_USABLE: Final = "everything: usable at no distance of the study; other distances or looser limits measure it"


def nothing_measured(name: str, title: str, says: str, why: str) -> Measured:
    """A table without entries, and why."""
    return Measured(
        name=name,
        title=title,
        says=says,
        reference="none",
        reference_error=math.nan,
        reference_seconds=math.nan,
        entries=(),
        left_out=(why,),
    )
