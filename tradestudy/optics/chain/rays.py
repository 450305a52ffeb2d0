"""Rays through the chain: where light goes before diffraction spreads it, which sizes the grids of the wave methods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.scene import LightPath
from tradestudy.optics.propagation.lens import PointSource


@dataclass(frozen=True, kw_only=True)
class RayReach:
    """Rays of one source point through the rim of every microlens, paraxial.

    Attributes
    ----------
    image
        Where the ray through each microlens's centre lands, absolute (x, y) [m], shape (lenses, 2).
    travel
        Farthest landing of a ray from where it passed the array [m], shape (lenses,).
    spread
        Farthest landing from ``image`` [m], shape (lenses,).
    slope
        Direction (dx/dz, dy/dz) of the arriving ray at each centre, shape (lenses, 2).
    """

    image: FloatArray
    travel: FloatArray
    spread: FloatArray
    slope: FloatArray


def ray_reach(path: LightPath, source: PointSource, *, whole_pupil: bool = False) -> RayReach:
    """Trace the rays through centre and rim of every cell, from the pupil points that can reach them.

    `whole_pupil` admits rays from every pupil point to every array point, as a coherent extended source does.
    """
    lenses, b = path.microlenses, path.detector_distance
    angle = 2 * np.pi * np.arange(16) / 16
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    rings = [np.zeros((1, 2)), lenses.reach * rim]
    acting = [True] * (1 + angle.size)
    if lenses.gaps == "clear":
        rings.append(lenses.cell_reach * rim)
        acting += [False] * angle.size
    offset = np.concatenate(rings)
    at = lenses.centres[:, None] + offset  # (lenses, points, 2)
    slope = _arriving_slope(path, source, at, rim, whole_pupil)  # (lenses, points, candidates, 2)
    power = np.asarray(acting)[:, None, None] / lenses.focal_lengths[:, None, None, None]
    behind = slope - power * offset[:, None, :]
    landing = at[:, :, None] + b * behind
    image = landing[:, 0].mean(axis=1)
    travel = np.linalg.norm(b * behind, axis=-1).max(axis=(1, 2))
    spread = np.linalg.norm(landing - image[:, None, None], axis=-1).max(axis=(1, 2))
    return RayReach(image=image, travel=travel, spread=spread, slope=slope[:, 0].mean(axis=1))


def blur_radius(path: LightPath, source: PointSource) -> float:
    """Radius of the source's geometric blur on the array [m]."""
    depth = path.image_at_array(source)[2]
    return path.main_lens.radius * abs(depth / (path.array_distance - depth))


def _arriving_slope(
    path: LightPath, source: PointSource, at: FloatArray, rim: FloatArray, whole_pupil: bool
) -> FloatArray:
    """Slopes of rays that can arrive at points of the array; the whole pupil where the image is in focus there."""
    radius, z = path.main_lens.radius, path.array_distance
    blur = blur_radius(path, source)
    chief = np.asarray(path.chief_point(source))
    if whole_pupil or blur < 0.02 * path.microlenses.pitch:
        pupil = np.concatenate([np.zeros((1, 2)), radius * rim])
        return np.asarray((at[:, :, None] - pupil) / z)
    depth = path.image_at_array(source)[2]
    pupil = (at - chief) * (radius / blur) * np.sign(depth) * -np.sign(path.array_distance - depth)
    size = np.linalg.norm(pupil, axis=-1, keepdims=True)
    pupil = pupil * np.minimum(1, radius / np.maximum(size, radius * 1e-300))
    return np.asarray((at - pupil) / z)[:, :, None]
