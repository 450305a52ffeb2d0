"""Scales of noise by restricted maximum likelihood: steps with the average information.

Whitened residuals e = M y are free of the fitted parameters: ``M = I − Q Qᵀ``, with Q an orthonormal basis of the
whitened derivatives. If a parameter of the noise changes the whitened covariance by B, then

    ∂ℓ/∂θᵢ = −½ (tr(M Bᵢ) − eᵀ Bᵢ e),    average information Iᵢⱼ = ½ eᵀ Bᵢ M Bⱼ e.

References
----------
A. R. Gilmour, R. Thompson, B. R. Cullis, "Average information REML: an efficient algorithm for variance parameter
estimation in linear mixed models", Biometrics 51 (1995) 1440.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import FloatArray

_MOST_STEPS: Final = 100
_LONGEST_STEP: Final = 1.0
_LEAST_DAMPING: Final = 1e-12


@dataclass(frozen=True, kw_only=True)
class LocalLikelihood:
    """A log likelihood at one place.

    Parameters
    ----------
    value : float
        Log likelihood.
    gradient : array (K,)
        Its first derivatives.
    information : array (K, K)
        Estimate of its negative second derivatives, positive semidefinite.
    """

    value: float
    gradient: FloatArray
    information: FloatArray


def average_information(basis: FloatArray, changed: FloatArray) -> FloatArray:
    """Sum of ½ eᵀ Bᵢ M Bⱼ e over views, for orthonormal bases Q (V, R, P) and changed residuals Bᵢ e (K, V, R)."""
    along = (np.swapaxes(basis, -1, -2) @ changed[..., None])[..., 0]
    return np.asarray(0.5 * (np.einsum("ivr,jvr->ij", changed, changed) - np.einsum("ivp,jvp->ij", along, along)))


def maximise(likelihood: Callable[[FloatArray], LocalLikelihood], start: FloatArray, settled: float) -> FloatArray:
    """The place of the largest likelihood, by steps of ``information⁻¹ gradient``, halved until the likelihood grows.

    Parameters
    ----------
    likelihood
        Log likelihood at a place (K,) of unbounded parameters on a scale of about 1.
    start : array (K,)
        The place from which to start.
    settled
        Predicted gain of the log likelihood below which a place counts as the maximum.

    Raises
    ------
    NotConvergedError
        No maximum is found.
    """
    place, here = start, likelihood(start)
    information = here.information
    for _ in range(_MOST_STEPS if np.isfinite([here.value, *here.gradient]).all() else 0):
        step = _short_step(information, here.gradient)
        while (gain := 0.5 * float(step @ here.gradient)) > settled:
            there = likelihood(place + step)
            if there.value >= here.value:
                break
            step = 0.5 * step
        if not gain > settled:
            return place
        information = _agreeing(there.information, step, here.gradient - there.gradient)
        place, here = place + step, there
    raise NotConvergedError(
        "the scales of the corners' noise do not settle",
        value=f"{_MOST_STEPS} steps",
        limit=f"a step that raises the log likelihood by less than {settled:g}",
        remedy="remove views that contradict the others",
    )


def _short_step(information: FloatArray, gradient: FloatArray) -> FloatArray:
    """The step to the maximum, damped where the likelihood is too flat to locate it (a scale close to zero)."""
    damping = _LEAST_DAMPING
    while True:
        step = np.linalg.solve(information + damping * np.eye(gradient.size), gradient)
        if np.max(np.abs(step)) <= _LONGEST_STEP:
            return np.asarray(step)
        damping *= 10.0


def _agreeing(information: FloatArray, step: FloatArray, decrease: FloatArray) -> FloatArray:
    """The information, corrected to explain by how much the gradient decreased over the last step (the BFGS rule)."""
    along = information @ step
    if not (decrease @ step > 0.0 and along @ step > 0.0):
        return information
    return np.asarray(
        information - np.outer(along, along) / (along @ step) + np.outer(decrease, decrease) / (decrease @ step)
    )
