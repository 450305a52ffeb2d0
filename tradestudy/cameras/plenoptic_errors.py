"""The parameters that can be in error in a camera with a microlens array behind its main lens."""

from __future__ import annotations

from typing import Final

from tradestudy.cameras.error_vocabulary import INTERIOR, NOISE_PARAMETER, PIXEL_NOISE, ErrorParameter, ErrorVocabulary
from tradestudy.uncertainty.sources import ErrorClass

PLENOPTIC_ERRORS: Final[ErrorVocabulary] = {
    "mla_distance": ErrorParameter(
        unit="m", part=INTERIOR, meaning="Distance from the main lens to the microlens array."
    ),
    "focal_length": ErrorParameter(unit="m", part=INTERIOR, meaning="Focal length of the main lens."),
    "microlens_gap": ErrorParameter(
        unit="m", part=INTERIOR, meaning="Distance from the microlens array to the sensor."
    ),
    "microlens_pitch": ErrorParameter(
        unit="m", part="array", meaning="Mean distance between neighbouring microlens centres."
    ),
    "array_rotation": ErrorParameter(
        unit="rad",
        part="array",
        meaning="Rotation of the microlens array about the optical axis, relative to the rows of pixels.",
    ),
    "array_tilt_x": ErrorParameter(
        unit="rad",
        part="array",
        meaning="Tilt of the microlens array along x, relative to the sensor; if positive, the array is "
        "nearer to the sensor at larger x.",
    ),
    "array_tilt_y": ErrorParameter(
        unit="rad",
        part="array",
        meaning="Tilt of the microlens array along y, relative to the sensor; if positive, the array is "
        "nearer to the sensor at larger y.",
    ),
    "array_offset_x": ErrorParameter(
        unit="m", part="array", meaning="Position of the centre of the microlens array on the sensor, along x."
    ),
    "array_offset_y": ErrorParameter(
        unit="m", part="array", meaning="Position of the centre of the microlens array on the sensor, along y."
    ),
    "pupil_distance": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Distance from the microlens array to the exit pupil, minus that to the main lens; 0 by design. It "
        "changes how far the centres of the micro-images of a white scene lie from the centres of the microlenses.",
    ),
    "principal_point_x": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Position along x at which the axis of the main lens meets the microlens array: the centre of "
        "distortion and field curvature.",
    ),
    "principal_point_y": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Position along y at which the axis of the main lens meets the microlens array: the centre of "
        "distortion and field curvature.",
    ),
    "field_curvature": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Field curvature, for a flat object: the image distance in the corner of the sensor, minus that on the "
        "axis. The difference grows with the square of the distance from the axis.",
    ),
    "depth_distortion": ErrorParameter(
        unit="1",
        part=INTERIOR,
        meaning="Relative change, in the corner of the sensor, of the distance between the microlens array and the "
        "image that the main lens forms. The change grows with the square of the distance from the axis.",
    ),
    "distortion_k1": ErrorParameter(
        unit="1",
        part=INTERIOR,
        meaning="Coefficient of r² in the radial distortion of the main lens, where r is the slope of a ray.",
    ),
    "distortion_k2": ErrorParameter(
        unit="1",
        part=INTERIOR,
        meaning="Coefficient of r⁴ in the radial distortion of the main lens, where r is the slope of a ray.",
    ),
    "microlens_center_scatter": ErrorParameter(
        unit="m",
        part="microlens centres",
        meaning="Each coordinate of the centre of a microlens. The error differs from microlens to microlens. A "
        "disparity compares two microlenses, so its error from this source is √2 times the error of one coordinate.",
        error_class=ErrorClass.ELEMENT,
    ),
    PIXEL_NOISE: NOISE_PARAMETER,
}
"""Errors of a plenoptic camera, focused or not, in the order in which they are drawn.

Depth distortion: O. Johannsen et al., "On the calibration of focused plenoptic cameras", 2013. A microlens's own focal
length changes blur, not geometry, and is therefore not included. The principal point is a position on the array, as
tilts require; ``array_offset_x`` and ``_y`` move the array on the sensor."""
