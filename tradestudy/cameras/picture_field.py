"""Field angles and image scale of a picture, from its lens model."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.calibrated_pair import CalibratedPair
from tradestudy.cameras.camera import Properties
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_model import IDEAL, LensModel
from tradestudy.units import ANGLE, pretty


def edge_angle(lens: LensModel, across: float, down: float) -> float:
    """Angle from the axis [rad] of normalised image coordinates; at most the valid field of the lens."""
    x, y, z = (float(one) for one in lens.ray(across, down))
    return float(lens.valid_field) if math.isnan(x) else math.atan2(math.hypot(x, y), z)


def full_angle(lens: LensModel, across: float, down: float) -> float:
    """Angle [rad] between opposite edges of the picture, (across, down) from its centre in normalised coordinates."""
    return edge_angle(lens, -across, -down) + edge_angle(lens, across, down)


def properties_of_lens_models(lens: LensModel, pair: CalibratedPair | None) -> Properties:
    """Properties of the common lens model, or of both lens models of a calibrated pair."""
    if pair is None:
        return properties_of(lens, "lens model")
    return (*properties_of(pair.lenses[0], "left lens model"), *properties_of(pair.lenses[1], "right lens model"))


def properties_of(lens: LensModel, what: str) -> Properties:
    """Name, nonzero coefficients and valid field of a lens model; nothing for a pinhole."""
    if lens == IDEAL:
        return ()
    given = ", ".join(f"{name} {value:g}" for name, value in lens.coefficients().items() if value)
    return (
        (what, f"{lens.name} ({given})"),
        (f"valid field of the {what}, from the axis", pretty(float(lens.valid_field), ANGLE, 4)),
    )


def place_across(lens: LensModel, angle: ArrayLike) -> FloatArray:
    """Normalised image coordinates (..., 2) of a direction at an angle to the right of the axis [rad].

    For a pinhole, x is the tangent of the angle; NaN outside the valid field.
    """
    angle = np.asarray(angle, dtype=np.float64)
    return lens.project(np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=-1))


def scale_across(lens: LensModel, slope: ArrayLike) -> FloatArray:
    """Derivative of the image coordinate x with respect to the slope x/z: 1 for a pinhole."""
    slope = np.asarray(slope, dtype=np.float64)
    points = np.stack([slope, np.zeros_like(slope), np.ones_like(slope)], axis=-1)
    scale: FloatArray = lens.derivatives(points, ())[0][..., 0, 0]
    return scale
