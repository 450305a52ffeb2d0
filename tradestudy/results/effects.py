"""/effects: every model of every effect, what it changes, and which one acts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import Variable

_DECISION, _CHANGE = ("decision",), ("decision", "quantity")
_PIECE, _TOGETHER = ("piece",), ("piece", "quantity")
_HOW = "computed, rule (a closed rule, with a margin) or trial (a more expensive model at a few places, with a margin)"
_KNOWN_AS = "as its evidence says: computed with a margin for the places between, a bound, or a trial with a margin"


def _words(dims: tuple[str, ...], long_name: str) -> Variable:
    return Variable(dims=dims, units="", long_name=long_name)


EFFECTS: Final[Mapping[str, Variable]] = {
    "situation": _words(_DECISION, "camera, lens or light path the model belongs to, by its name in piece"),
    "slot": _words(_DECISION, "effect"),
    "model": _words(_DECISION, "way to treat the effect; off leaves it out"),
    "chosen": Variable(dims=_DECISION, units="1", long_name="whether it acts", error="exact"),
    "forced": Variable(dims=_DECISION, units="1", long_name="whether the study names the model", error="exact"),
    "reason": _words(_DECISION, "why the effect has one model alone; empty where there is a choice"),
    "change": Variable(
        dims=_CHANGE,
        units="1",
        long_name="relative change of a quantity by this model alone, beside the most complete models of the others; "
        "NaN for quantities that the piece does not have, infinite where none is known",
        error=_KNOWN_AS,
    ),
    "evidence": _words(_CHANGE, f"how that is known: {_HOW}"),
    "change_at": Variable(
        dims=_CHANGE,
        units="m",
        long_name="distance at which the change is the largest; NaN where it belongs to none",
        error="one of the distances that were looked at",
    ),
    "joint_change": Variable(
        dims=_TOGETHER,
        units="1",
        long_name="relative change of a quantity by all that the acting models leave out together; "
        "NaN for quantities that the piece does not have, infinite where it is not known",
        error=_KNOWN_AS,
    ),
    "joint_evidence": _words(_TOGETHER, f"how that is known: {_HOW}"),
    "forced_change": Variable(
        dims=_TOGETHER,
        units="1",
        long_name="relative change of a quantity by the models that the study names; NaN where it names none, "
        "infinite where it is not known",
        error=_KNOWN_AS,
    ),
    "tolerance": Variable(
        dims=_TOGETHER,
        units="1",
        long_name="relative change that the study allows; NaN where it does not ask for the quantity",
        error="declared",
    ),
    "piece_title": _words(_PIECE, "the camera, lens or light path in words"),
    "summary": _words(_PIECE, "what is simulated, and the largest thing left out, in one line"),
}
