"""/value_of_information: what knowing each assumption is worth to the choice of a camera."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import Variable

_DRAWS: Final = "standard error of a fraction of draws"

VALUE_OF_INFORMATION: Final[Mapping[str, Variable]] = {
    "worth": Variable(
        dims=("assumption",),
        units="1",
        long_name="expected reduction of relative depth uncertainty, averaged over the distances, from knowing the "
        "assumption before choosing a camera (EVPPI), corrected for its upward bias",
        error="worth_error",
    ),
    "worth_error": Variable(
        dims=("assumption",), units="1", long_name="standard error of worth", error="itself an estimate"
    ),
    "worth_bias": Variable(
        dims=("assumption",),
        units="1",
        long_name="upward bias of worth due to noise in the maximum over cameras; already subtracted",
        error="itself an estimate",
    ),
    "says": Variable(dims=("assumption",), units="", long_name="name of the assumption"),
    "varied": Variable(dims=("assumption",), units="", long_name="paths of the varied values"),
    "between": Variable(dims=("assumption",), units="", long_name="ends of the range of the varied values"),
    "expected_utility": Variable(
        dims=("candidate",),
        units="1",
        long_name="negative mean relative depth uncertainty, over the distances and draws",
        error="expected_utility_error",
    ),
    "expected_utility_error": Variable(
        dims=("candidate",), units="1", long_name="standard error of expected_utility", error="itself an estimate"
    ),
    "best_overall": Variable(
        dims=("candidate",),
        units="1",
        long_name="fraction of draws in which the camera has the best utility",
        error=_DRAWS,
    ),
    "best_probability": Variable(
        dims=("candidate", "place"),
        units="1",
        long_name="fraction of draws in which the camera is usable and has the lowest uncertainty at a distance",
        error=_DRAWS,
    ),
    "requirement_probability": Variable(
        dims=("requirement",),
        units="1",
        long_name="fraction of draws in which the requirement holds at all its distances jointly",
        error=_DRAWS,
    ),
}
