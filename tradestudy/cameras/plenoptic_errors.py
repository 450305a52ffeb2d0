"""The parameters that can be in error in a camera with a microlens array behind its main lens."""

from __future__ import annotations

from typing import Final

from tradestudy.cameras.error_vocabulary import INTERIOR, NOISE_PARAMETER, PIXEL_NOISE, ErrorParameter, ErrorVocabulary
from tradestudy.uncertainty.error_class import ErrorClass

PLENOPTIC_ERRORS: Final[ErrorVocabulary] = {
    "mla_distance": ErrorParameter(unit="m", part=INTERIOR, meaning="Distance from the main lens to the array."),
    "focal_length": ErrorParameter(unit="m", part=INTERIOR, meaning="Focal length of the main lens."),
    "microlens_gap": ErrorParameter(unit="m", part=INTERIOR, meaning="Distance from the array to the sensor."),
    "microlens_pitch": ErrorParameter(
        unit="m", part="array", meaning="Mean distance between neighbouring microlens centres."
    ),
    "array_rotation": ErrorParameter(
        unit="rad", part="array", meaning="Rotation of the array relative to the pixel rows, about the optical axis."
    ),
    "array_tilt_x": ErrorParameter(
        unit="rad",
        part="array",
        meaning="Slope of the array relative to the sensor along x: at larger x it is farther from the main lens and "
        "nearer to the sensor.",
    ),
    "array_tilt_y": ErrorParameter(
        unit="rad",
        part="array",
        meaning="Slope of the array relative to the sensor along y, defined like array_tilt_x.",
    ),
    "array_offset_x": ErrorParameter(
        unit="m", part="array", meaning="Position of the array's centre on the sensor along x."
    ),
    "array_offset_y": ErrorParameter(
        unit="m", part="array", meaning="Position of the array's centre on the sensor along y."
    ),
    "pupil_distance": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Distance from exit pupil to array minus that from main lens to array; it shifts the centres of white "
        "images relative to microlens centres.",
    ),
    "principal_point_x": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Where the axis of the main lens meets the array along x: the centre of distortion and curvature.",
    ),
    "principal_point_y": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Where the axis of the main lens meets the array along y: the centre of distortion and curvature.",
    ),
    "field_curvature": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="How much farther from the main lens its image lies in the corner than known field curvature implies; "
        "it grows with the square of the distance from the axis.",
    ),
    "depth_distortion": ErrorParameter(
        unit="1",
        part=INTERIOR,
        meaning="Relative change, in the corner, of the distance from image to array; it grows with the square of the "
        "distance from the axis.",
    ),
    "distortion_k1": ErrorParameter(
        unit="1",
        part=INTERIOR,
        meaning="Radial distortion coefficient of the main lens, for the square of the slope.",
    ),
    "distortion_k2": ErrorParameter(
        unit="1",
        part=INTERIOR,
        meaning="Radial distortion coefficient of the main lens, for the fourth power of the slope.",
    ),
    "microlens_center_scatter": ErrorParameter(
        unit="m",
        part="microlens centres",
        meaning="One coordinate of a microlens centre, the origin of coordinates in its micro-image; the disparity of "
        "two microlenses contains √2 times this error.",
        error_class=ErrorClass.ELEMENT,
    ),
    PIXEL_NOISE: NOISE_PARAMETER,
}
"""Errors of a plenoptic camera, focused or not, in the order in which they are drawn.

Depth distortion: O. Johannsen et al., "On the calibration of focused plenoptic cameras", 2013. A microlens's own focal
length changes blur, not geometry, and is therefore not included. The principal point is a position on the array, as
tilts require; ``array_offset_x`` and ``_y`` move the array on the sensor."""
