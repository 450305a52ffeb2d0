"""Pictures and depth maps from files: PNG, TIFF and NPY."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray


def read_picture(file: Path) -> FloatArray:
    """Brightness in one or three colours, shape (colours, rows, columns); the values of the file are linear.

    Raises
    ------
    OutOfRangeError
        The file is not a picture, or it is black.
    """
    values = _values(file)
    values = values[..., :3] if values.ndim == 3 and values.shape[-1] in (3, 4) else values
    if values.ndim == 3 and values.shape[-1] == 3:
        values = np.moveaxis(values, -1, 0)
    elif values.ndim == 2:
        values = values[None]
    if values.ndim != 3 or values.shape[0] not in (1, 3):
        raise OutOfRangeError(
            "shape of a picture", value=f"{values.shape} in {file}", limit="grey, or red, green, blue"
        )
    if not (np.all(np.isfinite(values)) and np.all(values >= 0.0) and values.mean() > 0.0):
        raise OutOfRangeError("brightness of a picture", value=str(file), limit="0 or more, and not 0 everywhere")
    return np.asarray(values, np.float32)


def read_depths(file: Path, unit: float) -> FloatArray:
    """Depths [m], shape (rows, columns), of a map whose values are in a unit [m].

    Raises
    ------
    OutOfRangeError
        The file is not a depth map, or it has holes.
    """
    values = _values(file)
    if values.ndim != 2 or min(values.shape) < 2:
        raise OutOfRangeError(
            "shape of a depth map", value=f"{values.shape} in {file}", limit="2 × 2 pixels or more, one value each"
        )
    holes = int(np.count_nonzero(~(np.isfinite(values) & (values > 0.0))))
    if holes:
        raise OutOfRangeError(
            "depths that are not above zero",
            value=f"{holes} pixels of {file}",
            limit="none",
            remedy="fill the holes of the map",
        )
    return np.asarray(values * unit)


def _values(file: Path) -> FloatArray:
    try:
        if file.suffix.lower() == ".npy":
            return np.asarray(np.load(file, allow_pickle=False), np.float64)
        from PIL import Image

        # The library warns only of invalid tags, which do not matter here; invalid pixels raise an error.
        with warnings.catch_warnings(action="ignore", category=UserWarning), Image.open(file) as picture:
            return np.asarray(picture.convert("RGB") if picture.mode == "P" else picture, np.float64)
    except (OSError, ValueError) as error:
        raise OutOfRangeError(
            "a file that cannot be read",
            value=f"{file}: {getattr(error, 'strerror', None) or error}",
            limit="PNG, TIFF or NPY",
        ) from error
