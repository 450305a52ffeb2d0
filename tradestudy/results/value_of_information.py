"""/value_of_information: what knowing each assumption is worth to the choice of a camera."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import ESTIMATE, Variable

_DRAWS: Final = "not stored: about √(p (1 − p)/n) for a fraction p of n draws"

VALUE_OF_INFORMATION: Final[Mapping[str, Variable]] = {
    "worth": Variable(
        dims=("assumption",),
        units="1",
        long_name="expected value of partial perfect information (EVPPI): how much the expected utility of the best "
        "choice of camera grows if the assumption is known before choosing; corrected for worth_bias",
        error="see worth_error",
    ),
    "worth_error": Variable(dims=("assumption",), units="1", long_name="standard error of 'worth'", error=ESTIMATE),
    "worth_bias": Variable(
        dims=("assumption",),
        units="1",
        long_name="upward bias that has been subtracted from 'worth': noise raises the largest of several estimated "
        "utilities",
        error=ESTIMATE,
    ),
    "says": Variable(dims=("assumption",), units="", long_name="name of the assumption in reports"),
    "varied": Variable(dims=("assumption",), units="", long_name="paths of the varied values, or the readings"),
    "between": Variable(
        dims=("assumption",),
        units="",
        long_name="smallest and largest possible value with units, or the readings in words",
    ),
    "expected_utility": Variable(
        dims=("candidate",),
        units="1",
        long_name="mean utility of the camera over the draws",
        error="see expected_utility_error",
    ),
    "expected_utility_error": Variable(
        dims=("candidate",), units="1", long_name="standard error of expected_utility", error=ESTIMATE
    ),
    "best_overall": Variable(
        dims=("candidate",),
        units="1",
        long_name="fraction of the draws in which the camera has the highest utility",
        error=_DRAWS,
    ),
    "best_probability": Variable(
        dims=("candidate", "place"),
        units="1",
        long_name="fraction of the draws in which the camera is usable at this distance and has the lowest depth "
        "uncertainty",
        error=_DRAWS,
    ),
    "requirement_probability": Variable(
        dims=("requirement",),
        units="1",
        long_name="fraction of the draws in which the requirement is met",
        error=_DRAWS,
    ),
}
