"""The micro-images that an estimator compares: the part of an object that they share, and its information.

Two microlenses D apart form images of a point at a_L in front of the array that are D (1 + b_L/a_L) apart on the
sensor. Their images of the centre of the main lens's pupil, and thus their micro-images, are D (1 + b_L/z) apart. When
their textures are aligned, the micro-images are therefore d apart,

    d = D b_L |1/a_L − 1/z| = (D/|v|) b/z,    b = z − a_L,

and a fraction d/n = D/(2 r) of the diameter n, where r is the radius of the disc in which microlenses see a point: the
window vanishes exactly where no pair sees it. With z ≈ b, where the main lens images onto the array, d is n D/(p |v|).

Off the axis, the rims of other stops vignette the pupil. A pixel behind a microlens sees one spot of the pupil, so rims
narrow the micro-images and the disc without dimming the remaining pixels. The fraction of the width that remains along
the radius of the field is applied in all directions: radial pairs, the worst case, represent all. The obliquity of the
pupil narrows neither, since pupil and array are parallel planes and the disc is the central projection of the pupil
through the image point. It only dims the light, by one of the four cosines.
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
    """Micro-images of objects at given distances.

    Parameters
    ----------
    estimator, lenses, array
        The estimator and its microlenses.
    diameter_px
        Diameter n of a micro-image [px].
    neighbours_apart_px
        d for two microlenses one pitch apart [px], at each distance.
    radius_over_pitch
        Radius, in pitches, of the disc in which microlenses see a point, at each distance; NaN where it has no image.
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
        """Side of the largest window in one micro-image [px]."""
        return self.diameter_px / math.sqrt(2.0)

    def through(self, width: float) -> MatchedPairs:
        """The pairs of the estimator through a pupil with this fraction of its width."""
        pairs = pairs_of(self.estimator, self.lenses, self.array, self.radius_over_pitch, width)
        apart = pairs.over_pitch * self.neighbours_apart_px
        return MatchedPairs(
            largest_px=largest_common_square(self.diameter_px * width, apart), apart_px=apart, weight=pairs.share
        )

    def at(self, index: NDArray[np.intp]) -> MicroImages:
        """Select some of the distances, by index."""
        return replace(
            self,
            neighbours_apart_px=self.neighbours_apart_px[index],
            radius_over_pitch=self.radius_over_pitch[index],
        )
