"""/effects: every model of every effect, the change that it causes, and which one is applied."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import DECLARED, EXACT, Variable

_DECISION, _CHANGE = ("decision",), ("decision", "quantity")
_PROBLEM, _TOGETHER = ("problem",), ("problem", "quantity")
_HOW = "'computed', 'rule' (a closed form) or 'trial' (a more complete model at a few places)"
_KNOWN_AS = "not stored: the change includes a margin, for example for places between those examined"


def _words(dims: tuple[str, ...], long_name: str) -> Variable:
    return Variable(dims=dims, units="", long_name=long_name)


EFFECTS: Final[Mapping[str, Variable]] = {
    "problem_of": _words(_DECISION, "problem to which the model applies, by its label along 'problem'"),
    "slot": _words(_DECISION, "effect that the model describes, by its key under 'effects' in the study file"),
    "model": _words(_DECISION, "model of the effect; 'off' leaves the effect out"),
    "chosen": Variable(dims=_DECISION, units="1", long_name="whether the model is applied", error=EXACT),
    "forced": Variable(
        dims=_DECISION, units="1", long_name="whether the study file prescribes the model, under 'effects'", error=EXACT
    ),
    "reason": _words(_DECISION, "why the effect has only one model; empty where it has several"),
    "change": Variable(
        dims=_CHANGE,
        units="1",
        long_name="relative change of the quantity if this model replaces the most complete one of its effect, with "
        "the most complete models of all other effects; infinite where unknown, NaN where the problem lacks the "
        "quantity",
        error=_KNOWN_AS,
    ),
    "evidence": _words(_CHANGE, f"how 'change' is known: {_HOW}; empty where it is NaN"),
    "change_at": Variable(
        dims=_CHANGE,
        units="m",
        long_name="distance at which replacing the most complete model by this one changes the quantity most, by the "
        "amount 'change'; NaN where the quantity belongs to no distance",
        error="the spacing of the examined distances",
    ),
    "joint_change": Variable(
        dims=_TOGETHER,
        units="1",
        long_name="relative change of the quantity due to everything that the applied models leave out; "
        "infinite where unknown, NaN where the problem lacks the quantity",
        error=_KNOWN_AS,
    ),
    "joint_evidence": _words(_TOGETHER, f"how joint_change is known: {_HOW}; empty where it is NaN"),
    "forced_change": Variable(
        dims=_TOGETHER,
        units="1",
        long_name="relative change of the quantity due to the models that the study file prescribes; infinite where "
        "unknown, NaN where it prescribes none",
        error=_KNOWN_AS,
    ),
    "tolerance": Variable(
        dims=_TOGETHER,
        units="1",
        long_name="tolerance on the relative change, declared under 'accuracy'; NaN where the study does not need "
        "the quantity of this problem",
        error=DECLARED,
    ),
    "problem_title": _words(_PROBLEM, "name of the problem in figures and tables"),
    "summary": _words(_PROBLEM, "what the applied models include, and their largest omission"),
}
