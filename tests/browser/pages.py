"""Reports opened in a Chromium, and what is wrong with them."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

GRAVE = ("serious", "critical")
WIDTHS = {"desktop": 1280, "phone": 390}
_OPTIONS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Visit:
    """A page that is open, and what it reported while it was."""

    page: Any
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


def find_chromium() -> str | None:
    """The Chromium of `CHROMIUM`, or an installed one."""
    return os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)


@contextmanager
def launched(playwright: Any, path: str) -> Iterator[Any]:
    browser = playwright.chromium.launch(executable_path=path, args=list(_OPTIONS))
    try:
        yield browser
    finally:
        browser.close()


@contextmanager
def opened(
    browser: Any, report: Path, *, width: int = 1280, dark: bool = False, script: bool = True, touch: bool = False
) -> Iterator[Visit]:
    """A report; the page may neither report an error nor ask for anything else."""
    context = browser.new_context(
        viewport={"width": width, "height": 900},
        color_scheme="dark" if dark else "light",
        java_script_enabled=script,
        has_touch=touch,
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


# Tables of the page itself, and one of those that the script makes: all of them would be many thousand cells.
_OPEN = """() => {
    const every = [...document.querySelectorAll("details")];
    for (const one of [...every.filter((one) => one.querySelector("table")), ...every.slice(-1)]) one.open = true;
}"""


def grave_findings(axe: Any, page: Any) -> dict[str, str]:
    """What axe finds serious in a page with tables of values open: the rule, and the first place."""
    page.evaluate(_OPEN)
    found = axe.run(page).response["violations"]
    return {one["id"]: one["nodes"][0]["html"] for one in found if one["impact"] in GRAVE}
