"""The light path: main lens, microlens array and detector, and the law of propagation on each leg."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.argument_types import checked_fields
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.microlenses import Microlenses
from tradestudy.optics.propagation.lens import CircularLens, PointSource
from tradestudy.optics.propagation.pupil import Pupil

LegMethod = Literal["geometric", "boundary_wave", "fresnel", "kirchhoff"]
WaveMethod = Literal["boundary_wave", "fresnel", "kirchhoff"]
LEG_METHODS: tuple[LegMethod, ...] = ("geometric", "boundary_wave", "fresnel", "kirchhoff")


@checked_fields
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


@checked_fields
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
        if not all(math.isfinite(one) for one in self.centre):
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


@checked_fields
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
        return tuple(one for one in (self.main_lens.pupil, self.microlenses.pupil) if one is not None)

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
