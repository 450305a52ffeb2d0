"""The documentation in a browser: nothing grave, and nothing wider than a telephone."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.browser.pages import WIDTHS, grave_findings

ROOT = Path(__file__).parents[2]
_PAGES = (  # with code, tables, figures, pictures, keys and signatures
    "index",
    "tutorials/two-cameras",
    "explanation/plenoptic-and-distance",
    "reference/studies",
    "reference/generated/study/stereo",
    "reference/python",
)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("furo", reason="the documentation's packages are not installed (extra `docs`)")
    folder = tmp_path_factory.mktemp("site")
    subprocess.run([sys.executable, "-m", "sphinx", "--quiet", "-W", "docs", folder], cwd=ROOT, check=True)
    return folder


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", WIDTHS.values(), ids=WIDTHS)
def test_pages_are_accessible_and_scroll_one_way(chromium: Any, site: Path, width: int, dark: bool) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    context = chromium.new_context(
        viewport={"width": width, "height": 900}, color_scheme="dark" if dark else "light", reduced_motion="reduce"
    )
    page = context.new_page()
    for name in _PAGES:
        page.goto((site / f"{name}.html").as_uri())
        assert grave_findings(axe, page) == {}, name
        assert page.evaluate("document.documentElement.scrollWidth") <= width, name
    context.close()
