"""Quantities in a schema: limits in SI, words for people, a pattern for editors."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any

import pytest
from pydantic import TypeAdapter, ValidationError

from tradestudy import units
from tradestudy.study.schema import quantities
from tradestudy.study.schema.quantities import quantity


def message(kind: Any, value: object) -> str:
    with pytest.raises(ValidationError) as caught:
        TypeAdapter(kind).validate_python(value)
    return str(caught.value.errors()[0]["ctx"]["error"])


@pytest.mark.parametrize(
    ("name", "accepted", "refused"),
    [
        ("Length", "-3 mm", "infinity"),
        ("PositiveLength", "1e-30 m", "0 m"),
        ("NonNegativeLength", "0 m", "-1 nm"),
        ("PositiveLengthOrInfinity", "infinity", "-infinity"),
        ("PositiveWavelength", "10 nm", "550 mm"),
        ("Angle", "-0.2 deg", "0.2"),
        ("FieldOfView", "179 deg", "180 deg"),
        ("PositivePixels", "0.1 px", "0 px"),
        ("Share", "100 %", "101 %"),
        ("PositiveNumber", 8, 0),
        ("Temperature", "-273 degC", "-274 degC"),
        ("TemperatureDifference", "-400 degC", "3 mm"),
        ("Pressure", "0 Pa", "-1 Pa"),
        ("PositiveDuration", "1 ms", "0 s"),
        ("ThermalExpansion", "-1 ppm/K", "1 ppm"),
    ],
)
def test_limits(name: str, accepted: object, refused: object) -> None:
    adapter = TypeAdapter(getattr(quantities, name))
    assert isinstance(adapter.validate_python(accepted), float)
    with pytest.raises(ValidationError):
        adapter.validate_python(refused)


@pytest.mark.parametrize("slip", ["1e31 m", "-1e31 m", "1e-31 m"])
def test_what_no_study_can_hold_is_a_slip(slip: str) -> None:
    assert message(quantities.Length, slip) == (
        f"'{slip}' is out of range; nothing in a study is below 1e-30 or beyond 1e30 in SI units"
    )


@pytest.mark.parametrize("refused", [3.0, "3", True, -1, None])
def test_counts_are_whole_numbers(refused: object) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(quantities.Count).validate_python(refused)


def test_infinity_keeps_its_sign_and_its_place() -> None:
    assert TypeAdapter(quantities.PositiveLengthOrInfinity).validate_python("infinity") == math.inf


@pytest.mark.parametrize(
    ("limits", "value", "words"),
    [
        ({"above": 0.0}, "-3 mm", "'-3 mm' is out of range; a length above 0 m is expected"),
        ({"at_least": 0.0}, "-3 mm", "'-3 mm' is out of range; a length of 0 m or more is expected"),
        ({"at_most": 1.0}, "3 m", "'3 m' is out of range; a length of 1 m or less is expected"),
        ({"at_least": 0.1, "at_most": 1.0}, "3 m", "'3 m' is out of range; a length from 100 mm to 1 m is expected"),
        ({"above": 0.0, "at_most": 1.0}, "3 m", "'3 m' is out of range; a length above 0 m and up to 1 m is expected"),
        ({}, "inf", "infinity is not possible here; a length is expected, such as 30.5 mm"),
    ],
)
def test_words(limits: dict[str, float], value: str, words: str) -> None:
    assert message(Annotated[float, *quantity(units.LENGTH, **limits)], value) == words  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kind", "right", "wrong"),
    [
        (quantities.Length, ["3 mm", "-.5um", "1e-3 m", "0.2 m"], ["3", "mm", "3,5"]),
        (quantities.PositiveLengthOrInfinity, ["3 mm", "infinity"], ["3", "finity"]),
        (quantities.Share, ["80 %", "0.8"], ["80 mm"]),
    ],
)
def test_editors_get_a_pattern_that_agrees(kind: Any, right: list[str], wrong: list[str]) -> None:
    schema = TypeAdapter(kind).json_schema()
    for text in right:
        assert re.search(schema["pattern"], text)
        TypeAdapter(kind).validate_python(text)
    for text in wrong:
        assert not re.search(schema["pattern"], text)
