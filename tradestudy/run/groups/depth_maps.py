"""The variables of /pictures for depth measured in the pictures of the scene."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.camera import Camera
from tradestudy.imaging.estimation import VARIANCE_OF_SPREAD, DepthScore, middle_and_spread
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.window_matching import Reason
from tradestudy.results import GROUPS
from tradestudy.run.depth_maps import MeasuredDepth, predicted_availability
from tradestudy.run.groups.reduction import LARGEST, padded

_CLASSES: Final = 6
_LARGEST_BLOCK: Final = 64  # px
_FILLED: Final = 0.8  # of the share of the largest blocks that contain a depth


def score_values(scores: Sequence[DepthScore | None]) -> dict[str, list[float]]:
    """The variables ``depth_…`` of /depth_loop or /pictures; without a score, 0 for counts and NaN for estimates."""
    found = {}
    for variable in [key for key in GROUPS["depth_loop"] if key.startswith("depth_") and not key.endswith("_error")]:
        name, error = variable.removeprefix("depth_"), f"{variable}_error"
        unknown = math.nan if error in GROUPS["depth_loop"] else 0.0
        found[variable] = [unknown if one is None else float(getattr(one, name)) for one in scores]
        if error in GROUPS["depth_loop"]:
            found[error] = [math.nan if one is None else one.standard_errors[name] for one in scores]
    return found


def depth_map_values(depths: Sequence[MeasuredDepth], cameras: Mapping[str, Camera]) -> dict[str, Any]:
    """The variables of /pictures about measured depth."""
    blocks = [_block(one) for one in depths]
    maps = [_reduced(one, block) for one, block in zip(depths, blocks, strict=True)]
    shape = tuple(max(one.shape[k] for some in maps for one in some.values()) for k in (0, 1))
    classes = [_classes(one) for one in depths]
    middles = [float(np.nanmedian(one.truth.depth[one.truth.measurable])) if one.score.seen else 0.0 for one in depths]
    return {
        **score_values([one.score for one in depths]),
        "predicted_availability": [
            predicted_availability(cameras[one.camera], middle) if middle else math.nan
            for one, middle in zip(depths, middles, strict=True)
        ],
        "matcher": [one.score.matcher for one in depths],
        "map_block": [float(one) for one in blocks],
        **{name: [padded(some[name], shape) for some in maps] for name in maps[0]},
        **{name: [some[name] for some in classes] for name in classes[0]},
    }


def _block(one: MeasuredDepth) -> int:
    """The smallest block side, a power of two, for which hardly fewer blocks contain a depth than for the largest.

    Smaller blocks would be empty between the micro-images of the types that are out of focus.
    """
    measured = np.isfinite(one.found.depth)
    sides = [1 << k for k in range(_LARGEST_BLOCK.bit_length()) if max(measured.shape) <= LARGEST << k]
    sides = [side for side in sides if side <= min(measured.shape)] or [1]
    shares = [float(np.mean(np.any(_in_blocks(measured, side), axis=-1))) for side in sides]
    return next(side for side, share in zip(sides, shares, strict=True) if share >= _FILLED * shares[-1])


def _reduced(one: MeasuredDepth, block: int) -> dict[str, FloatArray]:
    found, truth = one.found, one.truth
    surface = np.isfinite(truth.depth) & ~np.isin(found.reason, (Reason.NO_LIGHT, Reason.LESS_SHARP))
    hidden = np.where(surface | truth.measurable, ~truth.measurable, np.nan)
    sharp = one.made.get("all_in_focus")
    return {
        "map_depth": _blockwise(found.depth, block, np.nanmedian),
        "map_depth_error": _blockwise(
            np.where(truth.measurable, found.depth - truth.depth, np.nan), block, np.nanmedian
        ),
        "map_hidden": _blockwise(hidden, block, np.nanmean),
        "map_sharp": np.full((1, 1), np.nan)
        if sharp is None
        else _blockwise(sharp, math.ceil(max(sharp.shape) / LARGEST), np.nanmean),
    }


def _in_blocks(values: NDArray[Any], block: int) -> NDArray[Any]:
    """Shape (rows, columns, pixels of a block); incomplete blocks at the right and bottom edges are left out."""
    rows, columns = (size // block for size in values.shape)
    inside = values[: rows * block, : columns * block].reshape(rows, block, columns, block)
    return np.moveaxis(inside, 1, 2).reshape(rows, columns, block * block)


def _blockwise(values: NDArray[Any], block: int, middle: Any) -> FloatArray:
    """One number for each block from its finite values; NaN for a block without any."""
    parts = np.asarray(_in_blocks(values, block), np.float64)
    known = np.any(np.isfinite(parts), axis=-1)
    found = np.full(known.shape, np.nan)
    if np.any(known):
        found[known] = middle(np.where(np.isfinite(parts[known]), parts[known], np.nan), axis=-1)
    return found


def _classes(one: MeasuredDepth) -> dict[str, FloatArray]:
    """Errors by class of true depth; their standard errors follow from the number of windows in each class."""
    names = ("distance", "bias", "bias_error", "spread", "spread_error", "predicted")
    found = {f"class_{name}": np.full(_CLASSES, np.nan) for name in names}
    both = np.isfinite(one.found.depth) & one.truth.measurable
    true = np.asarray(one.truth.depth[both], np.float64)
    error, predicted = (one.found.depth - one.truth.depth)[both], one.predicted[both]
    for k, among in enumerate(np.array_split(np.argsort(true, kind="stable"), _CLASSES)):
        windows = among.size / one.search.window_px**2
        if windows < 2.0:
            continue
        middle, spread = middle_and_spread(error[among])
        values = (
            np.median(true[among]),
            middle,
            spread * math.sqrt(math.pi / 2.0 / windows),  # for the median of normal errors
            spread,
            spread * math.sqrt(VARIANCE_OF_SPREAD / windows),
            np.median(predicted[among]),
        )
        for name, value in zip(names, values, strict=True):
            found[f"class_{name}"][k] = value
    return found
