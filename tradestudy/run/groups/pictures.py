"""/pictures: the pictures of the scene, reduced to the size that results store and reports show."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.run.groups.depth_maps import depth_map_values
from tradestudy.run.groups.reduction import LARGEST, padded
from tradestudy.run.pictures import TakenPicture
from tradestudy.run.scene_pictures import TakenScene

_DETAIL: Final = 96  # pixels


def pictures_group(taken: TakenScene) -> xr.Dataset:
    """/pictures over pictures with their rows and columns, and over the cameras that measured depth in them."""
    pictures = taken.rendering.pictures
    reduced = [_reduced(one) for one in pictures]
    rows, columns = (max(one[0].shape[k] for one in reduced) for k in (0, 1))
    values: dict[str, Any] = {
        "brightness": [padded(one[0], (rows, columns)) for one in reduced],
        "true_depth": [padded(one[1], (rows, columns)) for one in reduced],
        "detail": [padded(_detail(one), (_DETAIL, _DETAIL)) for one in pictures],
        "camera_of": [one.camera for one in pictures],
        "block": [float(_block(one)) for one in pictures],
        "columns": [float(one.values.shape[1]) for one in pictures],
        "rows": [float(one.values.shape[0]) for one in pictures],
        "pixel_pitch": [one.pixel_pitch for one in pictures],
        "saturated": [float(one.saturated) for one in pictures],
        "sampling_error": [one.sampling_error for one in pictures],
        "by_waves": [float(one.tile.waves is not None) for one in pictures],
        "model_error": [one.model_error for one in pictures],
    }
    labels = {"picture": [f"{one.camera} {one.name}" for one in pictures]}
    if taken.depths:
        values |= depth_map_values(taken.depths, {one.name: one.camera for one in taken.rendering.cameras})
        labels["mapped_camera"] = [one.camera for one in taken.depths]
    return dataset("pictures", values, labels)


def _block(one: TakenPicture) -> int:
    largest: int = max(one.values.shape)
    return math.ceil(largest / LARGEST)


def _reduced(one: TakenPicture) -> tuple[FloatArray, FloatArray]:
    """Brightness and depth of blocks; incomplete blocks at the right and bottom edges are left out."""
    side = _block(one)
    rows, columns = (size // side for size in one.values.shape)
    inside = one.values[: rows * side, : columns * side].astype(np.float64)
    blocks = inside.reshape(rows, side, columns, side).mean(axis=(1, 3))
    middle = slice(side // 2, None, side)
    return blocks / _brightest(one), one.depth[middle, middle][:rows, :columns].astype(np.float64)


def _detail(one: TakenPicture) -> FloatArray:
    top, left = (max(0, (size - _DETAIL) // 2) for size in one.values.shape)
    return one.values[top : top + _DETAIL, left : left + _DETAIL].astype(np.float64) / _brightest(one)


def _brightest(one: TakenPicture) -> float:
    return max(float(np.max(one.values)), np.finfo(np.float64).tiny)
