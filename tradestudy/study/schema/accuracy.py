"""Tolerances of a study, the time limit of its run, and the models that it forces."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated, Literal, cast

from pydantic import Field, create_model

from tradestudy import accuracy, units
from tradestudy.accuracy import Quantity
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import PositiveDuration, quantity
from tradestudy.effects.models import EFFECTS, SlotName, models_of
from tradestudy.effects.words import EFFECT

# A tolerance above the value itself, or below the error that any propagator states, means nothing.
Tolerance = Annotated[float, *quantity(units.FRACTION, at_least=1e-6, at_most=1.0)]


class AccuracyPart(Part):
    """Largest relative changes that simplifications may cause, and the time limit of a run."""

    tolerance: Tolerance = Field(
        default=0.01, description="Tolerance on every quantity without a tolerance of its own."
    )
    depth_uncertainty: Tolerance | None = Field(
        default=None, description="Tolerance on depth uncertainty from noise and calibration together."
    )
    usable_range: Tolerance | None = Field(
        default=None, description="Tolerance on the near and far ends of the usable range."
    )
    depth_noise: Tolerance | None = Field(
        default=None, description="Tolerance on depth uncertainty from noise alone; ignored unless given."
    )
    depth_of_field: Tolerance | None = Field(
        default=None, description="Tolerance on the near and far ends of the depth of field."
    )
    pixel_intensity: Tolerance | None = Field(
        default=None, description="Tolerance on pixel intensity: L2 norm over the pixels of a picture."
    )
    psf_width: Tolerance | None = Field(default=None, description="Tolerance on the width of a point's image.")
    time_limit: PositiveDuration | None = Field(default=None, description="Time limit of the whole run; default: none.")

    def asked(self) -> accuracy.Accuracy:
        """The tolerance of each quantity for which models are chosen."""
        everywhere: tuple[Quantity, ...] = (
            "depth_uncertainty", "usable_range", "depth_of_field", "pixel_intensity", "psf_width",
        )  # fmt: skip
        own: dict[Quantity, float | None] = {name: getattr(self, name) for name in everywhere}
        tolerances = {name: self.tolerance if value is None else value for name, value in own.items()}
        if self.depth_noise is not None:
            tolerances["depth_noise"] = self.depth_noise
        return accuracy.Accuracy(
            tolerances=tolerances, time_limit=math.inf if self.time_limit is None else self.time_limit
        )


class _EffectsPart(Part):
    """Forced models: each replaces the automatic choice for its effect."""

    def forced(self) -> dict[SlotName, str]:
        """The forced models, by effect."""
        slots = cast(Iterable[SlotName], type(self).model_fields)
        return {slot: name for slot in slots if (name := getattr(self, slot)) is not None}


if TYPE_CHECKING:
    EffectsPart = _EffectsPart
else:  # one optional key for each effect
    EffectsPart = create_model(
        "EffectsPart",
        __base__=_EffectsPart,
        __doc__=_EffectsPart.__doc__,
        **{
            slot: (Literal[models_of(slot)] | None, Field(default=None, description=f"Model of {EFFECT[slot]}."))
            for slot in EFFECTS
        },
    )
