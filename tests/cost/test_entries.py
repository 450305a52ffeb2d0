"""The frontier and the price of the next digit, on tables made up so that the answer can be read off."""

from __future__ import annotations

import math

import pytest

from tradestudy.cost.entries import (
    Entry,
    Measured,
    next_digit,
    on_frontier,
    seconds_for,
    seconds_for_a_tenth_of_what_is_asked,
)


def entry(model: str, error: float, seconds: float, *, chosen: bool = False) -> Entry:
    return Entry(
        model=model,
        setting="",
        evaluations=math.nan,
        error=error,
        typical_error=error,
        seconds=seconds,
        least_seconds=seconds,
        peak_memory=0.0,
        repeats=3,
        chosen=chosen,
    )


def measured(*entries: Entry, floor: float = 1e-9, asked: float = math.nan) -> Measured:
    return Measured(
        name="q",
        title="Q",
        says="",
        reference="",
        reference_error=floor,
        reference_seconds=1.0,
        entries=entries,
        asked=asked,
    )


def test_the_frontier_holds_what_nothing_beats() -> None:
    errors = [1e-1, 1e-2, 1e-2, 5e-2, math.inf, 1e-3]
    seconds = [1.0, 10.0, 20.0, 15.0, 0.1, 100.0]
    assert on_frontier(errors, seconds, 1e-9).tolist() == [True, True, False, False, False, True]


def test_errors_that_the_reference_cannot_tell_apart_are_equal() -> None:
    assert on_frontier([1e-6, 1e-5, 1e-3], [10.0, 1.0, 0.1], 1e-4).tolist() == [False, True, True]


def test_equal_entries_are_both_on_it() -> None:
    assert on_frontier([1e-2, 1e-2], [1.0, 1.0], 0.0).tolist() == [True, True]


def test_no_number_is_never_on_it() -> None:
    assert on_frontier([math.nan, 1e-2], [1e-3, 1.0], 0.0).tolist() == [False, True]


def test_seconds_lie_between_entries_in_logarithms() -> None:
    frontier = [(1e-1, 1.0), (1e-3, 100.0)]
    assert seconds_for(1e-2, frontier) == pytest.approx(10.0, rel=1e-12)
    assert seconds_for(1e-1 * 10**-0.5, frontier) == pytest.approx(10**0.5, rel=1e-12)
    assert seconds_for(1e-3, frontier) == pytest.approx(100.0, rel=1e-12)


def test_a_loose_error_costs_what_the_cheapest_costs_and_a_tight_one_cannot_be_had() -> None:
    frontier = [(1e-1, 1.0), (1e-3, 100.0)]
    assert seconds_for(0.5, frontier) == 1.0
    assert seconds_for(9e-4, frontier) == math.inf


def test_an_exact_entry_is_there_or_not() -> None:
    assert seconds_for(1e-7, [(1e-1, 1.0), (0.0, 7.0)]) == 7.0


def test_the_next_digit_follows_the_frontier_and_not_the_model() -> None:
    found = next_digit(
        measured(
            entry("slow", 1e-2, 50.0, chosen=True),
            entry("slow", 1e-3, 5000.0),
            entry("quick", 1e-1, 1.0),
            entry("quick", 1e-3, 30.0),
        )
    )
    assert found is not None
    assert (found.error, found.seconds, found.wanted) == (1e-2, 50.0, 1e-3)
    assert found.needed == pytest.approx(30.0, rel=1e-9)
    assert (found.best, found.best_seconds) == (1e-3, 30.0)


def test_the_next_digit_of_what_is_best_already_cannot_be_had() -> None:
    found = next_digit(measured(entry("a", 1e-2, 1.0), entry("b", 1e-3, 2.0, chosen=True)))
    assert found is not None
    assert math.isinf(found.needed)
    assert not found.below_reference


def test_a_digit_below_the_reference_is_said_to_be() -> None:
    found = next_digit(measured(entry("a", 1e-4, 1.0, chosen=True), floor=5e-5))
    assert found is not None
    assert found.below_reference


def test_of_several_choices_the_most_accurate_counts() -> None:
    found = next_digit(measured(entry("a", 1e-1, 1.0, chosen=True), entry("b", 1e-2, 2.0, chosen=True)))
    assert found is not None
    assert found.error == 1e-2


def test_without_a_choice_there_is_no_next_digit() -> None:
    assert next_digit(measured(entry("a", 1e-1, 1.0))) is None


def test_a_tenth_of_what_is_asked_lies_along_the_frontier_too() -> None:
    entries = entry("a", 1e-2, 1.0, chosen=True), entry("a", 1e-4, 100.0)
    assert seconds_for_a_tenth_of_what_is_asked(measured(*entries, asked=1e-2)) == pytest.approx(10.0, rel=1e-9)
    assert math.isinf(seconds_for_a_tenth_of_what_is_asked(measured(*entries, asked=1e-4)))
    assert math.isinf(seconds_for_a_tenth_of_what_is_asked(measured(*entries, asked=1e-2, floor=2e-3)))
    assert math.isnan(seconds_for_a_tenth_of_what_is_asked(measured(*entries)))
    assert math.isnan(seconds_for_a_tenth_of_what_is_asked(measured(asked=1e-2)))
