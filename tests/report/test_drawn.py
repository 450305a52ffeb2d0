from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
import xarray as xr

from tradestudy import figures, report
from tradestudy.figures import drawn
from tradestudy.figures.drawing import Drawing
from tradestudy.figures.drawn import Drawer, drawer, drawn_here

STUDY = Path(__file__).parents[2] / "studies" / "close_range.yaml"


@pytest.fixture(scope="module")
def small(tree: xr.DataTree) -> xr.DataTree:
    """A part of the results that allows one figure, quickly drawn."""
    return xr.DataTree.from_dict({f"/{name}": tree[name].to_dataset() for name in ("cameras", "decision")})


@pytest.fixture(scope="module")
def drawings(small: xr.DataTree) -> Mapping[str, Drawing]:
    return figures.build(small)


def test_another_interpreter_draws_the_same_bytes(
    small: xr.DataTree, drawings: Mapping[str, Drawing], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert list(drawings) == ["readings"]
    expected = drawn_here(drawings)
    with drawer() as there:
        shared = there.begin(small)
        shared.receiving.join()
        monkeypatch.delattr(drawn, "drawn_here")
        assert shared.pictures(drawings) == expected


def test_figures_that_another_process_has_not_drawn_are_drawn_here(
    small: xr.DataTree, drawings: Mapping[str, Drawing], monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = drawn_here(drawings)
    with drawer() as there:  # which has to load libraries first
        assert there.begin(small).pictures(drawings) == expected
    monkeypatch.setattr(sys, "path", [])  # where the other interpreter finds nothing
    with drawer() as there:
        shared = there.begin(small)
        shared.receiving.join()
        assert shared.pictures(drawings) == expected


def test_every_figure_moves_the_progress_of_a_report(small: xr.DataTree, drawings: Mapping[str, Drawing]) -> None:
    drawings = {"first": drawings["readings"], "second": drawings["readings"]}
    told: list[float] = []
    drawn_here(drawings, told.append)
    assert told == [0.5, 1.0]
    run = {"seconds": {"compute": 1.0}}
    report.compose_files(small, run, pdf=False, progress=(told := []).append)
    assert told == sorted(told)
    assert 0.0 < told[0] < told[-1] < 1.0  # pages remain


def test_an_interpreter_that_was_not_asked_ends_with_the_run() -> None:
    with pytest.raises(KeyboardInterrupt), drawer() as there:
        raise KeyboardInterrupt
    assert isinstance(there, Drawer)
    assert there.tasks.closed
    assert there.answers.closed


def test_a_run_can_end_while_its_figures_are_drawn(small: xr.DataTree) -> None:
    with drawer() as there:
        shared = there.begin(small)
    shared.receiving.join()
    assert there.answers.closed


@pytest.mark.slow
def test_a_script_needs_no_guard(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        f"from pathlib import Path\nimport tradestudy\nfrom tradestudy import api\nprint('once')\n"
        f"api.run(tradestudy.load({str(STUDY)!r}), Path({str(tmp_path / 'out')!r}), pdf=False)\n",
        encoding="utf-8",
    )
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "once\n", "")
    assert (tmp_path / "out" / "figures" / "whole_range.svg").is_file()
