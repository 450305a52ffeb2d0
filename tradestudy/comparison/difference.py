"""A difference between runs as one line, and the runs themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import xarray as xr

from tradestudy.results.views.groups import camera_titles

ARROW = " → "


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A finished run: its name, the content of its ``run.json``, and its results."""

    name: str
    record: Mapping[str, Any]
    tree: xr.DataTree


@dataclass(frozen=True, kw_only=True)
class Difference:
    """One thing that differs between runs.

    Parameters
    ----------
    what
        What differs, in words.
    values
        Its value in each run, in words.
    where
        Distances and details, in words; may be empty.
    """

    what: str
    values: tuple[str, ...]
    where: str = ""

    @property
    def change(self) -> str:
        """The values one after the other, and where they differ."""
        return " ".join(filter(None, (ARROW.join(self.values), self.where)))

    def __str__(self) -> str:
        return f"{self.what}: {self.change}"


def same_or_each(texts: Sequence[str]) -> str:
    """The text if all are the same, else each different one once."""
    return " / ".join(dict.fromkeys(texts))


def titles_of(runs: Sequence[Run]) -> dict[str, str]:
    """Titles of the cameras of all runs by key; a camera with different titles has all of them."""
    found = [camera_titles(run.tree) if "cameras" in run.tree.children else {} for run in runs]
    return {
        key: same_or_each([titles[key] for titles in found if key in titles])
        for key in dict.fromkeys(key for titles in found for key in titles)
    }


def common_cameras(runs: Sequence[Run], group: str) -> tuple[str, ...]:
    """Keys of the cameras that a group contains in every run, in the order of the first run."""
    if not all(group in run.tree.children and "camera" in run.tree[group].coords for run in runs):
        return ()
    keys = [[str(key) for key in run.tree[group].to_dataset()["camera"].values] for run in runs]
    return tuple(key for key in keys[0] if all(key in others for others in keys[1:]))
