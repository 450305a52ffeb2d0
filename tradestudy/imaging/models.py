"""Settings and models of a picture: light, noise, texture, matching window, matcher, and the physics to include."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, assert_never

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.parts import require_positive
from tradestudy.cameras.picture_geometry import MatchedWindow, PictureGeometry, column
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.transfer import airy_transfer, disc_transfer
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.quadrature import gauss_legendre
from tradestudy.units import FRACTION, pretty, significant
from tradestudy.wording import listed

# Nodes of the integral over a neighbour's light.
_LEAST_NODES: Final = 32
_NODES_PER_CYCLE: Final = 3  # for each cycle of the product of Bessel functions
_LEAST_WINDOW_PX: Final = 1e-3  # acts as a point
_STEP: Final = 32  # node counts are multiples of this, so that few rules serve all pictures

SensorNoiseModel = Literal["off", "shot", "shot+read", "shot+read+quantisation"]


@dataclass(frozen=True, kw_only=True)
class Light:
    """Light and exposure of a scene, as the electrons that a pixel collects at mean radiance.

    Parameters
    ----------
    electrons
        Mean electrons per pixel at `f_number`, on the axis.
    f_number
        Image distance over pupil diameter to which `electrons` refers.
    pixel_pitch
        Pitch [m] of the pixel to which `electrons` refers, so that larger pixels collect more; None: every pixel
        collects `electrons`, regardless of its size.

    Raises
    ------
    OutOfRangeError
        A value is not above zero.
    """

    electrons: float
    f_number: float
    pixel_pitch: float | None = None

    def __post_init__(self) -> None:
        require_positive("electrons", self.electrons, "e")
        require_positive("f-number of the light", self.f_number, "")
        if self.pixel_pitch is not None:
            require_positive("pixel pitch of the light", self.pixel_pitch)


@dataclass(frozen=True, kw_only=True)
class SensorNoise:
    """Noise, saturation and digitisation of a sensor.

    Parameters
    ----------
    read_noise_electrons
        Standard deviation of one reading.
    full_well_electrons
        Electrons at which a pixel saturates.
    bits
        Bits of a raw value.
    gain
        K: digital numbers for each electron; None: the full well fills the range of the digitiser.

    Raises
    ------
    OutOfRangeError
        A value is outside its range.
    """

    read_noise_electrons: float
    full_well_electrons: float
    bits: int
    gain: float | None = None

    @property
    def step_electrons(self) -> float:
        """One step of the digitiser [electrons]: 1/K, or full well / 2^bits."""
        return self.full_well_electrons / 2.0**self.bits if self.gain is None else 1.0 / self.gain

    def __post_init__(self) -> None:
        if self.gain is not None:
            require_positive("system gain", self.gain, "DN/e")
        require_positive("full well", self.full_well_electrons, "e")
        if not (math.isfinite(self.read_noise_electrons) and self.read_noise_electrons >= 0.0):
            raise OutOfRangeError("read noise", value=f"{self.read_noise_electrons:g} e", limit="0 e or more")
        if not 1 <= self.bits <= 32:
            raise OutOfRangeError("bits of a raw value", value=str(self.bits), limit="1 … 32")


def mean_electrons(light: Light, f_number: ArrayLike, pixel_pitch: float, illumination: ArrayLike = 1.0) -> FloatArray:
    """Mean electrons per pixel at fixed light: ``n = n₀ (N₀/N)² (p/p₀)² V``.

    Parameters
    ----------
    light
        Light and exposure of the scene.
    f_number
        Working f-number N = b/A = N_∞ (1 + m) of the cone that reaches the pixel.
    pixel_pitch
        p [m].
    illumination
        Relative illumination V at the field position; see `field_illumination`.
    """
    area = 1.0 if light.pixel_pitch is None else (pixel_pitch / light.pixel_pitch) ** 2
    ratio = light.f_number / np.asarray(f_number, dtype=np.float64)
    return np.asarray(light.electrons * area * np.square(ratio) * np.asarray(illumination))


def noise_variance(electrons: ArrayLike, sensor: SensorNoise, model: SensorNoiseModel) -> FloatArray:
    """Variance of one pixel [electrons²]: those terms of ``n + σ_r² + q²/12`` that the model includes.

    Parameters
    ----------
    electrons
        Mean electrons n. Shot noise is evaluated at the mean, which is correct on average over the texture.
    sensor
        Read noise σ_r and step q of the digitiser.
    model
        Which of the three terms to include.

    Notes
    -----
    Quantisation is treated as uniform, independent noise. This holds if the other noise exceeds about half a step; with
    less, the errors of neighbouring pixels are correlated and the bound is too optimistic.
    """
    n = np.asarray(electrons, dtype=np.float64)
    read_noise = np.full_like(n, sensor.read_noise_electrons**2)
    match model:
        case "off":
            return np.zeros_like(n)
        case "shot":
            return n
        case "shot+read":
            return n + read_noise
        case "shot+read+quantisation":
            return n + read_noise + sensor.step_electrons**2 / 12.0
        case _:
            assert_never(model)


def field_illumination(field_angle: float, *, pupil_diameter: float, stop_separation: float) -> float:
    """Illumination relative to that on the axis: ``cos⁴θ · (2/π)(arccos s − s √(1 − s²)), s = L tan θ / A``.

    The fourth power of the cosine holds for a lens whose pupil looks the same from all field positions; the other
    factor is the fraction of the pupil's area that two equal round stops leave. At 32.5° off the axis, cos⁴θ is 0.506.

    Parameters
    ----------
    field_angle
        θ between chief ray and axis [rad], from 0 to below 90°.
    pupil_diameter
        A [m].
    stop_separation
        L [m] between pupil and the second stop, along the axis; 0: no second stop.

    Raises
    ------
    OutOfRangeError
        The angle or a length is outside its range.
    """
    s = 1.0 - radial_pupil_width(field_angle, pupil_diameter=pupil_diameter, stop_separation=stop_separation)
    return math.cos(field_angle) ** 4 * (2.0 / math.pi) * (math.acos(s) - s * math.sqrt(1.0 - s * s))


def radial_pupil_width(field_angle: float, *, pupil_diameter: float, stop_separation: float) -> float:
    """Width of the pupil along the field's radius, relative to its diameter: ``1 − s, s = L tan θ / A``, at least 0.

    The pupil is the overlap of two equal round stops. Its tangential width, √(1 − s²), is the larger one. Widths are
    measured in the plane of the pupil; seen along the ray, the radial one is foreshortened by cos θ, 0.843 at 32.5°,
    which `field_illumination` includes.

    Parameters and errors as for `field_illumination`.
    """
    require_field_and_stops(field_angle, stop_separation)
    return 1.0 - min(stop_separation * math.tan(field_angle) / pupil_diameter, 1.0)


def require_field_and_stops(field_angle: float, stop_separation: float) -> None:
    """Refuse angles and lengths outside their range, as `field_illumination` does.

    Raises
    ------
    OutOfRangeError
        The angle is outside 0° to below 90°, or the separation is negative or not finite.
    """
    if not 0.0 <= field_angle < math.pi / 2.0:
        raise OutOfRangeError("field angle", value=f"{math.degrees(field_angle):g}°", limit="0° to below 90°")
    if not (math.isfinite(stop_separation) and stop_separation >= 0.0):
        raise OutOfRangeError("separation of the stops", value=f"{stop_separation:g} m", limit="0 m or more")


def neighbours_share(
    geometry: PictureGeometry, wavelength: float, window: MatchedWindow, *, blurred: bool
) -> FloatArray:
    """Fraction of the light in a window that comes from neighbouring microlenses, over distance; 0 without microlenses.

    Diffraction and blur spread the light of every microlens beyond its own micro-image, a disc of radius R; in a
    uniform scene, as much light arrives from the neighbours as is lost to them. The average is over the window,
    represented by a disc of equal area with radius a, whose centre is at c from that of the micro-image:

    ``1 − (2 R/a) ∫₀^{1/λN} H(ν) J₁(2π R ν) J₁(2π a ν) J₀(2π c ν) dν/ν``,

    where H is the transfer function of Airy pattern and blur.

    Parameters
    ----------
    geometry
        The picture.
    wavelength
        [m].
    window
        The matched window, halfway between the centres of two micro-images and no larger than their overlap.
    blurred
        Whether the geometric blur spreads light too.
    """
    lens = geometry.microlens
    if lens is None:
        return np.zeros_like(geometry.distance)
    from scipy.special import j0, j1

    R = geometry.micro_image_diameter / 2.0
    # Quantities that are the same at all distances are computed once.
    a = column(np.maximum(window.side_px, _LEAST_WINDOW_PX) * geometry.sample_pitch / math.sqrt(math.pi))
    c = column(window.apart_px / 2.0 * geometry.sample_pitch)
    _, N, blur = lens.columns
    blur = blur if blurred else np.zeros((1, 1))
    cutoff = 1.0 / (wavelength * N)
    cycles = 2.0 * R * float(np.nanmax(cutoff, initial=0.0))
    t, w = gauss_legendre(_STEP * math.ceil((_LEAST_NODES + _NODES_PER_CYCLE * cycles) / _STEP))
    nu = cutoff * t
    unblurred = w / t * airy_transfer(nu, wavelength, N) * j1(2.0 * np.pi * R * nu) * j1(2.0 * np.pi * a * nu)
    unblurred = unblurred * j0(2.0 * np.pi * c * nu)
    own_light = 2.0 * R / a * np.sum(unblurred * disc_transfer(nu, blur), axis=1, keepdims=True)
    return np.broadcast_to(1.0 - own_light, (geometry.distance.size, 1))[:, 0]


@dataclass(frozen=True, kw_only=True)
class Matcher:
    """A matcher, described by what it adds to the Cramér–Rao bound σ_b: ``σ² = (k σ_b)² + f² + A²/2``.

    Pixel locking is a systematic bias ``A sin(2π d + φ)`` of the disparity d [samples]. Its phase φ is unknown, so in a
    single measurement its mean square A²/2 adds like normal noise; but it is the same for all measurements at one
    distance, so averaging them does not reduce it. A false match measures nothing: it counts as a failed measurement,
    and the depth uncertainty is that of the true matches.

    Parameters
    ----------
    factor
        k: noise relative to the bound, 1 or more.
    floor
        f: standard deviation of the noise that no amount of light reduces [samples].
    pixel_locking
        A: amplitude of the bias [samples], at most half a sample.
    false_matches
        Fraction of all matches that are false, from 0 to below 1.

    Raises
    ------
    OutOfRangeError
        A value is outside its range.
    """

    factor: float = 1.0
    floor: float = 0.0
    pixel_locking: float = 0.0
    false_matches: float = 0.0

    def __post_init__(self) -> None:
        for name, value, limit, holds in (
            ("noise of a matcher relative to its bound", self.factor, "1 or more", 1.0 <= self.factor < math.inf),
            ("floor of a matcher's noise", self.floor, "0 px or more", 0.0 <= self.floor < math.inf),
            ("amplitude of pixel locking", self.pixel_locking, "from 0 to 0.5 px", 0.0 <= self.pixel_locking <= 0.5),
            ("share of false matches", self.false_matches, "from 0 to below 1", 0.0 <= self.false_matches < 1.0),
        ):
            if not holds:
                raise OutOfRangeError(name, value=f"{value:g}", limit=limit)

    @property
    def words(self) -> str:
        """What the matcher adds to the bound, as the end of a sentence; empty if nothing."""
        rms = significant(self.pixel_locking / math.sqrt(2.0))
        parts = {
            f"noise {significant(self.factor)} times the bound": self.factor != 1.0,
            f"a floor of {significant(self.floor)} px": self.floor != 0.0,
            f"pixel locking of {significant(self.pixel_locking)} px ({rms} px rms)": self.pixel_locking != 0.0,
            f"{pretty(self.false_matches, FRACTION)} false matches": self.false_matches != 0.0,
        }
        return listed([words for words, applies in parts.items() if applies])

    @property
    def beside(self) -> float:
        """The error that adds to any bound in quadrature [samples]: floor and rms pixel locking."""
        return math.hypot(self.floor, self.pixel_locking / math.sqrt(2.0))

    def error_px(self, bound: ArrayLike) -> FloatArray:
        """Standard deviation of one disparity [samples] for a given bound; infinite for an infinite bound."""
        return np.hypot(self.factor * np.asarray(bound, dtype=np.float64), self.beside)

    def numerical_error_px(self, bound: ArrayLike, error: ArrayLike) -> FloatArray:
        """Numerical error of `error_px` [samples] due to that of the bound, to first order."""
        return np.asarray(self.factor * self._weights(bound)[0] * np.asarray(error, dtype=np.float64))

    def change(self, bound: ArrayLike, factor: ArrayLike) -> FloatArray:
        """The factor by which `error_px` changes if the bound changes by a given factor."""
        by_bound, by_rest = self._weights(bound)
        with np.errstate(invalid="ignore"):  # a zero bound changes by any factor
            combined = np.hypot(by_bound * np.asarray(factor, dtype=np.float64), by_rest)
        return np.where(np.isinf(factor), np.inf, combined)

    def _weights(self, bound: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Parts of `error_px` due to the bound and to the rest, whose squares sum to 1; 1 and 0 if unknown."""
        value, achieved = np.asarray(bound, dtype=np.float64), self.error_px(bound)
        known = np.isfinite(achieved) & (achieved > 0.0)
        total = np.where(known, achieved, 1.0)
        return (
            np.where(known, self.factor * np.where(known, value, 0.0) / total, 1.0),
            np.where(known, self.beside / total, 0.0),
        )


AT_BOUND = Matcher()
"""The ideal matcher, which reaches the bound."""


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
