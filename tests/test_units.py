"""Units, checked against pint's own full registry, which shares no definition with ours."""

from __future__ import annotations

import math
import subprocess
import sys

import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tradestudy import unit_registry, units
from tradestudy.errors import nearest
from tradestudy.units import (
    Dimension,
    UnitError,
    parse,
    pretty,
    pretty_with_error,
    rounded_inwards,
    significant,
    with_deviation,
)

PINT = pint.UnitRegistry(cache_folder=None)


@pytest.mark.parametrize("number", [2.4842105263157896, 0.1 + 0.2, 1 / 3, 5e-324, 12345678901234568, -1.0])
def test_a_number_of_python_keeps_its_last_digit(number: float) -> None:
    assert parse(number, units.NUMBER) == number


def test_an_astronomical_unit_is_that_of_2012() -> None:
    """Resolution B2 of the International Astronomical Union; pint knows no capitals."""
    assert parse("1 AU", units.LENGTH) == parse("1 au", units.LENGTH) == 149_597_870_700.0


@pytest.mark.parametrize("unit", unit_registry._USUAL)
@pytest.mark.parametrize("absolute", [True, False])
def test_usual_units_agree_with_pint(unit: str, absolute: bool) -> None:
    assert unit_registry.resolve_unit(unit, absolute=absolute) == unit_registry._resolve_by_pint(
        unit, absolute=absolute
    )


def test_degrees_celsius_agree_with_pint() -> None:
    assert unit_registry.resolve_unit("degC", absolute=True) == unit_registry._resolve_by_pint("degC", absolute=True)
    assert unit_registry.resolve_unit("degC", absolute=False) == unit_registry._resolve_by_pint("degC", absolute=False)


@pytest.mark.parametrize(
    ("text", "dimension", "si_unit"),
    [
        ("5.5 um", units.LENGTH, "metre"),
        ("126.5um", units.LENGTH, "metre"),
        ("0.568 mm", units.LENGTH, "metre"),
        ("3 cm", units.LENGTH, "metre"),
        ("2.5e-3 km", units.LENGTH, "metre"),
        ("1 inch", units.LENGTH, "metre"),
        ("3 in", units.LENGTH, "metre"),
        ("2 yd", units.LENGTH, "metre"),
        ("5000 angstrom", units.LENGTH, "metre"),
        ("3 ft", units.LENGTH, "metre"),
        ("2 feet", units.LENGTH, "metre"),
        ("1.5 au", units.LENGTH, "metre"),
        ("+.5 metres", units.LENGTH, "metre"),
        ("12 mm**2/mm", units.LENGTH, "metre"),
        ("12 mm^2 / mm", units.LENGTH, "metre"),
        ("550 nm", units.WAVELENGTH, "metre"),
        ("65.24 deg", units.ANGLE, "radian"),
        ("12 arcmin", units.ANGLE, "radian"),
        ("3 arcsec", units.ANGLE, "radian"),
        ("0.2 mrad", units.ANGLE, "radian"),
        ("20 degC", units.TEMPERATURE, "kelvin"),
        ("-40 celsius", units.TEMPERATURE, "kelvin"),
        ("77 K", units.TEMPERATURE, "kelvin"),
        ("300 mK", units.TEMPERATURE, "kelvin"),
        ("1013.25 hPa", units.PRESSURE, "pascal"),
        ("0.9 atm", units.PRESSURE, "pascal"),
        ("6 mbar", units.PRESSURE, "pascal"),
        ("2 min", units.DURATION, "second"),
        ("1.5 h", units.DURATION, "second"),
        ("15 ms", units.DURATION, "second"),
        ("23 ppm/K", units.EXPANSION, "1/kelvin"),
        ("23e-6 1/K", units.EXPANSION, "1/kelvin"),
        ("380 g", units.MASS, "kilogram"),
        ("1.2 kg", units.MASS, "kilogram"),
        ("90 mg", units.MASS, "kilogram"),
        ("2500 mW", units.POWER, "watt"),
        ("1.1 kW", units.POWER, "watt"),
        ("12 MB", units.DATA, "bit"),
        ("0.4 msr", units.SOLID_ANGLE, "steradian"),
    ],
)
def test_agrees_with_the_full_registry(text: str, dimension: Dimension, si_unit: str) -> None:
    number, unit = text.replace("um", " um").split(maxsplit=1)
    expected = PINT.Quantity(float(number), unit).to(si_unit).magnitude
    assert parse(text, dimension) == pytest.approx(expected, rel=4e-16, abs=0.0)


@pytest.mark.parametrize(
    ("text", "dimension", "expected"),
    [
        ("5.5 µm", units.LENGTH, 5.5e-6),
        ("5.5 μm", units.LENGTH, 5.5e-6),
        ("−5 mm", units.LENGTH, -5e-3),
        ("3 Å", units.LENGTH, 3e-10),
        ("0.2°", units.ANGLE, math.radians(0.2)),
        ("2 %", units.FRACTION, 0.02),
        ("0.02", units.FRACTION, 0.02),
        (0.02, units.FRACTION, 0.02),
        (8, units.NUMBER, 8.0),
        ("0.1 px", units.PIXELS, 0.1),
        ("2 pixels", units.PIXELS, 2.0),
        ("12 ke-", units.ELECTRONS, 12000.0),
        ("3.5 e⁻", units.ELECTRONS, 3.5),
        ("0.25 waves", units.WAVES, 0.25),
        ("10 degC", units.TEMPERATURE_DIFFERENCE, 10.0),
        ("23 ppm/degC", units.EXPANSION, 23e-6),
        ("0 degC", units.TEMPERATURE, 273.15),
        ("infinity", units.LENGTH, math.inf),
        ("-.inf", units.LENGTH, -math.inf),
        (math.inf, units.LENGTH, math.inf),
    ],
)
def test_reads_what_people_write(text: object, dimension: Dimension, expected: float) -> None:
    assert parse(text, dimension) == expected


@given(
    st.decimals(-9999, 9999, places=4, allow_nan=False), st.sampled_from([("nm", -9), ("um", -6), ("mm", -3), ("m", 0)])
)
def test_is_the_float_nearest_to_the_decimals_written(number: object, unit: tuple[str, int]) -> None:
    assert parse(f"{number} {unit[0]}", units.LENGTH) == float(f"{number}e{unit[1]}")


@pytest.mark.parametrize(
    ("text", "dimension", "message"),
    [
        ("30.5", units.LENGTH, "'30.5' has no unit; a length is expected, such as 30.5 mm"),
        (30.5, units.LENGTH, "'30.5' has no unit; a length is expected, such as 30.5 mm"),
        (1000.0, units.ANGLE, "'1000' has no unit; an angle is expected, such as 0.2 deg"),
        ("3 deg", units.LENGTH, "'3 deg' is an angle; a length is expected, such as 30.5 mm"),
        ("3 px", units.LENGTH, "'3 px' is a number of pixels; a length is expected, such as 30.5 mm"),
        ("3 %", units.LENGTH, "'3 %' is a fraction; a length is expected, such as 30.5 mm"),
        ("3 mm", units.FRACTION, "'3 mm' is a length; a fraction is expected, such as 2 %"),
        ("5 m/s", units.LENGTH, "'5 m/s' is a quantity of another kind; a length is expected, such as 30.5 mm"),
        (
            "5 umm",
            units.LENGTH,
            "'5 umm' has the unknown unit 'umm' (nearest: 'um'); a length is expected, such as 30.5 mm",
        ),
        (
            "5 furlongs",
            units.LENGTH,
            "'5 furlongs' has the unknown unit 'furlongs'; a length is expected, such as 30.5 mm",
        ),
        (
            "5,5 um",
            units.LENGTH,
            "'5,5 um' has a comma; the decimal sign is a point; a length is expected, such as 30.5 mm",
        ),
        ("wide", units.LENGTH, "'wide' is not a quantity; a length is expected, such as 30.5 mm"),
        ("", units.LENGTH, "'' is not a quantity; a length is expected, such as 30.5 mm"),
        (None, units.LENGTH, "an empty value is not a quantity; a length is expected, such as 30.5 mm"),
        (True, units.NUMBER, "'true' is not a quantity; a plain number is expected, such as 3.8"),
        ([], units.NUMBER, "a list is not a quantity; a plain number is expected, such as 3.8"),
        ({}, units.NUMBER, "a mapping is not a quantity; a plain number is expected, such as 3.8"),
        (math.nan, units.NUMBER, "'nan' is not a quantity; a plain number is expected, such as 3.8"),
        ("5 m/", units.LENGTH, "'5 m/' does not end in a unit; a length is expected, such as 30.5 mm"),
    ],
)
def test_refuses_with_a_remedy(text: object, dimension: Dimension, message: str) -> None:
    with pytest.raises(UnitError) as caught:
        parse(text, dimension)
    assert str(caught.value) == message


@pytest.mark.parametrize("text", ["1e400 m", "1e308 km"])
def test_a_number_beyond_floats_is_refused(text: str) -> None:
    with pytest.raises(UnitError, match=rf"^'{text}' is too large .*; a length is expected, such as 30\.5 mm$"):
        parse(text, units.LENGTH)


@pytest.mark.parametrize(
    "text", ["9**9**9**9 m", "5 m**99999999", "5 __class__", "5 " + "m*" * 5000 + "m", "9" * 5000 + " m"]
)
def test_hostile_text_is_refused_at_once(text: str) -> None:
    with pytest.raises(UnitError):
        parse(text, units.LENGTH)


@given(st.text(max_size=30), st.sampled_from([units.LENGTH, units.NUMBER, units.TEMPERATURE, units.EXPANSION]))
def test_any_text_is_a_number_or_a_unit_error(text: str, dimension: Dimension) -> None:
    try:
        read = parse(text, dimension)
    except UnitError as error:
        read, said = math.inf, str(error)
    else:
        said = dimension.example
    assert not math.isnan(read)
    assert dimension.example in said


@pytest.mark.parametrize(
    ("value", "dimension", "shown"),
    [
        (0.0055, units.LENGTH, "5.5 mm"),
        (5.5e-6, units.LENGTH, "5.5 µm"),
        (550e-9, units.LENGTH, "550 nm"),
        (0.99999, units.LENGTH, "1 m"),
        (-0.5, units.LENGTH, "−500 mm"),
        (9999.0, units.LENGTH, "10 km"),
        (0.0, units.LENGTH, "0 m"),
        (math.inf, units.LENGTH, "∞"),
        (-math.inf, units.LENGTH, "−∞"),
        (math.nan, units.LENGTH, "—"),
        (math.radians(65.24), units.ANGLE, "65.2°"),
        (math.radians(0.05), units.ANGLE, "0.05°"),
        (math.radians(0.0001), units.ANGLE, "0.36″"),
        (0.025, units.FRACTION, "2.5 %"),
        (4.48, units.FRACTION, "448 %"),
        (0.0, units.FRACTION, "0 %"),
        (44.8, units.FRACTION, "44.8 times"),  # not 4480 %, which nobody reads as a share
        (23e-6, units.FRACTION, "23 ppm"),
        (293.15, units.TEMPERATURE, "20 °C"),
        (23.1e-6, units.EXPANSION, "23.1 ppm/K"),
        (90.0, units.DURATION, "90 s"),
        (150.0, units.DURATION, "2.5 min"),
        (12345.6, units.PIXELS, "12300 px"),
        (3.0, units.ELECTRONS, "3 e⁻"),
    ],
)
def test_shows_the_expected_unit(value: float, dimension: Dimension, shown: str) -> None:
    assert pretty(value, dimension) == shown


@pytest.mark.parametrize(
    ("number", "digits", "text"),
    [
        (1234.5, 3, "1230"),
        (0.00012345, 3, "0.000123"),
        (9.996, 3, "10"),
        (100.0, 3, "100"),
        (4.5e-9, 3, "4.5×10⁻⁹"),
        (-1.25e12, 2, "−1.2×10¹²"),
        (0.1 + 0.2, 15, "0.3"),
        (5e-324, 3, "4.94×10⁻³²⁴"),
        (0.0, 3, "0"),
    ],
)
def test_keeps_significant_digits(number: float, digits: int, text: str) -> None:
    assert significant(number, digits) == text


@given(st.floats(1e-12, 1e9), st.integers(2, 12))
def test_shown_values_read_back_to_the_digits_kept(value: float, digits: int) -> None:
    shown = pretty(value, units.LENGTH, digits)
    if "×" not in shown:
        assert parse(shown, units.LENGTH) == pytest.approx(value, rel=0.51 * 10 ** (1 - digits), abs=0.0)


def test_finds_the_nearest_name() -> None:
    assert nearest("Basline", ["baseline", "lenses"]) == "baseline"
    assert nearest("zoom", ["baseline", "lenses"]) is None


def test_pint_is_not_imported_unless_a_study_is_read() -> None:
    script = "import sys, tradestudy.units; assert 'pint' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


def test_an_infinite_number_is_written_as_infinite() -> None:
    assert units.significant(float("inf")) == "∞"
    assert units.significant(float("-inf"), 2) == "−∞"
    assert units.significant(float("nan")) == "—"


@given(st.floats(1e-6, 1e3), st.floats(1e-7, 0.5))
def test_the_written_ends_of_a_range_lie_within_it(low: float, share: float) -> None:
    """However narrow it is, down to a ten-millionth of its ends."""
    high = low * (1.0 + share)
    first, last = (parse(words, units.LENGTH) for words in rounded_inwards(low, high, units.LENGTH))
    assert low * (1.0 - 1e-8) <= first <= last <= high * (1.0 + 1e-8)
    assert first - low <= 1.0101e-2 * low
    assert high - last <= 1.0101e-2 * high


def test_ends_have_three_digits_or_as_many_as_a_narrow_range_needs() -> None:
    def written(*ends: float, error: float = 0.0) -> tuple[str, str]:
        return rounded_inwards(*ends, units.LENGTH, error)

    assert written(62.42e-3, 80.08e-3) == ("62.5 mm", "80 mm")
    assert written(62.4e-3, 62.4e-3) == ("62.4 mm", "62.4 mm")
    assert written(191.5e-3, 191.994e-3) == ("191.5 mm", "191.9 mm")
    assert written(999.7e-6, 2e-3) == ("1 mm", "2 mm")
    assert written(0.1, 191.995e-3, error=9e-6) == ("100 mm", "192 mm")
    assert written(0.1, math.inf) == ("100 mm", "∞")


def test_an_error_is_shown_beside_the_digits_of_the_unit_not_of_kelvins() -> None:
    assert pretty_with_error(293.2, 0.1, units.TEMPERATURE) == "20.1 ± 0.1 °C"


def test_a_deviation_sets_the_digits_of_its_value() -> None:
    assert with_deviation(-60.1234, 0.13) == "−60.12 ± 0.13"
    assert with_deviation(60.1234, 0.13, digits=1) == "60.1 ± 0.1"
    assert with_deviation(61234.0, 130.0, sign="+") == "+61234 ± 130"
    assert with_deviation(1.0, 0.0) == "1.000 ± 0.000"
