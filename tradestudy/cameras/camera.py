"""The interface of all cameras, whether or not they measure depth; the rest of the program uses nothing else."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.depth_measurement import Environment, Errors
from tradestudy.cameras.focus import Focus
from tradestudy.cameras.light_cones import Exposure
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field import hyperfocal_distance
from tradestudy.optics.refocusing import Refocusing
from tradestudy.units import ANGLE, ELECTRONS, LENGTH, PHOTONS, Dimension, pretty

if TYPE_CHECKING:
    from tradestudy.cameras.stated_declaration import StatedPart
    from tradestudy.optics.microlens_camera import MicrolensCamera


# Values printed with three or four digits agree within this.
PRINTED_TOLERANCE = 5e-3
_ANGLE_TOLERANCE = 1e-3


@dataclass(frozen=True, kw_only=True)
class Contradiction:
    """Two values of one quantity that cannot both be right.

    Parameters
    ----------
    what, stated, implied, used
        The quantity, its two values, and the one that the program uses, in words.
    path
        Keys in the declaration of the camera that `check` names.
    consequence
        What it does to the camera's answers, as a clause such as "its micro-images overlap"; empty if they do not
        suffer.
    """

    what: str
    stated: str
    implied: str
    used: str
    path: tuple[str, ...]
    consequence: str = ""


def lens_contradictions(
    lens: Lens,
    sensor: Sensor,
    stated: StatedPart | None,
    views: tuple[float, float] | None = None,
    part: str = "lens",
) -> list[Contradiction]:
    """Check both pupils, and stated field of view, hyperfocal distance and sensitivity against lens and sensor.

    ``views`` are the fields of view across and on the diagonal [rad] of a lens that is no pinhole; ``part`` is the key
    of the lens.
    """
    contradictions = _pupil_contradictions(lens, part)
    if stated is None:
        return contradictions
    contradictions += _sensitivity_contradictions(sensor, stated.absolute_sensitivity_threshold)
    if stated.field_of_view is not None:
        across, diagonal = views or (lens.field_of_view(sensor.width), lens.field_of_view(sensor.diagonal))
        if not any(math.isclose(stated.field_of_view, angle, rel_tol=_ANGLE_TOLERANCE) for angle in (across, diagonal)):
            contradictions.append(
                Contradiction(
                    what="field of view against focal length and sensor",
                    stated=show(stated.field_of_view, ANGLE),
                    implied=f"{show(across, ANGLE)} across, {show(diagonal, ANGLE)} on the diagonal",
                    used=f"focal length {show(lens.focal_length, LENGTH)}",
                    path=("stated", "field_of_view"),
                )
            )
    if stated.hyperfocal_distance is not None:
        implied = float(hyperfocal_distance(lens.focal_length, lens.pupil_diameter, sensor.pixel_pitch))
        if not math.isclose(stated.hyperfocal_distance, implied, rel_tol=PRINTED_TOLERANCE):
            contradictions.append(
                Contradiction(
                    what="hyperfocal distance against focal length, aperture and pixel",
                    stated=show(stated.hyperfocal_distance, LENGTH),
                    implied=f"{show(implied, LENGTH)} for a blur of one pixel",
                    used="focal length and f-number",
                    path=("stated", "hyperfocal_distance"),
                )
            )
    return contradictions


def _pupil_contradictions(lens: Lens, part: str) -> list[Contradiction]:
    """Check that the exit pupil is the image of the entrance pupil, by the entrance pupil whose image it is."""
    leaving, f = lens.stated_exit_pupil, lens.focal_length
    if leaving is None:
        return []
    entering = leaving / (1.0 - leaving / f) if math.isfinite(leaving) else -f
    if math.isclose(entering, lens.entrance_pupil, rel_tol=PRINTED_TOLERANCE):
        return []
    return [
        Contradiction(
            what="exit pupil against entrance pupil and focal length",
            stated=f"{show(leaving, LENGTH)} behind the second principal plane",
            implied=f"{show(lens.exit_pupil, LENGTH)}, the image of the entrance pupil",
            used="the implied value",
            path=(part, "exit_pupil"),
        )
    ]


def digitiser_contradictions(sensor: Sensor, full_well: float, bits: int) -> list[Contradiction]:
    """Check that the system gain maps the full well [electrons] to at most the last digital number."""
    gain = sensor.system_gain
    if gain is None or full_well * gain <= 2.0**bits * (1.0 + PRINTED_TOLERANCE):
        return []
    return [
        Contradiction(
            what="saturation capacity against system gain and bit depth",
            stated=show(full_well, ELECTRONS),
            implied=f"{show(2.0**bits / gain, ELECTRONS)} at the largest of 2^{bits} digital numbers",
            used="whichever ends first",
            path=("sensor", "system_gain"),
        )
    ]


def _sensitivity_contradictions(sensor: Sensor, stated: float | None) -> list[Contradiction]:
    """Check the threshold ``μ_p.min = (√(σ² + 1/4) + 1/2)/η, σ² = σ_d² + 1/(12 K²)``, formerly ``(σ + 1/2)/η``.

    Source: EMVA 1288, releases 4.0 and 3.1. Without quantum efficiency and dark noise, there is nothing to check.
    """
    efficiency, dark = sensor.quantum_efficiency, sensor.temporal_dark_noise
    if stated is None or efficiency is None or dark is None:
        return []
    noise = math.hypot(dark, 0.0 if sensor.system_gain is None else 1.0 / (math.sqrt(12.0) * sensor.system_gain))
    implied = (math.hypot(noise, 0.5) + 0.5) / efficiency, (noise + 0.5) / efficiency
    if any(math.isclose(stated, threshold, rel_tol=PRINTED_TOLERANCE) for threshold in implied):
        return []
    return [
        Contradiction(
            what="absolute sensitivity threshold against quantum efficiency, dark noise and system gain",
            stated=show(stated, PHOTONS),
            implied=show(implied[0], PHOTONS),
            used="quantum efficiency, dark noise and system gain",
            path=("stated", "absolute_sensitivity_threshold"),
        )
    ]


def show(value: float, dimension: Dimension) -> str:
    """A value with enough digits to distinguish contradictory values."""
    return pretty(value, dimension, digits=4)


@dataclass(frozen=True)
class DerivedValue:
    """A number that follows from the declared values, in the SI unit of its dimension; as text, four digits of it."""

    value: float
    dimension: Dimension

    def __str__(self) -> str:
        return show(self.value, self.dimension)


Properties = tuple[tuple[str, DerivedValue | str], ...]


@dataclass(frozen=True, kw_only=True)
class Camera(ABC):
    """A camera: pixels, a lens that gathers light, and a focus. Cameras that measure depth are `DepthCamera`s.

    Parameters
    ----------
    sensor
        The sensor that takes each of its pictures.
    """

    family: ClassVar[str]
    """Its working principle; reports compare cameras of one family side by side."""
    corners_calibrate: ClassVar[bool] = False
    """Whether corners of a board in its pictures can calibrate it as a pair of cameras."""
    lens_count: ClassVar[int] = 1
    """Number of equal lenses that take a picture at the same time."""
    refocuses: ClassVar[bool] = False
    """Whether its pictures can be refocused by shifting views."""
    rays_per_pixel: ClassVar[int] = 8
    """Number of rays per pixel and lens that keeps the sampling error of ray-traced pictures below 0.5 %."""

    sensor: Sensor

    @property
    def pixel_count(self) -> int:
        """Number of pixels of all pictures that are taken at the same time."""
        return self.sensor.columns * self.sensor.rows * self.lens_count

    @property
    @abstractmethod
    def gathering_lens(self) -> Lens:
        """The lens whose pupil gathers the light."""

    @property
    def principal_plane(self) -> float:
        """How far the first principal plane lies in front of the point from which distances count [m].

        That point is the centre of projection: the entrance pupil.
        """
        return self.gathering_lens.entrance_pupil

    def from_pupil(self, distance: ArrayLike) -> FloatArray:
        """Distances from the entrance pupil of distances as they count for this camera [m]."""
        return np.asarray(distance, dtype=np.float64) - self.principal_plane + self.gathering_lens.entrance_pupil

    @property
    def nearest_imaged(self) -> float:
        """Distance beyond which an object has a real image and lies in front of the entrance pupil [m]."""
        lens = self.gathering_lens
        return max(lens.focal_length, -lens.entrance_pupil) + self.principal_plane

    @property
    @abstractmethod
    def focus(self) -> Focus:
        """The focus, which decides what is sharp."""

    @abstractmethod
    def properties(self) -> Properties:
        """Names and values of derived properties, in reading order; words where no number can say it."""

    @abstractmethod
    def contradictions(self, stated: StatedPart | None, tolerance: float) -> Sequence[Contradiction]:
        """Check over-determined inputs against each other, to a relative ``tolerance`` of depth."""

    @abstractmethod
    def depth_behind_lens(self, nearest: float) -> float:
        """Distance from the second principal plane to the sensor [m], focused as near as the scene requires.

        ``nearest`` is the distance of its nearest object [m].
        """

    def edge_angles(self, nearest: float) -> tuple[float, float, float, float]:
        """Angles [rad] from the axis to the left, right, upper and lower edge of the picture.

        It is focused as near as the scene requires (``nearest`` [m]).
        """
        twice = 2.0 * self.gathering_lens.principal_distance(self.depth_behind_lens(nearest))
        across, down = math.atan(self.sensor.width / twice), math.atan(self.sensor.height / twice)
        return across, across, down, down

    @property
    def front(self) -> float:
        """How far in front of the point from which distances count the front of the housing lies [m]; NaN if unknown.

        A working distance, from the front, is shorter by this length.
        """
        front = self.gathering_lens.housing_front
        return math.nan if front is None else front + self.principal_plane

    @property
    def origin(self) -> str:
        """The point from which its distances count, in words; see `principal_plane`."""
        return "entrance pupil" if self.gathering_lens.is_thick else "principal plane"

    def lens_places(self) -> Properties:
        """Where distances count from, principal planes, pupils and front; none for a thin lens without a housing."""
        lens, rows = self.gathering_lens, dict[str, float]()
        if lens.is_thick:
            rows = {
                "separation of the principal planes": lens.principal_separation,
                "entrance pupil, behind the first principal plane": lens.entrance_pupil,
                "exit pupil, behind the second principal plane": lens.exit_pupil,
                "diameter of the exit pupil": lens.exit_pupil_diameter,
            }
        if not math.isnan(self.front):
            rows["front of the housing, in front of the point from which distances count"] = self.front
        counted = [("distances count from", f"the {self.origin}")] if rows else []
        return (*counted, *((name, DerivedValue(value, LENGTH)) for name, value in rows.items()))

    @property
    def makes_depth_map(self) -> bool:
        """Whether the exposures of one scene give a depth map."""
        return True

    @property
    def separation(self) -> float:
        """Distance [m] between its lenses across the line of sight; 0 for cameras with one lens."""
        return 0.0

    @property
    def nearest_distance(self) -> float:
        """Nearest distance [m] by the disparities that a matcher searches; NaN if nothing determines it so."""
        return math.nan

    @property
    def one_pixel_distance(self) -> float:
        """Distance [m] at which the disparity is one pixel; NaN if disparity is not ``1/Z`` times a constant."""
        return math.nan

    @property
    def view_baseline(self) -> float:
        """Largest distance [m] between two views from which depth is measured; 0 for a single image."""
        return self.separation or (self.gathering_lens.pupil_diameter if self.makes_depth_map else 0.0)

    @property
    def takes_stack(self) -> bool:
        """Whether it takes several images one after another, each with its own focus."""
        return False

    @property
    def time_per_image(self) -> float | None:
        """Time from one image of a stack to the next [s]; None if unknown."""
        return None

    def microlenses_seeing(self, distance: FloatArray) -> FloatArray:
        """Mean number of microlenses that see a point at distances [m]; NaN for cameras without microlenses."""
        return np.full_like(distance, math.nan)

    @property
    def elements(self) -> int:
        """Number of parts with individual errors, such as microlenses."""
        return 0

    @property
    def left_out(self) -> str:
        """What of the camera's declaration acts only in part, as clauses; empty if all acts wherever it could."""
        return ""

    def light_chain(self) -> MicrolensCamera:
        """The camera in the form that `tradestudy.optics.microlens_image` expects.

        Raises
        ------
        OutOfRangeError
            If it has no microlens array.
        """
        raise OutOfRangeError(
            "light behind a microlens array",
            value="a camera without one",
            limit="plenoptic cameras",
            remedy="for the spot of a lens, use tradestudy.optics.point_spread",
        )

    @property
    def refocusing(self) -> Refocusing:
        """Its views, which shifts refocus and two of which triangulate.

        Raises
        ------
        OutOfRangeError
            If a picture of the camera is no sum of views.
        """
        raise OutOfRangeError(
            "refocusing by shifting views",
            value=f"a camera of the family “{self.family}” without a view for each pixel under a microlens",
            limit="unfocused plenoptic cameras",
            remedy="leave it out; the depth of field of any camera is a question of its own (depth_of_field)",
        )

    def exposures(
        self,
        reference_distance: float,  # noqa: ARG002 - kinds that take pictures use it
        errors: Errors,  # noqa: ARG002 - as above
        environment: Environment | None,  # noqa: ARG002 - as above
        stop_separation: float,  # noqa: ARG002 - as above
    ) -> Sequence[Exposure]:
        """The pictures that it takes of one scene.

        Parameters
        ----------
        reference_distance
            Distance of the middle of the scene [m]; cameras that refocus are focused there.
        errors
            Deviations of the camera from its design, by the names in its vocabulary and in `SESSION_PARAMETERS`;
            errors of individual elements have shape (elements, 2).
        environment
            How the camera responds to its surroundings; None if it does not.
        stop_separation
            Distance [m] from the lens to a second stop in front of it, which vignettes off axis; 0 for none.

        Raises
        ------
        OutOfRangeError
            If pictures of this kind of camera, or with such errors, cannot be rendered.
        """
        raise OutOfRangeError(
            "pictures of this kind of camera cannot be rendered", remedy="leave it out of scene.image with cameras: […]"
        )

    @property
    def total_covering_plane(self) -> float:
        """Distance [m] at which the absolute virtual depth is 2; NaN for a camera without microlenses."""
        return math.nan
