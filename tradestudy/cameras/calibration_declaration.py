"""The declaration of a calibration: the errors of a camera, their source, and changes since the calibration."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Annotated, Any, ClassVar, Final, Literal

import numpy as np
from pydantic import Field, create_model

from tradestudy import units
from tradestudy.cameras.calibration import SourceName
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_measurement import INTERIOR, PIXEL_NOISE, ErrorParameter
from tradestudy.declarations.distributions import (
    AngleDistribution,
    AnyDistribution,
    DistributionPart,
    LengthDistribution,
    LengthOrPixelsDistribution,
    NumberDistribution,
    PressureDistribution,
    TemperatureDistribution,
    lowest,
)
from tradestudy.declarations.lens_models import FittedLensModel
from tradestudy.declarations.part import MistakeAt, Part, nearest_name
from tradestudy.declarations.quantities import (
    Angle,
    Length,
    Number,
    ObjectDistance,
    PositiveAngle,
    PositiveLength,
    PositivePixels,
    Pressure,
    Span,
    Temperature,
    Text,
    ThermalExpansion,
    quantity,
)
from tradestudy.uncertainty.sources import ErrorClass
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

    def _mistakes(self) -> Iterator[MistakeAt]:
        if self.columns * self.rows < LEAST_CORNERS:
            yield MistakeAt(("columns",), f"a board needs at least {LEAST_CORNERS} corners, columns times rows")
        if mistakes := [*self._mistakes_of_views(), *self._mistakes_of_tilt()]:
            yield MistakeAt.several(mistakes)

    def _mistakes_of_views(self) -> Iterator[MistakeAt]:
        given_keys = [key for key in _DRAWN if getattr(self, key) is not None]
        if self.poses is not None:
            for key in given_keys:
                yield MistakeAt((key,), "poses determines every view; remove this (null removes an inherited one)")
        elif missing := [key for key in _DRAWN if key not in given_keys]:
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
    # The sine keeps small angles exact, where the cosine would lose half of the digits.
    sines = np.linalg.norm(np.cross(normals[:, None], normals[None]), axis=-1)
    return float(np.arcsin(np.clip(sines, 0.0, 1.0)).max())


Correlation = Annotated[float, *quantity(units.NUMBER, at_least=-1.0, at_most=1.0)]
SquareSizeUncertainty = Annotated[float, *quantity(units.FRACTION, at_least=0.0, at_most=0.1)]

_OF_UNIT: Final = {"m": LengthDistribution, "rad": AngleDistribution, "1": NumberDistribution}
_KNOWN_OF_UNIT: Final = {"m": Length, "rad": Angle, "1": Number}
_SOURCES: Final[tuple[SourceName, ...]] = ("corners", "target", "posterior")
_ROUNDING: Final = 1e-9  # of correlations that are written with nine digits, as in files of draws


class ErrorsPart(Part):
    """Distributions of the errors of a camera's parameters; each key names a parameter.

    An error is the true value minus the one with which depth is computed.
    """

    def given(self) -> dict[str, AnyDistribution]:
        """The declared errors by name."""
        return {name: value for name in type(self).model_fields if (value := getattr(self, name)) is not None}


class KnownPart(Part):
    """Values of parameters that the calibration found. Each key names a parameter; those left out are zero.

    The values act in measured depth, in its uncertainty and in rendered pictures. Errors and changes since the
    calibration add to them. Blur, coverage, depth of field and lateral resolution are those of a camera without them.
    """


class CalibratedAtPart(Part):
    """Temperature and pressure of the air during the calibration."""

    temperature: Temperature = Field(default=293.15, description="Air temperature during the calibration.")
    pressure: Pressure = Field(default=101325.0, description="Air pressure during the calibration.")


class StabilityPart(Part):
    """Changes of the air and the camera since the calibration, and a difference in colour; default: none.

    The difference in colour is that between the object and the calibration target.
    """

    needed_by: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "housing_expansion": ("temperature",),
        "sensor_expansion": ("temperature",),
        "focal_length_expansion": ("temperature",),
        "glass_index": ("temperature", "pressure"),
        "calibrated_at": ("temperature", "pressure"),
    }
    """Keys that have an effect only with one of the named changes."""

    temperature: TemperatureDistribution | None = Field(
        default=None, description="Change of the air temperature since the calibration."
    )
    pressure: PressureDistribution | None = Field(
        default=None, description="Change of the air pressure since the calibration."
    )
    color: LengthDistribution | None = Field(
        default=None,
        description="Focal length for light of the object's colour, minus that for light of the calibration target's "
        "colour.",
    )
    ageing: ErrorsPart = Field(
        default_factory=ErrorsPart, description="Errors that the parameters have acquired since the calibration."
    )
    calibrated_at: CalibratedAtPart = Field(
        default_factory=CalibratedAtPart, description="Temperature and pressure of the air during the calibration."
    )
    housing_expansion: ThermalExpansion | None = Field(
        default=None,
        description="Coefficient of linear thermal expansion of the housing; required with "
        "`temperature`, and not accepted without it.",
    )
    sensor_expansion: ThermalExpansion = Field(
        default="2.6 ppm/K",
        validate_default=True,
        description="Coefficient of linear thermal expansion of the sensor; default: that of silicon.",
    )
    focal_length_expansion: ThermalExpansion | None = Field(
        default=None,
        description="Relative change of the focal length per kelvin, not counting the change due to the air "
        "(glass_index); required with `temperature`, and not accepted without it.",
    )
    glass_index: Annotated[float, Field(gt=1.1, lt=5.0)] | None = Field(
        default=None,
        description="Refractive index of the lens, treated as if made of a single glass. It determines how the "
        "surrounding air changes the focal length; required if `temperature` or `pressure` is given, and accepted only "
        "then.",
    )

    def assumed(self) -> Iterator[tuple[tuple[str, ...], str]]:
        """As for every part, but materials matter only if the temperature changes."""
        matter = self.temperature is not None
        for path, value in super().assumed():
            if matter or self.needed_by.get(path[0]) != ("temperature",):
                yield path, value

    def _mistakes(self) -> Iterator[MistakeAt]:
        if mistakes := [*self._mistakes_of_ambient_conditions()]:
            yield MistakeAt.several(mistakes)

    def _mistakes_of_ambient_conditions(self) -> Iterator[MistakeAt]:
        changes = [change for change in ("temperature", "pressure") if getattr(self, change) is not None]
        for change in changes:
            if getattr(self.calibrated_at, change) + lowest(getattr(self, change)) <= 0.0:
                end = "absolute zero" if change == "temperature" else "zero pressure"
                yield MistakeAt(
                    (change,), f"can take stability.calibrated_at.{change} down to {end}; give a smaller change"
                )
        # These have a default, so that no change requires them.
        optional = ("calibrated_at", "sensor_expansion", "baseline_expansion", "microlens_centers")
        for key, users in self.needed_by.items():
            using = [user for user in users if user in changes]
            is_given = key in self.model_fields_set and getattr(self, key) is not None
            if using and not is_given and key not in optional:
                yield MistakeAt((using[0],), f"needs stability.{key} too")
            if is_given and not using:
                yield MistakeAt(
                    (key,), f"has no effect without stability.{' or stability.'.join(users)}; add it, or remove this"
                )


class PairStabilityPart(StabilityPart):
    """Changes of the air and the two cameras since the calibration, and a difference in colour; default: none.

    The difference in colour is that between the object and the calibration target.
    """

    needed_by: ClassVar[Mapping[str, tuple[str, ...]]] = {
        **StabilityPart.needed_by,
        "baseline_expansion": ("temperature",),
    }
    absent: ClassVar[Mapping[str, str]] = {"baseline_expansion": "that of the housing"}

    baseline_expansion: ThermalExpansion | None = Field(
        default=None,
        description="Coefficient of linear thermal expansion of the part that holds the two cameras apart; default: "
        "that of the housing.",
    )


class ArrayStabilityPart(StabilityPart):
    """Changes of the air and the camera since the calibration, and a difference in colour; default: none.

    The difference in colour is that between the object and the calibration target.
    """

    needed_by: ClassVar[Mapping[str, tuple[str, ...]]] = {
        **StabilityPart.needed_by,
        "array_expansion": ("temperature",),
        "microlens_centers": ("temperature",),
    }

    array_expansion: ThermalExpansion | None = Field(
        default=None,
        description="Coefficient of linear thermal expansion of the microlens array; required with `temperature`, and "
        "not accepted without it.",
    )
    microlens_centers: Literal["kept", "found-again"] = Field(
        default="kept",
        validate_default=True,
        description="Centres of the micro-images on the pixels: those of the calibration (`kept`), or found again in "
        "white pictures at the current temperature (`found-again`), so that they follow the array.",
    )


class CornersPart(Part):
    """Stereo rigs only: a calibration from the measured corners of a board that both cameras saw."""

    file: Text = Field(
        description="CSV file of the corners, with the columns `view`, `corner`, `board_x_mm`, `board_y_mm`, "
        "`left_x_px`, `left_y_px`, `right_x_px` and `right_y_px`. The path is relative to the file that contains this "
        "key. If the key `from` of the camera names the corner file, leave this key out; otherwise, it is "
        "required."
    )
    lens_model: FittedLensModel | None = Field(
        default=None,
        description="Lens model to fit to each camera. Default: `{model: rational, fitted: [k1, k2]}`. A rational "
        "model declared without `fitted` has five fitted coefficients: k1, k2, p1, p2 and k3.",
    )
    compared_with: Annotated[tuple[FittedLensModel, ...], Field(max_length=10)] = Field(
        default=(),
        description="Other lens models to fit. The report says how much better or worse than lens_model each of them "
        "predicts views that are left out of the fit, and by how much each changes the depths.",
    )
    square_size_uncertainty: SquareSizeUncertainty = Field(
        default=0.0,
        description="Relative standard deviation of the side of the board's squares, a length that the corners in the "
        "pictures cannot determine.",
    )
    max_steps: MostSteps = Field(
        default=20_000,
        description="Largest number of steps of each Markov chain, a random walk that draws from the posterior.",
    )


class PosteriorPart(Part):
    """A saved calibration: a covariance or joint draws, of errors or of values near the declared ones."""

    file: Text = Field(
        description="A NetCDF file, such as a run writes, or a CSV file. For draws, the first line of the CSV file "
        "names the parameters, and each further line is one joint draw. For a covariance, the first line is "
        "`parameter,mean,` followed by the names, and each further line gives a parameter's name, its mean and its row "
        "of the covariance. Numbers are in SI units, or in pixels if the name ends in `_px`. The path is relative to "
        "the file that contains this key."
    )


class CalibrationPart(Part):
    """How well a camera's parameters are known: their errors, their calibration, and changes since that calibration."""

    camera: ClassVar[type[DepthCamera]]
    kind: ClassVar[str]

    errors: ErrorsPart = Field(
        default_factory=ErrorsPart,
        description="Distributions of the errors of the parameters. Give at most one of `target`, `posterior` and, for "
        "a stereo rig, `corners`. With `target`, the distributions are the priors. With `posterior`, give only errors "
        "that it does not contain; with `corners`, give none.",
    )
    correlations: dict[str, dict[str, Correlation]] = Field(
        default={},
        description="Correlation coefficients of pairs of errors, from −1 to 1; give each pair once. For errors that "
        "are not normal, the coefficients apply to the normal scores: the errors transformed to a normal distribution.",
    )
    corners: CornersPart | None = None
    target: TargetPart | None = None
    posterior: PosteriorPart | None = None
    stability: StabilityPart = Field(default_factory=StabilityPart)

    def assumed(self) -> Iterator[tuple[tuple[str, ...], str]]:
        """A perfect calibration, and no change since, where the part declares no errors or changes."""
        yield from super().assumed()
        if self.source == "errors" and not self.errors.given():
            yield ("errors",), "none: a perfect calibration"
        changed = self.stability
        if not (changed.temperature or changed.pressure or changed.color or changed.ageing.given()):
            yield ("stability",), "none: no change since the calibration"

    @property
    def known_values(self) -> tuple[tuple[str, float], ...]:
        """Names and values in SI of the parameters whose value is known and not zero."""
        part = getattr(self, "known", None)
        return tuple((name, value) for name in self.camera.known_parameters if (value := getattr(part, name)))

    @property
    def source(self) -> SourceName:
        """The source of the errors' distribution."""
        return next((source for source in _SOURCES if getattr(self, source) is not None), "errors")

    def _mistakes(self) -> Iterator[MistakeAt]:
        if mistakes := [*self._mistakes_of_source(), *self._mistakes_of_correlations()]:
            yield MistakeAt.several(mistakes)

    def _mistakes_of_source(self) -> Iterator[MistakeAt]:
        sources = [source for source in _SOURCES if getattr(self, source) is not None]
        for other in sources[1:]:
            yield MistakeAt(
                (other,), f"a calibration has only one source, and {sources[0]} is given already; remove one of the two"
            )
        if self.corners is not None and not self.camera.corners_calibrate:
            what = f"corners of two cameras calibrate a stereo rig; a {self.kind} camera takes target or posterior"
            yield MistakeAt(("corners",), what)
        elif self.corners is not None and self.errors.given():
            what = (
                "corners determine every parameter of the rig; remove errors (null removes inherited ones), and "
                "put changes since the calibration under stability"
            )
            yield MistakeAt(("errors",), what)
        if self.target is not None:
            yield from self._mistakes_of_priors()

    def _mistakes_of_priors(self) -> Iterator[MistakeAt]:
        errors = self.errors.given()
        if not errors:
            yield MistakeAt(("target",), "needs errors, the priors of the parameters that it determines")
        vocabulary = self.camera.error_vocabulary
        priors = {name for name in errors if vocabulary[name].error_class is ErrorClass.RIG}
        for name in errors:
            shape = errors[name].resolved_shape
            if name in priors and shape not in ("normal", "uniform"):
                yield MistakeAt(
                    ("errors", name), f"{shape} is not a valid prior for a target; a normal or uniform one is expected"
                )
        for name, partners in self.correlations.items():
            if priors & {name, *partners}:
                what = (
                    "priors for a target are independent, because the target determines the correlations; remove this "
                    "(null removes an inherited one)"
                )
                yield MistakeAt(("correlations", name), what)

    def _mistakes_of_correlations(self) -> Iterator[MistakeAt]:
        errors, seen = self.errors.given(), set[frozenset[str]]()
        wrong = [*self._unknown_names(errors)]
        for first, partners in self.correlations.items():
            for second in partners:
                pair, path = frozenset((first, second)), ("correlations", first, second)
                if len(pair) == 1:
                    wrong.append(MistakeAt(path, "an error cannot be correlated with itself; name two errors"))
                elif pair in seen:
                    wrong.append(
                        MistakeAt(path, f"the pair of {first} and {second} is given already; give each pair once")
                    )
                elif pair <= errors.keys() and (classes := self._class_conflict(first, second)) is not None:
                    wrong.append(MistakeAt(path, f"errors drawn {classes} cannot be correlated"))
                seen.add(pair)
        yield from wrong or _indefinite(self.correlations)

    def _unknown_names(self, errors: Mapping[str, object]) -> Iterator[MistakeAt]:
        for first, partners in self.correlations.items():
            for path, name in ((("correlations", first), first), *((("correlations", first, n), n) for n in partners)):
                if name not in errors:
                    what = f"{name!r} is not among the errors of this camera{nearest_name(name, errors)}"
                    yield MistakeAt(path, what)

    def _class_conflict(self, first: str, second: str) -> str | None:
        """How often each of two parameters is drawn; None where both are drawn equally often."""
        first_class, second_class = (self.camera.error_vocabulary[name].error_class for name in (first, second))
        return None if first_class is second_class else f"{first_class.value} and errors drawn {second_class.value}"


def _distribution_of(parameter: ErrorParameter) -> type[DistributionPart[Any, Any]]:
    """How an error is declared: lengths inside a camera may be counted in pixels."""
    is_inside = parameter.unit == "m" and parameter.part == INTERIOR
    return LengthOrPixelsDistribution if is_inside else _OF_UNIT[parameter.unit]


def correlated(correlations: Mapping[str, Mapping[str, float]]) -> list[tuple[str, ...]]:
    """Groups of errors that are correlated, directly or through others, in the order of their first errors."""
    groups: list[list[str]] = []
    for first, partners in correlations.items():
        # A new row may connect groups that were separate until now.
        joined = [group for group in groups if {first, *partners} & set(group)]
        names = dict.fromkeys([*(name for group in joined for name in group), first, *partners])
        groups = [group for group in groups if group not in joined]
        groups.append(list(names))
    return [tuple(group) for group in groups if len(group) > 1]


def correlation_matrix(
    names: tuple[str, ...], correlations: Mapping[str, Mapping[str, float]]
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Correlation matrix of these errors: 1 on the diagonal, 0 where nothing is given."""
    matrix = np.eye(len(names))
    at = {name: index for index, name in enumerate(names)}
    for first, partners in correlations.items():
        for second, value in partners.items():
            if first in at and second in at:
                matrix[at[first], at[second]] = matrix[at[second], at[first]] = value
    return matrix


def _indefinite(correlations: Mapping[str, Mapping[str, float]]) -> Iterator[MistakeAt]:
    """Mistakes for groups whose correlation matrix is not positive semidefinite."""
    for names in correlated(correlations):
        smallest = float(np.linalg.eigvalsh(correlation_matrix(names, correlations))[0])
        if smallest < -len(names) * _ROUNDING:
            yield MistakeAt(
                ("correlations", next(name for name in correlations if name in names)),
                f"these correlations are impossible: the matrix of {', '.join(names)} has the eigenvalue "
                f"{smallest:.3g}; at least 0 is expected. Declare the missing pairs (an omitted pair is "
                "uncorrelated), or reduce the correlations",
            )


def calibration_part(
    camera: type[DepthCamera], kind: str, stability: type[StabilityPart] = StabilityPart
) -> type[CalibrationPart]:
    """The calibration part of a kind of camera: every error of its vocabulary, each in its dimension.

    Parameters
    ----------
    camera
        Class of the cameras. Measurement noise is not declared here, but as their disparity error.
    kind
        Name of the kind in study files.
    stability
        Its changes since the calibration, with the parts that expand.
    """
    title = "".join(word.capitalize() for word in kind.split("-"))
    vocabulary = tuple(camera.error_vocabulary.items())
    parts = _parts_of_family(camera.family.capitalize(), vocabulary, camera.known_parameters, stability)
    made = create_model(f"{title}Calibration", __base__=CalibrationPart, __doc__=CalibrationPart.__doc__, **parts)
    made.camera, made.kind = camera, kind
    return made


@cache
def _parts_of_family(
    title: str,
    vocabulary: tuple[tuple[str, ErrorParameter], ...],
    known_parameters: tuple[str, ...],
    stability: type[StabilityPart],
) -> dict[str, Any]:
    """The errors, changes and known values of a calibration, which kinds of one family share."""
    fields: dict[str, Any] = {
        name: (_distribution_of(parameter) | None, Field(default=None, description=parameter.meaning))
        for name, parameter in vocabulary
        if name != PIXEL_NOISE
    }
    errors = create_model(f"{title}Errors", __base__=ErrorsPart, __doc__=ErrorsPart.__doc__, **fields)
    ageing = Field(default_factory=errors, description=StabilityPart.model_fields["ageing"].description)
    changes = create_model(f"{title}Stability", __base__=stability, __doc__=stability.__doc__, ageing=(errors, ageing))
    described = Field(default_factory=errors, description=CalibrationPart.model_fields["errors"].description)
    parts: dict[str, Any] = {"errors": (errors, described), "stability": (changes, Field(default_factory=changes))}
    if known_parameters:
        values: dict[str, Any] = {
            name: (_KNOWN_OF_UNIT[parameter.unit], Field(default=0.0, description=parameter.meaning))
            for name, parameter in vocabulary
            if name in known_parameters
        }
        known_part = create_model(f"{title}Known", __base__=KnownPart, __doc__=KnownPart.__doc__, **values)
        parts["known"] = (known_part, Field(default_factory=known_part))
    return parts
