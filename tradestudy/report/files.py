"""Files that are either whole or not there: written beside their place, then moved into it."""

from __future__ import annotations

from pathlib import Path

from tradestudy.results.storage import replacing


def replace_file(path: Path, content: bytes) -> None:
    """Write a file so that a reader sees the old content or the new, never a part of it.

    Parameters
    ----------
    path
        Where it belongs; missing folders are made.
    content
        All of it.

    Raises
    ------
    OSError
        If it cannot be written; the old file is untouched and nothing else is left behind.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(content)
