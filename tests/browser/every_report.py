"""The report of every shipped study in a Chromium: axe, console errors and width, light and dark, desktop and phone.

    python -m tests.browser.every_report --runs DIR

Computes the studies that have no results in DIR yet (half an hour for all of them), renders their reports again, and
looks at each. Figures go to every_report.md beside this file; ends with 1 where something is wrong.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import sync_playwright

import tradestudy
from tests.browser.pages import WIDTHS, find_chromium, grave_findings, launched, opened
from tests.campaigns import record
from tests.report.layout import unreadable
from tradestudy import api, figures
from tradestudy.results.storage import read_finished

STUDIES = Path(__file__).parents[2] / "studies"


def _report(study: Path, runs: Path) -> Path:
    folder = runs / study.stem
    if not (folder / "results.nc").exists():
        tradestudy.load(study).run().write(folder, pdf=False)
    api.report(folder, pdf=False)
    return folder / "report.html"


def _faults(browser: Any, report: Path) -> Iterator[str]:
    """What is wrong with a report in a browser and with its figures on paper."""
    for (where, width), dark in itertools.product(WIDTHS.items(), (False, True)):
        here = f"{where}, {'dark' if dark else 'light'}"
        try:
            with opened(browser, report, width=width, dark=dark) as seen:
                yield from (f"{here}: {rule}: {place}" for rule, place in grave_findings(Axe(), seen.page).items())
                if seen.page.evaluate("document.documentElement.scrollWidth") > width:
                    yield f"{here}: wider than the window"
        except AssertionError as error:
            yield f"{here}: {error}"
    for name, drawing in figures.build(read_finished(report.parent)[0]).items():
        yield from (f"{name}: {fault}" for fault in unreadable(drawing.draw()))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--runs", type=Path, required=True, help="folder of runs, each under the name of its study's file"
    )
    runs = parser.parse_args().runs
    if (path := find_chromium()) is None:
        parser.error("no Chromium is installed")
    rows, wrong = [], 0
    with sync_playwright() as playwright, launched(playwright, path) as browser:
        for study in sorted(STUDIES.glob("*.yaml")):
            report = _report(study, runs)
            faults = list(_faults(browser, report))
            print(study.stem, *(faults or ["in order"]), sep="\n  ", flush=True)
            wrong += len(faults)
            shown = len(figures.build(read_finished(report.parent)[0]))
            rows.append((study.stem, shown, f"{report.stat().st_size / 1e6:.2f} MB", len(faults)))
    title = "Reports of all shipped studies in a Chromium"
    header = ("study", "figures", "HTML", "serious findings, errors, unreadable texts")
    record.write("every_report", title, "python -m tests.browser.every_report", header, rows, Path(__file__).parent)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
