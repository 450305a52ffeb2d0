"""Cameras whose every parameter can be in error: what they see of points, and which inverse depth they read from that.

Both halves invert each other. Temperature and pressure change the camera; a calibration error changes the reading.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.environment import Environment
from tradestudy.cameras.reading import Errors, InverseDepthReading
from tradestudy.optics.arrays import BoolArray, FloatArray

if TYPE_CHECKING:  # whoever draws errors has loaded it
    from tradestudy.uncertainty.sources import Group


@dataclass(frozen=True, kw_only=True)
class ExactModel(DepthCamera):
    """A camera with an exact model of every parameter in error, on and off the axis."""

    @abstractmethod
    def declared_errors(self) -> tuple[Group, ...]:
        """The errors that the camera declares of itself, as they are drawn; the disparity error is a number."""

    @abstractmethod
    def read(
        self, distance: FloatArray, field: float, errors: Errors, environment: Environment | None = None
    ) -> InverseDepthReading:
        """Inverse depths read in changed surroundings with a calibration that is off by ``errors``.

        Parameters
        ----------
        distance
            True distances [m], shape (distances,).
        field
            Where the point lies: 0 on the axis, 1 in the corner of the sensor.
        errors
            By the names of `error_units` and `SESSION_CHANGES`, arrays of shape (draws, 1).
        environment
            How the camera, as designed at calibration, answers to its surroundings; None: not at all.

        Raises
        ------
        OutOfRangeError
            For an error that the camera does not have, or a place beyond the sensor.
        """

    @abstractmethod
    def observe_target(self, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, ...]:
        """What a camera that deviates from its design by ``errors`` measures of points of a target [m on the sensor].

        The components come last in what inference takes of them; x, y, z as of the camera's own frame [m].
        """

    @abstractmethod
    def target_noise_px(self, corner_noise_px: float) -> FloatArray:
        """Noise of each component of `observe_target`, where one coordinate of a corner has the given one."""

    @abstractmethod
    def seen_on_sensor(self, observed_px: FloatArray) -> BoolArray:
        """Which components of `observe_target` [px] lie on the sensor, in the same shape (…, components)."""
