"""Sources of error as tests write them."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from tradestudy.uncertainty.joint import JointNormal
from tradestudy.uncertainty.sources import ErrorClass, Sources


def of_class(sources: Sources, classes: Collection[ErrorClass]) -> Sources:
    """The same sources with only the groups of these error classes drawn."""
    return sources.only([group.name for group in sources.groups if group.error_class in classes])


def correlated_normal(
    *,
    name: str,
    parameters: tuple[str, ...],
    mean: Sequence[float],
    standard_deviation: Sequence[float],
    correlation: Sequence[Sequence[float]],
    error_class: ErrorClass,
) -> JointNormal:
    """A joint normal distribution by standard deviations and a correlation matrix."""
    covariance = np.asarray(correlation) * np.multiply.outer(standard_deviation, standard_deviation)
    return JointNormal(
        name=name, parameters=parameters, mean=np.array(mean), covariance=covariance, error_class=error_class
    )


def plain_random(dimensions, rng):
    """Independent uniform points, in the form of `scrambled_sobol`: plain Monte Carlo, to compare Sobol points with."""
    return lambda n: np.ascontiguousarray(rng.random((n, dimensions)).T)
