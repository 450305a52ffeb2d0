"""/hard_cases: every hard case by the usual formula and by this program, with the allowed error and the verdict."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import Variable

_CASE: Final = ("case",)
_OUTCOME: Final = "NaN where the answer is in words"


def _text(long_name: str) -> Variable:
    return Variable(dims=_CASE, units="", long_name=long_name)


def _error(long_name: str) -> Variable:
    return Variable(
        dims=_CASE,
        units="1",
        long_name=f"{long_name}; infinite where the answer is a wrong infinity, not a number, or an exception; "
        f"{_OUTCOME}",
        error="exact to thirty digits",
    )


HARD_CASES: Final[Mapping[str, Variable]] = {
    "family": _text("family of the case, by its name in a study file"),
    "family_title": _text("family of the case, in words"),
    "law": _text("quantity that is computed"),
    "naive_answer": _text("answer of the usual formula"),
    "our_answer": _text("answer of this program"),
    "expected": _text("right answer: a rounded multiple-precision number, or words"),
    "outcome": Variable(
        dims=_CASE, units="1", long_name="whether the right answer is in words (a refusal, a sign, a count)"
    ),
    "naive_error": _error("relative error of the usual formula"),
    "our_error": _error("relative error of this program"),
    "bound": Variable(
        dims=_CASE,
        units="1",
        long_name="allowed relative error: 1e-12, ten machine epsilons times the condition number, or the error that "
        f"the computation states; {_OUTCOME}",
        error="exact",
    ),
    "condition_number": Variable(
        dims=_CASE,
        units="1",
        long_name=f"relative change of the value per relative change of each input, summed; infinite at a pole or a "
        f"jump; {_OUTCOME}",
        error="correct to four digits",
    ),
    "met": Variable(dims=_CASE, units="1", long_name="whether the answer of this program is right"),
}
