"""How large pictures and maps are that results keep, and how those of several sizes stand in one array."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.optics.arrays import FloatArray

LARGEST: Final = 256
"""Rows and columns of a reduced picture."""


def padded(values: NDArray[Any], shape: tuple[int, ...]) -> FloatArray:
    """With NaN beyond its last row and column."""
    whole = np.full(shape, np.nan)
    whole[: values.shape[0], : values.shape[1]] = values
    return whole
