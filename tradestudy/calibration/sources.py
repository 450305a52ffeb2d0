"""The joint distribution of a camera's errors, from the calibration that a study declares."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from tradestudy.cameras.calibration import Calibration
from tradestudy.cameras.calibration_declaration import (
    ArrayStabilityPart,
    CalibrationPart,
    PairStabilityPart,
    StabilityPart,
    correlated,
    correlation_matrix,
)
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_measurement import AGEING, SESSION_PARAMETERS, Environment
from tradestudy.declarations.distributions import AnyDistribution, LengthOrPixelsDistribution
from tradestudy.declarations.part import MistakeAt
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.provenance import require_regular_file
from tradestudy.uncertainty.sources import ErrorClass, Group
from tradestudy.units import (
    ANGLE,
    FRACTION,
    LENGTH,
    PIXELS,
    PRESSURE_DIFFERENCE,
    TEMPERATURE_DIFFERENCE,
    Dimension,
    UnitError,
    parse,
    pretty,
    significant,
)

if TYPE_CHECKING:  # these load scipy, which `check` does not need
    from tradestudy.uncertainty.distributions import Distribution
    from tradestudy.uncertainty.joint import JointDraws
    from tradestudy.uncertainty.sources import Group, Source


CALIBRATION = "calibration"
"""Name of the group of parameters that a source determines."""
_DIMENSIONS: Final = (LENGTH, ANGLE, TEMPERATURE_DIFFERENCE, PRESSURE_DIFFERENCE, PIXELS, FRACTION)
"""Dimensions whose units the name of a column may contain."""


def calibration_of(
    part: CalibrationPart,
    camera: DepthCamera,
    *,
    folder: Path,
    wavelength: float,
    posterior: Calibration | None = None,
) -> Calibration:
    """The joint distribution of all that is uncertain about a camera, except measurement noise.

    Parameters
    ----------
    part
        The declared calibration.
    camera
        The camera as designed.
    folder
        Folder of the files that the part names.
    wavelength
        Wavelength of the scene [m].
    posterior
        Result of the part's source: the groups that it determines, and the exact model to which they belong; None
        without a source, or before the source has been evaluated.

    Returns
    -------
    Calibration
        The calibration; without groups and not ``inferred`` if the part has a source but no posterior is given.
    """
    if part.source != "errors" and posterior is None:
        return Calibration(source=part.source, inferred=False)
    groups = declared_groups(part, camera, folder)
    stability = stability_groups(part.stability, camera, folder)
    environment = environment_of(part.stability, wavelength)
    if posterior is None:
        return Calibration(groups=(*groups, *stability), environment=environment)
    determined = {name for group in posterior.groups for name in group.parameters}
    remaining = [group for group in groups if not determined.intersection(group.parameters)]
    return replace(
        posterior,
        groups=(*remaining, *posterior.groups, *stability),
        environment=environment,
        source=part.source,
    )


def mistakes_of_files(part: CalibrationPart, folder: Path) -> list[MistakeAt]:
    """Unreadable draw files and missing corner files of a calibration, with paths relative to the part."""
    mistakes: list[MistakeAt] = []
    for path, distribution in _distributions(part):
        if distribution.resolved_shape == "empirical":
            try:
                _draws(distribution, folder)
            except OutOfRangeError as error:
                mistakes.append(MistakeAt((*path, "file"), str(error)))
    if part.corners is not None and not (folder / part.corners.file).is_file():
        mistakes.append(MistakeAt(("corners", "file"), f"there is no file '{folder / part.corners.file}'"))
    return mistakes


def given_twice(part: CalibrationPart, posterior: Calibration) -> list[MistakeAt]:
    """Declared errors that a saved posterior already determines, with paths relative to the part."""
    assert part.posterior is not None
    determined = {name for group in posterior.groups for name in group.parameters}
    of_a_rig = posterior.measurement is not None
    determines = "every parameter of the rig" if of_a_rig else "this error"
    return [
        MistakeAt(("errors", name), f"{part.posterior.file} (posterior.file) determines {determines}; remove it here")
        for name in part.errors.given()
        if of_a_rig or name in determined
    ]


def declared_groups(part: CalibrationPart, camera: DepthCamera, folder: Path) -> tuple[Group, ...]:
    """The declared errors in the order of the vocabulary; correlated errors form one group."""
    from tradestudy.uncertainty.joint import GaussianCopula
    from tradestudy.uncertainty.sources import Source

    vocabulary, pitch = camera.error_vocabulary, camera.sensor.pixel_pitch
    marginals = {name: distribution_of(error, folder, pitch) for name, error in part.errors.given().items()}
    tied = {name: group for group in correlated(part.correlations) for name in group}
    groups: list[Group] = []
    for name, marginal in marginals.items():
        together = tuple(partner for partner in marginals if partner in tied.get(name, ()))
        if not together:
            groups.append(Source(name=name, distribution=marginal, error_class=vocabulary[name].error_class))
        elif name == together[0]:
            groups.append(
                GaussianCopula(
                    name=" and ".join(together),
                    parameters=together,
                    marginals=tuple(marginals[partner] for partner in together),
                    correlation=correlation_matrix(together, part.correlations),
                    error_class=vocabulary[name].error_class,
                )
            )
    return tuple(groups)


def stability_groups(part: StabilityPart, camera: DepthCamera, folder: Path) -> tuple[Source, ...]:
    """Changes since the calibration: ageing, temperature, pressure and colour."""
    from tradestudy.uncertainty.sources import Source

    changes: dict[str, AnyDistribution | None] = dict(
        zip(SESSION_PARAMETERS, (part.temperature, part.pressure, part.color), strict=True)
    )
    changes |= {AGEING + name: error for name, error in part.ageing.given().items()}
    return tuple(
        Source(
            name=name,
            distribution=distribution_of(change, folder, camera.sensor.pixel_pitch),
            error_class=ErrorClass.SESSION,
        )
        for name, change in changes.items()
        if change is not None
    )


def environment_of(part: StabilityPart, wavelength: float) -> Environment | None:
    """How the camera responds to temperature and pressure; None if neither changes."""
    if part.temperature is None and part.pressure is None:
        return None
    assert part.glass_index is not None  # the validator requires it for both
    array = part.array_expansion if isinstance(part, ArrayStabilityPart) else None
    found_again = isinstance(part, ArrayStabilityPart) and part.microlens_centers == "found-again"
    housing, apart = (
        part.housing_expansion or 0.0,
        part.baseline_expansion if isinstance(part, PairStabilityPart) else None,
    )
    return Environment(
        housing_expansion=housing,
        baseline_expansion=housing if apart is None else apart,
        array_expansion=array or 0.0,
        scale_expansion=array or 0.0 if found_again else part.sensor_expansion,
        focal_length_expansion=part.focal_length_expansion or 0.0,
        glass_index=part.glass_index,
        wavelength=wavelength,
        temperature=part.calibrated_at.temperature,
        pressure=part.calibrated_at.pressure,
    )


def distribution_of(part: AnyDistribution, folder: Path, pixel_pitch: float) -> Distribution:
    """The distribution that a study declares, in SI, with files from ``folder`` and pixels of the given pitch [m].

    Raises
    ------
    OutOfRangeError
        A file of draws cannot be read, or the values define no distribution.
    """
    from tradestudy.uncertainty.distributions import (
        Arcsine,
        CurvilinearTrapezoid,
        Empirical,
        Normal,
        StudentT,
        Triangular,
        Uniform,
    )

    if isinstance(part, LengthOrPixelsDistribution):
        part = part.in_lengths(pixel_pitch)
    middle, half_width = part.mean or 0.0, part.half_width or 0.0
    low, high = middle - half_width, middle + half_width
    match part.resolved_shape:
        case "normal":
            return Normal(mean=middle, standard_deviation=part.standard_deviation or 0.0)
        case "uniform":
            return Uniform(low=low, high=high)
        case "triangular":
            return Triangular(low=low, mode=middle, high=high)
        case "student-t":
            return StudentT(location=middle, scale=part.scale or 0.0, degrees_of_freedom=part.degrees_of_freedom or 0.0)
        case "arcsine":
            return Arcsine(low=low, high=high)
        case "curvilinear-trapezoid":
            return CurvilinearTrapezoid(low=low, high=high, inexactness=part.inexactness or 0.0)
        case "empirical":
            return Empirical(draws=_draws(part, folder))


def group_of_draws(name: str, parameters: tuple[str, ...], draws: FloatArray) -> JointDraws:
    """Joint draws of a calibration as errors relative to their mean."""
    from tradestudy.uncertainty.joint import JointDraws

    return JointDraws(name=name, parameters=parameters, draws=draws - draws.mean(axis=0), error_class=ErrorClass.RIG)


def _distributions(part: CalibrationPart) -> Iterable[tuple[tuple[str, ...], AnyDistribution]]:
    """Every distribution of a calibration, with its path."""
    stability = part.stability
    for path, errors in ((("errors",), part.errors), (("stability", "ageing"), stability.ageing)):
        yield from (((*path, name), error) for name, error in errors.given().items())
    changes: Mapping[str, AnyDistribution | None] = {
        name: getattr(stability, name) for name in ("temperature", "pressure", "color")
    }
    yield from ((("stability", name), change) for name, change in changes.items() if change is not None)


def _draws(part: AnyDistribution, folder: Path) -> FloatArray:
    """One column of numbers from a CSV file."""
    path, column = folder / (part.file or ""), part.column or ""
    try:
        require_regular_file(path)
        with path.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.DictReader(stream)
            header, rows = list(reader.fieldnames or ()), list(reader)
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "not UTF-8 text"
        raise OutOfRangeError(f"'{path}' cannot be read", value=why) from None
    if column not in header:
        raise OutOfRangeError(
            f"{path.name} has no column with this name",
            value=column,
            limit=", ".join(header) or "no columns",
            remedy="name the columns in the first line",
        )
    if header.count(column) > 1:
        raise OutOfRangeError(
            f"{path.name} has several columns with this name", value=column, limit="one", remedy="rename the others"
        )
    if unit := _other_unit(column, part.dimension):
        raise OutOfRangeError(
            f"column {column} of {path.name} names another unit than that of its draws",
            value=unit,
            limit=part.dimension.unit or "no unit",
            remedy="convert the draws to SI units, and rename the column",
        )
    if surplus := next((row for row in rows if None in row), None):
        raise OutOfRangeError(
            f"{path.name} has a line with more cells than columns",
            value=f"{len(surplus) - 1 + len(surplus[None])} cells",
            limit=str(len(header)),
            remedy="write decimal points, not commas, and remove surplus cells",
        )
    try:
        draws = np.array([float(row[column]) for row in rows])
    except (TypeError, ValueError):
        raise OutOfRangeError(
            f"column {column} of {path.name} contains a cell that is not a number", remedy="remove units and text"
        ) from None
    if draws.size < 2 or not np.all(np.isfinite(draws)):
        raise OutOfRangeError(
            f"column {column} of {path.name} contains too few or non-finite draws",
            value=f"{draws.size} draws, {int(np.sum(~np.isfinite(draws)))} of them not finite",
            limit="at least two, all finite",
            remedy="add draws, or remove those that are not finite",
        )
    return draws


def _other_unit(column: str, dimension: Dimension) -> str:
    """The unit at the end of a column's name, as in ``error_mm`` and ``error [mm]``, if it is not the SI unit."""
    before, *words = re.split(r"[\s_()\[\]]+", column.rstrip(")] "))
    for candidate in (dimension, *_DIMENSIONS) if before and words else ():
        with suppress(UnitError):
            return "" if parse(f"1 {words[-1]}", candidate) == 1.0 and candidate == dimension else words[-1]
    return ""


def impossible_errors(camera: DepthCamera, distance: FloatArray) -> Iterator[str]:
    """Parameters of which a deviation by one standard deviation leaves no camera that measures depth, in words.

    Parameters
    ----------
    camera
        The camera with its calibration.
    distance
        Distances [m] at which it is tried.
    """
    calibration = camera.calibration
    sizes = {
        name: size
        for group in calibration.groups
        for name, size in zip(group.parameters, _deviations(group), strict=True)
    }
    if not sizes:
        return
    # The first row has no deviation; each other row has that of one parameter, down or up.
    moved = np.concatenate([np.zeros((1, len(sizes))), *(sign * np.diag([*sizes.values()]) for sign in (-1.0, 1.0))])
    drawn = {name: calibration.means[name] + moved[:, k : k + 1] for k, name in enumerate(sizes)}
    measured = camera.measured_depth(distance, 0.0, drawn)
    measures = np.isfinite(measured.inverse_depth) & ~measured.no_overlap & ~measured.out_of_range
    works = np.any(np.broadcast_to(measures, (len(moved), distance.size)), axis=1)
    if not works[0]:  # even without deviations: not the fault of any parameter
        return
    for number, (name, size) in enumerate(sizes.items(), start=1):
        if not (works[number] and works[number + len(sizes)]):
            yield (
                f"a deviation of {name} by one standard deviation, {in_words(size, camera, name)}, leaves no camera "
                "that measures depth; check its unit"
            )


def in_words(value: float, camera: DepthCamera, name: str) -> str:
    """A value of one of the camera's parameters, with its unit."""
    unit = camera.parameter(name).unit
    return pretty(value, LENGTH) if unit == "m" else f"{significant(value)} {unit}"


def _deviations(group: Group) -> FloatArray:
    """Standard deviation of each parameter; 0 where it does not exist or cannot be computed."""
    try:
        covariance = group.covariance
    except OutOfRangeError:
        covariance = None
    return np.zeros(len(group.parameters)) if covariance is None else np.sqrt(np.diag(covariance))
