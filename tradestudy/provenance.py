"""The provenance of a run: study, code, versions, machine. It does not affect any result."""

from __future__ import annotations

import errno
import hashlib
import importlib.metadata
import json
import os
import platform
import stat
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

LIBRARIES = ("numpy", "scipy", "xarray", "h5netcdf", "matplotlib", "pandas", "pydantic", "ruamel.yaml", "pint", "typst")


def study_hash(tree: Mapping[str, Any]) -> str:
    """SHA-256 of a study's content, with cameras and overrides resolved."""
    return hashlib.sha256(json.dumps(tree, sort_keys=True, default=str).encode()).hexdigest()


def require_regular_file(path: Path) -> None:
    """Refuse folders, and also pipes and devices, which might never end.

    Raises
    ------
    OSError
        There is no such file, or it is not a regular one.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "not a regular file", str(path))


def file_hash(path: Path) -> str:
    """SHA-256 of a file's bytes; empty if it cannot be read, which the code that needs the file reports."""
    try:
        require_regular_file(path)
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


def values_by_path(tree: Mapping[str, Any]) -> dict[str, str]:
    """Every value that a study declares, as text by dotted path."""
    flat: dict[str, str] = {}
    # A stack, which returns its last entry first: reversed, so that values keep the order of the study.
    pending: list[tuple[str, Any]] = [(key, value) for key, value in reversed(list(tree.items()))]
    while pending:
        path, value = pending.pop()
        if isinstance(value, Mapping) and value:
            pending += [(f"{path}.{key}", child) for key, child in reversed(list(value.items()))]
        else:
            flat[path] = str(value)
    return flat


@cache
def code_hash() -> str:
    """SHA-256 of the package's own sources and tables, so that results of other code are recognised."""
    digest = hashlib.sha256()
    folder = Path(__file__).parent
    for path in sorted(path for path in folder.rglob("*") if path.suffix in (".py", ".tsv", ".txt")):
        digest.update(path.relative_to(folder).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def versions() -> dict[str, str]:
    """Versions of Python, of this package and of the libraries that results and pictures depend on."""
    return {
        "python": platform.python_version(),
        "tradestudy": importlib.metadata.version("tradestudy"),
    } | {name: importlib.metadata.version(name) for name in LIBRARIES}


def machine() -> dict[str, str | int]:
    """The machine, as far as it affects computing times."""
    return {
        "system": platform.system(),
        "release": platform.release(),
        "architecture": platform.machine(),
        "cores": cores(),
    }


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
