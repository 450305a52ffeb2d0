"""Errors of cameras: the parameters that can be in error, the environment, and what error models take and return."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.parts import Sensor
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.thin_lens import air_refractive_index, focal_length_change_with_medium
from tradestudy.uncertainty.sources import ErrorClass

Unit = Literal["m", "rad", "1", "px", "K", "Pa"]


@dataclass(frozen=True, kw_only=True)
class ErrorParameter:
    """One parameter that can be in error.

    Parameters
    ----------
    unit
        SI unit, or px.
    part
        The group of error sources under which it is reported, such as "noise", "interior orientation" or "array".
    meaning
        One sentence for the authors of studies.
    error_class
        How often it is drawn.
    """

    unit: Unit
    part: str
    meaning: str
    error_class: ErrorClass = ErrorClass.RIG


ErrorVocabulary = Mapping[str, ErrorParameter]
"""The parameters of one kind of camera by name, in the order in which they are drawn."""

PIXEL_NOISE: Final = "pixel_noise"
"""The error of one measured disparity [m on the sensor], which every kind has."""
NOISE_PARAMETER: Final = ErrorParameter(
    unit="m", part="noise", meaning="Error of one measured disparity on the sensor.", error_class=ErrorClass.MEASUREMENT
)
SESSION_PARAMETERS: Final[ErrorVocabulary] = {
    "temperature_change": ErrorParameter(
        unit="K",
        part="temperature",
        meaning="Temperature minus that during the calibration.",
        error_class=ErrorClass.SESSION,
    ),
    "pressure_change": ErrorParameter(
        unit="Pa",
        part="pressure",
        meaning="Ambient pressure minus that during the calibration.",
        error_class=ErrorClass.SESSION,
    ),
    "color_shift": ErrorParameter(
        unit="m",
        part="color",
        meaning="Focal length for the object's colour minus that for the calibration target's colour.",
        error_class=ErrorClass.SESSION,
    ),
}
"""Changes that affect the camera after its calibration, and that the calibration therefore does not contain."""
INTERIOR: Final = "interior orientation"
"""The group of parameters inside a camera: focal length, principal point, distortion, distances behind the lens."""
AGEING: Final = "ageing_"
"""Prefix of a parameter's name that denotes the error added since the calibration."""


Errors = Mapping[str, ArrayLike]
"""Errors by name, in SI; missing ones are zero. Arrays of shape (draws, 1) give one row per draw."""


_GRID: Final = 5  # places across and down a part of the picture


@dataclass(frozen=True, kw_only=True)
class PicturePlace:
    """One position in the picture.

    Parameters
    ----------
    across, down
        Distance from the middle as a fraction of half the sensor, −1 (left, top) to 1 (right, bottom).
    """

    across: float
    down: float

    def __post_init__(self) -> None:
        for share in (self.across, self.down):
            require_field(abs(share))


@dataclass(frozen=True, kw_only=True, eq=False)
class PicturePlaces:
    """Positions anywhere in the picture, one for each measured distance.

    Parameters
    ----------
    across, down : array (distances,)
        Distance from the middle as a fraction of half the sensor, −1 to 1.
    """

    across: FloatArray
    down: FloatArray


FieldPosition = float | PicturePlace
"""A position in the picture; a number is a fraction of the way from the axis to the lower right corner."""
Field = FieldPosition | PicturePlaces
"""One position in the picture, or one for each measured distance."""

# Errors of calibration are correlated and act from one side, as the yaw of one camera of a pair does, so no camera
# measures alike in all four; the disparity error alone depends only on the distance from the middle.
CORNERS: Final[Mapping[str, tuple[int, int]]] = {
    "lower right": (1, 1),
    "lower left": (-1, 1),
    "upper right": (1, -1),
    "upper left": (-1, -1),
}
"""The corners of the picture, with the signs of their positions across and down."""


def towards_corners(share: float) -> tuple[PicturePlace, ...]:
    """The places at a fraction of the way from the middle of the picture to its corners, in the order of `CORNERS`."""
    return tuple(PicturePlace(across=share * across, down=share * down) for across, down in CORNERS.values())


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredInverseDepth:
    """Inverse depths measured by a camera.

    Parameters
    ----------
    inverse_depth
        w = 1/Z [1/m], shape (draws, distances); w ≤ 0 is at or beyond infinity.
    no_overlap
        Where the camera does not see the point at all; broadcasts against ``inverse_depth``.
    out_of_range
        Where the errors make the camera impossible: a length is not positive, or a distortion has no inverse.
    """

    inverse_depth: FloatArray
    no_overlap: BoolArray
    out_of_range: BoolArray


def places_within(share: float) -> tuple[PicturePlace, ...]:
    """A grid of places over the rectangle that reaches a fraction of the way to the corners of the picture.

    The first ones are its corners; the middle is one of them. Depth uncertainty changes smoothly over the picture, so
    that its largest value in the rectangle lies near one of them, usually in a corner or on an edge.
    """
    steps = share * np.linspace(-1.0, 1.0, _GRID)
    inner = (PicturePlace(across=float(across), down=float(down)) for down in steps for across in steps)
    return tuple(dict.fromkeys((*towards_corners(share), *inner)))


def place_words(field: FieldPosition) -> str:
    """A position in the picture, in words."""
    if not isinstance(field, PicturePlace):
        field = PicturePlace(across=field, down=field)
    across, down = abs(field.across), abs(field.down)
    left, top = "left" if field.across < 0.0 else "right", "top" if field.down < 0.0 else "bottom"
    if across == down:
        corner = f"{'upper' if top == 'top' else 'lower'} {left} corner"
        return f"{100.0 * across:.3g} % of the way to the {corner}" if across else "on the axis"
    towards = [
        f"{100.0 * share:.3g} % of the way to the {edge}"
        for share, edge in ((across, f"{left} edge"), (down, f"{top} edge"))
        if share
    ]
    return " and ".join(towards)


def require_known(errors: Errors, known: Collection[str], camera: str) -> None:
    """Refuse errors that a camera does not have."""
    if unknown := sorted(set(errors) - set(known) - set(SESSION_PARAMETERS)):
        raise OutOfRangeError(
            f"{camera} has no such error",
            value=", ".join(unknown),
            limit=", ".join(sorted({*known, *SESSION_PARAMETERS})),
            remedy="use one of the names of its error model",
        )


def shares_of(field: Field) -> tuple[FloatArray, FloatArray]:
    """Position as fractions of half the sensor, across and down; refuses positions beyond the edge."""
    if isinstance(field, PicturePlace | PicturePlaces):
        return np.asarray(field.across), np.asarray(field.down)
    require_field(field)
    return np.asarray(field), np.asarray(field)


def require_field(field: float) -> None:
    """Refuse a position beyond the edge of the sensor."""
    if not 0.0 <= field <= 1.0:
        raise OutOfRangeError(
            "field position beyond the edge of the sensor",
            value=f"{field:g}",
            limit="0 (axis) to 1 (corner of the sensor)",
            remedy="give the field position as a fraction of the distance from axis to corner",
        )


def value_of(errors: Errors, name: str) -> FloatArray:
    """One error, zero where it is not given."""
    return np.asarray(errors.get(name, 0.0), dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class Environment:
    """The ambient conditions in which a camera was calibrated, and its response to changes.

    Parameters
    ----------
    housing_expansion
        Coefficient of linear thermal expansion of the housing [1/K]; 23e-6 for aluminium.
    baseline_expansion
        That of the part that holds the two cameras of a stereo rig apart [1/K].
    array_expansion
        That of a microlens array [1/K].
    scale_expansion
        That of whatever positions in the picture are measured by [1/K]: the pixels of the sensor or, if the centres of
        the microlenses are found again in the pictures, the microlens array.
    focal_length_expansion
        Relative change of the focal length per kelvin [1/K].
    glass_index
        Refractive index of the lens, treated as if made of a single glass; it determines how the surrounding air
        changes the focal length.
    wavelength
        Wavelength in vacuum [m].
    temperature, pressure
        Values during the calibration [K], [Pa].

    Raises
    ------
    OutOfRangeError
        For a glass index of at most 1.1, or an impossible temperature or pressure.
    """

    housing_expansion: float
    baseline_expansion: float
    array_expansion: float
    scale_expansion: float
    focal_length_expansion: float
    glass_index: float
    wavelength: float
    temperature: float
    pressure: float

    def __post_init__(self) -> None:
        if not (self.glass_index > 1.1 and self.temperature > 0.0 and self.pressure >= 0.0):
            raise OutOfRangeError(
                "impossible environment of the calibration",
                value=f"glass {self.glass_index:g}, {self.temperature:g} K, {self.pressure:g} Pa",
                limit="glass above 1.1, temperature above 0 K, pressure 0 Pa or more",
                remedy="correct the values",
            )

    def housing_factor(self, changes: Errors) -> FloatArray:
        """Ratio of current lengths of the housing to those during calibration [1]."""
        return self._length_factor(self.housing_expansion, changes)

    def baseline_factor(self, changes: Errors) -> FloatArray:
        """Ratio of the current baseline of a stereo rig to that during calibration [1]."""
        return self._length_factor(self.baseline_expansion, changes)

    def array_factor(self, changes: Errors) -> FloatArray:
        """Ratio of the current pitch of the microlenses to that during calibration [1]."""
        return self._length_factor(self.array_expansion, changes)

    def scale_factor(self, changes: Errors) -> FloatArray:
        """Ratio of the current length of what measures positions in the picture to that during calibration [1]."""
        return self._length_factor(self.scale_expansion, changes)

    def _length_factor(self, expansion: float, changes: Errors) -> FloatArray:
        return 1.0 + expansion * value_of(changes, "temperature_change")

    def focal_length_factor(self, changes: Errors) -> FloatArray:
        """Ratio of the current focal length to that during calibration [1], from thermal drift and the ambient air."""
        warmer = value_of(changes, "temperature_change")
        factor: FloatArray = 1.0 + self.focal_length_expansion * warmer
        return factor * focal_length_change_with_medium(
            self.glass_index,
            self._index(np.zeros(()), np.zeros(())),
            self._index(warmer, value_of(changes, "pressure_change")),
        )

    def _index(self, warmer: FloatArray, denser: FloatArray) -> FloatArray:
        return air_refractive_index(self.wavelength, self.temperature + warmer, self.pressure + denser)


def warmed(sensor: Sensor, changes: Errors, environment: Environment | None) -> Sensor:
    """A sensor whose pixels have expanded since the calibration; see `Environment.scale_expansion`."""
    if environment is None or "temperature_change" not in changes:
        return sensor
    return replace(sensor, pixel_pitch=sensor.pixel_pitch * float(environment.scale_factor(changes)))
