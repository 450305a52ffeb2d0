"""Write the index of the catalogue from its entries: ``python -m tests.catalogue_index``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict

from tradestudy.catalogue import INDEX, PREFIX, entry_names
from tradestudy.study.catalogue_entries import entry_of, index_row


def _rows() -> Iterator[str]:
    for name in entry_names():
        entry = entry_of(PREFIX + name)
        for mode, camera in entry.cameras:
            yield json.dumps(asdict(index_row(name, mode, camera, entry)), ensure_ascii=False)


def text() -> str:
    """The index, one row a line."""
    return "[\n" + ",\n".join(_rows()) + "\n]\n"


if __name__ == "__main__":
    INDEX.write_text(text(), encoding="utf-8")
