"""Exact camera models with every parameter in error: from named errors to inverse depth, on and off the axis.

Each model has two halves that invert each other: what a camera with given errors sees of a point, and which depth a
calibration with given errors reads from that. Temperature and pressure change the camera; a calibration error changes
the reading.
"""

from tradestudy.cameras.error_models.environment import Environment
from tradestudy.cameras.error_models.focused_plenoptic import (
    PLENOPTIC_ERRORS,
    plenoptic_observation,
    plenoptic_reading,
)
from tradestudy.cameras.error_models.reading import SESSION_CHANGES, Errors, InverseDepthReading
from tradestudy.cameras.error_models.stereo import STEREO_ERRORS, stereo_observation, stereo_reading

__all__ = [
    "PLENOPTIC_ERRORS",
    "SESSION_CHANGES",
    "STEREO_ERRORS",
    "Environment",
    "Errors",
    "InverseDepthReading",
    "plenoptic_observation",
    "plenoptic_reading",
    "stereo_observation",
    "stereo_reading",
]
