"""The forms in which a study uses its cameras: as declared, under readings, in designs, for inverse questions."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import Entry
from tradestudy.study.varying import SweepAxis, Varying, sweep_axes

# The largest number of designs examined in a sweep, evenly along each axis with its ends. The ends alone are not
# enough: changes are not monotonic where a design between them is in focus and they are not.
_MOST_DESIGNS: Final = 48
_ENDS: Final = 2
# Number of values examined of the parameter that an inverse question varies, including its ends.
_OF_QUESTIONS: Final = 5


def every_variant(definition: StudyDefinition) -> Iterator[tuple[str, StudyDefinition]]:
    """The study, its readings, designs of its sweep, values of its inverse questions and ends of its assumptions.

    Each comes with the name of its reading or question, which may use models of its own; "" for study and designs.
    """
    yield "", definition
    yield from definition.readings.items()
    for axes in _axes_of_cameras(definition):
        for values in _designs(axes):
            yield "", definition.with_values({axis.path: value for axis, value in zip(axes, values, strict=True)})
    for name, question in definition.file.solve.items():
        varying = Varying.of(definition, question)
        for value in np.linspace(varying.low, varying.high, _OF_QUESTIONS):
            yield name, definition.with_values(varying.changes(float(value)))
    for variant in _assumed(definition):
        yield "value_of_information", variant


def _axes_of_cameras(definition: StudyDefinition) -> Iterator[tuple[SweepAxis, ...]]:
    """For every camera, the axes of the sweep that can change it; each set of axes once.

    An axis of another camera would take the place of designs in which the camera itself changes.
    """
    axes = sweep_axes(definition)
    paths = [definition.document.path_of(axis.path) for axis in axes]
    found = (
        tuple(axis for axis, path in zip(axes, paths, strict=True) if path[0] != "cameras" or path[1] == name)
        for name in definition.case.cameras
    )
    yield from dict.fromkeys(own for own in found if own)


def _assumed(definition: StudyDefinition) -> Iterator[StudyDefinition]:
    """The study with each assumption at either of its ends, the others as declared."""
    part = definition.file.value_of_information
    for one in part.assumptions.values() if part is not None else ():
        if one.readings is None:
            for value in (one.low, one.high):
                yield definition.with_values(dict.fromkeys(one.paths, value))
        for name in one.readings or ():
            yield definition.with_values(definition.entries_of_reading(name))


def _designs(axes: Sequence[SweepAxis]) -> Iterator[tuple[Entry, ...]]:
    """The values along all axes, for every design examined."""
    sizes = [len(axis.values) for axis in axes]
    while math.prod(sizes) > _MOST_DESIGNS and max(sizes) > _ENDS:
        sizes[sizes.index(max(sizes))] -= 1
    kept = [
        [axis.values[k] for k in np.unique(np.round(np.linspace(0, len(axis.values) - 1, size)).astype(int))]
        for axis, size in zip(axes, sizes, strict=True)
    ]
    return itertools.islice(itertools.product(*kept), _MOST_DESIGNS)
