"""Distributions of errors, one part for each dimension; normal and uniform distributions need no shape."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Final, Generic, Literal, TypeVar

from pydantic import Field

from tradestudy import units
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    Angle,
    InPixels,
    Length,
    LengthOrPixels,
    Number,
    PositiveAngle,
    PositiveLength,
    PositiveLengthOrPixels,
    PositiveNumber,
    PressureDifference,
    TemperatureDifference,
    Text,
    quantity,
)

PositiveTemperatureDifference = Annotated[float, *quantity(units.TEMPERATURE_DIFFERENCE, above=0.0)]
# Fewer than those of two measurements would give such long tails that no number of draws converges.
DegreesOfFreedom = Annotated[float, *quantity(units.NUMBER, at_least=1.0)]
PositivePressureDifference = Annotated[float, *quantity(units.PRESSURE_DIFFERENCE, above=0.0)]

Shape = Literal["normal", "uniform", "triangular", "student-t", "arcsine", "curvilinear-trapezoid", "empirical"]
_NEEDS: Final[dict[Shape, tuple[str, ...]]] = {
    "normal": ("standard_deviation",),
    "uniform": ("half_width",),
    "triangular": ("half_width",),
    "student-t": ("scale", "degrees_of_freedom"),
    "arcsine": ("half_width",),
    "curvilinear-trapezoid": ("half_width", "inexactness"),
    "empirical": ("file", "column"),
}

_WIDTHS: Final = ("standard_deviation", "half_width", "inexactness", "scale")

Signed = TypeVar("Signed", bound=float | InPixels)
Positive = TypeVar("Positive", bound=float | InPixels)


_DEVIATIONS: Final = 6.0


def _size(value: float | InPixels) -> float:
    return value.pixels if isinstance(value, InPixels) else value


class DistributionPart(Part, Generic[Signed, Positive]):
    """The distribution of one error; ``standard_deviation`` alone makes it normal, ``half_width`` alone uniform."""

    dimension: ClassVar[units.Dimension]
    spreads: ClassVar[tuple[str, ...]] = tuple(dict.fromkeys(key for keys in _NEEDS.values() for key in keys))

    shape: Shape | None = Field(
        default=None,
        description="Shape of the distribution. Without it, the distribution is normal (with standard_deviation) or "
        "uniform (with half_width).",
    )
    mean: Signed | None = Field(
        default=None,
        description="Mean of the distribution, or median of a Student-t distribution that has no mean; default: 0. "
        "Omit it for an empirical distribution, whose mean is that of the draws.",
    )
    standard_deviation: Positive | None = Field(
        default=None, description="Standard deviation of a normal distribution."
    )
    half_width: Positive | None = Field(
        default=None, description="Half-width of a uniform, triangular, arcsine or curvilinear-trapezoid distribution."
    )
    inexactness: Positive | None = Field(
        default=None,
        description="Largest amount by which the half-width of a curvilinear-trapezoid distribution may differ from "
        "half_width.",
    )
    scale: Positive | None = Field(
        default=None,
        description="Scale of a Student-t distribution: s/√n for the mean of n measurements with standard deviation s.",
    )
    degrees_of_freedom: DegreesOfFreedom | None = Field(
        default=None,
        description="Degrees of freedom of a Student-t distribution: n − 1 for the mean of n measurements.",
    )
    file: Text | None = Field(
        default=None,
        description="CSV file with the draws of an empirical distribution, in SI units; its first line names the "
        "columns. The path is relative to the file that contains this key.",
    )
    column: Text | None = Field(default=None, description="Name of the column of `file` that contains the draws.")

    def _mistakes(self) -> Iterator[MistakeAt]:
        given_keys = [key for key in self.spreads if getattr(self, key) is not None]
        values = [getattr(self, key) for key in ("mean", *_WIDTHS)]
        if len({isinstance(value, InPixels) for value in values if value is not None}) > 1:
            yield MistakeAt((), "mixes pixels with lengths; write all values in one of the two")
        if self.shape is None:
            self._require_one_spread(given_keys)
            return
        needed = _NEEDS[self.shape]
        mistakes = [MistakeAt((), f"shape {self.shape} needs {key}") for key in needed if key not in given_keys]
        mistakes += [
            MistakeAt((key,), f"does not belong to shape {self.shape}, which takes {' and '.join(needed)}")
            for key in given_keys
            if key not in needed
        ]
        if self.shape == "empirical" and self.mean is not None:
            mistakes.append(MistakeAt(("mean",), "does not belong to shape empirical, whose draws have their own mean"))
        width, inexactness = self.half_width, self.inexactness
        if not mistakes and width is not None and inexactness is not None and _size(inexactness) > _size(width):
            mistakes.append(MistakeAt(("inexactness",), "exceeds half_width; at most half_width is expected"))
        if mistakes:
            yield MistakeAt.several(mistakes)

    def _require_one_spread(self, given_keys: list[str]) -> None:
        for key in given_keys:
            if key not in ("standard_deviation", "half_width"):
                shapes = " or ".join(shape for shape, keys in _NEEDS.items() if key in keys)
                raise MistakeAt((key,), f"needs shape: {shapes}")
        if len(given_keys) != 1:
            hint = ", not both" if given_keys else ""
            raise MistakeAt((), f"give standard_deviation (a normal error) or half_width (a uniform one){hint}")

    @property
    def resolved_shape(self) -> Shape:
        """The shape as given, or as implied by the given spread."""
        if self.shape is not None:
            return self.shape
        return "uniform" if self.standard_deviation is None else "normal"


def lowest(part: DistributionPart[Any, Any]) -> float:
    """The lowest relevant value: the end of a bounded distribution, or six standard deviations below a normal mean."""
    spread = part.half_width if part.half_width is not None else _DEVIATIONS * (part.standard_deviation or 0.0)
    return float((part.mean or 0.0) - spread - (part.inexactness or 0.0))


class LengthDistribution(DistributionPart[Length, PositiveLength]):
    """The distribution of the error of a length."""

    dimension: ClassVar = units.LENGTH


class LengthOrPixelsDistribution(DistributionPart[LengthOrPixels, PositiveLengthOrPixels]):
    """The distribution of the error of a length inside a camera, in units of length or in pixels of the sensor."""

    dimension: ClassVar = units.LENGTH

    def in_lengths(self, pixel_pitch: float) -> LengthDistribution:
        """The same distribution for a pixel pitch [m], with no value in pixels."""
        values = {name: getattr(self, name) for name in self.model_fields_set}
        lengths = {name: value.pixels * pixel_pitch for name, value in values.items() if isinstance(value, InPixels)}
        return LengthDistribution.model_construct(**(values | lengths))


class AngleDistribution(DistributionPart[Angle, PositiveAngle]):
    """The distribution of the error of an angle."""

    dimension: ClassVar = units.ANGLE


class NumberDistribution(DistributionPart[Number, PositiveNumber]):
    """The distribution of the error of a plain number."""

    dimension: ClassVar = units.NUMBER


class TemperatureDistribution(DistributionPart[TemperatureDifference, PositiveTemperatureDifference]):
    """The distribution of a change in temperature."""

    dimension: ClassVar = units.TEMPERATURE_DIFFERENCE


class PressureDistribution(DistributionPart[PressureDifference, PositivePressureDifference]):
    """The distribution of a change in pressure."""

    dimension: ClassVar = units.PRESSURE_DIFFERENCE


AnyDistribution = (
    LengthDistribution
    | LengthOrPixelsDistribution
    | AngleDistribution
    | NumberDistribution
    | TemperatureDistribution
    | PressureDistribution
)
