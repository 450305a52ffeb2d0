"""Microlenses that light of a point reaches, and the pixels on which it lands, with a bound on the light left out.

Outside the shadow of the pupil, of radius a on the array, the wave from the rim of the pupil (radius R) leaves on
average the irradiance P λ z/(4 π³ R) [1/(r − a)² + 1/(r + a)²]/r, P being the power through the pupil; in focus this is
Airy's tail.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy
from tradestudy.optics.chain.array_field import PupilWave
from tradestudy.optics.chain.arriving_light import RayWave, blur_radius, ray_reach
from tradestudy.optics.chain.microlens_nodes import lit_share
from tradestudy.optics.chain.scene import LightPath

_SHARE = 0.25  # share of the tolerance that left-out microlenses may use


@dataclass(frozen=True, kw_only=True)
class LitPart:
    """Wave on the microlenses that it lights.

    Attributes
    ----------
    wave
        Wave on a path that contains only these microlenses.
    lost
        Root sum of squares of the powers on the other microlenses, relative to the power through the pupil: as if each
        of them gathered its light on one pixel.
    """

    wave: PupilWave | RayWave
    lost: float


def lit_part(wave: PupilWave | RayWave, accuracy: ChainAccuracy) -> LitPart:
    """Leave out microlenses that rays do not light and whose diffracted light is negligible within the tolerance.

    All microlenses stay for a coherent disc, and for a main lens that is aberrated or not lit evenly.
    """
    lenses = wave.path.microlenses
    away = np.linalg.norm(lenses.centres - wave.path.chief_point(wave.source), axis=1)
    pupil = wave.path.main_lens.pupil
    if isinstance(wave, RayWave):
        kept, lost = lit_share(lenses, wave.lit) > 0.0, 0.0
    elif wave.whole_pupil or (pupil is not None and (pupil.aberrated or not pupil.evenly_lit)):
        return LitPart(wave=wave, lost=0.0)
    else:
        kept, lost = _felt(wave, away, accuracy)
    kept = kept | (away == away.min())
    path = replace(wave.path, microlenses=lenses.only(*np.flatnonzero(kept).tolist()))
    return LitPart(wave=replace(wave, path=path), lost=lost)


def _felt(wave: PupilWave, away: FloatArray, accuracy: ChainAccuracy) -> tuple[BoolArray, float]:
    """Microlenses that matter within the tolerance, and the light that the others take."""
    path, lenses = wave.path, wave.path.microlenses
    blur = blur_radius(path, wave.source)
    nearest = away - lenses.cell_reach
    radius, z = path.main_lens.radius, path.array_distance
    power = lenses.pitch**2 * rim_light(radius=radius, z=z, blur=blur, distance=nearest, wavelength=wave.wavelength)
    order = np.argsort(-away, kind="stable")
    lost = np.sqrt(np.cumsum(power[order] ** 2))
    longer = accuracy.diffraction_reach**2  # the irradiance falls as the square of the distance
    count = int(np.searchsorted(lost, _SHARE * accuracy.tolerance / longer * _least_norm(wave, away, blur)))
    kept = np.ones(away.size, dtype=bool)
    kept[order[:count]] = False
    return kept, float(lost[count - 1]) if count else 0.0


def rim_light(*, radius: float, z: float, blur: float, distance: FloatArray, wavelength: float) -> FloatArray:
    """Mean irradiance of the light from a lens's rim, over the power through the lens [1/m²]; infinite where rays land.

    The rays land within `blur` of a point z behind the lens; `distance` is measured from this point.
    """
    beyond = np.maximum(distance, blur)
    with np.errstate(divide="ignore"):
        law = (1 / (beyond - blur) ** 2 + 1 / (beyond + blur) ** 2) / beyond
    return np.asarray(wavelength * z / (4 * math.pi**3 * radius) * law)


def _least_norm(wave: PupilWave, away: FloatArray, blur: float) -> float:
    """Least L2 norm of the picture, relative to the power through the pupil: rays spread evenly where they land."""
    path, lenses = wave.path, wave.path.microlenses
    lit = np.flatnonzero(away <= max(blur, float(away.min())))
    share = min(1.0, (lenses.aperture_width / (2 * blur)) ** 2) if blur > 0 else 1.0
    spread = ray_reach(path, wave.source).spread[lit]
    pixels = np.maximum(1.0, math.pi * (spread / path.pixels.pitch + 1.0) ** 2)
    return float(math.sqrt(np.sum(share**2 / pixels)))


def reached_pixels(path: LightPath, followed: float) -> tuple[slice, slice]:
    """Rows and columns of the pixels reached by light that is followed this far from where it passes the array."""
    grid, lenses = path.pixels, path.microlenses
    far = lenses.cell_reach + followed
    low, high = lenses.centres.min(axis=0) - far, lenses.centres.max(axis=0) + far
    found = []
    for axis, edges in ((1, grid.edges_y), (0, grid.edges_x)):
        first, last = np.searchsorted(edges, [low[axis], high[axis]])
        start = min(max(int(first) - 1, 0), edges.size - 2)
        found.append(slice(start, min(max(int(last), start + 1), edges.size - 1)))
    return found[0], found[1]
