"""Estimators of depth from micro-images, and the pictures that they compare.

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

from tradestudy.cameras.parts import Lens, MicrolensArray, Sensor
from tradestudy.cameras.picture_geometry import LensStage, MatchedPairs, PictureGeometry, largest_common_square
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.equivalent_baseline import (
    PairLengths,
    least_squares_baseline,
    least_squares_pairs,
    widest_pair_baseline,
)
from tradestudy.optics.microlens_coverage import seen_count_probability
from tradestudy.optics.thin_lens import image_distance, microlens_object_distance

PlenopticEstimator = Literal["adjacent-pair", "same-type-pair", "widest-pair", "least-squares"]
UsedLenses = Literal["all", "sharpest-type"]
LENSES_OF_PAIRS: Final[dict[str, UsedLenses]] = {"adjacent-pair": "all", "same-type-pair": "sharpest-type"}
"""Microlenses used by estimators that offer no choice."""


def require_choice(estimator: PlenopticEstimator, lenses: UsedLenses) -> None:
    """Refuse microlenses that an estimator cannot use."""
    only = LENSES_OF_PAIRS.get(estimator, lenses)
    if lenses != only:
        raise OutOfRangeError(f"the estimator {estimator} has no choice of microlenses", value=lenses, limit=only)


def neighbour_distance(estimator: PlenopticEstimator, array: MicrolensArray) -> float:
    """Distance between the microlenses of an adjacent or same-type pair [m]: the pitch, or √3 times it."""
    same_of_three = estimator == "same-type-pair" and array.types > 1
    return array.pitch * (math.sqrt(3.0) if same_of_three else 1.0)


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
    law = {"widest-pair": widest_pair_baseline, "least-squares": least_squares_baseline}[estimator]
    radius, counting = radius_over_pitch, _counting(lenses, array)
    found = law(np.nan_to_num(radius), layout=array.layout, types=array.types, counting=counting)
    return np.asarray(np.where(np.isfinite(radius), found.over_pitch, np.nan) * array.pitch)


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
        np.nan_to_num(effective_baseline(estimator, lenses, array, one)) for one in (radius, radius_over_pitch)
    )
    kept = np.square(baseline / np.where(whole > 0.0, whole, 1.0))
    if estimator == "widest-pair":
        return PairLengths(over_pitch=baseline[np.newaxis] / array.pitch, share=kept[np.newaxis])
    pairs = least_squares_pairs(radius, layout=array.layout, types=array.types, counting=_counting(lenses, array))
    return PairLengths(over_pitch=pairs.over_pitch, share=pairs.share * kept)


def share_with_a_pair(lenses: UsedLenses, array: MicrolensArray, radius_over_pitch: FloatArray) -> FloatArray:
    """Share of points seen by at least two of the microlenses that an estimator uses; 0 where there is no image."""
    found = seen_count_probability(
        np.nan_to_num(radius_over_pitch),
        at_least=2,
        layout=array.layout,
        types=array.types,
        counting=_counting(lenses, array),
    )
    return np.asarray(np.where(np.isfinite(radius_over_pitch), found, 0.0))


def _counting(lenses: UsedLenses, array: MicrolensArray) -> Literal["all_lenses", "given_type"]:
    return "given_type" if lenses == "sharpest-type" and array.types > 1 else "all_lenses"


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


def relayed_picture(
    distance: FloatArray,
    lens: Lens,
    array: MicrolensArray,
    sensor: Sensor,
    mla_distance: float,
    *,
    estimator: PlenopticEstimator,
    lenses: UsedLenses,
    radius_over_pitch: FloatArray,
    blur: FloatArray,
    used_type: NDArray[np.intp],
) -> PictureGeometry:
    """Micro-images of objects at distances [m], NaN where there is no picture.

    Parameters
    ----------
    distance, lens, array, sensor, mla_distance
        The objects and the camera.
    estimator, lenses, radius_over_pitch
        The micro-images compared, as for `MicroImages`.
    blur
        Blur of the micro-images [m], with the shape of ``distance``.
    used_type
        Index of their microlens type.
    """
    a, pixel = distance, sensor.pixel_pitch
    f, pupil = lens.focal_length, lens.pupil_diameter
    image = image_distance(a, f)
    relayed = np.asarray(microlens_object_distance(a, mla_distance, f))
    # An image on the array is magnified infinitely: there is no picture.
    relayed = np.where(relayed == 0.0, np.nan, relayed)
    relay = array.gap / np.abs(relayed)
    microlens = LensStage(
        aperture_diameter=array.aperture_diameter,
        focal_length=np.asarray(array.focal_lengths)[used_type],
        object_distance=relayed,
        plane_distance=np.full_like(a, array.gap),
        blur_diameter=np.where(np.isnan(relayed), np.nan, blur),
        relay=np.ones_like(a),
    )
    main_lens = LensStage(
        aperture_diameter=pupil,
        focal_length=np.full_like(a, f),
        object_distance=a,
        plane_distance=image,
        blur_diameter=np.zeros_like(a),
        relay=relay,
    )
    micro_image = min(array.pitch, pupil * array.gap / mla_distance)
    return PictureGeometry(
        distance=a,
        magnification=image / a * relay,
        sample_pitch=pixel,
        sample_width=pixel,
        sample_shape="square",
        pixel_pitch=pixel,
        compared=MicroImages(
            estimator=estimator,
            lenses=lenses,
            array=array,
            diameter_px=micro_image / pixel,
            neighbours_apart_px=array.pitch * relay * image / mla_distance / pixel,
            radius_over_pitch=radius_over_pitch,
        ),
        light_f_number=microlens.f_number,
        pupil_diameter=pupil,
        main_lens=main_lens,
        microlens=microlens,
        micro_image_diameter=micro_image,
    )
