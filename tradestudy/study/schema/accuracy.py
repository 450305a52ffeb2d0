"""Tolerances of a study, the models that it forces, and how errors are propagated to depth."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated, Literal, cast

from pydantic import AfterValidator, Field, create_model

from tradestudy import accuracy, units
from tradestudy.accuracy import Quantity
from tradestudy.cameras.calibration import ONE_SIGMA, Propagation
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import ObjectDistance, PositiveDuration, Seed, Share, distinct, quantity
from tradestudy.effects import EFFECT, EFFECTS, SlotName, models_of

# A tolerance above the value itself, or below the error that any propagator states, means nothing.
Tolerance = Annotated[float, *quantity(units.FRACTION, at_least=1e-6, at_most=1.0)]


class AccuracyPart(Part):
    """The tolerance of each answer (the largest fraction by which simplifications may change it), and a time limit."""

    tolerance: Tolerance = Field(
        default=0.01, description="Default tolerance on the quantities below, except depth_noise."
    )
    depth_uncertainty: Tolerance | None = Field(
        default=None,
        description="Tolerance on depth uncertainty from noise and calibration together; default: `tolerance`.",
    )
    usable_range: Tolerance | None = Field(
        default=None, description="Tolerance on the near and far ends of the usable range; default: `tolerance`."
    )
    depth_noise: Tolerance | None = Field(
        default=None,
        description="Tolerance on depth uncertainty from noise alone; without this key, that quantity does not affect "
        "the choice of models.",
    )
    depth_of_field: Tolerance | None = Field(
        default=None, description="Tolerance on the near and far ends of the depth of field; default: `tolerance`."
    )
    pixel_intensity: Tolerance | None = Field(
        default=None,
        description="Tolerance on pixel intensities, as the relative change of a whole picture in the L2 norm; "
        "default: `tolerance`.",
    )
    psf_width: Tolerance | None = Field(
        default=None, description="Tolerance on the half-energy radius of the image of a point; default: `tolerance`."
    )
    time_limit: PositiveDuration | None = Field(
        default=None,
        description="Limit on the time of a run. One that would certainly take longer is refused before it starts; "
        "another stops at the limit and keeps what is finished. Default: none.",
    )

    def asked(self) -> accuracy.Accuracy:
        """The tolerance of each quantity for which models are chosen."""
        everywhere: tuple[Quantity, ...] = (
            "depth_uncertainty", "usable_range", "depth_of_field", "pixel_intensity", "psf_width",
        )  # fmt: skip
        declared: dict[Quantity, float | None] = {quantity: getattr(self, quantity) for quantity in everywhere}
        tolerances = {quantity: self.tolerance if value is None else value for quantity, value in declared.items()}
        if self.depth_noise is not None:
            tolerances["depth_noise"] = self.depth_noise
        return accuracy.Accuracy(
            tolerances=tolerances, time_limit=math.inf if self.time_limit is None else self.time_limit
        )


_MODELS = {
    "defocus_blur": "none (`off`), or a disc of uniform light (`disc`)",
    "main_lens_diffraction": "none (`off`); the Airy pattern of the lens in focus, convolved with the disc of defocus "
    "(`airy`); rays and the wave diffracted at the aperture's edge (`boundary_wave`, only for light spots, whose "
    "`methods` call it `boundary-wave`); Fresnel's approximation (`fresnel`); or Kirchhoff's integral, with exact path "
    "lengths (`kirchhoff`)",
    "microlens_diffraction": "as for main_lens_diffraction",
    "crosstalk": "none (`off`); the light that neighbouring microlenses add (`share`); or, for light spots, "
    "interference of the waves from all microlenses (`coherent`)",
    "pixel_integration": "one sample at the centre of each pixel (`off`), or the mean over its square active area "
    "(`square`)",
    "source_extent": "a point of light (`off`), or a disc (`disc`); only for light spots",
    "spectrum": "a single wavelength (`off`), or all wavelengths with their weights (`weighted`)",
    "vignetting": "none (`off`), or the cos⁴ law and obstruction by two equal round stops, "
    "scene.picture.stop_separation apart (`cos4`)",
    "sensor_noise": "shot noise alone (`shot`), with read noise (`shot+read`), or with read and quantisation noise "
    "(`shot+read+quantisation`)",
    "calibration": "none (`off`); propagation by the derivatives of inverse depth (`linear`); or propagation of random "
    "draws through the whole depth computation (`exact`)",
}


class _EffectsPart(Part):
    """The model of each effect.

    For every effect that the study does not name under `effects`, the program chooses the model. It refuses a model
    that applies to nothing in the study.
    """

    def forced(self) -> dict[SlotName, str]:
        """The forced models, by effect."""
        slots = cast(Iterable[SlotName], type(self).model_fields)
        return {slot: model for slot in slots if (model := getattr(self, slot)) is not None}


if TYPE_CHECKING:
    EffectsPart = _EffectsPart
else:  # one optional key for each effect
    EffectsPart = create_model(
        "EffectsPart",
        __base__=_EffectsPart,
        __doc__=_EffectsPart.__doc__,
        **{
            slot: (
                Literal[models_of(slot)] | None,
                Field(default=None, description=f"Model of {EFFECT[slot]}: {_MODELS[slot]}."),
            )
            for slot in EFFECTS
        },
    )


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
