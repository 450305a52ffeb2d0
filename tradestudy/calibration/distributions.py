"""From the distributions of a study file to those that are propagated."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import assert_never

import numpy as np

from tradestudy.calibration.declaration import (
    ArcsinePart,
    CurvilinearTrapezoidPart,
    DistributionPart,
    EmpiricalPart,
    NormalPart,
    StudentTPart,
    TriangularPart,
    UniformPart,
)
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.distributions import (
    Arcsine,
    CurvilinearTrapezoid,
    Distribution,
    Empirical,
    Normal,
    StudentT,
    Triangular,
    Uniform,
)
from tradestudy.uncertainty.sources import ErrorClass


def distribution_of(part: DistributionPart, folder: Path) -> Distribution:
    """The distribution that a part of a study file describes; files are looked for in ``folder``.

    Raises
    ------
    OutOfRangeError
        A file of draws cannot be read, or values that do not make a distribution.
    """
    if isinstance(part, EmpiricalPart):
        return Empirical(draws=_column(folder / part.file, part.column))
    middle = float(part.mean or 0.0)
    match part:
        case NormalPart():
            return Normal(mean=middle, standard_deviation=part.standard_deviation)
        case UniformPart():
            return Uniform(low=middle - part.half_width, high=middle + part.half_width)
        case TriangularPart():
            return Triangular(low=middle - part.half_width, mode=middle, high=middle + part.half_width)
        case StudentTPart():
            return StudentT(location=middle, scale=part.scale, degrees_of_freedom=part.degrees_of_freedom)
        case ArcsinePart():
            return Arcsine(low=middle - part.half_width, high=middle + part.half_width)
        case CurvilinearTrapezoidPart():
            return CurvilinearTrapezoid(
                low=middle - part.half_width, high=middle + part.half_width, inexactness=part.inexactness
            )
        case _:
            assert_never(part)


def error_class_of(part: DistributionPart, default: ErrorClass) -> ErrorClass:
    """How often an error is drawn anew."""
    return default if part.drawn is None else _CLASSES[part.drawn]


_CLASSES = {
    "per rig": ErrorClass.RIG,
    "per session": ErrorClass.SESSION,
    "per lens": ErrorClass.ELEMENT,
    "per measurement": ErrorClass.MEASUREMENT,
}


def _column(path: Path, name: str) -> FloatArray:
    """One column of numbers from a CSV file."""
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            reader = csv.DictReader(stream)
            header, rows = list(reader.fieldnames or ()), list(reader)
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "no text"
        raise OutOfRangeError("a file of draws cannot be read", value=f"{path.name}: {why}") from None
    if name not in header:
        raise OutOfRangeError(
            f"{path.name} has no column of draws",
            value=name,
            limit=", ".join(header) or "no columns",
            remedy="name the columns in the first line",
        )
    try:
        return np.array([float(row[name]) for row in rows])
    except (TypeError, ValueError):
        raise OutOfRangeError(
            f"the column {name} of {path.name} holds a cell that is no number", remedy="remove units and text"
        ) from None
