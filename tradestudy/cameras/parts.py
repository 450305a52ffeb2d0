"""The parts of cameras: lens, sensor and microlens array. They are frozen, in SI units, and checked once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray

Layout = Literal["hexagonal", "square"]


def require_positive(name: str, value: float, unit: str = "m") -> None:
    """Refuse a value that is not a finite number above zero."""
    if not (math.isfinite(value) and value > 0.0):
        raise OutOfRangeError(
            f"{name} must be a finite number above zero",
            value=f"{value:g} {unit}".strip(),
            remedy="correct the value",
        )


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """A pixel array.

    Parameters
    ----------
    columns, rows
        Number of pixels across and down.
    pixel_pitch
        Distance between neighbouring pixel centres [m], the same in both directions.
    quantum_efficiency, temporal_dark_noise, saturation_capacity, system_gain
        As defined by EMVA 1288: η [electrons per photon], σ_d and μ_e.sat [electrons], K [DN/electron]; None where
        unknown.
    relative_exposure
        Exposure time, relative to that at which the scene's light is given [1].
    """

    columns: int
    rows: int
    pixel_pitch: float
    quantum_efficiency: float | None = None
    temporal_dark_noise: float | None = None
    saturation_capacity: float | None = None
    system_gain: float | None = None
    relative_exposure: float = 1.0

    def __post_init__(self) -> None:
        require_positive("pixel pitch", self.pixel_pitch)
        if self.columns < 1 or self.rows < 1:
            raise OutOfRangeError(
                "a sensor needs at least one pixel in each direction",
                value=f"{self.columns} × {self.rows}",
                limit="at least 1 × 1",
            )

    @property
    def width(self) -> float:
        """Width [m]."""
        return self.columns * self.pixel_pitch

    @property
    def height(self) -> float:
        """Height [m]."""
        return self.rows * self.pixel_pitch

    @property
    def diagonal(self) -> float:
        """Diagonal [m]."""
        return math.hypot(self.width, self.height)


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A lens in air, with its principal planes H and H' and its pupils; by default a thin lens, where all coincide.

    Conjugates count from the principal planes: 1/a + 1/b = 1/f with a in front of H and b behind H'. Rays enter through
    the entrance pupil and leave through its image, the exit pupil.

    Parameters
    ----------
    focal_length
        Focal length f [m].
    f_number
        N = f / A with A the diameter of the entrance pupil.
    principal_separation
        Distance from H to H' along the light [m], of either sign.
    entrance_pupil
        Distance e of the entrance pupil behind H [m]; negative in front of it.
    stated_exit_pupil
        Distance of the exit pupil behind H' [m] that is stated besides e, to check; None if it is not stated.
    housing_front
        Distance of the front of the housing in front of H [m]; None if unknown.
    """

    focal_length: float
    f_number: float
    principal_separation: float = 0.0
    entrance_pupil: float = 0.0
    stated_exit_pupil: float | None = None
    housing_front: float | None = None

    def __post_init__(self) -> None:
        require_positive("focal length", self.focal_length)
        require_positive("f-number", self.f_number, "")

    @property
    def is_thick(self) -> bool:
        """Whether principal planes and pupils do not all coincide."""
        return self.entrance_pupil != 0.0 or self.principal_separation != 0.0

    @property
    def pupil_diameter(self) -> float:
        """A = f / N [m], of the entrance pupil."""
        return self.focal_length / self.f_number

    @property
    def pupil_ratio(self) -> float:
        """g = A/A' = 1 + e/f, the diameter of the entrance pupil over that of the exit pupil; 0 for one at infinity."""
        return 1.0 + self.entrance_pupil / self.focal_length

    @property
    def exit_pupil(self) -> float:
        """Distance e' = e/g of the exit pupil behind H' [m], from 1/e' = 1/e + 1/f; infinity is allowed."""
        return self.entrance_pupil / self.pupil_ratio if self.pupil_ratio else math.inf

    @property
    def exit_pupil_diameter(self) -> float:
        """A' = A/|g| [m]."""
        return self.pupil_diameter / abs(self.pupil_ratio) if self.pupil_ratio else math.inf

    @property
    def front_focus(self) -> float:
        """F = f + e [m], how far in front of the entrance pupil the front focal point lies."""
        return self.focal_length + self.entrance_pupil

    @overload
    def principal_distance(self, image_distance: float) -> float: ...
    @overload
    def principal_distance(self, image_distance: FloatArray) -> FloatArray: ...
    def principal_distance(self, image_distance: float | FloatArray) -> float | FloatArray:
        """c = g b − e [m] of a plane b behind H': an object in focus at slope t from the entrance pupil appears at c t.

        It is g times the distance from the exit pupil, so that the f-number on the image side is c/A.
        """
        return self.pupil_ratio * image_distance - self.entrance_pupil

    def thin_focal_length(self, focus: ArrayLike) -> FloatArray:
        """f Z₀/(Z₀ − e) [m]: focal length of the thin lens in place of the entrance pupil that images like this lens.

        Both are focused at Z₀ [m] from the pupil. Blur, scale and f-number then agree at all distances.
        """
        return np.asarray(self.focal_length / (1.0 - self.entrance_pupil / np.asarray(focus, dtype=np.float64)))

    def thin(self, focus: float) -> Lens:
        """The thin lens of `thin_focal_length`."""
        if self.entrance_pupil == 0.0:
            return self
        focal_length = float(self.thin_focal_length(focus))
        return Lens(focal_length=focal_length, f_number=focal_length / self.pupil_diameter)

    def field_of_view(self, extent: float) -> float:
        """Full angle [rad] that corresponds to an extent [m] in the focal plane: ``2 atan(extent / 2f)``."""
        return 2.0 * math.atan(extent / (2.0 * self.focal_length))


def focal_length_of_field_of_view(field_of_view: float, extent: float) -> float:
    """The focal length [m] that images a full angle [rad] onto an extent [m]: ``extent / (2 tan(FOV/2))``."""
    return extent / (2.0 * math.tan(field_of_view / 2.0))


@dataclass(frozen=True, kw_only=True)
class MicrolensArray:
    """Microlenses of one or several types on a square or hexagonal lattice, at one distance in front of the sensor.

    Parameters
    ----------
    layout
        The lattice.
    pitch
        Distance p between neighbouring centres [m].
    gap
        Distance b_L from array to sensor [m].
    focal_lengths
        One f_L [m] for each type; types alternate, so that each forms a coarser lattice of its own. Infinite for
        pinholes.
    aperture_diameter
        Clear diameter of one microlens [m]; at most the pitch.
    """

    layout: Layout
    pitch: float
    gap: float
    focal_lengths: tuple[float, ...]
    aperture_diameter: float

    def __post_init__(self) -> None:
        require_positive("microlens pitch", self.pitch)
        require_positive("microlens gap", self.gap)
        require_positive("microlens aperture diameter", self.aperture_diameter)
        if not self.focal_lengths:
            raise OutOfRangeError("a microlens array needs at least one type", remedy="give one focal length per type")
        for focal_length in self.focal_lengths:
            if math.isnan(focal_length) or focal_length in (0.0, -math.inf):
                raise OutOfRangeError(
                    "a microlens focal length must be finite and not zero, or infinite for a pinhole",
                    value=f"{focal_length:g} m",
                )
        if self.aperture_diameter > self.pitch * (1.0 + 1e-12):
            raise OutOfRangeError(
                "microlenses overlap",
                value=f"aperture {self.aperture_diameter * 1e6:g} um",
                limit=f"at most the pitch, {self.pitch * 1e6:g} um",
                remedy="reduce the aperture or the fill factor",
            )
        if len(self.focal_lengths) not in ((1, 3) if self.layout == "hexagonal" else (1,)):
            raise OutOfRangeError(
                f"{len(self.focal_lengths)} types cannot tile a {self.layout} array evenly",
                limit="1 or 3 types on a hexagonal array, 1 on a square one",
            )

    @property
    def types(self) -> int:
        """Number of microlens types."""
        return len(self.focal_lengths)
