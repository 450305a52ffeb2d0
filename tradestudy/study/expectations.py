"""Expected values of claims and ends of inverse questions, parsed in the dimension of their quantity."""

from __future__ import annotations

import math
from typing import Protocol

from tradestudy.declarations.quantities import common_dimension
from tradestudy.errors import OutOfRangeError
from tradestudy.study.schema.questions import (
    ClaimPart,
    CriterionFNumberClaim,
    DepthOfFieldClaim,
    DepthOfFieldRatioClaim,
    FresnelFNumberClaim,
    ImageDifferenceClaim,
    LimitDistanceClaim,
    LitPixelsClaim,
    PsfErrorClaim,
    RelativeUncertaintyDistanceClaim,
    ShareBetterClaim,
    UncertaintyRatioClaim,
)
from tradestudy.units import FRACTION, LENGTH, NUMBER, Dimension, parse


def claim_dimension(claim: ClaimPart) -> Dimension:
    """The dimension of a claim's value."""
    match claim:
        case LimitDistanceClaim() | RelativeUncertaintyDistanceClaim() | DepthOfFieldClaim():
            return LENGTH
        case UncertaintyRatioClaim() | DepthOfFieldRatioClaim():
            return NUMBER
        case ShareBetterClaim() | PsfErrorClaim() | ImageDifferenceClaim():
            return FRACTION
        case FresnelFNumberClaim() | CriterionFNumberClaim() | LitPixelsClaim():
            return NUMBER


def expectation_bounds(claim: ClaimPart) -> float:
    """The expected value or bound of a claim in the SI unit of its quantity.

    Raises
    ------
    UnitError
        If it is not a value of that quantity.
    """
    expect = claim.expect
    text = next(text for text in (expect.about, expect.above, expect.below) if text is not None)
    return parse(text, claim_dimension(claim))


class Varied(Protocol):
    """An inverse question or an assumption, which varies values between two ends."""

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths of the varied values."""

    @property
    def low(self) -> str:
        """Lower end, with its unit."""

    @property
    def high(self) -> str:
        """Upper end, with its unit."""


def question_ends(question: Varied) -> tuple[Dimension, float, float]:
    """The dimension of the values that an inverse question or an assumption varies, and the ends of their range in SI.

    Raises
    ------
    OutOfRangeError
        If the ends have no common unit, or do not satisfy 0 < low < high.
    """
    dimension = common_dimension(question.low, question.high)
    if dimension is None:
        raise OutOfRangeError("the ends have no common unit", value=f"{question.low} … {question.high}")
    low, high = parse(question.low, dimension), parse(question.high, dimension)
    if not 0.0 < low < high < math.inf:
        raise OutOfRangeError(
            "the ends of the varied range", value=f"{question.low} … {question.high}", limit="0 < low < high"
        )
    return dimension, low, high
