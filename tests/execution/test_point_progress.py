"""Progress that a computation reports from inside one point."""

from __future__ import annotations

import pytest

from tradestudy.execution import Steps, Threads
from tradestudy.execution.executor import part_of_point, tell


def halves(point: int) -> int:
    """A computation in two parts: a fifth of its time, and the rest."""
    tell(0.2)
    with part_of_point(0.2, 1.0):
        tell(0.5)
    return point


def test_what_a_point_tells_counts_as_a_part_of_it() -> None:
    told: list[float] = []
    Steps(progress=lambda _step, share: told.append(share)).map("step", halves, [1, 2], ["one", "two"])
    first, second = [0.1, 0.3, 0.5, 0.5], [0.6, 0.8, 1.0, 1.0]
    assert told == pytest.approx([0.0, *first, *second])


def twice(point: int) -> int:
    """A computation that does its work twice, to find out that it must."""
    for _ in range(2):
        halves(point)
    return point


def test_a_step_never_goes_back() -> None:
    told: list[float] = []
    Steps(progress=lambda _step, share: told.append(share)).map("step", twice, [1, 2], ["one", "two"])
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_points_on_threads_tell_nobody() -> None:
    told: list[float] = []
    steps = Steps(executor=Threads(count=2), progress=lambda _step, share: told.append(share))
    assert steps.map("step", halves, [1, 2], ["one", "two"]) == [1, 2]
    assert told == [0.0, 0.5, 1.0]


def test_outside_a_step_nobody_listens() -> None:
    assert halves(1) == 1
