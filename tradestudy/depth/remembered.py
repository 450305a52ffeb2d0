"""Results over distances that several questions ask of the same camera."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Concatenate, ParamSpec, TypeVar

import numpy as np

from tradestudy.optics.arrays import FloatArray

Camera = TypeVar("Camera")
Others = ParamSpec("Others")
Found = TypeVar("Found")
OverDistance = Callable[Concatenate[Camera, FloatArray, Others], Found]


def remembered(
    size: int,
) -> Callable[[OverDistance[Camera, Others, Found]], OverDistance[Camera, Others, Found]]:
    """Keep the last results of a function of a camera and of distances [m], shape (distances,); see `lru_cache`.

    What it returns is shared, and its distances are read-only. All arguments are given by position.
    """

    def keeping(function: OverDistance[Camera, Others, Found]) -> OverDistance[Camera, Others, Found]:
        @lru_cache(maxsize=size)
        def cached(camera: Camera, distances: bytes, *args: Others.args, **named: Others.kwargs) -> Found:
            return function(camera, np.frombuffer(distances), *args, **named)

        @wraps(function)
        def read(camera: Camera, distance: FloatArray, *args: Others.args, **named: Others.kwargs) -> Found:
            return cached(camera, np.asarray(distance, dtype=np.float64).tobytes(), *args, **named)  # type: ignore[arg-type]

        read.cache_clear = cached.cache_clear  # type: ignore[attr-defined]
        return read  # type: ignore[return-value]

    return keeping
