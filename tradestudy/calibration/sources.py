"""Which errors a camera of the study has, how they are distributed, and which are drawn together."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import assert_never

import numpy as np

from tradestudy.calibration.calibration_file import CalibrationDraws, read_calibration
from tradestudy.calibration.declaration import (
    ArcsinePart,
    CameraCalibrationPart,
    CurvilinearTrapezoidPart,
    DistributionPart,
    EmpiricalPart,
    NormalPart,
    StudentTPart,
    SurroundingsPart,
    TriangularPart,
    UniformPart,
)
from tradestudy.cameras.exact_model import ExactModel
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
from tradestudy.uncertainty.error_class import ErrorClass
from tradestudy.uncertainty.joint import GaussianCopula, JointDraws, JointNormal
from tradestudy.uncertainty.sources import Group, Source

_CLASSES = {
    "per rig": ErrorClass.RIG,
    "per session": ErrorClass.SESSION,
    "per lens": ErrorClass.ELEMENT,
    "per measurement": ErrorClass.MEASUREMENT,
}
SEPARATOR = "/"


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


def declared_groups(camera: ExactModel, part: CameraCalibrationPart, folder: Path) -> tuple[Group, ...]:
    """All errors of a camera: its own, those of the study's calibration part, and joint ones.

    Raises
    ------
    OutOfRangeError
        An error is given twice, or tied in two joint distributions.
    """
    own = camera.declared_errors()
    given = part.errors.given()
    taken = {name for group in own for name in group.parameters}
    if repeated := sorted(taken & set(given)):
        raise OutOfRangeError(
            "errors that the camera's own calibration has already",
            value=", ".join(repeated),
            limit="each error once",
            remedy="take them out of the calibration of the study, or of that of the camera",
        )
    tied = [name for joint in part.joint.values() for name in joint.parameters]
    if repeated := sorted({name for name in tied if tied.count(name) > 1}):
        raise OutOfRangeError(
            "errors that stand in two joint distributions", value=", ".join(repeated), limit="each error once"
        )
    marginals = {name: distribution_of(value, folder) for name, value in given.items()}
    classes = {name: error_class_of(value, ErrorClass.RIG) for name, value in given.items()}
    alone = tuple(
        Source(name=name, distribution=marginals[name], error_class=classes[name]) for name in given if name not in tied
    )
    together = tuple(
        GaussianCopula(
            name=name,
            parameters=joint.parameters,
            marginals=tuple(marginals[parameter] for parameter in joint.parameters),
            correlation=np.array(joint.correlation),
            error_class=_common_class(name, [classes[parameter] for parameter in joint.parameters]),
        )
        for name, joint in part.joint.items()
    )
    return (*own, *alone, *together)


def _common_class(name: str, classes: list[ErrorClass]) -> ErrorClass:
    if len(set(classes)) > 1:
        raise OutOfRangeError(
            f"the errors of {name} are drawn together but not equally often",
            value=", ".join(error_class.value for error_class in classes),
            limit="one class for all",
            remedy="give all of them the same drawn",
        )
    return classes[0]


def group_of_file(path: Path, known: Mapping[str, str]) -> Group:
    """A joint calibration from a file, as errors about its own best values.

    Raises
    ------
    CalibrationFileError
        The file cannot be what it says it is.
    OutOfRangeError
        It names parameters that the camera's error model does not have.
    """
    found = read_calibration(path)
    if unknown := [name for name in found.names if name not in known]:
        raise OutOfRangeError(
            f"{path.name} names parameters that the camera's error model does not have",
            value=", ".join(unknown),
            limit=", ".join(known),
            remedy="rename the columns; values are in SI units",
        )
    if isinstance(found, CalibrationDraws):
        return group_of_draws("calibration", found.names, found.draws)
    return JointNormal(
        name="calibration",
        parameters=found.names,
        mean=np.zeros(len(found.names)),
        covariance=found.covariance,
        error_class=ErrorClass.RIG,
    )


def group_of_draws(
    name: str, parameters: tuple[str, ...], draws: np.ndarray[tuple[int, int], np.dtype[np.float64]]
) -> JointDraws:
    """Joint draws of a calibration as errors about their mean: what the calibration leaves open."""
    return JointDraws(name=name, parameters=parameters, draws=draws - draws.mean(axis=0), error_class=ErrorClass.RIG)


def replaced(groups: Iterable[Group], calibration: Group) -> tuple[Group, ...]:
    """The groups with a joint calibration in the place of those whose parameters it determines.

    Raises
    ------
    OutOfRangeError
        It determines a part of a joint group: what is left would have lost its partner.
    """
    kept: list[Group] = []
    covered = set(calibration.parameters)
    for group in groups:
        inside = covered & set(group.parameters)
        if inside and inside != set(group.parameters):
            raise OutOfRangeError(
                f"a joint calibration determines a part of {group.name}",
                value=", ".join(sorted(inside)),
                limit=", ".join(group.parameters),
                remedy="let it determine all of them, or declare them apart",
            )
        if not inside:
            kept.append(group)
    return (*kept, calibration)


def session_groups(part: SurroundingsPart | None, folder: Path) -> tuple[Source, ...]:
    """Changes of temperature and pressure, shared by all cameras."""
    if part is None:
        return ()
    given = {name: getattr(part, name) for name in ("temperature_change", "pressure_change")}
    return tuple(
        Source(
            name=name,
            distribution=distribution_of(value, folder),
            error_class=error_class_of(value, ErrorClass.SESSION),
        )
        for name, value in given.items()
        if value is not None
    )
