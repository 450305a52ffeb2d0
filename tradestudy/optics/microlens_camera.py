"""The data of a camera with a microlens array, and the part of it that a source lights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.arguments import check_wavelength, checked
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.lit_part import array_reach
from tradestudy.optics.chain.scene import Gaps, Layout, LightPath, Microlenses, PixelGrid
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.lens import CircularLens, LensPhase, PointSource
from tradestudy.optics.propagation.pupil import Pupil


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


def focal_length_for(given: float | FocalLengths, source: PointSource, wavelength: float) -> float:
    """Focal length of a lens for a source and a wavelength [m]."""
    if not isinstance(given, FocalLengths):
        return given
    angle = math.atan2(math.hypot(source.x, source.y), abs(source.distance))
    return given.at(field_angle=angle, wavelength=wavelength)


def reference_focal_length(given: float | FocalLengths) -> float:
    """Focal length at which a camera is focused [m]."""
    return given.reference if isinstance(given, FocalLengths) else given


_MOST_MICROLENSES = 1e5
_MOST_PIXELS = 1e8
_LENSES_BEYOND = 1.0  # pitches beyond the light's reach, for the light that the main lens diffracts farther
_NEXT_LENSES = 2.0  # pitches beyond the microlenses of an image, where others may send light to its pixels


@checked
@dataclass(frozen=True, kw_only=True)
class MicrolensCamera:
    """Data of a camera with a microlens array; `light_path` finds the microlenses and pixels that a source lights.

    Parameters
    ----------
    focal_length
        Focal length f of the main lens [m], > 0, or a table of it over field angle and wavelength.
    f_number
        f-number of the main lens [1], > 0: f divided by the diameter of the pupil. For a table, f is its reference
        focal length.
    array_distance
        Distance z from the main lens to the microlens array [m], > 0.
    microlens_focal_lengths
        Focal length of all microlenses [m]; or three focal lengths, for a hexagonal array with three types of microlens
        in which neighbours are always of different types.
    microlens_pitch
        Distance between the centres of neighbouring microlenses [m], > 0 and at most z divided by the f-number.
    gap
        Distance b_L from the microlens array to the detector [m], > 0.
    pixel_pitch
        Side of a pixel [m], in the same range as `microlens_pitch`.
    layout
        Lattice of the microlenses: ``hexagonal``, with rows along x, or ``square``. One microlens is centred on the
        axis.
    microlens_aperture
        Diameter of the circular aperture of every microlens [m]. Default: `microlens_pitch`.
    gaps
        Whether the area between the apertures blocks light (``opaque``) or passes it unchanged (``clear``).
    lens_phase
        Phase of the main lens: ``perfect``, ``stigmatic`` or ``parabolic``, see `CircularLens`. A stigmatic main lens
        images the axial point at the distance of the source exactly.
    microlens_phase
        Phase of every microlens, see `CircularLens`: ``parabolic`` is a fixed element. ``perfect`` and ``stigmatic``
        follow the source: their phase is computed for the main lens's image of it. `chain_image` refuses them where
        they change the image by more than its tolerance, as they do near focus.
    pupil
        Amplitude transmission and aberrations of the main lens. Default: a clear pupil without aberrations.
    microlens_pupil
        Amplitude transmission and aberrations of every microlens. Default: a clear pupil without aberrations.
    odd_pixels
        Whether the sensor has an odd number of (rows, columns). If both are odd, the axis meets the centre of a pixel;
        if both are even, the corner of four pixels.

    Raises
    ------
    OutOfRangeError
        If the f-number, the focal length, a distance, a pitch or the number of microlens types is out of range.
        `light_path` checks the apertures and focal lengths of the microlenses.

    Examples
    --------
    A camera with the lenses of a Raytrix R5: the number of microlenses on the light path of a point at 0.5 m (those
    that it lights and a ring around them), and the number of the next microlenses outside these:

    >>> from tradestudy import optics
    >>> camera = optics.MicrolensCamera(
    ...     focal_length=12.5e-3,
    ...     f_number=3.8,
    ...     array_distance=13.0e-3,
    ...     microlens_focal_lengths=(0.38e-3, 0.432e-3, 0.49e-3),
    ...     microlens_pitch=126.5e-6,
    ...     gap=0.43e-3,
    ...     pixel_pitch=5.5e-6,
    ... )
    >>> point = optics.PointSource(distance=0.5)
    >>> path = camera.light_path(point, wavelength=550e-9)
    >>> path.microlenses.count, camera.next_microlenses(path, point).count
    (7, 30)
    """

    focal_length: float | FocalLengths
    f_number: float
    array_distance: float
    microlens_focal_lengths: float | Sequence[float]
    microlens_pitch: float
    gap: float
    pixel_pitch: float
    layout: Layout = "hexagonal"
    microlens_aperture: float | None = None
    gaps: Gaps = "opaque"
    lens_phase: LensPhase = "perfect"
    microlens_phase: LensPhase = "parabolic"
    pupil: Pupil | None = None
    microlens_pupil: Pupil | None = None
    odd_pixels: tuple[bool, bool] = (False, False)

    def __post_init__(self) -> None:
        if not (self.f_number > 0 and math.isfinite(self.f_number)):
            raise OutOfRangeError(
                "f-number",
                value=f"{self.f_number:g}",
                limit="> 0, finite",
                remedy="divide focal length by pupil diameter",
            )
        for name, length in (
            ("focal length", reference_focal_length(self.focal_length)),
            ("array distance", self.array_distance),
            ("gap from array to detector", self.gap),
        ):
            if not 0 < length < math.inf:
                remedy = "give it in metres, such as 0.43e-3"
                raise OutOfRangeError(name, value=f"{length:g} m", limit="> 0, finite", remedy=remedy)
        widest = self.array_distance / self.f_number
        for name, pitch in (("microlens pitch", self.microlens_pitch), ("pixel pitch", self.pixel_pitch)):
            if not 0 < pitch <= widest:
                raise OutOfRangeError(
                    name,
                    value=f"{pitch:g} m",
                    limit=f"> 0, and ≤ {widest:g} m, which the main lens lights (array_distance / f_number)",
                    remedy="give lengths in metres, such as 5.5e-6",
                )
        if len(self._types) not in ((1, 3) if self.layout == "hexagonal" else (1,)):
            raise OutOfRangeError(
                f"focal lengths of the microlenses of a {self.layout} array",
                value=str(len(self._types)),
                limit="1 or 3" if self.layout == "hexagonal" else "1",
                remedy="give one focal length, or three with layout='hexagonal'",
            )

    @property
    def _types(self) -> FloatArray:
        return np.atleast_1d(np.asarray(self.microlens_focal_lengths, dtype=np.float64))

    @checked
    def light_path(self, source: PointSource | DiscSource, *, wavelength: float) -> LightPath:
        """Return the light path of a source through this camera.

        Parameters
        ----------
        source
            Point source or disc in front of the main lens.
        wavelength
            Wavelength λ [m], at which the focal length is read if it is a table.

        Returns
        -------
        LightPath
            Main lens, the microlenses that the source lights and a ring around them, and the pixels behind all of them.
            The lit part of the array is where the exact rays through the aberrated pupil arrive, enlarged by the radius
            of the first dark ring of diffraction.

        Raises
        ------
        OutOfRangeError
            If an aperture or a focal length of the microlenses is out of range, the main lens forms its image at
            infinity, the source or the wavelength lies outside the table of focal lengths, or the focal length varies
            over a disc source.
        UnaffordableError
            If the source lights more than 100 000 microlenses or 100 million pixels.
        """
        check_wavelength(wavelength)
        points = source_points(source)
        middle = points[0]
        lens = CircularLens(
            radius=reference_focal_length(self.focal_length) / self.f_number / 2,
            focal_length=self._focal_length(source, wavelength),
            lens_phase=self.lens_phase,
            focus_distance=middle.distance if self.lens_phase == "stigmatic" else None,
            pupil=self.pupil,
        )
        depth = self.array_distance - lens.image_of(middle)[2]
        first = LightPath(
            main_lens=lens,
            microlenses=self._microlenses(np.zeros((1, 2)), np.zeros(1, dtype=int), depth),
            array_distance=self.array_distance,
            detector_distance=self.gap,
            pixels=PixelGrid(pitch=self.pixel_pitch, shape=(1, 1)),
        )
        chief = np.array(first.chief_point(middle))
        reach = array_reach(first, points, wavelength) + _LENSES_BEYOND * self.microlens_pitch
        self._refuse_too_many(reach)
        centres, types = self._lattice(chief, reach)
        return replace(first, microlenses=self._microlenses(centres, types, depth), pixels=self._pixels(chief, reach))

    @checked
    def next_microlenses(self, path: LightPath, source: PointSource) -> Microlenses:
        """Return the microlenses around those of a light path, which the path leaves out.

        Parameters
        ----------
        path
            A light path of this camera.
        source
            Point source about whose chief ray the microlenses of the path lie.

        Returns
        -------
        Microlenses
            The microlenses up to two pitches farther from the chief ray than the farthest of the path.

        Raises
        ------
        UnaffordableError
            If these are more than 100 000.
        """
        chief, known = np.array(path.chief_point(source)), path.microlenses
        reach = float(np.linalg.norm(known.centres - chief, axis=1).max()) + _NEXT_LENSES * self.microlens_pitch
        self._refuse_too_many(reach)
        centres, types = self._lattice(chief, reach)
        new = cKDTree(known.centres).query(centres)[0] > self.microlens_pitch / 2
        return replace(known, centres=centres[new], focal_lengths=self._types[types[new]])

    def _refuse_too_many(self, reach: float) -> None:
        """Refuse light on more microlenses or pixels than any camera has, before they are listed."""
        for name, pitch, most in (
            ("microlenses", self.microlens_pitch, _MOST_MICROLENSES),
            ("pixels", self.pixel_pitch, _MOST_PIXELS),
        ):
            if (2 * reach / pitch) ** 2 > most:
                raise UnaffordableError(
                    f"{name} on the light path",
                    value=f"{(2 * reach / pitch) ** 2:.2g} at a pitch of {pitch:g} m",
                    limit=f"≤ {most:g}",
                    remedy="give lengths in metres, such as 5.5e-6, or focus nearer to the source",
                )

    def _focal_length(self, source: PointSource | DiscSource, wavelength: float) -> float:
        """Focal length for the source; refuses a disc over which it varies."""
        if isinstance(source, PointSource):
            return focal_length_for(self.focal_length, source, wavelength)
        away = math.hypot(source.x, source.y)
        radii = (away, max(away - source.diameter / 2, 0.0), away + source.diameter / 2)
        found = [
            focal_length_for(self.focal_length, PointSource(x=r, distance=source.distance), wavelength) for r in radii
        ]
        if max(found) != min(found):
            raise OutOfRangeError(
                "field curvature over a disc",
                value=f"focal lengths from {min(found):g} to {max(found):g} m",
                limit="one focal length",
                remedy="use point sources, or a table with a single field angle",
            )
        return found[0]

    def _lattice(self, about: FloatArray, reach: float) -> tuple[FloatArray, FloatArray]:
        """Centres and types of the microlenses within reach of a point on the array."""
        skew, rise = (0.5, math.sqrt(3) / 2) if self.layout == "hexagonal" else (0.0, 1.0)
        near = about / self.microlens_pitch
        across = reach / self.microlens_pitch
        rows = np.arange(math.floor((near[1] - across) / rise), math.ceil((near[1] + across) / rise) + 1)
        span = math.ceil(across + 1)
        columns = [np.rint(near[0] - skew * row) + np.arange(-span, span + 1) for row in rows]
        first, second = np.concatenate(columns), np.repeat(rows, 2 * span + 1)
        centres = self.microlens_pitch * np.column_stack([first + skew * second, rise * second])
        distance = np.linalg.norm(centres - about, axis=1)
        kept = distance <= max(reach, float(distance.min()))
        return centres[kept], np.asarray((first - second)[kept].astype(int) % self._types.size)

    def _microlenses(self, centres: FloatArray, types: FloatArray, depth: float) -> Microlenses:
        return Microlenses(
            centres=centres,
            focal_lengths=self._types[types],
            aperture="circular",
            aperture_width=self.microlens_pitch if self.microlens_aperture is None else self.microlens_aperture,
            pitch=self.microlens_pitch,
            layout=self.layout,
            gaps=self.gaps,
            lens_phase=self.microlens_phase,
            focus_distance=depth if self.microlens_phase == "stigmatic" else None,
            pupil=self.microlens_pupil,
        )

    def _pixels(self, chief: FloatArray, reach: float) -> PixelGrid:
        """Whole pixels of the sensor behind these microlenses."""
        grown = 1 + self.gap / self.array_distance
        half = math.ceil(grown * reach / self.pixel_pitch)
        centre = self.pixel_pitch * np.rint(grown * chief / self.pixel_pitch) + 0.0  # never −0
        rows, columns = (2 * half + int(odd) for odd in self.odd_pixels)
        return PixelGrid(pitch=self.pixel_pitch, shape=(rows, columns), centre=(float(centre[0]), float(centre[1])))


def source_points(source: PointSource | DiscSource) -> list[PointSource]:
    """A point source; or the centre of a disc and four points of its rim."""
    if isinstance(source, PointSource):
        return [source]
    radius = source.diameter / 2
    return [
        PointSource(x=source.x + i * radius, y=source.y + j * radius, distance=source.distance)
        for i, j in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
    ]
