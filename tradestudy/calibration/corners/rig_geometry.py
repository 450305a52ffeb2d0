"""Comparison of the declared geometry of a pair with the one fitted to its corners."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from tradestudy.calibration.corners.view_blocks import ROTATION, TRANSLATION, cameras_of
from tradestudy.calibration.projection import RADIAL_LENS, FreeLens, rotation_matrix
from tradestudy.cameras.pair_geometry import PairGeometry
from tradestudy.errors import TradestudyError
from tradestudy.optics.arrays import FloatArray
from tradestudy.units import significant

LENGTH_LIMIT = 0.05  # of a declared focal length or baseline
ANGLE_LIMIT = 0.05  # of the field of view
CENTRE_LIMIT = 0.15  # of the sensor, for the principal point
_DEVIATIONS = 5.0
Says = Literal["corners say", "the posterior says"]


class GeometryContradictionError(TradestudyError):
    """The declared geometry of a rig contradicts the one fitted to its corners."""

    exit_status = 2


def check_geometry(
    name: str, rig: PairGeometry, best: FloatArray, draws: FloatArray, *, says: Says, lens: FreeLens = RADIAL_LENS
) -> None:
    """Refuse a declared pair that contradicts the fitted one, listing all contradictions.

    Parameters
    ----------
    name
        Name of the camera in its study.
    rig
        The declared pair.
    best : array (P,)
        Best parameters, in the order of ``view_blocks.shared_names``.
    draws : array (K, P)
        Joint draws, whose spread is the uncertainty of these parameters.
    says
        Subject and verb that introduce the parameters in messages.
    lens
        Lens model of the free coefficients.

    Raises
    ------
    GeometryContradictionError
        The focal length or baseline differs by more than 5 %, the angle between the axes differs by more than 5 % of
        the field of view, or the principal point lies farther from the centre of the sensor than 15 % of its size.
        Where five standard deviations are larger than one of these limits, they replace it.
    """
    if found := tuple(_contradictions(name, rig, best, draws, says, lens)):
        raise GeometryContradictionError("\n".join(found))


def check_inside(name: str, rig: PairGeometry, seen: FloatArray) -> None:
    """Refuse corners (N, 2) [px] outside the declared sensor, which mean that the pictures have another size.

    Raises
    ------
    GeometryContradictionError
        A corner lies outside.
    """
    size = np.array([rig.sensor.columns, rig.sensor.rows])
    if np.all((seen >= -0.5) & (seen <= size - 0.5)):
        return
    low, high = seen.min(axis=0), seen.max(axis=0)
    raise GeometryContradictionError(
        f"declared sensor {size[0]} × {size[1]} px, but corners lie between ({low[0]:.0f}, {low[1]:.0f}) and "
        f"({high[0]:.0f}, {high[1]:.0f}) px; correct cameras.{name}.sensor.pixels or use another corner file"
    )


def _contradictions(
    name: str, rig: PairGeometry, best: FloatArray, draws: FloatArray, says: Says, lens: FreeLens
) -> Iterator[str]:
    """One line for each quantity that differs by more than the limit."""
    focal, baseline, angle = _geometry(best)
    deviation = np.std(np.stack(_geometry(draws)), axis=-1)
    instead = "another corner file" if says == "corners say" else "another posterior"
    # The scale of the image on the axis makes focal lengths of different lens models comparable.
    fitted = np.mean([lens.at(camera[4:]).scale_on_axis for camera in cameras_of(best)])
    focal, deviation[0] = focal * fitted, deviation[0] * fitted
    declared = rig.principal_distance / rig.sensor.pixel_pitch * rig.distortion.scale_on_axis
    rows = (
        ("focal length", "lenses", "px", 1.0, declared, focal, LENGTH_LIMIT * declared),
        ("baseline", "baseline", "mm", 1e3, rig.baseline, baseline, LENGTH_LIMIT * rig.baseline),
        (
            "angle between the axes",
            "convergence_distance",
            "°",
            np.degrees(1.0),
            rig.convergence_angle,
            angle,
            ANGLE_LIMIT * rig.field_of_view,
        ),
    )
    for (what, key, unit, per_unit, said, found, allowed), spread in zip(rows, deviation, strict=True):
        if abs(said - found) > max(allowed, _DEVIATIONS * spread):
            label = unit if unit == "°" else f" {unit}"
            yield (
                f"declared {what} {significant(said * per_unit, 4)}{label}, {says} "
                f"{_with_spread(float(found) * per_unit, float(spread) * per_unit)}{label}; "
                f"correct cameras.{name}.{key} or use {instead}"
            )
    for side, own, drawn in zip(("left", "right"), cameras_of(best), cameras_of(draws), strict=True):
        size = np.array([rig.sensor.columns, rig.sensor.rows])
        centre, spread = own[2:4], drawn[:, 2:4].std(axis=0)
        if np.any(np.abs(centre - (size - 1) / 2.0) > np.maximum(CENTRE_LIMIT * size, _DEVIATIONS * spread)):
            yield (
                f"declared sensor {size[0]} × {size[1]} px, {says} that the {side} optical axis meets it at "
                f"({centre[0]:.0f}, {centre[1]:.0f}) px; correct cameras.{name}.sensor.pixels or use {instead}"
            )


def _geometry(shared: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean focal length [px], baseline [m], and angle by which the axes converge [rad], each of shape (...,)."""
    right_axis = rotation_matrix(shared[..., ROTATION])[..., 2, :]  # in the frame of the left camera
    return (
        np.concatenate([camera[..., :2] for camera in cameras_of(shared)], axis=-1).mean(axis=-1),
        np.linalg.norm(shared[..., TRANSLATION], axis=-1),
        np.arctan2(-right_axis[..., 0], right_axis[..., 2]),
    )


def _with_spread(value: float, spread: float) -> str:
    """A value with its standard deviation, both rounded to the first digit of the latter: "60.1 ± 0.1"."""
    digits = max(0, -int(np.floor(np.log10(spread)))) if spread > 0.0 else 3
    return f"{value:.{digits}f} ± {spread:.{digits}f}".replace("-", "−")
