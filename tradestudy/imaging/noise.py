"""Electrons in a pixel, and their noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, assert_never

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.parts import require_positive
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray

SensorNoiseModel = Literal["off", "shot", "shot+read", "shot+read+quantisation"]


@dataclass(frozen=True, kw_only=True)
class Light:
    """Scene and exposure, as what a pixel collects of the mean radiance.

    Parameters
    ----------
    electrons
        Mean electrons per pixel at `f_number`, on the axis.
    f_number
        Image distance over pupil diameter for which that is so.
    pixel_pitch
        Of such a pixel [m], so that larger pixels collect more; None: every pixel collects that, whatever its size.

    Raises
    ------
    OutOfRangeError
        For values that are not above zero.
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
    """What a sensor adds.

    Parameters
    ----------
    read_noise_electrons
        Standard deviation of one reading.
    full_well_electrons
        Where a pixel saturates; also the top of the scale that is digitised.
    bits
        Of a raw value.

    Raises
    ------
    OutOfRangeError
        For values that a sensor cannot have.
    """

    read_noise_electrons: float
    full_well_electrons: float
    bits: int

    def __post_init__(self) -> None:
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
        Scene and exposure.
    f_number
        Working f-number N = b/A = N_∞ (1 + m) of the cone that reaches the pixel.
    pixel_pitch
        p [m].
    illumination
        Share V that is left at the place in the field; see `field_illumination`.
    """
    area = 1.0 if light.pixel_pitch is None else (pixel_pitch / light.pixel_pitch) ** 2
    ratio = light.f_number / np.asarray(f_number, dtype=np.float64)
    return np.asarray(light.electrons * area * np.square(ratio) * np.asarray(illumination))


def noise_variance(electrons: ArrayLike, sensor: SensorNoise, model: SensorNoiseModel) -> FloatArray:
    """Variance of one pixel [electrons²]: ``n + σ_r² + q²/12``, q = full well / 2^bits, as far as the model goes.

    Parameters
    ----------
    electrons
        Mean electrons n. Shot noise is taken at the mean, which is right in the mean of the variance.
    sensor
        Read noise, full well, bits.
    model
        Which of the three count.

    Notes
    -----
    Quantisation counts as even, independent noise: right where the other noise exceeds about half a step; below, the
    values of neighbouring pixels err together and the bound is too good.
    """
    n = np.asarray(electrons, dtype=np.float64)
    read = np.full_like(n, sensor.read_noise_electrons**2)
    step = sensor.full_well_electrons / 2.0**sensor.bits
    match model:
        case "off":
            return np.zeros_like(n)
        case "shot":
            return n
        case "shot+read":
            return n + read
        case "shot+read+quantisation":
            return n + read + step**2 / 12.0
        case _:
            assert_never(model)
