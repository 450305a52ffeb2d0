"""A camera with everything that is uncertain about it, ready to be propagated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tradestudy.calibration.renamed import Renamed
from tradestudy.calibration.sources import SEPARATOR
from tradestudy.cameras.reading import SESSION_CHANGES, Errors, InverseDepthReading
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.evaluation import Model, Outcome
from tradestudy.uncertainty.sources import Group, Sources


class Reading(Protocol):
    """Inverse depths that a camera reads at true distances [m], at a place in the field, under given errors."""

    def __call__(self, distance: FloatArray, field: float, errors: Errors) -> InverseDepthReading:
        """Read."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class UncertainCamera:
    """One camera of the study with its errors.

    Parameters
    ----------
    name
        Its key in the study.
    reading
        Its exact model.
    groups
        Its own errors, under the names of its model.
    surroundings
        Errors that it shares with the other cameras.
    """

    name: str
    reading: Reading
    groups: tuple[Group, ...]
    surroundings: tuple[Group, ...]

    @property
    def sources(self) -> Sources:
        """Everything uncertain about it, its own errors with its name before theirs."""
        return sources_of(self)

    def model(self, distance: FloatArray, field: float, scaled: Mapping[str, float] | None = None) -> Model:
        """The engine's model at distances [m]; ``scaled`` multiplies the draws of some of its errors."""
        own = tuple(name for group in self.groups for name in group.parameters)
        factors = scaled or {}

        def evaluate(values: Mapping[str, FloatArray]) -> Outcome:
            errors = {name: values[self.name + SEPARATOR + name] * factors.get(name, 1.0) for name in own}
            errors |= {name: values[name] for name in SESSION_CHANGES if name in values}
            found = self.reading(distance, field, errors)
            shape = (len(next(iter(values.values()))), distance.size)
            return Outcome(
                values=np.broadcast_to(found.inverse_depth, shape),
                no_overlap=found.no_overlap,
                out_of_range=found.out_of_range,
            )

        return evaluate


def sources_of(*cameras: UncertainCamera) -> Sources:
    """The errors of several cameras together; what they share stands once."""
    shared = {group.name: group for camera in cameras for group in camera.surroundings}
    own = tuple(Renamed(group=group, prefix=camera.name + SEPARATOR) for camera in cameras for group in camera.groups)
    return Sources(groups=(*own, *shared.values()))


def short_name(name: str) -> str:
    """The name of a group or parameter without its camera."""
    return name.rpartition(SEPARATOR)[2]
