"""What every camera tells of itself, whether it measures depth or not; the rest of the program asks nothing else."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tradestudy.cameras.environment import Environment
from tradestudy.cameras.focus import Focus
from tradestudy.cameras.light_cones import Exposure
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.cameras.reading import Errors
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray

if TYPE_CHECKING:  # pydantic is not needed to compute with a camera
    from tradestudy.cameras.contradictions import Contradiction
    from tradestudy.cameras.stated_declaration import StatedPart

Properties = tuple[tuple[str, str], ...]


@dataclass(frozen=True, kw_only=True)
class Camera(ABC):
    """A camera: pixels, a lens that gathers light, and a focus. One that measures depth is a `DepthCamera` too.

    Parameters
    ----------
    sensor
        Of each of its pictures.
    """

    family: ClassVar[str]
    """Which idea it is; reports compare cameras of one family side by side."""
    corners_calibrate: ClassVar[bool] = False
    """Whether the corners of a board in its pictures calibrate it as two cameras."""
    lens_count: ClassVar[int] = 1
    """How many equal lenses take a picture at the same time."""

    sensor: Sensor

    @property
    @abstractmethod
    def gathering_lens(self) -> Lens:
        """The lens whose pupil gathers the light."""

    @property
    @abstractmethod
    def focus(self) -> Focus:
        """What it keeps sharp."""

    @abstractmethod
    def properties(self) -> Properties:
        """Name and value of what follows from the inputs, in reading order."""

    @abstractmethod
    def contradictions(self, stated: StatedPart | None, tolerance: float) -> Sequence[Contradiction]:
        """Hold over-determined inputs against each other, to a relative ``tolerance`` of depth."""

    @abstractmethod
    def depth_behind_lens(self, nearest: float) -> float:
        """Principal plane to sensor [m] where the scene asks for a focus as near as ``nearest`` [m]."""

    @property
    def makes_depth_map(self) -> bool:
        """Whether a depth map comes out of the exposures of one scene."""
        return True

    @property
    def separation(self) -> float:
        """How far its parts stand apart across the line of sight [m]; 0 for what looks through one lens."""
        return 0.0

    @property
    def view_baseline(self) -> float:
        """Distance [m] of the two views farthest apart that depth is taken from; 0 for a single image."""
        return self.separation or (self.gathering_lens.pupil_diameter if self.makes_depth_map else 0.0)

    @property
    def takes_stack(self) -> bool:
        """Whether it takes several images one after another, each at a focus of its own."""
        return False

    @property
    def time_per_image(self) -> float | None:
        """From one image of a stack to the next [s]; None where it is not known."""
        return None

    def microlenses_seeing(self, distance: FloatArray) -> FloatArray:
        """Mean number of microlenses that see a point at distances [m]; NaN for a camera without."""
        return np.full_like(distance, math.nan)

    @property
    def elements(self) -> int:
        """How many parts of it have an error each of their own, such as microlenses."""
        return 0

    def exposures(
        self,
        reference_distance: float,  # noqa: ARG002 - none unless the kind has some
        errors: Errors,  # noqa: ARG002 - as above
        environment: Environment | None,  # noqa: ARG002 - as above
        stop_separation: float,  # noqa: ARG002 - as above
    ) -> Sequence[Exposure]:
        """The pictures that it takes of one scene.

        Parameters
        ----------
        reference_distance
            Of the middle of the scene [m]: what refocuses is focused there.
        errors
            What the camera is less its design, by the names of its vocabulary and of `SESSION_PARAMETERS`; those that
            every element has of its own have shape (elements, 2).
        environment
            How it answers to its surroundings; None: not at all.
        stop_separation
            Of a second stop before the lens, which cuts the pupil away from the axis [m]; 0: there is none.

        Raises
        ------
        OutOfRangeError
            Where pictures of this kind of camera, or with such errors, cannot be rendered.
        """
        raise OutOfRangeError(
            "no pictures of this kind of camera can be rendered", remedy="leave it out of scene.image with cameras: […]"
        )

    @property
    def total_covering_plane(self) -> float:
        """Distance [m] at which the absolute virtual depth is 2; NaN for a camera without microlenses."""
        return math.nan
