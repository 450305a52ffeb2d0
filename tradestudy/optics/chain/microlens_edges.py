"""Boundary waves behind the array: the spherical part of a microlens's light as rays and a wave from its edge.

The light of a microlens is split into the best-fitting sphere about the main lens's image and the rest, which is zero
if rays brought the light. The sphere has closed forms; the rest is left to Kirchhoff's integral. So is all light of
microlenses that the shadow of the pupil cuts, since no single edge surrounds it, and of those whose rays meet or cross
on the detector.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import ComplexArray, IndexArray, unit_phasor
from tradestudy.optics.chain.accuracy import MARGIN, ChainAccuracy
from tradestudy.optics.chain.array_field import PupilWave, looser_for_edges
from tradestudy.optics.chain.arriving_light import RayReach, RayWave, blur_radius
from tradestudy.optics.chain.microlens_nodes import CellNodes, Disc, lit_share
from tradestudy.optics.chain.scene import LightPath, Microlenses
from tradestudy.optics.propagation.boundary_wave import one_ray_per_target
from tradestudy.optics.propagation.hybrid import LEAST_ZONES, unchecked_hybrid_field
from tradestudy.optics.propagation.kernels import KirchhoffKernel
from tradestudy.optics.propagation.lens import LensWave
from tradestudy.optics.propagation.paths import Array, SphericalPath
from tradestudy.optics.propagation.sampling import Limits
from tradestudy.optics.propagation.targets import TargetGrid


class _EvenWave(LensWave):
    """Spherical wave through a microlens, of amplitude 1 at every point."""

    def amplitude(self, x: Array, y: Array) -> Array:
        """Return 1."""
        return np.ones(np.broadcast(x, y).shape, dtype=np.complex128)


@dataclass(frozen=True, kw_only=True)
class Spheres:
    """Light of microlenses, split into spheres about one point and the rest.

    Attributes
    ----------
    which
        Microlenses whose sphere is propagated.
    strength
        Field of each sphere at the vertex of its microlens, shape (which,).
    rest
        Field on the nodes minus the spheres.
    power
        ∫ |U|² over the nodes.
    """

    which: IndexArray
    strength: ComplexArray
    rest: ComplexArray
    power: float


def refuse_square_edges(lenses: Microlenses) -> None:
    """Refuse apertures whose edge is not a circle.

    Raises
    ------
    OutOfRangeError
        If the aperture is square.
    """
    if lenses.aperture != "circular":
        raise OutOfRangeError(
            "boundary wave behind the microlenses",
            value=f"{lenses.aperture} apertures",
            limit="circular apertures",
            remedy="use kirchhoff to the detector, which is the same integral",
        )


def split_spheres(
    path: LightPath, wave: PupilWave | RayWave, *, which: IndexArray, cell: CellNodes, field: ComplexArray
) -> Spheres:
    """Subtract the sphere of the source's image from the field, by least squares over each microlens.

    Parameters
    ----------
    path, wave
        Camera, and the wave of one source point.
    which
        Microlenses, shape (n,).
    cell
        Their nodes, shape (nodes,) or (n, nodes).
    field
        Field on the nodes, shape (n, nodes).
    """
    x, y = path.chief_point(wave.source)
    shadow = Disc(x=x, y=y, radius=blur_radius(path, wave.source))
    lit = np.flatnonzero(lit_share(path.microlenses, shadow)[which] == 1.0)
    rows = [row for row in lit if _has_rays(path, _through(path, wave, int(which[row])))]
    rest = field.copy()
    strength = np.zeros(len(rows), dtype=np.complex128)
    for n, row in enumerate(rows):
        u, v, weights, in_lens = (c[row] if c.ndim > 1 else c for c in (cell.x, cell.y, cell.weights, cell.in_lens))
        centre = path.object_before(int(which[row]), wave.source)
        arriving = SphericalPath(x=centre.x, y=centre.y, distance=centre.distance)
        sphere = np.where(in_lens, unit_phasor(2 * math.pi / wave.wavelength * arriving.value(u, v)), 0.0)
        strength[n] = np.sum(weights * np.conj(sphere) * field[row]) / np.sum(weights * in_lens)
        rest[row] = 0.0 if isinstance(wave, RayWave) and in_lens.all() else field[row] - strength[n] * sphere
    power = float(np.sum(np.abs(field) ** 2 * cell.weights))
    return Spheres(which=which[rows], strength=strength, rest=rest, power=power)


def _through(path: LightPath, wave: PupilWave | RayWave, index: int) -> _EvenWave:
    """Sphere of the source's image behind a microlens."""
    return _EvenWave(
        source=path.object_before(index, wave.source),
        lens=path.microlenses.lens(index),
        wavelength=wave.wavelength,
        paraxial=False,
        obliquity="paper",
    )


def _has_rays(path: LightPath, through: _EvenWave) -> bool:
    """Whether the detector lies out of focus behind a microlens, and one ray leads to each of its points."""
    lens, b = through.lens, path.detector_distance
    defocus = abs(1 / through.source.distance + 1 / b - 1 / lens.focal_length)
    zones = lens.radius**2 / through.wavelength * defocus
    return zones >= LEAST_ZONES and one_ray_per_target(through, np.array([b]))


def add_spheres(
    canvas: ComplexArray,
    *,
    path: LightPath,
    wave: PupilWave | RayWave,
    spheres: Spheres,
    reach: RayReach,
    half_patch: float,
    spacing: float,
    accuracy: ChainAccuracy,
) -> float:
    """Add rays and boundary wave of every sphere to the samples on the detector, around where its rays land.

    Parameters
    ----------
    canvas
        Field on a grid of the detector without its constant phase, as in `detector_transfer.response`; changed in
        place.
    path, wave
        Camera, and the wave of one source point.
    spheres
        Spheres to propagate.
    reach
        Where rays land.
    half_patch
        Distance from there within which light is followed, along x and y [m].
    spacing
        Distance between samples [m]; the grid extends `MARGIN` samples beyond the pixels on every side.
    accuracy
        Tolerance of the image, and memory.

    Returns
    -------
    float
        Power of the spheres, minus that of points where rays are singular: these are left to Kirchhoff's integral.

    Raises
    ------
    NotConvergedError
        If Kirchhoff's integral misses the tolerance there.
    """
    start = np.asarray(path.pixels.corner) + (0.5 - MARGIN) * spacing
    vertex = unit_phasor(np.array(-2 * math.pi / wave.wavelength * path.detector_distance))
    carried = 0.0
    for index, strength in zip(spheres.which.tolist(), spheres.strength, strict=True):
        centre, middle = path.microlenses.centres[index], reach.image[index]
        low = np.maximum(np.ceil((middle - half_patch - start) / spacing), 0).astype(int)
        high = np.minimum(np.floor((middle + half_patch - start) / spacing) + 1, canvas.shape[::-1]).astype(int)
        power = math.pi / 4 * path.microlenses.aperture_width**2 * float(np.abs(strength) ** 2)
        if np.any(high <= low):
            carried += power
            continue
        first = start + low * spacing - centre
        done = unchecked_hybrid_field(
            wave=_through(path, wave, index),
            kernel=KirchhoffKernel(wavelength=wave.wavelength, obliquity="paper"),
            targets=TargetGrid(
                x_start=float(first[0]),
                y_start=float(first[1]),
                x_pitch=spacing,
                y_pitch=spacing,
                x_count=int(high[0] - low[0]),
                y_count=int(high[1] - low[1]),
                distance=path.detector_distance,
            ),
            tolerance=looser_for_edges(accuracy.tolerance),
            limits=Limits(memory_bytes=accuracy.memory_limit),
        )
        canvas[low[1] : high[1], low[0] : high[0]] += strength * vertex * done.field
        carried += power * (1.0 - done.handed_over)
    return carried
