"""/cameras, /assumptions, /contradictions, /criteria: registers of every study."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import EXACT, ROUNDING, Variable

CAMERAS: Final[Mapping[str, Variable]] = {
    "title": Variable(dims=("camera",), units="", long_name="name of the camera in figures and tables"),
    "kind": Variable(dims=("camera",), units="", long_name="kind of camera, such as 'stereo'"),
    "family": Variable(
        dims=("camera",),
        units="",
        long_name="family of kinds that work by the same principle, such as 'plenoptic'",
    ),
    "method": Variable(
        dims=("camera",),
        units="",
        long_name="how depth follows from the pictures of the camera, as JSON for the report; empty if the camera "
        "measures no depth",
    ),
    "note": Variable(
        dims=("camera",), units="", long_name="the note declared under the camera; empty if there is none"
    ),
    "perfect_calibration": Variable(
        dims=("camera",),
        units="1",
        long_name="1 if the camera measures depth and has no uncertain parameter, else 0",
        error=EXACT,
    ),
    "property_camera": Variable(dims=("property",), units="", long_name="camera that has the property"),
    "property_name": Variable(
        dims=("property",),
        units="",
        long_name="name of a property that follows from the declared values, with its symbol if it has one",
    ),
    "property_value": Variable(dims=("property",), units="", long_name="value of the property, with its unit"),
}

ASSUMPTIONS: Final[Mapping[str, Variable]] = {
    "value": Variable(
        dims=("path",),
        units="",
        long_name="value with its unit: as set for this run, as written in the study file, or the default",
    ),
    "basis": Variable(
        dims=("path",),
        units="",
        long_name="basis of the value: 'paper', 'datasheet', 'measured', 'assumed' or 'derived'; 'set for this run' if "
        "the run replaces the value of the study file; empty if none is declared",
    ),
    "note": Variable(
        dims=("path",),
        units="",
        long_name="source of the value in words or, if it is set for this run, the value that it replaces in the study "
        "file; empty if neither is known",
    ),
    "cameras": Variable(
        dims=("path",), units="", long_name="cameras that have the value; empty for values outside cameras"
    ),
    "warning": Variable(
        dims=("warned",), units="", long_name="warning about an implausible value, with the path of the value"
    ),
}

CONTRADICTIONS: Final[Mapping[str, Variable]] = {
    "camera": Variable(dims=("contradiction",), units="", long_name="camera with the contradictory inputs"),
    "what": Variable(
        dims=("contradiction",),
        units="",
        long_name="quantity that the study states although it follows from other inputs, and the names of those inputs",
    ),
    "stated": Variable(dims=("contradiction",), units="", long_name="value that the study states"),
    "implied": Variable(dims=("contradiction",), units="", long_name="value that follows from the other inputs"),
    "used": Variable(dims=("contradiction",), units="", long_name="which value the program uses"),
    "consequence": Variable(
        dims=("contradiction",),
        units="",
        long_name="what the contradiction does to the answers about the camera; empty if they do not suffer",
    ),
}

CRITERIA: Final[Mapping[str, Variable]] = {
    "value": Variable(
        dims=("camera", "criterion"),
        units="",
        long_name="value of the criterion, with its unit, or in words",
    ),
    "basis": Variable(
        dims=("camera", "criterion"),
        units="",
        long_name="basis of the value; 'derived' if the value follows from other inputs, 'declared' if the study "
        "gives it without a basis; empty if there is no value",
    ),
    "number": Variable(
        dims=("camera", "criterion"),
        units="mixed",
        long_name="value of the criterion as a number, in the unit given by number_units; NaN where it has no number",
        error=ROUNDING,
    ),
    "number_units": Variable(
        dims=("criterion",), units="", long_name="unit of 'number', '1' for plain numbers; empty for criteria in words"
    ),
    "says": Variable(
        dims=("criterion",),
        units="",
        long_name="meaning of the criterion; 'as declared' for criteria under attributes.others",
    ),
}
