"""The uncertainty of one camera's calibration, and how it is propagated to depth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Literal, Protocol, Self

import numpy as np

from tradestudy.cameras.calibrated_pair import CalibratedPair
from tradestudy.cameras.depth_measurement import (
    AGEING,
    Environment,
    Errors,
    ErrorVocabulary,
    Field,
    MeasuredInverseDepth,
)
from tradestudy.optics.arrays import FloatArray

if TYPE_CHECKING:  # loaded only where errors are drawn
    from tradestudy.uncertainty.sources import Group

DepthMeasurement = Callable[[FloatArray, Field, Errors, Environment | None], MeasuredInverseDepth]
"""Inverse depths that a camera with given errors measures at true distances [m] and a field position."""
PropagationModel = Literal["off", "linear", "exact"]
SourceName = Literal["errors", "target", "corners", "posterior"]
ONE_SIGMA: Final = 0.6826894921370859
"""Coverage of the central interval whose half-width is the depth uncertainty."""


class CalibratedMeasurement(Protocol):
    """The exact model of a calibrated pair of cameras: a `DepthMeasurement` that also describes the pair."""

    @property
    def pair(self) -> CalibratedPair:
        """The calibrated pair."""

    def __call__(
        self, distance: FloatArray, field: Field, errors: Errors, environment: Environment | None, /
    ) -> MeasuredInverseDepth:
        """See `DepthMeasurement`."""

    def shared_area(self, distance: FloatArray) -> FloatArray:
        """Overlap of the pictures at distances [m]: the smaller of the shares of their areas that both cameras see."""

    def disparity_px(self, distance: FloatArray) -> FloatArray:
        """Disparity [px] of points midway between the cameras at distances [m]: the difference of their x coordinates.

        Each is measured from the principal point of its camera, along the rows of its own picture, and scaled to the
        `common_focal_length` if the cameras have different ones; infinity is allowed.
        """

    def cropped(self, columns: int, rows: int) -> Self:
        """The same pair with only the middle of its pictures, so many pixels wide and high."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """The joint distribution of all that is uncertain about a camera, except the noise of its measurements.

    Parameters
    ----------
    groups
        Independent groups of parameters, named as in the camera's vocabulary (or in ``vocabulary``). The ageing of a
        parameter since the calibration has the prefix ``ageing_``; session changes have names of their own.
    environment
        How the camera responds to temperature and pressure; None if it does not.
    source
        Source of the distribution.
    measurement
        The exact model to which the parameters belong, if the source has its own; None for the camera's model.
    vocabulary
        The parameters of that model; None for those of the camera.
    remark
        How the source was read, if the user should know.
    inferred
        False until the posterior of a target or of corners is known; until then, ``groups`` is empty.
    """

    groups: tuple[Group, ...] = ()
    environment: Environment | None = None
    source: SourceName = "errors"
    measurement: CalibratedMeasurement | None = None
    vocabulary: ErrorVocabulary | None = field(default=None, compare=False)
    remark: str = ""
    inferred: bool = True

    @property
    def means(self) -> dict[str, float]:
        """Mean of every parameter, by name."""
        return {
            name: float(mean)
            for group in self.groups
            for name, mean in zip(group.parameters, group.nominal, strict=True)
        }

    def errors(self, values: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Errors by the parameter names of the camera's model, from draws in which ageing is separate."""
        errors = {name: value for name, value in values.items() if not name.startswith(AGEING)}
        for name, value in values.items():
            if name.startswith(AGEING):
                base = name.removeprefix(AGEING)
                errors[base] = errors.get(base, np.zeros(())) + value
        return errors


PERFECT: Final = Calibration()
"""A calibration without errors: only measurement noise is uncertain."""


@dataclass(frozen=True, kw_only=True)
class Propagation:
    """How errors are propagated to depth.

    Parameters
    ----------
    model
        ``off``: the total uncertainty is that of noise alone. ``linear``: the Jacobian of the exact model propagates
        the covariance of all parameters to inverse depth; the ratio of the resulting standard deviation to that due to
        noise alone scales the noise for which the ends of intervals are computed. ``exact``: scrambled Sobol draws are
        propagated by the exact model. With ``off``, the uncertainty due to calibration alone is computed linearly.
    seed
        Seed of the draws.
    tolerance
        Relative sampling error allowed in a reported half-width.
    max_draws
        Largest number of draws over all scrambles, for each camera, field position and error source.
    coverages
        Coverage of the central intervals that are reported; the first is that of the depth uncertainty.
    judged
        Distances [m] at which the sampling error decides the number of draws.
    """

    model: PropagationModel = "linear"
    seed: int = 0
    tolerance: float = 0.01
    max_draws: int = 2**16
    coverages: tuple[float, ...] = (ONE_SIGMA, 0.95)
    judged: tuple[float, ...] = ()

    @property
    def probabilities(self) -> tuple[float, ...]:
        """Probabilities of the reported quantiles: the ends of every interval and the median, in ascending order."""
        low = sorted((1.0 - coverage) / 2.0 for coverage in self.coverages)
        return (*low, 0.5, *(1.0 - p for p in reversed(low)))


LINEAR: Final = Propagation()
"""Propagation off, with default coverages."""
