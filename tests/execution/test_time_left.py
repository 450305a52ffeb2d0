"""The time left of a run, by a clock that the test sets."""

from __future__ import annotations

import math

import pytest

from tradestudy.execution.steps import long_ones_first, mixed
from tradestudy.execution.time_left import TimeLeft


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def left(clock: Clock) -> TimeLeft:
    found = TimeLeft(clock)
    found.expect({"depth": 10.0, "decision": 5.0, "report": 3.0})
    return found


def test_a_step_that_has_hardly_begun_has_its_predicted_time(clock: Clock, left: TimeLeft) -> None:
    left("depth", 0.0)
    clock.now += 2.0
    assert left.of_step == pytest.approx(8.0)
    assert left.of_run == pytest.approx(16.0)
    clock.now += 20.0
    assert left.of_step == 0.0  # overdue, and nothing to go by


def test_after_a_tenth_the_pace_of_a_step_counts_as_much_as_its_prediction(clock: Clock, left: TimeLeft) -> None:
    left("depth", 0.0)
    clock.now += 4.0
    left("depth", 0.1)
    assert left.of_step == pytest.approx(0.9 * (40.0 + 10.0) / 2.0)
    clock.now += 1.0  # no new progress, but time passes
    assert left.of_step == pytest.approx(21.5)


def test_in_the_end_a_step_continues_at_its_own_pace(clock: Clock, left: TimeLeft) -> None:
    left("depth", 0.0)
    clock.now += 36.0
    left("depth", 0.9)
    assert left.of_step == pytest.approx(4.0, rel=0.1)


def test_the_prediction_counts_less_the_more_of_a_step_is_done(clock: Clock, left: TimeLeft) -> None:
    """The step takes four times as long as predicted."""
    left("depth", 0.0)
    off = []
    for done in range(1, 10):
        clock.now += 4.0
        left("depth", done / 10.0)
        off.append(left.of_step / (4.0 * (10 - done)))
    assert off == sorted(off)
    assert off[-1] < 1.0


def test_a_prediction_of_nothing_does_not_count(clock: Clock, left: TimeLeft) -> None:
    left.expect({"depth": 0.0})
    left("depth", 0.0)
    clock.now += 4.0
    left("depth", 0.5)
    assert left.of_step == pytest.approx(4.0)


def test_preparations_do_not_count_as_pace(clock: Clock, left: TimeLeft) -> None:
    left("depth", 0.0)
    clock.now += 3.0
    left("depth", 0.0)
    assert left.of_step == pytest.approx(7.0)  # but they are part of the predicted time
    clock.now += 5.0
    left("depth", 0.5)
    assert left.of_step == pytest.approx(5.0)


def test_the_square_root_of_the_error_of_past_predictions_recurs(clock: Clock, left: TimeLeft) -> None:
    """The first step takes four times as long as predicted, so the others are expected to take twice as long."""
    left("depth", 0.0)
    clock.now += 40.0
    left("depth", 1.0)
    assert left.of_step == 0.0
    left("decision", 0.0)
    assert left.of_step == pytest.approx(10.0)
    assert left.of_run == pytest.approx(16.0)


def test_a_step_taken_from_an_earlier_run_says_nothing_about_later_ones(clock: Clock, left: TimeLeft) -> None:
    left("depth", 1.0)
    clock.now += 0.1
    left("decision", 0.0)
    assert left.of_step == pytest.approx(5.0)
    assert left.of_run == pytest.approx(8.0)


def test_a_step_resumed_after_another_one_keeps_its_time(clock: Clock, left: TimeLeft) -> None:
    """As claims do, whose last part waits for requirements in every design."""
    left("depth", 0.0)
    clock.now += 8.0
    left("decision", 0.0)
    clock.now += 5.0
    left("depth", 1.0)
    assert left.of_run == pytest.approx(3.0 * math.sqrt(13.0 / 15.0))  # the decision is not to come again
    clock.now += 2.0
    left("report", 0.0)
    assert left.of_step == pytest.approx(3.0)  # 15 s, as predicted


def test_resumed_parts_do_not_count_as_pace(clock: Clock, left: TimeLeft) -> None:
    left("depth", 0.6)
    assert left.of_step == pytest.approx(4.0)
    clock.now += 5.0
    left("depth", 0.8)
    assert 2.0 < left.of_step < 5.0  # by the prediction, and by its own pace


def test_a_step_that_begins_anew_has_the_pace_of_its_new_beginning(clock: Clock, left: TimeLeft) -> None:
    """As a picture does that is refined: its first round says nothing about the time that the second takes."""
    left("depth", 0.0)
    clock.now += 20.0
    left("depth", 1.0)
    left("depth", 0.05)
    assert left.of_step == pytest.approx(9.5)
    clock.now += 8.0
    left("depth", 0.25)
    assert 7.5 < left.of_step < 30.0  # by the prediction, and by its own pace


def test_an_unpredicted_step_is_extrapolated_from_its_own_pace(clock: Clock, left: TimeLeft) -> None:
    left("something", 0.0)
    assert math.isnan(left.of_step)
    clock.now += 5.0
    left("something", 0.5)
    assert left.of_step == pytest.approx(5.0)
    assert left.of_run == pytest.approx(5.0)


@pytest.mark.parametrize("count", [0, 1, 24, 193])
def test_every_part_of_a_mixed_order_comes_up_early(count: int) -> None:
    order = mixed(count)
    assert sorted(order) == list(range(count))
    if count > 20:
        first = order[: count // 4]
        for quarter in range(4):
            inside = [k for k in first if quarter * count / 4 <= k < (quarter + 1) * count / 4]
            assert len(inside) == pytest.approx(len(first) / 4, abs=1)


def test_long_points_come_first_and_equal_ones_stay_mixed() -> None:
    order = long_ones_first([1.0, 20.0, 1.0, 30.0, *[1.0] * 8])
    assert order[:2] == [3, 1]
    assert sorted(order) == list(range(12))
    two_kinds = long_ones_first([9.0] * 8 + [1.0] * 40)
    assert sorted(two_kinds[:8]) == list(range(8)) != two_kinds[:8]
    assert sorted(long_ones_first([1.0, math.nan, 2.0])) == [0, 1, 2]  # no point is lost
    assert long_ones_first([2.0] * 24) == mixed(24)
    assert long_ones_first([]) == []
