"""How much longer pictures take just now than is predicted."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from tradestudy.study.schema.light_spot import MethodName

_TELLING: Final = 0.2  # predicted seconds from which a picture tells the pace
_UNKNOWN: Final = 2.0  # as on a machine that is in use
_LEAST: Final = 0.5  # no picture is believed to be quicker than that


@dataclass(kw_only=True)
class Pace:
    """Seconds over predicted seconds, law by law: the most of all pictures so far, for finer ones exceed it the more.

    ``first`` is that of the first picture by Kirchhoff's law, which is the coarsest.
    """

    seen: dict[MethodName, float] = field(default_factory=dict)
    first: float | None = None

    def of(self, method: MethodName) -> float:
        """That of a law; by default that of Kirchhoff's law, and where this is unknown, too, twice as predicted."""
        return self.seen.get(method, self.seen.get("kirchhoff", _UNKNOWN))

    def learn(self, method: MethodName, *, predicted: float, took: float) -> None:
        """Count one more picture; quick ones tell nothing."""
        if predicted < _TELLING:
            return
        ratio = max(took / predicted, _LEAST)
        self.seen[method] = max(ratio, self.seen.get(method, 0.0))
        if method == "kirchhoff" and self.first is None:
            self.first = ratio

    def for_others(self) -> Pace:
        """What is known of it before the first of other pictures is measured: the pace of a coarse one."""
        return Pace() if self.first is None else Pace(seen={"kirchhoff": self.first})
