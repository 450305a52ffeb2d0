"""The notebook that newcomers open runs from its first cell to its last."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

STUDIES = Path(__file__).parents[2] / "studies"


@pytest.mark.slow
def test_explore_runs_and_shows_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    # A backend of the caller's would keep the notebook's own from showing figures.
    monkeypatch.delenv("MPLBACKEND", raising=False)
    notebook = nbformat.read(STUDIES / "explore.ipynb", as_version=4)
    NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(STUDIES)}}).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    pictures = [set(output.get("data", {})) & {"image/svg+xml", "image/png"} for output in outputs]
    assert sum(map(bool, pictures)) == 2
    assert any("Raytrix R5" in output.get("data", {}).get("text/html", "") for output in outputs)
