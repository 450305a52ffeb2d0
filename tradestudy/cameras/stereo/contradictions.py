"""Contradictions between what a data sheet states of a stereo rig and what follows from its other values."""

from __future__ import annotations

import math

from tradestudy.cameras.camera import Contradiction, show
from tradestudy.units import FRACTION, LENGTH, pretty

_NEAREST_TOLERANCE = 0.05  # data sheets give two digits, for focal lengths that vary from camera to camera


def focus_contradictions(
    focal_length: float, focused: float, focus_distance: float, tolerance: float
) -> list[Contradiction]:
    """A principal distance equal to the focal length against that of lenses focused at a finite distance.

    The two differ by the magnification ``c/a`` of the focus distance a, and so do disparity and its noise.

    Parameters
    ----------
    focal_length, focused, focus_distance
        Focal length, principal distance c of the focused lenses, and distance a at which they are focused [m].
    tolerance
        Largest relative difference that does not matter.
    """
    magnification = focused / focus_distance
    if magnification <= tolerance:
        return []
    return [
        Contradiction(
            what="principal distance against focus distance",
            stated=f"{show(focal_length, LENGTH)}, the focal length",
            implied=f"{show(focused, LENGTH)} when focused at {show(focus_distance, LENGTH)}: longer by "
            f"{pretty(magnification, FRACTION)}, more than the {pretty(tolerance, FRACTION)} tolerance on depth",
            used=f"{show(focal_length, LENGTH)} for depth, {show(focused, LENGTH)} for blur. If the focal length does "
            "not come from a camera calibration that gives it in pixels, set principal_distance: focused to use "
            f"{show(focused, LENGTH)} for both",
            path=("principal_distance",),
        ),
    ]


def nearest_contradictions(stated: float, implied: float, disparity_range_px: float) -> list[Contradiction]:
    """A stated nearest distance against that which follows from the search range, baseline and focal length.

    Parameters
    ----------
    stated, implied
        Nearest distances [m]; the implied one is NaN if it cannot be derived.
    disparity_range_px
        Largest disparity that the matcher searches [px].
    """
    if math.isnan(implied) or math.isclose(stated, implied, rel_tol=_NEAREST_TOLERANCE):
        return []
    return [
        Contradiction(
            what="nearest distance against search range, baseline and focal length",
            stated=show(stated, LENGTH),
            implied=f"{show(implied, LENGTH)} for disparities up to {disparity_range_px:g} px",
            used=f"{show(implied, LENGTH)}, from the search range",
            path=("stated", "nearest_distance"),
        )
    ]
