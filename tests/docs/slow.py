"""All blocks of the pages that have slow ones: ``python -m tests.docs.slow`` (some minutes)."""

from __future__ import annotations

import tempfile
from pathlib import Path

from tests.docs.blocks import ROOT, run_page, slow_pages

if __name__ == "__main__":
    for page in slow_pages():
        print(page.relative_to(ROOT), flush=True)
        with tempfile.TemporaryDirectory() as folder:
            run_page(page, Path(folder), slow=True)
