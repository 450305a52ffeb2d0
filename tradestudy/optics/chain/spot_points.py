"""Points of a spot: the data shared by all points, and the light of some points on the pixels.

Shared data are computed once: the main-lens field at a few distances of the source from the axis (it turns with the
source, and is interpolated in between), the nodes of a microlens, and the transfer to the detector. Behind the array,
light is followed either from all microlenses over the whole detector at once, or from each on a patch about its ray
image; patches of one source point add as fields.
"""

from __future__ import annotations

import math
import pickle
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from threading import Lock
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from tradestudy.optics.arrays import ComplexArray, FloatArray, IndexArray
from tradestudy.optics.chain.accuracy import MARGIN, ChainAccuracy, far_light, light_on_pixels
from tradestudy.optics.chain.array_field import FieldTable, PupilWave
from tradestudy.optics.chain.arriving_light import (
    Place,
    RayReach,
    RayWave,
    SourceTables,
    farthest_on_array,
    point_wave,
    ray_reach,
    refuse_large_tables,
    source_tables,
)
from tradestudy.optics.chain.detector_patch import (
    POINTS_AT_ONCE,
    SINGLE_PRECISION_FROM,
    DetectorPatch,
    MicrolensPlane,
    detector_patch,
    lit_radius,
    shadowed,
)
from tradestudy.optics.chain.detector_transfer import (
    PatchLaw,
    PatchPlan,
    Response,
    patch_fields,
    patch_law,
    refuse_large_patch,
    response,
)
from tradestudy.optics.chain.microlens_nodes import CellNodes, cell_nodes, lit_share, padded
from tradestudy.optics.chain.point_image import add_spheres, over_detector, split_spheres
from tradestudy.optics.chain.scene import Legs, LightPath
from tradestudy.optics.chain.sources import DiscSource, SourceNodes, source_nodes, tolerated_density
from tradestudy.optics.propagation.lens import PointSource
from tradestudy.optics.propagation.result import squared_magnitude

_RIM = 64  # points of the rim of a disc
_PREPARING = Lock()  # so that threads that begin together prepare a spot only once


@dataclass(frozen=True, kw_only=True, eq=False)
class SpotRequest:
    """Everything that a worker needs to prepare a spot by itself.

    Requests compare by identity; all copies of one request that reach another process become one object there.
    """

    path: LightPath
    source: DiscSource
    wavelength: float
    legs: Legs
    accuracy: ChainAccuracy

    def __reduce__(self) -> tuple[Any, ...]:
        return _received, (pickle.dumps({field.name: getattr(self, field.name) for field in fields(self)}),)

    @cached_property
    def nodes(self) -> SourceNodes:
        """Points that represent the disc."""
        density = source_density(self.accuracy)
        return source_nodes(self.path, self.source, wavelength=self.wavelength, density=density)

    @cached_property
    def outermost(self) -> PointSource:
        """The node that is farthest from the axis."""
        edge = self.nodes.all[np.argmax(np.linalg.norm(self.nodes.all, axis=1))]
        return PointSource(x=float(edge[0]), y=float(edge[1]), distance=self.source.distance)

    @cached_property
    def patch(self) -> DetectorPatch:
        """Part of the detector on which light is followed, from the rays of the disc's centre and outermost node."""
        return detector_patch(
            self.path,
            self.source,
            [ray_reach(self.path, point) for point in (self.source.centre, self.outermost)],
            wavelength=self.wavelength,
            paraxial=self.legs.to_detector == "fresnel",
            accuracy=self.accuracy,
        )

    @cached_property
    def lit_within(self) -> float:
        """Distance from a chief ray within which microlenses are lit [m]."""
        ends = (self.source.centre, self.outermost)
        return max(lit_radius(self.path, point, self.wavelength, self.accuracy) for point in ends)

    def wave(self, x: float, y: float) -> PupilWave | RayWave:
        """Wave of one source point."""
        point = PointSource(x=x, y=y, distance=self.source.distance)
        return point_wave(self.path, point, wavelength=self.wavelength, legs=self.legs)

    def farthest_read(self) -> float:
        """Largest distance from a point's chief ray at which its field is read [m]: at lit lenses, else the nearest.

        Points between the nodes, up to the rim of the disc, estimate the error.
        """
        lenses, source, z = self.path.microlenses, self.source, self.path.array_distance
        anywhere = farthest_on_array(self.path, source, float(np.linalg.norm(self.nodes.all, axis=1).max()))
        if self.patch.whole_detector:
            return anywhere
        turn = 2.0 * math.pi * np.arange(_RIM) / _RIM
        rim = source.diameter / 2.0 * np.column_stack([np.cos(turn), np.sin(turn)]) + [source.x, source.y]
        nearest, _ = cKDTree(lenses.centres).query(-z / source.distance * np.concatenate([self.nodes.all, rim]))
        return min(max(self.lit_within, float(np.max(nearest))) + lenses.cell_reach, anywhere)

    def refuse_large(self) -> None:
        """Refuse what `prepared` could not hold in memory, before it computes anything.

        Raises
        ------
        UnaffordableError
            If the tables of the main-lens field, or the transfer behind a microlens, need more memory than allowed.
        """
        if isinstance(self.patch.grid, PatchPlan):
            refuse_large_patch(self.patch.grid, self.accuracy.memory_limit)
        if self.legs.to_array != "geometric":
            wave = PupilWave(
                path=self.path, source=self.outermost, wavelength=self.wavelength, method=self.legs.to_array
            )
            refuse_large_tables(wave, self.farthest_read(), self.accuracy)

    def prepared(self) -> Spot:
        """Data shared by all points, kept for the latest request only: parts of one spot are computed in sequence."""
        with _PREPARING:
            return _prepared(self)


@lru_cache(maxsize=1)
def _received(content: bytes) -> SpotRequest:
    return SpotRequest(**pickle.loads(content))  # pickled by `SpotRequest.__reduce__`


@lru_cache(maxsize=1)
def _prepared(request: SpotRequest) -> Spot:
    """Compute the tables, on the grids that the geometry of centre and rim of the disc asks for."""
    path, patch, accuracy = request.path, request.patch, request.accuracy
    plane = MicrolensPlane(
        path=path,
        wavelength=request.wavelength,
        paraxial=request.legs.to_detector == "fresnel",
        cell=cell_nodes(path.microlenses, cycles=patch.cycles),
    )
    tables = None
    if request.legs.to_array != "geometric":
        distance = np.linalg.norm(request.nodes.all, axis=1)
        tables = source_tables(
            path,
            request.source,
            (float(distance.min()), float(distance.max())),
            wavelength=request.wavelength,
            method=request.legs.to_array,
            accuracy=accuracy,
            half_width=request.farthest_read(),
        )
    single = accuracy.tolerance >= SINGLE_PRECISION_FROM
    return Spot(
        request=request,
        tables=tables,
        plane=plane,
        transmission=plane.transmission(request.source.centre),
        law=patch_law(patch.grid, memory_limit=accuracy.memory_limit, single=single)
        if isinstance(patch.grid, PatchPlan)
        else response(patch.grid, single=single),
    )


def source_density(accuracy: ChainAccuracy) -> float:
    """Fraction of the cutoff to resolve: light near the cutoff is weak, and the pixel averages it away."""
    return accuracy.source_sampling * tolerated_density(accuracy)


def forget_spot() -> None:
    """Free the tables of the spot that was prepared last."""
    _prepared.cache_clear()


@dataclass(frozen=True, kw_only=True)
class Spot:
    """Data shared by all source points; rays to the array need no tables."""

    request: SpotRequest
    tables: SourceTables | None
    plane: MicrolensPlane
    transmission: ComplexArray
    law: PatchLaw | Response

    @property
    def spacing(self) -> float:
        """Distance between detector samples [m]."""
        return self.request.path.pixels.pitch / self.request.patch.per_pixel

    @property
    def samples(self) -> int:
        """Samples along a side of a Fourier transform."""
        return (self.law.transfer if isinstance(self.law, Response) else self.law.plan).count

    def light(self, place: Place) -> PointLight:
        """Light of one source point."""
        (light,) = self.lights([place])
        return light

    def lights(self, places: Sequence[Place]) -> Iterator[PointLight]:
        """Follow source points side by side; yielded one by one, so that few fine grids are held at once."""
        shared = self.tables.at(list(places)) if self.tables else {}
        with ThreadPoolExecutor(POINTS_AT_ONCE) as pool:
            yield from pool.map(lambda place: _point_light(self, place, shared.get(place)), places)


@dataclass(frozen=True, kw_only=True)
class PointLight:
    """Light of one source point.

    Attributes
    ----------
    intensity
        Intensity on the fine grid of the detector, relative to the point's power through the pupil.
    far
        Light on each pixel from beyond the patches, relative to the same power.
    handed_over
        Fraction of the light that a boundary wave behind the array left to Kirchhoff's integral.
    """

    intensity: FloatArray
    far: FloatArray
    handed_over: float

    def on_pixels(self, spot: Spot) -> FloatArray:
        """Fraction of the point's power on each pixel."""
        intensity = self.intensity.astype(np.float64)
        return (
            light_on_pixels(intensity, spot.request.path.pixels, per_pixel=spot.request.patch.per_pixel)[0] + self.far
        )


def _point_light(spot: Spot, place: Place, table: FieldTable | None) -> PointLight:
    """Follow the light of one source point from the array to the detector."""
    wave = spot.request.wave(*place)
    reach = ray_reach(spot.request.path, wave.source)
    if isinstance(spot.law, Response):
        return _light_of_all(spot, spot.law, wave, place, table, reach)
    rows, columns = (n * spot.request.patch.per_pixel + 2 * MARGIN for n in spot.request.path.pixels.shape)
    single = spot.request.accuracy.tolerance >= SINGLE_PRECISION_FROM
    canvas = np.zeros((rows, columns), dtype=np.complex64 if single else np.complex128)
    far, power, carried = np.zeros(spot.request.path.pixels.shape), 0.0, 0.0
    for group in _lit_groups(spot, wave, place, table):
        rest = group.field
        if spot.request.legs.to_detector == "boundary_wave":
            spheres = split_spheres(spot.request.path, wave, which=group.which, cell=group.cell, field=group.field)
            rest = spheres.rest
            power += spheres.power
            carried += add_spheres(
                canvas,
                path=spot.request.path,
                wave=wave,
                spheres=spheres,
                reach=reach,
                half_patch=spot.request.patch.half_side,
                spacing=spot.spacing,
                accuracy=spot.request.accuracy,
            )
        if rest.any():
            far += _add_light(spot, spot.law, canvas, reach, replace(group, field=rest))
    return PointLight(
        intensity=squared_magnitude(canvas) / wave.power(),
        far=far / wave.power(),
        handed_over=1.0 - carried / power if power > 0.0 else 0.0,
    )


def _light_of_all(
    spot: Spot,
    response: Response,
    wave: PupilWave | RayWave,
    place: Place,
    table: FieldTable | None,
    reach: RayReach,
) -> PointLight:
    """Follow the light of all microlenses over the whole detector at once; none is lost beyond patches."""
    plane, lenses = spot.plane, spot.request.path.microlenses
    if isinstance(wave, RayWave):
        cells = [
            shadowed(lenses, plane.cell, wave.lit, index, spot.request.patch.cycles) for index in range(lenses.count)
        ]
        plane = replace(plane, cell=padded(cells))
        field, transmission = wave.field(*plane.positions), plane.transmission(wave.source)
    else:
        assert spot.tables is not None
        assert table is not None  # waves to the array need one
        field, transmission = spot.tables.field(place, table, *plane.positions), _transmission(spot, wave)
    canvas, handed_over = over_detector(
        plane,
        wave,
        field,
        transmission,
        to_detector=spot.request.legs.to_detector,
        response=response,
        reach=reach,
        half_side=spot.request.patch.half_side,
        accuracy=spot.request.accuracy,
        threads=1,  # points are already followed side by side
    )
    return PointLight(
        intensity=squared_magnitude(canvas) / wave.power(),
        far=np.zeros(spot.request.path.pixels.shape),
        handed_over=handed_over,
    )


@dataclass(frozen=True, kw_only=True)
class _Lit:
    """Microlenses that share their nodes, the field that arrives there, and the lenses' transmission."""

    which: IndexArray
    cell: CellNodes
    field: ComplexArray
    transmission: ComplexArray


def _lit_groups(spot: Spot, wave: PupilWave | RayWave, place: Place, table: FieldTable | None) -> Iterator[_Lit]:
    """Microlenses that light of a source point reaches; those that the edge of a shadow cuts come one by one."""
    lenses, plane = spot.request.path.microlenses, spot.plane
    if isinstance(wave, RayWave):
        share = lit_share(lenses, wave.lit)
        whole = np.flatnonzero(share == 1.0)
        for index in np.flatnonzero(share == 0.5):
            cell = shadowed(lenses, plane.cell, wave.lit, int(index), spot.request.patch.cycles)
            if cell.x.size == 0:  # the edge passes between a corner of the aperture and the circle about it
                continue
            cut = replace(plane, path=replace(spot.request.path, microlenses=lenses.only(int(index))), cell=cell)
            yield _Lit(
                which=np.array([index]),
                cell=cell,
                field=wave.field(*cut.positions),
                transmission=cut.transmission(wave.source),
            )
    else:
        distance = np.linalg.norm(lenses.centres - wave.path.chief_point(wave.source), axis=1)
        whole = np.flatnonzero(distance <= max(spot.request.lit_within, float(distance.min())))
    x, y = (c[whole] for c in plane.positions)
    if spot.tables is None or table is None:
        field = wave.field(x, y) if isinstance(wave, RayWave) else None
    else:
        field = spot.tables.field(place, table, x, y)
    if whole.size and field is not None:
        yield _Lit(which=whole, cell=plane.cell, field=field, transmission=_transmission(spot, wave)[whole])


def _add_light(spot: Spot, law: PatchLaw, canvas: ComplexArray, reach: RayReach, lit: _Lit) -> FloatArray:
    """Add the light of some microlenses on their patches of the detector; return the light that leaves the patches."""
    origin = np.asarray(spot.request.path.pixels.corner) + (0.5 - MARGIN) * spot.spacing
    # Patches snap to the samples of the canvas, so that they add without interpolation.
    nearest = np.rint((reach.image[lit.which] - origin) / spot.spacing).astype(int)
    middles = origin + nearest * spot.spacing
    patches = patch_fields(
        law,
        x=lit.cell.x,
        y=lit.cell.y,
        strengths=(lit.field * lit.transmission).astype(canvas.dtype),
        middles=middles - spot.request.path.microlenses.centres[lit.which],
        tolerance=spot.request.accuracy.tolerance / 20,
    )
    _add_patches(canvas, patches, nearest - law.plan.half)
    sent = np.sum(squared_magnitude(lit.field) * lit.cell.weights, axis=-1)
    held = np.sum(squared_magnitude(patches), axis=(1, 2), dtype=np.float64) * spot.spacing**2
    half = law.plan.side * spot.spacing / 2
    # The law around a disc of rays assumes a round edge. Square apertures use the law of a point focus, which is their
    # mean far away.
    round_edge = spot.request.path.microlenses.aperture == "circular"
    radii = reach.spread[lit.which] if round_edge else np.zeros(lit.which.size)
    return far_light(spot.request.path.pixels, middles, half, np.maximum(sent - held, 0.0), radii)


def _transmission(spot: Spot, wave: PupilWave | RayWave) -> ComplexArray:
    """Phasors of the lenses; those of perfect lenses depend on the source."""
    if spot.request.path.microlenses.lens_phase == "perfect":
        return spot.plane.transmission(wave.source)
    return spot.transmission


def _add_patches(canvas: ComplexArray, patches: ComplexArray, first: IndexArray) -> None:
    """Add patches, whose first samples lie at given indices (x, y), to the canvas of the detector."""
    (rows, columns), side = canvas.shape, patches.shape[1]
    for patch, (j, i) in zip(patches, first, strict=True):
        y0, y1, x0, x1 = max(i, 0), min(i + side, rows), max(j, 0), min(j + side, columns)
        if y0 < y1 and x0 < x1:
            canvas[y0:y1, x0:x1] += patch[y0 - i : y1 - i, x0 - j : x1 - j]


def mean_on_pixels(spot: Spot, part: Iterable[tuple[int, PointLight]]) -> tuple[FloatArray, float]:
    """Weighted mean of points on the pixels, and the error of its integration over them."""
    rows, columns = (n * spot.request.patch.per_pixel + 2 * MARGIN for n in spot.request.path.pixels.shape)
    points, intensity, far = 0, np.zeros((rows, columns)), np.zeros(spot.request.path.pixels.shape)
    for n, light in part:
        points += n
        intensity += n * light.intensity
        far += n * light.far
    pixels, error = light_on_pixels(
        intensity / points, spot.request.path.pixels, per_pixel=spot.request.patch.per_pixel
    )
    return pixels + far / points, error


@dataclass(frozen=True, kw_only=True)
class FollowedPoints:
    """Mean light of some points of a spot on the pixels.

    Attributes
    ----------
    pixels
        Weighted mean, shape (rows, columns).
    pixel_error
        Relative L2 error of its integration over the pixels.
    alone
        Image of each point that was requested separately, shape (points, rows, columns).
    handed_over
        Largest fraction that a boundary wave left to Kirchhoff's integral.
    effort
        Counts of nodes and samples for each point.
    """

    pixels: FloatArray
    pixel_error: float
    alone: FloatArray
    handed_over: float
    effort: dict[str, int]


def follow_points(
    request: SpotRequest, places: FloatArray, weights: tuple[int, ...], alone: tuple[int, ...] = ()
) -> FollowedPoints:
    """Follow weighted source points, shape (n, 2); `alone` lists those whose images are also returned separately."""
    spot = request.prepared()
    points = [(float(x), float(y)) for x, y in places]
    images, handed = [], [spot.tables.handed_over if spot.tables else 0.0]

    def followed() -> Iterator[tuple[int, PointLight]]:
        for number, (weight, light) in enumerate(zip(weights, spot.lights(points), strict=True)):
            handed.append(light.handed_over)
            if number in alone:
                images.append(light.on_pixels(spot))
            yield weight, light

    pixels, error = mean_on_pixels(spot, followed())
    return FollowedPoints(
        pixels=pixels,
        pixel_error=error,
        alone=np.array(images).reshape(-1, *pixels.shape),
        handed_over=max(handed),
        effort={
            "nodes per microlens": spot.plane.cell.x.size,
            "samples per patch": spot.samples**2,
        },
    )
