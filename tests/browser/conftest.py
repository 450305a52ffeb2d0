"""Reports in a browser: `pytest tests/browser`, with `--reports DIR` for the finished reports in folders of DIR too.

Needs the extra `browser` and a Chromium (`CHROMIUM` names another one than those looked for); skipped without them.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

import tradestudy

STUDIES = Path(__file__).parents[2] / "studies"
_OPTIONS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--reports", type=Path, help="folder of finished runs, each to be checked for accessibility")


@dataclass(frozen=True, kw_only=True)
class Visit:
    """A page that is open, and what it reported while it was."""

    page: Any
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


Open = Callable[..., Any]


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (extra `browser`)")
    found = os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)
    if found is None:
        pytest.skip("no Chromium is installed")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=list(_OPTIONS))
        yield browser
        browser.close()


@pytest.fixture
def visit(chromium: Any) -> Open:
    """Opens a report as a context manager; the page may neither report an error nor ask for anything else."""

    @contextmanager
    def open_page(report: Path, *, width: int = 1280, dark: bool = False, script: bool = True) -> Iterator[Visit]:
        context = chromium.new_context(
            viewport={"width": width, "height": 900},
            color_scheme="dark" if dark else "light",
            java_script_enabled=script,
            reduced_motion="reduce",
        )
        page = context.new_page()
        seen = Visit(page=page)
        page.on("pageerror", lambda error: seen.errors.append(str(error)))
        page.on("console", lambda message: seen.errors.append(message.text) if message.type == "error" else None)
        page.on("request", lambda request: seen.requests.append(request.url))
        page.goto(report.as_uri())
        try:
            yield seen
        finally:
            context.close()
        assert seen.errors == []
        assert [url for url in seen.requests if not url.startswith("data:")] == [report.as_uri()]

    return open_page


@dataclass(frozen=True, kw_only=True)
class Run:
    """A finished run."""

    report: Path
    tree: xr.DataTree


def _run(study: str, folder: Path) -> Run:
    result = tradestudy.load(STUDIES / f"{study}.yaml").run()
    result.write(folder, pdf=False)
    return Run(report=folder / "report.html", tree=result.data)


@pytest.fixture(scope="session")
def headline(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return _run("plenoptic_vs_stereo", tmp_path_factory.mktemp("headline"))


@pytest.fixture(scope="session")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return _run("stereo_design", tmp_path_factory.mktemp("sweep"))


@pytest.fixture(scope="session")
def reports(request: pytest.FixtureRequest, headline: Run, sweep: Run) -> list[Path]:
    """Both reports, and those of `--reports`."""
    folder = request.config.getoption("reports")
    return [headline.report, sweep.report, *(sorted(folder.glob("*/report.html")) if folder else ())]
