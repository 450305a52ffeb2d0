"""Stated priors of calibration parameters: normal, bounded normal, or uniform."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class Priors:
    """Independent priors: normal with mean and standard deviation, cut at bounds.

    Parameters
    ----------
    names : tuple of str, length P
        Parameters.
    mean : array (P,)
        Centres; the starting value where the prior is uniform.
    standard_deviation : array (P,)
        > 0; inf for a uniform prior, which needs finite bounds.
    lower, upper : array (P,)
        Bounds; −inf and inf for none.

    Raises
    ------
    OutOfRangeError
        A shape differs, a deviation is not positive, a mean lies outside its bounds, a uniform prior has no bounds.
    """

    names: tuple[str, ...]
    mean: FloatArray
    standard_deviation: FloatArray
    lower: FloatArray
    upper: FloatArray

    def __post_init__(self) -> None:
        for what in ("mean", "standard_deviation", "lower", "upper"):
            if getattr(self, what).shape != (len(self.names),):
                raise OutOfRangeError(
                    f"the priors' {what} does not match their names",
                    value=str(getattr(self, what).shape),
                    limit=f"({len(self.names)},)",
                    remedy="give one value per parameter",
                )
        bad = {
            "needs a positive standard deviation": ~(self.standard_deviation > 0.0),
            "is uniform without finite bounds": np.isinf(self.standard_deviation)
            & ~(np.isfinite(self.lower) & np.isfinite(self.upper)),
            "has its mean outside its bounds": ~((self.lower < self.mean) & (self.mean < self.upper)),
        }
        for what, where in bad.items():
            if np.any(where):
                index = int(np.argmax(where))
                raise OutOfRangeError(
                    f"the prior of {self.names[index]} {what}",
                    value=f"{self.mean[index]:g} ± {self.standard_deviation[index]:g}",
                    limit=f"{self.lower[index]:g} to {self.upper[index]:g}",
                    remedy="correct the prior",
                )

    @property
    def precision(self) -> FloatArray:
        """Inverse variances, zero where uniform, shape (P,)."""
        return self.standard_deviation**-2.0

    @property
    def scale(self) -> FloatArray:
        """A length typical of each parameter: its deviation, or a quarter of its range, shape (P,)."""
        with np.errstate(invalid="ignore"):  # inf − inf of an unbounded normal, which is not selected
            width = (self.upper - self.lower) / 4.0
        return np.where(np.isinf(self.standard_deviation), width, self.standard_deviation)

    def log_density(self, parameters: FloatArray) -> FloatArray:
        """Logarithm of the prior up to a constant, −inf outside the bounds.

        Parameters
        ----------
        parameters : array (..., P)
            Where.
        """
        inside = np.all((parameters >= self.lower) & (parameters <= self.upper), axis=-1)
        square = np.sum(((parameters - self.mean) / self.standard_deviation) ** 2, axis=-1)
        return np.where(inside, -0.5 * square, -np.inf)

    def draw(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Draws of the prior, shape (count, P).

        Parameters
        ----------
        rng : numpy.random.Generator
            Randomness.
        count : int
            Draws wanted.
        """
        uniform = rng.random((count, len(self.names)))
        flat = np.isinf(self.standard_deviation)
        spread = np.where(flat, 1.0, self.standard_deviation)
        low, high = ndtr((self.lower - self.mean) / spread), ndtr((self.upper - self.mean) / spread)
        normal = self.mean + spread * ndtri(low + uniform * (high - low))
        box_low, box_high = np.where(flat, self.lower, 0.0), np.where(flat, self.upper, 0.0)
        return np.where(flat, box_low + uniform * (box_high - box_low), normal)
