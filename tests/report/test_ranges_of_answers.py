"""Ranges of distance in which one camera is best, from the best camera at every computed distance."""

from __future__ import annotations

import numpy as np

from tradestudy.results.views.decision import merged_ranges, worth_reporting


def test_a_usable_range_that_begins_with_the_study_ends_no_answer() -> None:
    """Both cameras' usable ranges end with the study, and that of the first begins with it."""
    distance, ends = np.array([0.3, 0.316, 0.35, 4.0]), np.array([0.3, 0.312, 4.0, 4.0])
    found = tuple(merged_ranges(["short", "long", "long", "long"], distance, ends))
    assert found == ((0.3, 0.312, "short"), (0.312, 4.0, "long"))
    assert tuple(worth_reporting(found)) == found


def test_without_an_end_between_two_distances_the_answer_changes_at_their_geometric_mean() -> None:
    found = tuple(merged_ranges(["short", "long", "long"], np.array([1.0, 4.0, 9.0]), np.array([1.0, 9.0])))
    assert found == ((1.0, 2.0, "short"), (2.0, 9.0, "long"))


def test_a_brief_tie_of_three_between_ties_of_two_is_divided_too() -> None:
    """Cameras that tie within 0.6 % of a distance, in three ranges, leave one camera from 0.3 to 10 m."""
    found = ((0.1, 0.3, "b"), (0.3, 6.85, "c"), (6.85, 6.88, "a, c"), (6.88, 6.885, "a, b, c"), (6.885, 6.89, "a, c"))
    assert list(worth_reporting((*found, (6.89, 10.0, "c")))) == [(0.1, 0.3, "b"), (0.3, 10.0, "c")]
