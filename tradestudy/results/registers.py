"""/cameras, /assumptions, /contradictions, /criteria: registers of every study."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import Variable

CAMERAS: Final[Mapping[str, Variable]] = {
    "title": Variable(dims=("camera",), units="", long_name="name in figures and tables"),
    "kind": Variable(dims=("camera",), units="", long_name="kind of camera"),
    "family": Variable(
        dims=("camera",),
        units="",
        long_name="principle of measurement, which all cameras of one family share",
    ),
    "method": Variable(
        dims=("camera",),
        units="",
        long_name="how depth follows from the pictures of the camera, in JSON",
    ),
    "note": Variable(dims=("camera",), units="", long_name="what a reader should know about the camera"),
    "property_value": Variable(
        dims=("property",), units="", long_name="value of a property that follows from the inputs, with its unit"
    ),
    "perfect_calibration": Variable(
        dims=("camera",),
        units="",
        long_name="1 where a camera that measures depth declares no uncertain parameter",
    ),
    "property_camera": Variable(dims=("property",), units="", long_name="camera that has the property"),
    "property_name": Variable(dims=("property",), units="", long_name="name of the property"),
}

ASSUMPTIONS: Final[Mapping[str, Variable]] = {
    "value": Variable(dims=("path",), units="", long_name="the value as written"),
    "basis": Variable(
        dims=("path",), units="", long_name="basis of the value: paper, datasheet, measured, assumed or derived"
    ),
    "note": Variable(dims=("path",), units="", long_name="note on where the value comes from"),
    "cameras": Variable(
        dims=("path",), units="", long_name="cameras to which the value belongs; empty for values of the study itself"
    ),
    "warning": Variable(
        dims=("warned",), units="", long_name="warning about an implausible input, with the path of the input"
    ),
}

CONTRADICTIONS: Final[Mapping[str, Variable]] = {
    "camera": Variable(dims=("contradiction",), units="", long_name="camera with contradictory inputs"),
    "what": Variable(
        dims=("contradiction",), units="", long_name="quantity that is stated and also implied by other inputs"
    ),
    "stated": Variable(dims=("contradiction",), units="", long_name="value that is stated"),
    "implied": Variable(dims=("contradiction",), units="", long_name="value implied by the other inputs"),
    "used": Variable(dims=("contradiction",), units="", long_name="which of the two values the study uses"),
}

CRITERIA: Final[Mapping[str, Variable]] = {
    "value": Variable(
        dims=("camera", "criterion"),
        units="",
        long_name="value of the criterion for a camera, with its unit",
    ),
    "basis": Variable(
        dims=("camera", "criterion"),
        units="",
        long_name="basis of this value: derived from the other inputs, or as declared",
    ),
    "number": Variable(
        dims=("camera", "criterion"),
        units="mixed",
        long_name="value of the criterion as a number, in the unit of number_units; NaN where it is not a number",
        error="closed form of declared values; rounding only",
    ),
    "number_units": Variable(dims=("criterion",), units="", long_name="SI unit of 'number'"),
    "says": Variable(dims=("criterion",), units="", long_name="meaning of the criterion"),
}
