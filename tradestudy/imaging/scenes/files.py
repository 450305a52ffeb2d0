"""Pictures and depth maps from files: PNG, TIFF and NPY."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Final

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.provenance import require_regular_file

MOST_PIXELS: Final = 100_000_000
"""Largest number of pixels of a picture or depth map, and of numbers in an array: 0.8 GB in double precision."""
LARGEST_VALUE: Final = 1e12
"""Largest brightness or depth of a file: squares of depths are computed in single precision."""


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
        require_regular_file(file)
        values = _array(file) if file.suffix.lower() == ".npy" else _image(file)
    except OutOfRangeError:
        raise
    except Exception as error:  # damaged files make the libraries raise errors of any kind
        raise OutOfRangeError(
            "a file that cannot be read",
            value=f"{file}: {getattr(error, 'strerror', None) or error}",
            limit="PNG, TIFF or NPY",
        ) from error
    largest = float(np.max(values[np.isfinite(values)], initial=0.0))
    if largest > LARGEST_VALUE:
        raise OutOfRangeError(
            "a value of a picture or depth map", value=f"{largest:g} in {file}", limit=f"{LARGEST_VALUE:g}"
        )
    return values


def _array(file: Path) -> FloatArray:
    """The numbers of an NPY file, of which only the header is read before its size and type are known."""
    found = np.load(file, mmap_mode="r", allow_pickle=False)
    if not isinstance(found, np.ndarray) or found.dtype.kind not in "biuf":
        kind = found.dtype if isinstance(found, np.ndarray) else "an archive"
        raise OutOfRangeError("the type of an array", value=f"{kind} in {file}", limit="real numbers")
    _require_size(file, found.size)
    return np.array(found, np.float64)


def _image(file: Path) -> FloatArray:
    from PIL import Image

    # The library warns of invalid tags, which do not matter (invalid pixels raise an error), and of large pictures.
    with warnings.catch_warnings(action="ignore"), Image.open(file) as picture:
        _require_size(file, picture.width * picture.height)
        return np.asarray(picture.convert("RGB") if picture.mode == "P" else picture, np.float64)


def _require_size(file: Path, pixels: int) -> None:
    if not 0 < pixels <= MOST_PIXELS:
        raise OutOfRangeError(
            "the size of a picture or depth map",
            value=f"{pixels:,} values in {file}",
            limit=f"1 to {MOST_PIXELS:,}",
            remedy="reduce its resolution, or crop it",
        )
