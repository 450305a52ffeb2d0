"""Write the index of the catalogue from its entries: ``python -m tests.catalogue_index``."""

from __future__ import annotations

import json

from tradestudy.catalogue import INDEX
from tradestudy.study.catalogue_entries import index


def text() -> str:
    """The index, one row a line."""
    return "[\n" + ",\n".join(json.dumps(row, ensure_ascii=False) for row in index()) + "\n]\n"


if __name__ == "__main__":
    INDEX.write_text(text(), encoding="utf-8")
