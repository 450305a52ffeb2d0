"""The camera that light passes: main lens, microlens array and pixels, and the law of each leg."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arguments import checked
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.microlens_coverage import LATTICES
from tradestudy.optics.propagation.lens import CircularLens, LensPhase, PointSource
from tradestudy.optics.propagation.pupil import Pupil

Layout = Literal["square", "hexagonal"]
ApertureShape = Literal["circular", "square"]
Gaps = Literal["opaque", "clear"]


@checked
@dataclass(frozen=True, kw_only=True)
class Microlenses:
    """A microlens array: n thin lenses in one plane, each with its own centre and focal length.

    The cell of a microlens is a square or a regular hexagon whose opposite sides are one pitch apart. The object of a
    microlens is the image that the main lens forms of the source.

    Parameters
    ----------
    centres
        Centre (x, y) of each microlens, which is also its vertex [m], shape (n, 2).
    focal_lengths
        Focal length of each microlens [m], shape (n,).
    aperture
        Shape of the apertures: ``circular``, or ``square`` with sides along x and y.
    aperture_width
        Diameter of a circular aperture or side of a square one [m], > 0; no aperture may extend beyond its cell.
    pitch
        Distance between the centres of neighbouring microlenses [m], > 0.
    layout
        Lattice of the microlenses: ``hexagonal``, with rows along x, or ``square``.
    gaps
        Whether the area between the apertures blocks light (``opaque``) or passes it unchanged (``clear``).
    lens_phase
        Phase of every microlens, see `CircularLens`: ``parabolic`` is a fixed element; ``perfect`` follows the source,
        and so does ``stigmatic`` if `focus_distance` is that of the main lens's image. See `chain_image` for where it
        refuses them.
    focus_distance
        Distance of the axial point that a stigmatic microlens images exactly [m]; required for ``stigmatic``, not
        allowed otherwise.
    pupil
        Amplitude transmission and aberrations of every microlens, without an obscuration. The radius R of this pupil is
        that of the smallest circle around the aperture. Default: a clear pupil without aberrations.

    Raises
    ------
    OutOfRangeError
        If a shape or a value does not meet the conditions above, or two microlenses are closer than `pitch`.

    Examples
    --------
    >>> import numpy as np
    >>> from tradestudy import optics
    >>> lenses = optics.Microlenses(
    ...     centres=optics.square_centres(pitch=26e-6, count=3),
    ...     focal_lengths=np.full(9, 76e-6),
    ...     aperture="circular",
    ...     aperture_width=24e-6,
    ...     pitch=26e-6,
    ...     layout="square", gaps="opaque", lens_phase="parabolic",
    ... )
    >>> print(f"fill factor {lenses.fill_factor:.3f}; {lenses.only(0, 4).count} of {lenses.count} microlenses kept")
    fill factor 0.669; 2 of 9 microlenses kept
    >>> print(f"aperture radius {lenses.lens(4).radius * 1e6:.1f} µm")
    aperture radius 12.0 µm
    """

    centres: FloatArray
    focal_lengths: FloatArray
    aperture: ApertureShape
    aperture_width: float
    pitch: float
    layout: Layout
    gaps: Gaps
    lens_phase: LensPhase
    focus_distance: float | None = None
    pupil: Pupil | None = None

    def __post_init__(self) -> None:
        n = self.focal_lengths.size
        if n < 1 or self.centres.shape != (n, 2) or self.focal_lengths.shape != (n,):
            raise OutOfRangeError(
                "microlens arrays",
                value=f"centres {self.centres.shape}, focal lengths {self.focal_lengths.shape}",
                limit="(n, 2) and (n,), n ≥ 1",
                remedy="give one focal length for each centre",
            )
        if not np.isfinite(self.centres).all():
            raise OutOfRangeError(
                "centres of the microlenses", value="not finite", limit="finite", remedy="give (x, y) of each in metres"
            )
        for value, allowed, name in (
            (self.aperture, ("circular", "square"), "microlens aperture"),
            (self.layout, ("square", "hexagonal"), "microlens layout"),
            (self.gaps, ("opaque", "clear"), "gaps between microlenses"),
        ):
            if value not in allowed:
                raise OutOfRangeError(name, value=repr(value), limit=" | ".join(allowed), remedy="choose one")
        if not 0 < self.aperture_width <= self.pitch * (1 + 1e-12) < math.inf:
            raise OutOfRangeError(
                "aperture of a microlens",
                value=f"{self.aperture_width:g} m",
                limit=f"in (0, {self.pitch:g}] m",
                remedy="keep it within the pitch",
            )
        widest = self.pitch * (math.sqrt(3) - 1) if self.layout == "hexagonal" else self.pitch
        if self.aperture == "square" and self.aperture_width > widest * (1 + 1e-12):
            raise OutOfRangeError(
                "square aperture in a hexagonal cell",
                value=f"{self.aperture_width:g} m",
                limit=f"side ≤ {widest:g} m",
                remedy="narrow it, or use circular apertures",
            )
        nearest = float(np.min(cKDTree(self.centres).query(self.centres, k=[2])[0]))
        if nearest < self.pitch * (1 - 1e-6):
            raise OutOfRangeError(
                "microlenses closer than their pitch",
                value=f"{nearest:g} m",
                limit=f"≥ {self.pitch:g} m",
                remedy="move them apart, or lower the pitch",
            )
        if self.pupil is not None and self.pupil.obscuration:
            raise OutOfRangeError(
                "obscuration of microlenses",
                value=f"{self.pupil.obscuration:g}",
                limit="0",
                remedy="give a dark centre as an amplitude",
            )
        for index in range(n):
            self.lens(index)

    @property
    def count(self) -> int:
        """Number of microlenses."""
        return int(self.centres.shape[0])

    @property
    def reach(self) -> float:
        """Distance from the centre of an aperture to the farthest point of the aperture [m]."""
        return self.aperture_width / 2 * (math.sqrt(2) if self.aperture == "square" else 1.0)

    @property
    def cell_reach(self) -> float:
        """Distance from the centre of a cell to the farthest point of the cell that passes light [m]."""
        if self.gaps == "opaque":
            return self.reach
        return self.pitch / math.sqrt(2) if self.layout == "square" else self.pitch / math.sqrt(3)

    @property
    def fill_factor(self) -> float:
        """Fraction of a cell's area that the aperture fills [1]."""
        area = self.aperture_width**2 * (math.pi / 4 if self.aperture == "circular" else 1.0)
        return area / (self.pitch**2 * LATTICES[self.layout].cell_area)

    def only(self, *indices: int) -> Microlenses:
        """Return an array of some of these microlenses.

        Parameters
        ----------
        indices
            Indices of the microlenses to keep.

        Returns
        -------
        Microlenses
            The microlenses kept, in the given order.
        """
        chosen = list(indices)
        return replace(self, centres=self.centres[chosen], focal_lengths=self.focal_lengths[chosen])

    def lens(self, index: int) -> CircularLens:
        """Return one microlens as a lens centred on the origin.

        Parameters
        ----------
        index
            Index of the microlens.

        Returns
        -------
        CircularLens
            Lens with a circular aperture; for a square aperture, the smallest circle around the square.
        """
        return CircularLens(
            radius=self.reach,
            focal_length=float(self.focal_lengths[index]),
            lens_phase=self.lens_phase,
            focus_distance=self.focus_distance,
            pupil=self.pupil,
        )


@checked
def square_centres(*, pitch: float, count: int) -> FloatArray:
    """Centres of microlenses on a square lattice, as a square block about the axis.

    Parameters
    ----------
    pitch
        Distance between the centres of neighbouring microlenses [m], > 0.
    count
        Number of microlenses along a side, ≥ 0.

    Returns
    -------
    ndarray
        Centres (x, y) [m], row by row, shape (count², 2).

    Raises
    ------
    OutOfRangeError
        The pitch is not positive and finite, or the count is negative.

    References
    ----------
    Neighbouring rows and neighbouring columns are ``pitch`` apart.

    Examples
    --------
    >>> from tradestudy import optics
    >>> optics.square_centres(pitch=26e-6, count=3).shape
    (9, 2)
    """
    _refuse_lattice(pitch, count)
    axis = pitch * (np.arange(count) - (count - 1) / 2)
    x, y = np.meshgrid(axis, axis)
    return np.column_stack([x.ravel(), y.ravel()])


@checked
def hexagonal_centres(*, pitch: float, rings: int) -> FloatArray:
    """Centres of microlenses on a hexagonal lattice: one on the axis, and hexagonal rings around it.

    Parameters
    ----------
    pitch
        Distance between the centres of neighbouring microlenses [m], > 0.
    rings
        Number of rings, ≥ 0.

    Returns
    -------
    ndarray
        Centres (x, y) [m], shape (1 + 3 rings (rings + 1), 2).

    Raises
    ------
    OutOfRangeError
        The pitch is not positive and finite, or the number of rings is negative.

    References
    ----------
    Rows run along x and are √3/2 times ``pitch`` apart; every other row is shifted by half the pitch.

    Examples
    --------
    >>> from tradestudy import optics
    >>> optics.hexagonal_centres(pitch=26e-6, rings=1).shape
    (7, 2)
    """
    _refuse_lattice(pitch, rings)
    q, r = np.meshgrid(np.arange(-rings, rings + 1), np.arange(-rings, rings + 1))
    inside = np.abs(q + r) <= rings
    q, r = q[inside], r[inside]
    return np.column_stack([pitch * (q + r / 2), pitch * np.sqrt(3) / 2 * r])


def _refuse_lattice(pitch: float, number: int) -> None:
    if not (0 < pitch < math.inf and number >= 0):
        raise OutOfRangeError(
            "lattice",
            value=f"{number} at a pitch of {pitch:g} m",
            limit="≥ 0 at a pitch > 0, finite",
            remedy="give the pitch in metres",
        )


LegMethod = Literal["geometric", "boundary_wave", "fresnel", "kirchhoff"]
WaveMethod = Literal["boundary_wave", "fresnel", "kirchhoff"]
LEG_METHODS: tuple[LegMethod, ...] = ("geometric", "boundary_wave", "fresnel", "kirchhoff")


@checked
@dataclass(frozen=True, kw_only=True)
class Legs:
    """The methods of propagation from the main lens to the microlens array, and from there to the detector.

    * ``geometric``: rays, paraxial unless `exact`.
    * ``fresnel``: Fresnel's integral, see `FresnelKernel`.
    * ``kirchhoff``: Kirchhoff's integral, see `KirchhoffKernel`.
    * ``boundary_wave``: rays and the wave diffracted at the edge of the aperture, which together approximate
      Kirchhoff's integral; the integral itself where the rays or the edge wave are singular.

    The constants `GEOMETRIC`, `EXACT_RAYS`, `FRESNEL` and `KIRCHHOFF` of this package use one method on both legs;
    `KIRCHHOFF_FRESNEL` uses ``kirchhoff`` to the array and ``fresnel`` to the detector.

    Attributes
    ----------
    to_array
        Method from the main lens to the microlens array.
    to_detector
        Method from the microlens array to the detector.
    exact
        Whether rays follow exact paths instead of paraxial ones; needs ``geometric`` on both legs.

    Raises
    ------
    OutOfRangeError
        If a method is unknown, or exact rays are combined with waves.

    Examples
    --------
    >>> from tradestudy import optics
    >>> optics.Legs(to_array="kirchhoff", to_detector="fresnel") == optics.KIRCHHOFF_FRESNEL
    True
    """

    to_array: LegMethod
    to_detector: LegMethod
    exact: bool = False

    def __post_init__(self) -> None:
        for method in (self.to_array, self.to_detector):
            if method not in LEG_METHODS:
                raise OutOfRangeError(
                    "method of a leg", value=repr(method), limit=" | ".join(LEG_METHODS), remedy="choose one"
                )
        if self.exact and not self.to_array == self.to_detector == "geometric":
            raise OutOfRangeError(
                "exact rays beside waves",
                value=f"{self.to_array} to the array, {self.to_detector} to the detector",
                limit="geometric on both legs",
                remedy="use geometric on both legs, or leave exact out",
            )


GEOMETRIC = Legs(to_array="geometric", to_detector="geometric")
EXACT_RAYS = Legs(to_array="geometric", to_detector="geometric", exact=True)
FRESNEL = Legs(to_array="fresnel", to_detector="fresnel")
KIRCHHOFF_FRESNEL = Legs(to_array="kirchhoff", to_detector="fresnel")
KIRCHHOFF = Legs(to_array="kirchhoff", to_detector="kirchhoff")


@checked
@dataclass(frozen=True, kw_only=True)
class PixelGrid:
    """Grid of square pixels: row i begins at y = ``edges_y[i]``, column j at x = ``edges_x[j]``.

    Parameters
    ----------
    pitch
        Side of a pixel [m].
    shape
        Numbers of (rows, columns), ≥ 1.
    centre
        Centre (x, y) of the grid [m]. Default: on the axis of the main lens.
    integrated
        True: the irradiance is integrated over each pixel. False: the irradiance at the centre of each pixel is
        multiplied by the area of the pixel.

    Raises
    ------
    OutOfRangeError
        If the pitch is not positive and finite, the centre is not finite, or there are no pixels.

    Examples
    --------
    >>> from tradestudy import optics
    >>> grid = optics.PixelGrid(pitch=4e-6, shape=(9, 23))
    >>> part = grid.part(slice(0, 9), slice(10, 13))
    >>> print(f"the grid begins at x = {grid.edges_x[0] * 1e6:.0f} µm, the part at {part.edges_x[0] * 1e6:.0f} µm")
    the grid begins at x = -46 µm, the part at -6 µm
    """

    pitch: float
    shape: tuple[int, int]
    centre: tuple[float, float] = (0.0, 0.0)
    integrated: bool = True

    def __post_init__(self) -> None:
        if not all(math.isfinite(coordinate) for coordinate in self.centre):
            raise OutOfRangeError(
                "centre of the pixels", value=f"{self.centre} m", limit="finite", remedy="give (x, y) in metres"
            )
        if not (self.pitch > 0 and math.isfinite(self.pitch)) or min(self.shape) < 1:
            raise OutOfRangeError(
                "pixels",
                value=f"{self.shape} of {self.pitch:g} m",
                limit="at least 1 × 1 pixels of more than 0 m",
                remedy="give rows, columns and the pitch in metres",
            )

    def part(self, rows: slice, columns: slice) -> PixelGrid:
        """Return the grid of a rectangular part of the pixels.

        Parameters
        ----------
        rows
            Rows of the part, as a slice with start and stop.
        columns
            Columns of the part, as a slice with start and stop.

        Returns
        -------
        PixelGrid
            Grid of these pixels, at their positions in the whole grid.
        """
        x, y = ((e[p.start] + e[p.stop]) / 2 for e, p in ((self.edges_x, columns), (self.edges_y, rows)))
        shape = (rows.stop - rows.start, columns.stop - columns.start)
        return replace(self, shape=shape, centre=(float(x), float(y)))

    @property
    def corner(self) -> tuple[float, float]:
        """Corner (x, y) of the grid with the smallest coordinates, which is a corner of pixel [0, 0] [m]."""
        rows, columns = self.shape
        return self.centre[0] - columns * self.pitch / 2, self.centre[1] - rows * self.pitch / 2

    @property
    def edges_x(self) -> FloatArray:
        """x positions of the edges between and around the columns [m], shape (columns + 1,)."""
        return np.asarray(self.corner[0] + self.pitch * np.arange(self.shape[1] + 1))

    @property
    def edges_y(self) -> FloatArray:
        """y positions of the edges between and around the rows [m], shape (rows + 1,)."""
        return np.asarray(self.corner[1] + self.pitch * np.arange(self.shape[0] + 1))


@checked
@dataclass(frozen=True, kw_only=True)
class LightPath:
    """Main lens, microlens array and detector on one axis.

    Parameters
    ----------
    main_lens
        Main lens, centred on the axis.
    microlenses
        Microlens array.
    array_distance
        Distance z from the main lens to the microlens array [m], > 0.
    detector_distance
        Distance b_L from the microlens array to the detector [m], > 0.
    pixels
        Pixels of the detector.

    Raises
    ------
    OutOfRangeError
        If a distance is not positive and finite, or the main lens is not centred on the axis.

    Examples
    --------
    >>> import numpy as np
    >>> from tradestudy import optics
    >>> lenses = optics.Microlenses(
    ...     centres=optics.square_centres(pitch=26e-6, count=3),
    ...     focal_lengths=np.full(9, 76e-6),
    ...     aperture="circular",
    ...     aperture_width=24e-6,
    ...     pitch=26e-6,
    ...     layout="square", gaps="opaque", lens_phase="parabolic",
    ... )
    >>> path = optics.LightPath(
    ...     main_lens=optics.CircularLens(radius=0.1e-3, focal_length=2e-3, lens_phase="parabolic"),
    ...     microlenses=lenses,
    ...     array_distance=2.5e-3,
    ...     detector_distance=0.1e-3,
    ...     pixels=optics.PixelGrid(pitch=4e-6, shape=(21, 21)),
    ... )
    >>> source = optics.PointSource(x=1e-3, distance=20e-3)
    >>> print("image {2:.3g} m in front of the array".format(*path.image_at_array(source)))
    image 0.000278 m in front of the array
    >>> middle = path.object_before(4, source)
    >>> print(f"object at x = {middle.x * 1e6:.1f} µm; chief ray at x = {path.chief_point(source)[0] * 1e6:.1f} µm")
    object at x = -111.1 µm; chief ray at x = -125.0 µm
    """

    main_lens: CircularLens
    microlenses: Microlenses
    array_distance: float
    detector_distance: float
    pixels: PixelGrid

    def __post_init__(self) -> None:
        for name, value in (("array distance", self.array_distance), ("detector distance", self.detector_distance)):
            if not (value > 0 and math.isfinite(value)):
                raise OutOfRangeError(name, value=f"{value:g} m", limit="> 0, finite", remedy="give it in metres")
        if self.main_lens.centre != (0.0, 0.0):
            raise OutOfRangeError(
                "centre of the main lens",
                value=str(self.main_lens.centre),
                limit="(0, 0)",
                remedy="move the array instead",
            )

    @property
    def pupils(self) -> tuple[Pupil, ...]:
        """The pupils of the main lens and of the microlenses, without those that are None."""
        return tuple(pupil for pupil in (self.main_lens.pupil, self.microlenses.pupil) if pupil is not None)

    def image_at_array(self, source: PointSource) -> tuple[float, float, float]:
        """Image that the main lens forms of a source, and its distance from the array.

        Parameters
        ----------
        source
            Point source in front of the main lens.

        Returns
        -------
        tuple
            x and y of the image [m], and its distance in front of the array, a_L = z − b [m]; a_L < 0 for an image
            behind the array. Here, z is `array_distance` and b the distance of the image behind the main lens.

        Raises
        ------
        OutOfRangeError
            If the image lies at infinity.
        """
        x, y, b = self.main_lens.image_of(source)
        return x, y, self.array_distance - b

    def object_before(self, index: int, source: PointSource) -> PointSource:
        """Image that the main lens forms of a source, as the object of one microlens.

        Parameters
        ----------
        index
            Index of the microlens in `microlenses`.
        source
            Point source in front of the main lens.

        Returns
        -------
        PointSource
            Object of the microlens: its position relative to the centre of the microlens, and its distance a_L in front
            of the array [m].

        Raises
        ------
        OutOfRangeError
            If the image lies at infinity or in the plane of the array.
        """
        x, y, depth = self.image_at_array(source)
        if depth == 0.0:
            raise OutOfRangeError(
                "main lens's image of the source",
                value=f"on the microlens array, {self.array_distance:g} m behind the lens",
                limit="before or behind the array",
                remedy="use the parabolic lens phase for the microlenses",
            )
        centre_x, centre_y = self.microlenses.centres[index]
        return PointSource(x=float(x - centre_x), y=float(y - centre_y), distance=depth)

    def chief_point(self, source: PointSource) -> tuple[float, float]:
        """Point where the chief ray, through the centre of the main lens, meets the array.

        Parameters
        ----------
        source
            Point source in front of the main lens.

        Returns
        -------
        tuple
            x and y of the point [m].
        """
        scale = -self.array_distance / source.distance
        return scale * source.x, scale * source.y
