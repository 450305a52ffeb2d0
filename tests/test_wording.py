"""How counts and distances read in a sentence."""

from __future__ import annotations

import math

import pytest

from tradestudy.wording import (
    counted,
    distance,
    in_words,
    limit_words,
    listed,
    span,
    with_article,
    with_unit_symbols,
)


@pytest.mark.parametrize(
    ("number", "text"), [(0, "0 readings"), (1, "1 reading"), (2, "2 readings"), (15, "15 readings")]
)
def test_one_is_singular(number: int, text: str) -> None:
    assert counted(number, "reading") == text


@pytest.mark.parametrize(
    ("title", "text"),
    [
        ("8 mm stereo rig", "the 8 mm stereo rig"),
        ("Raytrix R5", "the Raytrix R5"),
        ("OAK-D", "the OAK-D"),
        ("Short-base stereo rig", "the short-base stereo rig"),
        ("Single-focus R5 set to 150 mm", "the single-focus R5 set to 150 mm"),
        ("Stereo rig", "the stereo rig"),
        ("MAHLI focus stack", "the MAHLI focus stack"),
        ("Calibrated 8 mm rig", "the calibrated 8 mm rig"),
        ("Head B", "Head B"),
        ("Head A (50 mm)", "Head A (50 mm)"),
        ("Stereo 100 mm, wide", "Stereo 100 mm, wide"),
        ("Camera 2", "Camera 2"),
        ("b", "b"),
        ("rig b", "rig b"),
        ("Webcams", "the webcams"),
        ("Rig", "the rig"),
        ("Near", "Near"),
        ("a stereo rig", "a stereo rig"),
        ("the old rig", "the old rig"),
        ("Robot", "the Robot"),
    ],
)
def test_a_title_reads_as_english_within_a_sentence(title: str, text: str) -> None:
    assert with_article(title) == text


def test_units_are_written_with_their_symbols() -> None:
    assert with_unit_symbols("0.2 deg of 5.5 um, 3 degrees, deg") == "0.2° of 5.5 µm, 3 degrees, deg"


def test_a_plural_of_its_own() -> None:
    assert [counted(number, "entry", "entries") for number in (1, 2)] == ["1 entry", "2 entries"]


def test_the_first_of_several_broken_limits_is_named_and_a_condition_is_its_own_words() -> None:
    assert limit_words("overlap, focus") == limit_words("overlap")
    assert limit_words("matching: the window is small, focus") == "the window is small"


@pytest.mark.parametrize(
    ("items", "text"),
    [
        ([], ""),
        (["a"], "a"),
        (["a", "b"], "a and b"),
        (["a", "b", "c"], "a, b and c"),
        (["A, x", "B", "C"], "A, x; B; and C"),
        (["A (1, 2)", "B"], "A (1, 2) and B"),
    ],
)
def test_the_last_two_of_a_list_are_joined_by_and(items: list[str], text: str) -> None:
    assert listed(items) == text


@pytest.mark.parametrize(
    ("start", "end", "text"),
    [
        (0.042, 0.0494, "42 mm to 49.4 mm"),
        (0.05, 0.15, "0.05 to 0.15 m"),
        (0.391, 10.0, "0.391 to 10 m"),
        (1.0, math.inf, "1 m to ∞"),
        # Ends that three digits do not tell apart are no stretch of no width.
        (0.042, 0.04200383, "42 mm to 42.004 mm"),
        (1.2341, 1.2344, "1.2341 to 1.2344 m"),
        (1.0, 1.0, "1 to 1 m"),
    ],
)
def test_both_ends_of_a_range_can_be_distinguished(start: float, end: float, text: str) -> None:
    assert span(start, end).replace("\N{NO-BREAK SPACE}", " ") == text


@pytest.mark.parametrize(("value", "text"), [(0.0553, "55.3 mm"), (0.1, "0.1 m"), (2.5, "2.5 m"), (math.inf, "∞")])
def test_metres_are_used_from_a_tenth_on(value: float, text: str) -> None:
    assert distance(value).replace("\N{NO-BREAK SPACE}", " ") == text


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("focal_length_x_px", "focal length x"),
        ("f_number", "f-number"),
        ("mla_distance", "array distance"),
    ],
)
def test_names_are_written_as_words(name: str, words: str) -> None:
    assert in_words(name) == words
