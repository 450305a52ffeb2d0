"""The array types that the physics takes and returns."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Samples = NDArray[np.floating[Any]]
"""Samples of pictures; single precision is enough because their noise is larger."""
BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.intp]
