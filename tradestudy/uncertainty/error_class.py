"""How often an error is redrawn."""

from __future__ import annotations

from enum import Enum
from typing import Final


class ErrorClass(Enum):
    """How often an error is redrawn: averaging measurements reduces only errors that are drawn per measurement."""

    RIG = "per rig"
    """One draw per built and calibrated rig: calibration."""
    SESSION = "per session"
    """One draw per time of use: temperature, pressure, drift."""
    ELEMENT = "per lens or pixel"
    """One draw per microlens or pixel: fixed pattern."""
    MEASUREMENT = "per measurement"
    """One draw per measurement: pixel noise."""


NOISE: Final = (ErrorClass.MEASUREMENT,)
"""Errors that differ from one measurement to the next."""
CALIBRATION: Final = (ErrorClass.RIG, ErrorClass.SESSION, ErrorClass.ELEMENT)
"""Errors that stay the same if a measurement is repeated at once with the same rig."""
