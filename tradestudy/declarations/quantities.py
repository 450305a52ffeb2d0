"""The values of a study file as pydantic types: text with a unit outside, SI inside; also names, ranges and texts."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any, Literal, TypeVar, cast

from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer, PlainValidator, WithJsonSchema

from tradestudy import units
from tradestudy.declarations.part import MistakeAt
from tradestudy.units import (
    ANGLE,
    DATA,
    DURATION,
    ELECTRONS,
    EXPANSION,
    FRACTION,
    INVERSE_LENGTH,
    LENGTH,
    MASS,
    NUMBER,
    PIXELS,
    POWER,
    PRESSURE,
    SOLID_ANGLE,
    TEMPERATURE_DIFFERENCE,
    Dimension,
    UnitError,
    parse,
    pretty,
)

# Products of a few quantities within these limits stay finite; anything beyond is a typing error.
_SMALLEST, _LARGEST = 1e-30, 1e30

Annotations = tuple[BeforeValidator, WithJsonSchema]
_Read = TypeVar("_Read")
_NUMBER = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"


@dataclass(frozen=True, kw_only=True)
class Known:
    """The plausible sizes [SI] of something, from microscopes to spacecraft, with a margin on both sides."""

    name: str
    smallest: float
    largest: float


def quantity(
    dimension: Dimension,
    *,
    above: float = -math.inf,
    at_least: float = -math.inf,
    at_most: float = math.inf,
    infinite: bool = False,
    known: Known | None = None,
) -> Annotations:
    """Make the annotations that turn ``float`` into a quantity of a study file.

    Parameters
    ----------
    dimension
        Dimension of the value.
    above, at_least, at_most
        Limits in SI [`dimension.unit`]; ``above`` excludes its own value.
    infinite
        Whether ``infinity`` is a valid value.
    known
        Plausible sizes; a finite value outside them is probably a wrong unit.

    Returns
    -------
    tuple
        For ``Annotated[float, *quantity(LENGTH)]``; a value that breaks a rule raises
        `UnitError`, which pydantic reports.
    """
    limits = _limits(dimension, above=above, at_least=at_least, at_most=at_most)

    def read(value: object) -> float:
        number = parse(value, dimension)
        if math.isinf(number) and not (infinite and number > 0.0):
            raise UnitError(f"infinity is not allowed here; {dimension.name} is expected, such as {dimension.example}")
        if math.isfinite(number) and number != 0.0 and not _SMALLEST <= abs(number) <= _LARGEST:
            raise UnitError(f"'{value}' is out of range; a number from 1e-30 to 1e30 in SI units is expected")
        if not (above < number and at_least <= number <= at_most):
            raise UnitError(f"'{value}' is out of range; {dimension.name} {limits} is expected")
        if known is not None and math.isfinite(number) and not known.smallest <= number <= known.largest:
            ends = f"{pretty(known.smallest, dimension)} to {pretty(known.largest, dimension)}"
            check = "check its unit; " if dimension.unit else ""
            raise UnitError(f"'{value}' is not a plausible {known.name}; {check}{ends} is expected")
        return number

    return BeforeValidator(_remembered(read)), WithJsonSchema(_json_schema(dimension, limits, infinite=infinite))


def _remembered(read: Callable[[object], _Read]) -> Callable[[object], _Read]:
    """The function, which remembers texts: solvers validate a camera again and again with all values but one."""
    cached = lru_cache(maxsize=64)(read)
    return lambda value: cached(value) if isinstance(value, str) else read(value)


def _limits(dimension: Dimension, *, above: float, at_least: float, at_most: float) -> str:
    """The limits in words: "above 0 m", "of 0 m or more", "from 10 nm to 10 mm"."""
    low, high = pretty(at_least, dimension), pretty(at_most, dimension)
    if math.isfinite(above):
        words = f"above {pretty(above, dimension, digits=5)}"
        return f"{words} and up to {high}" if math.isfinite(at_most) else words
    if math.isfinite(at_least) and math.isfinite(at_most):
        return f"from {low} to {high}"
    if math.isfinite(at_least):
        return f"of {low} or more"
    return f"of {high} or less" if math.isfinite(at_most) else "of either sign"


def _json_schema(dimension: Dimension, limits: str, *, infinite: bool) -> dict[str, Any]:
    """Describe the text form to editors; a bare number is valid only if the dimension has no unit."""
    pattern = f"^{_NUMBER}" + (r"\s*(1?/)?[A-Za-z%°µμÅ].*$" if dimension.unit else r"(\s*%)?$")
    schema: dict[str, Any] = {
        "type": ["string"] if dimension.unit else ["number", "string"],
        "title": f"{dimension.name} {limits}" + (" (or infinity)" if infinite else ""),
        "examples": [dimension.example],
        "pattern": f"{pattern}|^\\.?inf(inity)?$" if infinite else pattern,
    }
    return schema


Length = Annotated[float, *quantity(units.LENGTH)]
LengthOrInfinity = Annotated[float, *quantity(units.LENGTH, infinite=True)]
PositiveLength = Annotated[float, *quantity(units.LENGTH, above=0.0)]
NonNegativeLength = Annotated[float, *quantity(units.LENGTH, at_least=0.0)]
# A wavelength outside these limits has a wrong unit ("550 mm").
PositiveWavelength = Annotated[float, *quantity(units.WAVELENGTH, at_least=1e-8, at_most=1e-2)]

# Wide enough for every existing camera, and narrow enough to catch a wrong unit.
PixelPitch = Annotated[
    float,
    *quantity(units.LENGTH, above=0.0, known=Known(name="pixel pitch of a sensor", smallest=1e-8, largest=5e-3)),
]
_FOCAL_LENGTH = quantity(
    units.LENGTH, above=0.0, known=Known(name="focal length of a lens", smallest=1e-6, largest=1e4)
)
FocalLength = Annotated[float, *_FOCAL_LENGTH]


@dataclass(frozen=True, kw_only=True)
class InPixels:
    """A length on a sensor, counted in its pixel pitches [px]."""

    pixels: float


def _or_pixels(
    length: Annotations, pixels: Annotations, *examples: str
) -> tuple[PlainValidator, PlainSerializer, WithJsonSchema]:
    """A length or, counted in pixels, `InPixels`; a value that is neither is reported as a wrong length."""
    as_length, as_pixels = (cast(Callable[[object], float], annotations[0].func) for annotations in (length, pixels))

    def read(value: object) -> float | InPixels:
        try:
            parse(value, units.PIXELS)
        except UnitError:
            return as_length(value)
        return InPixels(pixels=as_pixels(value))

    schema = length[1].json_schema or {}
    return (
        PlainValidator(_remembered(read)),
        PlainSerializer(lambda value: f"{value.pixels!r} px" if isinstance(value, InPixels) else value),
        WithJsonSchema({**schema, "title": f"{schema['title']}, or a number of pixels", "examples": list(examples)}),
    )


_OF_LENS = Known(name="focal length", smallest=1.0, largest=1e7)
FocalLengthOrPixels = Annotated[
    float | InPixels,
    *_or_pixels(_FOCAL_LENGTH, quantity(units.PIXELS, above=0.0, known=_OF_LENS), "30.5 mm", "882.5 px"),
]
LengthOrPixels = Annotated[
    float | InPixels, *_or_pixels(quantity(units.LENGTH), quantity(units.PIXELS), "20 um", "0.5 px")
]
PositiveLengthOrPixels = Annotated[
    float | InPixels,
    *_or_pixels(quantity(units.LENGTH, above=0.0), quantity(units.PIXELS, above=0.0), "20 um", "0.5 px"),
]
_MICROLENS = quantity(units.LENGTH, above=0.0, known=Known(name="size of a microlens", smallest=1e-7, largest=10.0))
MicrolensPitch = Annotated[float, *_MICROLENS]
MicrolensPitchOrPixels = Annotated[
    float | InPixels,
    *_or_pixels(
        _MICROLENS,
        quantity(
            units.PIXELS, above=0.0, known=Known(name="size of a micro-image in pixels", smallest=1.0, largest=1e5)
        ),
        "125 um",
        "23.2 px",
    ),
]
LensToSensor = Annotated[
    float,
    *quantity(units.LENGTH, above=0.0, known=Known(name="distance inside a camera", smallest=1e-7, largest=1e4)),
]
Baseline = Annotated[
    float, *quantity(units.LENGTH, above=0.0, known=Known(name="baseline of two cameras", smallest=1e-6, largest=1e12))
]
_OBJECTS = Known(name="distance of an object", smallest=1e-6, largest=1e20)
ObjectDistance = Annotated[float, *quantity(units.LENGTH, above=0.0, known=_OBJECTS)]
ObjectDistanceOrInfinity = Annotated[float, *quantity(units.LENGTH, above=0.0, infinite=True, known=_OBJECTS)]
DETAIL = Known(name="detail of an object", smallest=1e-9, largest=1e9)
DetailSize = Annotated[float, *quantity(units.LENGTH, above=0.0, known=DETAIL)]
FNumber = Annotated[
    float, *quantity(units.NUMBER, above=0.0, known=Known(name="f-number of a lens", smallest=0.05, largest=1e5))
]

Angle = Annotated[float, *quantity(units.ANGLE)]
PositiveAngle = Annotated[float, *quantity(units.ANGLE, above=0.0)]
NonNegativeAngle = Annotated[float, *quantity(units.ANGLE, at_least=0.0)]
Pixels = Annotated[float, *quantity(units.PIXELS)]
PositivePixels = Annotated[float, *quantity(units.PIXELS, above=0.0)]
PositiveElectrons = Annotated[float, *quantity(units.ELECTRONS, above=0.0)]
NonNegativeElectrons = Annotated[float, *quantity(units.ELECTRONS, at_least=0.0)]
PositivePhotons = Annotated[float, *quantity(units.PHOTONS, above=0.0)]
SystemGain = Annotated[float, *quantity(units.SYSTEM_GAIN, above=0.0)]
Waves = Annotated[float, *quantity(units.WAVES)]

Fraction = Annotated[float, *quantity(units.FRACTION)]
PositiveFraction = Annotated[float, *quantity(units.FRACTION, above=0.0)]
# A fraction of a whole: an overlap, a probability, a confidence.
Share = Annotated[float, *quantity(units.FRACTION, at_least=0.0, at_most=1.0)]
PositiveShare = Annotated[float, *quantity(units.FRACTION, above=0.0, at_most=1.0)]
Number = Annotated[float, *quantity(units.NUMBER)]
PositiveNumber = Annotated[float, *quantity(units.NUMBER, above=0.0)]

PositiveDuration = Annotated[float, *quantity(units.DURATION, above=0.0)]
Temperature = Annotated[float, *quantity(units.TEMPERATURE, above=0.0)]
TemperatureDifference = Annotated[float, *quantity(units.TEMPERATURE_DIFFERENCE)]
Pressure = Annotated[float, *quantity(units.PRESSURE, at_least=0.0)]
PressureDifference = Annotated[float, *quantity(units.PRESSURE_DIFFERENCE)]
InverseLength = Annotated[float, *quantity(units.INVERSE_LENGTH)]
ThermalExpansion = Annotated[float, *quantity(units.EXPANSION)]

# A quantity whose dimension depends on the question; a plain number needs no quotes.
QuantityText = Annotated[
    str,
    BeforeValidator(
        lambda value: str(value) if type(value) in (int, float) else value, json_schema_input_type=str | float
    ),
]

# Whole numbers are strict: 3.0, "3" and true are mistakes where a count belongs.
Count = Annotated[int, Field(strict=True, ge=0)]
PositiveCount = Annotated[int, Field(strict=True, ge=1)]


# A number without a unit is a plain number; only a percent sign makes it a fraction.
_DIMENSIONS: tuple[Dimension, ...] = (
    LENGTH, ANGLE, PIXELS, FRACTION, NUMBER, ELECTRONS, TEMPERATURE_DIFFERENCE, PRESSURE, EXPANSION, DURATION,
    INVERSE_LENGTH, MASS, POWER, DATA, SOLID_ANGLE,
)  # fmt: skip


@lru_cache(maxsize=4096)  # every design of a sweep asks again for the same texts
def common_dimension(*texts: str) -> Dimension | None:
    """The first dimension in which all texts are valid, or None."""
    plain = not any("%" in text for text in texts)
    for dimension in (candidate for candidate in _DIMENSIONS if not (plain and candidate is FRACTION)):
        try:
            for text in texts:
                parse(text, dimension)
        except UnitError:
            continue
        return dimension
    return None


Item = TypeVar("Item", bound=Hashable)


def increasing(span: tuple[float, ...]) -> tuple[float, ...]:
    """Refuse a range that does not go from near to far."""
    if not span[0] < span[-1]:
        raise MistakeAt((), "a range must go from near to far")
    return span


def different(pair: tuple[str, ...]) -> tuple[str, ...]:
    """Refuse to compare a camera with itself."""
    if len(set(pair)) < len(pair):
        raise MistakeAt((), "two different cameras are expected")
    return pair


def distinct(values: tuple[Item, ...]) -> tuple[Item, ...]:
    """Refuse a list with duplicates."""
    if twice := [MistakeAt((i,), "is listed twice") for i, value in enumerate(values) if value in values[:i]]:
        raise MistakeAt.several(twice)
    return values


ErrorSources = Literal["noise", "calibration", "both"]
Span = Annotated[tuple[ObjectDistance, ...], Field(min_length=2, max_length=2), AfterValidator(increasing)]
Text = Annotated[str, Field(min_length=1, max_length=2000)]
CameraName = Annotated[str, Field(min_length=1, max_length=80)]
Pair = Annotated[tuple[CameraName, ...], Field(min_length=2, max_length=2), AfterValidator(different)]
Seed = Annotated[int, Field(ge=0, le=2**64 - 1, strict=True)]
Scalar = str | int | float | bool | None
