"""Units at the edge of the program: "5.5 um" to an SI float, and back to readable text.

Inside, every number is SI. Pixels, electrons and waves are separate dimensions here, so that a length can never be
mistaken for a number of pixels, nor an angle for a plain number.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal

from tradestudy.errors import TradestudyError
from tradestudy.unit_registry import DEGREE, ResolvedUnit, resolve_unit

_SPELLINGS = str.maketrans(
    {
        "µ": "u",
        "μ": "u",
        "−": "-",
        "·": "*",
        "⋅": "*",
        "×": "*",
        "Å": "angstrom",
        "%": "percent",
        "\u00a0": " ",
    }
    | {"²": "^2", "³": "^3", "⁻": "^-", "¹": "1", "\u2009": " ", "\u202f": " "}
)
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_QUANTITY = re.compile(r"(?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?P<unit>.*)", re.ASCII)
_INFINITY = re.compile(r"(?P<sign>[+-]?)\.?inf(?:inity)?", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class DisplayUnit:
    """A unit that reports use.

    Parameters
    ----------
    label
        Text after the number, including any space: " mm", "°".
    size
        The unit in SI.
    used_from
        The smallest SI magnitude that is shown in this unit.
    zero
        The SI value shown as 0 (for degrees Celsius).
    """

    label: str
    size: float
    used_from: float = 0.0
    zero: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Dimension:
    """A dimension: its name, its SI unit, how a study file writes it and how a report shows it.

    Parameters
    ----------
    name
        Name with its article, as in messages ("a length").
    unit
        SI unit, in the notation of study files ("" for a plain number).
    example
        A valid value in a study file.
    display
        Units in reports, from the smallest to the largest.
    absolute
        Whether values in an offset unit are absolute (a temperature) or differences.
    """

    name: str
    unit: str
    example: str
    display: tuple[DisplayUnit, ...]
    absolute: bool = False


def _shown_in(label: str) -> tuple[DisplayUnit, ...]:
    """The SI unit as the only display unit."""
    return (DisplayUnit(label=label, size=1.0),)


_METRIC = (
    DisplayUnit(label=" nm", size=1e-9),
    DisplayUnit(label=" µm", size=1e-6, used_from=1e-6),
    DisplayUnit(label=" mm", size=1e-3, used_from=1e-3),
    DisplayUnit(label=" m", size=1.0, used_from=1.0),
    DisplayUnit(label=" km", size=1e3, used_from=1e4),
)

LENGTH = Dimension(name="a length", unit="m", example="30.5 mm", display=_METRIC)
WAVELENGTH = Dimension(name="a wavelength", unit="m", example="550 nm", display=_METRIC)
ANGLE = Dimension(
    name="an angle",
    unit="rad",
    example="0.2 deg",
    display=(
        DisplayUnit(label="″", size=DEGREE / 3600),
        DisplayUnit(label="°", size=DEGREE, used_from=DEGREE / 1000),
    ),
)
PIXELS = Dimension(name="a number of pixels", unit="px", example="0.1 px", display=_shown_in(" px"))
ELECTRONS = Dimension(
    name="a number of electrons", unit="electron", example="12000 electrons", display=_shown_in(" e⁻")
)
PHOTONS = Dimension(name="a number of photons", unit="photon", example="12000 photons", display=_shown_in(" photons"))
SYSTEM_GAIN = Dimension(
    name="a system gain", unit="DN/electron", example="0.25 DN/electron", display=_shown_in(" DN/e⁻")
)
WAVES = Dimension(name="a number of waves", unit="wave", example="0.25 waves", display=_shown_in(" waves"))
FRACTION = Dimension(
    name="a fraction",
    unit="",
    example="2 %",
    display=(
        DisplayUnit(label=" ppm", size=1e-6),
        DisplayUnit(label=" %", size=1e-2, used_from=1e-4),
        DisplayUnit(label=" times", size=1.0, used_from=10.0),
    ),
)
NUMBER = Dimension(name="a plain number", unit="", example="3.8", display=_shown_in(""))
DURATION = Dimension(
    name="a time",
    unit="s",
    example="60 s",
    display=(
        DisplayUnit(label=" µs", size=1e-6),
        DisplayUnit(label=" ms", size=1e-3, used_from=1e-3),
        DisplayUnit(label=" s", size=1.0, used_from=1.0),
        DisplayUnit(label=" min", size=60.0, used_from=120.0),
        DisplayUnit(label=" h", size=3600.0, used_from=7200.0),
    ),
)
TEMPERATURE = Dimension(
    name="a temperature",
    unit="K",
    example="20 degC",
    display=(DisplayUnit(label=" °C", size=1.0, zero=273.15),),
    absolute=True,
)
TEMPERATURE_DIFFERENCE = Dimension(name="a temperature difference", unit="K", example="10 K", display=_shown_in(" K"))
PRESSURE = Dimension(
    name="a pressure",
    unit="Pa",
    example="101325 Pa",
    display=(
        DisplayUnit(label=" Pa", size=1.0),
        DisplayUnit(label=" kPa", size=1e3, used_from=1e3),
    ),
)
PRESSURE_DIFFERENCE = Dimension(name="a pressure difference", unit="Pa", example="1 kPa", display=PRESSURE.display)
EXPANSION = Dimension(
    name="a coefficient of thermal expansion",
    unit="1/K",
    example="23 ppm/K",
    display=(DisplayUnit(label=" ppm/K", size=1e-6),),
)
INVERSE_LENGTH = Dimension(
    name="an inverse length", unit="1/m", example="0.11 1/m", display=(DisplayUnit(label=" 1/m", size=1.0),)
)
MASS = Dimension(
    name="a mass",
    unit="kg",
    example="380 g",
    display=(
        DisplayUnit(label=" mg", size=1e-6),
        DisplayUnit(label=" g", size=1e-3, used_from=1e-3),
        DisplayUnit(label=" kg", size=1.0, used_from=1.0),
    ),
)
POWER = Dimension(
    name="a power",
    unit="W",
    example="2.5 W",
    display=(
        DisplayUnit(label=" mW", size=1e-3),
        DisplayUnit(label=" W", size=1.0, used_from=1.0),
    ),
)
DATA = Dimension(
    name="an amount of data",
    unit="bit",
    example="12 MB",
    display=(
        DisplayUnit(label=" bit", size=1.0),
        DisplayUnit(label=" kB", size=8e3, used_from=8e3),
        DisplayUnit(label=" MB", size=8e6, used_from=8e6),
        DisplayUnit(label=" GB", size=8e9, used_from=8e9),
    ),
)
SOLID_ANGLE = Dimension(
    name="a solid angle",
    unit="sr",
    example="400 usr",
    display=(DisplayUnit(label=" µsr", size=1e-6),),
)


class UnitError(TradestudyError, ValueError):
    """A value is not the expected quantity; the message gives a valid example."""

    exit_status = 2
    without_unit: Dimension | None = None
    """The expected dimension, if the value is a number that lacks only its unit."""


def parse(value: object, dimension: Dimension) -> float:
    """Read a value of a study file as an SI float.

    Parameters
    ----------
    value
        Text such as ``"5.5 um"``, or a number from YAML; a bare number is valid only for fractions and plain
        numbers. ``infinity`` is valid in any dimension.
    dimension
        Dimension that the value must have.

    Returns
    -------
    float
        In the SI unit of the dimension [`dimension.unit`].

    Raises
    ------
    UnitError
        For a missing or unknown unit, a wrong dimension, text that is not a quantity, NaN, or a number too large
        for a float.
    """
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise _mismatch(f"{_shown(value)} is not a quantity", dimension)
    text = str(value).strip() if isinstance(value, str) else _shown_number(value)
    if infinity := _INFINITY.fullmatch(text):
        return -math.inf if infinity["sign"] == "-" else math.inf
    match = _QUANTITY.fullmatch(text.translate(_SPELLINGS))
    if "," in text:
        raise _mismatch(f"{_shown(text)} has a comma; the decimal sign is a point", dimension)
    if match is None:
        raise _mismatch(f"{_shown(text)} is not a quantity", dimension)
    number, unit = match["number"], match["unit"].strip()
    if not unit and dimension.unit:
        mistake = _mismatch(f"'{text}' has no unit", dimension)
        mistake.without_unit = dimension
        raise mistake
    result = _in_si(number, unit, text, dimension) if unit else float(number)
    if not math.isfinite(result):
        raise _mismatch(f"'{text}' is too large for a floating-point number", dimension)
    return result


_SHOWN_ERROR = 5e-4  # of a value
_ROUNDING = 1e-6  # of the last digit shown; a value this close to a digit is that digit


def pretty(value: float, dimension: Dimension, digits: int = 3) -> str:
    """Write an SI value with a readable unit: a length of 0.0055 is ``5.5 mm``.

    Parameters
    ----------
    value
        Value in the SI unit of the dimension [`dimension.unit`].
    dimension
        Dimension of the value.
    digits
        Number of significant digits; trailing zeros are dropped.

    Returns
    -------
    str
        "∞" and "−∞" for infinities, "—" for NaN.
    """
    if not math.isfinite(value):
        return significant(value)
    # Rounded before the unit is chosen: 0.9996 m is 1 m, not 1000 mm. Kelvins would lose digits of degrees Celsius.
    rounded = float(f"{value:.{digits - 1}e}") if not dimension.absolute else value
    unit = display_unit(rounded, dimension)
    return significant((value - unit.zero) / unit.size, digits) + unit.label


def rounded_inwards(low: float, high: float, dimension: Dimension, error: float = 0.0) -> tuple[str, str]:
    """Write the ends of a range as `pretty` does, but so that the written values lie within it: 62.42 mm is 62.5 mm.

    They have three digits, or as many more as a narrow range needs. An end that is a written value to within its
    `error` is that value.
    """
    for digits in range(3, 9):
        first, last = (
            _on_grid(low, dimension, digits, math.ceil, error),
            _on_grid(high, dimension, digits, math.floor, error),
        )
        if first <= last:
            break
    return pretty(first, dimension, digits), pretty(last, dimension, digits)


def _on_grid(value: float, dimension: Dimension, digits: int, to: Callable[[float], int], error: float) -> float:
    """The SI value of a value rounded to significant digits of its display unit."""
    if not math.isfinite(value) or value == 0.0:
        return value
    unit = display_unit(value, dimension)
    return rounded((value - unit.zero) / unit.size, digits, to, error / unit.size) * unit.size + unit.zero


def rounded(number: float, digits: int, to: Callable[[float], int], error: float = 0.0) -> float:
    """A number with so many significant digits: itself if it has them to within its `error`, else rounded by `to`."""
    if not math.isfinite(number) or number == 0.0:
        return number
    step = 10.0 ** (math.floor(math.log10(abs(number))) - digits + 1)
    whole = round(number / step)
    return (whole if abs(number / step - whole) < max(_ROUNDING, error / step) else to(number / step)) * step


def shows_error(value: float, error: float, dimension: Dimension, negligible: float = _SHOWN_ERROR) -> bool:
    """Whether an error is known and more than this fraction of its value; by default, visible at three digits."""
    return math.isfinite(error) and error > negligible * abs(value - display_unit(value, dimension).zero)


def pretty_with_error(value: float, error: float, dimension: Dimension, negligible: float = _SHOWN_ERROR) -> str:
    """Write an SI value and its error in one unit, the error with one digit and the value as far as that digit.

    An error that is unknown, or negligible as in `shows_error`, is left out.
    """
    if not shows_error(value, error, dimension, negligible):
        return pretty(value, dimension)
    # Rounding can carry an error to its next digit: 0.096 is shown as 0.1.
    digit = math.floor(math.log10(float(f"{error:.0e}")))
    unit = display_unit(float(f"{max(abs(round(value, -digit)), error):.2e}"), dimension)
    return f"{' ± '.join(to_digit_of_error((value - unit.zero) / unit.size, error / unit.size))}{unit.label}"


def to_digit_of_error(value: float, error: float) -> tuple[str, str]:
    """Write a value and its positive error in one unit: the error with one digit, the value as far as that digit."""
    shown = float(f"{error:.0e}")
    decimals = -math.floor(math.log10(shown))
    # Adding 0 turns −0 into 0.
    number = f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}".replace("-", "−")
    return number, significant(shown, 1)


def with_deviation(value: float, deviation: float, digits: int = 2, sign: str = "-") -> str:
    """Write a number and its standard deviation as far as these digits of the deviation: "60.12 ± 0.13".

    With the sign "+", a positive number has one, too.
    """
    decimals = max(0, digits - 1 - math.floor(math.log10(deviation))) if deviation > 0.0 else 3
    return f"{value:{sign}.{decimals}f} ± {deviation:.{decimals}f}".replace("-", "−")


def display_unit(value: float, dimension: Dimension) -> DisplayUnit:
    """Choose the unit for an SI magnitude in a report; for an axis, pass a typical value."""
    units = dimension.display
    if value == 0.0:
        return max((unit for unit in units if unit.used_from <= unit.size <= 1.0), key=lambda unit: unit.size)
    return next((unit for unit in reversed(units) if abs(value) >= unit.used_from), units[0])


def significant(number: float, digits: int = 3) -> str:
    """Write a number with significant digits, no trailing zeros: ``1230``, ``0.00012``, ``4.5×10⁻⁹``, ``∞``, ``—``."""
    if math.isnan(number):
        return "—"
    if math.isinf(number):
        return "∞" if number > 0.0 else "−∞"
    mantissa, _, exponent = f"{number:.{digits - 1}e}".partition("e")
    if number == 0.0:
        return "0"
    power = int(exponent)
    if -5 <= power < 7:
        plain = f"{float(f'{mantissa}e{power}'):.{max(digits - 1 - power, 0)}f}"
        text = plain.rstrip("0").rstrip(".") if "." in plain else plain
    else:
        text = f"{mantissa.rstrip('0').rstrip('.')}×10{str(power).translate(_SUPERSCRIPTS)}"
    return text.replace("-", "−")


def _in_si(number: str, unit: str, text: str, dimension: Dimension) -> float:
    """Convert a number with its unit to SI, or raise an error that says why not."""
    resolved = resolve_unit(unit, absolute=dimension.absolute)
    if isinstance(resolved, str):
        raise _mismatch(f"'{text}' {resolved}", dimension)
    if resolved.dimensions != _dimensions(dimension):
        raise _mismatch(f"'{text}' is {_name_of(resolved.dimensions)}", dimension)
    written = float(number)
    if written == 0.0 or not math.isfinite(written):
        return written + resolved.offset
    # Decimal arithmetic makes "5.5 um" the float 5.5e-6 and not its neighbour.
    return float(Decimal(number) * Decimal(repr(resolved.scale)) + Decimal(repr(resolved.offset)))


def _dimensions(dimension: Dimension) -> frozenset[tuple[str, object]]:
    """Powers of the base dimensions."""
    if not dimension.unit:
        return frozenset()
    resolved = resolve_unit(dimension.unit, absolute=False)
    assert isinstance(resolved, ResolvedUnit), dimension.unit
    return resolved.dimensions


def _name_of(dimensions: frozenset[tuple[str, object]]) -> str:
    """Name of a combination of base dimensions."""
    return next(
        (dimension.name for dimension in _KNOWN if _dimensions(dimension) == dimensions), "a quantity of another kind"
    )


_KNOWN = (
    LENGTH, ANGLE, PIXELS, ELECTRONS, PHOTONS, SYSTEM_GAIN, WAVES, FRACTION, DURATION, TEMPERATURE, PRESSURE, EXPANSION,
    INVERSE_LENGTH, MASS, POWER, DATA, SOLID_ANGLE,
)  # fmt: skip


def _mismatch(problem: str, dimension: Dimension) -> UnitError:
    return UnitError(f"{problem}; {dimension.name} is expected, such as {dimension.example}")


def _shown(value: object) -> str:
    """Quote a value in an error message, shortened, on one line."""
    if value is None:
        return "an empty value"
    if isinstance(value, bool):
        return f"'{str(value).lower()}'"
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, list | tuple):
        return "a list"
    text = str(value)
    return f"'{text}'" if len(text) <= 40 else f"'{text[:37]}…'"


def _shown_number(value: float) -> str:
    """Write a number as a person would: 1000, not 1000.0."""
    try:
        return text if float(text := f"{value:.15g}") == value else repr(value)
    except OverflowError:
        return "1e999"
