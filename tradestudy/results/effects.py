"""/effects: every model of every effect, the change that it causes, and which one is applied."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import Variable

_DECISION, _CHANGE = ("decision",), ("decision", "quantity")
_PROBLEM, _TOGETHER = ("problem",), ("problem", "quantity")
_HOW = "'computed', 'rule' (a closed form) or 'trial' (a more expensive model at a few places)"
_KNOWN_AS = "an upper estimate: the change includes a margin, for example for places between those examined"


def _words(dims: tuple[str, ...], long_name: str) -> Variable:
    return Variable(dims=dims, units="", long_name=long_name)


EFFECTS: Final[Mapping[str, Variable]] = {
    "problem_of": _words(
        _DECISION, "camera, lens or light path to which the model belongs, by its name along the dimension 'problem'"
    ),
    "slot": _words(_DECISION, "effect that the model describes"),
    "model": _words(_DECISION, "model of the effect; 'off' leaves the effect out"),
    "chosen": Variable(dims=_DECISION, units="1", long_name="whether the model is applied", error="exact"),
    "forced": Variable(dims=_DECISION, units="1", long_name="whether the study forces the model", error="exact"),
    "reason": _words(_DECISION, "why the effect has a single model; empty where there is a choice"),
    "change": Variable(
        dims=_CHANGE,
        units="1",
        long_name="relative change of a quantity when this model replaces the most complete model of its effect, and "
        "all other effects keep theirs; NaN for quantities that do not apply, infinite where the change is unknown",
        error=_KNOWN_AS,
    ),
    "evidence": _words(_CHANGE, f"how the change is known: {_HOW}"),
    "change_at": Variable(
        dims=_CHANGE,
        units="m",
        long_name="distance at which the change is largest; NaN where no distance applies",
        error="the spacing of the examined distances",
    ),
    "joint_change": Variable(
        dims=_TOGETHER,
        units="1",
        long_name="relative change of a quantity due to everything that the applied models leave out together; "
        "NaN for quantities that do not apply, infinite where the change is unknown",
        error=_KNOWN_AS,
    ),
    "joint_evidence": _words(_TOGETHER, f"how the joint change is known: {_HOW}"),
    "forced_change": Variable(
        dims=_TOGETHER,
        units="1",
        long_name="relative change of a quantity due to the models that the study forces; NaN where it forces none, "
        "infinite where the change is unknown",
        error=_KNOWN_AS,
    ),
    "tolerance": Variable(
        dims=_TOGETHER,
        units="1",
        long_name="tolerance on the relative change; NaN where the study does not ask for the quantity",
        error="none: declared",
    ),
    "problem_title": _words(_PROBLEM, "the camera, lens or light path in words"),
    "summary": _words(_PROBLEM, "what is simulated, and the largest omission, in one line"),
}
