"""The response of a camera to temperature and ambient pressure."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tradestudy.cameras.depth_measurement import Errors, value_of
from tradestudy.cameras.parts import Sensor
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.thin_lens import air_refractive_index, focal_length_change_with_medium


@dataclass(frozen=True, kw_only=True)
class Environment:
    """The ambient conditions in which a camera was calibrated, and its response to changes.

    Parameters
    ----------
    housing_expansion
        Coefficient of linear thermal expansion of the housing [1/K]; 23e-6 for aluminium.
    baseline_expansion
        That of the part that holds the two cameras of a stereo rig apart [1/K].
    array_expansion
        That of a microlens array [1/K].
    scale_expansion
        That of whatever positions in the picture are measured by [1/K]: the pixels of the sensor or, if the centres of
        the microlenses are found again in the pictures, the microlens array.
    focal_length_expansion
        Relative change of the focal length per kelvin [1/K].
    glass_index
        Refractive index of the lens, treated as if made of a single glass; it determines how the surrounding air
        changes the focal length.
    wavelength
        Wavelength in vacuum [m].
    temperature, pressure
        Values during the calibration [K], [Pa].

    Raises
    ------
    OutOfRangeError
        For a glass index of at most 1.1, or an impossible temperature or pressure.
    """

    housing_expansion: float
    baseline_expansion: float
    array_expansion: float
    scale_expansion: float
    focal_length_expansion: float
    glass_index: float
    wavelength: float
    temperature: float
    pressure: float

    def __post_init__(self) -> None:
        if not (self.glass_index > 1.1 and self.temperature > 0.0 and self.pressure >= 0.0):
            raise OutOfRangeError(
                "impossible environment of the calibration",
                value=f"glass {self.glass_index:g}, {self.temperature:g} K, {self.pressure:g} Pa",
                limit="glass above 1.1, temperature above 0 K, pressure 0 Pa or more",
                remedy="correct the values",
            )

    def housing_factor(self, changes: Errors) -> FloatArray:
        """Ratio of current lengths of the housing to those during calibration [1]."""
        return self._length_factor(self.housing_expansion, changes)

    def baseline_factor(self, changes: Errors) -> FloatArray:
        """Ratio of the current baseline of a stereo rig to that during calibration [1]."""
        return self._length_factor(self.baseline_expansion, changes)

    def array_factor(self, changes: Errors) -> FloatArray:
        """Ratio of the current pitch of the microlenses to that during calibration [1]."""
        return self._length_factor(self.array_expansion, changes)

    def scale_factor(self, changes: Errors) -> FloatArray:
        """Ratio of the current length of what measures positions in the picture to that during calibration [1]."""
        return self._length_factor(self.scale_expansion, changes)

    def _length_factor(self, expansion: float, changes: Errors) -> FloatArray:
        return 1.0 + expansion * value_of(changes, "temperature_change")

    def focal_length_factor(self, changes: Errors) -> FloatArray:
        """Ratio of the current focal length to that during calibration [1], from thermal drift and the ambient air."""
        warmer = value_of(changes, "temperature_change")
        factor: FloatArray = 1.0 + self.focal_length_expansion * warmer
        return factor * focal_length_change_with_medium(
            self.glass_index,
            self._index(np.zeros(()), np.zeros(())),
            self._index(warmer, value_of(changes, "pressure_change")),
        )

    def _index(self, warmer: FloatArray, denser: FloatArray) -> FloatArray:
        return air_refractive_index(self.wavelength, self.temperature + warmer, self.pressure + denser)


def warmed(sensor: Sensor, changes: Errors, environment: Environment | None) -> Sensor:
    """A sensor whose pixels have expanded since the calibration; see `Environment.scale_expansion`."""
    if environment is None or "temperature_change" not in changes:
        return sensor
    return replace(sensor, pixel_pitch=sensor.pixel_pitch * float(environment.scale_factor(changes)))
