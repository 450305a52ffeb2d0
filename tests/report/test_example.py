"""The example report that the repository holds."""

from __future__ import annotations

from pathlib import Path

from tradestudy.results.storage import read_finished

EXAMPLE = Path(__file__).parents[2] / "reports" / "plenoptic-vs-stereo"


def test_this_program_reads_the_example() -> None:
    tree, run = read_finished(EXAMPLE)
    assert tree.attrs["study"] == run["study"] == EXAMPLE.name
