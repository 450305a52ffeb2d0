"""What can be in error about a camera: each parameter with its unit, how often it is drawn, and its part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

from tradestudy.uncertainty.error_class import ErrorClass

Unit = Literal["m", "rad", "1", "px", "K", "Pa"]


@dataclass(frozen=True, kw_only=True)
class ErrorParameter:
    """One parameter that can be in error.

    Parameters
    ----------
    unit
        SI unit, or px.
    part
        The group of causes that it is reported under: "noise", "interior orientation", "relative rotation", "array".
    meaning
        One sentence for whoever declares it.
    error_class
        How often it is drawn anew.
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
        meaning="Temperature less that of the calibration.",
        error_class=ErrorClass.SESSION,
    ),
    "pressure_change": ErrorParameter(
        unit="Pa",
        part="pressure",
        meaning="Ambient pressure less that of the calibration.",
        error_class=ErrorClass.SESSION,
    ),
    "color_shift": ErrorParameter(
        unit="m",
        part="color",
        meaning="Focal length in the colour of the object less that in the colour of the calibration target.",
        error_class=ErrorClass.SESSION,
    ),
}
"""What changes since the calibration; the camera changes by it, its calibration does not."""
INTERIOR: Final = "interior orientation"
"""The part of what is inside a camera: focal length, principal point, distortion, distances behind the lens."""
AGEING: Final = "ageing_"
"""Before the name of a parameter: what has been added to its error since the calibration."""
