"""Pictures of the README and the documentation: described, small, shown, and drawn by the scripts beside them."""

from __future__ import annotations

import re
import runpy
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

import tradestudy
from tests.docs.blocks import PAGES, ROOT

_PICTURE = re.compile(r"!\[(?P<alt>[^\]]*)\]\((?P<file>[^)\s]+)\)")
_LARGEST = 60_000  # bytes
DIAGRAMS = ROOT / "docs" / "diagrams"


def shown() -> dict[Path, str]:
    """The files of pictures that pages show, with their descriptions."""
    pictures: dict[Path, str] = {}
    for page in PAGES:
        for picture in _PICTURE.finditer(page.read_text(encoding="utf-8")):
            pictures[(page.parent / picture["file"]).resolve()] = picture["alt"]
    return pictures


@pytest.fixture(scope="module")
def diagrams() -> dict[str, Any]:
    return runpy.run_path(str(DIAGRAMS / "draw.py"))


def test_pictures_are_described_and_small() -> None:
    for path, described in shown().items():
        assert len(described) > 20, path
        assert ROOT / "docs" not in path.parents or 0 < path.stat().st_size < _LARGEST, path


def test_every_picture_is_shown() -> None:
    pictures = {path for path in (ROOT / "docs").rglob("*") if path.suffix in {".svg", ".png", ".webp"}}
    assert {path for path in pictures if "_build" not in path.parts} <= shown().keys()


def test_the_diagrams_are_those_of_the_script_in_both_grounds(diagrams: dict[str, Any], tmp_path: Path) -> None:
    diagrams["write"](tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in DIAGRAMS.glob("*.svg")}
    for path in tmp_path.iterdir():
        drawn, kept = path.read_text(encoding="utf-8"), (DIAGRAMS / path.name).read_text(encoding="utf-8")
        assert ET.fromstring(drawn).get("viewBox") == ET.fromstring(kept).get("viewBox")
        colours = set(re.findall(r"(?:fill|stroke): (#\w{6})", kept))
        assert colours <= diagrams["DARK"].keys()
        assert all(f"{dark} !important" in kept for dark in diagrams["DARK"].values())


def test_lenses_of_diagrams_bend_rays_in_proportion_to_their_height(diagrams: dict[str, Any]) -> None:
    """A thin lens of focal length f changes the slope of a ray at height y by -y/f."""
    pupil, *_ = diagrams["baseline_within_the_pupil"]().axes
    both = diagrams["keplerian_and_galilean"]().axes
    for axes, rays in ((pupil, 2), *((axes, 2) for axes in both)):
        lengths = []
        for line in axes.lines:
            x, y = line.get_data()
            if len(x) >= 3:
                before, behind = (y[1] - y[0]) / (x[1] - x[0]), (y[2] - y[1]) / (x[2] - x[1])
                lengths.append(y[1] / (before - behind))
        assert len(lengths) == rays
        assert lengths == pytest.approx([lengths[0]] * rays, rel=1e-12)


def test_the_diagram_of_the_covering_plane_colours_as_many_microlenses_as_it_says(diagrams: dict[str, Any]) -> None:
    (axes,) = diagrams["total_covering_plane"]().axes
    filled = [patch for patch in axes.patches if patch.get_zorder() == 3 and patch.get_facecolor()[3] > 0.0]
    assert len(filled) == 1 + 2 + 3


def test_the_figure_of_the_readme_shows_the_limits_of_the_usable_ranges() -> None:
    """Each of its cameras is best from its nearest usable distance to that of the next; the last, to its farthest."""
    result = tradestudy.open_result(ROOT / "reports" / "examples" / "plenoptic-vs-stereo")
    of = result.data["depth"].to_dataset().sel(camera=["stereo-short", "raytrix-r5", "stereo-65-across"])
    ends = [*of["usable_near"].values.ravel(), of["usable_far"].values.ravel()[-1]]
    written = [f"{end:.2g}" for end in ends]
    (described,) = (words for path, words in shown().items() if path.name == "answer.svg")
    assert re.findall(r"(?:From|to)\s(\d\.\d+)", described.split("10 m.")[1]) == written
    (axes,) = runpy.run_path(str(ROOT / "docs" / "pictures" / "draw.py"))["answer"](result).axes
    assert [label.get_text() for label in axes.get_xticklabels()] == ["0.05", *written, "10"]
