"""Points of a spot: the data shared by all points, and the light of some points on the pixels.

Shared data are computed once: the main-lens field at a few distances of the source from the axis (it turns with the
source, and is interpolated in between), the nodes of a microlens, and the transfer to the detector. Behind the array,
light is followed either from all microlenses over the whole detector at once, or from each on a patch about its ray
image; patches of one source point add as fields.
"""

from __future__ import annotations

import math
import pickle
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import lru_cache
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
    disc_ends,
    lit_radius,
    outermost,
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
from tradestudy.optics.chain.microlens_edges import add_spheres, split_spheres
from tradestudy.optics.chain.microlens_nodes import CellNodes, cell_nodes, lit_share, padded
from tradestudy.optics.chain.point_image import over_detector
from tradestudy.optics.chain.scene import Legs, LightPath
from tradestudy.optics.chain.sources import DiscSource, SourceNodes, source_nodes, tolerated_density
from tradestudy.optics.propagation.lens import PointSource
from tradestudy.optics.propagation.result import squared_magnitude

_RIM = 64  # points of the rim of a disc


@dataclass(frozen=True, kw_only=True)
class Spot:
    """Data shared by all source points; rays to the array need no tables."""

    path: LightPath
    source: DiscSource
    wavelength: float
    legs: Legs
    accuracy: ChainAccuracy
    tables: SourceTables | None
    plane: MicrolensPlane
    cycles: float
    transmission: ComplexArray
    law: PatchLaw | Response
    half_patch: float
    per_pixel: int
    lit_within: float

    @property
    def spacing(self) -> float:
        """Distance between detector samples [m]."""
        return self.path.pixels.pitch / self.per_pixel

    @property
    def whole_detector(self) -> bool:
        """Whether all microlenses are followed over the whole detector at once."""
        return isinstance(self.law, Response)

    @property
    def samples(self) -> int:
        """Samples along a side of a Fourier transform."""
        return (self.law.transfer if isinstance(self.law, Response) else self.law.plan).count

    def wave(self, x: float, y: float) -> PupilWave | RayWave:
        """Wave of one source point."""
        source = PointSource(x=x, y=y, distance=self.source.distance)
        return point_wave(self.path, source, wavelength=self.wavelength, legs=self.legs)


def prepare_spot(
    path: LightPath,
    source: DiscSource,
    nodes: SourceNodes,
    wavelength: float,
    legs: Legs,
    accuracy: ChainAccuracy,
) -> Spot:
    """Choose every grid from the geometry of centre and rim of the disc, and compute the tables."""
    distance = np.linalg.norm(nodes.all, axis=1)
    patch = _patch_of(path, source, nodes, wavelength, legs, accuracy)
    paraxial = legs.to_detector == "fresnel"
    plane = MicrolensPlane(
        path=path,
        wavelength=wavelength,
        paraxial=paraxial,
        cell=cell_nodes(path.microlenses, cycles=patch.cycles),
    )
    lit_within = _lit_within(path, source, nodes, wavelength, accuracy)
    single = accuracy.tolerance >= SINGLE_PRECISION_FROM
    tables = None
    if legs.to_array != "geometric":
        tables = source_tables(
            path,
            source,
            (float(distance.min()), float(distance.max())),
            wavelength=wavelength,
            method=legs.to_array,
            accuracy=accuracy,
            half_width=_farthest_read(path, source, nodes, math.inf if patch.whole_detector else lit_within),
        )
    return Spot(
        path=path,
        source=source,
        wavelength=wavelength,
        legs=legs,
        accuracy=accuracy,
        tables=tables,
        plane=plane,
        cycles=patch.cycles,
        transmission=plane.transmission(source.centre),
        law=patch_law(patch.grid, memory_limit=accuracy.memory_limit, single=single)
        if isinstance(patch.grid, PatchPlan)
        else response(patch.grid, single=single),
        half_patch=patch.half_side,
        per_pixel=patch.per_pixel,
        lit_within=lit_within,
    )


def refuse_large_spot(
    path: LightPath, source: DiscSource, nodes: SourceNodes, wavelength: float, legs: Legs, accuracy: ChainAccuracy
) -> None:
    """Refuse what `prepare_spot` could not hold in memory, before it computes anything.

    Raises
    ------
    UnaffordableError
        If the tables of the main-lens field, or the transfer behind a microlens, need more memory than allowed.
    """
    patch = _patch_of(path, source, nodes, wavelength, legs, accuracy)
    if isinstance(patch.grid, PatchPlan):
        refuse_large_patch(patch.grid, accuracy.memory_limit)
    if legs.to_array != "geometric":
        lit_within = math.inf if patch.whole_detector else _lit_within(path, source, nodes, wavelength, accuracy)
        wave = PupilWave(path=path, source=outermost(source, nodes), wavelength=wavelength, method=legs.to_array)
        refuse_large_tables(wave, _farthest_read(path, source, nodes, lit_within), accuracy)


def _patch_of(
    path: LightPath, source: DiscSource, nodes: SourceNodes, wavelength: float, legs: Legs, accuracy: ChainAccuracy
) -> DetectorPatch:
    reaches, paraxial = disc_ends(path, source, nodes), legs.to_detector == "fresnel"
    return detector_patch(path, source, reaches, wavelength=wavelength, paraxial=paraxial, accuracy=accuracy)


def _lit_within(
    path: LightPath, source: DiscSource, nodes: SourceNodes, wavelength: float, accuracy: ChainAccuracy
) -> float:
    """Distance from a chief ray within which microlenses are lit [m]."""
    ends = (source.centre, outermost(source, nodes))
    return max(lit_radius(path, point, wavelength, accuracy) for point in ends)


def tables_at(spot: Spot, at: list[Place]) -> dict[Place, FieldTable | None]:
    """Table of the main-lens field for each place; None for rays."""
    return dict.fromkeys(at) if spot.tables is None else dict(spot.tables.at(at))


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
        return light_on_pixels(intensity, spot.path.pixels, per_pixel=spot.per_pixel)[0] + self.far


def point_light(spot: Spot, at: Place, table: FieldTable | None) -> PointLight:
    """Follow the light of one source point from the array to the detector."""
    wave = spot.wave(*at)
    reach = ray_reach(spot.path, wave.source)
    if isinstance(spot.law, Response):
        return _light_of_all(spot, spot.law, wave, at, table, reach)
    rows, columns = (n * spot.per_pixel + 2 * MARGIN for n in spot.path.pixels.shape)
    single = spot.accuracy.tolerance >= SINGLE_PRECISION_FROM
    canvas = np.zeros((rows, columns), dtype=np.complex64 if single else np.complex128)
    far, power, carried = np.zeros(spot.path.pixels.shape), 0.0, 0.0
    for group in _lit_groups(spot, wave, at, table):
        rest = group.field
        if spot.legs.to_detector == "boundary_wave":
            spheres = split_spheres(spot.path, wave, which=group.which, cell=group.cell, field=group.field)
            rest = spheres.rest
            power += spheres.power
            carried += add_spheres(
                canvas,
                path=spot.path,
                wave=wave,
                spheres=spheres,
                reach=reach,
                half_patch=spot.half_patch,
                spacing=spot.spacing,
                accuracy=spot.accuracy,
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
    at: Place,
    table: FieldTable | None,
    reach: RayReach,
) -> PointLight:
    """Follow the light of all microlenses over the whole detector at once; none is lost beyond patches."""
    plane, lenses = spot.plane, spot.path.microlenses
    if isinstance(wave, RayWave):
        cells = [shadowed(lenses, plane.cell, wave.lit, index, spot.cycles) for index in range(lenses.count)]
        plane = replace(plane, cell=padded(cells))
        field, transmission = wave.field(*plane.positions), plane.transmission(wave.source)
    else:
        assert spot.tables is not None
        assert table is not None  # waves to the array need one
        field, transmission = spot.tables.field(at, table, *plane.positions), _transmission(spot, wave)
    canvas, handed_over = over_detector(
        plane,
        wave,
        field,
        transmission,
        to_detector=spot.legs.to_detector,
        response=response,
        reach=reach,
        half_side=spot.half_patch,
        accuracy=spot.accuracy,
        threads=1,
    )
    return PointLight(
        intensity=squared_magnitude(canvas) / wave.power(),
        far=np.zeros(spot.path.pixels.shape),
        handed_over=handed_over,
    )


@dataclass(frozen=True, kw_only=True)
class _Lit:
    """Microlenses that share their nodes, the field that arrives there, and the lenses' transmission."""

    which: IndexArray
    cell: CellNodes
    field: ComplexArray
    transmission: ComplexArray


def _farthest_read(path: LightPath, source: DiscSource, nodes: SourceNodes, lit_within: float) -> float:
    """Largest distance from a point's chief ray at which its field is read [m]: at lit microlenses, else the nearest.

    Points between the nodes, up to the rim of the disc, estimate the error.
    """
    lenses = path.microlenses
    on_array = float(np.max(np.linalg.norm(lenses.centres, axis=1))) + lenses.cell_reach
    anywhere = on_array + float(np.linalg.norm(nodes.all, axis=1).max()) * path.array_distance / source.distance
    if lit_within == math.inf:
        return anywhere
    turn = 2.0 * math.pi * np.arange(_RIM) / _RIM
    rim = source.diameter / 2.0 * np.column_stack([np.cos(turn), np.sin(turn)]) + [source.x, source.y]
    chief = -path.array_distance / source.distance * np.concatenate([nodes.all, rim])
    nearest, _ = cKDTree(lenses.centres).query(chief)
    return min(max(lit_within, float(np.max(nearest))) + lenses.cell_reach, anywhere)


def _lit_groups(spot: Spot, wave: PupilWave | RayWave, at: Place, table: FieldTable | None) -> Iterator[_Lit]:
    """Microlenses that light of a source point reaches; those that the edge of a shadow cuts come one by one."""
    lenses, plane = spot.path.microlenses, spot.plane
    if isinstance(wave, RayWave):
        share = lit_share(lenses, wave.lit)
        whole = np.flatnonzero(share == 1.0)
        for index in np.flatnonzero(share == 0.5):
            cell = shadowed(lenses, plane.cell, wave.lit, int(index), spot.cycles)
            if cell.x.size == 0:  # the edge passes between a corner of the aperture and the circle about it
                continue
            cut = replace(plane, path=replace(spot.path, microlenses=lenses.only(int(index))), cell=cell)
            yield _Lit(
                which=np.array([index]),
                cell=cell,
                field=wave.field(*cut.positions),
                transmission=cut.transmission(wave.source),
            )
    else:
        distance = np.linalg.norm(lenses.centres - wave.path.chief_point(wave.source), axis=1)
        whole = np.flatnonzero(distance <= max(spot.lit_within, float(distance.min())))
    x, y = (c[whole] for c in plane.positions)
    if spot.tables is None or table is None:
        field = wave.field(x, y) if isinstance(wave, RayWave) else None
    else:
        field = spot.tables.field(at, table, x, y)
    if whole.size and field is not None:
        yield _Lit(which=whole, cell=plane.cell, field=field, transmission=_transmission(spot, wave)[whole])


def _add_light(spot: Spot, law: PatchLaw, canvas: ComplexArray, reach: RayReach, lit: _Lit) -> FloatArray:
    """Add the light of some microlenses on their patches of the detector; return the light that leaves the patches."""
    origin = np.asarray(spot.path.pixels.corner) + (0.5 - MARGIN) * spot.spacing
    nearest = np.rint((reach.image[lit.which] - origin) / spot.spacing).astype(int)
    middles = origin + nearest * spot.spacing
    patches = patch_fields(
        law,
        x=lit.cell.x,
        y=lit.cell.y,
        strengths=(lit.field * lit.transmission).astype(canvas.dtype),
        middles=middles - spot.path.microlenses.centres[lit.which],
        tolerance=spot.accuracy.tolerance / 20,
    )
    _add_patches(canvas, patches, nearest - law.plan.half)
    sent = np.sum(squared_magnitude(lit.field) * lit.cell.weights, axis=-1)
    held = np.sum(squared_magnitude(patches), axis=(1, 2), dtype=np.float64) * spot.spacing**2
    half = law.plan.side * spot.spacing / 2
    # The law around a disc of rays assumes a round edge. Square apertures use the law of a point focus, which is their
    # mean far away.
    round_edge = spot.path.microlenses.aperture == "circular"
    radii = reach.spread[lit.which] if round_edge else np.zeros(lit.which.size)
    return far_light(spot.path.pixels, middles, half, np.maximum(sent - held, 0.0), radii)


def _transmission(spot: Spot, wave: PupilWave | RayWave) -> ComplexArray:
    """Phasors of the lenses; those of perfect lenses depend on the source."""
    if spot.path.microlenses.lens_phase == "perfect":
        return spot.plane.transmission(wave.source)
    return spot.transmission


def _add_patches(canvas: ComplexArray, patches: ComplexArray, first: IndexArray) -> None:
    """Add patches, whose first samples lie at given indices (x, y), to the canvas of the detector."""
    (rows, columns), side = canvas.shape, patches.shape[1]
    for patch, (j, i) in zip(patches, first, strict=True):
        y0, y1, x0, x1 = max(i, 0), min(i + side, rows), max(j, 0), min(j + side, columns)
        if y0 < y1 and x0 < x1:
            canvas[y0:y1, x0:x1] += patch[y0 - i : y1 - i, x0 - j : x1 - j]


def lights_of(spot: Spot, places: FloatArray) -> Iterator[PointLight]:
    """Follow source points, shape (n, 2), side by side; yielded one by one, so that few fine grids are held at once."""
    at = [(float(x), float(y)) for x, y in places]
    shared = tables_at(spot, at)
    with ThreadPoolExecutor(POINTS_AT_ONCE) as pool:
        yield from pool.map(lambda place: point_light(spot, place, shared[place]), at)


def mean_on_pixels(spot: Spot, part: Iterable[tuple[int, PointLight]]) -> tuple[FloatArray, float]:
    """Weighted mean of points on the pixels, and the error of its integration over them."""
    rows, columns = (n * spot.per_pixel + 2 * MARGIN for n in spot.path.pixels.shape)
    points, intensity, far = 0, np.zeros((rows, columns)), np.zeros(spot.path.pixels.shape)
    for n, light in part:
        points += n
        intensity += n * light.intensity
        far += n * light.far
    pixels, error = light_on_pixels(intensity / points, spot.path.pixels, per_pixel=spot.per_pixel)
    return pixels + far / points, error


_PREPARING = Lock()  # so that threads that begin together prepare a spot only once


@dataclass(frozen=True, kw_only=True, eq=False)
class AskedSpot:
    """Everything that a worker needs to prepare a spot by itself.

    Requests compare by identity; all copies of one request that reach another process become one object there.
    """

    path: LightPath
    source: DiscSource
    wavelength: float
    legs: Legs
    accuracy: ChainAccuracy

    def __reduce__(self) -> tuple[Any, ...]:
        return _received, (pickle.dumps({one.name: getattr(self, one.name) for one in fields(self)}),)

    def prepared(self) -> Spot:
        """Data shared by all points, kept for the latest request only: parts of one spot are computed in sequence."""
        with _PREPARING:
            return _prepared(self)


@lru_cache(maxsize=1)
def _received(content: bytes) -> AskedSpot:
    return AskedSpot(**pickle.loads(content))  # pickled by `AskedSpot.__reduce__`


@lru_cache(maxsize=1)
def _prepared(asked: AskedSpot) -> Spot:
    nodes = source_nodes(asked.path, asked.source, wavelength=asked.wavelength, density=source_density(asked.accuracy))
    return prepare_spot(asked.path, asked.source, nodes, asked.wavelength, asked.legs, asked.accuracy)


def forget_spot() -> None:
    """Free the tables of the spot that was prepared last."""
    _prepared.cache_clear()


def source_density(accuracy: ChainAccuracy) -> float:
    """Fraction of the cutoff to resolve: light near the cutoff is weak, and the pixel averages it away."""
    return accuracy.source_sampling * tolerated_density(accuracy)


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
    asked: AskedSpot, places: FloatArray, weights: tuple[int, ...], alone: tuple[int, ...] = ()
) -> FollowedPoints:
    """Follow weighted source points, shape (n, 2); `alone` lists those whose images are also returned separately."""
    spot = asked.prepared()
    images, handed = [], [spot.tables.handed_over if spot.tables else 0.0]

    def followed() -> Iterator[tuple[int, PointLight]]:
        for number, (weight, light) in enumerate(zip(weights, lights_of(spot, places), strict=True)):
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
