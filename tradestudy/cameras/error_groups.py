"""Errors of a camera as the groups that are drawn together."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from tradestudy.cameras.depth_camera import ErrorSource
from tradestudy.uncertainty.distributions import Distribution, Normal, Uniform
from tradestudy.uncertainty.error_class import ErrorClass
from tradestudy.uncertainty.joint import GaussianCopula
from tradestudy.uncertainty.sources import Group, Source


def centred(source: ErrorSource, share: float = 1.0) -> Distribution:
    """The distribution of a share of an error about zero."""
    deviation = share * source.standard_deviation
    if source.shape == "uniform":
        return Uniform(low=-math.sqrt(3.0) * deviation, high=math.sqrt(3.0) * deviation)
    return Normal(mean=0.0, standard_deviation=deviation)


def per_rig(name: str, source: ErrorSource) -> Iterator[Source]:
    """An error that is drawn once for each rig; nothing for one of no spread."""
    if source.standard_deviation > 0.0:
        yield Source(name=name, distribution=centred(source), error_class=ErrorClass.RIG)


def tied(name: str, parameters: tuple[str, str], marginal: Distribution, correlation: float) -> Group:
    """Two parameters of one distribution that move together (correlation 1) or apart (−1), once for each rig."""
    return GaussianCopula(
        name=name,
        parameters=parameters,
        marginals=(marginal, marginal),
        correlation=np.array([[1.0, correlation], [correlation, 1.0]]),
        error_class=ErrorClass.RIG,
    )


def measurement_noise(name: str, deviation: float) -> Source:
    """Normal noise that is drawn anew for every measurement."""
    noise = Normal(mean=0.0, standard_deviation=deviation)
    return Source(name=name, distribution=noise, error_class=ErrorClass.MEASUREMENT)
