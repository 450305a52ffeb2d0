"""The notebooks that newcomers open run from their first cell to their last."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

STUDIES = Path(__file__).parents[2] / "studies"


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Any:
    # A backend of the caller's would keep the notebook's own from showing figures.
    monkeypatch.delenv("MPLBACKEND", raising=False)

    def outputs(name: str) -> list[dict[str, Any]]:
        notebook = nbformat.read(STUDIES / name, as_version=4)
        assert not any(cell.get("outputs") for cell in notebook.cells), "outputs are not kept"
        NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(STUDIES)}}).execute()
        return [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]

    return outputs


def pictures(outputs: list[dict[str, Any]]) -> int:
    return sum(bool(set(output.get("data", {})) & {"image/svg+xml", "image/png"}) for output in outputs)


@pytest.mark.slow
def test_explore_runs_and_shows_figures(run: Any) -> None:
    outputs = run("explore.ipynb")
    assert pictures(outputs) == 2
    assert any("Raytrix R5" in output.get("data", {}).get("text/html", "") for output in outputs)


@pytest.mark.slow
def test_optimise_agrees_with_a_simulation_and_with_the_closed_form(run: Any) -> None:
    outputs = run("optimise.ipynb")  # whose own assertions compare them
    assert pictures(outputs) == 1
    texts = [output["text"] for output in outputs if output["output_type"] == "stream"]
    assert texts[0] == "baseline 111 mm, focal length 3.18 mm: ±2.43 mm at 1 m\n"
