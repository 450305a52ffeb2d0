"""/hard_cases: every hard case by the usual formula and by this program, with the allowed error and the verdict."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import EXACT, Variable

_CASE: Final = ("case",)


def _text(long_name: str) -> Variable:
    return Variable(dims=_CASE, units="", long_name=long_name)


def _error(long_name: str) -> Variable:
    return Variable(
        dims=_CASE,
        units="1",
        long_name=f"{long_name}; infinite where it wrongly gives infinity, NaN or an exception; NaN where the "
        "right answer is in words",
        error="correct to thirty digits",
    )


HARD_CASES: Final[Mapping[str, Variable]] = {
    "family": _text("family of the case, as named in hard_cases.families"),
    "family_title": _text("family of the case, in words"),
    "law": _text("computed quantity, with its equation"),
    "naive_answer": _text("answer of the textbook formula"),
    "our_answer": _text("answer of this program"),
    "expected": _text("right answer: a number rounded from a computation with more digits, or words"),
    "outcome": Variable(
        dims=_CASE,
        units="1",
        long_name="whether the right answer is in words: an error message, a sign or a count rather than a computed "
        "number",
    ),
    "naive_error": _error("relative error of the textbook formula"),
    "our_error": _error("relative error of this program"),
    "bound": Variable(
        dims=_CASE,
        units="1",
        long_name="largest acceptable our_error: the relative error that the program states (for a sampled value, six "
        "standard errors) or, if it states none, 10 machine epsilons times condition_number, or only 10 machine "
        "epsilons where the program computes the ill-conditioned step without rounding; at least 1e-12, and 1e-12 "
        "where condition_number is infinite and the program states no error; NaN where the right answer is in words",
        error=EXACT,
    ),
    "condition_number": Variable(
        dims=_CASE,
        units="1",
        long_name="relative change of the result per relative change of an input, summed over the inputs; infinite "
        "at a pole or a jump, NaN where the right answer is in words",
        error="correct to four digits",
    ),
    "met": Variable(dims=_CASE, units="1", long_name="whether the answer of this program is right"),
}
