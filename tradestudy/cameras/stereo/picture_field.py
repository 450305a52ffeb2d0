"""Directions at the edges of a picture, and how finely its middle is imaged, by the model of its lens."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.calibrated_pair import CalibratedPair
from tradestudy.cameras.camera import Properties
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_models.lens_model import LensModel
from tradestudy.optics.lens_models.rational import IDEAL
from tradestudy.units import ANGLE, pretty


def edge_angle(lens: LensModel, across: float, down: float) -> float:
    """Angle from the axis [rad] of a place in the normalised picture; beyond the lens's field, where that ends."""
    x, y, z = (float(one) for one in lens.ray(across, down))
    return float(lens.valid_field) if math.isnan(x) else math.atan2(math.hypot(x, y), z)


def full_angle(lens: LensModel, across: float, down: float) -> float:
    """Angle [rad] from one edge of the picture to the opposite one, half its size (across, down) from the middle."""
    return edge_angle(lens, -across, -down) + edge_angle(lens, across, down)


def properties_of_lens_models(lens: LensModel, pair: CalibratedPair | None) -> Properties:
    """Of the lens of both cameras, or of each of a calibrated pair."""
    if pair is None:
        return _properties_of(lens, "lens model")
    return (*_properties_of(pair.lenses[0], "left lens model"), *_properties_of(pair.lenses[1], "right lens model"))


def _properties_of(lens: LensModel, what: str) -> Properties:
    """Its name and coefficients that are not zero, and where it ends; nothing of a pinhole."""
    if lens == IDEAL:
        return ()
    given = ", ".join(f"{name} {value:g}" for name, value in lens.coefficients().items() if value)
    return (
        (what, f"{lens.name} ({given})"),
        (f"valid field of the {what}, from the axis", pretty(float(lens.valid_field), ANGLE, 4)),
    )


def place_across(lens: LensModel, angle: ArrayLike) -> FloatArray:
    """Place (..., 2) in the normalised picture of a direction this far to the right of the axis [rad].

    A pinhole has x = its tangent; NaN outside the valid field.
    """
    angle = np.asarray(angle, dtype=np.float64)
    return lens.project(np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=-1))


def scale_across(lens: LensModel, slope: ArrayLike) -> FloatArray:
    """How far the place x of a direction moves with its slope x/z: 1 for a pinhole."""
    slope = np.asarray(slope, dtype=np.float64)
    points = np.stack([slope, np.zeros_like(slope), np.ones_like(slope)], axis=-1)
    scale: FloatArray = lens.derivatives(points, ())[0][..., 0, 0]
    return scale
