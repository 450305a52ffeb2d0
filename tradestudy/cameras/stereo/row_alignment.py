"""Alignment of the rows of the right picture to those of the left one, for a rig that deviates from its design."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from tradestudy.optics.arrays import FloatArray, IndexArray, Samples

_PATCHES: Final = 16  # along each side of the picture
_HALF_PATCH: Final = 15  # px
_LARGEST_OFFSET: Final = 0.02  # of the longer side of the picture; a calibrated rig has no larger one
_LEAST_REACH_PX: Final = 4  # rows searched even in a small picture
_LEAST_CORRELATION: Final = 0.7  # least correlation of two patches that show the same texture
_CORRELATION_DROP: Final = 0.1  # by which the correlation must fall on both sides of its only peak
_FEWEST_PATCHES: Final = 20  # patches needed to fit the five coefficients
_FEWEST_LINES: Final = 4  # different rows and columns in which they must lie
_LEAST_AGREEING: Final = 0.7  # fraction of the patches that must agree with the fit
_AGREEMENT_PX: Final = 0.5  # largest residual of a patch that agrees with the fit
_SCATTER_PX: Final = 0.2  # residual beyond which a patch counts as an outlier
_NEGLIGIBLE_PX: Final = 0.1  # too small an offset to affect matching windows
_SIGNIFICANT: Final = 3.0  # standard errors by which an offset must differ from zero


def row_alignment(left: Samples, right: Samples, steps: range, library: Any) -> Callable[[Samples], Samples]:
    """A function that resamples the right picture so that each point lies in the same row as in the left one.

    Small rotations between two parallel pinholes, different principal distances and a shift of the sensor displace rows
    by ``a + b u + c v + d u v + e v²`` (u, v from the middle of the picture), whatever the depth: a and e by pitch, b
    by roll, d by yaw. The coefficients are fitted, with a Cauchy loss, to patches of the left picture that are found
    again in the right one. Columns remain unchanged, since an error along them cannot be distinguished from depth.

    Parameters
    ----------
    left, right
        Pictures of parallel pinholes, shape (rows, columns); NaN where there is no light.
    steps
        Disparities to search [px].
    library
        OpenCV.

    Returns
    -------
    Callable[[Samples], Samples]
        Resamples a picture of the right camera. It returns the picture itself if no offset is both above 0.1 px and
        above three standard errors, or if too few patches are found or agree; patches count only where texture
        determines their row. Beyond the outermost patches, offsets are constant.
    """
    places, offsets = _offsets(left, right, steps, library)
    if len(offsets) < _FEWEST_PATCHES or min(np.unique(places[:, k]).size for k in (0, 1)) < _FEWEST_LINES:
        return _unchanged
    from scipy.optimize import least_squares

    hull = np.stack([places.min(axis=0), places.max(axis=0)])
    base = _basis(places, left.shape)
    start = np.array([np.median(offsets), 0.0, 0.0, 0.0, 0.0])

    def residuals(coefficients: FloatArray) -> FloatArray:
        return np.asarray(base @ coefficients - offsets)

    fit = least_squares(residuals, start, loss="cauchy", f_scale=_SCATTER_PX)
    scatter = 1.4826 * float(np.median(np.abs(fit.fun)))
    agreeing = float(np.mean(np.abs(fit.fun) < _AGREEMENT_PX))
    border = _basis(np.stack(np.meshgrid(*np.linspace(hull[0], hull[1], 5).T), axis=-1).reshape(-1, 2), left.shape)
    error = scatter * np.linalg.norm(border @ np.linalg.pinv(base), axis=1)
    moved = np.abs(border @ fit.x)
    if agreeing < _LEAST_AGREEING or not np.any((moved > _NEGLIGIBLE_PX) & (moved > _SIGNIFICANT * error)):
        return _unchanged
    return lambda picture: _resampled(picture, fit.x, hull)


def _unchanged(picture: Samples) -> Samples:
    return picture


def _offsets(left: Samples, right: Samples, steps: range, library: Any) -> tuple[FloatArray, FloatArray]:
    """Patches of the left picture that are found in the right one: their row and column there, and row offset [px]."""
    reach = max(_LEAST_REACH_PX, math.ceil(_LARGEST_OFFSET * max(left.shape)))
    high, wide = _HALF_PATCH + reach, _HALF_PATCH
    first, second = (np.nan_to_num(one).astype(np.float32) for one in (left, right))
    lit = np.isfinite(left), np.isfinite(right)
    rows, columns = left.shape
    places, offsets = [], []
    for row in _middles(rows, high):
        for column in _middles(columns, wide):
            patch = np.s_[row - wide : row + wide + 1, column - wide : column + wide + 1]
            start = max(column - steps[-1] - wide, 0)
            strip = np.s_[row - high : row + high + 1, start : min(column - steps[0] + wide + 1, columns)]
            if second[strip].shape[1] <= 2 * wide + 2 or not (lit[0][patch].all() and lit[1][strip].all()):
                continue
            alike = library.matchTemplate(second[strip], first[patch], library.TM_CCOEFF_NORMED)
            down, along = map(int, np.unravel_index(int(np.argmax(alike)), alike.shape))
            if alike[down, along] < _LEAST_CORRELATION or not _is_lone_peak(alike.max(axis=1)):
                continue
            above, peak, below = alike[down - 1 : down + 2, along].astype(float)
            places.append((row, start + wide + along))
            offsets.append(down - reach + 0.5 * (above - below) / (above - 2.0 * peak + below))
    return np.array(places, dtype=np.float64).reshape(-1, 2), np.array(offsets)


def _middles(size: int, margin: int) -> IndexArray:
    """Middles of patches that do not overlap, at least ``margin`` from both ends; none if the picture is too small."""
    span = size - 1 - 2 * margin
    return (
        np.linspace(margin, size - 1 - margin, min(_PATCHES, span // (2 * _HALF_PATCH + 1) + 1)).astype(int)
        if span > 0
        else np.zeros(0, int)
    )


def _is_lone_peak(best_of_row: Samples) -> bool:
    """Whether the best correlation at any disparity, as a function of the row, has a single peak inside its range.

    Stripes and gratings do not: stripes look the same when shifted along themselves, and gratings repeat.
    """
    near = np.flatnonzero(best_of_row > best_of_row.max() - _CORRELATION_DROP)
    return bool(near[0] > 0 and near[-1] < best_of_row.size - 1 and near[-1] - near[0] + 1 == near.size)


def _basis(places: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """The terms 1, u, v, u v, v², shape (..., 5), of rows and columns (..., 2), in units of half the longer side."""
    v, u = ((places[..., k] + 0.5 - shape[k] / 2.0) / (max(shape) / 2.0) for k in (0, 1))
    return np.stack([np.ones_like(u), u, v, u * v, v * v], axis=-1)


def _resampled(picture: Samples, coefficients: FloatArray, hull: FloatArray) -> Samples:
    """A picture with its rows shifted up by the fitted offsets, constant outside a hull; NaN where it has no data."""
    from scipy.ndimage import map_coordinates

    rows, columns = np.indices(picture.shape)
    down = _basis(np.clip(np.stack([rows, columns], axis=-1), *hull), picture.shape) @ coefficients
    place = np.stack([rows + down, columns])
    missing = map_coordinates(np.isnan(picture).astype(np.float32), place, order=1, mode="constant", cval=1.0)
    found = map_coordinates(np.nan_to_num(picture).astype(np.float32), place, order=3, mode="nearest")
    return np.where(missing > 0.0, np.nan, found).astype(picture.dtype)
