"""What the corners of a board say of two cameras is held against: the geometry that a pair declares."""

from __future__ import annotations

from typing import ClassVar, Protocol

from tradestudy.cameras.error_vocabulary import ErrorVocabulary
from tradestudy.cameras.parts import Sensor
from tradestudy.optics.lens_models.lens_model import LensModel


class PairGeometry(Protocol):
    """Two equal cameras side by side, of whatever kind has `corners_calibrate`."""

    error_vocabulary: ClassVar[ErrorVocabulary]

    @property
    def sensor(self) -> Sensor:
        """Of each camera."""

    @property
    def baseline(self) -> float:
        """Distance of the two centres of projection [m]."""

    @property
    def principal_distance(self) -> float:
        """From the centre of projection to the sensor [m]."""

    @property
    def distortion(self) -> LensModel:
        """Lens model of both cameras."""

    @property
    def convergence_angle(self) -> float:
        """Between the optical axes [rad]."""

    @property
    def field_of_view(self) -> float:
        """Across, of one camera [rad]."""
