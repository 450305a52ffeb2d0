"""Values that answer inverse questions, and the calibrations that are planned to find them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

from tradestudy.study.bases import NamedInput
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.schema.questions import SolvePart
from tradestudy.study.varying import Varying
from tradestudy.units import Dimension
from tradestudy.wording import DECLARED_VALUE

if TYPE_CHECKING:
    from tradestudy.calibration.camera_target import TargetToInfer


def bracketed(
    inside: float,
    outside: float,
    holds: Callable[[float], bool | None],
    *,
    possible: Callable[[float], float],
    close: float,
) -> tuple[float, float]:
    """The last value found at which a condition holds, and the next one at which it does not.

    Parameters
    ----------
    inside, outside
        Where it holds, and where it does not; either may be the larger.
    holds
        Whether it holds at a value; None if this cannot be known, which ends the search.
    possible
        The permitted value nearest to a value, such as a whole number.
    close
        Relative distance of the two values at which the search ends.
    """
    while abs(outside - inside) > close * max(abs(inside), abs(outside)):
        middle = possible((inside + outside) / 2.0)
        if middle in (inside, outside):  # no permitted value lies between them
            break
        kept = holds(middle)
        if kept is None:
            break
        inside, outside = (middle, outside) if kept else (inside, middle)
    return inside, outside


PLANS: Final = range(8)
"""The arrangements of the views from which the scatter of an answer is estimated; the first is that of the run."""


def planned(study: PreparedStudy, plan: int = 0) -> PreparedStudy:
    """The study with the calibrations expected from its targets, where none has been inferred yet.

    Raises
    ------
    TradestudyError
        A target is seen in too few views.
    """
    requests = to_plan(study)
    if not requests:
        return study
    from tradestudy.calibration.camera_target import planned_calibration

    posteriors = {key: planned_calibration(request, plan) for key, request in requests.items()}
    return replace(study, choices=replace(study.choices, posteriors={**study.choices.posteriors, **posteriors}))


def to_plan(study: PreparedStudy) -> dict[str, TargetToInfer]:
    """The calibrations by a target that have not been inferred, by the keys of their posteriors."""
    requests = study.definition.calibrations_to_infer()
    if not requests:
        return {}
    from tradestudy.calibration.camera_target import TargetToInfer

    inferred = study.choices.posteriors
    return {
        key: request for key, request in requests.items() if isinstance(request, TargetToInfer) and key not in inferred
    }


def to_be_planned(study: PreparedStudy, varying: Varying) -> PreparedStudy:
    """The study without calibrations inferred from targets that a question varies, to make its values comparable."""
    varied = varied_calibrations(study, varying)
    kept = {key: posterior for key, posterior in study.choices.posteriors.items() if key not in varied}
    return replace(study, choices=replace(study.choices, posteriors=kept))


def varied_calibrations(study: PreparedStudy, varying: Varying) -> set[str]:
    """Keys of the inferred calibrations that a question varies."""
    definition, keys = study.definition, study.definition.posterior_keys
    ends = [definition.with_values(varying.changes(end)).posterior_keys for end in (varying.low, varying.high)]
    return {keys[camera_name] for camera_name in keys if any(end.get(camera_name) != keys[camera_name] for end in ends)}


def plans(study: PreparedStudy) -> range:
    """The arrangements of the views to try: only the first if nothing needs planning or every pose is given."""
    is_spread = any(request.part.poses is None for request in to_plan(study).values())
    return PLANS if is_spread else PLANS[:1]


@dataclass(frozen=True, kw_only=True)
class Solution:
    """A value that answers an inverse question, with its standard error, in the SI unit of the varied input."""

    value: float
    error: float


@dataclass(frozen=True, kw_only=True)
class Solved:
    """Every solution of an inverse question within its ends, ascending, with the answer in words.

    `tried` has the values at which the depth uncertainty [m] of a camera was computed, each with that uncertainty (the
    geometric mean over scrambles or plans), for a question that gives it a required value; otherwise it is empty.
    `rests_on` names the input that decides the variance at the first solution, and `share` is its share of it; empty
    and NaN where none is known to.
    """

    solutions: tuple[Solution, ...]
    dimension: Dimension
    answer: str
    tried: tuple[tuple[float, float], ...] = ()
    rests_on: NamedInput = field(default_factory=NamedInput)
    share: float = math.nan

    @property
    def value(self) -> float:
        """The first solution; NaN if there is none."""
        return self.solutions[0].value if self.solutions else math.nan

    @property
    def error(self) -> float:
        """Its standard error."""
        return self.solutions[0].error if self.solutions else math.nan


def with_declared_value(study: PreparedStudy, question: SolvePart, answer: str) -> str:
    """An answer, followed by the declared value of the varied input if it has one."""
    path = question.paths[0]
    if study.document.entry(path) is None:
        return answer
    return f"{answer}{DECLARED_VALUE}{study.document.text_of(path)}"
