"""What is uncertain about one camera, and how that is propagated to depth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from tradestudy.cameras.environment import Environment
from tradestudy.cameras.error_vocabulary import AGEING, ErrorVocabulary
from tradestudy.cameras.reading import Errors, Field, InverseDepthReading
from tradestudy.optics.arrays import FloatArray

if TYPE_CHECKING:  # whoever draws errors has loaded it
    from tradestudy.uncertainty.sources import Group

Reading = Callable[[FloatArray, Field, Errors, Environment | None], InverseDepthReading]
"""Inverse depths that a camera reads at true distances [m], at a place in the field, under given errors."""
PropagationModel = Literal["off", "linear", "exact"]
SourceName = Literal["errors", "target", "corners", "posterior"]
ONE_SIGMA: Final = 0.6826894921370859
"""Content of the central interval whose half width is the depth uncertainty."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """The one joint distribution of everything that is uncertain about a camera, except the noise of a measurement.

    Parameters
    ----------
    groups
        Independent groups of parameters, under the names of the camera's vocabulary (or of ``vocabulary``); what has
        aged since stands beside them with ``ageing_`` before its name, and session changes under their own names.
    environment
        How the camera answers to temperature and pressure; None: not at all.
    source
        Where the distribution comes from.
    reading
        The exact model that the parameters belong to, where the source brings its own; None: the camera's.
    vocabulary
        The parameters of that model; None: the camera's.
    inferred
        False while the posterior of a target or of corners is not known yet: then ``groups`` is empty.
    """

    groups: tuple[Group, ...] = ()
    environment: Environment | None = None
    source: SourceName = "errors"
    reading: Reading | None = None
    vocabulary: ErrorVocabulary | None = field(default=None, compare=False)
    inferred: bool = True

    def errors(self, values: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Draws by the names of the camera's model: what has aged is added to what it was."""
        found = {name: value for name, value in values.items() if not name.startswith(AGEING)}
        for name, value in values.items():
            if name.startswith(AGEING):
                base = name.removeprefix(AGEING)
                found[base] = found.get(base, np.zeros(())) + value
        return found


PERFECT: Final = Calibration()
"""Nothing is uncertain but the noise of a measurement."""


@dataclass(frozen=True, kw_only=True)
class Propagation:
    """How errors are propagated to depth.

    Parameters
    ----------
    model
        ``off``: noise alone stands for the whole. ``linear``: the covariance of all parameters through the Jacobian of
        the exact reading to inverse depth, counted in deviations of the noise, at which the ends of intervals are read.
        ``exact``: scrambled Sobol draws through the exact reading. Calibration alone is linear where it is left out of
        the whole.
    seed
        Of the draws.
    tolerance
        Relative error that the sampling of a reported half width may leave.
    max_draws
        Most draws for each camera, place in the field and way, over all scrambles.
    coverages
        Contents of the central intervals that are reported; the first is that of the depth uncertainty.
    judged
        Distances [m] at which the number of draws is settled.
    """

    model: PropagationModel = "linear"
    seed: int = 0
    tolerance: float = 0.01
    max_draws: int = 2**16
    coverages: tuple[float, ...] = (ONE_SIGMA, 0.95)
    judged: tuple[float, ...] = ()

    @property
    def probabilities(self) -> tuple[float, ...]:
        """Of the quantiles that are reported: the ends of every interval and the median, rising."""
        low = sorted((1.0 - coverage) / 2.0 for coverage in self.coverages)
        return (*low, 0.5, *(1.0 - p for p in reversed(low)))


LINEAR: Final = Propagation()
"""The cheapest way, and the default coverages."""
