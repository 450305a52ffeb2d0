"""The overlap of the pictures of a calibrated pair, from its exact geometry."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from tradestudy.calibration.corners.view_blocks import RELATIVE, ROTATION, TRANSLATION, cameras_of
from tradestudy.calibration.projection import move, project, ray_slopes, rotation_matrix
from tradestudy.cameras.calibrated_pair import Lenses
from tradestudy.optics.arrays import FloatArray

_NODES: Final = (33, 25)  # nodes across and down
_OUTSIDE: Final = -1.0  # px from the edge, for nodes that show no point or whose point has no image


def shared_area(
    rig: FloatArray, lenses: Lenses, free: Sequence[str], pixels: tuple[int, int], distance: FloatArray
) -> FloatArray:
    """Share of the area of a picture whose points the other camera also sees; the smaller of both pictures' shares.

    Points lie in a plane perpendicular to the left camera's axis. Between nodes in the picture, the distance of a
    point's image from the edge of the other picture is interpolated linearly; the share errs by about 1e-3.

    Parameters
    ----------
    rig : array (P,)
        Parameters in the order of ``view_blocks.shared_names`` [px, 1, rad, m].
    lenses, free
        Lens models, and names of their free coefficients.
    pixels
        Columns and rows of each picture.
    distance : array (D,)
        Z [m] from the left camera.

    Returns
    -------
    array (D,)
        ``1 − B/W`` for parallel pinholes whose pictures are W wide at the distance.
    """
    of_left, of_right = cameras_of(rig)
    turn, translation = rotation_matrix(rig[ROTATION]), rig[TRANSLATION]
    nodes = np.stack(
        np.meshgrid(*(np.linspace(-0.5, n - 0.5, k) for n, k in zip(pixels, _NODES, strict=True))), axis=-1
    )
    flat = nodes.reshape(-1, 2)
    from_left = _to_plane(ray_slopes(of_left, flat, lenses[0], free), np.zeros(3), np.eye(3), distance)
    rays = ray_slopes(of_right, flat, lenses[1], free)
    from_right = _to_plane(rays, -turn.T @ translation, turn.T, distance)
    in_right = project(of_right, move(rig[RELATIVE], from_left), lenses[1], free)
    in_left = project(of_left, from_right, lenses[0], free)
    both = [_share_inside(seen, pixels).reshape(distance.shape) for seen in (in_right, in_left)]
    return np.minimum(*both)


def _to_plane(rays: FloatArray, centre: FloatArray, rotation: FloatArray, distance: FloatArray) -> FloatArray:
    """Where rays of a camera meet the planes at given distances, shape (D, N, 3); NaN for rays that do not."""
    directions = np.concatenate([rays, np.ones_like(rays[:, :1])], axis=-1) @ rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (distance[:, None] - centre[2]) / directions[:, 2]
    return centre + np.where(along > 0.0, along, np.nan)[..., None] * directions


def _share_inside(seen: FloatArray, pixels: tuple[int, int]) -> FloatArray:
    """Share of a picture's area, shape (D,), that another picture shows; (D, N, 2) [px] are the nodes' images there."""
    low, high = seen + 0.5, np.array(pixels) - 0.5 - seen
    inside = np.nan_to_num(np.minimum(low, high).min(axis=-1), nan=_OUTSIDE).reshape(-1, *_NODES[::-1])
    a, b, c, d = inside[:, :-1, :-1], inside[:, :-1, 1:], inside[:, 1:, :-1], inside[:, 1:, 1:]
    triangles = np.stack([np.stack([a, b, d]), np.stack([a, c, d])])
    return np.asarray(_positive_part(np.sort(triangles, axis=1)).mean(axis=(0, 2, 3)))


def _positive_part(corners: FloatArray) -> FloatArray:
    """Share of triangles in which a linear function is positive, from ascending values (2, 3, ...) at their corners."""
    low, middle, high = np.moveaxis(corners, 1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        one = high**2 / ((high - low) * (high - middle))
        two = 1.0 - low**2 / ((middle - low) * (high - low))
    return np.where(low >= 0.0, 1.0, np.where(high <= 0.0, 0.0, np.where(middle <= 0.0, one, two)))
