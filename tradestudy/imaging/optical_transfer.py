"""Combined transfer function of all lenses of a camera, each by its chosen model, over the chosen spectrum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, assert_never

import numpy as np

from tradestudy.cameras.picture_geometry import LensStage, PictureGeometry
from tradestudy.imaging.kirchhoff import kirchhoff_transfers, lattice_points
from tradestudy.imaging.models import DefocusModel, DiffractionModel, PictureModels, PictureSettings
from tradestudy.imaging.transfer import airy_transfer, disc_transfer, fresnel_transfer
from tradestudy.optics.arrays import BoolArray, FloatArray

if TYPE_CHECKING:
    from tradestudy.imaging.kirchhoff import LatticePoint

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
        transfer = np.zeros((error.size, max(one.shape[1] for one in products)))
        for one in products:
            transfer[:, : one.shape[1]] += one
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
