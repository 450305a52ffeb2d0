"""Hard cases and their verdicts: the textbook formula and this program's, each compared with a reference."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import cache
from importlib.resources import files
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

WELL_CONDITIONED: Final = 1e-12
"""Relative error allowed in well-conditioned cases."""

_ROUNDINGS: Final = 10.0  # number of roundings of one epsilon, which the condition number may magnify
_DIGITS: Final = 60  # digits of the difference from the reference, far more than either number has


@dataclass(frozen=True, kw_only=True)
class Stated:
    """A value with the error stated by its computation, in the unit of the value."""

    value: float
    error: float


@dataclass(frozen=True, kw_only=True)
class Law:
    """One quantity by two formulas of the same arguments.

    Parameters
    ----------
    name
        The law in a few words, as the report prints it.
    naive, ours
        The textbook formula, and the function of this program; both take the inputs of a case by name.
    magnified
        Whether the condition number may magnify the allowed error. False if the ill-conditioned step is a difference of
        inputs, which floating point computes without error.
    epsilon
        Machine epsilon of the inputs' precision.
    """

    name: str
    naive: Callable[..., ArrayLike]
    ours: Callable[..., ArrayLike | Stated]
    magnified: bool = True
    epsilon: float = 2.0**-52


@dataclass(frozen=True, kw_only=True)
class NumericCase:
    """A law at hard inputs, judged by its error relative to a stored reference of thirty digits."""

    name: str
    law: Law
    inputs: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class OutcomeCase:
    """A case whose correct answer is not a number but a refusal, a count or a sign.

    Parameters
    ----------
    name, law
        The difficulty, and a description of the correct answer.
    naive, ours
        The answers of the textbook method and of this program, in words.
    expected
        Texts that a correct answer contains.
    """

    name: str
    law: str
    naive: Callable[[], str]
    ours: Callable[[], str]
    expected: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Family:
    """Hard cases of one part of the program."""

    name: str
    title: str
    cases: tuple[NumericCase | OutcomeCase, ...]


@dataclass(frozen=True, kw_only=True)
class Reference:
    """The result of a case in multiple precision.

    Parameters
    ----------
    value
        Thirty digits, or ``inf``.
    scale
        The number to which errors are relative; it differs from the value if the value can pass through zero.
    condition_number
        Relative change of the value per relative change of an input, summed over the inputs.
    """

    value: str
    scale: str
    condition_number: float


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The verdict on a case.

    Parameters
    ----------
    family, case, law
        Names of the family, the case and its law.
    naive_answer, our_answer, reference
        The answers, as text.
    naive_error, our_error, bound
        Relative errors and the largest one allowed; NaN for answers in words, infinite for answers that are not numbers
        or wrongly infinite.
    condition_number
        Condition number of the case; NaN for answers in words.
    met
        Whether our answer is correct.
    """

    family: str
    case: str
    law: str
    naive_answer: str
    our_answer: str
    reference: str
    naive_error: float
    our_error: float
    bound: float
    condition_number: float
    met: bool


def judge(family: Family, case: NumericCase | OutcomeCase, references: Mapping[str, Reference]) -> Verdict:
    """Compute a case by both formulas and judge the program's.

    Parameters
    ----------
    family, case
        The case and its family.
    references
        References of the family's numeric cases, by name.
    """
    if isinstance(case, OutcomeCase):
        return _judge_outcome(family, case)
    reference = references[case.name]
    naive, ours = _naive(case), _ours(case)
    our_error = math.inf if isinstance(ours, str) else relative_error(ours.value, reference)
    bound = allowed_error(case, reference, ours)
    return Verdict(
        family=family.name,
        case=case.name,
        law=case.law.name,
        naive_answer=_text(naive),
        our_answer=ours if isinstance(ours, str) else _text(ours.value),
        reference=reference.value if reference.value in ("inf", "-inf") else f"{float(reference.value):.9g}",
        naive_error=math.inf if isinstance(naive, str) else relative_error(naive, reference),
        our_error=our_error,
        bound=bound,
        condition_number=reference.condition_number,
        met=our_error <= bound,
    )


def allowed_error(case: NumericCase, reference: Reference, ours: Stated | str) -> float:
    """The stated error or, without one, ten roundings magnified by the condition number; at least 1e-12."""
    if isinstance(ours, Stated) and not math.isnan(ours.error):
        scale = abs(float(reference.scale))
        return max(WELL_CONDITIONED, ours.error / scale) if scale > 0.0 else WELL_CONDITIONED
    rounding = _ROUNDINGS * case.law.epsilon
    magnified = rounding * max(reference.condition_number, 1.0) if case.law.magnified else rounding
    return max(WELL_CONDITIONED, magnified) if math.isfinite(magnified) else WELL_CONDITIONED


def relative_error(value: float, reference: Reference) -> float:
    """|value − reference| over the scale, exact to many digits; 0 or infinite if either number is infinite."""
    if reference.value in ("inf", "-inf") or not math.isfinite(value):
        return 0.0 if value == float(reference.value) else math.inf
    with localcontext() as context:
        context.prec = _DIGITS
        difference = abs(Decimal(value) - Decimal(reference.value))
        scale = abs(Decimal(reference.scale))
        if scale == 0:
            return 0.0 if difference == 0 else math.inf
        return float(difference / scale)


def _naive(case: NumericCase) -> float | str:
    """The answer of the textbook formula; the name of its exception if it raises one."""
    with np.errstate(all="ignore"):  # its warnings are the point of the comparison
        try:
            return _scalar(case.law.naive(**case.inputs))
        except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
            return type(error).__name__


def _ours(case: NumericCase) -> Stated | str:
    """The answer of the program's formula; an unhandled floating-point warning counts as a wrong answer."""
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        try:
            answer = case.law.ours(**case.inputs)
        except FloatingPointError as error:
            return f"FloatingPointError: {error}"
    return answer if isinstance(answer, Stated) else Stated(value=_scalar(answer), error=math.nan)


def _judge_outcome(family: Family, case: OutcomeCase) -> Verdict:
    with np.errstate(all="ignore"):  # its warnings are the point of the comparison
        naive = case.naive()
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        try:
            ours = case.ours()
        except FloatingPointError as error:
            ours = f"FloatingPointError: {error}"
    return Verdict(
        family=family.name,
        case=case.name,
        law=case.law,
        naive_answer=naive,
        our_answer=ours,
        reference=" … ".join(case.expected),
        naive_error=math.nan,
        our_error=math.nan,
        bound=math.nan,
        condition_number=math.nan,
        met=all(part in ours for part in case.expected),
    )


def _scalar(value: Any) -> float:
    return float(np.asarray(value)[()])


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.9g}"


@cache
def references() -> Mapping[str, Mapping[str, Reference]]:
    """References by family and case."""
    text = files("tradestudy.verification").joinpath("references.json").read_text(encoding="utf-8")
    return {
        family: {
            name: Reference(
                value=row["value"],
                scale=row.get("scale", row["value"]),
                condition_number=float(row["condition_number"]),
            )
            for name, row in table.items()
        }
        for family, table in json.loads(text).items()
    }
