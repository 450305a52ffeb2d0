"""Combined transfer function of all lenses of a camera, each by its chosen model, over the chosen spectrum.

The correction to Fresnel's transfer function is computed on a lattice and interpolated: over defocus if the plane is
fixed, over the logarithm of the plane's distance if it follows the image. The lattice does not depend on the requested
distances, so the result at one distance does not depend on the others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import TYPE_CHECKING, assert_never

import numpy as np

from tradestudy.cameras.picture_geometry import LensStage, PictureGeometry
from tradestudy.imaging.models import DefocusModel, DiffractionModel, PictureModels, PictureSettings
from tradestudy.imaging.transfer import airy_transfer, disc_transfer, fresnel_transfer
from tradestudy.optics.arrays import BoolArray, FloatArray, lagrange_weights
from tradestudy.optics.axial_spot import axial_fresnel_spot, axial_kirchhoff_spot
from tradestudy.optics.quadrature import gauss_legendre

if TYPE_CHECKING:
    from tradestudy.optics.propagation.lens import LensPhase

    LatticePoint = tuple[float, float, float, float, float, LensPhase]  # arguments of `kirchhoff_correction`


# A point source beyond this distance [m] is as good as at infinity, and paths are still exact.
FARTHEST = 1e6
_PERIODS = 12
_PERIODS_PER_PANEL = 4
_NODES_PER_PANEL = 16
_FREQUENCIES = 97
# Settings of the lattice.
_POINTS = 4
_WAVES = 0.1
_LOG_PLANE = 0.05
_IN_FOCUS_WAVES = 1e-6


def correction_at(correction: FloatArray, share: FloatArray) -> FloatArray:
    """Interpolate corrections of `kirchhoff_correction` at fractions of the cut-off; 0 above it, within the error.

    One correction, shape (97,), is evaluated at fractions of any shape; of several, shape (n, 97), each is evaluated at
    its own row of fractions. The cubic spline is that of `scipy.interpolate.CubicSpline`, which takes longer to load
    than most plans to make.
    """
    corrections = np.atleast_2d(correction)
    bends = corrections @ _bends()
    place = np.minimum(share, 1.0) * (_FREQUENCIES - 1)
    interval = np.minimum(place.astype(np.intp), _FREQUENCIES - 2)
    row = np.arange(len(corrections))[:, np.newaxis]
    b = place - interval
    a = 1.0 - b
    cubic = a * corrections[row, interval] + b * corrections[row, interval + 1]
    cubic += (a**3 - a) * bends[row, interval] + (b**3 - b) * bends[row, interval + 1]
    return np.where(share < 1.0, cubic, 0.0).reshape(share.shape)


@cache
def _bends() -> FloatArray:
    """Matrix, applied from the right, from corrections to h²/6 times the second derivatives of their splines.

    At spacing h, Dᵢ₋₁ + 4 Dᵢ + Dᵢ₊₁ is the second difference of the correction; the first two intervals, and the last
    two, share one cubic.
    """
    neighbours = np.eye(_FREQUENCIES, k=1) + np.eye(_FREQUENCIES, k=-1)
    of_bends, of_values = neighbours + 4.0 * np.eye(_FREQUENCIES), neighbours - 2.0 * np.eye(_FREQUENCIES)
    of_bends[0, :3] = of_bends[-1, -3:] = 1.0, -2.0, 1.0
    of_values[[0, -1]] = 0.0
    return np.asarray(np.linalg.solve(of_bends, of_values).T, np.float64)


@lru_cache(maxsize=2**15)  # a kilobyte each
def kirchhoff_correction(
    wavelength: float, aperture: float, focal_length: float, distance: float, plane: float, lens_phase: LensPhase
) -> tuple[FloatArray, float]:
    """Kirchhoff's transfer function minus Fresnel's at 97 evenly spaced fractions of the cut-off, and its error.

    The transfer function is ``2π ∫ I(r) J₀(2π ν r) r dr`` over the spot of a point on the axis. The spot falls off as
    1/r³, so its transform converges slowly; but Fresnel's spot has the same tail, and its transform is one smooth
    integral. Therefore only the difference of the two spots is transformed, over the geometric blur and 12 periods λ N.
    The error is that of the spot plus the larger of two: the contribution of its outer half, and the change due to
    normalisation.
    """
    from scipy.special import j0

    N, waves = plane / aperture, aperture**2 / 8.0 * abs(1.0 / focal_length - 1.0 / distance - 1.0 / plane) / wavelength
    period, blur = wavelength * N, 8.0 * wavelength * N * waves
    frequency = np.linspace(0.0, 1.0 / period, _FREQUENCIES)
    fresnel = fresnel_transfer(frequency, wavelength, N, blur)
    periods = math.ceil(0.6 * blur / period) + _PERIODS
    panels = math.ceil(periods / _PERIODS_PER_PANEL)
    panel = periods / panels * period
    t, w = gauss_legendre(_NODES_PER_PANEL)
    r = (np.arange(panels)[:, np.newaxis] + t).ravel() * panel
    weight = 2.0 * np.pi * r * np.tile(w, panels) * panel
    spot, of_spot = axial_kirchhoff_spot(
        r,
        wavelength=wavelength,
        aperture_diameter=aperture,
        focal_length=focal_length,
        object_distance=distance,
        plane_distance=plane,
        lens_phase=lens_phase,
    )
    difference = spot - axial_fresnel_spot(
        r, wavelength=wavelength, aperture_diameter=aperture, plane_distance=plane, defocus_waves=waves
    )
    terms = j0(2.0 * np.pi * np.outer(frequency, r)) * (weight * difference)
    correction = terms.sum(axis=1)
    outer = float(np.max(np.abs(terms[:, r > r[-1] / 2.0].sum(axis=1))))
    # At frequency 0, a transfer function is 1; what is missing there lies beyond the radii of this sum.
    at_zero = 1.0 + float(correction[0])
    normalised = (fresnel + correction) / at_zero - fresnel
    normalised.setflags(write=False)
    return normalised, max(outer, abs(at_zero - 1.0)) + of_spot


def kirchhoff_transfers(
    frequency: FloatArray,
    *,
    wavelength: float,
    aperture_diameter: float,
    focal_length: FloatArray,
    plane_distance: FloatArray,
    defocus_waves: FloatArray,
    lens_phase: LensPhase,
    interpolated: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """Transfer function by Kirchhoff's integral, ``2π ∫ I(r) J₀(2π ν r) r dr``, interpolated between planes or defoci.

    Parameters
    ----------
    frequency
        ν ≥ 0 [cycles/m] in the plane, shape (distances, frequencies).
    wavelength, aperture_diameter
        λ, and the diameter of the lens [m].
    lens_phase
        ``perfect`` or ``parabolic``; see `CircularLens`.
    focal_length, plane_distance
        [m], shape (distances,).
    defocus_waves
        Path error at the rim ``A²/8 (1/a + 1/b − 1/f)/λ``, signed; 0 is the point on which the plane is focused. A
        negative object distance a means light that converges towards a point behind the lens; a point beyond 1000 km
        counts as infinitely far away.
    interpolated
        Whether to interpolate on the lattice, which many distances share; a few distances are faster one by one.

    Returns
    -------
    tuple
        Transfer function, 1 at frequency 0, shape (distances, frequencies), and its error, shape (distances,): that of
        the lattice points plus the difference of cubic and parabolic interpolation. NaN where a length is NaN.

    Raises
    ------
    TradestudyError
        The lens phase is unknown, or a point needs more nodes than are allowed.
    """
    value, error = np.full_like(frequency, np.nan), np.full(len(frequency), np.nan)
    lengths = np.stack(np.broadcast_arrays(focal_length, plane_distance, defocus_waves))
    known = np.isfinite(lengths).all(axis=0)
    if not known.any():
        return value, error
    nu, (_, plane, waves) = frequency[known], lengths[:, known]
    N = plane[:, np.newaxis] / aperture_diameter
    fresnel = fresnel_transfer(nu, wavelength, N, 8.0 * wavelength * N * np.abs(waves)[:, np.newaxis])
    share = wavelength * N * nu
    if not interpolated:
        exact = [
            kirchhoff_correction(*_point(wavelength, aperture_diameter, f, b, w, lens_phase))
            for f, b, w in lengths[:, known].T.tolist()
        ]
        value[known] = fresnel + correction_at(np.array([table for table, _ in exact]), share)
        error[known] = [off for _, off in exact]
        return value, error
    lattice = [
        [kirchhoff_correction(*point) for point in _points_around(wavelength, aperture_diameter, f, b, w, lens_phase)]
        for f, b, w in lengths[:, known].T.tolist()
    ]
    tables = np.array([[table for table, _ in around] for around in lattice])
    place = _place(plane, waves)
    since_first = place - np.floor(place) + 1.0
    nodes = np.arange(_POINTS, dtype=np.float64)
    cubic = np.einsum("dp,dps->ds", lagrange_weights(nodes, since_first), tables)
    parabola = np.einsum("dp,dps->ds", lagrange_weights(nodes[:-1], since_first), tables[:, :-1])
    value[known] = fresnel + correction_at(cubic, share)
    error[known] = np.array([max(off for _, off in around) for around in lattice]) + np.max(
        np.abs(cubic - parabola), axis=1
    )
    return value, error


def lattice_points(
    *,
    wavelength: float,
    aperture_diameter: float,
    focal_length: FloatArray,
    plane_distance: FloatArray,
    defocus_waves: FloatArray,
    lens_phase: LensPhase,
) -> tuple[LatticePoint, ...]:
    """Arguments of every `kirchhoff_correction` that `kirchhoff_transfers` needs for one lens, without duplicates."""
    lengths = np.stack(np.broadcast_arrays(focal_length, plane_distance, defocus_waves), axis=1)
    points = {
        point: None
        for f, plane, waves in lengths[np.isfinite(lengths).all(axis=1)].tolist()
        for point in _points_around(wavelength, aperture_diameter, f, plane, waves, lens_phase)
    }
    return tuple(points)


def _points_around(
    wavelength: float, aperture: float, focal_length: float, plane: float, waves: float, lens_phase: LensPhase
) -> tuple[LatticePoint, ...]:
    """The lattice points between which a transfer function is interpolated, in order."""
    first = math.floor(_place(np.asarray(plane), np.asarray(waves))) - 1
    points = []
    for j in range(first, first + _POINTS):
        b, w = (plane, j * _WAVES) if _is_fixed(np.asarray(waves)) else (math.exp(j * _LOG_PLANE), 0.0)
        points.append(_point(wavelength, aperture, focal_length, b, w, lens_phase))
    return tuple(points)


def _point(
    wavelength: float, aperture: float, focal_length: float, plane: float, waves: float, lens_phase: LensPhase
) -> LatticePoint:
    """Arguments of `kirchhoff_correction` for a plane out of focus by a number of waves."""
    inverse = 1.0 / focal_length - 1.0 / plane + 8.0 * wavelength * waves / aperture**2
    distance = math.copysign(1.0 / max(abs(inverse), 1.0 / FARTHEST), inverse)
    return wavelength, aperture, focal_length, distance, plane, lens_phase


def _is_fixed(defocus_waves: FloatArray) -> BoolArray:
    """Whether the plane is fixed and out of focus, instead of following the image."""
    return np.asarray(np.abs(defocus_waves) > _IN_FOCUS_WAVES)


def _place(plane_distance: FloatArray, defocus_waves: FloatArray) -> FloatArray:
    """Position on the lattice, in lattice steps."""
    along_plane = np.log(plane_distance) / _LOG_PLANE
    return np.asarray(np.where(_is_fixed(defocus_waves), defocus_waves / _WAVES, along_plane))


_MOST_BLUR_OF_WAVES = 200.0


@dataclass(frozen=True, kw_only=True, eq=False)
class LensTransfers:
    """Transfer function of the lenses, without the pixel, for any models; that of each lens is computed once.

    Parameters
    ----------
    geometry, settings
        The picture and its light.
    frequency_px
        |ν| [cycles/sample], shape (frequencies,); increasing after the first ``always``.
    always
        Number of leading frequencies that are always computed; the others are computed only below the cut-off, beyond
        which the transfer is exactly 0.
    interpolated
        See `kirchhoff_transfers`.
    """

    geometry: PictureGeometry
    settings: PictureSettings
    frequency_px: FloatArray
    always: int
    interpolated: bool = True
    _products: dict[tuple[str, ...], tuple[FloatArray, FloatArray]] = field(default_factory=dict, init=False)
    _known: dict[tuple[LensStage, float, DiffractionModel, DefocusModel], tuple[FloatArray, FloatArray]] = field(
        default_factory=dict, init=False
    )
    _passing: dict[tuple[LensStage, float], int] = field(default_factory=dict, init=False)

    def product(self, models: PictureModels) -> tuple[FloatArray, FloatArray]:
        """Transfer function, shape (distances, leading frequencies), and its error over distance.

        With the model ``weighted``, it is the mean over the spectrum of the product of all stages; thin lenses focus
        all colours alike.
        """
        key = (models.main_lens_diffraction, models.microlens_diffraction, models.defocus_blur, models.spectrum)
        if key in self._products:
            return self._products[key]
        spectrum = _light_of(self.settings, models)
        total = sum(weight for _, weight in spectrum)
        error = np.zeros(self.geometry.distance.size)
        products = []
        for wavelength, weight in spectrum:
            passed, off = self._at(wavelength, models)
            products.append(weight / total * passed)
            error += weight / total * off
        transfer = np.zeros((error.size, max(product.shape[1] for product in products)))
        for product in products:
            transfer[:, : product.shape[1]] += product
        self._products[key] = transfer, error
        return transfer, error

    def _at(self, wavelength: float, models: PictureModels) -> tuple[FloatArray, FloatArray]:
        """The product of all stages in light of one wavelength, and its error."""
        transfer, error = self._of_stage(
            self.geometry.main_lens, wavelength, models.main_lens_diffraction, models.defocus_blur
        )
        if self.geometry.microlens is None:
            return transfer, error
        second, off = self._of_stage(
            self.geometry.microlens, wavelength, models.microlens_diffraction, models.defocus_blur
        )
        reach = min(transfer.shape[1], second.shape[1])
        return transfer[:, :reach] * second[:, :reach], error + off

    def _of_stage(
        self, stage: LensStage, wavelength: float, model: DiffractionModel, defocus: DefocusModel
    ) -> tuple[FloatArray, FloatArray]:
        key = (stage, wavelength, model, defocus)
        if key not in self._known:
            columns = self.frequency_px.size if model == "off" else self._below_cutoff(stage, wavelength)
            frequency = self.frequency_px[:columns] / self.geometry.sample_pitch
            self._known[key] = _stage_transfer(
                stage, model, defocus, self.settings, wavelength, frequency, interpolated=self.interpolated
            )
        return self._known[key]

    def _below_cutoff(self, stage: LensStage, wavelength: float) -> int:
        """Number of frequencies that pass at any of the distances."""
        key = (stage, wavelength)
        if key not in self._passing:
            cutoff = self.geometry.sample_pitch / stage.finest_period(wavelength)
            self._passing[key] = self.always + int(np.searchsorted(self.frequency_px[self.always :], cutoff))
        return self._passing[key]


def _stage_transfer(
    stage: LensStage,
    model: DiffractionModel,
    defocus: DefocusModel,
    settings: PictureSettings,
    wavelength: float,
    frequency: FloatArray,
    *,
    interpolated: bool,
) -> tuple[FloatArray, FloatArray]:
    """Transfer function of one lens at frequencies on the sensor [cycles/m], and its error over distance.

    One that is the same at all distances has a single row.
    """
    relay, N, blur = stage.columns
    nu, blur = frequency * relay, blur if defocus == "disc" else np.zeros((1, 1))
    exact = np.zeros(stage.relay.size)
    blurred = np.any(blur != 0.0)
    by_rays = is_by_rays(blur, wavelength, N)
    match model:
        case "off":
            return (disc_transfer(nu, blur) if blurred else np.ones_like(nu)), exact
        case "airy":
            spread = airy_transfer(nu, wavelength, N)
            return (spread * disc_transfer(nu, blur) if blurred else spread), exact
        case "fresnel":
            value, error = fresnel_transfer(nu, wavelength, N, np.where(by_rays, 0.0, blur)), exact
        case "kirchhoff":
            value, error = kirchhoff_transfers(
                np.broadcast_to(nu, (exact.size, frequency.size)),
                wavelength=wavelength,
                aperture_diameter=stage.aperture_diameter,
                focal_length=stage.focal_length,
                plane_distance=stage.plane_distance,
                defocus_waves=_waves(stage, wavelength, defocus),
                lens_phase=settings.lens_phase,
                interpolated=interpolated,
            )
        case _:
            assert_never(model)
    if not np.any(by_rays):
        return value, error
    # Where rays replace waves, the disc of rays blurs the spot that the lens would have in focus.
    spot_over_blur = wavelength * N / np.where(by_rays, blur, np.inf)
    return value * np.where(by_rays, disc_transfer(nu, blur), 1.0), error + 0.2 * np.sqrt(spot_over_blur)[:, 0]


def kirchhoff_points(
    geometry: PictureGeometry, settings: PictureSettings, models: PictureModels
) -> tuple[LatticePoint, ...]:
    """Arguments of every `kirchhoff_correction` that a picture needs; empty if no model is ``kirchhoff``."""
    stages = ((geometry.main_lens, models.main_lens_diffraction), (geometry.microlens, models.microlens_diffraction))
    return tuple(
        point
        for stage, model in stages
        if stage is not None and model == "kirchhoff"
        for wavelength, _ in _light_of(settings, models)
        for point in lattice_points(
            wavelength=wavelength,
            aperture_diameter=stage.aperture_diameter,
            focal_length=stage.focal_length,
            plane_distance=stage.plane_distance,
            defocus_waves=_waves(stage, wavelength, models.defocus_blur),
            lens_phase=settings.lens_phase,
        )
    )


def _light_of(settings: PictureSettings, models: PictureModels) -> Sequence[tuple[float, float]]:
    """Wavelengths [m] and their weights."""
    return settings.spectrum if models.spectrum == "weighted" else ((settings.wavelength, 1.0),)


def _waves(stage: LensStage, wavelength: float, defocus: DefocusModel) -> FloatArray:
    """Defocus [waves] for the wave models; 0 in focus, and where rays replace waves."""
    by_waves = ~is_by_rays(stage.blur_diameter, wavelength, stage.f_number)
    counts = (stage.blur_diameter != 0.0) & by_waves & (defocus == "disc")
    return np.where(counts, stage.defocus(wavelength), 0.0)


def is_by_rays(blur: FloatArray, wavelength: float, f_number: FloatArray) -> BoolArray:
    """Where the blur c is so large that rays err by less than 0.2 √(λN/c) and waves would need too many nodes."""
    return np.asarray(blur > _MOST_BLUR_OF_WAVES * wavelength * f_number)
