"""Long steps of a study, made of independent points: resumed, spread over workers, saved and timed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, MutableMapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Final, get_origin, get_type_hints

from tradestudy.errors import TradestudyError, UnaffordableError
from tradestudy.execution.checkpoints import Checkpoints
from tradestudy.execution.executor import Executor, LostPointError, Point, Raised, Serial, Value
from tradestudy.execution.fingerprint import environment, fingerprint
from tradestudy.execution.point_progress import heard_by

_GOLDEN: Final = (5.0**0.5 - 1.0) / 2.0

# Called with the name of a step and the fraction of it that is done, from 0 to 1.
Progress = Callable[[str, float], None]

# Wall time [s] by name of the task; for run.json, never for results, which must be equal for equal runs.
Seconds = MutableMapping[str, float]


@contextmanager
def timed(seconds: Seconds, name: str) -> Iterator[None]:
    """Add the wall time of a block under this name."""
    begin = time.perf_counter()
    yield
    seconds[name] = seconds.get(name, 0.0) + time.perf_counter() - begin


def within_time(progress: Progress, limit: float, remedy: str) -> Progress:
    """Progress that ends the work when it reports later than ``limit`` [s] from now, by an `UnaffordableError`."""
    end = time.monotonic() + limit

    def report(step: str, share: float) -> None:
        if time.monotonic() > end:
            raise UnaffordableError(
                "the run has reached its time limit",
                value=f"{share:.0%} of the step '{step}'",
                limit=f"{limit:.3g} s",
                remedy=f"finished parts are kept, and the next run resumes: {remedy}",
            )
        progress(step, share)

    return report


def mixed(count: int) -> list[int]:
    """An order of ``count`` points in which any first fraction of them takes about that fraction of the time.

    Neighbouring points often take equally long, so the golden ratio spreads the first ones evenly among all.
    """
    return sorted(range(count), key=lambda k: k * _GOLDEN % 1.0)


def _could_return(function: Callable[..., Any], value: object) -> bool:
    """Whether a value has the type that a function declares to return, with all its fields if it is a dataclass."""
    try:
        declared = get_type_hints(function).get("return", object)
        kind = get_origin(declared) or declared
        fits = isinstance(value, (int, kind) if kind is float else kind)
    except (NameError, TypeError):  # imported for the type checker only, no plain function, or no class
        fits = True
    return fits and (not is_dataclass(value) or all(hasattr(value, one.name) for one in fields(value)))


class DeadlyPointError(TradestudyError):
    """Workers died repeatedly over one point of the study."""


@dataclass(frozen=True, kw_only=True)
class Steps:
    """How the independent points of a study are computed.

    Parameters
    ----------
    executor
        Computes the points.
    checkpoints
        Saves and finds finished points; None: nothing is saved.
    progress
        Called with the name of a step and the fraction of it that is done.
    counts
        Records, for each step, how many points were computed and how many were taken from an earlier run.
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
    ) -> list[Value]:
        """Values of a function at points, in the order of the points, but computed in a `mixed` order.

        Parameters
        ----------
        step
            Name of the step, for the progress shown and for run.json.
        function
            A module-level function whose value at a point depends on the point alone.
        points
            Its arguments; their content and the code make up the key under which a value is saved.
        labels
            Readable names of the points.

        Raises
        ------
        DeadlyPointError
            Workers died repeatedly over one point; the error contains its label.
        Exception
            The error of the first point that fails; all points before it are finished then.
        """
        values: dict[int, Any] = {}
        keys: list[bytes] = []
        if self.checkpoints is not None:
            shared = fingerprint(environment(), function)
            keys = [fingerprint(shared, point) for point in points]
            found_before = self.checkpoints.finished(keys)
            values = {i: value for i, value in found_before.items() if _could_return(function, value)}
        taken = len(values)
        missing = [i for i in mixed(len(points)) if i not in values]
        executor = self.executor if len(missing) > 1 else Serial()  # a single point needs no workers
        failed: dict[int, Exception] = {}
        furthest = 0.0

        def report(share_of_next: float = 0.0) -> None:
            nonlocal furthest
            done = len(values) + share_of_next
            furthest = max(furthest, done / max(1, len(points)))  # a point may repeat a part of its work
            self.progress(step, furthest)

        report()
        try:
            with (
                heard_by(report),  # computed in this thread, if at all: one point after another
                closing(executor.map_unordered(function, [points[i] for i in missing])) as found,
            ):
                for number, outcome in found:
                    place = missing[number]
                    if isinstance(outcome, Raised):
                        failed[place] = outcome.error
                    else:
                        values[place] = outcome
                        if self.checkpoints is not None:
                            self.checkpoints.add(keys[place], outcome)
                        report()
                    if failed and all(i in values for i in missing if i < min(failed)):
                        raise failed[min(failed)]
        except LostPointError as lost:
            raise DeadlyPointError(
                f"{lost.deaths} workers died one after another over the same point of the step '{step}'",
                value=labels[missing[lost.index]],
                remedy="finished points are kept; find out what ends the workers, such as too little memory",
            ) from lost
        finally:
            before = self.counts.get(step, {"computed": 0, "taken up": 0})  # a step may be computed in several calls
            now = {"computed": len(values) - taken, "taken up": taken}
            self.counts[step] = {name: before[name] + now[name] for name in now}
        return [values[i] for i in range(len(points))]
