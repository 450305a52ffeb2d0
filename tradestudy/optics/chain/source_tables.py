"""The main-lens field of every point of a disc: tables at a few distances from the axis, turned and interpolated."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tradestudy.errors import UnaffordableError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy
from tradestudy.optics.chain.array_field import FieldTable, PupilWave, blended, fast_phase, field_table
from tradestudy.optics.chain.arriving_light import field_spacing, table_tolerance
from tradestudy.optics.chain.scene import LightPath, WaveMethod
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.phasors import ComplexArray, unit_phasor
from tradestudy.optics.propagation.lens import PointSource

Place = tuple[float, float]  # of a source point [m]


@dataclass(frozen=True, kw_only=True)
class SourceTables:
    """Main-lens field for sources on the x axis; for other sources it is turned about the axis of the lens.

    Attributes
    ----------
    path, distance, wavelength, method
        Camera, distance of the disc [m], wavelength [m], and law of the leg to the array.
    radii
        Distances from the axis: Chebyshev points of the range that occurs, shape (n,) [m].
    tables
        One field for each distance, all on one grid.
    """

    path: LightPath
    distance: float
    wavelength: float
    method: WaveMethod
    radii: FloatArray
    tables: list[FieldTable]

    def wave(self, x: float, y: float) -> PupilWave:
        """Wave of one source point."""
        return PupilWave(
            path=self.path,
            source=PointSource(x=x, y=y, distance=self.distance),
            wavelength=self.wavelength,
            method=self.method,
        )

    def at(self, places: list[Place]) -> dict[Place, FieldTable]:
        """Table at the distance of each place, interpolated once for all places at the same distance."""
        blends: dict[int, FieldTable] = {}
        result = {}
        for place in places:
            radius = math.hypot(*place)
            key = round(radius * 1e12)
            if key not in blends:
                blends[key] = blended(self.tables, _lagrange(self.radii, np.array(radius)))
            result[place] = blends[key]
        return result

    def field(self, place: Place, table: FieldTable, x: FloatArray, y: FloatArray) -> ComplexArray:
        """Field of a source point at points of the array, from its table turned to the azimuth of the source."""
        radius = math.hypot(*place)
        cosine, sine = (place[0] / radius, place[1] / radius) if radius > 0 else (1.0, 0.0)
        turned = self.wave(radius, 0.0)
        along, across = cosine * x + sine * y, cosine * y - sine * x
        chief = self.path.chief_point(turned.source)
        return table.slow_part(along - chief[0], across) * unit_phasor(fast_phase(turned, along, across))

    def irradiance(self, source_x: FloatArray, source_y: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """|U|² relative to the power through the pupil [1/m²], for pairs of source points and points of the array."""
        radius = np.hypot(source_x, source_y)
        off_axis = radius > 0
        cosine, sine = (
            np.divide(c, radius, out=np.full_like(radius, on_axis), where=off_axis)
            for c, on_axis in ((source_x, 1.0), (source_y, 0.0))
        )
        weights = _lagrange(self.radii, radius)
        along = cosine * x + sine * y + self.path.array_distance / self.distance * radius
        across = cosine * y - sine * x
        slow = np.zeros(radius.shape, dtype=np.complex128)
        for weight, table in zip(weights.T, self.tables, strict=True):
            slow += weight * table.slow_part(along, across)
        return np.asarray(np.abs(slow) ** 2 / (weights @ self._powers))

    @cached_property
    def _powers(self) -> FloatArray:
        """Power through the pupil from each radius."""
        return np.array([self.wave(float(radius), 0.0).power() for radius in self.radii])

    @property
    def samples(self) -> int:
        """Grid points of all tables."""
        return sum(table.coefficients.size for table in self.tables)

    @property
    def handed_over(self) -> float:
        """Largest fraction of a table that a boundary wave left to Kirchhoff's integral."""
        return max(table.handed_over for table in self.tables)


def refuse_large_tables(wave: PupilWave, half_width: float, accuracy: ChainAccuracy) -> float:
    """Refuse tables of this half width [m] that exceed the memory; return the distance between their points [m]."""
    spacing, count = field_spacing(wave, accuracy), _table_count(accuracy)
    needed = 16.0 * count * (2 * half_width / spacing) ** 2
    if needed > accuracy.memory_limit:
        raise UnaffordableError(
            "tables of the main-lens field",
            value=f"{count} of {2 * half_width / spacing:.0f}² points, {needed / 1e9:.3g} GB",
            limit=f"{accuracy.memory_limit / 1e9:.3g} GB",
            remedy="use fewer pixels or microlenses, lower field_sampling, or raise the memory limit",
        )
    return spacing


def _table_count(accuracy: ChainAccuracy) -> int:
    """Number of distances from the axis at which the main-lens field is computed; others are interpolated."""
    return max(2, math.ceil(4 * accuracy.source_sampling * math.pow(1e-2 / accuracy.tolerance, 1 / 6)))


def source_tables(
    path: LightPath,
    source: DiscSource,
    distances: tuple[float, float],
    *,
    wavelength: float,
    method: WaveMethod,
    accuracy: ChainAccuracy,
    half_width: float,
) -> SourceTables:
    """Compute the main-lens field at Chebyshev distances from the axis.

    Parameters
    ----------
    path, source
        Camera and disc.
    distances
        Smallest and largest distance from the axis that occurs [m].
    wavelength, method
        Wavelength [m], and law of the leg to the array.
    accuracy
        Tolerance and sampling.
    half_width
        Largest distance from the chief ray at which tables are read [m].

    Raises
    ------
    UnaffordableError
        If the tables need more memory than allowed.
    NotConvergedError
        If Kirchhoff's integral misses the tolerance where it replaces the boundary wave.
    """
    low, high = distances
    count = _table_count(accuracy)
    radii = (low + high) / 2 - (high - low) / 2 * np.cos(math.pi * (np.arange(count) + 0.5) / count)
    waves = [
        PupilWave(
            path=path,
            source=PointSource(x=float(radius), distance=source.distance),
            wavelength=wavelength,
            method=method,
        )
        for radius in radii
    ]
    spacing = refuse_large_tables(waves[0], half_width, accuracy)
    tables = [
        field_table(
            wave,
            low=(-half_width, -half_width),
            high=(half_width, half_width),
            spacing=spacing,
            node_density=accuracy.pupil_nodes,
            tolerance=table_tolerance(accuracy),
            memory_limit=accuracy.memory_limit,
            edge_tolerance=accuracy.tolerance,
            only_disc=True,
        )
        for wave in waves
    ]
    return SourceTables(
        path=path, distance=source.distance, wavelength=wavelength, method=method, radii=radii, tables=tables
    )


def _lagrange(points: FloatArray, at: FloatArray) -> FloatArray:
    """Weights that interpolate a polynomial through the points, shape (…, points)."""
    difference = points[:, None] - points + np.eye(points.size)
    factors = np.where(np.eye(points.size, dtype=bool), 1.0, (at[..., None, None] - points) / difference)
    return np.asarray(factors.prod(axis=-1))
