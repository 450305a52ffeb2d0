"""Sweeps: vary values of a study over lists or ranges; every combination is a study of its own."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tradestudy.declarations.quantities import common_dimension
from tradestudy.errors import UnaffordableError
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import Entry, ScalarEntry, text_of
from tradestudy.study.schema.questions import SweepRangePart
from tradestudy.units import Dimension, UnitError, parse

if TYPE_CHECKING:  # heavy, and only some studies infer calibrations
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


def sweep_axes(definition: StudyDefinition) -> tuple[SweepAxis, ...]:
    """The axes that a study declares; none if it has no sweep."""
    for path, part in definition.file.sweep.items():
        if path.startswith("scene.") and not path.startswith(_NO_PART_OF_THE_SCENE):
            raise UnitError(
                f"{path} cannot be swept, because all designs of a sweep share one scene; "
                "declare its values as readings, or compute a study for each value"
            )
        if not isinstance(part, SweepRangePart) and None in part:
            raise UnitError(f"{path}: null removes a value, but a sweep sets values; leave null out")
    return tuple(
        _axis(
            path,
            _values_of_range(path, part) if isinstance(part, SweepRangePart) else tuple(map(ScalarEntry.of, part)),
            definition,
        )
        for path, part in definition.file.sweep.items()
    )


def sweep_points(definition: StudyDefinition, axes: tuple[SweepAxis, ...]) -> list[StudyDefinition]:
    """The study at every combination of values, with the last axis varying fastest; without axes, the study itself.

    Raises
    ------
    UnaffordableError
        If there are more than 20 000 combinations.
    """
    if not axes:
        return [definition]
    count = int(np.prod([len(axis.values) for axis in axes]))
    if count > MOST_POINTS:
        raise UnaffordableError(
            "points of the sweep", value=str(count), limit=f"at most {MOST_POINTS}", remedy="sweep fewer values"
        )
    return [
        definition.with_values({axis.path: value for axis, value in zip(axes, values, strict=True)})
        for values in itertools.product(*(axis.values for axis in axes))
    ]


def calibrations_to_infer(definition: StudyDefinition) -> dict[str, TargetToInfer | CornersToInfer]:
    """Calibrations to infer for the study, its readings and the designs of its sweep, by their `posterior_keys`."""
    declared = [definition, *definition.readings.values()]
    if not any(one.calibrations_to_infer() for one in declared):
        return {}
    variants = [*declared, *sweep_points(definition, sweep_axes(definition))]
    return {key: one for variant in variants for key, one in variant.calibrations_to_infer().items()}


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
    return tuple(quantity_entry(float(number), dimension) for number in numbers)


def quantity_entry(number: float, dimension: Dimension) -> ScalarEntry:
    """An SI number as a value of a study."""
    return ScalarEntry.of(f"{number!r} {dimension.unit}" if dimension.unit else number)


def _axis(path: str, values: tuple[ScalarEntry, ...], definition: StudyDefinition) -> SweepAxis:
    """An axis of the swept values and the declared one, so that the study as declared is among the designs."""
    entry = definition.document.entry(path)
    declared = "" if entry is None else text_of(entry)
    texts = [value.text for value in values]
    dimension = common_dimension(*texts, *([declared] if declared else []))
    if dimension is None:
        choices: dict[str, Entry] = dict(zip(texts, values, strict=True))
        if entry is not None and declared:
            choices.setdefault(declared, entry)
        return SweepAxis(path=path, values=tuple(choices.values()), labels=tuple(choices), units="", declared=declared)
    labels: dict[float, Entry] = {parse(value.text, dimension): value for value in values}
    own = parse(declared, dimension) if declared else math.nan
    # Rounding can change the last digit of a range's ends; a value that close is the declared one.
    if entry is not None and declared and not any(math.isclose(label, own, rel_tol=1e-12) for label in labels):
        labels[own] = entry
    ordered = sorted(labels)
    return SweepAxis(
        path=path,
        values=tuple(labels[label] for label in ordered),
        labels=tuple(ordered),
        units=dimension.unit or "1",
        declared=next((label for label in labels if math.isclose(label, own, rel_tol=1e-12)), ""),
        dimension=dimension,
    )
