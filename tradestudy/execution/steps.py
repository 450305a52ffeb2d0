"""Long independent work of a study: taken up, spread over workers, kept as it finishes; how far it is, and how long."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, MutableMapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from typing import Any, Final

from tradestudy.errors import TradestudyError
from tradestudy.execution.checkpoints import Checkpoints
from tradestudy.execution.executor import Executor, LostPointError, Point, Raised, Serial, Value
from tradestudy.execution.fingerprint import environment, fingerprint

_GOLDEN: Final = (5.0**0.5 - 1.0) / 2.0

# Called with the name of a step and the share of it that is done, 0 … 1.
Progress = Callable[[str, float], None]


# Wall seconds by the name of what took them; for run.json, never for results, which two equal runs must share.
Seconds = MutableMapping[str, float]


@contextmanager
def timed(seconds: Seconds, name: str) -> Iterator[None]:
    """Add the wall time of a block under a name."""
    begin = time.perf_counter()
    yield
    seconds[name] = seconds.get(name, 0.0) + time.perf_counter() - begin


def mixed(count: int) -> list[int]:
    """An order of so many points in which every part of them comes up early, so that shares of points are of time.

    By the golden ratio: neighbours often take alike, and those that are computed first lie evenly among all.
    """
    return sorted(range(count), key=lambda k: k * _GOLDEN % 1.0)


class DeadlyPointError(TradestudyError):
    """Workers died over one point of the study again and again."""


@dataclass(frozen=True, kw_only=True)
class Steps:
    """How the independent points of a study are computed.

    Parameters
    ----------
    executor
        Where.
    checkpoints
        Where finished points are kept and looked for; None keeps nothing.
    progress
        Called with the name of a step and the share of it done.
    counts
        Takes, for each step, how many points were computed and how many were taken up from an earlier run.
    """

    executor: Executor = field(default_factory=Serial)
    checkpoints: Checkpoints | None = None
    progress: Progress = lambda _step, _share: None
    counts: dict[str, dict[str, int]] = field(default_factory=dict)

    def map(
        self,
        step: str,
        function: Callable[[Point], Value],
        points: Sequence[Point],
        labels: Sequence[str],
        efforts: Sequence[float] = (),
    ) -> list[Value]:
        """Values of a function at points, in their order.

        Parameters
        ----------
        step
            Name of the work, for progress and record.
        function
            A function of a module; its value at a point depends on nothing but the point.
        points
            Its arguments; what they say, and the code, is the key under which a value is kept.
        labels
            What a person calls each point.
        efforts
            Relative work of each point, which shares of progress are of; none: all are alike.

        Raises
        ------
        DeadlyPointError
            Workers died over one point again and again; named by its label.
        Exception
            What the first of the points that fail raises; all before it are finished then.
        """
        values: dict[int, Any] = {}
        keys: list[bytes] = []
        if self.checkpoints is not None:
            shared = fingerprint(environment(), function)
            keys = [fingerprint(shared, point) for point in points]
            values = self.checkpoints.finished(keys)
        taken = len(values)
        missing = [i for i in range(len(points)) if i not in values]
        executor = self.executor if len(missing) > 1 else Serial()  # one point alone is nothing to spread
        failed: dict[int, Exception] = {}
        work = efforts or [1.0] * len(points)

        def tell() -> None:
            self.progress(step, math.fsum(work[i] for i in values) / max(math.fsum(work), 1.0))

        tell()
        try:
            with closing(executor.map_unordered(function, [points[i] for i in missing])) as found:
                for number, outcome in found:
                    place = missing[number]
                    if isinstance(outcome, Raised):
                        failed[place] = outcome.error
                    else:
                        values[place] = outcome
                        if self.checkpoints is not None:
                            self.checkpoints.add(keys[place], outcome)
                        tell()
                    if failed and all(i in values for i in missing if i < min(failed)):
                        raise failed[min(failed)]
        except LostPointError as lost:
            raise DeadlyPointError(
                f"{lost.deaths} workers died one after another over one point of {step}",
                value=labels[missing[lost.index]],
                remedy="what is finished is kept; look for what ends them, such as too little memory",
            ) from lost
        finally:
            before = self.counts.get(step, {"computed": 0, "taken up": 0})  # a step may compute in several goes
            now = {"computed": len(values) - taken, "taken up": taken}
            self.counts[step] = {name: before[name] + now[name] for name in now}
        return [values[i] for i in range(len(points))]
