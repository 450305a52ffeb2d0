"""The declared geometry of a pair of cameras, with which a calibration from corners is compared."""

from __future__ import annotations

from typing import ClassVar, Protocol

from tradestudy.cameras.error_vocabulary import ErrorVocabulary
from tradestudy.cameras.parts import Sensor
from tradestudy.optics.lens_model import LensModel


class PairGeometry(Protocol):
    """Two equal cameras side by side, of any kind with `corners_calibrate`."""

    error_vocabulary: ClassVar[ErrorVocabulary]

    @property
    def sensor(self) -> Sensor:
        """The sensor of each camera."""

    @property
    def baseline(self) -> float:
        """Distance between the two centres of projection [m]."""

    @property
    def principal_distance(self) -> float:
        """Distance from the centre of projection to the sensor [m]."""

    @property
    def distortion(self) -> LensModel:
        """Lens model of both cameras."""

    @property
    def convergence_angle(self) -> float:
        """Angle between the optical axes [rad]."""

    @property
    def field_of_view(self) -> float:
        """Horizontal field of view of one camera [rad]."""
