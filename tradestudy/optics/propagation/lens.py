"""A point source and a thin circular lens: the wave that leaves the lens plane."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.propagation.paths import Array, ParabolicPath, PathSum, SphericalPath

LensPhase = Literal["parabolic", "stigmatic", "perfect"]
LENS_PHASES: tuple[LensPhase, ...] = ("parabolic", "stigmatic", "perfect")
Obliquity = Literal["paper", "textbook", "rayleigh-sommerfeld-1"]
OBLIQUITIES: tuple[Obliquity, ...] = ("paper", "textbook", "rayleigh-sommerfeld-1")


@dataclass(frozen=True, kw_only=True)
class PointSource:
    """A monochromatic point of unit strength before a lens, or a virtual one behind it.

    Parameters
    ----------
    x, y
        Transverse position [m], in the same axes as the centre of the lens.
    distance
        Distance before the lens plane [m]; < 0: light that converges to a point behind the lens plane.

    Raises
    ------
    OutOfRangeError
        The distance is zero, or a coordinate is not finite.
    """

    x: float = 0.0
    y: float = 0.0
    distance: float

    def __post_init__(self) -> None:
        if not all(math.isfinite(v) for v in (self.x, self.y, self.distance)) or self.distance == 0.0:
            raise OutOfRangeError(
                "position of the point source",
                value=f"x = {self.x:g} m, y = {self.y:g} m, distance = {self.distance:g} m",
                limit="finite, distance ≠ 0",
                remedy="for a source at infinity use a large finite distance (paths are exact at 1e8 m)",
            )


@dataclass(frozen=True, kw_only=True)
class CircularLens:
    """A thin lens filling a circular aperture.

    Parameters
    ----------
    radius
        Radius of the aperture [m], > 0.
    focal_length
        Focal length [m], ≠ 0; < 0 diverges.
    lens_phase
        ``parabolic``: −π r²/(λ f), the paper's lens; with exact paths it has the spherical aberration
        r⁴/8 (1/a³ + 1/b³). ``stigmatic``: a fixed element that cancels the exact paths between its vertex normal's
        point at `focus_distance` and that point's image; off axis it has coma. ``perfect``: sends every source point
        exactly to its thin-lens image, as a well-corrected objective does.
    focus_distance
        Object distance [m] for which a stigmatic lens is exact; required for it, forbidden for the others.
    centre
        Centre of the aperture and vertex of the lens [m].

    Raises
    ------
    OutOfRangeError
        A length is out of range, or `focus_distance` is missing or has no meaning.
    """

    radius: float
    focal_length: float
    lens_phase: LensPhase
    focus_distance: float | None = None
    centre: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if self.lens_phase not in LENS_PHASES:
            raise OutOfRangeError("lens_phase", value=repr(self.lens_phase), limit=" | ".join(LENS_PHASES))
        if not (math.isfinite(self.radius) and self.radius > 0):
            raise OutOfRangeError("radius of the lens", value=f"{self.radius:g} m", limit="> 0, finite")
        if not math.isfinite(self.focal_length) or self.focal_length == 0:
            raise OutOfRangeError("focal_length", value=f"{self.focal_length:g} m", limit="≠ 0, finite")
        if (self.focus_distance is not None) != (self.lens_phase == "stigmatic"):
            raise OutOfRangeError(
                f"focus_distance of a {self.lens_phase} lens",
                value=str(self.focus_distance),
                limit="a distance for a stigmatic lens, none for the others",
                remedy="give the object distance for which the stigmatic element is made, or choose another phase",
            )

    def image_of(self, source: PointSource) -> tuple[float, float, float]:
        """Thin-lens image of a point: x, y [m] and its distance behind the lens [m] (< 0: virtual).

        Raises
        ------
        OutOfRangeError
            The image lies at infinity.
        """
        b = finite_image_distance(source.distance, self.focal_length)
        scale = -b / source.distance
        cx, cy = self.centre
        return cx + scale * (source.x - cx), cy + scale * (source.y - cy), b


def finite_image_distance(object_distance: float, focal_length: float) -> float:
    """Thin-lens image distance b = a f/(a − f) [m]; refuses an image at infinity."""
    if object_distance == focal_length:
        raise OutOfRangeError(
            "image of a point in the focal plane",
            value=f"object at {object_distance:g} m, focal length {focal_length:g} m",
            limit="object_distance ≠ focal_length",
            remedy="move the point off the focal plane, or use the parabolic lens",
        )
    return object_distance * focal_length / (object_distance - focal_length)


def lens_paths(source: PointSource, lens: CircularLens, *, paraxial: bool) -> PathSum:
    """Path behind the lens, source leg and lens together, relative to the vertex, in lens coordinates.

    `paraxial` takes every conjugate path to second order, as Fresnel does; the three lens phases are then one.
    """
    x, y = source.x - lens.centre[0], source.y - lens.centre[1]
    if paraxial:
        incoming = ParabolicPath(x=x, y=y, distance=source.distance)
        return PathSum(terms=(incoming, ParabolicPath(x=0.0, y=0.0, distance=-lens.focal_length)))
    if lens.lens_phase == "perfect":
        # The lens takes the exact path from the source away and adds the one to the image: only the latter is left.
        image_x, image_y, b = lens.image_of(source)
        return PathSum(terms=(SphericalPath(x=image_x - lens.centre[0], y=image_y - lens.centre[1], distance=-b),))
    spherical = SphericalPath(x=x, y=y, distance=source.distance)
    if lens.lens_phase == "parabolic":
        return PathSum(terms=(spherical, ParabolicPath(x=0.0, y=0.0, distance=-lens.focal_length)))
    assert lens.focus_distance is not None  # guaranteed by CircularLens
    focus = lens.focus_distance
    cancelled = SphericalPath(x=0.0, y=0.0, distance=focus, weight=-1.0)
    added = SphericalPath(x=0.0, y=0.0, distance=-finite_image_distance(focus, lens.focal_length))
    return PathSum(terms=(spherical, cancelled, added))


@dataclass(frozen=True, kw_only=True)
class LensWave:
    """The wave of a point source directly behind a lens, U(q) = amplitude(q) exp(i k path(q)).

    Coordinates are relative to the centre of the lens. The constant phase of the lens, n Δ, is left out: it drops
    out of every intensity.
    """

    source: PointSource
    lens: CircularLens
    wavelength: float
    paraxial: bool
    obliquity: Obliquity

    @property
    def wavenumber(self) -> float:
        """2π/λ [rad/m]."""
        return 2.0 * math.pi / self.wavelength

    @cached_property
    def paths(self) -> PathSum:
        """Path behind the lens relative to the vertex."""
        return lens_paths(self.source, self.lens, paraxial=self.paraxial)

    def amplitude(self, x: Array, y: Array) -> Array:
        """Slowly varying complex amplitude [1/m²] of a unit point.

        Paper's law (eq. 10): a/(iλ r²); textbook: 1/(iλ r), the free spherical wave; full Rayleigh–Sommerfeld I:
        a/(iλ r²) (1 + i/(k r)); Fresnel (eq. 18): 1/(iλ a).
        """
        a = self.source.distance
        along_x, along_y = self.source.x - self.lens.centre[0], self.source.y - self.lens.centre[1]
        if self.paraxial:
            squared = along_x**2 + along_y**2
            vertex = self._phasor(abs(a) + squared / (2 * abs(a)))
            return np.full(np.broadcast(x, y).shape, vertex / (1j * self.wavelength * a))
        r = np.sqrt(a**2 + (x - along_x) ** 2 + (y - along_y) ** 2)
        vertex = self._phasor(math.hypot(a, along_x, along_y)) / (1j * self.wavelength)
        if self.obliquity == "textbook":
            return np.asarray(math.copysign(1.0, a) * vertex / r)
        if self.obliquity == "paper":
            return np.asarray(a * vertex / r**2)
        return np.asarray(a * vertex / r**2 * (1 + 1j * math.copysign(1.0, a) / (self.wavenumber * r)))

    def field(self, x: Array, y: Array) -> Array:
        """Complex field behind the lens at points of its plane."""
        return np.asarray(self.amplitude(x, y) * np.exp(1j * self.wavenumber * self.paths.value(x, y)))

    def axial_cosine(self, x: Array, y: Array) -> Array:
        """Cosine between the wave's direction and the axis.

        Raises
        ------
        OutOfRangeError
            The phase of the lens is steeper than any propagating wave.
        """
        p_x, p_y = self.paths.slope(x, y)
        transverse = p_x**2 + p_y**2
        if np.max(np.abs(transverse)) >= 1.0:
            raise OutOfRangeError(
                "slope of the phase behind the lens",
                value=f"sine {math.sqrt(float(np.max(np.abs(transverse)))):.3g}",
                limit="< 1",
                remedy="use a smaller aperture, a perfect lens phase, or obliquity 'paper'",
            )
        return np.asarray(np.sqrt(1.0 - transverse))

    def _phasor(self, path: float) -> complex:
        """exp(±i k path): a converging wave runs backwards to its centre."""
        return complex(np.exp(1j * math.copysign(self.wavenumber * path, self.source.distance)))
