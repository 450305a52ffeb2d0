"""The frontier and the price of the next digit, on tables made up so that the answer can be read off."""

from __future__ import annotations

import math

from tradestudy.cost.entries import (
    CostTable,
    Entry,
    a_tenth_of_what_is_asked,
    cheapest_within,
    most_accurate,
    next_digit,
    on_frontier,
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


def measured(*entries: Entry, floor: float = 1e-9, asked: float = math.nan) -> CostTable:
    return CostTable(
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


def test_what_is_no_answer_is_never_on_it() -> None:
    assert on_frontier([20.0, 1e-2], [1e-3, 1.0], 0.0).tolist() == [False, True]


def test_the_cheapest_within_an_error_is_an_entry_and_nothing_between_two() -> None:
    """Closed form and quadrature of the headline study: what lies between them on a log-log line cannot be had."""
    table = measured(entry("closed form", 1e-5, 840e-6, chosen=True), entry("quadrature", 1e-10, 57e-3), floor=0.0)
    for error in (9.9e-6, 1e-6, 1e-10):
        found = cheapest_within(table, error)
        assert found is not None
        assert (found.model, found.seconds) == ("quadrature", 57e-3)
    quick = cheapest_within(table, 1e-5)
    assert quick is not None
    assert quick.model == "closed form"
    assert cheapest_within(table, 9e-11) is None


def test_of_those_within_an_error_the_one_that_takes_least_counts_not_the_nearest() -> None:
    table = measured(entry("near", 9e-4, 5.0), entry("dear", 1e-4, 9.0), entry("cheap", 1e-6, 2.0))
    found = cheapest_within(table, 1e-3)
    assert found is not None
    assert found.model == "cheap"


def test_no_entry_is_within_less_than_the_reference_can_tell() -> None:
    table = measured(entry("a", 1e-8, 1.0), floor=1e-5)
    assert cheapest_within(table, 1e-5) is not None
    assert cheapest_within(table, 9e-6) is None


def test_an_exact_entry_is_within_any_error_and_no_answer_within_none() -> None:
    table = measured(entry("line", 1e-1, 1.0), entry("nothing", math.inf, 0.1), entry("exact", 0.0, 7.0), floor=0.0)
    found, loose = cheapest_within(table, 1e-7), cheapest_within(table, math.inf)
    assert found is not None
    assert found.model == "exact"
    assert loose is not None
    assert loose.model == "line"
    assert cheapest_within(measured(), 1.0) is None


def test_the_next_digit_is_the_cheapest_of_any_model() -> None:
    found = next_digit(
        measured(
            entry("slow", 1e-2, 50.0, chosen=True),
            entry("slow", 1e-3, 5000.0),
            entry("quick", 1e-1, 1.0),
            entry("quick", 1e-4, 60.0),
        )
    )
    assert found is not None
    assert found.found is not None
    assert (found.own.error, found.own.seconds, found.wanted) == (1e-2, 50.0, 1e-3)
    assert (found.found.model, found.found.error, found.found.seconds) == ("quick", 1e-4, 60.0)
    assert found.quicker is None


def test_what_errs_less_in_no_more_time_is_found() -> None:
    found = next_digit(
        measured(
            entry("own", 1e-2, 50.0, chosen=True),
            entry("a", 8e-3, 1.0),
            entry("b", 5e-3, 50.0),
            entry("c", 1e-5, 50.1),
        )
    )
    assert found is not None
    assert found.quicker is not None
    assert found.quicker.model == "b"


def test_what_the_reference_cannot_tell_from_the_choice_does_not_err_less() -> None:
    found = next_digit(measured(entry("own", 1e-4, 5.0, chosen=True), entry("a", 1e-6, 1.0), floor=1e-3))
    assert found is not None
    assert found.quicker is None


def test_the_next_digit_of_what_is_best_already_cannot_be_had() -> None:
    table = measured(entry("a", 1e-2, 1.0), entry("b", 1e-3, 2.0, chosen=True))
    found, best = next_digit(table), most_accurate(table)
    assert found is not None
    assert found.found is None
    assert best is found.own


def test_a_digit_below_the_reference_cannot_be_had() -> None:
    found = next_digit(measured(entry("a", 1e-4, 1.0, chosen=True), entry("b", 1e-9, 2.0), floor=5e-5))
    assert found is not None
    assert found.found is None


def test_of_several_choices_the_most_accurate_counts() -> None:
    found = next_digit(measured(entry("a", 1e-1, 1.0, chosen=True), entry("b", 1e-2, 2.0, chosen=True)))
    assert found is not None
    assert found.own.error == 1e-2


def test_without_a_choice_there_is_no_next_digit() -> None:
    assert next_digit(measured(entry("a", 1e-1, 1.0))) is None
    assert most_accurate(measured()) is None


def test_a_tenth_of_what_is_asked_is_an_entry_too() -> None:
    entries = entry("a", 1e-2, 1.0, chosen=True), entry("a", 1e-4, 100.0)
    found = a_tenth_of_what_is_asked(measured(*entries, asked=1e-2))
    assert found is not None
    assert found.seconds == 100.0
    assert a_tenth_of_what_is_asked(measured(*entries, asked=1e-4)) is None
    assert a_tenth_of_what_is_asked(measured(*entries, asked=1e-2, floor=2e-3)) is None
    assert a_tenth_of_what_is_asked(measured(*entries)) is None
    assert a_tenth_of_what_is_asked(measured(asked=1e-2)) is None
