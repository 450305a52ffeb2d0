"""Varied inputs: sweeps, in which every combination is a study of its own, inverse questions and assumptions."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from tradestudy.declarations.quantities import common_dimension
from tradestudy.errors import OutOfRangeError, StudyError, UnaffordableError
from tradestudy.study.document import Entry, ScalarEntry, overlap, text_of
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.schema.questions import AssumptionPart, SolvePart, SweepRangePart
from tradestudy.units import Dimension, UnitError, parse

if TYPE_CHECKING:
    from tradestudy.calibration.camera_target import TargetToInfer
    from tradestudy.calibration.posteriors import CornersToInfer


MOST_POINTS = 20_000
_NO_PART_OF_THE_SCENE = "scene.picture.matcher."  # describes the matching of pictures, not the scene


@dataclass(frozen=True, kw_only=True)
class SweepAxis:
    """One swept input: its dotted path, its values, and their labels (SI floats, or text for choices).

    ``declared`` is the label of the value that the study declares; empty if it declares none. Numeric values are
    increasing, in SI, and have a dimension.
    """

    path: str
    values: tuple[Entry, ...]
    labels: tuple[float, ...] | tuple[str, ...]
    units: str
    declared: float | str
    dimension: Dimension | None = None


def sweep_axes(study: PreparedStudy) -> tuple[SweepAxis, ...]:
    """The axes that a study declares; none if it has no sweep.

    Raises
    ------
    UnitError
        If a path overlaps another one or cannot be swept, or its values have no common unit.
    UnaffordableError
        If there are more than 20 000 combinations of values.
    """
    paths = [study.document.path_of(path) for path in study.file.sweep]
    for number, (path, part) in enumerate(study.file.sweep.items()):
        if what := overlap(paths[number], paths[:number]):
            raise UnitError(f"{path}: {what}")
        if path.startswith("scene.") and not path.startswith(_NO_PART_OF_THE_SCENE):
            raise UnitError(
                f"{path} cannot be swept, because all designs of a sweep share one scene; "
                "declare its values as readings, or compute a study for each value"
            )
        if not isinstance(part, SweepRangePart) and None in part:
            raise UnitError(f"{path}: null removes a value, but a sweep sets values; leave null out")
    axes = tuple(
        _axis(
            path,
            _values_of_range(path, part) if isinstance(part, SweepRangePart) else tuple(map(ScalarEntry.of, part)),
            study,
        )
        for path, part in study.file.sweep.items()
    )
    count = math.prod(len(axis.values) for axis in axes)
    if count > MOST_POINTS:
        raise UnaffordableError(
            "points of the sweep", value=str(count), limit=f"at most {MOST_POINTS}", remedy="sweep fewer values"
        )
    return axes


def axes_of_camera(study: PreparedStudy, camera_name: str) -> tuple[SweepAxis, ...]:
    """The axes of the sweep that can change a camera: its own, and those of what all cameras share."""
    paths = [(axis, study.document.path_of(axis.path)) for axis in sweep_axes(study)]
    return tuple(axis for axis, path in paths if path[0] != "cameras" or path[1] == camera_name)


def sweep_points(study: PreparedStudy, axes: tuple[SweepAxis, ...]) -> list[PreparedStudy]:
    """The study at every combination of values, with the last axis varying fastest; without axes, the study itself."""
    if not axes:
        return [study]
    return [
        study.with_values({axis.path: value for axis, value in zip(axes, values, strict=True)})
        for values in itertools.product(*(axis.values for axis in axes))
    ]


def calibrations_to_infer(study: PreparedStudy) -> dict[str, TargetToInfer | CornersToInfer]:
    """Calibrations to infer for the study, its readings and the designs of its sweep, by their `posterior_keys`."""
    declared = [study, *study.readings.values()]
    if not any(variant.definition.calibrations_to_infer() for variant in declared):
        return {}
    variants = [*declared, *sweep_points(study, sweep_axes(study))]
    return {key: request for variant in variants for key, request in variant.definition.calibrations_to_infer().items()}


def point_labels(axes: tuple[SweepAxis, ...]) -> list[str]:
    """A readable label of each combination, in the order of `sweep_points`."""
    if not axes:
        return ["the study as declared"]
    return [
        ", ".join(f"{axis.path}={text_of(value)}" for axis, value in zip(axes, values, strict=True))
        for values in itertools.product(*(axis.values for axis in axes))
    ]


def _values_of_range(path: str, part: SweepRangePart) -> tuple[ScalarEntry, ...]:
    dimension = common_dimension(part.start, part.stop)
    if dimension is None:
        raise UnitError(f"{path}: '{part.start}' and '{part.stop}' have no common unit")
    start, stop = parse(part.start, dimension), parse(part.stop, dimension)
    if not math.isfinite(stop - start) or (part.spacing == "log" and not (start > 0.0 and stop > 0.0)):
        raise UnitError(f"{path}: a {part.spacing} range from '{part.start}' to '{part.stop}' is impossible")
    numbers = (np.geomspace if part.spacing == "log" else np.linspace)(start, stop, part.points)
    if not dimension.unit:  # rounding must not turn a count into a fraction
        numbers = np.where(np.isclose(numbers, np.round(numbers), rtol=1e-12, atol=0.0), np.round(numbers), numbers)
    return tuple(quantity_entry(float(number), dimension) for number in numbers)


def quantity_entry(number: float, dimension: Dimension) -> ScalarEntry:
    """An SI number as a value of a study."""
    if not dimension.unit and number.is_integer():  # which may be a count
        return ScalarEntry.of(int(number))
    return ScalarEntry.of(f"{number!r} {dimension.unit}" if dimension.unit else number)


def _axis(path: str, values: tuple[ScalarEntry, ...], study: PreparedStudy) -> SweepAxis:
    """An axis of the swept values and the declared one, so that the study as declared is among the designs."""
    entry = study.document.entry(path)
    declared = "" if entry is None else text_of(entry)
    texts = [value.text for value in values]
    dimension = common_dimension(*texts, *([declared] if declared else []))
    points = texts if dimension is None else [parse(text, dimension) for text in texts]
    if len(set(points)) < len(points):
        twice = next(text for number, text in enumerate(texts) if points[number] in points[:number])
        raise UnitError(f"{path}: {twice} is given twice; give each value once")
    if dimension is None:
        choices: dict[str, Entry] = dict(zip(texts, values, strict=True))
        if entry is not None and declared:
            choices.setdefault(declared, entry)
        return SweepAxis(path=path, values=tuple(choices.values()), labels=tuple(choices), units="", declared=declared)
    labels: dict[float, Entry] = dict(zip(cast(list[float], points), values, strict=True))
    own_label = parse(declared, dimension) if declared else math.nan
    # Rounding can change the last digit of a range's ends; a value that close is the declared one.
    if entry is not None and declared and not any(math.isclose(label, own_label, rel_tol=1e-12) for label in labels):
        labels[own_label] = entry
    ordered = sorted(labels)
    swept = tuple(labels[label] for label in ordered)
    own = next((label for label in ordered if math.isclose(label, own_label, rel_tol=1e-12)), "")
    if math.isinf(ordered[-1]):  # nothing can be drawn or searched between a number and infinity
        words = {label: text_of(entry) for label, entry in labels.items()}
        own_words = words[own] if isinstance(own, float) else ""
        choices_in_order = tuple(words[label] for label in ordered)
        return SweepAxis(path=path, values=swept, labels=choices_in_order, units="", declared=own_words)
    return SweepAxis(
        path=path, values=swept, labels=tuple(ordered), units=dimension.unit or "1", declared=own, dimension=dimension
    )


def question_ends(question: SolvePart | AssumptionPart) -> tuple[Dimension, float, float]:
    """The dimension of the values that an inverse question or an assumption varies, and the ends of their range in SI.

    Raises
    ------
    OutOfRangeError
        If the ends have no common unit, or do not satisfy 0 < low < high.
    """
    dimension = common_dimension(question.low, question.high)
    if dimension is None:
        raise OutOfRangeError("the ends have no common unit", value=f"{question.low} … {question.high}")
    low, high = parse(question.low, dimension), parse(question.high, dimension)
    if not 0.0 < low < high < math.inf:
        raise OutOfRangeError(
            "the ends of the varied range", value=f"{question.low} … {question.high}", limit="0 < low < high < ∞"
        )
    return dimension, low, high


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
    def of(cls, study: PreparedStudy, question: SolvePart | AssumptionPart) -> Varying:
        """The inputs that a question varies.

        Raises
        ------
        OutOfRangeError
            If its ends have no common unit, or do not satisfy 0 < low < high.
        """
        return cls.between(study, question.paths, *question_ends(question))

    @classmethod
    def between(
        cls, study: PreparedStudy, paths: tuple[str, ...], dimension: Dimension, low: float, high: float
    ) -> Varying:
        """Inputs that take the same value between two ends, in SI; counted if the study refuses fractions."""
        plain = cls(paths=paths, dimension=dimension, low=low, high=high, is_counted=False)
        if dimension.unit or not (low.is_integer() and high.is_integer()):
            return plain
        try:
            study.with_values(plain.changes(low + 0.5))
        except StudyError:
            return replace(plain, is_counted=True)
        return plain

    def declared(self, study: PreparedStudy) -> set[float]:
        """The declared value, in SI, if it is a number between the ends; else empty."""
        entry = study.document.entry(self.paths[0])
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
    def of(cls, study: PreparedStudy, readings: Sequence[str]) -> AnyReading:
        """The study as declared, and the given readings."""
        return cls(entries=({}, *(study.definition.entries_of_reading(name) for name in readings)))

    def at_share(self, share: float) -> float:
        """The index of the choice at a fraction of the way through the list."""
        return float(min(int(share * len(self.entries)), len(self.entries) - 1))

    def changes(self, value: float) -> dict[str, Entry]:
        """Entries that replace the study's own values, by path."""
        return dict(self.entries[int(value)])


def assumed(study: PreparedStudy, part: AssumptionPart) -> Varying | AnyReading:
    """The inputs that an assumption varies."""
    return Varying.of(study, part) if part.readings is None else AnyReading.of(study, part.readings)
