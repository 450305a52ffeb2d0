"""Settings and models of a picture: its texture, its matching window, and the physics to include."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.parts import require_positive
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.light import Light, SensorNoise, SensorNoiseModel, require_field_and_stops
from tradestudy.optics.arrays import FloatArray

DefocusModel = Literal["off", "disc"]
DiffractionModel = Literal["off", "airy", "fresnel", "kirchhoff"]
CrosstalkModel = Literal["off", "share"]
PixelModel = Literal["off", "square"]
SpectrumModel = Literal["off", "weighted"]
VignettingModel = Literal["off", "cos4"]


@dataclass(frozen=True, kw_only=True)
class Texture:
    """A stationary, isotropic, Gaussian texture whose autocorrelation falls off as ``exp(−r/ℓ)``.

    The exponential is chosen because its spectrum falls off as a power law, ν⁻³ in two dimensions, like those of
    natural surfaces and scenes (amplitude close to 1/ν: D. J. Field, J. Opt. Soc. Am. A 4, 2379, 1987). The spectrum of
    a Gaussian autocorrelation would end so sharply that the answer would depend on where it ends.

    Parameters
    ----------
    contrast
        c: standard deviation of the radiance relative to its mean.
    correlation_length
        ℓ [m] on the object, at which the autocorrelation has fallen to 1/e.

    Raises
    ------
    OutOfRangeError
        A value is not finite and above zero.
    """

    contrast: float
    correlation_length: float

    def __post_init__(self) -> None:
        require_positive("contrast of the texture", self.contrast, "")
        require_positive("correlation length of the texture", self.correlation_length)


def texture_spectrum(frequency: ArrayLike, contrast: ArrayLike, correlation_length: ArrayLike) -> FloatArray:
    """Power spectrum of the relative radiance: ``S(ν) = 2π c² ℓ² (1 + (2π ℓ ν)²)^(−3/2)``.

    Parameters
    ----------
    frequency
        |ν| [cycles per unit of length].
    contrast
        c.
    correlation_length
        ℓ in that unit; in an image of magnification m, ``m ℓ``.

    Returns
    -------
    FloatArray
        Two-sided in the plane, [unit²]: its integral over all frequencies is c².
    """
    length = np.asarray(correlation_length, dtype=np.float64)
    argument = 1.0 + np.square(2.0 * np.pi * length * np.asarray(frequency, dtype=np.float64))
    return np.asarray(2.0 * np.pi * np.square(np.asarray(contrast) * length) / (argument * np.sqrt(argument)))


def share_beyond(frequency: ArrayLike, correlation_length: ArrayLike) -> FloatArray:
    """Fraction of the variance at frequencies above |ν|: ``(1 + (2π ℓ ν)²)^(−1/2)``."""
    return np.asarray(1.0 / np.hypot(1.0, 2.0 * np.pi * np.asarray(correlation_length) * np.asarray(frequency)))


@dataclass(frozen=True, kw_only=True)
class PictureSettings:
    """Scene, light and matching window of a picture.

    Parameters
    ----------
    texture
        Texture of the surface.
    window_px, window_length
        Side of the square matching window, exactly one of: in samples of the picture; or as a length [m] on the object,
        which gives all cameras the same window there. The window never exceeds the overlap of the compared pictures.
    light
        Light and exposure of the scene.
    sensor_noise
        Read noise, full well, bits.
    wavelength
        Wavelength of the picture if the spectrum is `off` [m].
    spectrum
        Wavelengths [m] and weights for the model `weighted`; the weights are normalised.
    field_angle
        Angle of the field position at which light is computed [rad], from 0 to below 90°.
    stop_separation
        Distance between two stops, see `field_illumination` [m]; 0 or more.
    pixel_fill
        Active width of a pixel relative to its pitch, above 0 to 1.
    lens_phase
        Lens of the Kirchhoff model: well corrected (``perfect``), or that of the paper (``parabolic``).

    Raises
    ------
    OutOfRangeError
        A value is outside its range, or not exactly one window is given.
    """

    texture: Texture
    light: Light
    sensor_noise: SensorNoise
    wavelength: float
    window_px: float | None = None
    window_length: float | None = None
    spectrum: tuple[tuple[float, float], ...] = ()
    field_angle: float = 0.0
    stop_separation: float = 0.0
    pixel_fill: float = 1.0
    lens_phase: Literal["perfect", "parabolic"] = "perfect"

    def asked_window(self, magnification: FloatArray, sample_pitch: float) -> FloatArray:
        """Requested side of the window [samples] at the magnification of a picture."""
        if self.window_px is not None:
            return np.full_like(magnification, self.window_px)
        assert self.window_length is not None  # exactly one of the two is given
        return np.asarray(self.window_length * magnification / sample_pitch)

    def __post_init__(self) -> None:
        if (self.window_px is None) == (self.window_length is None):
            raise OutOfRangeError(
                "matching window in pixels and as a length on the object", limit="exactly one of them"
            )
        for name, value, unit in (
            ("window", self.window_px, "px"),
            ("window", self.window_length, "m"),
            ("wavelength", self.wavelength, "m"),
        ):
            if value is not None:
                require_positive(name, value, unit)
        require_field_and_stops(self.field_angle, self.stop_separation)
        for wavelength, weight in self.spectrum:
            require_positive("wavelength", wavelength)
            require_positive("weight of a wavelength", weight, "")
        if not 0.0 < self.pixel_fill <= 1.0:
            raise OutOfRangeError("active width of a pixel", value=f"{self.pixel_fill:g}", limit="above 0 to 1 pitch")


@dataclass(frozen=True, kw_only=True)
class PictureModels:
    """The models of the picture's physics, one for each effect; the first of each effect is the simplest.

    Parameters
    ----------
    defocus_blur
        ``off``: everything in focus. ``disc``: the geometric blur; with ``fresnel`` or ``kirchhoff`` diffraction, the
        corresponding defocus.
    main_lens_diffraction, microlens_diffraction
        ``off``; ``airy``: diffraction in focus, multiplied by the disc; ``fresnel``: the defocused pupil;
        ``kirchhoff``: exact paths and cosines. If the blur exceeds 200 λN, the last two are the disc times their
        transfer function in focus. A camera without a microlens stage accepts only ``off``.
    crosstalk
        ``off``, or ``share``: light of neighbouring microlenses weakens the texture and adds its own texture to the
        noise; no effect without microlenses.
    pixel_integration
        ``off``: one sample at the centre of the pixel. ``square``: the mean over its active area.
    spectrum
        ``off``: a single wavelength. ``weighted``: the mean transfer function over the spectrum.
    vignetting
        ``off``, or ``cos4``: cos⁴ and the stops, at the field angle.
    sensor_noise
        Which noise terms to include.
    """

    defocus_blur: DefocusModel
    main_lens_diffraction: DiffractionModel
    microlens_diffraction: DiffractionModel
    crosstalk: CrosstalkModel
    pixel_integration: PixelModel
    spectrum: SpectrumModel
    vignetting: VignettingModel
    sensor_noise: SensorNoiseModel


def closed_form_models(picture: PictureSettings, *, microlenses: bool) -> PictureModels:
    """The closed-form model of every effect of the picture: the default models of a derived error.

    ``microlenses`` states whether microlenses blur the camera's picture.
    """
    return PictureModels(
        defocus_blur="disc",
        main_lens_diffraction="airy",
        microlens_diffraction="airy" if microlenses else "off",
        crosstalk="share" if microlenses else "off",
        pixel_integration="square",
        spectrum="weighted" if picture.spectrum else "off",
        vignetting="cos4",
        sensor_noise="shot+read+quantisation",
    )
