"""Groups under other names, so that the errors of several cameras can stand side by side."""

from __future__ import annotations

from dataclasses import dataclass

from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.distributions import Distribution
from tradestudy.uncertainty.sources import ErrorClass, Group


@dataclass(frozen=True, kw_only=True, eq=False)
class Renamed:
    """A group whose own name and parameters carry a prefix; all else is that of the group."""

    group: Group
    prefix: str

    @property
    def name(self) -> str:
        """Prefixed name."""
        return self.prefix + self.group.name

    @property
    def parameters(self) -> tuple[str, ...]:
        """Prefixed names of the parameters."""
        return tuple(self.prefix + name for name in self.group.parameters)

    @property
    def error_class(self) -> ErrorClass:
        """As the group's."""
        return self.group.error_class

    @property
    def dimensions(self) -> int:
        """As the group's."""
        return self.group.dimensions

    @property
    def nominal(self) -> FloatArray:
        """As the group's."""
        return self.group.nominal

    @property
    def covariance(self) -> FloatArray | None:
        """As the group's."""
        return self.group.covariance

    @property
    def correlation(self) -> FloatArray:
        """As the group's."""
        return self.group.correlation

    def draw(self, scores: FloatArray) -> FloatArray:
        """As the group does."""
        return self.group.draw(scores)

    def marginal(self, index: int) -> Distribution:
        """As the group's."""
        return self.group.marginal(index)
