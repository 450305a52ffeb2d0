"""Laplace's approximation: a normal distribution about the peak of a posterior, and its check against the exact one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import FloatArray

CONDITION_LIMIT = 1e12  # of the scaled information; beyond it, the least certain direction is rounding error
EFFICIENCY_LIMIT = 0.9  # least effective share of draws after reweighting to the exact posterior
CHECKED_POINTS = 100


@dataclass(frozen=True, kw_only=True)
class LaplaceFit:
    """Normal approximation of a posterior.

    Parameters
    ----------
    names : tuple of str, length P
        Names of the parameters.
    mean : array (P,)
        Peak of the posterior.
    covariance : array (P, P)
        Inverse information at the peak.
    """

    names: tuple[str, ...]
    mean: FloatArray
    covariance: FloatArray

    @property
    def standard_deviation(self) -> FloatArray:
        """Standard deviations, shape (P,)."""
        deviation: FloatArray = np.sqrt(np.diag(self.covariance))
        return deviation

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix, shape (P, P)."""
        deviation = self.standard_deviation
        return self.covariance / np.outer(deviation, deviation)

    def draw(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Joint draws, shape (count, P).

        Parameters
        ----------
        rng : numpy.random.Generator
            Random-number generator.
        count : int
            Number of draws.
        """
        # scaled, because very different units would make the factorisation inaccurate
        deviation = self.standard_deviation
        factor = np.linalg.cholesky(self.correlation)
        draws: FloatArray = self.mean + deviation * (rng.standard_normal((count, len(self.mean))) @ factor.T)
        return draws


def covariance_from_information(information: FloatArray, names: tuple[str, ...]) -> FloatArray:
    """Covariance as the inverse of an information matrix; refuses a singular one.

    Parameters
    ----------
    information : array (P, P)
        Symmetric information matrix in any units; it is scaled to a unit diagonal before inversion.
    names : tuple of str, length P
        Names of the parameters, for the message.

    Returns
    -------
    array (P, P)
        Covariance.

    Raises
    ------
    NotConvergedError
        The observations do not determine a combination of parameters, which the message names.
    """
    diagonal = np.diag(information)
    if not np.all(diagonal > 0.0):
        raise _undetermined([names[int(np.argmin(diagonal))]], np.inf)
    # With a unit diagonal, the units of the parameters do not decide whether the matrix counts as singular.
    scale = 1.0 / np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    if values[0] * CONDITION_LIMIT < values[-1]:
        share = np.abs(vectors[:, 0])
        culprits = [names[index] for index in np.argsort(-share)[:3] if share[index] > 0.1]
        raise _undetermined(culprits, values[-1] / max(values[0], np.finfo(float).eps * values[-1]))
    root = vectors * scale[:, None] / np.sqrt(values)
    covariance: FloatArray = root @ root.T
    return covariance


@dataclass(frozen=True, kw_only=True)
class LaplaceCheck:
    """Comparison of an approximate log posterior with the exact one, at draws from the former.

    Parameters
    ----------
    efficiency : float
        Effective share of draws after reweighting to the exact posterior, in (0, 1]; reweighting moves no mean by more
        than √(1/efficiency − 1) standard deviations.
    """

    efficiency: float

    @property
    def passed(self) -> bool:
        """Whether the approximate posterior may replace the exact one."""
        return self.efficiency >= EFFICIENCY_LIMIT


def compare_log_posteriors(exact: FloatArray, approximate: FloatArray) -> LaplaceCheck:
    """Check an approximate log posterior against an exact one, both up to a constant, by importance ratios.

    Parameters
    ----------
    exact, approximate : array (K,)
        Log posteriors at draws from the approximate posterior.

    Returns
    -------
    LaplaceCheck
        The check, with Kish's effective share 1/(K Σ w²).
    """
    ratio = exact - approximate
    weights = np.exp(ratio - ratio.max())
    weights = weights / weights.sum()
    return LaplaceCheck(efficiency=float(1.0 / (len(weights) * np.sum(weights**2))))


def _undetermined(culprits: list[str], condition: float) -> NotConvergedError:
    """The error for parameters that the observations do not determine."""
    return NotConvergedError(
        f"the observations do not determine {', '.join(culprits)}",
        value=f"condition {condition:.1e}",
        limit=f"<= {CONDITION_LIMIT:.0e}",
        remedy="add views with other tilts and distances, declare priors, or fix a parameter",
    )


def triangular_factor(matrices: FloatArray) -> FloatArray:
    """R of ``A = QR`` for one matrix or a stack of matrices, in a fraction of the time that Q and R take together."""
    return np.asarray(np.linalg.qr(matrices, mode="r"))
