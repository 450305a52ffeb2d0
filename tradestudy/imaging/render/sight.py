"""The mean brightness that cones of rays see in a scene, and its depth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.light_cones import Exposure, LightCones, PerCone, Pose, Stop
from tradestudy.imaging.render.nodes import LEAST_NODES, LitPart, Nodes, equal_disc, lit_part, nodes, places_on_lens
from tradestudy.imaging.render.waves import Bending, LensWaves, Tables, Waves, paraxial_numbers
from tradestudy.imaging.scenes.pattern import GREY
from tradestudy.imaging.scenes.scene import Scene, SceneSource
from tradestudy.imaging.scenes.surfaces import Nearby
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.two_apertures import Stop as DiffractingStop
from tradestudy.optics.two_apertures import TwoApertures

REAL = np.float32
"""Precision of all computations along rays: 4 nm on the object at 150 mm."""
_DARK = 1e-7  # weight of a ray through a lens that passes no light


@dataclass(frozen=True, kw_only=True, eq=False)
class Sight:
    """What cones see.

    Parameters
    ----------
    brightness
        Mean over pixel and lit part of the lens, relative to the mean of the pattern, shape (cones,).
    depth
        Depth [m] along the camera's axis from its plane z = 0, on the middle ray of the lit part; infinite if that ray
        meets nothing.
    """

    brightness: FloatArray
    depth: FloatArray


def sight(
    scene: Scene,
    cones: LightCones,
    pose: Pose,
    nodes: Nodes,
    pixel_width: float,
    color: NDArray[np.intp] | int,
    tables: Tables | None = None,
) -> Sight:
    """Brightness and depth that every cone sees.

    Parameters
    ----------
    scene, cones, pose
        The scene, the cones of rays, and the pose of the camera.
    nodes
        Rays of each cone.
    pixel_width
        Side of the light-sensitive square of a pixel [m].
    color
        The colour of a coloured pattern that each cone sees; one number if it is the same for all.
    tables
        How diffraction bends the rays, with the same number of nodes; None without diffraction.
    """
    cones = _single(cones)
    if not cones.pixel.size:
        return Sight(brightness=np.zeros(0), depth=np.zeros(0))
    radius = cones.lens_radius
    middle = lit_part(cones, 0.0, 0.0)
    eta = (middle.low + np.maximum(middle.half, 0)) * middle.axis
    start, slope = _rays(cones, pose, 0.0, 0.0, eta)
    spread = _spread(scene, cones, pixel_width, tables)
    # One middle ray of each cone is followed all the way; where it goes tells all others where to begin.
    approached = [surface.approach(start, slope, spread) for surface in scene.surfaces]
    depth, _ = _nearest([depths for depths, _ in approached])
    nearby = [beside for _, beside in approached]
    along = _along_axis(pose, start, slope, depth)
    bending = None if tables is None else tables.bending(cones, _depth_beside(along))
    # For every pattern, the mixture of levels whose filter covers the area that one node represents.
    z = _finite(depth)
    by_pixel = (cones.start_by_pixel + z * cones.slope_by_pixel) * REAL(pixel_width)
    variance = np.square(by_pixel) * REAL(nodes.pixel_spread) + _lens_variance(cones, middle, depth, nodes, bending)
    mixtures = [
        pattern.mixture(variance * np.square(np.asarray(surface.pattern_scale(z), REAL)))
        for surface, pattern in zip(scene.surfaces, scene.patterns, strict=True)
    ]
    total, weights = np.zeros(cones.pixel.size, REAL), np.zeros(cones.pixel.size, REAL)
    for node, ((x, y), (across, beside)) in enumerate(zip(nodes.pixel * pixel_width, nodes.disc, strict=True)):
        lit = lit_part(cones, x, y)
        eta, weight = places_on_lens(lit, radius, across, beside)
        deflection = None
        if tables is not None and bending is not None:
            weight, deflection = tables.passed(cones, x, y) + REAL(_DARK), bending.deflection(node, x, y, eta)
        rays = _rays(cones, pose, x, y, eta, deflection)
        total += weight * _brightness(scene, *rays, nearby, mixtures, color)
        weights += weight
    # A mean: the lit area gives the amount of light more precisely than the sum of these weights.
    return Sight(brightness=(total / weights).astype(float), depth=along)


def _single(cones: LightCones) -> LightCones:
    """The cones in single precision, which suffices because places and slopes are relative to each cone."""

    def small(value: PerCone) -> PerCone:
        return np.asarray(value, REAL)

    stop = cones.stop
    return replace(
        cones,
        start=cones.start.astype(REAL),
        slope=cones.slope.astype(REAL),
        start_by_pixel=small(cones.start_by_pixel),
        start_by_lens=small(cones.start_by_lens),
        slope_by_pixel=small(cones.slope_by_pixel),
        slope_by_lens=small(cones.slope_by_lens),
        image_distance=small(cones.image_distance),
        stop=None
        if stop is None
        else Stop(
            place=stop.place.astype(REAL),
            by_pixel=small(stop.by_pixel),
            by_lens=small(stop.by_lens),
            radius=stop.radius,
        ),
    )


def _rays(
    cones: LightCones, pose: Pose, x: float, y: float, eta: FloatArray, deflection: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Rays in the scene through places on the pixels and on the lenses: positions at z = 0, and slopes."""
    start, slope = eta * cones.start_by_lens, eta * cones.slope_by_lens
    start += cones.start
    slope += cones.slope
    if deflection is not None:
        slope += deflection
    for axis, value in enumerate((x, y)):
        if value != 0.0:
            start[axis] += REAL(value) * cones.start_by_pixel
            slope[axis] += REAL(value) * cones.slope_by_pixel
    if pose == Pose():
        return start, slope
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = ([REAL(value) for value in row] for row in pose.rotation)
    u, v = slope
    ahead = REAL(1) / (zx * u + zy * v + zz)
    turned = np.stack([(xx * u + xy * v + xz) * ahead, (yx * u + yy * v + yz) * ahead])
    a, b = start
    z = zx * a + zy * b + REAL(pose.centre[2])
    origin = np.stack([xx * a + xy * b + REAL(pose.centre[0]), yx * a + yy * b + REAL(pose.centre[1])])
    return origin - z * turned, turned


def _along_axis(pose: Pose, start: FloatArray, slope: FloatArray, depth: FloatArray) -> FloatArray:
    """Depth along the camera's own axis."""
    if pose == Pose():
        return depth
    met = np.where(np.isfinite(depth), depth, 0)
    axis = [row[2] for row in pose.rotation]
    x, y = start + met * slope
    along = (x - pose.centre[0]) * axis[0] + (y - pose.centre[1]) * axis[1] + (met - pose.centre[2]) * axis[2]
    return np.where(np.isfinite(depth), along, depth)


def _nearest(depths: Sequence[FloatArray]) -> tuple[FloatArray, NDArray[np.intp] | int]:
    """Depth of the nearest of several surfaces, and which surface it is."""
    if len(depths) == 1:
        return depths[0], 0
    nearest, number = depths[0], np.zeros(depths[0].size, np.intp)
    for k, depth in enumerate(depths[1:], start=1):
        before = depth < nearest
        nearest, number = np.where(before, depth, nearest), np.where(before, k, number)
    return nearest, number


def _spread(scene: Scene, cones: LightCones, pixel_width: float, tables: Tables | None) -> float:
    """Largest distance of a cone's rays from its middle ray anywhere in the scene [m]."""
    ends = [end for surface in scene.surfaces for end in surface.extent]

    def widest(z: float) -> float:
        by_pixel = np.abs(cones.start_by_pixel + np.float32(z) * np.asarray(cones.slope_by_pixel))
        by_lens = np.abs(cones.start_by_lens + np.float32(z) * np.asarray(cones.slope_by_lens))
        by_rays = 2.0 * float(np.max(by_lens)) * cones.lens_radius
        bent = 0.0 if tables is None else tables.farthest(cones, z)
        return float(np.max(by_pixel)) * pixel_width * math.sqrt(0.5) + max(by_rays, bent)

    return max(widest(min(ends)), widest(max(ends)))


def _depth_beside(depth: FloatArray) -> FloatArray:
    """Depths, or their median where the middle ray meets nothing but other rays may meet the edge of a surface."""
    met = np.isfinite(depth)
    return np.where(met, depth, np.median(depth[met]) if met.any() else REAL(1)).astype(REAL)


def _finite(depth: FloatArray) -> FloatArray:
    """Depths, with an arbitrary value where rays meet nothing and see no pattern."""
    return np.where(np.isfinite(depth), depth, REAL(1))


def _lens_variance(
    cones: LightCones, lit: LitPart, depth: FloatArray, nodes: Nodes, bending: Bending | None
) -> FloatArray:
    """Variance [m²] in the scene, along one axis, due to the part of the lens that each node represents."""
    if bending is not None:
        return bending.filter_variance()
    by_lens = cones.start_by_lens + _finite(depth) * cones.slope_by_lens
    # A partly lit lens counts as a disc of about the same area.
    return np.asarray(np.square(by_lens) * equal_disc(lit, cones.lens_radius) * REAL(nodes.disc_spread))


Mixture = tuple[NDArray[np.intp], FloatArray]


def _brightness(
    scene: Scene,
    start: FloatArray,
    slope: FloatArray,
    nearby: Sequence[Nearby | None],
    mixtures: Sequence[Mixture],
    color: NDArray[np.intp] | int,
) -> FloatArray:
    """Brightness of what each ray meets first."""
    depths = [surface.depth(start, slope, beside) for surface, beside in zip(scene.surfaces, nearby, strict=True)]
    depth, number = _nearest(depths)
    met = np.isfinite(depth)
    if isinstance(number, int) and met.all():
        return _painted(scene, 0, start + depth * slope, depth, mixtures[0], color)
    brightness = np.full(depth.size, scene.background, REAL)
    for k in range(len(scene.surfaces)):
        rays = np.flatnonzero(met & (number == k))
        if rays.size:
            points = start[:, rays] + depth[rays] * slope[:, rays]
            level, share = mixtures[k]
            ray_color = color if isinstance(color, int) else color[rays]
            brightness[rays] = _painted(scene, k, points, depth[rays], (level[rays], share[rays]), ray_color)
    return np.asarray(brightness)


def _painted(
    scene: Scene, k: int, points: FloatArray, depth: FloatArray, mixture: Mixture, color: NDArray[np.intp] | int
) -> FloatArray:
    x, y = scene.surfaces[k].place(points, depth)
    return scene.patterns[k].brightness(x, y, *mixture, color)


_GRID: Final = 33  # pixels to sample along each side of a picture
_MORE: Final = 0.05  # relative margin on either side of the depths found


def waves_of(exposure: Exposure, scene: SceneSource, wavelength: float) -> Waves:
    """Set up rendering by waves for a picture of a scene [m], with one set of numbers for each type of lens.

    Errors and field curvature make lenses of one type differ. Their mean determines how light is bent; the numbers of
    each lens determine where it goes.
    """
    sensor = exposure.sensor
    x, y = (
        (np.linspace(0.0, size - 1.0, _GRID).round() + 0.5 - size / 2.0) * sensor.pixel_pitch
        for size in (sensor.columns, sensor.rows)
    )
    places = np.meshgrid(x, y)
    cones = exposure.cones(places[0].ravel(), places[1].ravel())
    depth = sight(scene.build(), cones, exposure.pose, nodes(LEAST_NODES), sensor.pixel_pitch, GREY).depth
    depths = depth[np.isfinite(depth)]
    near, far = (float(np.min(depths)), float(np.max(depths))) if depths.size else scene.extent
    ends = np.array([near, far]) * np.array([1.0 - _MORE, 1.0 + _MORE])
    lenses, bent = [], 0.0
    types = np.broadcast_to(cones.lens_type, cones.pixel.shape)
    for lens_type in range(int(np.max(types)) + 1):
        of_type = cones.only(np.flatnonzero(types == lens_type))
        apertures = _apertures(of_type, wavelength)
        curvature = np.array([float(np.mean(paraxial_numbers(of_type, end)[2])) for end in ends])
        waves = np.sort((curvature - apertures.focused_curvature) * apertures.waves_per_curvature)
        lens = LensWaves(apertures=apertures, defocus=(float(waves[0]), float(waves[-1])))
        lenses.append(lens)
        if (stop := of_type.stop) is not None:
            bent = max(bent, lens.margin / abs(float(np.mean(stop.by_pixel))))
    return Waves(lenses=tuple(lenses), beyond=bent)


def _apertures(cones: LightCones, wavelength: float) -> TwoApertures:
    if (stop := cones.stop) is None:
        return TwoApertures(wavelength=wavelength, radius=cones.lens_radius)
    reach = float(np.mean(-np.asarray(cones.image_distance) * stop.by_pixel))
    diffracting = DiffractingStop(scale=float(np.mean(stop.by_lens)), reach=reach, radius=stop.radius)
    return TwoApertures(wavelength=wavelength, radius=cones.lens_radius, stop=diffracting)
