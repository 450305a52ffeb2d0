"""How accurate a study wants its answers, how long they may take, and which models it insists on."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Literal, cast

from pydantic import Field

from tradestudy import accuracy, units
from tradestudy.accuracy import QUANTITIES, Quantity
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import PositiveDuration, quantity
from tradestudy.effects.base import SlotName

# Beyond the whole of a value, or below what any propagator states, an accuracy says nothing.
RelativeError = Annotated[float, *quantity(units.FRACTION, at_least=1e-6, at_most=1.0)]


class AccuracyPart(Part):
    """Relative errors that simplifications may make, and the time that all may take."""

    tolerance: RelativeError = Field(default=0.01, description="For every quantity that is not named itself.")
    depth_uncertainty: RelativeError | None = None
    depth_of_field: RelativeError | None = Field(default=None, description="Of its near and far ends.")
    pixel_intensity: RelativeError | None = Field(default=None, description="L2 over the pixels of a picture.")
    psf_width: RelativeError | None = Field(default=None, description="Of the width of a point's image.")
    time_limit: PositiveDuration | None = Field(
        default=None, description="Of the whole run; default: as long as it takes."
    )

    def wanted(self) -> accuracy.Accuracy:
        """The accuracy of every quantity."""
        own: dict[Quantity, float | None] = {name: getattr(self, name) for name in QUANTITIES}
        return accuracy.Accuracy(
            relative={name: self.tolerance if value is None else value for name, value in own.items()},
            budget=math.inf if self.time_limit is None else self.time_limit,
        )


class EffectsPart(Part):
    """Models that stand whatever the selection would choose; each replaces the choice of its slot."""

    defocus_blur: Literal["off", "disc"] | None = None
    main_lens_diffraction: Literal["off", "airy", "boundary_wave", "fresnel", "kirchhoff"] | None = None
    microlens_diffraction: Literal["off", "airy", "boundary_wave", "fresnel", "kirchhoff"] | None = None
    crosstalk: Literal["off", "share", "coherent"] | None = None
    pixel_integration: Literal["off", "square"] | None = None
    source_extent: Literal["off", "disc"] | None = None
    spectrum: Literal["off", "weighted"] | None = None
    vignetting: Literal["off", "cos4"] | None = None
    sensor_noise: Literal["off", "shot", "shot+read", "shot+read+quantisation"] | None = None
    calibration: Literal["off", "linear", "exact"] | None = None

    def forced(self) -> dict[SlotName, str]:
        """The models that the study insists on, by slot."""
        slots = cast(Iterable[SlotName], type(self).model_fields)
        return {slot: name for slot in slots if (name := getattr(self, slot)) is not None}
