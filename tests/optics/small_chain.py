"""A camera small enough for nested quadrature, and what tests of light chains measure on it."""

from __future__ import annotations

import numpy as np

from tradestudy.optics.chain.scene import LightPath, Microlenses, PixelGrid
from tradestudy.optics.propagation.lens import CircularLens

WAVELENGTH = 550e-9
PITCH = 26e-6
ROW = PITCH * np.array([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]])


def camera(**changes: object) -> LightPath:
    """Three lenses in a row behind an f/10 main lens, whose blur is about as wide as one of them, and 4 µm pixels."""
    lenses: dict[str, object] = {
        "centres": ROW,
        "focal_lengths": np.array([70e-6, 76e-6, 85e-6]),
        "aperture": "circular",
        "aperture_width": 24e-6,
        "pitch": PITCH,
        "layout": "square",
        "gaps": "opaque",
        "lens_phase": "parabolic",
    }
    path: dict[str, object] = {
        "main_lens": CircularLens(radius=0.1e-3, focal_length=2e-3, lens_phase="parabolic"),
        "array_distance": 2.5e-3,
        "detector_distance": 0.1e-3,
        "pixels": PixelGrid(pitch=4e-6, shape=(9, 23)),
    }
    for name, value in changes.items():
        (path if name in path else lenses)[name] = value
    return LightPath(microlenses=Microlenses(**lenses), **path)


def relative(value: np.ndarray, truth: np.ndarray) -> float:
    """Relative L2 distance."""
    return float(np.linalg.norm(value - truth) / np.linalg.norm(truth))
