"""Record the light on pixels as the sensor does: as electrons or digital numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.parts import Sensor
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.light import Light, SensorNoise, SensorNoiseModel, mean_electrons
from tradestudy.optics.arrays import FloatArray

MosaicPattern = Literal["RGGB", "BGGR", "GRBG", "GBRG"]


@dataclass(frozen=True, kw_only=True)
class Mosaic:
    """A Bayer mosaic.

    Parameters
    ----------
    pattern
        Colours of the first two pixels of the first row, then of the second.
    response
        Electrons of red, green and blue pixels relative to a pixel without a filter.
    """

    pattern: MosaicPattern
    response: tuple[float, float, float]

    def colors(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> NDArray[np.intp]:
        """Colour of pixels: 0 red, 1 green, 2 blue."""
        numbers = np.array(["RGB".index(letter) for letter in self.pattern])
        return np.asarray(numbers[2 * (rows % 2) + columns % 2])


@dataclass(frozen=True, kw_only=True)
class Recording:
    """How the sensor records light.

    Parameters
    ----------
    light
        Light and exposure of the scene.
    noise
        Read noise, full well and bits.
    model
        Which noise terms to include; with quantisation the output is digital numbers, otherwise electrons.
    black_level
        Electrons added before digitising, so that noise in dark areas is not clipped.
    pixel_fill
        Width of the light-sensitive square relative to the pitch; the declared electrons of a pixel include it.
    mosaic
        Mosaic of colour filters, or None.

    Raises
    ------
    OutOfRangeError
        The black level is negative or not below the full well.
    """

    light: Light
    noise: SensorNoise
    model: SensorNoiseModel
    black_level: float = 0.0
    pixel_fill: float = 1.0
    mosaic: Mosaic | None = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.black_level < self.noise.full_well_electrons:
            raise OutOfRangeError(
                "black level",
                value=f"{self.black_level:g} e",
                limit=f"0 e to below the full well, {self.noise.full_well_electrons:g} e",
            )

    @property
    def electrons_per_number(self) -> float:
        """One step of the digitiser [electrons]."""
        return self.noise.step_electrons

    @property
    def saturation_electrons(self) -> float:
        """Mean electrons at which a pixel saturates: its full well, or fewer if digital numbers end earlier."""
        if not self.is_digital:
            return self.noise.full_well_electrons
        top = 2.0**self.noise.bits * self.electrons_per_number - self.black_level
        return min(self.noise.full_well_electrons, top)

    @property
    def is_digital(self) -> bool:
        """Whether the output is digital numbers."""
        return self.model == "shot+read+quantisation"

    def electrons_at_f1(self, sensor: Sensor) -> float:
        """Mean electrons of a pixel at f/1 on the axis."""
        return float(mean_electrons(self.light, 1.0, sensor.pixel_pitch))

    def record(self, expected: FloatArray, rng: np.random.Generator) -> NDArray[Any]:
        """The output of pixels for expected electrons: float32 electrons, or unsigned digital numbers.

        A pixel holds at most its full well, which is also the top of the digitised range; the bottom is 0.
        """
        noise = self.noise
        electrons = expected if self.model == "off" else rng.poisson(expected).astype(float)
        electrons = np.minimum(electrons, noise.full_well_electrons)
        if "read" in self.model:
            electrons = electrons + rng.normal(0.0, noise.read_noise_electrons, expected.shape)
        if not self.is_digital:
            return np.asarray(electrons, np.float32)
        numbers = np.rint((electrons + self.black_level) / self.electrons_per_number)
        kind = np.uint16 if noise.bits <= 16 else np.uint32
        return np.asarray(np.clip(numbers, 0, 2.0**noise.bits - 1), kind)
