"""The error parameters of a stereo rig."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from tradestudy.cameras.error_vocabulary import INTERIOR, NOISE_PARAMETER, PIXEL_NOISE, ErrorParameter, ErrorVocabulary
from tradestudy.cameras.stereo.pair import SIDES

_OF_BOTH: Final[ErrorVocabulary] = {
    "baseline": ErrorParameter(
        unit="m", part="relative position", meaning="Distance between the centres of projection of the two cameras."
    ),
    "baseline_direction_y": ErrorParameter(
        unit="rad",
        part="relative position",
        meaning="Vertical angle of the baseline; if positive, the right camera lies below the left one.",
    ),
    "baseline_direction_z": ErrorParameter(
        unit="rad",
        part="relative position",
        meaning="Horizontal angle of the baseline; if positive, the right camera lies ahead of the left one.",
    ),
    "yaw": ErrorParameter(
        unit="rad",
        part="relative rotation",
        meaning="Rotation of the right camera relative to the left one, about the vertical; if positive, towards the "
        "left one.",
    ),
    "pitch": ErrorParameter(
        unit="rad",
        part="relative rotation",
        meaning="Rotation of the right camera relative to the left one, about the baseline; if positive, upwards.",
    ),
    "roll": ErrorParameter(
        unit="rad",
        part="relative rotation",
        meaning="Rotation of the right camera relative to the left one, about its own optical axis; if positive, "
        "clockwise as seen from behind.",
    ),
    "focal_length": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Principal distance of both cameras, which a calibration in pixels calls the focal length.",
    ),
    "principal_point": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Difference between the positions of the two principal points along the baseline, right minus left. "
        "The two principal points move in opposite directions, each by half of the error.",
    ),
}


def _of_one(side: str) -> Iterator[tuple[str, ErrorParameter]]:
    """The error parameters of a single camera."""
    yield (
        "focal_length",
        ErrorParameter(
            unit="m",
            part=INTERIOR,
            meaning=f"Principal distance of the {side} camera; this error adds to that of focal_length.",
        ),
    )
    for axis, where in (("x", "along the baseline"), ("y", "perpendicular to the baseline")):
        yield (
            f"principal_point_{axis}",
            ErrorParameter(
                unit="m",
                part=INTERIOR,
                meaning=f"Position of the principal point of the {side} camera on its sensor, {where}.",
            ),
        )
    for name in ("k1", "k2"):
        yield (
            f"distortion_{name}",
            ErrorParameter(
                unit="1",
                part=INTERIOR,
                meaning=f"Coefficient {name} of the {side} camera's lens model. The model must have the coefficients "
                "k1 and k2; if no lens model is declared, the rational one is assumed.",
            ),
        )


STEREO_ERRORS: Final[ErrorVocabulary] = {
    **_OF_BOTH,
    **{f"{side}_{name}": parameter for side in SIDES for name, parameter in _of_one(side)},
    PIXEL_NOISE: NOISE_PARAMETER,
}
"""Errors of a stereo rig in the order in which they are drawn; each picture has half of the noise."""
