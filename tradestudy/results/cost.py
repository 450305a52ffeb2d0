"""/cost: error against seconds for every model and setting that was measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import Variable

NO_ANSWER: Final = 10.0
"""A relative error above this is that of no answer at all."""
_ENTRY: Final = ("entry",)
_QUANTITY: Final = ("cost_quantity",)
_SCATTER: Final = "the repeats scatter; see least_seconds and repeats; of a single run it is not known"


def _words(dims: tuple[str, ...], long_name: str) -> Variable:
    return Variable(dims=dims, units="", long_name=long_name)


def _entry_of(name: str, what: str, *, none: str, dims: tuple[str, ...] = _QUANTITY) -> dict[str, Variable]:
    """One of the entries by its words, its error and its time."""
    return {
        f"{name}_entry": _words(dims, f"model and setting of {what}; empty {none}"),
        f"{name}_error": Variable(dims=dims, units="1", long_name=f"its error; NaN {none}", error="as relative_error"),
        f"{name}_seconds": Variable(dims=dims, units="s", long_name=f"its time; NaN {none}", error=_SCATTER),
    }


COST: Final[Mapping[str, Variable]] = {
    "quantity": _words(_ENTRY, "what is computed, by its name in cost_quantity"),
    "model": _words(_ENTRY, "model, in words"),
    "setting": _words(_ENTRY, "its setting, in words; empty where it has none"),
    "evaluations": Variable(
        dims=_ENTRY, units="1", long_name="draws, nodes or points that were evaluated; NaN for none", error="a count"
    ),
    "relative_error": Variable(
        dims=_ENTRY,
        units="1",
        long_name="relative error against the reference, the worst over cameras and places; infinite for no answer",
        error="that of the reference, see reference_error; of random methods the root mean square over the repeats",
    ),
    "typical_error": Variable(
        dims=_ENTRY,
        units="1",
        long_name="the median of that error over cameras and places",
        error="as relative_error",
    ),
    "seconds": Variable(
        dims=_ENTRY,
        units="s",
        long_name="median wall time over the repeats, computed afresh; of 5 s and more that of the one run, "
        "lengthened by the tracing of its memory",
        error=_SCATTER,
    ),
    "least_seconds": Variable(
        dims=_ENTRY, units="s", long_name="least wall time over the repeats, computed afresh", error=_SCATTER
    ),
    "peak_memory": Variable(
        dims=_ENTRY,
        units="byte",
        long_name="largest memory that Python and numpy held at once, traced by tracemalloc in the first run, which "
        "is the only one of 5 s and more; what compiled libraries allocate for themselves is not in it",
        error="exact for what it counts",
    ),
    "repeats": Variable(
        dims=_ENTRY, units="1", long_name="how often it was timed; 1 for 5 s and more", error="a count"
    ),
    "chosen": Variable(dims=_ENTRY, units="1", long_name="whether a run of the study computes it so"),
    "frontier": Variable(
        dims=_ENTRY, units="1", long_name="whether no other entry has as small an error in as little time"
    ),
    "title": _words(_QUANTITY, "name of the quantity in figures and tables"),
    "says": _words(_QUANTITY, "what error and seconds are of"),
    "reference": _words(_QUANTITY, "what the error is against"),
    "reference_error": Variable(
        dims=_QUANTITY,
        units="1",
        long_name="relative error of the reference; NaN where there was no time for one",
        error="an estimate itself",
    ),
    "reference_seconds": Variable(
        dims=_QUANTITY, units="s", long_name="wall time of the reference; NaN where there is none", error="taken once"
    ),
    "left_out": _words(_QUANTITY, "what was not measured and why"),
    "notes": _words(_QUANTITY, "what else follows"),
    **_entry_of(
        "chosen",
        "the most accurate of what a run of the study computes",
        none="where none of it was measured",
    ),
    "next_wanted": Variable(dims=_QUANTITY, units="1", long_name="a tenth of that error", error="as relative_error"),
    **_entry_of("next", "the cheapest entry within a tenth of that error", none="where nothing measured is"),
    **_entry_of(
        "quicker",
        "the most accurate of the entries that err less than what a run computes, in no more time",
        none="where there is none",
    ),
    **_entry_of("best", "the entry that errs least", none="where nothing was measured"),
    "asked_error": Variable(
        dims=_QUANTITY, units="1", long_name="relative error that the study asks for; NaN for none", error="declared"
    ),
    **_entry_of(
        "asked_tenth",
        "the cheapest entry within a tenth of what the study asks for",
        none="where nothing measured is, or nothing is asked",
    ),
    **_entry_of(
        "digit",
        "the cheapest entry that errs by at most digit",
        none="where nothing measured does",
        dims=("cost_quantity", "digit"),
    ),
}
