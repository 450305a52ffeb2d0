"""What tolerance a study asks for, how long a run may take, and which models it insists on."""

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

# Beyond the whole of a value, or below what any propagator states, a tolerance says nothing.
Tolerance = Annotated[float, *quantity(units.FRACTION, at_least=1e-6, at_most=1.0)]


class AccuracyPart(Part):
    """Relative changes that simplifications may make, and the time that a run may take."""

    tolerance: Tolerance = Field(default=0.01, description="For every quantity that is not named itself.")
    depth_uncertainty: Tolerance | None = Field(default=None, description="Noise and calibration together.")
    usable_range: Tolerance | None = Field(default=None, description="Of its near and far ends.")
    depth_noise: Tolerance | None = Field(
        default=None, description="Of the uncertainty by noise alone; decides nothing unless it is named."
    )
    depth_of_field: Tolerance | None = Field(default=None, description="Of its near and far ends.")
    pixel_intensity: Tolerance | None = Field(default=None, description="L2 over the pixels of a picture.")
    psf_width: Tolerance | None = Field(default=None, description="Of the width of a point's image.")
    time_limit: PositiveDuration | None = Field(
        default=None, description="Of the whole run; default: as long as it takes."
    )

    def asked(self) -> accuracy.Accuracy:
        """The tolerance of every quantity that counts."""
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
    """Models that stand whatever the choice would be; each replaces the choice of its effect."""

    def forced(self) -> dict[SlotName, str]:
        """The models that the study insists on, by effect."""
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
