"""/cost: error against seconds for the sets of models that were measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import ESTIMATE, Variable

_ENTRY: Final = ("entry",)
_PROBLEM: Final = ("problem",)


def _words(dims: tuple[str, ...], long_name: str) -> Variable:
    return Variable(dims=dims, units="", long_name=long_name)


COST: Final[Mapping[str, Variable]] = {
    "problem_of": _words(_ENTRY, "camera or light path that the entry belongs to, by its label along 'problem'"),
    "models": _words(_ENTRY, "models and settings of the entry, in words"),
    "relative_error": Variable(
        dims=_ENTRY,
        units="1",
        long_name="relative difference from 'reference', but at least reference_error: for a camera, the largest "
        "difference in depth uncertainty over all distances; for a light path, the difference in the image, in the L2 "
        "norm over pixels; infinite where the entry has no answer",
        error="see reference_error",
    ),
    "seconds": Variable(
        dims=_ENTRY,
        units="s",
        long_name="wall-clock time with empty caches: the shortest of three measurements or, for a long computation, "
        "the only one",
        error="not estimated: other work on the machine adds to the time",
    ),
    "chosen": Variable(dims=_ENTRY, units="1", long_name="whether a run of the study uses these models"),
    "frontier": Variable(
        dims=_ENTRY, units="1", long_name="whether every other entry of the same problem is slower or less accurate"
    ),
    "next_digit": Variable(
        dims=_ENTRY,
        units="1",
        long_name="whether this is the fastest entry of its problem with at most a tenth of the error of the chosen "
        "entry",
    ),
    "title": _words(_PROBLEM, "name of the camera or light path in figures and tables"),
    "reference": _words(
        _PROBLEM, "computation that the entries are compared with, in words; empty where there was no time for one"
    ),
    "reference_error": Variable(
        dims=_PROBLEM,
        units="1",
        long_name="relative error of 'reference'; NaN where that is empty",
        error=ESTIMATE,
    ),
    "left_out": _words(_PROBLEM, "what was not measured, and why, line by line"),
}
