"""Linear propagation of the output itself, or of inverse depth with its quantiles mapped to depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.evaluation import Model, depth_from_inverse, ranked
from tradestudy.uncertainty.outputs import COVERAGE, Propagated
from tradestudy.uncertainty.sources import Sources

# Step of central differences in standard deviations: far above the rounding of the model, with a truncation error of a
# millionth of the third-order term.
_STEP = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Linear:
    """First-order estimate of each output; outputs are the last axis.

    ``estimate`` and ``standard_uncertainty`` are in the unit of the output (depth for an inverse-depth
    model); NaN where the model fails at a point of the difference quotient. ``sensitivity`` has shape
    (parameters, outputs).
    """

    estimate: FloatArray
    standard_uncertainty: FloatArray
    sensitivity: FloatArray
    inverse_estimate: FloatArray | None
    inverse_uncertainty: FloatArray | None
    evaluations: int

    @property
    def symmetric_interval(self) -> FloatArray:
        """Estimate ± 1.96 u, shape (2, outputs): the interval of a normal output."""
        half = float(ndtri(0.5 * (1.0 + COVERAGE))) * self.standard_uncertainty
        return np.stack([self.estimate - half, self.estimate + half])

    def mapped_quantiles(self, probabilities: ArrayLike) -> FloatArray:
        """Quantiles of depth from the linear model of inverse depth, shape (probabilities, outputs).

        Z_p = 1/(w₀ + Φ⁻¹(1 − p) u(w)). This is accurate where inverse depth is nearly linear in its sources and nearly
        normal, as for stereo disparity; +∞ where inverse depth is zero or negative.

        Raises
        ------
        OutOfRangeError
            The model is not one of inverse depth.
        """
        if self.inverse_estimate is None or self.inverse_uncertainty is None:
            raise OutOfRangeError(
                "quantiles mapped from inverse depth to depth",
                value="a model of the output itself",
                limit="models of inverse depth",
                remedy="propagate inverse depth, with inverse_depth=True",
            )
        score = ndtri(1.0 - np.atleast_1d(np.asarray(probabilities, float)))[:, None]
        return depth_from_inverse(self.inverse_estimate + score * self.inverse_uncertainty)


def _covariance(sources: Sources) -> FloatArray:
    covariance = sources.covariance()
    if covariance is None:
        missing = [group.name for group in sources.active_groups if group.covariance is None]
        raise OutOfRangeError(
            "linear propagation needs standard deviations",
            value=f"none for {', '.join(missing)}",
            limit="sources with a finite variance",
            remedy="use Monte Carlo, whose quantiles exist",
        )
    return covariance


def _evaluate(model: Model, sources: Sources, offsets: FloatArray) -> FloatArray:
    """Outputs (points, outputs) at nominal + offsets (points, parameters); NaN where the model fails."""
    nominal = sources.nominal()
    parameters = {name: nominal[name] + offsets[:, [k]] for k, name in enumerate(sources.parameters)}
    return ranked(model(parameters), inverse_depth=False, draws=offsets.shape[0])[0].T


def linear(model: Model, sources: Sources, *, inverse_depth: bool) -> Linear:
    """Law of propagation of uncertainty, u² = cᵀ V c, with the sensitivities c by central differences.

    Parameters
    ----------
    model : Model
        Vectorised model; it is evaluated 2 n + 1 times for n uncertain parameters (17 for eight).
    sources : Sources
        The uncertain sources; their full covariance V is used.
    inverse_depth : bool
        Whether the model returns inverse depth; the result is then that of depth, u(Z) = Z² u(w).

    Raises
    ------
    OutOfRangeError
        A source has no variance.

    Notes
    -----
    JCGM 100:2008, eq. 13. :func:`validity` judges whether the linear model is good enough.
    """
    covariance = _covariance(sources)
    deviation = np.sqrt(np.diag(covariance))
    uncertain = np.flatnonzero(deviation > 0.0)
    steps = np.zeros((uncertain.size, deviation.size))
    steps[np.arange(uncertain.size), uncertain] = _STEP * deviation[uncertain]
    offsets = np.concatenate([np.zeros((1, deviation.size)), steps, -steps])
    values = _evaluate(model, sources, offsets)
    above, below = values[1 : 1 + uncertain.size], values[1 + uncertain.size :]
    sensitivity = np.zeros((deviation.size, values.shape[1]))
    sensitivity[uncertain] = (above - below) / (2.0 * _STEP * deviation[uncertain, None])
    variance = np.einsum("ko,kl,lo->o", sensitivity, covariance, sensitivity)
    # With a correlation of ±1, rounding can make the variance slightly negative.
    estimate, uncertainty = values[0], np.sqrt(np.maximum(variance, 0.0))
    if not inverse_depth:
        return Linear(
            estimate=estimate,
            standard_uncertainty=uncertainty,
            sensitivity=sensitivity,
            inverse_estimate=None,
            inverse_uncertainty=None,
            evaluations=offsets.shape[0],
        )
    depth = depth_from_inverse(estimate)
    return Linear(
        estimate=depth,
        standard_uncertainty=depth * depth * uncertainty,
        sensitivity=-depth * depth * sensitivity,
        inverse_estimate=estimate,
        inverse_uncertainty=uncertainty,
        evaluations=offsets.shape[0],
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Validity:
    """Whether a linear 95 % interval may be used, by comparison with Monte Carlo (JCGM 101:2008, clause 8).

    For each output, ``verdict`` is ``valid``, ``invalid``, or ``undecided`` if the Monte Carlo error exceeds a fifth of
    the tolerance. ``low_difference`` and ``high_difference`` are |linear − Monte Carlo| at the ends of the interval, to
    be compared with ``tolerance``.
    """

    verdict: NDArray[np.str_]
    low_difference: FloatArray
    high_difference: FloatArray
    tolerance: FloatArray


def numerical_tolerance(standard_uncertainty: ArrayLike, significant_digits: int) -> FloatArray:
    """Half a unit in the last significant digit of u (JCGM 101:2008, 7.9.2): for u = c·10^l, δ = ½·10^l.

    Parameters
    ----------
    standard_uncertainty : array, any shape
        u [unit of the output]; zero and NaN have no digits and give zero and NaN.
    significant_digits : int
        Digits of c, usually 1 or 2.
    """
    u = np.asarray(standard_uncertainty, float)
    positive = np.where(u > 0.0, u, 1.0)
    exponent = np.floor(np.log10(positive)) - (significant_digits - 1)
    # Rounding can carry into the next power of ten: with two digits, 0.0999 is 0.10.
    carried = np.round(positive / 10.0**exponent) >= 10.0**significant_digits
    tolerance = 0.5 * 10.0 ** (exponent + carried)
    return np.where(u > 0.0, tolerance, np.where(np.isnan(u), np.nan, 0.0))


def validity(
    interval: FloatArray,
    propagated: Propagated,
    *,
    standard_uncertainty: FloatArray,
    significant_digits: int = 2,
) -> Validity:
    """Judge the ends of an analytic 95 % interval against Monte Carlo.

    Parameters
    ----------
    interval : array, shape (2, outputs)
        Ends of the linear interval, or of the interval mapped from inverse depth.
    propagated : Propagated
        Monte Carlo result for the same outputs.
    standard_uncertainty : array, shape (outputs,)
        u of the analytic method, whose last digit sets the tolerance.
    significant_digits : int
        Number of significant digits of u.
    """
    tolerance = numerical_tolerance(standard_uncertainty, significant_digits)
    reference = propagated.symmetric_interval
    both_infinite = np.isinf(interval) & np.isinf(reference)
    difference = np.zeros(reference.shape)
    np.subtract(interval, reference, out=difference, where=~both_infinite)
    difference = np.abs(difference)
    error = np.max(propagated.quantiles_error[[0, 4]], axis=0)
    worst = np.max(difference, axis=0)
    agrees = np.where(worst <= tolerance, "valid", "invalid")
    clear = (error <= tolerance / 5.0) | (worst > tolerance + 5.0 * error)
    return Validity(
        verdict=np.where(clear, agrees, "undecided"),
        low_difference=difference[0],
        high_difference=difference[1],
        tolerance=tolerance,
    )
