"""Estimators of depth from micro-images, and the micro-images that they compare.

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
from typing import ClassVar, Final, Literal

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.parts import MicrolensArray
from tradestudy.cameras.picture_geometry import MatchedPairs, largest_common_square
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.equivalent_baseline import (
    PairLengths,
    equivalent_baseline,
    least_squares_pairs,
)
from tradestudy.optics.microlens_coverage import pair_probability

PlenopticEstimator = Literal["adjacent-pair", "same-type-pair", "widest-pair", "least-squares"]
UsedLenses = Literal["all", "sharpest-type"]
LENSES_OF_PAIRS: Final[dict[str, UsedLenses]] = {"adjacent-pair": "all", "same-type-pair": "sharpest-type"}
"""Microlenses used by estimators that offer no choice."""


def neighbour_distance(estimator: PlenopticEstimator, array: MicrolensArray) -> float:
    """Distance between the microlenses of an adjacent or same-type pair [m]: the pitch, or √3 times it."""
    return array.pitch * _pitches_apart(LENSES_OF_PAIRS[estimator], array)


def effective_baseline(
    estimator: PlenopticEstimator, lenses: UsedLenses, array: MicrolensArray, radius_over_pitch: FloatArray
) -> FloatArray:
    """Baseline [m] of a pair of microlenses as precise as the widest pair, or as least squares over all microlenses.

    Precision means the mean square error over all positions of a point relative to the lattice. NaN where no pair of
    microlenses sees a point.

    Parameters
    ----------
    estimator, lenses, array
        The estimator and its microlenses.
    radius_over_pitch
        Radius of the disc in which microlenses see a point; NaN where it has no image.
    """
    assert estimator == "widest-pair" or estimator == "least-squares"  # the others have pairs of one length
    spacing = _pitches_apart(lenses, array)
    baseline = spacing * equivalent_baseline(
        np.nan_to_num(radius_over_pitch) / spacing, layout=array.layout, judged=estimator
    )
    return np.asarray(np.where(np.isfinite(radius_over_pitch), baseline, np.nan) * array.pitch)


def pairs_of(
    estimator: PlenopticEstimator,
    lenses: UsedLenses,
    array: MicrolensArray,
    radius_over_pitch: FloatArray,
    width: float = 1.0,
) -> PairLengths:
    """Pairs of microlenses that an estimator compares through a vignetted pupil.

    One pair of neighbours, one pair that represents the widest ones, or all pairs of least squares. Through a narrower
    pupil, pairs contain less information, in proportion to the squares of the effective baselines, since disparities
    refer to the baseline of the whole pupil.

    Parameters
    ----------
    estimator, lenses, array, radius_over_pitch
        As for `effective_baseline`; the radius is that of the whole pupil.
    width
        Width of the vignetted pupil as a fraction of the whole one, from 0 to 1.
    """
    radius = np.nan_to_num(radius_over_pitch) * width
    if estimator in LENSES_OF_PAIRS:
        length = np.full((1, radius.size), neighbour_distance(estimator, array) / array.pitch)
        return PairLengths(over_pitch=length, share=np.ones_like(length))
    baseline, whole = (
        np.nan_to_num(effective_baseline(estimator, lenses, array, reach)) for reach in (radius, radius_over_pitch)
    )
    kept = np.square(baseline / np.where(whole > 0.0, whole, 1.0))
    if estimator == "widest-pair":
        return PairLengths(over_pitch=baseline[np.newaxis] / array.pitch, share=kept[np.newaxis])
    spacing = _pitches_apart(lenses, array)
    pairs = least_squares_pairs(radius / spacing, layout=array.layout)
    return PairLengths(over_pitch=pairs.over_pitch * spacing, share=pairs.share * kept)


def share_with_a_pair(lenses: UsedLenses, array: MicrolensArray, radius_over_pitch: FloatArray) -> FloatArray:
    """Share of points seen by at least two of the microlenses that an estimator uses; 0 where there is no image."""
    share = pair_probability(np.nan_to_num(radius_over_pitch) / _pitches_apart(lenses, array), layout=array.layout)
    return np.asarray(np.where(np.isfinite(radius_over_pitch), share, 0.0))


def _pitches_apart(lenses: UsedLenses, array: MicrolensArray) -> float:
    """Pitch of the lattice of the used microlenses, over that of the array: each of three types has its own lattice."""
    return math.sqrt(3.0) if lenses == "sharpest-type" and array.types > 1 else 1.0


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
