"""The parameters of a camera that can be in error, each with its unit, part, and how often it is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

from tradestudy.uncertainty.sources import ErrorClass

Unit = Literal["m", "rad", "1", "px", "K", "Pa"]


@dataclass(frozen=True, kw_only=True)
class ErrorParameter:
    """One parameter that can be in error.

    Parameters
    ----------
    unit
        SI unit, or px.
    part
        The group of error sources under which it is reported, such as "noise", "interior orientation" or "array".
    meaning
        One sentence for the authors of studies.
    error_class
        How often it is drawn.
    """

    unit: Unit
    part: str
    meaning: str
    error_class: ErrorClass = ErrorClass.RIG


ErrorVocabulary = Mapping[str, ErrorParameter]
"""The parameters of one kind of camera by name, in the order in which they are drawn."""

PIXEL_NOISE: Final = "pixel_noise"
"""The error of one measured disparity [m on the sensor], which every kind has."""
NOISE_PARAMETER: Final = ErrorParameter(
    unit="m", part="noise", meaning="Error of one measured disparity on the sensor.", error_class=ErrorClass.MEASUREMENT
)
SESSION_PARAMETERS: Final[ErrorVocabulary] = {
    "temperature_change": ErrorParameter(
        unit="K",
        part="temperature",
        meaning="Temperature minus that during the calibration.",
        error_class=ErrorClass.SESSION,
    ),
    "pressure_change": ErrorParameter(
        unit="Pa",
        part="pressure",
        meaning="Ambient pressure minus that during the calibration.",
        error_class=ErrorClass.SESSION,
    ),
    "color_shift": ErrorParameter(
        unit="m",
        part="color",
        meaning="Focal length for the object's colour minus that for the calibration target's colour.",
        error_class=ErrorClass.SESSION,
    ),
}
"""Changes that affect the camera after its calibration, and that the calibration therefore does not contain."""
INTERIOR: Final = "interior orientation"
"""The group of parameters inside a camera: focal length, principal point, distortion, distances behind the lens."""
AGEING: Final = "ageing_"
"""Prefix of a parameter's name that denotes the error added since the calibration."""
