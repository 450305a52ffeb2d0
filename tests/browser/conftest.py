"""Reports in a browser: `pytest tests/browser`, with `--reports DIR` for the finished reports in folders of DIR too.

Needs the extra `browser` and a Chromium (`CHROMIUM` names another one than those looked for); skipped without them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

import tradestudy
from tests.browser.pages import find_chromium, launched, opened

STUDIES = Path(__file__).parents[2] / "studies"
# The others are looked at by `python -m tests.browser.every_report`.
QUICK = ("robot", "hand_lens", "close_range", "hard_cases", "real_rig")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--reports", type=Path, help="folder of finished runs, each to be checked for accessibility")


Open = Callable[..., Any]


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (extra `browser`)")
    if (path := find_chromium()) is None:
        pytest.skip("no Chromium is installed")
    with sync_api.sync_playwright() as playwright, launched(playwright, path) as browser:
        yield browser


@pytest.fixture
def visit(chromium: Any) -> Open:
    """Opens a report as a context manager."""
    return partial(opened, chromium)


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
def reports(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, headline: Run, sweep: Run
) -> list[Path]:
    """Those of all studies that are quick to compute, and those of `--reports`."""
    folder = request.config.getoption("reports")
    quick = [_run(study, tmp_path_factory.mktemp(study)).report for study in QUICK]
    return [headline.report, sweep.report, *quick, *(sorted(folder.glob("*/report.html")) if folder else ())]
