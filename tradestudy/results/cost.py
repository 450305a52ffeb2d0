"""/cost: error against seconds for the sets of models that were measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import Variable

_ENTRY: Final = ("entry",)
_PIECE: Final = ("piece",)


def _words(dims: tuple[str, ...], long_name: str) -> Variable:
    return Variable(dims=dims, units="", long_name=long_name)


COST: Final[Mapping[str, Variable]] = {
    "piece_of": _words(_ENTRY, "the camera or light path that is answered for, by its name in piece"),
    "models": _words(_ENTRY, "models and settings, in words"),
    "relative_error": Variable(
        dims=_ENTRY,
        units="1",
        long_name="relative error against the reference, at least that of the reference: the worst over distances, or "
        "L2 over pixels; infinite for no answer",
        error="that of the reference, see reference_error",
    ),
    "seconds": Variable(
        dims=_ENTRY,
        units="s",
        long_name="wall time, computed afresh: the least of three times, of long computations the only one",
        error="other work on the machine adds to it",
    ),
    "chosen": Variable(dims=_ENTRY, units="1", long_name="whether a run of the study computes it so"),
    "frontier": Variable(dims=_ENTRY, units="1", long_name="whether no other entry errs as little in as little time"),
    "next_digit": Variable(
        dims=_ENTRY, units="1", long_name="whether it is the quickest with a tenth of the chosen entry's error or less"
    ),
    "title": _words(_PIECE, "name in figures and sentences"),
    "reference": _words(_PIECE, "what the errors are against; empty where there was no time for one"),
    "reference_error": Variable(
        dims=_PIECE, units="1", long_name="relative error of the reference; NaN without one", error="an estimate itself"
    ),
    "left_out": _words(_PIECE, "what was not measured and why, a line each"),
}
