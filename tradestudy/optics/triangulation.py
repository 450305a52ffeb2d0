"""Two views: triangulation, and the surfaces that only one of them sees or that they see differently.

Equation 8 belongs to "Diffraction model of a plenoptic camera for in-situ space exploration". Its image coordinates are
local to each microlens; see `tradestudy.optics.thin_lens`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray, as_floats, require


def plenoptic_focus_shift(
    disparity: ArrayLike,
    microlens_baseline: ArrayLike,
    *,
    mla_distance: ArrayLike,
    microlens_gap: ArrayLike,
    focal_length: ArrayLike,
) -> FloatArray:
    """The focus shift behind a disparity: ``s = (z − f_M) − b_L Δx / Δσ`` [m], the denominator of eq. 8.

    An inverse depth up to the factor f²: 0 at infinity, negative beyond. Arguments as in `plenoptic_depth`.
    """
    with np.errstate(divide="ignore", over="ignore"):  # a disparity of zero, or barely more, means a_L = ±infinity
        v = np.asarray(microlens_baseline, dtype=np.float64) / np.asarray(disparity, dtype=np.float64)
    f = np.asarray(focal_length, dtype=np.float64)
    return np.asarray(
        (np.asarray(mla_distance, dtype=np.float64) - f) - np.asarray(microlens_gap, dtype=np.float64) * v
    )


def plenoptic_depth(
    disparity: ArrayLike,
    microlens_baseline: ArrayLike,
    *,
    mla_distance: ArrayLike,
    microlens_gap: ArrayLike,
    focal_length: ArrayLike,
) -> FloatArray:
    """Eq. 8: ``a_M = f + f² / s`` with ``s = (z − f) − b_L Δx / Δσ``.

    Parameters
    ----------
    disparity
        Δσ [m], difference of two local image coordinates, signed.
    microlens_baseline
        Δx [m], difference of the two microlens centres, in the same order.
    mla_distance, microlens_gap, focal_length
        z, b_L and f_M [m].

    Returns
    -------
    FloatArray
        a_M [m]; +infinity where s ≤ 0: a disparity that no point in front of the camera causes ranks beyond the
        farthest point, so that quantiles of noisy depths stay right. The relative error is 2⁻⁵² times the condition
        number Σ |∂ ln a / ∂ ln p| over all inputs p, which grows as a/f for distant points.
    """
    f = np.asarray(focal_length, dtype=np.float64)
    s = plenoptic_focus_shift(
        disparity, microlens_baseline, mla_distance=mla_distance, microlens_gap=microlens_gap, focal_length=f
    )
    with np.errstate(divide="ignore"):
        depth = np.where(s > 0.0, f + f * (f / np.where(s > 0.0, s, 1.0)), np.inf)
    return np.asarray(np.where(np.isnan(s), np.nan, depth))


def stereo_disparity(
    object_distance: ArrayLike,
    baseline: ArrayLike,
    focal_length: ArrayLike,
    *,
    convergence_angle: ArrayLike = 0.0,
) -> FloatArray:
    """The disparity of a point between the two axes: ``d = 2 f tan(atan(B / 2Z) − θ/2)`` [m].

    Parameters
    ----------
    object_distance
        Z [m] from the baseline, on the line midway between the cameras; infinity is allowed.
    baseline, focal_length
        B and f [m]; f is the principal distance.
    convergence_angle
        θ [rad], the angle between the two optical axes, positive when they meet in front; 0 for a parallel rig, where
        the law is ``d = f B / Z`` exactly.
    """
    half = np.asarray(baseline, dtype=np.float64) / (2.0 * np.asarray(object_distance, dtype=np.float64))
    t = np.tan(np.asarray(convergence_angle, dtype=np.float64) / 2.0)
    return np.asarray(2.0 * np.asarray(focal_length, dtype=np.float64) * (half - t) / (1.0 + half * t))


def depth_of_inverse(inverse_depth: ArrayLike) -> FloatArray:
    """Depth [m] from an inverse depth [1/m]: +infinity where it is zero or negative, NaN where it is NaN."""
    inverse = np.asarray(inverse_depth, dtype=np.float64)
    with np.errstate(over="ignore"):  # overflow counts as infinitely far
        depth = np.where(inverse > 0.0, 1.0 / np.where(inverse > 0.0, inverse, 1.0), np.inf)
    return np.asarray(np.where(np.isnan(inverse), np.nan, depth))


def inverse_depth_on_ray(
    ray_x: ArrayLike, ray_z: ArrayLike, slope: ArrayLike, moved_x: ArrayLike, moved_z: ArrayLike
) -> FloatArray:
    """Inverse depth of a point on a ray, from the slope at which a second camera sees it: the law of every stereo pair.

    With t from the second camera to the first, a point at depth Z on the first one's ray ``Z (a_x, a_y, a_z)`` appears
    in the second one's picture at the slope ``r = (Z a_x + t_x)/(Z a_z + t_z)``, hence
    ``1/Z = (r a_z − a_x)/(t_x − r t_z)``.

    Parameters
    ----------
    ray_x, ray_z
        Components of the ray along the baseline and along the axis, in a frame along the axes of the second camera. Z
        is measured in lengths of (a_x, a_y, a_z) per unit depth, so it is the depth in that frame if a_z = 1.
    slope
        r, the ratio x/z of the second ray in the same frame.
    moved_x, moved_z
        Components of t [m], from the second camera to the first.

    Returns
    -------
    FloatArray
        Inverse depth [1/m]; zero at infinity, and negative for rays that diverge.
    """
    r, a_x, a_z, t_x, t_z = as_floats(slope, ray_x, ray_z, moved_x, moved_z)
    return np.asarray((r * a_z - a_x) / (t_x - r * t_z))


def stereo_inverse_depth(
    disparity: ArrayLike,
    baseline: ArrayLike,
    focal_length: ArrayLike,
    *,
    convergence_angle: ArrayLike = 0.0,
) -> FloatArray:
    """``1/Z = (2/B) tan(atan(d / 2f) + θ/2)`` [1/m], for points midway between the cameras.

    Zero at infinity and negative for rays that diverge; arguments as in `stereo_disparity`.
    """
    half = np.asarray(disparity, dtype=np.float64) / (2.0 * np.asarray(focal_length, dtype=np.float64))
    t = np.tan(np.asarray(convergence_angle, dtype=np.float64) / 2.0)
    slope = (half + t) / (1.0 - half * t)  # of the left ray; that of the right one is its mirror image
    return inverse_depth_on_ray(slope, 1.0, -slope, -np.asarray(baseline, dtype=np.float64), 0.0)


def stereo_depth(
    disparity: ArrayLike,
    baseline: ArrayLike,
    focal_length: ArrayLike,
    *,
    convergence_angle: ArrayLike = 0.0,
) -> FloatArray:
    """``Z = f B / d`` for a parallel rig and its exact counterpart for a converging one.

    Returns
    -------
    FloatArray
        Z [m]; +infinity where the rays are parallel or diverge, so that noisy depths keep their rank.
    """
    return depth_of_inverse(
        stereo_inverse_depth(disparity, baseline, focal_length, convergence_angle=convergence_angle)
    )


def midpoint_depth(
    left_direction: FloatArray, right_direction: FloatArray, left_centre: FloatArray, right_centre: FloatArray
) -> FloatArray:
    """Midpoint rule: the z coordinate of the middle of the shortest segment between two lines of sight.

    Parameters
    ----------
    left_direction, right_direction
        Directions of the two rays, shape (..., 3), of any length; z lies along the rig's depth axis.
    left_centre, right_centre
        Centres of projection [m], shape (..., 3).

    Returns
    -------
    FloatArray
        Depth [m], shape (...); +infinity where the rays are parallel or meet behind the cameras.
    """
    offset = right_centre - left_centre
    # The closest points from cross products, which do not cancel where the rays are nearly parallel.
    normal = np.cross(left_direction, right_direction)
    square = np.sum(normal * normal, axis=-1)
    safe = np.where(square > 0.0, square, 1.0)
    along_left = np.sum(np.cross(offset, right_direction) * normal, axis=-1) / safe
    along_right = np.sum(np.cross(offset, left_direction) * normal, axis=-1) / safe
    z_left = left_centre[..., 2] + along_left * left_direction[..., 2]
    z_right = right_centre[..., 2] + along_right * right_direction[..., 2]
    in_front = (square > 0.0) & (along_left > 0.0) & (along_right > 0.0)
    return np.asarray(np.where(in_front, (z_left + z_right) / 2.0, np.inf))


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
    h, Z, B, w = as_floats(step_height, edge_distance, baseline, obstacle_width)
    require(Z > 0, "distance of the edge", Z, limit="> 0 m")
    require(h >= 0, "height of the step", h, limit="≥ 0 m")
    require(B >= 0, "baseline", B, limit="≥ 0 m")
    require(w >= 0, "width of the obstacle", w, limit="≥ 0 m")
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
    tilt, Z, B, x = as_floats(surface_tilt, distance, baseline, lateral_position)
    require(np.abs(tilt) < np.pi / 2, "tilt of the surface", tilt, limit="below π/2 in magnitude", unit="rad")
    require(Z > 0, "distance", Z, limit="> 0 m")
    require(B >= 0, "baseline", B, limit="≥ 0 m")
    left, right = (1 - np.tan(tilt) * ((x + side * B / 2) / Z) for side in (1, -1))
    larger = np.maximum(left, right)
    smaller = np.maximum(np.minimum(left, right), 0.0)
    return np.asarray(np.divide(smaller, larger, out=np.zeros(np.shape(larger)), where=larger > 0))
