"""Saved posteriors, which a run writes beside its results and cameras read as calibrations."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal, cast

import numpy as np

from tradestudy.calibration.calibration_file import (
    CalibrationCovariance,
    CalibrationDraws,
    CalibrationFileError,
    read_calibration,
)
from tradestudy.calibration.corners.rig_measurement import RigMeasurement, check_geometry, pair_found, rig_parameters
from tradestudy.calibration.corners.view_blocks import shared_names
from tradestudy.calibration.projection import text_of_lens
from tradestudy.calibration.sources import CALIBRATION, group_of_draws, in_words
from tradestudy.cameras.calibrated_pair import CalibratedPair, PairGeometry
from tradestudy.cameras.calibration import Calibration, SourceName
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_measurement import PIXEL_NOISE, ErrorVocabulary
from tradestudy.cameras.plenoptic import PlenopticCamera
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.joint import JointDraws, JointNormal
from tradestudy.uncertainty.sources import ErrorClass, Group
from tradestudy.unit_registry import resolve_unit
from tradestudy.wording import listed

_DEVIATIONS: Final = 3.0  # from its mean, within which a value is taken for the one that the file is about
_NO_SHIFT: Final = 0.1  # standard deviations; less matters to nobody
_ROUNDING: Final = 1e-9  # of a mean, relative


def write_posterior(path: Path, posterior: CalibrationDraws) -> None:
    """Write a posterior as a NetCDF file with full precision, for `read_calibration`; with a reference, as errors.

    Parameters
    ----------
    path
        Path of the file, in an existing folder.
    posterior
        Draws, with best parameters, picture size and lens for a rig calibrated from corners.
    """
    import h5netcdf

    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"draw": len(posterior.draws), "parameter": len(posterior.names)}
        file.create_variable("parameter", ("parameter",), data=np.array(posterior.names, dtype=np.bytes_))
        reference = posterior.reference if posterior.best is None else None
        zero = np.zeros(len(posterior.names))
        draws = posterior.draws - (zero if reference is None else reference)
        file.create_variable("draws", ("draw", "parameter"), data=draws)
        if reference is not None:
            file.create_variable("reference", ("parameter",), data=zero)
        if posterior.best is not None:
            file.dimensions["side"] = 2
            file.create_variable("best", ("parameter",), data=posterior.best)
            file.create_variable("pixels", ("side",), data=np.array(posterior.pixels, dtype=np.int64))
            if lens := text_of_lens(posterior.lens):
                file.attrs["lens_model"] = lens


def posterior_of_file(path: Path, name: str, camera: DepthCamera) -> Calibration:
    """The part of a camera's calibration that a file determines.

    Without best values or a reference, the numbers are errors if the mean of each lies within three standard deviations
    of 0; their mean is kept. They are values of the parameters if each mean lies within three of the declared value;
    their mean then counts as this value, as ``remark`` says. The closer of the two is taken. A reference must lie as
    close to 0 or to the declared values; errors are relative to it, and ``remark`` says by how much it differs.

    Parameters
    ----------
    path
        NetCDF or CSV with joint draws or with a covariance; see `calibration_file`.
    name
        Name of the camera in its study.
    camera
        The camera as designed.

    Raises
    ------
    CalibrationFileError
        The file is unreadable or inconsistent, names parameters that the camera does not have, states units other than
        SI, or has means or a reference that are neither those of errors nor the declared values.
    GeometryContradictionError
        The file contradicts the declared geometry.
    """
    contents = read_calibration(path)
    if isinstance(contents, CalibrationDraws) and contents.best is not None:
        calibration = _of_rig(path, name, camera, contents)
        _require_units(path, contents, calibration.vocabulary or {})
        return replace(calibration, remark=_not_used(contents.unread))
    _require_known(path, contents.names, [name for name in camera.error_vocabulary if name != PIXEL_NOISE])
    _require_units(path, contents, camera.error_vocabulary)
    group, remark = _group(path, camera, contents)
    remark = "; ".join(filter(None, (remark, _not_used(contents.unread))))
    return Calibration(groups=(group,), source="posterior", remark=remark)


def rig_calibration(camera: PairGeometry, posterior: CalibrationDraws, *, source: SourceName) -> Calibration:
    """The calibration of a rig from the posterior of its parameters, with its own exact model.

    Parameters
    ----------
    camera
        The camera as designed.
    posterior
        Draws of the parameters, the best parameters, their lens, and the size of the pictures.
    source
        Origin of the posterior.
    """
    assert posterior.best is not None
    assert posterior.pixels is not None
    measurement = measurement_of_rig(camera, pair_found(posterior.best, posterior.lens), posterior.pixels)
    group = group_of_draws(CALIBRATION, posterior.names, posterior.draws)
    return Calibration(groups=(group,), source=source, measurement=measurement, vocabulary=measurement.vocabulary)


def measurement_of_rig(
    camera: PairGeometry,
    pair: CalibratedPair,
    pixels: tuple[int, int],
    right_pixels: tuple[int, int] | None = None,
) -> RigMeasurement:
    """The exact model of a calibrated pair.

    Parameters
    ----------
    camera
        The camera as designed.
    pair
        The calibrated pair.
    pixels, right_pixels
        Columns and rows of its pictures, and of the right one if it has others.
    """
    return RigMeasurement(
        best=np.array(pair.parameters),
        lenses=pair.lenses,
        free=pair.free,
        pixels=pixels,
        right_pixels=right_pixels,
        pixel_pitch=camera.sensor.pixel_pitch,
        vocabulary={**rig_parameters(pair.free), **camera.error_vocabulary},
    )


def as_calibrated(calibration: Calibration, camera: DepthCamera) -> Calibration:
    """The calibration, with depth from the camera's calibrated geometry if it has one.

    A calibration that already has its own exact model is returned unchanged.
    """
    if camera.calibrated_pair is None or calibration.measurement is not None or not calibration.inferred:
        return calibration
    pixels = (camera.sensor.columns, camera.sensor.rows)
    measurement = measurement_of_rig(cast(PairGeometry, camera), camera.calibrated_pair, pixels, camera.right_pixels)
    return replace(calibration, measurement=measurement, vocabulary=measurement.vocabulary)


def _of_rig(path: Path, name: str, camera: DepthCamera, posterior: CalibrationDraws) -> Calibration:
    """The posterior of a rig calibrated from corners; refuses any camera but a stereo rig."""
    if not camera.corners_calibrate:
        raise CalibrationFileError(
            f"{path.name} contains the posterior of a stereo rig, but {name} is not one",
            limit="the posterior of a camera of the same kind",
            remedy="use a file that a run wrote for a camera of this kind",
        )
    names = shared_names(posterior.lens.free)
    _require_known(path, posterior.names, names)
    if lacking := [name for name in names if name not in posterior.names]:
        raise CalibrationFileError(
            f"{path.name} lacks parameters of a rig",
            value=", ".join(lacking),
            limit=f"all {len(names)}",
            remedy="use an unchanged file written by a run",
        )
    if camera.right_pixels is not None:
        raise CalibrationFileError(
            f"{path.name} contains the posterior of a rig whose pictures have one size, but those of {name} have two",
            limit="errors declared one by one, or their covariance",
            remedy="remove calibration.posterior, or right_sensor",
        )
    size = (camera.sensor.columns, camera.sensor.rows)
    if posterior.pixels != size:
        raise CalibrationFileError(
            f"{path.name} belongs to pictures of another size",
            value=" × ".join(map(str, posterior.pixels or ())),
            limit=f"{size[0]} × {size[1]}, the pixels of the sensor",
            remedy="correct the pixels of the sensor, or use a posterior of such pictures",
        )
    assert posterior.best is not None
    if posterior.names != names:  # the exact model takes them by position
        order = [posterior.names.index(name) for name in names]
        draws = np.ascontiguousarray(posterior.draws[:, order])
        posterior = replace(posterior, names=names, draws=draws, best=posterior.best[order])
    assert posterior.best is not None
    pair = cast(PairGeometry, camera)
    check_geometry(name, pair, posterior.best, posterior.draws, says="the posterior says", lens=posterior.lens)
    return rig_calibration(pair, posterior, source="posterior")


def _group(path: Path, camera: DepthCamera, contents: CalibrationCovariance | CalibrationDraws) -> tuple[Group, str]:
    """The errors, and a remark if the file has values of the parameters instead."""
    if isinstance(contents, CalibrationCovariance):
        zero, remark = _reference(path, camera, contents.names, contents.mean, np.sqrt(np.diag(contents.covariance)))
        return JointNormal(
            name=CALIBRATION,
            parameters=contents.names,
            mean=contents.mean - zero,
            covariance=contents.covariance,
            error_class=ErrorClass.RIG,
        ), remark
    spread = contents.draws.std(axis=0)
    if contents.reference is None:
        zero, remark = _reference(path, camera, contents.names, contents.draws.mean(axis=0), spread)
    else:
        zero, remark = _reference(path, camera, contents.names, contents.reference, spread, what="reference")
    errors = contents.draws - zero
    return JointDraws(name=CALIBRATION, parameters=contents.names, draws=errors, error_class=ErrorClass.RIG), remark


def _reference(
    path: Path,
    camera: DepthCamera,
    names: tuple[str, ...],
    mean: FloatArray,
    deviation: FloatArray,
    what: Literal["mean", "reference"] = "mean",
) -> tuple[FloatArray, str]:
    """Values at which the errors are zero, with a remark if that shifts anything; see `posterior_of_file`."""
    by_name = _declared_values(camera)
    declared = np.array([by_name.get(name, 0.0) for name in names])
    # The mean of equal numbers differs from them by rounding.
    unit = deviation + _ROUNDING * np.abs(mean) + np.finfo(float).tiny
    from_zero, from_declared = np.abs(mean) / unit, np.abs(mean - declared) / unit
    are_values = from_declared.max() < from_zero.max()
    away = from_declared if are_values else from_zero
    worst = int(np.argmax(away))
    if away[worst] > _DEVIATIONS:
        value, spread, usual = (
            in_words(numbers[worst], camera, names[worst]) for numbers in (mean, deviation, declared)
        )
        raise CalibrationFileError(
            f"the {what} of {names[worst]} in {path.name} is neither that of an error nor the declared value",
            value=f"{value}, with a standard deviation of {spread}",
            limit=f"within {_DEVIATIONS:g} standard deviations of 0"
            + (f", or of the declared {usual}" if declared[worst] else ""),
            remedy="correct the file or the declared value; declare a large known error under errors, with its mean",
        )
    if not are_values and what == "mean":
        return np.zeros(len(names)), ""
    shifts = [
        f"{name} by {in_words(shift, camera, name)}"
        for name, shift, size in zip(names, (declared if are_values else 0.0) - mean, away, strict=True)
        if size > _NO_SHIFT
    ]
    if what == "reference":
        remark = "the reference in the file counts as the declared values" if shifts else ""
    else:
        remark = "the file contains values of the parameters, not errors; their means count as the declared values"
    return mean, remark + (f", which shifts {listed(shifts)}" if shifts else "")


def _declared_values(camera: DepthCamera) -> dict[str, float]:
    """Declared values of the parameters that are lengths of the design; all others are zero by design."""
    if isinstance(camera, PlenopticCamera):
        design = camera.geometry
        return {
            "mla_distance": design.mla_distance,
            "focal_length": design.focal_length,
            "microlens_gap": design.gap,
            "microlens_pitch": design.pitch,
            "field_curvature": design.field_curvature,
        }
    rig = cast(PairGeometry, camera)
    focal = dict.fromkeys(("focal_length", "left_focal_length", "right_focal_length"), rig.principal_distance)
    return {"baseline": rig.baseline, "yaw": rig.convergence_angle, **focal}


def _require_known(path: Path, names: tuple[str, ...], allowed: Collection[str]) -> None:
    if unknown := [name for name in names if name not in allowed]:
        raise CalibrationFileError(
            f"{path.name} names parameters that the camera does not have",
            value=", ".join(unknown),
            limit=", ".join(allowed),
            remedy="rename or remove them",
        )


def _require_units(path: Path, contents: CalibrationCovariance | CalibrationDraws, vocabulary: ErrorVocabulary) -> None:
    """Refuse a stated unit that is not the one in which numbers are read."""
    for variable, name, stated in contents.stated_units:
        unit: str = vocabulary[name].unit
        unit = f"{unit}^2" if variable == "covariance" and unit != "1" else unit
        expected = None if unit == "1" else resolve_unit(unit, absolute=False)
        if stated not in ("", "SI", unit) and resolve_unit(stated, absolute=False) != expected:
            raise CalibrationFileError(
                f"{variable} in {path.name} states another unit for {name}",
                value=stated,
                limit=unit,
                remedy="convert the numbers, and correct their unit",
            )


def _not_used(unread: tuple[str, ...]) -> str:
    return f"not used from the file: {listed(unread)}" if unread else ""
