"""A camera with a microlens array: its data, the part of it that a source lights, and the spot behind it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from tradestudy.errors import NotConvergedError, OutOfRangeError, UnaffordableError
from tradestudy.optics.arguments import check_wavelength, checked
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.array_field import PupilWave
from tradestudy.optics.chain.arriving_light import point_wave
from tradestudy.optics.chain.image import mean_image, refuse_following_microlenses, unguarded_image
from tradestudy.optics.chain.lit_part import array_reach, missing_light
from tradestudy.optics.chain.scene import KIRCHHOFF, Gaps, Layout, Legs, LightPath, Microlenses, PixelGrid
from tradestudy.optics.chain.sources import DiscSource, spectral_shares
from tradestudy.optics.microlens_coverage import LATTICES
from tradestudy.optics.propagation.lens import (
    CircularLens,
    FocalLengths,
    LensPhase,
    PointSource,
    focal_length_for,
    reference_focal_length,
)
from tradestudy.optics.propagation.pupil import Pupil

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
        chief, present = np.array(path.chief_point(source)), path.microlenses
        reach = float(np.linalg.norm(present.centres - chief, axis=1).max()) + _NEXT_LENSES * self.microlens_pitch
        self._refuse_too_many(reach)
        centres, types = self._lattice(chief, reach)
        new = cKDTree(present.centres).query(centres)[0] > self.microlens_pitch / 2
        return replace(present, centres=centres[new], focal_lengths=self._types[types[new]])

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
        focal_lengths = [
            focal_length_for(self.focal_length, PointSource(x=r, distance=source.distance), wavelength) for r in radii
        ]
        if max(focal_lengths) != min(focal_lengths):
            raise OutOfRangeError(
                "field curvature over a disc",
                value=f"focal lengths from {min(focal_lengths):g} to {max(focal_lengths):g} m",
                limit="one focal length",
                remedy="use point sources, or a table with a single field angle",
            )
        return focal_lengths[0]

    def _lattice(self, about: FloatArray, reach: float) -> tuple[FloatArray, FloatArray]:
        """Centres and types of the microlenses within reach of a point on the array."""
        skew, rise = LATTICES[self.layout].second_vector
        near = about / self.microlens_pitch
        across = reach / self.microlens_pitch
        rows = np.arange(math.floor((near[1] - across) / rise), math.ceil((near[1] + across) / rise) + 1)
        span = math.ceil(across + 1)
        columns = [np.rint(near[0] - skew * row) + np.arange(-span, span + 1) for row in rows]
        first, second = np.concatenate(columns), np.repeat(rows, 2 * span + 1)
        centres = self.microlens_pitch * np.column_stack([first + skew * second, rise * second])
        distance = np.linalg.norm(centres - about, axis=1)
        # At least the nearest microlens. Neighbours differ by 1 or 2 in `first − second`: of three types, no two equal
        # ones touch.
        within = distance <= max(reach, float(distance.min()))
        return centres[within], np.asarray((first - second)[within].astype(int) % self._types.size)

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


_ROUNDS = 4
_FINEST = 1e-6  # smallest tolerance that `ChainAccuracy` accepts
_SAFETY = 2.0  # of the light that is left out: measured at up to 1.5 times the estimate


@checked
def microlens_image(
    camera: MicrolensCamera,
    source: PointSource | DiscSource,
    *,
    wavelength: float | FloatArray,
    weights: FloatArray | None = None,
    legs: Legs = KIRCHHOFF,
    tolerance: float = 1e-3,
    seed: int = 0,
) -> ChainImage:
    """Image of a point or a disc on the pixels behind a main lens and a microlens array, within a tolerance.

    Parameters
    ----------
    camera
        Main lens, microlens array and sensor. For a plenoptic camera of a loaded study, give
        ``study.cameras[NAME].light_chain()``, where NAME is its key in the study file.
    source
        A `PointSource` or a `DiscSource`. The intensities of the points of an incoherent disc add up; a coherent disc
        emits one wave, with the same phase at every point.
    wavelength
        Wavelength λ [m], > 0; or several, shape (n,), whose images are averaged with ``weights``.
    weights
        Power through the pupil at each wavelength [any unit], ≥ 0, not all zero, shape (n,); only the ratios matter.
        Default: equal.
    legs
        Methods of propagation to the array and to the detector, as in `chain_image`.
    tolerance
        Largest relative L2 error over the pixels [1], from 1e-6 to 0.2.
    seed
        Seed, ≥ 0, of the random points at which the result is checked; the same seed gives the same digits.

    Returns
    -------
    ChainImage
        Fraction of the power through the pupil on each pixel, with a stated error within the tolerance. The pixels are
        ``camera.light_path(source, wavelength=…).pixels``; for several wavelengths, the widest of these grids.

    Raises
    ------
    OutOfRangeError
        An argument is outside the range in which the methods hold; see `chain_image`.
    UnaffordableError
        The image, or the second computation for its error estimate, needs more than 2 GB of memory; or the source would
        have to be divided into more than about a million points.
    NotConvergedError
        The stated error stays above the tolerance after refinement.

    References
    ----------
    "Diffraction model of a plenoptic camera for in-situ space exploration", eqs. 14, 16, 22 and 25, as in
    `chain_image`.

    Examples
    --------
    >>> from tradestudy import optics
    >>> camera = optics.MicrolensCamera(
    ...     focal_length=2e-3,
    ...     f_number=8,
    ...     array_distance=2.5e-3,
    ...     microlens_focal_lengths=76e-6,
    ...     microlens_pitch=26e-6,
    ...     gap=0.1e-3,
    ...     pixel_pitch=4e-6,
    ...     pupil=optics.Pupil.from_waves({8: 0.1}, wavelength=550e-9),
    ... )
    >>> image = optics.microlens_image(camera, optics.PointSource(distance=20e-3), wavelength=550e-9, tolerance=1e-2)
    >>> rows, columns = image.pixels.shape
    >>> print(f"{image.pixels.sum():.2f} of the light on {rows} × {columns} pixels, to 1 %: {image.within_tolerance}")
    0.92 of the light on 38 × 38 pixels, to 1 %: True
    >>> grid = camera.light_path(optics.PointSource(distance=20e-3), wavelength=550e-9).pixels
    >>> print(f"from x = {grid.edges_x[0] * 1e6:.0f} to {grid.edges_x[-1] * 1e6:.0f} µm")
    from x = -76 to 76 µm
    """
    if seed < 0:
        raise OutOfRangeError("seed", value=str(seed), limit="≥ 0", remedy="give another")
    wavelengths = np.atleast_1d(np.asarray(wavelength, dtype=np.float64))
    shares = spectral_shares(wavelengths, np.ones_like(wavelengths) if weights is None else weights)
    paths = [camera.light_path(source, wavelength=float(value)) for value in wavelengths]
    widest = max((path.pixels for path in paths), key=lambda grid: grid.shape)
    lenses = max((path.microlenses for path in paths), key=lambda array: array.count)
    parts = [
        _refined(camera, replace(path, pixels=widest, microlenses=lenses), source, float(value), legs, tolerance, seed)
        for value, path in zip(wavelengths, paths, strict=True)
    ]
    return parts[0] if len(parts) == 1 else mean_image(parts, wavelengths, shares)


def _refined(
    camera: MicrolensCamera,
    path: LightPath,
    source: PointSource | DiscSource,
    wavelength: float,
    legs: Legs,
    tolerance: float,
    seed: int,
) -> ChainImage:
    """Image whose stated error is within the tolerance, with as many microlenses as that takes."""
    accuracy = ChainAccuracy(tolerance=tolerance)

    def sampled(path: LightPath) -> ChainImage:
        rng = np.random.default_rng(seed)
        return unguarded_image(path, source, wavelength=wavelength, legs=legs, accuracy=accuracy, rng=rng)

    for _ in range(_ROUNDS):
        image = sampled(path)
        around, missing = path, np.zeros(0)
        if legs.to_array != "geometric":  # rays light none beyond
            around = replace(path, microlenses=camera.next_microlenses(path, source_points(source)[0]))
            missing = _missing(around, source, wavelength, legs, image.pixels)
        terms = image.error_terms | {"microlenses left out": _SAFETY * float(np.linalg.norm(missing))}
        error = math.hypot(image.numerical_error, terms["microlenses left out"])
        if error <= tolerance:
            refuse_following_microlenses(image, path, source, legs, tolerance, sampled)
            return replace(image, numerical_error=error, error_terms=terms, tolerance=tolerance)
        # Both errors add in quadrature: whichever exceeds half the tolerance is reduced.
        if terms["microlenses left out"] > tolerance / 2:
            path = replace(path, microlenses=_joined(path.microlenses, around.microlenses, missing, tolerance / 4))
        if image.numerical_error > tolerance / 2:
            finer = max(accuracy.tolerance * min(0.3, 0.5 * tolerance / image.numerical_error), _FINEST)
            accuracy = replace(accuracy, tolerance=finer)
    raise NotConvergedError(
        "the image does not reach its tolerance",
        value=f"stated relative L2 error {error:.2g}",
        limit=f"{tolerance:g}",
        remedy="raise the tolerance; the error_terms of chain_image show what limits the error",
    )


def _missing(
    around: LightPath, source: PointSource | DiscSource, wavelength: float, legs: Legs, pixels: FloatArray
) -> FloatArray:
    """Relative L2 change of the image by each microlens around it: of a disc, by the point that changes it most."""
    coherent = source.diameter / 2 if isinstance(source, DiscSource) and source.coherent else 0.0
    points = source_points(source)[: 1 if coherent else None]
    waves = [point_wave(around, point, wavelength=wavelength, legs=legs, coherent_radius=coherent) for point in points]
    changes = [missing_light(wave.reference, around, pixels) for wave in waves if isinstance(wave, PupilWave)]
    return np.asarray(np.max(changes, axis=0))


def _joined(present: Microlenses, around: Microlenses, missing: FloatArray, allowed: float) -> Microlenses:
    """Known microlenses and those of the others without which the error would exceed what is allowed."""
    # From the faintest on, as many are left out as their light in quadrature allows.
    order = np.argsort(missing)
    added = order[np.sqrt(np.cumsum(missing[order] ** 2)) > allowed]
    return replace(
        present,
        centres=np.concatenate([present.centres, around.centres[added]]),
        focal_lengths=np.concatenate([present.focal_lengths, around.focal_lengths[added]]),
    )
