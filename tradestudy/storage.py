"""Results on disk: complete files only, the same bytes for the same results, and a word for what cannot be read."""

from __future__ import annotations

import contextlib
import json
import os
import platform
import re
import secrets
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from tradestudy.errors import ResultsError
from tradestudy.results import FORMAT_VERSION

RESULTS = "results.nc"
RUN = "run.json"


_PART = re.compile(r"\..+\.[0-9a-f]{8}\.(?P<process>\d+)@(?P<machine>.+)\.part")


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path beside ``path``; it takes the place of ``path`` only if the block ends well."""
    path.parent.mkdir(parents=True, exist_ok=True)
    owner = f"{os.getpid()}@{platform.node()}"
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.{owner}.part")
    try:
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())  # or a power failure could leave a whole name on half a content
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def remove_abandoned(directory: Path) -> None:
    """Remove what killed processes of this machine have left half-written in a folder and the folders in it."""
    for part in (*directory.glob(".*.part"), *directory.glob("*/.*.part")):
        owner = _PART.fullmatch(part.name)
        if owner and owner["machine"] == platform.node() and not _is_running(int(owner["process"])):
            part.unlink(missing_ok=True)


def _is_running(process: int) -> bool:
    """Whether a process of this machine is alive; where that cannot be asked without harm it counts as alive."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def write_results(tree: xr.DataTree, directory: Path) -> None:
    """Write ``results.nc`` whole or not at all."""
    content = tree.to_netcdf(engine="h5netcdf")  # in memory: HDF5 brings the process down where a disk is full
    with replacing(directory / RESULTS) as temporary:
        temporary.write_bytes(content)


def read_results(directory: Path) -> xr.DataTree:
    """Read ``results.nc`` into memory.

    Raises
    ------
    ResultsError
        Where it is missing, damaged, or of another format version.
    """
    path = directory / RESULTS
    if not path.is_file():
        raise ResultsError("no results here", value=str(path), remedy="run the study first")
    try:
        with xr.open_datatree(path, engine="h5netcdf") as opened:
            tree = opened.load()
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        raise ResultsError(
            "the results file cannot be read", value=f"{path}: {error}", remedy="run the study again"
        ) from error
    version = tree.attrs.get("format_version")
    if version != FORMAT_VERSION:
        raise ResultsError(
            "the results file has another format version",
            value=f"{version} in {path}",
            limit=str(FORMAT_VERSION),
            remedy="run the study again",
        )
    return tree


def write_run(run: Mapping[str, Any], directory: Path) -> None:
    """Write ``run.json`` whole or not at all."""
    with replacing(directory / RUN) as temporary:
        temporary.write_text(json.dumps(run, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def read_run(directory: Path) -> dict[str, Any]:
    """Read ``run.json``.

    Raises
    ------
    ResultsError
        Where it is missing or damaged.
    """
    path = directory / RUN
    try:
        run = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ResultsError(
            "the run's record cannot be read", value=f"{path}: {error}", remedy="run the study again"
        ) from error
    if not isinstance(run, dict):
        raise ResultsError("the run's record is not a mapping", value=str(path), remedy="run the study again")
    return run
