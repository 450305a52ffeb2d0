"""The declaration of a simulated calibration: the board and its poses in front of the camera."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Final, Self

import numpy as np
from pydantic import Field, model_validator

from tradestudy import units
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    Angle,
    Length,
    ObjectDistance,
    PositiveAngle,
    PositiveLength,
    PositivePixels,
    Span,
    quantity,
)
from tradestudy.unit_registry import DEGREE
from tradestudy.units import ANGLE, pretty

HalfFieldAngle = Annotated[float, *quantity(units.ANGLE, above=0.0, at_most=80.0 * DEGREE)]
MostSteps = Annotated[int, Field(ge=100, le=1_000_000, strict=True)]
MOST_VIEWS: Final = 1000
LEAST_TILT: Final = 1.0 * DEGREE
"""Smallest allowed angle between boards of unknown position. Parallel boards cannot distinguish a shorter focal length
from a nearer board, and at smaller tilts, the foreshortening of a board is below the noise of its corners."""
LEAST_CORNERS: Final = 6
"""Fewest corners in a view that determine its pose with certainty to spare."""
_DRAWN: Final = ("views", "distances", "half_field_angle", "tilt")
_REMEDY: Final = "tilt it by some 20 deg, differently in each view, or declare position_known_to"


class PosePart(Part):
    """The pose of the board in one view: its rotation about its centre, and its position in the frame of the camera.

    The x axis points right, the y axis down and the z axis along the optical axis; for a stereo rig, the origin is
    midway between the cameras.
    """

    rotation: tuple[Angle, Angle, Angle] = Field(
        description="Rotation vector: its direction is the axis of rotation, its length the angle. At zero, the "
        "board is perpendicular to the optical axis."
    )
    position: tuple[Length, Length, ObjectDistance] = Field(description="Position of the board's centre: x, y and z.")

    @property
    def normal(self) -> tuple[float, float, float]:
        """Normal ``e_z cos θ + (k × e_z) sin θ + k k_z (1 − cos θ)`` for rotation by θ about the axis k (Rodrigues)."""
        angle = math.hypot(*self.rotation)
        x, y, z = (component / (angle or 1.0) for component in self.rotation)
        sine, cosine = math.sin(angle), math.cos(angle)
        along = z * (1.0 - cosine)
        return x * along + y * sine, y * along - x * sine, z * along + cosine


class TargetPart(Part):
    """A simulated calibration with views of a board.

    The priors are the distributions in calibration.errors, which must be independent, and normal or uniform.

    Give either `poses` or all of `views`, `distances`, `half_field_angle` and `tilt`. With these four keys, the program
    generates the views: the positions of the board are spread evenly over inverse distance and direction, and its
    rotations are normally distributed.
    """

    views: Annotated[int, Field(ge=3, le=MOST_VIEWS, strict=True)] | None = Field(
        default=None, description="Number of views of the board."
    )
    columns: Annotated[int, Field(ge=2, le=100, strict=True)] = Field(
        description="Number of inner corners in each row of the board."
    )
    rows: Annotated[int, Field(ge=2, le=100, strict=True)] = Field(
        description="Number of inner corners in each column of the board."
    )
    spacing: PositiveLength = Field(
        description="Distance between neighbouring inner corners of the board: the side of a square."
    )
    distances: Span | None = Field(default=None, description="Nearest and farthest distance of the board.")
    half_field_angle: HalfFieldAngle | None = Field(
        default=None,
        description="Largest angle between the optical axis and the direction of the board's centre, horizontally and "
        "vertically.",
    )
    tilt: PositiveAngle | None = Field(
        default=None,
        description="Standard deviation, from view to view, of each component of the board's rotation vector.",
    )
    poses: Annotated[tuple[PosePart, ...], Field(min_length=3, max_length=MOST_VIEWS)] | None = Field(
        default=None,
        description="Instead of `views`, `distances`, half_field_angle and `tilt`: the pose of the board in each view.",
    )
    corner_noise: PositivePixels = Field(
        description="Standard deviation of the error of each measured image coordinate of a corner."
    )
    rotation_known_to: PositiveAngle | None = Field(
        default=None,
        description="Standard uncertainty of each component of the board's rotation; default: the rotation is unknown.",
    )
    position_known_to: PositiveLength | None = Field(
        default=None,
        description="Standard uncertainty of each coordinate of the board's position; default: the position is "
        "unknown.",
    )
    max_steps: MostSteps = Field(
        default=20_000,
        description="Largest number of steps of each Markov chain, a random walk that draws from the posterior.",
    )

    @property
    def half_field(self) -> float:
        """Largest slope of the direction to the board's centre, for views that are spread evenly."""
        return math.tan(self.half_field_angle or 0.0)

    @model_validator(mode="after")
    def _enough_corners(self) -> Self:
        if self.columns * self.rows < LEAST_CORNERS:
            raise MistakeAt(("columns",), f"a board needs at least {LEAST_CORNERS} corners, columns times rows")
        return self

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if mistakes := [*self._mistakes_of_views(), *self._mistakes_of_tilt()]:
            raise MistakeAt.several(mistakes)
        return self

    def _mistakes_of_views(self) -> Iterator[MistakeAt]:
        given = [name for name in _DRAWN if getattr(self, name) is not None]
        if self.poses is not None:
            for name in given:
                yield MistakeAt((name,), "poses determines every view; remove this (null removes an inherited one)")
        elif missing := [name for name in _DRAWN if name not in given]:
            yield MistakeAt((), f"needs {', '.join(missing)} (or poses instead of {', '.join(_DRAWN)})")

    def _mistakes_of_tilt(self) -> Iterator[MistakeAt]:
        if self.position_known_to is not None:
            return
        least = pretty(LEAST_TILT, ANGLE)
        if self.tilt is not None and self.tilt < LEAST_TILT:
            what = (
                f"{pretty(self.tilt, ANGLE)} cannot determine the focal length; at least {least} is expected; {_REMEDY}"
            )
            yield MistakeAt(("tilt",), what)
        if self.poses is not None and (angle := _largest_angle(self.poses)) < LEAST_TILT:
            what = (
                f"cannot determine the focal length: no two boards are tilted relative to each other by more than "
                f"{pretty(angle, ANGLE)}; at least {least} is expected; {_REMEDY}"
            )
            yield MistakeAt(("poses",), what)


def _largest_angle(poses: tuple[PosePart, ...]) -> float:
    """Largest angle between the planes of two boards [rad]."""
    normals = np.array([pose.normal for pose in poses])
    sines = np.linalg.norm(np.cross(normals[:, None], normals[None]), axis=-1)
    return float(np.arcsin(np.clip(sines, 0.0, 1.0)).max())
