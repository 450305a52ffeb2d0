"""Difference between Fresnel's and Kirchhoff's point-spread functions, measured on the two intensities.

Both are computed in the plane of the thin-lens image, on rings about it, out to the largest window. Between the rings
they are band-limited, so Chebyshev interpolation in radius and Fourier interpolation in angle are exact to rounding,
and the kinks of the absolute difference can be sampled as finely as necessary.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lateral_resolution import FIRST_DARK_RING, airy_radius
from tradestudy.optics.propagation.aperture import aperture_field
from tradestudy.optics.propagation.lens import CircularLens, LensPhase, PointSource, finite_image_distance
from tradestudy.optics.propagation.result import ApertureField, Method
from tradestudy.optics.propagation.targets import TargetPoints
from tradestudy.optics.propagation.wave_optics import FieldAccuracy
from tradestudy.optics.quadrature import gauss_legendre

_INTERVALS = 16  # of a panel at most one Airy radius long; they resolve its 1.2 periods to 1e-9
_FINE_POINTS = 64  # Gauss nodes in a panel for the kinked absolute difference
_ANGLE_MARGIN = 1.2  # angles relative to the smallest number that resolves the outermost ring
_ANGLE_REFINEMENT = 4


@dataclass(frozen=True, kw_only=True)
class PsfDifference:
    """Difference between Fresnel's and Kirchhoff's patterns, each measure over windows of several radii.

    Attributes
    ----------
    peak
        |I_F − I_K|/I_K at the thin-lens image point; the same for every window.
    l1
        ∫|I_F − I_K| dA / ∫ I_K dA over the window.
    largest
        max|I_F − I_K| / max I_K over the window.
    peak_error, l1_error, largest_error
        Numerical errors of these measures: the propagated stated errors of both intensities, plus the change when every
        second ring and half the points in between are left out.
    """

    peak: FloatArray
    l1: FloatArray
    largest: FloatArray
    peak_error: FloatArray
    l1_error: FloatArray
    largest_error: FloatArray


def fresnel_psf_difference(
    *,
    focal_length: float,
    object_distance: float,
    f_number: float,
    field_angle: float,
    wavelength: float,
    lens_phases: Sequence[LensPhase],
    windows: Sequence[float],
    tolerance: float,
) -> Mapping[LensPhase, PsfDifference]:
    """Compare Fresnel's in-focus point-spread function with Kirchhoff's, for several lens phases.

    Fresnel's is the same for all of them: to second order, every lens phase is the parabola.

    Parameters
    ----------
    focal_length, object_distance
        f > 0 and a > f [m]; the image plane lies at b = a f/(a − f).
    f_number
        N > 0; the pupil diameter is f/N.
    field_angle
        Angle of the object point from the axis [rad], in [0, π/2).
    wavelength
        λ [m].
    lens_phases
        Lens phases; Kirchhoff's pattern is computed for each. A stigmatic lens images the axial
        point at ``object_distance`` exactly.
    windows
        Radii about the thin-lens image, in Airy radii, increasing.
    tolerance
        Relative L2 numerical error of each intensity over the rings.

    Raises
    ------
    OutOfRangeError
        Windows are not positive and increasing, or an argument is outside the laws of `aperture_field`.
    UnaffordableError, NotConvergedError
        As in `aperture_field`.

    Notes
    -----
    "Diffraction model of a plenoptic camera for in-situ space exploration", section 5.3 and Figure 6, where neither
    the measure, nor the window, nor the wavelength is stated.
    """
    if len(windows) == 0 or windows[0] <= 0 or np.any(np.diff(windows) <= 0):
        raise OutOfRangeError("windows", value=str(list(windows)), limit="positive and increasing")
    b = finite_image_distance(object_distance, focal_length)
    pupil = focal_length / f_number
    airy = float(airy_radius(b, pupil, wavelength))
    offset = math.tan(field_angle)
    annuli = _annuli(windows, symmetric=offset == 0.0)
    x, y = (np.concatenate(axis) for axis in zip(*(annulus.positions(airy) for annulus in annuli), strict=True))
    targets = TargetPoints(x=x - b * offset, y=y, distance=b)

    def psf(method: Method, lens_phase: LensPhase) -> ApertureField:
        return aperture_field(
            source=PointSource(x=object_distance * offset, distance=object_distance),
            lens=CircularLens(
                radius=pupil / 2,
                focal_length=focal_length,
                lens_phase=lens_phase,
                focus_distance=object_distance if lens_phase == "stigmatic" else None,
            ),
            targets=targets,
            wavelength=wavelength,
            method=method,
            accuracy=FieldAccuracy(tolerance=tolerance),
        )

    fresnel = psf("fresnel", "parabolic")
    return {phase: _compared(annuli, fresnel, psf("kirchhoff", phase)) for phase in lens_phases}


def compared_points(windows: Sequence[float], *, symmetric: bool) -> int:
    """Points at which `fresnel_psf_difference` computes each pattern; a point on the axis has a symmetric one."""
    return sum(math.prod(annulus.shape) for annulus in _annuli(windows, symmetric=symmetric))


@dataclass(frozen=True, kw_only=True)
class _Annulus:
    """Rings of targets in panels of radius, in Airy radii; a symmetric pattern needs only one angle.

    Arrays on the rings have shape (radii, angles). The angles cover half a turn; the other half mirrors it.
    """

    edges: FloatArray
    angles: int

    @property
    def _lobatto(self) -> FloatArray:
        return -np.cos(math.pi * np.arange(_INTERVALS + 1) / _INTERVALS)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of radii and angles."""
        return (self.edges.size - 1) * _INTERVALS + 1, 1 if self.angles == 1 else self.angles // 2 + 1

    def positions(self, airy: float) -> tuple[FloatArray, FloatArray]:
        """Targets relative to the image point [m], flat."""
        middle, half = (self.edges[1:] + self.edges[:-1]) / 2, np.diff(self.edges) / 2
        inner = middle[:, None] + half[:, None] * self._lobatto
        radius = airy * np.concatenate([self.edges[:1], inner[:, 1:].ravel()])[:, None]
        angle = 2 * math.pi * np.arange(self.shape[1]) / self.angles
        return (radius * np.cos(angle)).ravel(), (radius * np.sin(angle)).ravel()

    def refined(self, values: FloatArray, *, coarse: bool) -> FloatArray:
        """Values at the points between the rings, shape (panels, points, angles)."""
        step = 2 if coarse else 1
        nodes, t = self._lobatto[::step], _gauss(coarse=coarse)[0]
        degree = nodes.size - 1
        interpolation = np.polynomial.chebyshev.chebvander(t, degree) @ np.linalg.inv(
            np.polynomial.chebyshev.chebvander(nodes, degree)
        )
        starts = _INTERVALS * np.arange(self.edges.size - 1)[:, None] + np.arange(0, _INTERVALS + 1, step)
        return np.asarray(interpolation @ self._around(values, coarse=coarse)[starts])

    def weights(self, *, coarse: bool) -> FloatArray:
        """Weights r dr dθ of the values between the rings, shape (panels, points, 1)."""
        t, w = _gauss(coarse=coarse)
        half = np.diff(self.edges)[:, None] / 2
        radius = (self.edges[1:] + self.edges[:-1])[:, None] / 2 + half * t
        angles = self.angles if self.angles == 1 else self.angles * _refinement(coarse=coarse)
        return np.asarray((radius * half * w * (2 * math.pi / angles))[:, :, None])

    def _around(self, values: FloatArray, *, coarse: bool) -> FloatArray:
        """Full turns from half turns, interpolated to more angles."""
        if self.angles == 1:
            return values
        turn = np.concatenate([values, values[:, -2:0:-1]], axis=1)
        factor = _refinement(coarse=coarse)
        return np.asarray(np.fft.irfft(np.fft.rfft(turn, axis=1), n=factor * self.angles, axis=1) * factor)


def _gauss(*, coarse: bool) -> tuple[FloatArray, FloatArray]:
    nodes, weights = gauss_legendre(_FINE_POINTS // 2 if coarse else _FINE_POINTS)
    return 2 * nodes - 1, 2 * weights


def _refinement(*, coarse: bool) -> int:
    return _ANGLE_REFINEMENT // 2 if coarse else _ANGLE_REFINEMENT


def _annuli(windows: Sequence[float], *, symmetric: bool) -> list[_Annulus]:
    """One annulus for each window, starting at the previous window."""
    annuli = []
    for inner, outer in itertools.pairwise((0.0, *windows)):
        # An intensity contains no period shorter than λ N_w; the outermost ring gets two angles for each such period.
        periods = 2 * math.pi * FIRST_DARK_RING * outer
        annuli.append(
            _Annulus(
                edges=np.linspace(inner, outer, math.ceil(outer - inner - 1e-9) + 1),
                angles=1 if symmetric else 2 * math.ceil(_ANGLE_MARGIN * periods + 8),
            )
        )
    return annuli


@dataclass(frozen=True, kw_only=True)
class _Sums:
    """Integrals and extremes over the windows, and the measures that follow from them."""

    absolute: FloatArray
    power: FloatArray
    largest: FloatArray
    brightest: FloatArray

    @classmethod
    def of(cls, annuli: list[_Annulus], fresnel: FloatArray, kirchhoff: FloatArray, *, coarse: bool) -> _Sums:
        parts = []
        split = np.cumsum([math.prod(annulus.shape) for annulus in annuli])[:-1]
        for annulus, approximate, exact in zip(
            annuli, np.split(fresnel, split), np.split(kirchhoff, split), strict=True
        ):
            weights = annulus.weights(coarse=coarse)
            difference = np.abs(annulus.refined((approximate - exact).reshape(annulus.shape), coarse=coarse))
            intensity = annulus.refined(exact.reshape(annulus.shape), coarse=coarse)
            parts.append((np.sum(difference * weights), np.sum(intensity * weights), difference.max(), intensity.max()))
        absolute, power, largest, brightest = np.array(parts).T
        # The image point itself does not lie between two rings.
        return cls(
            absolute=np.cumsum(absolute),
            power=np.cumsum(power),
            largest=np.maximum.accumulate(np.maximum(largest, abs(fresnel[0] - kirchhoff[0]))),
            brightest=np.maximum.accumulate(np.maximum(brightest, kirchhoff[0])),
        )

    @property
    def measures(self) -> FloatArray:
        """L1 and largest difference, shape (2, windows)."""
        return np.stack([self.absolute / self.power, self.largest / self.brightest])


def _compared(annuli: list[_Annulus], fresnel: ApertureField, kirchhoff: ApertureField) -> PsfDifference:
    """All measures from the fine grid, with errors from the coarse one and the stated errors."""
    exact, approximate = kirchhoff.intensity, fresnel.intensity
    fine, coarse = (_Sums.of(annuli, approximate, exact, coarse=coarse) for coarse in (False, True))
    (l1, largest), (l1_change, largest_change) = fine.measures, np.abs(fine.measures - coarse.measures)
    stated = [pattern.error.intensity * float(np.linalg.norm(pattern.intensity)) for pattern in (fresnel, kirchhoff)]
    # A numerical error of L2 norm ‖δI‖ over n targets, spread evenly over the window A: ∫|δI| dA = A ‖δI‖/√n.
    outer = np.array([annulus.edges[-1] for annulus in annuli])
    spread = math.pi * outer**2 / np.sqrt(np.cumsum([math.prod(annulus.shape) for annulus in annuli]))
    centre, peak = float(exact[0]), abs(float(approximate[0] - exact[0])) / float(exact[0])
    return PsfDifference(
        peak=np.full_like(l1, peak),
        l1=l1,
        largest=largest,
        peak_error=np.full_like(l1, (stated[0] + stated[1] * (1 + peak)) / centre),
        l1_error=l1_change + (stated[0] + stated[1] * (1 + l1)) * spread / fine.power,
        largest_error=largest_change + (stated[0] + stated[1] * (1 + largest)) / fine.brightest,
    )
