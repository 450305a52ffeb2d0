"""Quantities in a schema: limits in SI, words for people, a pattern for editors."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any

import pytest
from pydantic import Field, TypeAdapter, ValidationError

from tradestudy import units
from tradestudy.declarations import quantities
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import quantity


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
        ("ObjectDistanceOrInfinity", "infinity", "-infinity"),
        ("PositiveWavelength", "10 nm", "550 mm"),
        ("Angle", "-0.2 deg", "0.2"),
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
def test_numbers_beyond_any_study_are_refused(slip: str) -> None:
    assert message(quantities.Length, slip) == (
        f"'{slip}' is out of range; a number from 1e-30 to 1e30 in SI units is expected"
    )


@pytest.mark.parametrize(
    ("name", "smallest", "largest", "slip", "words"),
    [
        ("PixelPitch", "10 nm", "5 mm", "10 mm", "pixel pitch of a sensor; check its unit; 10 nm to 5 mm"),
        ("FocalLength", "1 um", "10 km", "1e6 m", "focal length of a lens; check its unit; 1 µm to 10 km"),
        ("MicrolensPitch", "100 nm", "10 m", "1 nm", "size of a microlens; check its unit; 100 nm to 10 m"),
        ("LensToSensor", "100 nm", "10 km", "10 nm", "distance inside a camera; check its unit; 100 nm to 10 km"),
        ("Baseline", "1 um", "1e9 km", "1e-9 m", "baseline of two cameras; check its unit; 1 µm to 1×10⁹ km"),
        ("ObjectDistance", "1 um", "1e17 km", "1 nm", "distance of an object; check its unit; 1 µm to 1×10¹⁷ km"),
        ("DetailSize", "1 nm", "1e6 km", "1 angstrom", "detail of an object; check its unit; 1 nm to 1000000 km"),
        ("FNumber", 0.05, 1e5, 1e6, "f-number of a lens; 0.05 to 100000"),
    ],
)
def test_impossible_sizes_are_refused_as_wrong_units(
    name: str, smallest: object, largest: object, slip: object, words: str
) -> None:
    adapter = TypeAdapter(getattr(quantities, name))
    assert adapter.validate_python(smallest) < adapter.validate_python(largest)
    said = message(getattr(quantities, name), slip)
    assert said.startswith(f"'{slip}' ")
    assert said.endswith(f" {words} is expected")
    zero = "0" if name == "FNumber" else "0 m"
    assert "above 0" in message(getattr(quantities, name), zero)  # what is no size at all keeps its own words


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("PixelPitch", "0.5 um"),  # of the densest sensors
        ("PixelPitch", "2 mm"),  # of a detector array
        ("FocalLength", "5 um"),  # of a microlens on a pixel
        ("FocalLength", "420 m"),  # of a radio telescope's prime focus, and more
        ("Baseline", "300e6 km"),  # of a parallax from both sides of the orbit of the Earth
        ("ObjectDistanceOrInfinity", "infinity"),
        ("ObjectDistance", "4.5e9 km"),  # Neptune from the Earth
        ("DetailSize", "0.1 um"),
        ("FNumber", 0.33),  # of an immersion objective
        ("FNumber", 500),  # of a pinhole
    ],
)
def test_real_values_are_not_refused(name: str, value: object) -> None:
    assert TypeAdapter(getattr(quantities, name)).validate_python(value) > 0.0


@pytest.mark.parametrize("refused", [3.0, "3", True, -1, None])
def test_counts_are_whole_numbers(refused: object) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(quantities.Count).validate_python(refused)


def test_infinity_keeps_its_sign_and_its_place() -> None:
    assert TypeAdapter(quantities.ObjectDistanceOrInfinity).validate_python("infinity") == math.inf


@pytest.mark.parametrize(
    ("limits", "value", "words"),
    [
        ({"above": 0.0}, "-3 mm", "'-3 mm' is out of range; a length above 0 m is expected"),
        ({"at_least": 0.0}, "-3 mm", "'-3 mm' is out of range; a length of 0 m or more is expected"),
        ({"at_most": 1.0}, "3 m", "'3 m' is out of range; a length of 1 m or less is expected"),
        ({"at_least": 0.1, "at_most": 1.0}, "3 m", "'3 m' is out of range; a length from 100 mm to 1 m is expected"),
        ({"above": 0.0, "at_most": 1.0}, "3 m", "'3 m' is out of range; a length above 0 m and up to 1 m is expected"),
        ({}, "inf", "infinity is not allowed here; a length is expected, such as 30.5 mm"),
    ],
)
def test_words(limits: dict[str, float], value: str, words: str) -> None:
    assert message(Annotated[float, *quantity(units.LENGTH, **limits)], value) == words  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kind", "right", "wrong"),
    [
        (quantities.Length, ["3 mm", "-.5um", "1e-3 m", "0.2 m"], ["3", "mm", "3,5"]),
        (quantities.ObjectDistanceOrInfinity, ["3 mm", "infinity"], ["3", "finity"]),
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


class _Bound(Part):
    exactly_one = (("above", "below"),)
    increasing = ("start", "stop")

    above: float | None = None
    below: float | None = None
    start: float = Field(default=0.0, alias="from")
    stop: float = Field(default=1.0, alias="to")


@pytest.mark.parametrize(
    ("written", "place", "what"),
    [
        ({"above": 1.0}, None, ""),
        ({}, (), "give exactly one of above and below"),
        ({"above": 1.0, "below": 2.0}, (), "give exactly one of above and below (null removes an inherited one)"),
        ({"below": 2.0, "from": 1.0, "to": 1.0}, ("to",), "must lie beyond from"),
    ],
)
def test_a_part_declares_what_excludes_and_what_exceeds_what(
    written: dict[str, float], place: tuple[str, ...] | None, what: str
) -> None:
    if place is None:
        assert _Bound.model_validate(written).above == 1.0
        return
    with pytest.raises(ValidationError) as caught:
        _Bound.model_validate(written)
    (detail,) = caught.value.errors()
    assert (detail["ctx"]["error"].tail, detail["ctx"]["error"].what) == (place, what)
