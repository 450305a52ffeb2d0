"""Field curvature and axial colour of a lens as data: its focal length over field angle and wavelength."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.argument_types import checked_fields
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation.lens import PointSource


@checked_fields
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
