"""How errors are propagated to depth, and at which distances their sensitivities are computed."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from tradestudy import units
from tradestudy.cameras.calibration import ONE_SIGMA, Propagation
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import ObjectDistance, Seed, Share, distinct, quantity

Coverage = Annotated[float, *quantity(units.FRACTION, at_least=0.01, at_most=0.999)]
_SAME_COVERAGE = 1e-4  # of a standard deviation's, 68.27 %, which studies round to four digits


class PropagationPart(Part):
    """Field positions at which depth is computed, coverage of the depth intervals, and draws that propagate errors."""

    seed: Seed = Field(
        default=0,
        description="Seed of all random draws but those of light_spot, which has a seed of its own.",
    )
    field_places: Annotated[tuple[Share, ...], Field(max_length=10), AfterValidator(distinct)] = Field(
        default=(),
        description="Field positions at which depth is computed, besides the optical axis (0 %): fractions of the way "
        "to every corner of the sensor (100 %).",
    )
    max_draws: Annotated[int, Field(ge=2**12, le=2**26, strict=True)] = Field(
        default=2**16,
        description="Largest number of random draws for one camera, field position and error source.",
    )
    coverage: Annotated[tuple[Coverage, ...], Field(max_length=10), AfterValidator(distinct)] = Field(
        default=(0.6827, 0.95),
        description="Coverage probabilities of the depth intervals to report; 68.27 % is always reported.",
    )

    @property
    def axis_and_places(self) -> tuple[float, ...]:
        """The optical axis, and the other field positions."""
        return tuple(dict.fromkeys((0.0, *self.field_places)))

    @property
    def coverages(self) -> tuple[float, ...]:
        """Probabilities of the intervals: that of one standard deviation first, then the others, increasing."""
        others = sorted(value for value in self.coverage if abs(value - ONE_SIGMA) > _SAME_COVERAGE)
        return (ONE_SIGMA, *others)

    def propagation(self, tolerance: float) -> Propagation:
        """Settings of the propagation; ``tolerance`` is the largest relative error of depth uncertainties."""
        return Propagation(seed=self.seed, max_draws=self.max_draws, coverages=self.coverages, tolerance=tolerance)


class SensitivityPart(Part):
    """How strongly the depth that each camera measures depends on each of its error sources."""

    at: Annotated[tuple[ObjectDistance, ...], Field(min_length=1, max_length=50), AfterValidator(distinct)] = Field(
        description="Distances at which the sensitivities are computed."
    )
