"""Error sources: the uncertain parameters, their distributions, and how often they are redrawn."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Final, Protocol

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import Distribution, FloatArray, at_scores


class ErrorClass(Enum):
    """How often an error is redrawn: averaging measurements reduces only errors that are drawn per measurement."""

    RIG = "per rig"
    """One draw per built and calibrated rig: calibration."""
    SESSION = "per session"
    """One draw per time of use: temperature, pressure, drift."""
    ELEMENT = "per lens or pixel"
    """One draw per microlens or pixel: fixed pattern."""
    MEASUREMENT = "per measurement"
    """One draw per measurement: pixel noise."""


NOISE: Final = (ErrorClass.MEASUREMENT,)
"""Errors that differ from one measurement to the next."""
CALIBRATION: Final = (ErrorClass.RIG, ErrorClass.SESSION, ErrorClass.ELEMENT)
"""Errors that stay the same if a measurement is repeated at once with the same rig."""


class Group(Protocol):
    """Parameters that are drawn together; different groups are independent."""

    @property
    def name(self) -> str:
        """Name of the group."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters, in order."""

    @property
    def error_class(self) -> ErrorClass:
        """How often the group is redrawn."""

    @property
    def dimensions(self) -> int:
        """Number of independent standard normal scores per draw."""

    @property
    def nominal(self) -> FloatArray:
        """Nominal values, shape (parameters,)."""

    @property
    def covariance(self) -> FloatArray | None:
        """Covariance, shape (parameters, parameters); None if it does not exist."""

    @property
    def correlation(self) -> FloatArray:
        """Correlation of the parameters (for a copula, of their normal scores), square."""

    def draw(self, scores: FloatArray) -> FloatArray:
        """Map standard normal scores (dimensions, n) to draws (parameters, n)."""

    def marginal(self, index: int) -> Distribution:
        """Return the distribution of one parameter alone."""

    def under(self, prefix: str) -> Group:
        """Return the same group, with a prefix before its name and the names of its parameters."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """One parameter with its own, independent distribution: a group of one.

    Parameters
    ----------
    name : str
        Name of the parameter, as the model expects it.
    distribution : Distribution
        Its distribution, in SI units.
    error_class : ErrorClass
        How often it is redrawn.
    """

    name: str
    distribution: Distribution
    error_class: ErrorClass

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameter's name, as a tuple."""
        return (self.name,)

    @property
    def dimensions(self) -> int:
        """One, or zero for a constant."""
        return 0 if self.distribution.standard_deviation == 0.0 else 1

    @property
    def nominal(self) -> FloatArray:
        """The mean, or the median if there is no mean, shape (1,)."""
        mean = self.distribution.mean
        return np.array([float(self.distribution.quantile(0.5)) if mean is None else mean])

    @property
    def covariance(self) -> FloatArray | None:
        """The variance, shape (1, 1); None if it does not exist.

        Raises
        ------
        OutOfRangeError
            The square of the standard deviation underflows or overflows.
        """
        sd = self.distribution.standard_deviation
        if sd is None:
            return None
        variance = sd * sd
        if not math.isfinite(variance) or (variance == 0.0 and sd > 0.0):
            raise OutOfRangeError(
                f"a double cannot represent the square of the standard deviation of {self.name}",
                value=f"{sd:.3g}",
                limit="1e-160 to 1e150, or 0",
                remedy="state the parameter in another unit",
            )
        return np.array([[variance]])

    @property
    def correlation(self) -> FloatArray:
        """The 1 × 1 identity matrix."""
        return np.ones((1, 1))

    def draw(self, scores: FloatArray) -> FloatArray:
        """Map standard normal scores (dimensions, n) to draws (1, n)."""
        if self.dimensions == 0:
            return np.broadcast_to(self.nominal[:, None], (1, scores.shape[1]))
        return at_scores(self.distribution, scores)

    def marginal(self, index: int) -> Distribution:
        """Return the distribution itself."""
        return (self.distribution,)[index]

    def under(self, prefix: str) -> Source:
        """Return the same source, with a prefix before its name."""
        return replace(self, name=prefix + self.name)


@dataclass(frozen=True, kw_only=True)
class Sources:
    """Independent groups of parameters: all uncertain inputs of a model.

    Parameters
    ----------
    groups : tuple of Group
        The groups; parameter names and group names are unique.

    Raises
    ------
    OutOfRangeError
        A name occurs twice.
    """

    groups: tuple[Group, ...]
    _frozen: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        for what, names in (("parameter", self.parameters), ("group", tuple(g.name for g in self.groups))):
            repeated = sorted({name for name in names if names.count(name) > 1})
            if repeated:
                raise OutOfRangeError(
                    f"error sources use the same {what} name more than once",
                    value=", ".join(repeated),
                    limit="each name once",
                    remedy="rename one of them, or combine their distributions",
                )

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters, group by group."""
        return tuple(name for group in self.groups for name in group.parameters)

    @property
    def active_groups(self) -> tuple[Group, ...]:
        """The groups that are drawn; the others stay at their nominal values."""
        return tuple(group for group in self.groups if group.name not in self._frozen)

    @property
    def dimensions(self) -> int:
        """Number of independent standard normal scores per draw."""
        return sum(group.dimensions for group in self.active_groups)

    def only(self, names: Collection[str]) -> Sources:
        """Return the same sources, with only these groups drawn and all others kept at their nominal values.

        Raises
        ------
        OutOfRangeError
            One of these names belongs to no group.
        """
        declared = {group.name for group in self.groups}
        unknown = sorted(set(names) - declared)
        if unknown:
            raise OutOfRangeError(
                "no group of error sources has this name",
                value=", ".join(unknown),
                limit=", ".join(sorted(declared)),
                remedy="use one of the declared groups",
            )
        return Sources(groups=self.groups, _frozen=self._frozen | (declared - set(names)))

    def nominal(self) -> dict[str, FloatArray]:
        """Nominal value of every parameter, each of shape (1, 1)."""
        return {
            name: value.reshape(1, 1)
            for group in self.groups
            for name, value in zip(group.parameters, group.nominal, strict=True)
        }

    def draw(self, scores: FloatArray) -> dict[str, FloatArray]:
        """Map standard normal scores (dimensions, n) to draws of every parameter, each of shape (n, 1)."""
        values: dict[str, FloatArray] = {}
        first, n = 0, scores.shape[1]
        for group in self.groups:
            if group.name in self._frozen:
                drawn = np.broadcast_to(group.nominal[:, None], (len(group.parameters), n))
            else:
                drawn = group.draw(scores[first : first + group.dimensions])
                first += group.dimensions
            values |= {name: row[:, None] for name, row in zip(group.parameters, drawn, strict=True)}
        return values

    def coordinates(self) -> Mapping[str, slice]:
        """The rows of the scores that belong to each active group."""
        slices: dict[str, slice] = {}
        first = 0
        for group in self.active_groups:
            slices[group.name] = slice(first, first + group.dimensions)
            first += group.dimensions
        return slices

    def covariance(self) -> FloatArray | None:
        """Block-diagonal covariance of the active groups, zero for the others; None if a group has none."""
        total = np.zeros((len(self.parameters), len(self.parameters)))
        first = 0
        for group in self.groups:
            size = len(group.parameters)
            if group.name not in self._frozen:
                block = group.covariance
                if block is None:
                    return None
                total[first : first + size, first : first + size] = block
            first += size
        return total
