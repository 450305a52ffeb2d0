"""Measured entries of a cost table: the frontier of those that nothing beats, the price of the next digit, of draws."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from tradestudy.optics.arrays import BoolArray
from tradestudy.results.cost import NO_ANSWER

NEXT_FACTOR: Final = 10.0
DIGITS: Final = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
NOWHERE_USABLE: Final = "everything: usable at no distance of the study; other distances or looser limits measure it"
SOBOL, PLAIN = "scrambled Sobol", "plain Monte Carlo"
_ROUNDING: Final = 1e-12  # of an error that is divided by that factor


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

    @property
    def words(self) -> str:
        """Model and setting."""
        return ", ".join(filter(None, (self.model, self.setting)))


@dataclass(frozen=True, kw_only=True)
class CostTable:
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
    ways
        By what a study asks for a model, in words; a model that is not in it is measured for comparison only.
    of_a_run
        Whether a run of the study computes this quantity.
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
    ways: Mapping[str, str] = field(default_factory=dict)
    of_a_run: bool = True

    def told(self, entry: Entry) -> float:
        """The smallest error that an entry can be said to have: its own, or that of the reference if it is larger."""
        return max(entry.error, self.reference_error)


def on_frontier(errors: Sequence[float], seconds: Sequence[float], floor: float) -> BoolArray:
    """Which entries no other beats: as small an error in as little time, and less of one.

    Parameters
    ----------
    errors, seconds
        Of the entries; what is no answer is beaten by every other.
    floor
        Error of the reference: errors below it count as equal.
    """
    error = np.maximum(np.where(np.less_equal(errors, NO_ANSWER), errors, np.inf), floor)
    took = np.asarray(seconds, dtype=np.float64)
    no_worse = (error[:, None] <= error) & (took[:, None] <= took)
    better = (error[:, None] < error) | (took[:, None] < took)
    return np.asarray(~np.any(no_worse & better, axis=0) & np.isfinite(error))


@dataclass(frozen=True, kw_only=True)
class NextDigit:
    """What a tenth of an error costs, by what was measured and by nothing in between.

    Parameters
    ----------
    own
        What is chosen.
    wanted
        A tenth of its error.
    found
        The cheapest entry that errs by at most that; None where nothing measured does.
    quicker
        The entry that errs least of those that take no more time than what is chosen and err less; None for none.
    """

    own: Entry
    wanted: float
    found: Entry | None
    quicker: Entry | None


def cheapest_within(measured: CostTable, error: float) -> Entry | None:
    """The entry that takes least of those that err by at most so much; None where nothing measured does.

    No entry errs by less than the reference, as far as anybody can tell. Nothing is read between entries: two models
    have nothing between them that could be had, and of one model only what was measured is known.
    """
    within = [entry for entry in _answers(measured) if measured.told(entry) <= error * (1.0 + _ROUNDING)]
    return min(within, key=lambda entry: (entry.seconds, entry.error), default=None)


def most_accurate(measured: CostTable, entries: Sequence[Entry] | None = None) -> Entry | None:
    """The one of some entries, else of all, that errs least, of equals the quickest; None where none has an answer."""
    among = _answers(measured) if entries is None else entries
    return min(among, key=lambda entry: (measured.told(entry), entry.seconds), default=None)


def next_digit(measured: CostTable) -> NextDigit | None:
    """What a tenth of the error of the most accurate chosen entry costs; None where nothing is chosen."""
    answers = _answers(measured)
    own = most_accurate(measured, [entry for entry in answers if entry.chosen])
    if own is None:
        return None
    error, wanted = measured.told(own), measured.told(own) / NEXT_FACTOR
    better = [entry for entry in answers if entry.seconds <= own.seconds and measured.told(entry) < error]
    return NextDigit(
        own=own,
        wanted=wanted,
        found=cheapest_within(measured, wanted),
        quicker=most_accurate(measured, better),
    )


def a_tenth_of_what_is_asked(measured: CostTable) -> Entry | None:
    """The cheapest entry within a tenth of what the study asks for; None where nothing is, or nothing is asked."""
    return None if math.isnan(measured.asked) else cheapest_within(measured, measured.asked / NEXT_FACTOR)


def _answers(measured: CostTable) -> list[Entry]:
    """The entries whose errors are those of an answer."""
    return [entry for entry in measured.entries if entry.error <= NO_ANSWER]


def nothing_measured(name: str, title: str, says: str, why: str) -> CostTable:
    """A table without entries, and why."""
    return CostTable(
        name=name,
        title=title,
        says=says,
        reference="none",
        reference_error=math.nan,
        reference_seconds=math.nan,
        entries=(),
        left_out=(why,),
    )


def gain(entries: Sequence[Entry], floor: float) -> Iterator[str]:
    """How many times fewer draws Sobol points need, by the median error over places."""
    saved = draws_saved(entries, floor)
    if saved is not None:
        least = "at least " if saved.at_least else ""
        yield (
            f"For a typical error of {100.0 * saved.error:.2g} % scrambled Sobol draws need {least}{saved.factor:.3g} "
            "times fewer evaluations than plain Monte Carlo draws."
        )


@dataclass(frozen=True, kw_only=True)
class DrawsSaved:
    """How many times fewer draws Sobol points need for a typical error; ``at_least`` where the fewest are enough."""

    error: float
    factor: float
    at_least: bool


def draws_saved(entries: Sequence[Entry], floor: float) -> DrawsSaved | None:
    """Compare the draws for the smallest typical error that both ways reach and that the reference can tell.

    Between measured numbers of draws the error is read log–log. None where either way was measured less than twice.
    """
    curves = {}
    for model in (SOBOL, PLAIN):
        rows = sorted(
            (
                (entry.evaluations, entry.typical_error)
                for entry in entries
                if entry.model == model and entry.evaluations > 0.0 and entry.typical_error > 2.0 * floor
            ),
        )
        if len(rows) < 2:
            return None
        draws, errors = (np.array(column) for column in zip(*rows, strict=True))
        # One that happens to be smaller than its successor does not make fewer draws enough.
        curves[model] = (draws, np.maximum.accumulate(errors[::-1])[::-1])
    error = max(float(errors[-1]) for _, errors in curves.values())
    needed = {
        model: math.exp(float(np.interp(-math.log(error), -np.log(errors), np.log(draws))))
        for model, (draws, errors) in curves.items()
    }
    return DrawsSaved(error=error, factor=needed[PLAIN] / needed[SOBOL], at_least=bool(error > curves[SOBOL][1][0]))
