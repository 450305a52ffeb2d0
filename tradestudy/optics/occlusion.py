"""Occlusion and foreshortening between two views: the hidden strip next to a depth step, and tilted surfaces."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray


def hidden_strip_width(
    step_height: ArrayLike,
    edge_distance: ArrayLike,
    baseline: ArrayLike,
    *,
    obstacle_width: ArrayLike = np.inf,
) -> FloatArray:
    """Width of the strip that only one of two views sees behind an edge: h B/Z on the lower surface.

    Parameters
    ----------
    step_height
        Height h ≥ 0 of the upper surface over the lower one [m], along the viewing direction.
    edge_distance
        Distance Z > 0 of the edge, on the upper surface, from the views [m]. In terms of the distance Z' of the lower
        surface, the strip is h B/(Z' − h).
    baseline
        Distance B ≥ 0 between the views across the edge [m]: between the lenses of a stereo rig, or for a single
        camera the part of its pupil that it uses (at most the whole pupil).
    obstacle_width
        Width w of the upper surface [m]. If it is narrow, both its sides uncover the lower surface, so the strip beside
        one edge is at most what the obstacle hides from a single view, w (1 + h/Z). Infinite for a step.

    Returns
    -------
    Width on the lower surface [m], broadcast. Exact for straight edges across the baseline and a lower
    surface across the viewing direction, wherever the edge lies in the field; 0 for no step or no baseline.

    Raises
    ------
    OutOfRangeError
        For a distance that is not positive, or a negative height, baseline or width.

    Notes
    -----
    The rays from both views through the edge are B apart at the views and h B/Z apart at h behind the edge.
    """
    h, Z, B, w = (
        np.asarray(value, dtype=np.float64) for value in (step_height, edge_distance, baseline, obstacle_width)
    )
    _require(Z > 0, "distance of the edge", Z, limit="> 0 m")
    _require(h >= 0, "height of the step", h, limit="≥ 0 m")
    _require(B >= 0, "baseline", B, limit="≥ 0 m")
    _require(w >= 0, "width of the obstacle", w, limit="≥ 0 m")
    return np.asarray(np.minimum(h * (B / Z), w * (1 + h / Z)))


def foreshortening_ratio(
    surface_tilt: ArrayLike, distance: ArrayLike, baseline: ArrayLike, *, lateral_position: ArrayLike = 0.0
) -> FloatArray:
    """Width of a small surface patch in one view over its width in the other, the smaller over the larger.

    In a view at x_c, the image of a patch at (x, Z) with tilt θ has the length f (cos θ − sin θ (x − x_c)/Z)/Z per
    length of surface, so the ratio is (1 − tan θ (x ± B/2)/Z)/(1 − tan θ (x ∓ B/2)/Z). Matching windows assume equal
    images, and fail as the ratio falls.

    Parameters
    ----------
    surface_tilt
        Angle θ of the surface against the plane across the viewing direction [rad], |θ| < π/2; positive where
        distance grows with x.
    distance
        Z > 0 of the patch [m].
    baseline
        B ≥ 0, the views at x = ∓B/2 with parallel axes [m].
    lateral_position
        x of the patch [m].

    Returns
    -------
    Ratio between 0 and 1, broadcast: 1 for a patch across the viewing direction or without a baseline, 0 where a view
    sees the patch edge-on or only from behind.

    Raises
    ------
    OutOfRangeError
        For a tilt of π/2 or more, a distance that is not positive, or a negative baseline.
    """
    tilt, Z, B, x = (
        np.asarray(value, dtype=np.float64) for value in (surface_tilt, distance, baseline, lateral_position)
    )
    _require(np.abs(tilt) < np.pi / 2, "tilt of the surface", tilt, limit="below π/2 in magnitude", unit="rad")
    _require(Z > 0, "distance", Z, limit="> 0 m")
    _require(B >= 0, "baseline", B, limit="≥ 0 m")
    left, right = (1 - np.tan(tilt) * ((x + side * B / 2) / Z) for side in (1, -1))
    larger = np.maximum(left, right)
    smaller = np.maximum(np.minimum(left, right), 0.0)
    return np.asarray(np.divide(smaller, larger, out=np.zeros(np.shape(larger)), where=larger > 0))


def _require(condition: ArrayLike, what: str, value: FloatArray, *, limit: str, unit: str = "m") -> None:
    """Refuse a value that breaks a condition."""
    holds = np.asarray(condition)
    if not np.all(holds):
        raise OutOfRangeError(
            what, value=f"{value[~holds].flat[0]:g} {unit}", limit=limit, remedy="check unit and sign"
        )
