"""The scoreboard of published measurements: its verdicts, and its table in the documentation."""

from __future__ import annotations

from pathlib import Path

from tests.campaigns import published


def test_the_scoreboard_is_that_of_the_documentation() -> None:
    found = published.rows()
    page = (Path(published.__file__).with_suffix(".md")).read_text(encoding="utf-8")
    for row in found:
        assert f"| {' | '.join(row.cells())} |" in page
    misses = {row.quantity for row in found if not row.hit}
    assert "f·B from the ripple" in misses  # the nominal focal length
    assert len(misses) == 5
    for _, _, data, _ in published.NOT_PREDICTED:
        assert data == "one number each" or (published.DATA / data).is_file()
