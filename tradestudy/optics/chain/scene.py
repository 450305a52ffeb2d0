"""The light path: main lens, microlens array and detector, and the law of propagation on each leg."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.argument_types import checked, checked_fields
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation.lens import CircularLens, LensPhase, PointSource
from tradestudy.optics.propagation.pupil import Pupil

LegMethod = Literal["geometric", "boundary_wave", "fresnel", "kirchhoff"]
WaveMethod = Literal["boundary_wave", "fresnel", "kirchhoff"]
LEG_METHODS: tuple[LegMethod, ...] = ("geometric", "boundary_wave", "fresnel", "kirchhoff")
Layout = Literal["square", "hexagonal"]
ApertureShape = Literal["circular", "square"]
Gaps = Literal["opaque", "clear"]


@checked_fields
@dataclass(frozen=True, kw_only=True)
class Legs:
    """The law of propagation on each leg.

    ``geometric``: paraxial rays. ``fresnel``, ``kirchhoff``: the integrals. ``boundary_wave``: rays and the wave from
    the edge of the aperture instead of Kirchhoff's integral, which takes over where they are singular.

    Attributes
    ----------
    to_array
        Law from the main lens to the microlens array.
    to_detector
        Law from the microlens array to the detector.
    exact
        Whether rays follow Kirchhoff's exact paths instead of paraxial ones; needs ``geometric`` on both legs.

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
class Microlenses:
    """Thin lenses in one plane, each with its own centre and focal length.

    Parameters
    ----------
    centres
        Centres and vertices (x, y) [m], shape (n, 2).
    focal_lengths
        Focal length of each [m], shape (n,); lenses of one type share a value.
    aperture
        ``circular`` or ``square``, sides along x and y.
    aperture_width
        Diameter or side [m].
    pitch
        Distance between the centres of neighbours [m], ≥ ``aperture_width``.
    layout
        ``square``, or ``hexagonal`` with rows along x.
    gaps
        ``opaque``, or ``clear``: the part of a lens's cell outside its aperture passes light unchanged.
    lens_phase
        As in `CircularLens`; ``perfect`` sends the main lens's image of the source to its thin-lens image.
    focus_distance
        Object distance for which a stigmatic lens is exact [m]; for ``stigmatic`` only.
    pupil
        Amplitude and aberrations of every microlens, over the smallest circle around its aperture.

    Raises
    ------
    OutOfRangeError
        If shapes or lengths do not fit together, or lenses overlap.

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
    >>> print(f"{lenses.fill_factor:.3f}")
    0.669
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
        """Distance from the centre of an aperture to its farthest point [m]."""
        return self.aperture_width / 2 * (math.sqrt(2) if self.aperture == "square" else 1.0)

    @property
    def cell_reach(self) -> float:
        """Distance from the centre of a cell to its farthest point that passes light [m]."""
        if self.gaps == "opaque":
            return self.reach
        return self.pitch / math.sqrt(2) if self.layout == "square" else self.pitch / math.sqrt(3)

    @property
    def fill_factor(self) -> float:
        """Fraction of a cell's area that the aperture fills."""
        area = self.aperture_width**2 * (math.pi / 4 if self.aperture == "circular" else 1.0)
        return area / (self.pitch**2 * (1.0 if self.layout == "square" else math.sqrt(3) / 2))

    def only(self, *indices: int) -> Microlenses:
        """Return the array with some of its microlenses."""
        kept = list(indices)
        return replace(self, centres=self.centres[kept], focal_lengths=self.focal_lengths[kept])

    def lens(self, index: int) -> CircularLens:
        """Return one microlens in its own coordinates; its radius reaches the farthest point of the aperture."""
        return CircularLens(
            radius=self.reach,
            focal_length=float(self.focal_lengths[index]),
            lens_phase=self.lens_phase,
            focus_distance=self.focus_distance,
            pupil=self.pupil,
        )


@checked_fields
@dataclass(frozen=True, kw_only=True)
class PixelGrid:
    """Square pixels; row i starts at y = ``edges_y[i]``, column j at x = ``edges_x[j]``.

    Parameters
    ----------
    pitch
        Side of a pixel [m].
    shape
        (rows, columns).
    centre
        Centre (x, y) of the grid [m]. Default: on the main lens's axis.
    integrated
        Whether a pixel integrates over its square or multiplies the irradiance at its centre by its area.

    Examples
    --------
    >>> from tradestudy import optics
    >>> print(f"{optics.PixelGrid(pitch=4e-6, shape=(9, 23)).edges_x[0]:.2g} m")
    -4.6e-05 m
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
                limit="≥ 1 × 1, > 0 m",
                remedy="give rows, columns and the pitch in metres",
            )

    def part(self, rows: slice, columns: slice) -> PixelGrid:
        """Return the grid of a rectangle of pixels."""
        x, y = ((e[p.start] + e[p.stop]) / 2 for e, p in ((self.edges_x, columns), (self.edges_y, rows)))
        shape = (rows.stop - rows.start, columns.stop - columns.start)
        return replace(self, shape=shape, centre=(float(x), float(y)))

    @property
    def corner(self) -> tuple[float, float]:
        """Outer corner (x, y) of pixel [0, 0] [m]."""
        rows, columns = self.shape
        return self.centre[0] - columns * self.pitch / 2, self.centre[1] - rows * self.pitch / 2

    @property
    def edges_x(self) -> FloatArray:
        """Edges of the columns [m]."""
        return np.asarray(self.corner[0] + self.pitch * np.arange(self.shape[1] + 1))

    @property
    def edges_y(self) -> FloatArray:
        """Edges of the rows [m]."""
        return np.asarray(self.corner[1] + self.pitch * np.arange(self.shape[0] + 1))


@checked_fields
@dataclass(frozen=True, kw_only=True)
class LightPath:
    """Main lens, microlens array and detector on one axis.

    Parameters
    ----------
    main_lens
        Lens on the axis.
    microlenses
        The array.
    array_distance
        Distance from main lens to array, z [m], > 0.
    detector_distance
        Distance from array to detector, b_L [m], > 0.
    pixels
        The detector.

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
    >>> print("main image {2:.3g} m before the array".format(*path.image_at_array(optics.PointSource(distance=20e-3))))
    main image 0.000278 m before the array
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
        """Pupils given for the main lens and the microlenses."""
        return tuple(one for one in (self.main_lens.pupil, self.microlenses.pupil) if one is not None)

    def image_at_array(self, source: PointSource) -> tuple[float, float, float]:
        """Main lens's image of a source: x, y [m] and the signed distance in front of the array, a_L = z − b [m]."""
        x, y, b = self.main_lens.image_of(source)
        return x, y, self.array_distance - b

    def object_before(self, index: int, source: PointSource) -> PointSource:
        """Main lens's image of a source relative to the vertex of one microlens, as its object."""
        x, y, depth = self.image_at_array(source)
        if depth == 0.0:
            raise OutOfRangeError(
                "main lens's image of the source",
                value=f"on the microlens array, {self.array_distance:g} m behind the lens",
                limit="before or behind the array",
                remedy="move the array or the source by a fraction of a micrometre",
            )
        centre_x, centre_y = self.microlenses.centres[index]
        return PointSource(x=float(x - centre_x), y=float(y - centre_y), distance=depth)

    def chief_point(self, source: PointSource) -> tuple[float, float]:
        """Where the ray through the centre of the main lens meets the array [m]."""
        scale = -self.array_distance / source.distance
        return scale * source.x, scale * source.y


@checked
def square_centres(*, pitch: float, count: int) -> FloatArray:
    """Centres of ``count`` × ``count`` lenses on a square lattice about the axis [m], shape (count², 2).

    Parameters
    ----------
    pitch
        Distance between neighbours [m].
    count
        Lenses along a side.

    Returns
    -------
    ndarray
        Centres (x, y) [m], row by row.

    Raises
    ------
    OutOfRangeError
        The pitch is not positive and finite, or the count is negative.

    References
    ----------
    The definition.

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
    """Centres of the lens on the axis and of ``rings`` hexagons around it, rows along x [m].

    Parameters
    ----------
    pitch
        Distance between neighbours [m].
    rings
        Hexagons around the middle lens.

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
    The definition.

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
