"""On what unfocused plenoptic cameras can refocus, in words, and the planes of each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

from tradestudy.results.views.groups import FloatArray, group, has, titles_in
from tradestudy.units import LENGTH, PIXELS, pretty
from tradestudy.wording import counted, distance, range_words, with_article


def refocused_cameras(tree: xr.DataTree) -> Iterator[tuple[str, xr.Dataset]]:
    """Title and planes of each camera that the study refocuses, by increasing shift."""
    if not has(tree, "refocusing", "shift"):
        return
    data = group(tree, "refocusing")
    for key, title in titles_in(tree, "refocusing").items():
        camera = data.sel(camera=key)
        shifts = camera["shift"].values
        order = np.argsort(shifts)[: int(np.isfinite(shifts).sum())]
        yield title, camera.isel(plane=order)


def depth_of_field(camera: xr.Dataset, by: str) -> FloatArray:
    """Far minus near limit [m] by "ray" or by "blur" along the planes of a camera."""
    return np.asarray(camera[f"{by}_far"].values - camera[f"{by}_near"].values, dtype=np.float64)


def refocusing_words(tree: xr.DataTree) -> Iterator[str]:
    """For each camera: its range and number of planes, and both depths of field in the plane nearest to its focus."""
    for title, camera in refocused_cameras(tree):
        reach, planes = (
            range_words(float(camera["near"]), float(camera["far"])),
            counted(int(camera["planes"]), "distinct plane"),
        )
        words = f"{with_article(title)} can be refocused {reach}, on {planes}"
        bounded = np.isfinite(depth_of_field(camera, "ray")) & np.isfinite(depth_of_field(camera, "blur"))
        if bounded.any():
            k = int(np.argmin(np.where(bounded, np.abs(camera["shift"].values), np.inf)))
            rays, blurred = (pretty(float(depth_of_field(camera, by)[k]), LENGTH) for by in ("ray", "blur"))
            by = f"{blurred} by blur of {pretty(float(camera.attrs['blur_px']), PIXELS)} and {rays} by rays"
            words += f"; refocused on {distance(float(camera['refocused_distance'][k]))}, its depth of field is {by}"
        yield words[0].upper() + words[1:]
