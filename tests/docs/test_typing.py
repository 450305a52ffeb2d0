"""Code that follows the documentation passes the strictest type checks, without casts or comments."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib import resources
from pathlib import Path

import pytest

import tradestudy
from tests.docs.blocks import PAGES, ROOT, blocks
from tradestudy.errors import OutOfRangeError

PROGRAM = """
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

import tradestudy
from tradestudy import optics
from tradestudy.uncertainty import Normal, Spread, propagate_through


def add(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return a + b


normals: dict[str, Normal] = {name: Normal(0.0, 1.0) for name in "ab"}
table = pd.DataFrame(np.eye(2), index=["a", "b"], columns=["a", "b"])
spreads: list[Spread] = [
    propagate_through(add, normals),
    propagate_through(add, {"a": normals["a"], "b": stats.gamma(2.0)}, correlation={("a", "b"): 0.5}),
    propagate_through(add, [stats.norm(0.0, 1.0), stats.uniform(2.0, 3.0)]),
    propagate_through(add, stats.multivariate_normal([0.0, 0.0], [[1.0, 0.5], [0.5, 1.0]])),
    propagate_through(add, table),
    propagate_through(add, table.mean(), covariance=table.cov()),
    propagate_through(add, {"a": 0.0, "b": 1.0}, covariance=table),
    propagate_through(add, np.zeros(2), covariance=[[1.0, 0.0], [0.0, 1.0]]),
    propagate_through(lambda a, b, c: a + b + c, {("a", "b"): np.zeros((9, 2)), "c": normals["a"]}),
]
psf = optics.point_spread(focal_length=50e-3, f_number=8, wavelength=550e-9)
mtf = psf.modulation_transfer([0.0, 1e5])
numbers: list[float] = [float(1.0 - psf.strehl_ratio()), float(mtf[0]), float(np.asarray(mtf).mean())]
study = tradestudy.load("study.yaml")
camera = study.cameras["rig"]
image = optics.microlens_image(camera.light_chain(), optics.PointSource(distance=1.0), wavelength=550e-9)
print(image.light_per_microlens.value.sum(), camera.depth_uncertainty(1.0).mean())
print(tradestudy.render(study, "pictures").arrays["rig"]["left"].mean())
"""


def code_of_page(page: Path) -> str:
    """The Python of a page, each line at its place in the page."""
    lines = [""] * (len(page.read_text(encoding="utf-8").splitlines()) + 1)
    for block in blocks(page):
        if block.language == "python":
            session = block.text.startswith(">>>")
            for place, line in enumerate(block.text.splitlines(), start=block.line):
                lines[place] = line if not session else line[4:] if line.startswith((">>>", "...")) else ""
    return "\n".join(lines) + "\n"


def code_of_notebook(notebook: Path) -> str:
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code") + "\n"


@pytest.mark.slow
def test_the_code_of_pages_and_notebooks_has_strict_types(tmp_path: Path) -> None:
    codes = {path: code_of_page(path) for path in PAGES}
    codes |= {path: code_of_notebook(path) for path in (ROOT / "studies").glob("*.ipynb")}
    codes[ROOT / "program"] = PROGRAM
    for path, code in codes.items():
        name = "_".join(path.relative_to(ROOT).with_suffix("").parts).replace("-", "_")
        (tmp_path / f"{name}.py").write_text(code, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file", "pyproject.toml", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"in {len(codes)} source files" in done.stdout


def test_the_package_ships_its_types() -> None:
    assert (resources.files(tradestudy) / "py.typed").is_file()


def test_every_camera_has_a_light_chain_or_says_that_it_has_no_microlenses() -> None:
    cameras = tradestudy.load(ROOT / "studies" / "plenoptic_vs_stereo.yaml").cameras
    chain = cameras["raytrix-r5"].light_chain()
    assert chain.pixel_pitch == cameras["raytrix-r5"].pixel_pitch
    with pytest.raises(OutOfRangeError, match="microlens array"):
        cameras["stereo-short"].light_chain()
