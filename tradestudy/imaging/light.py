"""Electrons in a pixel and their noise, vignetting, and light from neighbouring microlenses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, assert_never

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.matched_windows import MatchedWindow
from tradestudy.cameras.parts import require_positive
from tradestudy.cameras.picture_geometry import PictureGeometry, column
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.transfer import airy_transfer, disc_transfer
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.quadrature import gauss_legendre

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
    read = np.full_like(n, sensor.read_noise_electrons**2)
    match model:
        case "off":
            return np.zeros_like(n)
        case "shot":
            return n
        case "shot+read":
            return n + read
        case "shot+read+quantisation":
            return n + read + sensor.step_electrons**2 / 12.0
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
    own = 2.0 * R / a * np.sum(unblurred * disc_transfer(nu, blur), axis=1, keepdims=True)
    return np.broadcast_to(1.0 - own, (geometry.distance.size, 1))[:, 0]
