"""Inputs varied by an inverse question or an assumption: a value between two ends, or a choice of readings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from tradestudy.errors import StudyError
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import Entry, ScalarEntry, text_of
from tradestudy.study.expectations import Varied, question_ends
from tradestudy.study.schema.value_of_information import AssumptionPart
from tradestudy.study.sweep import quantity_entry
from tradestudy.units import Dimension, UnitError, parse


@dataclass(frozen=True, kw_only=True)
class Varying:
    """Inputs of a study that all take the same varied value.

    Parameters
    ----------
    paths
        Their dotted paths.
    dimension, low, high
        Dimension of the value, and its ends in SI.
    is_counted
        Whether the study accepts only whole numbers, such as counts of pixels.
    """

    paths: tuple[str, ...]
    dimension: Dimension
    low: float
    high: float
    is_counted: bool

    @classmethod
    def of(cls, definition: StudyDefinition, question: Varied) -> Varying:
        """The inputs that a question varies.

        Raises
        ------
        OutOfRangeError
            If its ends have no common unit, or do not satisfy 0 < low < high.
        """
        return cls.between(definition, question.paths, *question_ends(question))

    @classmethod
    def between(
        cls, definition: StudyDefinition, paths: tuple[str, ...], dimension: Dimension, low: float, high: float
    ) -> Varying:
        """Inputs that take the same value between two ends, in SI; counted if the study refuses fractions."""
        plain = cls(paths=paths, dimension=dimension, low=low, high=high, is_counted=False)
        if dimension.unit or not (low.is_integer() and high.is_integer()):
            return plain
        try:
            definition.with_values(plain.changes(low + 0.5))
        except StudyError:
            return replace(plain, is_counted=True)
        return plain

    def declared(self, definition: StudyDefinition) -> set[float]:
        """The declared value, in SI, if it is a number between the ends; else empty."""
        entry = definition.document.entry(self.paths[0])
        try:
            value = math.nan if entry is None else parse(text_of(entry), self.dimension)
        except UnitError:  # such as "derived"
            value = math.nan
        return {value} if self.low <= value <= self.high else set()

    def at_share(self, share: float) -> float:
        """The possible value at a fraction of the way from low to high, on a logarithmic scale."""
        return self.possible(self.low * (self.high / self.low) ** share)

    def possible(self, value: float) -> float:
        """The value, in SI, rounded to a whole number if the inputs are counted."""
        return float(round(value)) if self.is_counted else value

    def changes(self, value: float) -> dict[str, Entry]:
        """Entries that replace the study's own values, by path."""
        entry = ScalarEntry.of(round(value)) if self.is_counted else quantity_entry(value, self.dimension)
        return dict.fromkeys(self.paths, entry)


@dataclass(frozen=True, kw_only=True)
class AnyReading:
    """The study as declared or one of its readings, all equally likely.

    Parameters
    ----------
    entries
        Entries that each reading sets, by path; the first mapping, of the study as declared, is empty.
    """

    entries: tuple[Mapping[str, Entry], ...]

    @classmethod
    def of(cls, definition: StudyDefinition, readings: Sequence[str]) -> AnyReading:
        """The study as declared, and the given readings."""
        return cls(entries=({}, *(definition.entries_of_reading(name) for name in readings)))

    def at_share(self, share: float) -> float:
        """The index of the choice at a fraction of the way through the list."""
        return float(min(int(share * len(self.entries)), len(self.entries) - 1))

    def changes(self, value: float) -> dict[str, Entry]:
        """Entries that replace the study's own values, by path."""
        return dict(self.entries[int(value)])


def assumed(definition: StudyDefinition, part: AssumptionPart) -> Varying | AnyReading:
    """The inputs that an assumption varies."""
    return Varying.of(definition, part) if part.readings is None else AnyReading.of(definition, part.readings)
