"""What can be in error about a focused plenoptic camera: the vocabulary of its calibration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

PLENOPTIC_ERRORS: Final[Mapping[str, str]] = {
    "mla_distance": "m",
    "focal_length": "m",
    "microlens_gap": "m",
    "microlens_pitch": "m",
    "array_rotation": "rad",
    "array_tilt_x": "rad",
    "array_tilt_y": "rad",
    "array_offset_x": "m",
    "array_offset_y": "m",
    "pupil_distance": "m",
    "field_curvature": "m",
    "depth_distortion": "1",
    "distortion_k1": "1",
    "distortion_k2": "1",
    "pixel_noise": "m",
}
"""Errors of a focused plenoptic camera with their units.

``array_tilt_x`` is the slope of the array along x against the sensor: it adds to z and takes from b_L what it takes.
``pupil_distance`` is that of the exit pupil, by which microlens centres follow from the centres of their white images.
``field_curvature`` and ``depth_distortion`` are those in the corner of the sensor and grow with the square of the
distance from the axis: the first moves the image of the main lens along the axis, the second stretches its distance
from the array (O. Johannsen et al., "On the calibration of focused plenoptic cameras", 2013). k₁ and k₂ refer to the
lateral position over z. ``pixel_noise`` is that of the disparity [m on the sensor]."""
