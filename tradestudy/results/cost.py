"""/cost: error against seconds for the sets of models that were measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import Variable

_ENTRY: Final = ("entry",)
_PROBLEM: Final = ("problem",)


def _words(dims: tuple[str, ...], long_name: str) -> Variable:
    return Variable(dims=dims, units="", long_name=long_name)


COST: Final[Mapping[str, Variable]] = {
    "problem_of": _words(_ENTRY, "camera or light path, by its name along the dimension 'problem'"),
    "models": _words(_ENTRY, "models and settings of the entry, in words"),
    "relative_error": Variable(
        dims=_ENTRY,
        units="1",
        long_name="largest relative error over all distances, or relative L2 error over the pixels, compared with the "
        "reference; at least the error of the reference itself; infinite where there is no answer",
        error="that of the reference, see reference_error",
    ),
    "seconds": Variable(
        dims=_ENTRY,
        units="s",
        long_name="wall time with empty caches: the shortest of three runs; for long computations, of one run",
        error="other work on the machine adds to it",
    ),
    "chosen": Variable(dims=_ENTRY, units="1", long_name="whether a run of the study uses these models"),
    "frontier": Variable(dims=_ENTRY, units="1", long_name="whether no other entry is as accurate in as little time"),
    "next_digit": Variable(
        dims=_ENTRY,
        units="1",
        long_name="whether this entry is the fastest with at most a tenth of the error of the chosen entry",
    ),
    "title": _words(_PROBLEM, "name of the camera or light path in figures and sentences"),
    "reference": _words(_PROBLEM, "computation to which errors refer, in words; empty where there was no time for it"),
    "reference_error": Variable(
        dims=_PROBLEM,
        units="1",
        long_name="relative error of the reference; NaN without a reference",
        error="itself an estimate",
    ),
    "left_out": _words(_PROBLEM, "what was not measured and why, one line each"),
}
