"""Joint draws of a calibration, and their place among the other errors of a camera."""

from __future__ import annotations

from collections.abc import Iterable

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.error_class import ErrorClass
from tradestudy.uncertainty.joint import JointDraws
from tradestudy.uncertainty.sources import Group

CALIBRATION_GROUP = "calibration"


def group_of_draws(parameters: tuple[str, ...], draws: FloatArray) -> JointDraws:
    """Joint draws of a calibration as errors about their mean: what the calibration leaves open."""
    return JointDraws(
        name=CALIBRATION_GROUP,
        parameters=parameters,
        draws=draws - draws.mean(axis=0),
        error_class=ErrorClass.RIG,
    )


def replaced(groups: Iterable[Group], calibration: Group) -> tuple[Group, ...]:
    """The groups with a joint calibration in the place of those whose parameters it determines.

    Raises
    ------
    OutOfRangeError
        It determines a part of a joint group: what is left would have lost its partner.
    """
    kept: list[Group] = []
    covered = set(calibration.parameters)
    for group in groups:
        inside = covered & set(group.parameters)
        if inside and inside != set(group.parameters):
            raise OutOfRangeError(
                "the calibration determines some parameters of a correlation, not all",
                value=", ".join(sorted(inside)),
                limit=", ".join(group.parameters),
                remedy="leave out the correlation between what it determines and what it does not",
            )
        if not inside:
            kept.append(group)
    return (*kept, calibration)
