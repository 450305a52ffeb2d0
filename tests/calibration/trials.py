"""One synthetic calibration whose truth is known: where the truth ranks among the draws that were inferred."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tradestudy.calibration.camera_target import TargetProblem, fit_target, sample_target
from tradestudy.calibration.synthetic_target import CameraModel, Priors, SyntheticTarget, observe_target
from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import FloatArray

DepthMeasurement = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""Takes the true parameters (P,), draws (K, P) and true depths (D,) [m]; returns the depths (K, D) that the
draws read."""


@dataclass(frozen=True, kw_only=True)
class CalibrationTrial:
    """A calibration to be repeated with truths from its prior.

    Parameters
    ----------
    target : SyntheticTarget
        What is shown to the camera.
    model : CameraModel
        The camera.
    priors : Priors
        Where truths come from, and what the inference supposes.
    measurement : DepthMeasurement
        Depths read with drawn parameters of what the true camera sees.
    distances : array (D,)
        True depths [m].
    draws : int
        Draws per calibration.
    """

    target: SyntheticTarget
    model: CameraModel
    priors: Priors
    measurement: DepthMeasurement
    distances: FloatArray
    draws: int = 1000

    def by_laplace(self, rng: np.random.Generator) -> FloatArray:
        """Shares of draws of the Laplace fit below the truth: depths, then parameters, shape (D + P,).

        Parameters
        ----------
        rng : numpy.random.Generator
            Randomness of truth, noise and draws.
        """
        truth, problem = self.observe(rng)
        return self._shares(truth, fit_target(problem).laplace.draw(rng, self.draws))

    def by_sampling(self, rng: np.random.Generator) -> FloatArray:
        """Shares of posterior draws below the truth: depths, then parameters, shape (D + P,).

        Parameters
        ----------
        rng : numpy.random.Generator
            Randomness of truth, noise and chains.

        Raises
        ------
        NotConvergedError
            The chains did not converge, or the poses cannot be marginalised by Laplace.
        """
        truth, problem = self.observe(rng)
        posterior = sample_target(problem, fit_target(problem), rng=rng)
        if not posterior.converged:
            raise NotConvergedError(
                "the posterior of a synthetic calibration did not converge",
                value="; ".join(posterior.sample.diagnostics.failures)
                or f"efficiency {posterior.check.efficiency:.2f}",
                limit="all limits met",
                remedy="allow more steps",
            )
        return self._shares(truth, posterior.sample.thinned(self.draws))

    def observe(self, rng: np.random.Generator) -> tuple[FloatArray, TargetProblem]:
        """A truth from the prior, and the problem of inferring it."""
        truth = self.priors.draw(rng, 1)[0]
        observed = observe_target(self.target, self.model, truth, rng)
        return truth, TargetProblem(observed=observed, target=self.target, model=self.model, priors=self.priors)

    def _shares(self, truth: FloatArray, draws: FloatArray) -> FloatArray:
        """Share of draws below the truth for each depth and each parameter."""
        depths = self.measurement(truth, draws, self.distances)
        if np.any(np.isnan(depths)):
            raise NotConvergedError(
                "draws of a synthetic calibration read no depth",
                value=f"{int(np.isnan(depths).sum())} of {depths.size}",
                limit="none, or their ranks mean nothing",
                remedy="narrow the priors, or leave out distances outside the field",
            )
        shares: FloatArray = np.concatenate([(depths < self.distances).mean(axis=0), (draws < truth).mean(axis=0)])
        return shares


def normal_priors(names: tuple[str, ...], mean: FloatArray, standard_deviation: FloatArray) -> Priors:
    """Normal priors without bounds.

    Parameters
    ----------
    names : tuple of str
        Parameters.
    mean, standard_deviation : array (P,)
        Centres and standard deviations.
    """
    everywhere = np.full(len(names), np.inf)
    return Priors(names=names, mean=mean, standard_deviation=standard_deviation, lower=-everywhere, upper=everywhere)
