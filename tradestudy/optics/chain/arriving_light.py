"""The field of one source point on the array, ready to be read anywhere: from a table of waves, or as rays have it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy
from tradestudy.optics.chain.array_field import FieldTable, PupilWave, fast_phase, field_table
from tradestudy.optics.chain.ray_wave import RayWave
from tradestudy.optics.chain.rays import blur_radius
from tradestudy.optics.chain.scene import Legs, LightPath
from tradestudy.optics.propagation.direct import ComplexArray, unit_phasor
from tradestudy.optics.propagation.lens import PointSource

ArrayField = Callable[[FloatArray, FloatArray], ComplexArray]


@dataclass(frozen=True, kw_only=True)
class ArrivingLight:
    """Field on the array.

    Attributes
    ----------
    read
        Field at points (x, y).
    samples
        Points of the table that is interpolated; 0 for a closed form.
    handed_over
        As of `FieldTable`.
    """

    read: ArrayField
    samples: int = 0
    handed_over: float = 0.0


def point_wave(
    path: LightPath, source: PointSource, *, wavelength: float, legs: Legs, coherent_radius: float = 0.0
) -> PupilWave | RayWave:
    """What the first leg carries from a point: waves from the pupil, or the wave that rays are on the array."""
    if legs.to_array == "geometric":
        return RayWave(path=path, source=source, wavelength=wavelength, paraxial=legs.to_detector == "fresnel")
    return PupilWave(
        path=path, source=source, wavelength=wavelength, method=legs.to_array, coherent_radius=coherent_radius
    )


def arriving_light(wave: PupilWave | RayWave, accuracy: ChainAccuracy) -> ArrivingLight:
    """Field over all microlenses.

    Raises
    ------
    UnaffordableError
        If its table needs more memory than allowed.
    NotConvergedError
        If Kirchhoff's integral misses the tolerance where the boundary wave is left to it.
    """
    if isinstance(wave, RayWave):
        return ArrivingLight(read=wave.field)
    table = array_table(wave, accuracy)
    return ArrivingLight(
        read=table_reader(wave, table),
        samples=table.coefficients[0].size,
        handed_over=table.handed_over,
    )


def array_table(wave: PupilWave, accuracy: ChainAccuracy) -> FieldTable:
    """Table of the main lens's field over all microlenses."""
    lenses = wave.path.microlenses
    relative = lenses.centres - wave.path.chief_point(wave.source)
    low, high = relative.min(axis=0) - lenses.cell_reach, relative.max(axis=0) + lenses.cell_reach
    return field_table(
        wave,
        low=(float(low[0]), float(low[1])),
        high=(float(high[0]), float(high[1])),
        spacing=field_spacing(wave, accuracy),
        node_density=accuracy.pupil_nodes,
        tolerance=accuracy.tolerance / 4,
        memory_limit=accuracy.memory_limit,
        edge_tolerance=accuracy.tolerance,
    )


def table_reader(wave: PupilWave, table: FieldTable) -> ArrayField:
    """Read the field from its table, with its fast phase put back."""
    chief_x, chief_y = wave.path.chief_point(wave.source)

    def read(x: FloatArray, y: FloatArray) -> ComplexArray:
        return table.slow_part(x - chief_x, y - chief_y) * unit_phasor(fast_phase(wave, x, y))

    return read


def field_spacing(wave: PupilWave, accuracy: ChainAccuracy) -> float:
    """Spacing that samples the field of the whole pupil 2.5 times as finely as needed at a tolerance of 1e-4.

    Beside the sphere that is taken out, the wave from the opposite rim oscillates twice as fast; it matters where the
    blur has few Fresnel zones.
    """
    path = wave.path
    far = float(np.max(np.linalg.norm(path.microlenses.centres - path.chief_point(wave.source), axis=1)))
    sine = (path.main_lens.radius + far) / math.hypot(path.main_lens.radius + far, path.array_distance)
    depth = abs(path.image_at_array(wave.source)[2])
    zones = blur_radius(path, wave.source) ** 2 / (wave.wavelength * depth) if depth > 0 else 0.0
    rim = 1 + (min(1.0, 2 / zones) if zones > 1 else 0.0)
    finer = 2.5 * rim * math.pow(1e-4 / accuracy.tolerance, 1 / 6)
    return wave.wavelength / (2 * sine * max(finer, 1.2) * accuracy.field_sampling)
