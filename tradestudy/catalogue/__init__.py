"""Cameras that this package knows: their files, and an index by which they are listed without reading these."""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Final

PREFIX: Final = "catalogue/"
"""What stands before the name of an entry in the key ``from``."""
_FOLDER: Final = Path(str(files("tradestudy.catalogue")))
INDEX: Final = _FOLDER / "index.json"


@dataclass(frozen=True, kw_only=True)
class Listed:
    """One mode of a camera of the catalogue, in SI units.

    Parameters
    ----------
    entry, mode
        Name of the entry, and of the mode; the latter is empty if the camera has only one.
    title, kind, revision, projector
        Its title in studies, its kind, the revision of the entry, and whether a projector is on; empty if unknown.
    pixels
        Columns and rows.
    focal_length_px, field_of_view
        Focal length [px] and horizontal field of view [rad].
    baseline
        Largest distance between two views [m]; None for a camera that measures no depth.
    nearest, one_pixel
        Nearest distance [m] by the disparities that are searched, None where these are unknown; and the distance at
        which the disparity is one pixel, None for other cameras than stereo rigs with parallel axes.
    """

    entry: str
    mode: str
    title: str
    kind: str
    revision: str
    projector: str
    pixels: tuple[int, int]
    focal_length_px: float
    field_of_view: float
    baseline: float | None
    nearest: float | None
    one_pixel: float | None


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """A camera that the catalogue lacks, and the values for which no source was found."""

    camera: str
    missing: str
    found: str


def entry_names() -> tuple[str, ...]:
    """Names of all entries, in alphabetical order."""
    return tuple(sorted(path.stem for path in (_FOLDER / "entries").glob("*.yaml")))


def entry_path(name: str) -> Path:
    """File of an entry."""
    return _FOLDER / "entries" / f"{name}.yaml"


def revision(name: str) -> str:
    """Revision of an entry: the first 12 digits of the SHA-256 of its file, which change with every change of it."""
    return hashlib.sha256(entry_path(name).read_bytes()).hexdigest()[:12]


def listed() -> tuple[Listed, ...]:
    """Every mode of every entry, from the index."""
    rows = json.loads(INDEX.read_text(encoding="utf-8"))
    return tuple(Listed(**{**row, "pixels": tuple(row["pixels"])}) for row in rows)


def wanted() -> Iterator[Wanted]:
    """Cameras for whose values no source was found."""
    with (_FOLDER / "wanted.tsv").open(encoding="utf-8", newline="") as file:
        yield from (Wanted(**row) for row in csv.DictReader(file, delimiter="\t"))
