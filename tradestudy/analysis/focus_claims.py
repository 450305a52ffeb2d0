"""Claims about depth of field."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from tradestudy.cameras.focus import BlurCriterion, SharpRange
from tradestudy.study.definition import Case
from tradestudy.study.schema.claims import DepthOfFieldClaim, DepthOfFieldRatioClaim
from tradestudy.units import LENGTH, PIXELS, pretty


def depth_of_field_value(claim: DepthOfFieldClaim, case: Case) -> float:
    """Total extent of the sharp intervals of a camera [m]; NaN if diffraction alone exceeds the criterion."""
    criterion = BlurCriterion(blur_px=claim.blur, measure=claim.diffraction, wavelength=case.wavelength)
    found = case.all_cameras[claim.camera].focus.sharp_range(criterion)
    return found.extent if found.extent > 0.0 else math.nan


def depth_of_field_ratio(claim: DepthOfFieldRatioClaim, case: Case) -> float:
    """Ratio of the depths of field of two cameras; NaN if the second has none, or both are infinite."""
    first, second = (_extent(claim, case, name) for name in (claim.camera, claim.against))
    return math.nan if second == 0.0 or first == second == math.inf else first / second


def _extent(claim: DepthOfFieldRatioClaim, case: Case, name: str) -> float:
    focus = case.all_cameras[name].focus
    if claim.resolution is not None:
        found = focus.sharp_range_at_resolution(claim.resolution, case.wavelength)
    else:
        assert claim.blur is not None
        found = focus.sharp_range(
            BlurCriterion(blur_px=claim.blur, measure=claim.diffraction or "none", wavelength=case.wavelength)
        )
    return found.extent if claim.over is None else _extent_within(found, claim.over[0], claim.over[1])


def _extent_within(found: SharpRange, near: float, far: float) -> float:
    covered = np.clip(found.union.covered, near, far)
    return float(np.sum(covered[:, 1] - covered[:, 0]))


def depth_of_field_words(claim: DepthOfFieldClaim, titles: Mapping[str, str]) -> str:
    """The quantity that answers the claim, in words; `titles` name the cameras."""
    return f"depth of field of {titles[claim.camera]}, {_blur_words(claim.blur, claim.diffraction)}"


def depth_of_field_ratio_words(claim: DepthOfFieldRatioClaim, titles: Mapping[str, str]) -> str:
    """The quantity that answers the claim, in words; `titles` name the cameras."""
    text = f"ratio of the depth of field of {titles[claim.camera]} to that of {titles[claim.against]}"
    if claim.over is not None:
        text += f" between {pretty(claim.over[0], LENGTH)} and {pretty(claim.over[1], LENGTH)}"
    if claim.resolution is not None:
        return f"{text}, both resolving {pretty(claim.resolution, LENGTH)} on the object"
    return f"{text}, {_blur_words(claim.blur or 0.0, claim.diffraction or 'none')}"


def _blur_words(blur: float, diffraction: str) -> str:
    how = {
        "fwhm": "with diffraction (width at half maximum)",
        "airy-diameter": "with diffraction (Airy diameter)",
    }.get(diffraction, "by defocus alone")
    return f"for a blur of {pretty(blur, PIXELS)} {how}"
