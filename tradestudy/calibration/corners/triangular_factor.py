"""The triangular factor of matrices without the orthogonal one."""

from __future__ import annotations

import numpy as np

from tradestudy.optics.arrays import FloatArray


def triangular_factor(matrices: FloatArray) -> FloatArray:
    """R of ``A = QR`` for one matrix or a stack of matrices, in a fraction of the time that Q and R take together."""
    return np.asarray(np.linalg.qr(matrices, mode="r"))
