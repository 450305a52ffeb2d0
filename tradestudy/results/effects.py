"""/effects: every model that was weighed, what it may change at most, what it costs, and what became of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import Variable

TIMES_WITH_A_MODEL: Final = (
    "predicted on the reference machine for all models that act in the piece, with this one in its slot; where it "
    "cannot stand beside the others, with the cheapest change of one more"
)
OF_NOISE_ALONE: Final = (
    "Bounds on the depth uncertainty hold for what noise alone makes of it, too, which is shown by itself, however "
    "large the errors of calibration are: where these are the larger part, the whole moves by less."
)
WHERE_NUMBERS_ARE_TAKEN: Final = (
    "A distance behind a number is where it is the worst, under every reading, at every design of the "
    "sweep (at 64 of them where there are more) and at five values of what an inverse question varies: of usable "
    "distances, or of all for a camera that is usable nowhere, and a tenth beyond them where the disparity error is "
    "derived from the picture; usable or not, also of those that decision.at, solve and requirements ask for. Where "
    "none stands, the number is the same at all or belongs to none."
)
EFFECTS: Final[Mapping[str, Variable]] = {
    "situation": Variable(dims=("decision",), units="", long_name="camera, lens or light path the model belongs to"),
    "slot": Variable(dims=("decision",), units="", long_name="effect"),
    "model": Variable(dims=("decision",), units="", long_name="way to treat the effect; off leaves it out"),
    "chosen": Variable(dims=("decision",), units="1", long_name="whether it acts", error="exact"),
    "forced": Variable(dims=("decision",), units="1", long_name="whether the study insists on it", error="exact"),
    "bound": Variable(
        dims=("decision", "quantity"),
        units="1",
        long_name="upper bound on the relative change of a quantity if the model stands in for the most complete one; "
        "NaN where the quantity is not asked for; infinite where none can be stated",
        error="it is a bound",
    ),
    "criterion": Variable(dims=("decision",), units="", long_name="number that the bound follows from"),
    "definition": Variable(dims=("decision",), units="", long_name="formula of that number"),
    "number": Variable(
        dims=("decision",),
        units="1",
        long_name="its value at the worst place of the study; NaN where the effect has none, infinite where nothing "
        "of the kind is there to divide by",
        error="closed form; of light paths from sampled rays, a mean over some hundreds to thousands of them",
    ),
    "number_at": Variable(
        dims=("decision",),
        units="m",
        long_name="distance at which the number is the worst; NaN where it belongs to none",
        error="one of the distances that are looked at",
    ),
    "reason": Variable(dims=("decision",), units="", long_name="why the bound holds"),
    "why": Variable(dims=("decision",), units="", long_name="why the model was taken or not"),
    "predicted_seconds": Variable(
        dims=("decision",),
        units="s",
        long_name=f"cost {TIMES_WITH_A_MODEL}; infinite where nothing can be combined with it",
        error="a factor of 2",
    ),
    "joint_bound": Variable(
        dims=("piece", "quantity"),
        units="1",
        long_name="sum of the bounds of the models that act; NaN where the quantity is not asked for",
        error="it is a bound",
    ),
    "wanted": Variable(
        dims=("piece", "quantity"),
        units="1",
        long_name="relative error that the study allows; NaN where the quantity is not asked for",
        error="declared",
    ),
    "piece_title": Variable(dims=("piece",), units="", long_name="the camera, lens or light path in words"),
    "piece_seconds": Variable(
        dims=("piece",),
        units="s",
        long_name="predicted cost of the models that act, on the reference machine",
        error="a factor of 2",
    ),
}
