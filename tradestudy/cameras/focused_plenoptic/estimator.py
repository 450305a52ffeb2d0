"""Estimators of depth from micro-images: effective baseline, compared pairs and availability."""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np

from tradestudy.cameras.parts import MicrolensArray
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.equivalent_baseline import (
    PairLengths,
    least_squares_baseline,
    least_squares_pairs,
    widest_pair_baseline,
)
from tradestudy.optics.microlens_coverage import seen_count_probability

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
