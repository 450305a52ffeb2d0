"""What a real matcher adds to the matching bound: more noise, a floor, pixel locking, false matches."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.units import FRACTION, pretty, significant
from tradestudy.wording import listed


@dataclass(frozen=True, kw_only=True)
class Matcher:
    """A matcher, described by what it adds to the Cramér–Rao bound σ_b: ``σ² = (k σ_b)² + f² + A²/2``.

    Pixel locking is a systematic bias ``A sin(2π d + φ)`` of the disparity d [samples]. Its phase φ is unknown, so in a
    single measurement its mean square A²/2 adds like normal noise; but it is the same for all measurements at one
    distance, so averaging them does not reduce it. A false match measures nothing: it counts as a failed measurement,
    and the depth uncertainty is that of the true matches.

    Parameters
    ----------
    factor
        k: noise relative to the bound, 1 or more.
    floor
        f: standard deviation of the noise that no amount of light reduces [samples].
    pixel_locking
        A: amplitude of the bias [samples], at most half a sample.
    false_matches
        Fraction of all matches that are false, from 0 to below 1.

    Raises
    ------
    OutOfRangeError
        A value is outside its range.
    """

    factor: float = 1.0
    floor: float = 0.0
    pixel_locking: float = 0.0
    false_matches: float = 0.0

    def __post_init__(self) -> None:
        for name, value, limit, holds in (
            ("noise of a matcher relative to its bound", self.factor, "1 or more", 1.0 <= self.factor < math.inf),
            ("floor of a matcher's noise", self.floor, "0 px or more", 0.0 <= self.floor < math.inf),
            ("amplitude of pixel locking", self.pixel_locking, "from 0 to 0.5 px", 0.0 <= self.pixel_locking <= 0.5),
            ("share of false matches", self.false_matches, "from 0 to below 1", 0.0 <= self.false_matches < 1.0),
        ):
            if not holds:
                raise OutOfRangeError(name, value=f"{value:g}", limit=limit)

    @property
    def words(self) -> str:
        """What the matcher adds to the bound, as the end of a sentence; empty if nothing."""
        rms = significant(self.pixel_locking / math.sqrt(2.0))
        parts = {
            f"noise {significant(self.factor)} times the bound": self.factor != 1.0,
            f"a floor of {significant(self.floor)} px": self.floor != 0.0,
            f"pixel locking of {significant(self.pixel_locking)} px ({rms} px rms)": self.pixel_locking != 0.0,
            f"{pretty(self.false_matches, FRACTION)} false matches": self.false_matches != 0.0,
        }
        return listed([words for words, applies in parts.items() if applies])

    @property
    def beside(self) -> float:
        """The error that adds to any bound in quadrature [samples]: floor and rms pixel locking."""
        return math.hypot(self.floor, self.pixel_locking / math.sqrt(2.0))

    def error_px(self, bound: ArrayLike) -> FloatArray:
        """Standard deviation of one disparity [samples] for a given bound; infinite for an infinite bound."""
        return np.hypot(self.factor * np.asarray(bound, dtype=np.float64), self.beside)

    def numerical_error_px(self, bound: ArrayLike, error: ArrayLike) -> FloatArray:
        """Numerical error of `error_px` [samples] due to that of the bound, to first order."""
        return np.asarray(self.factor * self._weights(bound)[0] * np.asarray(error, dtype=np.float64))

    def change(self, bound: ArrayLike, factor: ArrayLike) -> FloatArray:
        """The factor by which `error_px` changes if the bound changes by a given factor."""
        by_bound, by_rest = self._weights(bound)
        with np.errstate(invalid="ignore"):  # a zero bound changes by any factor
            found = np.hypot(by_bound * np.asarray(factor, dtype=np.float64), by_rest)
        return np.where(np.isinf(factor), np.inf, found)

    def _weights(self, bound: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Parts of `error_px` due to the bound and to the rest, whose squares sum to 1; 1 and 0 if unknown."""
        value, achieved = np.asarray(bound, dtype=np.float64), self.error_px(bound)
        known = np.isfinite(achieved) & (achieved > 0.0)
        total = np.where(known, achieved, 1.0)
        return (
            np.where(known, self.factor * np.where(known, value, 0.0) / total, 1.0),
            np.where(known, self.beside / total, 0.0),
        )


AT_BOUND = Matcher()
"""The ideal matcher, which reaches the bound."""
