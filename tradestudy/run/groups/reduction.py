"""The size of the reduced pictures and maps in results, and the padding that puts several sizes into one array."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.optics.arrays import FloatArray

LARGEST: Final = 256
"""Most rows and columns of a reduced picture."""


def padded(values: NDArray[Any], shape: tuple[int, ...]) -> FloatArray:
    """The values padded with NaN beyond their last row and column."""
    whole = np.full(shape, np.nan)
    whole[: values.shape[0], : values.shape[1]] = values
    return whole
