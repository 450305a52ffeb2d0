"""The cameras of a study, in its order: their titles, families, and how they find depth."""

from __future__ import annotations

import json
from typing import Any

import xarray as xr

from tradestudy.results.views.groups import group


def camera_titles(tree: xr.DataTree) -> dict[str, str]:
    """Get the titles of all cameras by their keys."""
    return _by_key(tree, "title")


def camera_families(tree: xr.DataTree) -> dict[str, str]:
    """Get the families of all cameras by their keys."""
    return _by_key(tree, "family")


def titles_in(tree: xr.DataTree, name: str) -> dict[str, str]:
    """Get the titles of the cameras that a group is about, such as ``depth`` of those that measure depth."""
    keys = {str(key) for key in group(tree, name)["camera"].values}
    return {key: title for key, title in camera_titles(tree).items() if key in keys}


def depth_methods(tree: xr.DataTree) -> dict[str, dict[str, Any]]:
    """Get how each camera that measures depth finds it, by its key."""
    return {key: json.loads(method) for key, method in _by_key(tree, "method").items() if method}


def _by_key(tree: xr.DataTree, variable: str) -> dict[str, str]:
    data = group(tree, "cameras")
    return {str(key): str(value) for key, value in zip(data["camera"].values, data[variable].values, strict=True)}
