"""Light of one source point on its way to the array: its rays, and its field there by a table of waves or by rays."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.arrays import BoolArray, ComplexArray, FloatArray, lagrange_weights, unit_phasor
from tradestudy.optics.chain.accuracy import ChainAccuracy
from tradestudy.optics.chain.array_field import FieldTable, PupilWave, blended, fast_phase, field_table, reading_kernel
from tradestudy.optics.chain.microlens_nodes import Disc
from tradestudy.optics.chain.scene import Legs, LightPath, Microlenses, WaveMethod
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.lens import PointSource
from tradestudy.optics.propagation.paths import ParabolicPath, SphericalPath

_LEAST_ZONES = 0.5
ArrayField = Callable[[FloatArray, FloatArray], ComplexArray]


@dataclass(frozen=True, kw_only=True)
class RayReach:
    """Landing points of the paraxial rays of one source point through the centre and the rim of every microlens.

    Attributes
    ----------
    image
        Where the ray through each microlens's centre lands, absolute (x, y) [m], shape (lenses, 2).
    travel
        Largest distance between where a ray lands and where it passed the array [m], shape (lenses,).
    spread
        Largest distance between a landing point and ``image`` [m], shape (lenses,).
    """

    image: FloatArray
    travel: FloatArray
    spread: FloatArray


def ray_reach(path: LightPath, source: PointSource, *, whole_pupil: bool = False) -> RayReach:
    """Trace the rays through centre and rim of every cell, from the pupil points that can reach them.

    `whole_pupil` admits rays from every pupil point to every array point, as a coherent extended source does and an
    aberrated main lens may.
    """
    lenses, b = path.microlenses, path.detector_distance
    whole_pupil = whole_pupil or (path.main_lens.pupil is not None and path.main_lens.pupil.aberrated)
    angle = 2 * np.pi * np.arange(16) / 16
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    aberrated = lenses.pupil is not None and lenses.pupil.aberrated
    within = (0.25, 0.5, 0.75, 1.0) if aberrated else (1.0,)  # the steepest ray need not pass the rim
    rings = [np.zeros((1, 2)), *(share * lenses.reach * rim for share in within)]
    refracts = [True] * (1 + len(within) * angle.size)
    if lenses.gaps == "clear":
        rings.append(lenses.cell_reach * rim)
        refracts += [False] * angle.size
    offset = np.concatenate(rings)
    points = lenses.centres[:, None] + offset  # (lenses, points, 2)
    slope = _arriving_slope(path, source, points, rim, whole_pupil)  # (lenses, points, candidates, 2)
    behind = slope + bending(lenses, offset, np.array(refracts))[:, :, None]
    landing = points[:, :, None] + b * behind
    image = landing[:, 0].mean(axis=1)
    travel = np.linalg.norm(b * behind, axis=-1).max(axis=(1, 2))
    spread = np.linalg.norm(landing - image[:, None, None], axis=-1).max(axis=(1, 2))
    return RayReach(image=image, travel=travel, spread=spread)


def bending(lenses: Microlenses, offset: FloatArray, refracts: BoolArray) -> FloatArray:
    """Changes of slope of paraxial rays by each lens at offsets (points, 2) from its centre, (lenses, points, 2).

    They are 0 at offsets that do not refract: in clear gaps.
    """
    bent = -(refracts[:, None] / lenses.focal_lengths[:, None, None]) * offset
    if lenses.pupil is not None:
        for term in lenses.pupil.path_terms(lenses.reach):
            bent = bent + refracts[:, None] * np.stack(term.slope(offset[:, 0], offset[:, 1]), axis=-1)
    return np.asarray(bent)


def blur_radius(path: LightPath, source: PointSource) -> float:
    """Radius of the source's geometric blur on the array [m]."""
    depth = path.image_at_array(source)[2]
    return path.main_lens.radius * abs(depth / (path.array_distance - depth))


def _arriving_slope(
    path: LightPath, source: PointSource, points: FloatArray, rim: FloatArray, whole_pupil: bool
) -> FloatArray:
    """Slopes of rays that can arrive at points of the array: from the whole pupil if the image is in focus there."""
    radius, z = path.main_lens.radius, path.array_distance
    blur = blur_radius(path, source)
    chief = np.asarray(path.chief_point(source))
    if whole_pupil or blur < 0.02 * path.microlenses.pitch:
        pupil = np.concatenate([np.zeros((1, 2)), radius * rim])
        return np.asarray((points[:, :, None] - pupil) / z)
    depth = path.image_at_array(source)[2]
    pupil = (points - chief) * (radius / blur) * np.sign(depth) * -np.sign(path.array_distance - depth)
    # Points in the shadow get the ray from the nearest point of the rim, which diffracts light to them.
    size = np.linalg.norm(pupil, axis=-1, keepdims=True)
    pupil = pupil * np.minimum(1, radius / np.maximum(size, radius * 1e-300))
    return np.asarray((points - pupil) / z)[:, :, None]


@dataclass(frozen=True, kw_only=True)
class RayWave:
    """Wave that the paraxial rays of a point source form on the array.

    U(x) = exp(i k s(x))/(√π R |κ|) within R |κ| of the chief ray, else 0. κ = 1 − z/b scales the pupil's radius R to
    that of its shadow; s is the path of the sphere about the main lens's image, to second order if `paraxial`. The
    power through the pupil is 1 and arrives unchanged, since rays carry it: on this leg the edge diffracts nothing.

    Parameters
    ----------
    path
        The camera.
    source
        Point source in front of the main lens; its image may lie in front of the array or behind it.
    wavelength
        λ [m].
    paraxial
        Whether the leg behind the array follows Fresnel's law, with every path to second order; otherwise paths are
        exact.

    Raises
    ------
    OutOfRangeError
        If the array lies in the focus of the main lens, where rays have no density.
    """

    path: LightPath
    source: PointSource
    wavelength: float
    paraxial: bool

    def __post_init__(self) -> None:
        refuse_focus_on_array(self.path, self.source, self.wavelength)

    @property
    def whole_pupil(self) -> bool:
        """Whether light from every pupil point may reach every array point: never, as each array point sees one."""
        return False

    @property
    def reference(self) -> RayWave:
        """The wave itself: only a boundary wave is compared with another."""
        return self

    @property
    def lit(self) -> Disc:
        """Part of the array that the pupil's light covers."""
        x, y = self.path.chief_point(self.source)
        return Disc(x=x, y=y, radius=blur_radius(self.path, self.source))

    def power(self) -> float:
        """∫ |U|² over the pupil."""
        return 1.0

    def field(self, x: FloatArray, y: FloatArray) -> ComplexArray:
        """Wave at lit points of the array; callers must leave out points in the shadow."""
        image_x, image_y, depth = self.path.image_at_array(self.source)
        kind = ParabolicPath if self.paraxial else SphericalPath
        sphere = kind(x=image_x, y=image_y, distance=depth)
        phase = 2 * math.pi / self.wavelength * np.asarray(sphere.value(x, y))
        return np.asarray(unit_phasor(phase) / (math.sqrt(math.pi) * self.lit.radius))


def refuse_focus_on_array(path: LightPath, source: PointSource, wavelength: float) -> None:
    """Refuse rays on one leg if the main lens focuses on the array.

    Raises
    ------
    OutOfRangeError
        If the main lens's blur on the array has less than half a Fresnel zone.
    """
    depth = abs(path.image_at_array(source)[2])
    zones = blur_radius(path, source) ** 2 / (wavelength * depth) if depth > 0 else 0.0
    if zones < _LEAST_ZONES:
        raise OutOfRangeError(
            "rays on one leg, with the microlens array in the focus of the main lens",
            value=f"a blur of {zones:.2g} Fresnel zones on the array",
            limit=f"≥ {_LEAST_ZONES} zones",
            remedy="use fresnel or kirchhoff on both legs, or geometric on both",
        )


@dataclass(frozen=True, kw_only=True)
class ArrivingLight:
    """Field on the array.

    Attributes
    ----------
    read
        Function that returns the field at points (x, y).
    samples
        Number of points of the interpolated table; 0 for a closed form.
    handed_over
        As in `FieldTable`.
    """

    read: ArrayField
    samples: int = 0
    handed_over: float = 0.0


def point_wave(
    path: LightPath, source: PointSource, *, wavelength: float, legs: Legs, coherent_radius: float = 0.0
) -> PupilWave | RayWave:
    """Light of a point after the first leg: a wave from the pupil, or the wave that rays form on the array."""
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
        If the table of the field needs more memory than allowed.
    NotConvergedError
        If Kirchhoff's integral misses the tolerance where it replaces the boundary wave.
    """
    if isinstance(wave, RayWave):
        return ArrivingLight(read=wave.field)
    table = array_table(wave, accuracy)
    return ArrivingLight(
        read=table_reader(wave, table),
        samples=table.coefficients.size,
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
        tolerance=table_tolerance(accuracy),
        memory_limit=accuracy.memory_limit,
        edge_tolerance=accuracy.tolerance,
    )


def table_reader(wave: PupilWave, table: FieldTable) -> ArrayField:
    """Function that reads the field from its table and restores the fast phase."""
    chief_x, chief_y = wave.path.chief_point(wave.source)

    def read(x: FloatArray, y: FloatArray) -> ComplexArray:
        return table.slow_part(x - chief_x, y - chief_y) * unit_phasor(fast_phase(wave, x, y))

    return read


def table_tolerance(accuracy: ChainAccuracy) -> float:
    """Tolerance of a table of the main lens's field."""
    return min(accuracy.tolerance / 4, 1e-3)


def field_spacing(wave: PupilWave, accuracy: ChainAccuracy) -> float:
    """Grid spacing that samples light from the rim of the pupil as finely as the interpolation kernel requires [m]."""
    finer = reading_kernel(table_tolerance(accuracy)).oversampling * accuracy.field_sampling
    return wave.wavelength * wave.path.array_distance / (2 * wave.path.main_lens.radius * finer)


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
            # To the picometre: on one ring of nodes, distances differ by rounding.
            key = round(radius * 1e12)
            if key not in blends:
                blends[key] = blended(self.tables, lagrange_weights(self.radii, np.array(radius)))
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
        weights = lagrange_weights(self.radii, radius)
        # Relative to the chief ray, which meets the array on the side opposite to the source.
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


def farthest_on_array(path: LightPath, source: DiscSource, distance: float) -> float:
    """Largest distance between the array's points and the chief ray of a source point this far from the axis [m]."""
    lenses = path.microlenses
    on_array = float(np.max(np.linalg.norm(lenses.centres, axis=1))) + lenses.cell_reach
    return on_array + distance * path.array_distance / source.distance


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
        Largest distance from the chief ray at which tables are read [m]; beyond the array, there is nothing to read.

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
    half_width = min(half_width, farthest_on_array(path, source, high))
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
