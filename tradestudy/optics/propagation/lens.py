"""A point source and a thin circular lens: the wave that leaves the lens plane, and focal lengths as a table."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arguments import checked
from tradestudy.optics.arrays import FloatArray, unit_phasor
from tradestudy.optics.propagation.paths import Array, ParabolicPath, PathSum, PathTerm, SphericalPath
from tradestudy.optics.propagation.pupil import Pupil, checked_map
from tradestudy.optics.quadrature import QuadratureNodes, disc_nodes

LensPhase = Literal["parabolic", "stigmatic", "perfect"]
LENS_PHASES: tuple[LensPhase, ...] = ("parabolic", "stigmatic", "perfect")
Obliquity = Literal["paper", "textbook", "rayleigh-sommerfeld-1"]
OBLIQUITIES: tuple[Obliquity, ...] = ("paper", "textbook", "rayleigh-sommerfeld-1")
# As good as infinity: over an aperture of a metre its sphere departs from a plane by 1e-16 m, the limit of doubles.
AS_AT_INFINITY = 1e15
_AMPLITUDE_ERROR = 1e-14  # relative, of the quadrature of amplitudes
_MOST_RINGS = 400  # enough for a pupil 100 times as wide as its distance, to 1e-7


def check_obliquity(obliquity: str) -> None:
    """Refuse an unknown obliquity.

    Raises
    ------
    OutOfRangeError
        If it is unknown; the limit lists the known ones.
    """
    if obliquity not in OBLIQUITIES:
        raise OutOfRangeError("obliquity", value=repr(obliquity), limit=" | ".join(OBLIQUITIES), remedy="choose one")


@checked
@dataclass(frozen=True, kw_only=True)
class PointSource:
    """A monochromatic point source of unit strength in front of a lens, or a virtual one behind it.

    Unit strength means that on the line through the source parallel to the axis, the field at a distance r from the
    source is exp(i k r)/(iλ r) [1/m²], where λ is the wavelength and k = 2π/λ.

    Parameters
    ----------
    x, y
        Transverse position [m], in the same coordinates as the centre of the lens.
    distance
        Distance in front of the lens plane [m], ≠ 0; < 0 for light that converges to a point behind this plane.

    Raises
    ------
    OutOfRangeError
        The distance is zero, or a coordinate is not finite.

    Examples
    --------
    >>> from tradestudy import optics
    >>> near = optics.PointSource(x=1e-3, distance=0.15)
    >>> star = optics.PointSource.at_infinity(angle_x=0.01)
    >>> lens = optics.CircularLens(radius=2e-3, focal_length=50e-3, lens_phase="perfect")
    >>> print("image at x = {:.3g} m, {:.3g} m behind the lens".format(*lens.image_of(star)[::2]))
    image at x = -0.0005 m, 0.05 m behind the lens
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
                remedy="for a source at infinity use PointSource.at_infinity",
            )

    @classmethod
    @checked
    def at_infinity(cls, *, angle_x: float = 0.0, angle_y: float = 0.0) -> PointSource:
        """Return a point source at a distance of 1e15 m, so far away that its wave is plane.

        Parameters
        ----------
        angle_x
            Angle between the axis and the direction of the source, projected onto the x–z plane [rad], within ±π/2.
        angle_y
            The same angle, projected onto the y–z plane [rad], within ±π/2.

        Returns
        -------
        PointSource
            Source at x = 1e15 tan(angle_x) and y = 1e15 tan(angle_y) [m].

        Raises
        ------
        OutOfRangeError
            The magnitude of an angle is π/2 or more.
        """
        if not (abs(angle_x) < math.pi / 2 and abs(angle_y) < math.pi / 2):
            raise OutOfRangeError(
                "field angle",
                value=f"{angle_x:g}, {angle_y:g} rad",
                limit="between −π/2 and π/2",
                remedy="give angles in radians",
            )
        return cls(x=AS_AT_INFINITY * math.tan(angle_x), y=AS_AT_INFINITY * math.tan(angle_y), distance=AS_AT_INFINITY)


@checked
@dataclass(frozen=True, kw_only=True)
class CircularLens:
    """A thin lens that fills a circular aperture.

    Parameters
    ----------
    radius
        Radius of the aperture [m], > 0.
    focal_length
        Focal length [m], ≠ 0; < 0 for a diverging lens.
    lens_phase
        Phase of the lens:

        * ``perfect``: images every source point exactly onto its thin-lens image, as a well-corrected objective does.
        * ``stigmatic``: images the axial point at `focus_distance` exactly; its phase is fixed, so it has coma off the
          axis.
        * ``parabolic``: the lens of the paper under References, with the phase −π r²/(λ f) at the distance r from the
          centre, for the wavelength λ and the focal length f. Along exact paths, it has spherical aberration:
          a path error of r⁴/8 (1/a³ + 1/b³) [m], for the object distance a and the image distance b.
    focus_distance
        Distance of the axial point that a stigmatic lens images exactly [m]; required for ``stigmatic``, not allowed
        otherwise.
    centre
        Centre (x, y) of the aperture, which is also the vertex of the lens [m].
    pupil
        Amplitude transmission and aberrations, the same for all source points and methods of propagation. Default: a
        clear pupil without aberrations.

    Raises
    ------
    OutOfRangeError
        A length is out of range, or `focus_distance` is missing or not allowed.

    References
    ----------
    "Diffraction model of a plenoptic camera for in-situ space exploration", eqs. 9–22.

    Examples
    --------
    An f/2.8 lens that is perfect except for a tenth of a wave of coma along x:

    >>> from tradestudy import optics
    >>> lens = optics.CircularLens(
    ...     radius=50e-3 / 2.8 / 2,
    ...     focal_length=50e-3,
    ...     lens_phase="perfect",
    ...     pupil=optics.Pupil.from_waves({8: 0.1}, wavelength=550e-9),
    ... )
    >>> x, y, behind = lens.image_of(optics.PointSource(distance=0.15))
    >>> print(f"image {behind * 1e3:.1f} mm behind the lens, amplitude transmission {lens.transmission(1e-3, 0.0)}")
    image 75.0 mm behind the lens, amplitude transmission 1.0
    >>> lens.without_obscuration(lambda r: optics.disc_nodes(radius=r, radial_count=4, angular_count=8)).count
    32
    """

    radius: float
    focal_length: float
    lens_phase: LensPhase
    focus_distance: float | None = None
    centre: tuple[float, float] = (0.0, 0.0)
    pupil: Pupil | None = None

    def __post_init__(self) -> None:
        if self.lens_phase not in LENS_PHASES:
            raise OutOfRangeError(
                "lens_phase", value=repr(self.lens_phase), limit=" | ".join(LENS_PHASES), remedy="choose one"
            )
        if not (math.isfinite(self.radius) and self.radius > 0):
            raise OutOfRangeError(
                "radius of the lens", value=f"{self.radius:g} m", limit="> 0, finite", remedy="give it in metres"
            )
        if not all(math.isfinite(coordinate) for coordinate in self.centre):
            raise OutOfRangeError(
                "centre of the lens", value=str(self.centre), limit="finite", remedy="give (x, y) in metres"
            )
        if not math.isfinite(self.focal_length) or self.focal_length == 0:
            raise OutOfRangeError(
                "focal_length", value=f"{self.focal_length:g} m", limit="≠ 0, finite", remedy="give it in metres"
            )
        if (self.focus_distance is not None) != (self.lens_phase == "stigmatic"):
            raise OutOfRangeError(
                f"focus_distance of a {self.lens_phase} lens",
                value=str(self.focus_distance),
                limit="a distance for a stigmatic lens, none for the others",
                remedy="give the object distance for which the stigmatic lens is exact, or choose another lens phase",
            )
        if self.focus_distance is not None and (not math.isfinite(self.focus_distance) or self.focus_distance == 0.0):
            raise OutOfRangeError(
                "focus_distance of a stigmatic lens",
                value=f"{self.focus_distance:g} m",
                limit="≠ 0, finite",
                remedy="use a large distance, such as 1e15 m, for light from infinity, or the parabolic lens phase",
            )

    def without_obscuration(self, nodes_of: Callable[[float], QuadratureNodes]) -> QuadratureNodes:
        """Quadrature nodes for integrals over the clear part of the aperture: the obscured disc is subtracted.

        Parameters
        ----------
        nodes_of
            Function that returns the nodes of a disc about the centre of the aperture, given the radius of the disc
            [m].

        Returns
        -------
        QuadratureNodes
            Nodes of the aperture, and nodes of the obscuration with negative area weights.
        """
        whole = nodes_of(self.radius)
        if self.pupil is None or self.pupil.obscuration == 0.0:
            return whole
        dark = nodes_of(self.pupil.obscuration * self.radius)
        return replace(
            whole,
            x=np.concatenate([whole.x, dark.x]),
            y=np.concatenate([whole.y, dark.y]),
            weights=np.concatenate([whole.weights, -dark.weights]),
        )

    def transmission(self, x: Array, y: Array) -> Array | float:
        """Amplitude transmission t of the pupil; the obscuration is ignored.

        Parameters
        ----------
        x, y
            Positions relative to the centre of the lens [m], broadcast together.

        Returns
        -------
        ndarray or float
            t [1], in the shape of the positions; the number 1 if the pupil declares no transmission.

        Raises
        ------
        OutOfRangeError
            The amplitude function of the pupil does not return one finite number for each position.
        """
        passed = None if self.pupil is None else self.pupil.transmission
        if passed is None:
            return 1.0
        u, v = np.broadcast_arrays(x / self.radius, y / self.radius)
        return checked_map(passed(u, v), u, "amplitude")

    def image_of(self, source: PointSource) -> tuple[float, float, float]:
        """Thin-lens image of a point source, at the distance b = a f/(a − f) behind the lens.

        Here, a is the distance of the source in front of the lens, and f the focal length.

        Parameters
        ----------
        source
            Point source.

        Returns
        -------
        tuple
            x and y of the image and its distance b behind the lens [m]; b < 0 for a virtual image.

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
    """Path behind the lens relative to the vertex, in lens coordinates: source leg, lens and pupil.

    `paraxial` expands every conjugate path to second order, as Fresnel does; the three lens phases then agree.
    """
    aberrations = () if lens.pupil is None else lens.pupil.path_terms(lens.radius)
    return PathSum(terms=(*_conjugate_paths(source, lens, paraxial=paraxial), *aberrations))


def _conjugate_paths(source: PointSource, lens: CircularLens, *, paraxial: bool) -> tuple[PathTerm, ...]:
    """Terms of the source leg and of the lens phase."""
    x, y = source.x - lens.centre[0], source.y - lens.centre[1]
    if paraxial:
        incoming = ParabolicPath(x=x, y=y, distance=source.distance)
        return (incoming, ParabolicPath(x=0.0, y=0.0, distance=-lens.focal_length))
    if lens.lens_phase == "perfect":
        # The lens subtracts the exact path from the source and adds the path to the image: only the latter remains.
        image_x, image_y, b = lens.image_of(source)
        return (SphericalPath(x=image_x - lens.centre[0], y=image_y - lens.centre[1], distance=-b),)
    spherical = SphericalPath(x=x, y=y, distance=source.distance)
    if lens.lens_phase == "parabolic":
        return (spherical, ParabolicPath(x=0.0, y=0.0, distance=-lens.focal_length))
    assert lens.focus_distance is not None  # guaranteed by CircularLens
    focus = lens.focus_distance
    cancelled = SphericalPath(x=0.0, y=0.0, distance=focus, weight=-1.0)
    added = SphericalPath(x=0.0, y=0.0, distance=-finite_image_distance(focus, lens.focal_length))
    return (spherical, cancelled, added)


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
        """Slowly varying complex amplitude [1/m²] of a unit point source, times the pupil's amplitude.

        Paper's law (eq. 10): a/(iλ r²); textbook: 1/(iλ r), the free spherical wave; full Rayleigh–Sommerfeld I:
        a/(iλ r²) (1 + i/(k r)); Fresnel (eq. 18): 1/(iλ a).
        """
        return np.asarray(self._arriving(x, y) * self.lens.transmission(x, y))

    def power(self) -> float:
        """∫ |U|² over the pupil."""
        nodes = self.power_nodes(abs(self.source.distance))
        return float(nodes.weights @ np.abs(self.amplitude(nodes.x, nodes.y)) ** 2)

    def power_nodes(self, nearest: float) -> QuadratureNodes:
        """Nodes, relative to the centre, that resolve the amplitude but not the phase.

        A power of 1/r, seen from a point at the distance d that is `nearest`, has a pole in ρ² at −d². Gauss's rule
        converges as t⁻²ⁿ with t = x + √(x² − 1) and x = 1 + 2 (d/R)².
        """
        masked = self.lens.pupil is not None and self.lens.pupil.amplitude is not None
        beyond = 1 + 2 * (nearest / self.lens.radius) ** 2
        needed = -math.log(_AMPLITUDE_ERROR) / (2 * math.acosh(beyond)) if beyond > 1 else math.inf
        radial = max(100 if masked else 12, math.ceil(min(needed, _MOST_RINGS)))
        return self.lens.without_obscuration(
            lambda radius: disc_nodes(radius=radius, radial_count=radial, angular_count=2 * radial)
        )

    def _arriving(self, x: Array, y: Array) -> Array:
        """Amplitude in front of the pupil."""
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
        return np.asarray(self.amplitude(x, y) * unit_phasor(self.wavenumber * self.paths.value(x, y)))

    def axial_cosine(self, x: Array, y: Array) -> Array:
        """Cosine between the wave's direction and the axis.

        Raises
        ------
        OutOfRangeError
            The phase behind the lens is steeper than that of any propagating wave.
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
        """exp(i k path), or exp(−i k path) for a converging wave, which runs towards its centre."""
        return complex(np.exp(1j * math.copysign(self.wavenumber * path, self.source.distance)))


@checked
@dataclass(frozen=True, kw_only=True)
class FocalLengths:
    """Focal length f(θ, λ) of a lens as a table over field angle and wavelength, interpolated linearly.

    f(θ, λ) is defined such that a source at the distance a has its image at the distance b = a f/(a − f), both
    measured along the axis. If a lens images distant points onto a Petzval surface of radius R_P, > 0 for a surface
    that curves towards the lens, then f(θ) = f₀ − (f₀ tan θ)²/(2 R_P), where f₀ = f(0).

    Parameters
    ----------
    field_angles
        Field angles θ, between the axis and the direction of the source [rad], shape (n,); from 0, increasing, below
        π/2. A single angle means no field curvature.
    wavelengths
        Wavelengths λ [m], shape (m,); > 0, increasing. A single wavelength means no axial colour.
    focal_lengths
        f(θ, λ) [m], shape (n, m); finite, ≠ 0, all of one sign.
    reference_wavelength
        Wavelength at which the lens is in focus on the axis [m]; must lie within the table.

    Raises
    ------
    OutOfRangeError
        If a shape or a value does not meet the conditions above.

    References
    ----------
    M. Born and E. Wolf, *Principles of Optics*, sections 4.7 (axial colour) and 5.5.3 (Petzval's surface).

    Examples
    --------
    A focal length that is longer by 1/2000 in red light than in green light:

    >>> import numpy as np
    >>> from tradestudy import optics
    >>> lens = optics.FocalLengths(
    ...     field_angles=np.array([0.0]),
    ...     wavelengths=np.array([550e-9, 650e-9]),
    ...     focal_lengths=np.array([[50e-3, 50.025e-3]]),
    ...     reference_wavelength=550e-9,
    ... )
    >>> print(f"{lens.at(field_angle=0.0, wavelength=600e-9):.7f} m")
    0.0500125 m
    """

    field_angles: FloatArray
    wavelengths: FloatArray
    focal_lengths: FloatArray
    reference_wavelength: float

    def __post_init__(self) -> None:
        shape = self.field_angles.shape + self.wavelengths.shape
        if len(shape) != 2 or self.focal_lengths.shape != shape or 0 in shape:
            raise OutOfRangeError(
                "table of focal lengths",
                value=f"{self.focal_lengths.shape} for {self.field_angles.shape} angles and "
                f"{self.wavelengths.shape} wavelengths",
                limit="(n, m) for (n,) and (m,), n and m ≥ 1",
                remedy="give a row for each angle and a column for each wavelength",
            )
        for name, axis in (("field angles", self.field_angles), ("wavelengths", self.wavelengths)):
            if not (np.isfinite(axis).all() and np.all(np.diff(axis) > 0)):
                raise OutOfRangeError(name, value=str(axis), limit="finite, increasing", remedy="sort the table")
        if not (self.field_angles[0] == 0.0 and self.field_angles[-1] < math.pi / 2):
            raise OutOfRangeError(
                "field angles",
                value=str(self.field_angles),
                limit="from 0 to below π/2",
                remedy="begin on the axis, in radians",
            )
        if not self.wavelengths[0] > 0:
            raise OutOfRangeError("wavelengths", value=str(self.wavelengths), limit="> 0", remedy="give them in metres")
        signs = np.unique(np.sign(self.focal_lengths))
        if not (np.isfinite(self.focal_lengths).all() and signs.size == 1 and signs[0] != 0):
            raise OutOfRangeError(
                "focal lengths",
                value=f"{self.focal_lengths.min():g} to {self.focal_lengths.max():g} m",
                limit="finite, ≠ 0, of one sign",
                remedy="describe a lens that converges at every angle and wavelength, or diverges at every one",
            )
        self.reference  # noqa: B018  (refuses a reference wavelength beyond the table)

    @property
    def reference(self) -> float:
        """Focal length on the axis at `reference_wavelength` [m]."""
        return self.at(field_angle=0.0, wavelength=self.reference_wavelength)

    def at(self, *, field_angle: float, wavelength: float) -> float:
        """Focal length at a field angle and a wavelength, by linear interpolation in the table.

        Parameters
        ----------
        field_angle
            Field angle θ, between the axis and the direction of the source [rad].
        wavelength
            Wavelength λ [m].

        Returns
        -------
        float
            f(θ, λ) [m].

        Raises
        ------
        OutOfRangeError
            If the angle or the wavelength lies outside the table. (A single angle or a single wavelength holds for
            all.)
        """
        for name, value, axis, unit in (
            ("field angle", field_angle, self.field_angles, "rad"),
            ("wavelength", wavelength, self.wavelengths, "m"),
        ):
            if axis.size > 1 and not axis[0] <= value <= axis[-1]:
                raise OutOfRangeError(
                    f"{name} beyond the table of focal lengths",
                    value=f"{value:g} {unit}",
                    limit=f"{axis[0]:g} … {axis[-1]:g} {unit}",
                    remedy="extend the table",
                )
        over_angle = [np.interp(wavelength, self.wavelengths, row) for row in self.focal_lengths]
        return float(np.interp(field_angle, self.field_angles, over_angle))


def focal_length_for(focal_length: float | FocalLengths, source: PointSource, wavelength: float) -> float:
    """Focal length of a lens for a source and a wavelength [m]."""
    if not isinstance(focal_length, FocalLengths):
        return focal_length
    angle = math.atan2(math.hypot(source.x, source.y), abs(source.distance))
    return focal_length.at(field_angle=angle, wavelength=wavelength)


def reference_focal_length(focal_length: float | FocalLengths) -> float:
    """Focal length at which a camera is focused [m]."""
    return focal_length.reference if isinstance(focal_length, FocalLengths) else focal_length
