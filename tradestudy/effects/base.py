"""Effects are slots: of each, exactly one model acts, and "off" is a model like the others.

Every model says beforehand, without any simulation, how far a quantity can move at most if the model is used in place
of the dearest one of its slot, and what it will cost. `tradestudy.effects.selection` chooses from that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

from tradestudy.accuracy import Quantity
from tradestudy.errors import OutOfRangeError

SlotName = Literal[
    "defocus_blur",
    "main_lens_diffraction",
    "microlens_diffraction",
    "crosstalk",
    "pixel_integration",
    "source_extent",
    "spectrum",
    "vignetting",
    "sensor_noise",
    "calibration",
    "sampling",
]
OFF: Final = "off"
NOTHING_LEFT_OUT: Final = "nothing is left out"


@dataclass(frozen=True, kw_only=True)
class EffectCriterion:
    """The number that tells how strong an effect is.

    Parameters
    ----------
    words
        What it is, in words: "blur over pixel", "Fresnel number of the pupil from the array".
    definition
        Its formula, with the symbols explained, so that a reader can compute it; empty only of that of `COMPLETE`.
    value
        Its value at the worst place of the study; NaN where the effect has none.
    at
        Distance at which it is the worst [m]; NaN where it belongs to no distance.
    """

    words: str
    definition: str
    value: float
    at: float = math.nan


@dataclass(frozen=True, kw_only=True)
class Bound:
    """How far a quantity moves at most if a model stands in for the dearest model of its slot.

    Parameters
    ----------
    relative_change
        Upper bound on |with this model − with the dearest| / with the dearest; infinite where none can be stated.
    criterion
        The number that it follows from.
    reason
        One sentence that lets an expert agree or disagree: the rule by which the number decides, whatever it decides.

    Raises
    ------
    OutOfRangeError
        If the bound is negative or no number.
    """

    relative_change: float
    criterion: EffectCriterion
    reason: str

    def __post_init__(self) -> None:
        if not self.relative_change >= 0.0:
            raise OutOfRangeError("bound of an effect", value=f"{self.relative_change:g}", limit="≥ 0 or infinite")


COMPLETE: Final = Bound(
    relative_change=0.0,
    criterion=EffectCriterion(words="left out", definition="", value=0.0),
    reason=NOTHING_LEFT_OUT,
)


@dataclass(frozen=True, kw_only=True)
class Model:
    """One way to treat an effect.

    Parameters
    ----------
    name
        Unique in its slot; ``off`` leaves the effect out.
    bounds
        For each quantity that the study asks for; one that is missing is not touched by the slot at all.
    seconds
        Predicted cost of having it on this machine [s].
    """

    name: str
    bounds: Mapping[Quantity, Bound]
    seconds: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.seconds < math.inf:
            raise OutOfRangeError(f"predicted cost of {self.name}", value=f"{self.seconds:g} s", limit="≥ 0 s, finite")

    def change_of(self, quantity: Quantity) -> float:
        """Bound on the relative change of one quantity; 0 where it is not touched."""
        bound = self.bounds.get(quantity)
        return 0.0 if bound is None else bound.relative_change


@dataclass(frozen=True, kw_only=True)
class Slot:
    """An effect and the models that may stand for it, from the simplest to the most complete.

    Raises
    ------
    OutOfRangeError
        If there is no model, or two have one name.
    """

    name: SlotName
    models: tuple[Model, ...]

    def __post_init__(self) -> None:
        names = self.model_names
        if not names or len(set(names)) < len(names):
            raise OutOfRangeError(f"models of {self.name}", value=", ".join(names), limit="one or more, all different")

    @property
    def model_names(self) -> tuple[str, ...]:
        """From the simplest to the most complete."""
        return tuple(model.name for model in self.models)

    def model(self, name: str) -> Model:
        """The model of a name.

        Raises
        ------
        OutOfRangeError
            If the slot has none of that name.
        """
        for model in self.models:
            if model.name == name:
                return model
        raise OutOfRangeError(f"model of {self.name}", value=name, limit=" | ".join(self.model_names))
