from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
import xarray as xr

from tradestudy import figures, report
from tradestudy.figures.drawing import Drawing
from tradestudy.figures.drawn import drawn_here

STUDY = Path(__file__).parents[2] / "studies" / "close_range.yaml"


@pytest.fixture(scope="module")
def small(tree: xr.DataTree) -> xr.DataTree:
    """A part of the results that allows one figure, quickly drawn."""
    return xr.DataTree.from_dict({f"/{name}": tree[name].to_dataset() for name in ("cameras", "decision")})


@pytest.fixture(scope="module")
def drawings(small: xr.DataTree) -> Mapping[str, Drawing]:
    return figures.build(small)


def test_every_figure_moves_the_progress_of_a_report(small: xr.DataTree, drawings: Mapping[str, Drawing]) -> None:
    drawings = {"first": drawings["readings"], "second": drawings["readings"]}
    told: list[float] = []
    drawn_here(drawings, told.append)
    assert told == [0.5, 1.0]
    run = {"seconds": {"compute": 1.0}}
    report.compose_files(small, run, pdf=False, progress=(told := []).append)
    assert told == sorted(told)
    assert 0.0 < told[0] < told[-1] < 1.0  # pages remain


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
