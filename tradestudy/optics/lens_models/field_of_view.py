"""The field-of-view model of wide-angle lenses, with a single coefficient."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_models.lens_model import Coefficient, LensModel, slopes


@dataclass(frozen=True, kw_only=True)
class FieldOfView(LensModel):
    """``r = atan(2 r_u tan(w/2))/w``, where r_u is the tangent of the angle from the axis, up to 90°.

    Parameters
    ----------
    w
        Coefficient w [rad], above 0° and below 180°: the larger w is, the stronger the distortion. The coefficient need
        not equal the field of view of the lens.

    Notes
    -----
    F. Devernay, O. Faugeras, "Straight lines have to be straight", Machine Vision and Applications 13 (2001) 14.
    """

    name: ClassVar[str] = "fov"

    w: Coefficient

    def __post_init__(self) -> None:
        self._require("w", above=0.0, high=np.nextafter(np.pi, 0.0))

    @property
    def widest(self) -> FloatArray:
        """π/2 [rad]."""
        return np.full(np.shape(self.w), np.pi / 2.0)

    def image(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """See `LensModel.image`; NaN for points beside or behind the camera."""
        a, b = slopes(x, y, z)
        slope = np.sqrt(a * a + b * b)
        w = np.asarray(self.w)
        twice = 2.0 * np.tan(w / 2.0)
        axial = slope == 0.0
        scale = np.where(axial, twice / w, np.arctan(twice * slope) / (w * np.where(axial, 1.0, slope)))
        return a * scale, b * scale

    def ray(self, u: ArrayLike, v: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See `LensModel.ray`; ``r_u = tan(w r)/(2 tan(w/2))``, as unit vectors."""
        u, v = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
        w = np.asarray(self.w)
        radius = np.hypot(u, v)
        turned = w * radius
        # Sine and cosine instead of the tangent, so that no digits are lost near 90°.
        across, z = np.sin(turned), 2.0 * np.tan(w / 2.0) * np.cos(turned)
        scale = np.where(radius > 0.0, across / np.where(radius > 0.0, radius, 1.0), w)
        x, y = u * scale, v * scale
        found = (turned < np.pi / 2.0) & self._inside(x, y, z)
        return np.where(found, x, np.nan), np.where(found, y, np.nan), np.where(found, z, np.nan)
