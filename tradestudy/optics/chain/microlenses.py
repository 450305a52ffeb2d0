"""A microlens array: thin lenses in one plane, and the lattices on which their centres lie."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.argument_types import checked, checked_fields
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation.lens import CircularLens, LensPhase
from tradestudy.optics.propagation.pupil import Pupil

Layout = Literal["square", "hexagonal"]
ApertureShape = Literal["circular", "square"]
Gaps = Literal["opaque", "clear"]


@checked_fields
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
        return area / (self.pitch**2 * (1.0 if self.layout == "square" else math.sqrt(3) / 2))

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
        kept = list(indices)
        return replace(self, centres=self.centres[kept], focal_lengths=self.focal_lengths[kept])

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
