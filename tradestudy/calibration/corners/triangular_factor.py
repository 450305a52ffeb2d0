"""The triangular factor of matrices, without their orthogonal one."""

from __future__ import annotations

import numpy as np

from tradestudy.optics.arrays import FloatArray


def triangular_factor(matrices: FloatArray) -> FloatArray:
    """R of ``A = QR``, for one matrix or a stack of them; the same R as with Q, in a fraction of the time."""
    return np.asarray(np.linalg.qr(matrices, mode="r"))
