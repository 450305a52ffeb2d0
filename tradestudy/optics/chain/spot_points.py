"""One point of a spot: what all its points share, and the light of one of them on small detector patches.

What is shared is computed once: the main-lens field at a few distances of the source from the axis (it turns with the
source, and is interpolated in between), the nodes of a microlens, the transfer to the detector. Behind each microlens
the light is followed on a patch about its ray image only; patches of one source point add as fields.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tradestudy.errors import UnaffordableError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy
from tradestudy.optics.chain.array_field import FieldTable, PupilWave, blended, fast_phase, field_table
from tradestudy.optics.chain.detector_transfer import (
    Response,
    Transfer,
    choose_transfer,
    half_band,
    propagate,
    response,
)
from tradestudy.optics.chain.microlens_plane import MicrolensPlane, microlens_plane
from tradestudy.optics.chain.pixels import samples_per_pixel
from tradestudy.optics.chain.point_image import field_spacing
from tradestudy.optics.chain.rays import RayReach, blur_radius, ray_reach
from tradestudy.optics.chain.scene import LightPath
from tradestudy.optics.chain.sources import DiscSource, SourceNodes
from tradestudy.optics.propagation.direct import ComplexArray, unit_phasor
from tradestudy.optics.propagation.lens import PointSource

_MARGIN = 3
SINGLE_PRECISION_FROM = 1e-3  # tolerance above which 32-bit floats add nothing to the error


@dataclass(frozen=True, kw_only=True)
class Spot:
    """What all source points share."""

    path: LightPath
    source: DiscSource
    wavelength: float
    paraxial: tuple[bool, bool]
    accuracy: ChainAccuracy
    radii: FloatArray
    tables: list[FieldTable]
    plane: MicrolensPlane
    transmission: ComplexArray
    response: Response
    half_patch: float
    per_pixel: int
    lit_within: float

    @property
    def spacing(self) -> float:
        """Distance of detector samples [m]."""
        return self.path.pixels.pitch / self.per_pixel

    def wave(self, x: float, y: float) -> PupilWave:
        """Wave of one source point."""
        return PupilWave(
            path=self.path,
            source=PointSource(x=x, y=y, distance=self.source.distance),
            wavelength=self.wavelength,
            paraxial=self.paraxial[0],
        )


def prepare_spot(
    path: LightPath,
    source: DiscSource,
    nodes: SourceNodes,
    wavelength: float,
    paraxial: tuple[bool, bool],
    accuracy: ChainAccuracy,
) -> Spot:
    """Choose every grid from the geometry of centre and rim of the disc, and compute the tables."""
    lenses = path.microlenses
    distance = np.linalg.norm(nodes.all, axis=1)
    outer = outermost(source, nodes)
    reaches = [ray_reach(path, point) for point in (source.centre, outer)]
    patch = detector_patch(path, reaches, wavelength, paraxial[1], accuracy)
    plane = microlens_plane(
        path,
        reaches[1],
        wavelength=wavelength,
        paraxial=paraxial[1],
        target_reach=patch.half_side,
        density=accuracy.microlens_nodes,
    )
    lit_within = max(lit_radius(path, point, wavelength, accuracy) for point in (source.centre, outer))
    radii, tables = _tables(path, source, distance, wavelength, paraxial[0], accuracy, lit_within + lenses.cell_reach)
    transmission = plane.transmission(source.centre)
    return Spot(
        path=path,
        source=source,
        wavelength=wavelength,
        paraxial=paraxial,
        accuracy=accuracy,
        radii=radii,
        tables=tables,
        plane=plane,
        transmission=transmission,
        response=response(
            patch.transfer,
            largest_carrier=patch.tilt / wavelength + patch.transfer.frequency_step,
            single=accuracy.tolerance >= SINGLE_PRECISION_FROM,
        ),
        half_patch=patch.half_side,
        per_pixel=patch.per_pixel,
        lit_within=lit_within,
    )


@dataclass(frozen=True, kw_only=True)
class DetectorPatch:
    """The part of the detector behind one microlens that light of one source point is followed on."""

    half_side: float
    per_pixel: int
    tilt: float
    transfer: Transfer


def outermost(source: DiscSource, nodes: SourceNodes) -> PointSource:
    """The node that is farthest from the axis."""
    edge = nodes.all[np.argmax(np.linalg.norm(nodes.all, axis=1))]
    return PointSource(x=float(edge[0]), y=float(edge[1]), distance=source.distance)


def detector_patch(
    path: LightPath, reaches: list[RayReach], wavelength: float, paraxial: bool, accuracy: ChainAccuracy
) -> DetectorPatch:
    """Patch, samples and transfer that hold the light of all points, from the rays of centre and rim of the disc."""
    margin = accuracy.fresnel_lengths * math.sqrt(wavelength * path.detector_distance)
    half = max(float(one.spread.max()) for one in reaches) + margin
    node_reach = path.microlenses.cell_reach
    kept = node_reach + half
    band = half_band(wavelength, path.detector_distance, kept, paraxial=paraxial, tolerance=accuracy.tolerance)
    per_pixel = samples_per_pixel(path.pixels, accuracy.pixel_sampling * 2 * band * path.pixels.pitch)
    spacing = path.pixels.pitch / per_pixel
    tilt = _steepest(reaches[0], reaches[1])
    transfer = choose_transfer(
        wavelength=wavelength,
        distance=path.detector_distance,
        paraxial=paraxial,
        node_reach=node_reach,
        target_reach=half + spacing,
        kept_reach=kept,
        spacing=spacing,
        tilt=tilt,
        tolerance=accuracy.tolerance,
    )
    return DetectorPatch(half_side=half, per_pixel=per_pixel, tilt=tilt, transfer=transfer)


def lit_radius(path: LightPath, point: PointSource, wavelength: float, accuracy: ChainAccuracy) -> float:
    """Radius about the chief ray of a point within which its light may reach the middle of a microlens [m]."""
    depth = abs(path.image_at_array(point)[2])
    beyond = accuracy.fresnel_lengths * math.sqrt(wavelength * max(depth, path.detector_distance))
    return blur_radius(path, point) + beyond + path.microlenses.cell_reach


def table_count(accuracy: ChainAccuracy) -> int:
    """Distances from the axis at which the main-lens field is computed, to be interpolated in between."""
    return max(2, math.ceil(4 * accuracy.source_sampling * math.pow(1e-2 / accuracy.tolerance, 1 / 6)))


def _steepest(centre: RayReach, rim: RayReach) -> float:
    """Largest slope at the middle of any microlens: the disc's centre's, and as much more as any point of its rim's.

    The rim point that was traced may lie across the direction of a microlens, and another one along it.
    """
    added = np.linalg.norm(rim.slope - centre.slope, axis=1).max()
    return float(np.linalg.norm(centre.slope, axis=1).max() + added)


def _tables(
    path: LightPath,
    source: DiscSource,
    distance: FloatArray,
    wavelength: float,
    paraxial: bool,
    accuracy: ChainAccuracy,
    half_width: float,
) -> tuple[FloatArray, list[FieldTable]]:
    """Main-lens field for sources on the x axis at Chebyshev points of the distances that occur."""
    low, high = float(distance.min()), float(distance.max())
    count = table_count(accuracy)
    radii = (low + high) / 2 - (high - low) / 2 * np.cos(math.pi * (np.arange(count) + 0.5) / count)
    lenses = path.microlenses
    half = min(half_width, float(np.max(np.linalg.norm(lenses.centres, axis=1))) + lenses.cell_reach
               + high * path.array_distance / source.distance)  # fmt: skip
    tables: list[FieldTable] = []
    for radius in radii:
        wave = PupilWave(
            path=path,
            source=PointSource(x=float(radius), distance=source.distance),
            wavelength=wavelength,
            paraxial=paraxial,
        )
        spacing = field_spacing(wave, accuracy) if not tables else tables[0].spacing
        needed = 16.0 * count * (2 * half / spacing) ** 2
        if needed > accuracy.memory_limit:
            raise UnaffordableError(
                "tables of the main-lens field",
                value=f"{count} of {2 * half / spacing:.0f}² points, {needed / 1e9:.1f} GB",
                limit=f"{accuracy.memory_limit / 1e9:.1f} GB",
                remedy="lower field_sampling, or raise the memory limit",
            )
        tables.append(
            field_table(
                wave,
                low=(-half, -half),
                high=(half, half),
                spacing=spacing,
                node_density=accuracy.pupil_nodes,
                tolerance=min(accuracy.tolerance / 4, 1e-3),
                memory_limit=accuracy.memory_limit,
            )
        )
    return radii, tables


def tables_at(spot: Spot, at: list[tuple[float, float]]) -> dict[tuple[float, float], FieldTable]:
    """Table at the distance of each point; one blend where points share their distance."""
    blends: dict[int, FieldTable] = {}
    result = {}
    for point in at:
        radius = math.hypot(*point)
        key = round(radius * 1e12)
        if key not in blends:
            blends[key] = blended(spot.tables, _lagrange(spot.radii, radius))
        result[point] = blends[key]
    return result


def point_intensity(spot: Spot, at: tuple[float, float], table: FieldTable) -> FloatArray:
    """Intensity of one source point on the fine grid of the detector, as a share of its power through the pupil."""
    wave = spot.wave(*at)
    reach = ray_reach(spot.path, wave.source)
    lit = _lit(spot, wave)
    strengths = _arriving(spot, wave, table, lit) * _transmission(spot, wave)[lit]
    lenses, cell, transfer = spot.path.microlenses, spot.plane.cell, spot.response.transfer
    slope = reach.slope[lit]
    sine = slope if spot.paraxial[1] else slope / np.sqrt(1 + np.sum(slope**2, axis=1, keepdims=True))
    steps = np.rint(sine / (spot.wavelength * transfer.frequency_step)).astype(int)
    frequency = transfer.frequency_step * steps
    carrier = unit_phasor(-2 * np.pi * (frequency[:, :1] * cell.x + frequency[:, 1:] * cell.y))
    kind = np.complex64 if spot.accuracy.tolerance >= SINGLE_PRECISION_FROM else np.complex128
    first, start = _patch_starts(spot, reach, lit)
    side = 2 * math.ceil(spot.half_patch / spot.spacing) + 1
    patches = propagate(
        transfer,
        x=cell.x,
        y=cell.y,
        strengths=(strengths * carrier).astype(kind),
        response=spot.response,
        carriers=steps,
        start=start,
        shape=(side, side),
        tolerance=spot.accuracy.tolerance / 20,
        threads=1,
    )
    canvas = _added(spot, patches, first, frequency, lenses.centres[lit])
    return np.asarray(np.abs(canvas) ** 2 / wave.power())


def _lit(spot: Spot, wave: PupilWave) -> np.ndarray[tuple[int, ...], np.dtype[np.int_]]:
    """Microlenses that noticeable light can reach; at least the nearest."""
    distance = np.linalg.norm(spot.path.microlenses.centres - wave.path.chief_point(wave.source), axis=1)
    return np.flatnonzero(distance <= max(spot.lit_within, float(distance.min())))


def _arriving(
    spot: Spot, wave: PupilWave, table: FieldTable, lit: np.ndarray[tuple[int, ...], np.dtype[np.int_]]
) -> ComplexArray:
    """Main-lens field on the nodes of the lit microlenses: the table's, turned to the azimuth of the source."""
    x, y = (c[lit] for c in spot.plane.positions)
    radius = math.hypot(wave.source.x, wave.source.y)
    cosine, sine = (wave.source.x / radius, wave.source.y / radius) if radius > 0 else (1.0, 0.0)
    turned = spot.wave(radius, 0.0)
    along, across = cosine * x + sine * y, cosine * y - sine * x
    chief = turned.path.chief_point(turned.source)
    return table.slow_part(along - chief[0], across) * unit_phasor(fast_phase(turned, along, across))


def _transmission(spot: Spot, wave: PupilWave) -> ComplexArray:
    """Phasors of the lenses; perfect ones follow the source."""
    if spot.path.microlenses.lens_phase == "perfect":
        return spot.plane.transmission(wave.source)
    return spot.transmission


def _patch_starts(
    spot: Spot, reach: RayReach, lit: np.ndarray[tuple[int, ...], np.dtype[np.int_]]
) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.int_]], FloatArray]:
    """Canvas index (x, y) of each patch's first sample, and its position relative to its microlens."""
    origin = np.asarray(spot.path.pixels.corner) + (0.5 - _MARGIN) * spot.spacing
    half = math.ceil(spot.half_patch / spot.spacing)
    first = np.round((reach.image[lit] - origin) / spot.spacing).astype(int) - half
    return first, origin + first * spot.spacing - spot.path.microlenses.centres[lit]


def _added(
    spot: Spot,
    patches: ComplexArray,
    first: np.ndarray[tuple[int, ...], np.dtype[np.int_]],
    carrier: FloatArray,
    centres: FloatArray,
) -> ComplexArray:
    """Fields of all patches, each over its carrier, added on the canvas of the detector."""
    rows, columns = (n * spot.per_pixel + 2 * _MARGIN for n in spot.path.pixels.shape)
    origin = np.asarray(spot.path.pixels.corner) + (0.5 - _MARGIN) * spot.spacing
    canvas = np.zeros((rows, columns), dtype=patches.dtype)
    side = patches.shape[1]
    for patch, (j, i), (fx, fy), (cx, cy) in zip(patches, first, carrier, centres, strict=True):
        y0, y1, x0, x1 = max(i, 0), min(i + side, rows), max(j, 0), min(j + side, columns)
        if y0 >= y1 or x0 >= x1:
            continue
        x = origin[0] + spot.spacing * np.arange(x0, x1) - cx
        y = origin[1] + spot.spacing * np.arange(y0, y1) - cy
        wave_x = unit_phasor(2 * np.pi * fx * x).astype(patches.dtype)
        wave_y = unit_phasor(2 * np.pi * fy * y).astype(patches.dtype)
        canvas[y0:y1, x0:x1] += patch[y0 - i : y1 - i, x0 - j : x1 - j] * wave_y[:, None] * wave_x
    return canvas


def _lagrange(points: FloatArray, at: float) -> FloatArray:
    """Weights that interpolate a polynomial through the points."""
    difference = points[:, None] - points + np.eye(points.size)
    factors = np.where(np.eye(points.size, dtype=bool), 1.0, (at - points) / difference)
    return np.asarray(factors.prod(axis=1))
