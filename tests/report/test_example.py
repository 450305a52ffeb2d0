"""The example report that the repository holds."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tradestudy import figures
from tradestudy.results.storage import read_finished

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "reports" / "examples" / "plenoptic-vs-stereo"


def test_this_program_reads_the_example() -> None:
    tree, run = read_finished(EXAMPLE)
    assert tree.attrs["study"] == run["study"] == EXAMPLE.name
    assert "cost" in tree.children  # it shows what accuracy costs


def test_its_first_figure_names_both_requirements() -> None:
    """That from 0.25 to 0.4 m lies among three curves."""
    tree, _ = read_finished(EXAMPLE)
    shown = {text.get_text() for text in figures.figure(tree, "deciding_cameras").axes[0].texts}
    assert set(tree["requirements"]["says"].values) <= shown


def test_git_tracks_the_example_and_nothing_that_a_run_or_a_cost_writes() -> None:
    def is_ignored(path: str) -> bool:
        return subprocess.run(["git", "check-ignore", "-q", path], cwd=ROOT, check=False).returncode == 0

    if not (ROOT / ".git").exists():
        pytest.skip("this is no checkout")
    names = [path.stem.replace("_", "-") for path in (ROOT / "studies").glob("*.yaml")]
    assert all(is_ignored(f"reports/{name}/{file}") for name in names for file in ("report.html", "cost.svg"))
    assert is_ignored("reports/examples/report.html")  # of a study of that name
    assert not is_ignored("reports/examples/plenoptic-vs-stereo/report.html")
    assert not is_ignored("reports/README.md")
