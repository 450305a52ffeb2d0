"""How far a source's light reaches on the array, and what the microlenses that an image leaves out would change."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.airy import FIRST_DARK_RING
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.array_field import PupilWave
from tradestudy.optics.chain.arriving_light import bending, blur_radius
from tradestudy.optics.chain.lit_part import rim_light
from tradestudy.optics.chain.scene import LightPath
from tradestudy.optics.phasors import ComplexArray
from tradestudy.optics.propagation.fast_sum import fast_sum
from tradestudy.optics.propagation.lens import LensWave, PointSource
from tradestudy.optics.propagation.rays import aperture_mesh, land
from tradestudy.optics.propagation.targets import TargetPoints

_POINTS = 12  # on the aperture of each microlens, for its power
_TOLERANCE = 1e-2  # of the field at these points
_STEP = 0.05  # of the width of its finest fringes, for the gradient of its phase


def array_reach(path: LightPath, points: Sequence[PointSource], wavelength: float) -> float:
    """Distance from the first point's chief ray within which the light of all points meets the array [m].

    It includes the exact rays from the whole aberrated pupil, and the first dark ring around them, of radius
    1.22 λ z/(2R). Parts of the pupil whose phase is steeper than that of any ray send no light to the array.

    Raises
    ------
    OutOfRangeError
        If the phase is as steep as that over the whole pupil.
    """
    z, radius = path.array_distance, path.main_lens.radius
    chief = path.chief_point(points[0])
    u, v = aperture_mesh(radius)
    farthest = 0.0
    for one in points:
        wave = LensWave(source=one, lens=path.main_lens, wavelength=wavelength, paraxial=False, obliquity="paper")
        with np.errstate(invalid="ignore"):
            x, y = land(wave, u, v, np.asarray(z))
        away = np.hypot(x - chief[0], y - chief[1])
        if not np.isfinite(away).any():
            raise OutOfRangeError(
                "slope of the phase behind the main lens",
                value="steeper than that of any ray, over the whole pupil",
                limit="a sine < 1",
                remedy="reduce the aberrations; give waves to Pupil.from_waves, with the wavelength in metres",
            )
        farthest = max(
            farthest, float(np.nanmax(away)), math.dist(path.chief_point(one), chief) + blur_radius(path, one)
        )
    return farthest + FIRST_DARK_RING * wavelength * z / (2 * radius)


def missing_light(wave: PupilWave, path: LightPath, pixels: FloatArray) -> FloatArray:
    """Estimate what microlenses that an image leaves out would change in it.

    The main lens's field at points of each aperture gives the power P that a microlens receives, and by the gradient of
    its phase where this light lands. Pixel j receives P s_j: evenly where rays land, and by the mean light from the rim
    of the microlens beyond. There it interferes with the light I_j of the image: the mean square of the change is
    2 I_j P s_j + (P s_j)².

    Parameters
    ----------
    wave
        Wave behind the main lens.
    path
        The camera with only the microlenses left out.
    pixels
        The image: fraction of the power through the pupil on each pixel.

    Returns
    -------
    array, shape (lenses,)
        L2 change by each microlens, relative to the image [1].
    """
    lenses, grid = path.microlenses, path.pixels
    power, landing, spread = _landings(wave, path)
    across, along = ((edges[1:] + edges[:-1]) / 2 for edges in (grid.edges_x, grid.edges_y))
    changes = np.empty(lenses.count)
    for index, (centre, radius) in enumerate(zip(landing, spread + grid.pitch / math.sqrt(2), strict=True)):
        beyond = rim_light(
            radius=lenses.reach,
            z=path.detector_distance,
            blur=float(radius),
            distance=np.hypot(across - centre[0], (along - centre[1])[:, None]),
            wavelength=wave.wavelength,
        )
        share = np.minimum(grid.pitch**2 * beyond, 1.0 / max(1.0, math.pi * (radius / grid.pitch) ** 2))
        changes[index] = math.sqrt(np.sum(2 * np.abs(pixels) * power[index] * share + (power[index] * share) ** 2))
    return changes / float(np.linalg.norm(pixels))


def _landings(wave: PupilWave, path: LightPath) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Power of the light on each microlens over that through the pupil, and centre and radius of where it lands."""
    lenses = path.microlenses
    turn = np.arange(_POINTS) * math.pi * (3 - math.sqrt(5))
    out = lenses.cell_reach * np.sqrt((np.arange(_POINTS) + 0.5) / _POINTS)
    offset = out[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    lens = lenses.lens(0)
    in_lens = out <= lenses.reach
    passed = np.ones(_POINTS)
    if lenses.pupil is not None:
        passed[in_lens] = np.abs(np.broadcast_to(lens.transmission(*offset[in_lens].T), in_lens.sum())) ** 2
    at = lenses.centres[:, None] + offset
    step = _STEP * wave.wavelength * path.array_distance / path.main_lens.radius
    here, *moved = _field(wave, path, np.stack([at + shift for shift in ((0.0, 0.0), (step, 0.0), (0.0, step))]))
    slope = np.stack([np.angle(one * here.conj()) for one in moved], axis=-1) / (wave.kernel.wavenumber * step)
    weight = np.abs(here) ** 2 * passed
    total = np.maximum(weight.sum(axis=1), np.finfo(np.float64).tiny)
    landed = at + path.detector_distance * (slope + bending(lenses, offset, in_lens))
    centre = np.einsum("lp,lpc->lc", weight, landed) / total[:, None]
    squared = np.einsum("lp,lpc->l", weight, (landed - centre[:, None]) ** 2) / total
    power = weight.mean(axis=1) * math.pi * lenses.cell_reach**2 / wave.power()
    return power, centre, np.sqrt(2 * squared)


def _field(wave: PupilWave, path: LightPath, at: FloatArray) -> ComplexArray:
    """Field on the array at points (..., 2)."""
    x, y = at[..., 0], at[..., 1]
    found = fast_sum(
        wave.samples(wave.nodes((x, y), density=1.0)),
        wave.kernel,
        TargetPoints(x=x.ravel(), y=y.ravel(), distance=path.array_distance),
        low_rank_tolerance=_TOLERANCE,
        nufft_tolerance=_TOLERANCE,
    )
    return np.asarray(found.field.reshape(x.shape))
