"""The micro-images that an estimator compares: what two of them share of an object, and what that tells.

Microlenses D apart picture an image point at a_L before the array D (1 + b_L/a_L) apart on the sensor, and the middle
of the main lens's pupil D (1 + b_L/z) apart: that is how far their micro-images are apart. Where their textures
coincide, the micro-images are therefore d apart,

    d = D b_L |1/a_L − 1/z| = (D/|v|) b/z,    b = z − a_L,

and a fraction d/n = D/(2 r) of the diameter n, where r is the radius of the disc in which microlenses see a point: no
window is left exactly where no pair is. With z ≈ b, the array in the image of the main lens, it is n D/(p |v|).

Off the axis the rims of other stops narrow the pupil. A pixel behind a microlens looks through one spot of the pupil,
so rims make the micro-images and the disc narrower and take no light from the pixels that are left. The share of the
width that is left along the radius of the field is taken in all directions: pairs along the radius, the worst ones,
stand for all. The tilt of the pupil narrows neither, though as seen along the ray it is only cos θ as wide: the
pupil and the array are parallel planes, and the disc is the pupil's central projection through the image point, the
same wherever that lies beside the axis. What the tilt takes is light, one of the four cosines.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.focused_plenoptic.estimator import PlenopticEstimator, UsedLenses, pairs_of
from tradestudy.cameras.matched_windows import MatchedPairs, largest_common_square
from tradestudy.cameras.parts import MicrolensArray
from tradestudy.optics.arrays import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class MicroImages:
    """Micro-images of objects at some distances.

    Parameters
    ----------
    estimator, lenses, array
        What measures.
    diameter_px
        n of a micro-image [px].
    neighbours_apart_px
        d of two lenses one pitch apart [px], over distance.
    radius_over_pitch
        Of the disc in which microlenses see a point, over distance; NaN where it has no image.
    """

    stops_dim: ClassVar[bool] = False

    estimator: PlenopticEstimator
    lenses: UsedLenses
    array: MicrolensArray
    diameter_px: float
    neighbours_apart_px: FloatArray
    radius_over_pitch: FloatArray

    @property
    def widest_px(self) -> float:
        """In the disc of one micro-image."""
        return self.diameter_px / math.sqrt(2.0)

    def through(self, width: float) -> MatchedPairs:
        """The pairs of the estimator through a pupil of which so much is left of the width."""
        pairs = pairs_of(self.estimator, self.lenses, self.array, self.radius_over_pitch, width)
        apart = pairs.over_pitch * self.neighbours_apart_px
        return MatchedPairs(
            largest_px=largest_common_square(self.diameter_px * width, apart), apart_px=apart, weight=pairs.share
        )

    def at(self, index: NDArray[np.intp]) -> MicroImages:
        """The same at some of the distances."""
        return replace(
            self,
            neighbours_apart_px=self.neighbours_apart_px[index],
            radius_over_pitch=self.radius_over_pitch[index],
        )
