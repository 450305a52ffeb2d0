"""Which candidates are measured, against what, and what of them is reported."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

from tradestudy.answers import cost_measuring as measuring
from tradestudy.answers.cost_measuring import (
    Candidate,
    CostProblem,
    Entry,
    Reference,
    forget,
    measure,
    next_digit,
    on_frontier,
)
from tradestudy.errors import UnaffordableError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.quadrature import gauss_legendre
from tradestudy.provenance import code_hash


class Clock:
    """Seconds that pass only in computations."""

    def __init__(self) -> None:
        self.now = 0.0

    def perf_counter(self) -> float:
        return self.now

    def taking(self, seconds: float, value: float) -> Callable[[], FloatArray]:
        def compute() -> FloatArray:
            self.now += seconds
            return np.array([value])

        return compute


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(measuring, "time", clock)
    return clock


def relative(values: FloatArray, reference: FloatArray) -> float:
    return float(np.max(np.abs(values / reference - 1.0)))


def problem(clock: Clock, *, references: int = 2) -> CostProblem:
    """Truth 1: a quick rough candidate, the choice between, a slow exact one; references of 4 and of 12 s."""

    def reference(seconds: float, error: float) -> Callable[[], tuple[FloatArray, float]]:
        return lambda: (clock.taking(seconds, 1.0)(), error)

    return CostProblem(
        name="p",
        title="P",
        difference=relative,
        candidates=(
            Candidate(models="rough", compute=clock.taking(0.1, 1.5)),
            Candidate(models="choice", compute=clock.taking(1.0, 1.1), chosen=True),
            Candidate(models="exact", compute=clock.taking(5.0, 1.001), growth=2.0),
        ),
        references=(
            Reference(words="coarse", compute=reference(4.0, 0.05)),
            Reference(words="fine", compute=reference(12.0, 0.004), growth=3.0),
        )[:references],
    )


def test_errors_refer_to_the_finest_reference_and_are_never_below_its_own(clock: Clock) -> None:
    found = measure(problem(clock), 100.0)
    assert found.reference == "fine"
    assert [(one.models, one.chosen) for one in found.entries] == [("rough", False), ("choice", True), ("exact", False)]
    assert [one.error for one in found.entries] == pytest.approx([0.5, 0.1, 0.004])
    assert [one.seconds for one in found.entries] == pytest.approx([0.1, 1.0, 5.0])
    assert not found.left_out
    # Three runs of the short ones, one of the others.
    assert clock.now == pytest.approx(3 * 0.1 + 3 * 1.0 + 5.0 + 4.0 + 12.0)


@pytest.mark.parametrize(
    ("seconds", "reference", "models", "left_out"),
    [
        (0.5, "", (), [r"not measured: the reference .*about 1 s, .*larger budget"]),
        (9.0, "coarse", ("rough", "choice"), [r"exact: .*about 2 s, .*\b1\.7 s left"]),
        (30.0, "coarse", ("rough", "choice", "exact"), []),
    ],
)
def test_what_does_not_fit_is_left_out_and_named(
    clock: Clock, seconds: float, reference: str, models: tuple[str, ...], left_out: list[str]
) -> None:
    found = measure(problem(clock), seconds)
    assert found.reference == reference
    assert tuple(one.models for one in found.entries) == models
    assert len(found.left_out) == len(left_out)
    assert all(map(re.fullmatch, left_out, found.left_out))


def test_what_cannot_be_computed_is_left_out_and_named(clock: Clock) -> None:
    def refuse() -> FloatArray:
        raise UnaffordableError("too many nodes")

    one = problem(clock)
    failing = Candidate(models="failing", compute=refuse)
    found = measure(CostProblem(**{**vars(one), "candidates": (*one.candidates, failing)}), 100.0)
    assert found.left_out == ("failing: too many nodes",)


def entry(models: str, error: float, seconds: float, *, chosen: bool = False) -> Entry:
    return Entry(models=models, error=error, seconds=seconds, chosen=chosen)


ENTRIES = (
    entry("rough", 0.5, 0.1),
    entry("choice", 0.1, 1.0, chosen=True),
    entry("beaten", 0.1, 2.0),
    entry("slow tenth", 0.009, 8.0),
    entry("tenth", 0.01, 5.0),
    entry("none", np.inf, 0.05),
)


def test_the_frontier_contains_what_nothing_beats() -> None:
    names = [one.models for one, on in zip(ENTRIES, on_frontier(ENTRIES), strict=True) if on]
    assert names == ["rough", "choice", "slow tenth", "tenth"]


def test_the_next_digit_is_the_quickest_within_a_tenth_of_the_error_of_the_choice() -> None:
    assert next_digit(ENTRIES) == ENTRIES[4]
    assert next_digit(ENTRIES[:3]) is None
    assert next_digit((ENTRIES[0], *ENTRIES[2:])) is None  # nothing is chosen


def test_every_computation_starts_afresh() -> None:
    gauss_legendre(7)
    code_hash()
    assert gauss_legendre.cache_info().currsize > 0
    forget()
    assert gauss_legendre.cache_info().currsize == 0
    assert code_hash.cache_info().currsize == 1  # no computation of physics
