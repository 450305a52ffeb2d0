"""Calibration errors in full: distributions, joint calibrations, synthetic targets, and what to work out from them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Final, Generic, Literal, Self, TypeVar

from pydantic import Field, create_model, model_validator

from tradestudy import units
from tradestudy.cameras.declaration import CameraDeclaration
from tradestudy.cameras.kinds import ERROR_UNITS, KINDS, kind_name
from tradestudy.declarations.distances import DistanceRangePart
from tradestudy.declarations.mistakes import MistakeAt, nearest_name
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import (
    Angle,
    Length,
    Number,
    PositiveAngle,
    PositiveFraction,
    PositiveLength,
    PositiveNumber,
    PositivePixels,
    Pressure,
    Share,
    Temperature,
    TemperatureDifference,
    ThermalExpansion,
    quantity,
)
from tradestudy.declarations.words import CameraName, Text, Way

PressureChange = Annotated[float, *quantity(units.PRESSURE)]
PositivePressure = Annotated[float, *quantity(units.PRESSURE, above=0.0)]
PositiveTemperatureDifference = Annotated[float, *quantity(units.TEMPERATURE_DIFFERENCE, above=0.0)]

Drawn = Literal["per rig", "per session", "per lens", "per measurement"]
Any_ = TypeVar("Any_", bound=float)
Positive = TypeVar("Positive", bound=float)


class _DistributionPart(Part, Generic[Any_]):
    mean: Any_ | None = Field(default=None, description="Expectation of the error; default: 0.")
    drawn: Drawn | None = Field(
        default=None,
        description="How often the error is drawn anew; default: pixel noise per measurement, temperature and "
        "pressure per session, all else per rig.",
    )


class NormalPart(_DistributionPart[Any_], Generic[Any_, Positive]):
    """A normal error."""

    shape: Literal["normal"]
    standard_deviation: Positive


class UniformPart(_DistributionPart[Any_], Generic[Any_, Positive]):
    """An error that is anywhere within its half width with equal probability."""

    shape: Literal["uniform"]
    half_width: Positive


class TriangularPart(_DistributionPart[Any_], Generic[Any_, Positive]):
    """A triangular error, symmetric about its mean."""

    shape: Literal["triangular"]
    half_width: Positive


class StudentTPart(_DistributionPart[Any_], Generic[Any_, Positive]):
    """What few repeated readings know of a mean."""

    shape: Literal["student-t"]
    scale: Positive
    degrees_of_freedom: PositiveNumber


class ArcsinePart(_DistributionPart[Any_], Generic[Any_, Positive]):
    """A sinusoidal influence of unknown phase."""

    shape: Literal["arcsine"]
    half_width: Positive


class CurvilinearTrapezoidPart(_DistributionPart[Any_], Generic[Any_, Positive]):
    """A uniform error whose half width is itself uncertain (JCGM 101, 6.4.3)."""

    shape: Literal["curvilinear-trapezoid"]
    half_width: Positive
    inexactness: Positive = Field(description="Half width of the uncertainty of the half width.")


class EmpiricalPart(Part):
    """Draws from a column of a CSV file, in SI units."""

    shape: Literal["empirical"]
    file: Text = Field(description="CSV beside the study; the first line names the columns.")
    column: Text
    drawn: Drawn | None = None


LengthDistribution = Annotated[
    NormalPart[Length, PositiveLength]
    | UniformPart[Length, PositiveLength]
    | TriangularPart[Length, PositiveLength]
    | StudentTPart[Length, PositiveLength]
    | ArcsinePart[Length, PositiveLength]
    | CurvilinearTrapezoidPart[Length, PositiveLength]
    | EmpiricalPart,
    Field(discriminator="shape"),
]
AngleDistribution = Annotated[
    NormalPart[Angle, PositiveAngle]
    | UniformPart[Angle, PositiveAngle]
    | TriangularPart[Angle, PositiveAngle]
    | StudentTPart[Angle, PositiveAngle]
    | ArcsinePart[Angle, PositiveAngle]
    | CurvilinearTrapezoidPart[Angle, PositiveAngle]
    | EmpiricalPart,
    Field(discriminator="shape"),
]
NumberDistribution = Annotated[
    NormalPart[Number, PositiveNumber]
    | UniformPart[Number, PositiveNumber]
    | TriangularPart[Number, PositiveNumber]
    | StudentTPart[Number, PositiveNumber]
    | ArcsinePart[Number, PositiveNumber]
    | CurvilinearTrapezoidPart[Number, PositiveNumber]
    | EmpiricalPart,
    Field(discriminator="shape"),
]
TemperatureChangeDistribution = Annotated[
    NormalPart[TemperatureDifference, PositiveTemperatureDifference]
    | UniformPart[TemperatureDifference, PositiveTemperatureDifference]
    | TriangularPart[TemperatureDifference, PositiveTemperatureDifference]
    | StudentTPart[TemperatureDifference, PositiveTemperatureDifference]
    | ArcsinePart[TemperatureDifference, PositiveTemperatureDifference]
    | CurvilinearTrapezoidPart[TemperatureDifference, PositiveTemperatureDifference]
    | EmpiricalPart,
    Field(discriminator="shape"),
]
PressureChangeDistribution = Annotated[
    NormalPart[PressureChange, PositivePressure]
    | UniformPart[PressureChange, PositivePressure]
    | TriangularPart[PressureChange, PositivePressure]
    | StudentTPart[PressureChange, PositivePressure]
    | ArcsinePart[PressureChange, PositivePressure]
    | CurvilinearTrapezoidPart[PressureChange, PositivePressure]
    | EmpiricalPart,
    Field(discriminator="shape"),
]
DistributionPart = (
    LengthDistribution
    | AngleDistribution
    | NumberDistribution
    | TemperatureChangeDistribution
    | PressureChangeDistribution
)


_OF_UNIT: Final = {"m": LengthDistribution, "rad": AngleDistribution, "1": NumberDistribution}
_DRAWN_BY_THE_CAMERA: Final = "pixel_noise"


class ErrorsPart(Part):
    """Errors beside those of the camera's own calibration, each by its name in the exact model of its camera."""

    def given(self) -> dict[str, DistributionPart]:
        """Those that are given, by name."""
        return {name: value for name in type(self).model_fields if (value := getattr(self, name)) is not None}


def _errors_of_kinds() -> type[ErrorsPart]:
    """Everything that can be in error about some kind of camera, each in its dimension."""
    fields: dict[str, Any] = {
        name: (_OF_UNIT[unit] | None, None)
        for name, unit in ERROR_UNITS.items()
        if not name.endswith(_DRAWN_BY_THE_CAMERA)
    }
    made: type[ErrorsPart] = create_model("ErrorsPart", __base__=ErrorsPart, __doc__=ErrorsPart.__doc__, **fields)
    return made


if TYPE_CHECKING:
    KnownErrorsPart = ErrorsPart
else:
    KnownErrorsPart = _errors_of_kinds()


class JointPart(Part):
    """Errors that are drawn together: a Gaussian copula of their own distributions."""

    parameters: Annotated[tuple[Text, ...], Field(min_length=2, max_length=40)]
    correlation: Annotated[tuple[tuple[float, ...], ...], Field(min_length=2, max_length=40)] = Field(
        description="Of the normal scores, one row per parameter."
    )

    @model_validator(mode="after")
    def _square(self) -> Self:
        size = len(self.parameters)
        if any(len(row) != size for row in self.correlation) or len(self.correlation) != size:
            raise MistakeAt(("correlation",), f"{size} rows of {size} numbers are expected, one per parameter")
        return self


class BodyPart(Part):
    """How a camera answers to temperature and pressure."""

    housing_expansion: ThermalExpansion = Field(description="Linear expansion of what holds the parts apart.")
    focal_length_expansion: ThermalExpansion = Field(description="Relative change of the focal length per kelvin.")
    glass_index: Annotated[float, Field(gt=1.1, lt=5.0)] = Field(
        description="Refractive index of the lens taken as one glass: it says what pressure does to the focal length."
    )


class TargetPart(Part):
    """A synthetic calibration: a board shown to the camera; the declared errors are the priors."""

    views: Annotated[int, Field(ge=3, le=1000, strict=True)]
    columns: Annotated[int, Field(ge=2, le=100, strict=True)]
    rows: Annotated[int, Field(ge=2, le=100, strict=True)]
    spacing: PositiveLength
    distances: Annotated[tuple[PositiveLength, ...], Field(min_length=2, max_length=2)]
    half_field: PositiveNumber = Field(description="Largest slope of the direction to the board's middle.")
    tilt: PositiveAngle = Field(description="Standard deviation of each component of the board's rotation.")
    corner_noise: PositivePixels = Field(description="Standard deviation of one image coordinate of a corner.")
    rotation_known_to: PositiveAngle | None = Field(default=None, description="Left out: poses are not known.")
    position_known_to: PositiveLength | None = Field(default=None, description="Left out: poses are not known.")
    maximum_steps: Annotated[int, Field(ge=100, le=1_000_000, strict=True)] = 20_000


class CornersPart(Part):
    """A real calibration: corners of a board that both cameras of the rig saw."""

    file: Text
    declared_baseline: PositiveLength | None = Field(default=None, description="By a ruler; checked to 20 %.")
    maximum_steps: Annotated[int, Field(ge=100, le=1_000_000, strict=True)] = 20_000


class CameraCalibrationPart(Part):
    """What is uncertain about one camera, beside its own calibration part."""

    errors: KnownErrorsPart = KnownErrorsPart()
    joint: dict[str, JointPart] = {}
    body: BodyPart | None = None
    file: Text | None = Field(
        default=None, description="CSV or NetCDF with a joint calibration, a covariance or draws, beside the study."
    )
    target: TargetPart | None = None
    corners: CornersPart | None = None

    @model_validator(mode="after")
    def _one_calibration(self) -> Self:
        given = [name for name in ("file", "target", "corners") if getattr(self, name) is not None]
        if len(given) > 1:
            raise MistakeAt((given[1],), f"a camera has one joint calibration; {given[0]} is given already")
        return self


class SurroundingsPart(Part):
    """Changes of temperature and ambient pressure since the calibration, shared by all cameras."""

    calibrated_at_temperature: Temperature
    calibrated_at_pressure: Pressure
    temperature_change: TemperatureChangeDistribution | None = None
    pressure_change: PressureChangeDistribution | None = None


class StabilityQuestionPart(Part):
    """Which spread of one error makes a camera as uncertain as another, or as its distance allows."""

    says: Text
    camera: CameraName
    parameter: Text
    at: PositiveLength
    way: Way = "both"
    equal: CameraName | None = Field(default=None, description="The camera to be as uncertain as.")
    relative: PositiveFraction | None = Field(default=None, description="The uncertainty wanted over the distance.")

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.equal is None) == (self.relative is None):
            raise MistakeAt((), "give exactly one of equal and relative")
        return self


class CalibrationStudyPart(Part):
    """Propagation of all errors through the exact camera models."""

    seed: Annotated[int, Field(ge=0, strict=True)]
    distances: DistanceRangePart | Annotated[tuple[PositiveLength, ...], Field(min_length=2, max_length=200)]
    edge: Share = Field(description="Where the edge of the field lies: 0 is the axis, 1 the corner of the sensor.")
    accuracy: PositiveFraction = Field(description="Allowed error of every quantile over its magnitude.")
    budget: Annotated[int, Field(ge=2**12, le=2**26, strict=True)] = Field(
        description="Most draws for each camera, place in the field and way."
    )
    surroundings: SurroundingsPart | None = None
    cameras: dict[str, CameraCalibrationPart] = {}
    compare: Annotated[
        tuple[Annotated[tuple[CameraName, ...], Field(min_length=2, max_length=2)], ...], Field(max_length=20)
    ] = ()
    questions: dict[str, StabilityQuestionPart] = {}

    def distance_values(self) -> tuple[float, ...]:
        """The distances [m]."""
        return self.distances.values() if isinstance(self.distances, DistanceRangePart) else self.distances


def calibration_mistakes(study: CalibrationStudyPart, cameras: Mapping[str, CameraDeclaration]) -> list[MistakeAt]:
    """Find names in the calibration part that the cameras of the study do not have."""
    mistakes: list[MistakeAt] = []
    for name, part in study.cameras.items():
        at = ("calibration", "cameras", name)
        if name not in cameras:
            mistakes.append(MistakeAt(at, f"no camera is called {name!r}{nearest_name(name, cameras)}"))
        elif not cameras[name].camera.error_units:
            known = ", ".join(kind_name(kind) for kind in KINDS if kind.camera.error_units)
            what = f"a {cameras[name].kind} camera has no error model; those that have: {known}"
            mistakes.append(MistakeAt(at, what))
        else:
            mistakes += _mistakes_of_camera(at, part, cameras[name])
    for path, name in _named(study):
        if name not in study.cameras:
            near = nearest_name(name, study.cameras)
            mistakes.append(MistakeAt(path, f"{name!r} is not among the cameras of calibration{near}"))
    return mistakes


def _mistakes_of_camera(
    at: tuple[str | int, ...], part: CameraCalibrationPart, declared: CameraDeclaration
) -> Iterator[MistakeAt]:
    given = part.errors.given()
    for error in given:
        if error not in declared.camera.error_units:
            near = nearest_name(error, declared.camera.error_units)
            yield MistakeAt((*at, "errors", error), f"a {declared.kind} camera has no such error{near}")
    for name, joint in part.joint.items():
        for position, parameter in enumerate(joint.parameters):
            if parameter not in given:
                what = f"{parameter!r} is not among the errors of this camera{nearest_name(parameter, given)}"
                yield MistakeAt((*at, "joint", name, "parameters", position), what)
    if part.corners is not None and not declared.camera.corners_calibrate:
        pairs = " or ".join(f"a {kind_name(kind)} rig" for kind in KINDS if kind.camera.corners_calibrate)
        yield MistakeAt((*at, "corners"), f"corners of two cameras calibrate {pairs}")


def _named(study: CalibrationStudyPart) -> Iterator[tuple[tuple[str | int, ...], str]]:
    for position, pair in enumerate(study.compare):
        for side, name in enumerate(pair):
            yield ("calibration", "compare", position, side), name
    for key, question in study.questions.items():
        yield ("calibration", "questions", key, "camera"), question.camera
        if question.equal is not None:
            yield ("calibration", "questions", key, "equal"), question.equal
