"""Flat-fielding: brightness of a camera's raw pictures relative to those of a uniform white scene, and its noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.depth_map import FlatPicture
from tradestudy.cameras.light_cones import Exposure
from tradestudy.imaging.render.nodes import LEAST_NODES, lit_area
from tradestudy.imaging.render.sensor import Recording
from tradestudy.imaging.render.waves import Waves
from tradestudy.optics.arrays import Samples

_ROWS_AT_ONCE: Final = 16
_FULL_WITHIN: Final = 4.0  # of the full well, in standard deviations of the read noise
_LEAST_LIGHT: Final = 0.3  # relative to the brightest pixels; below it, flat-fielding mainly amplifies noise
_LEAST_SHARE: Final = 0.9  # fraction of a pixel's light that must come through one lens


@dataclass(frozen=True, kw_only=True, eq=False)
class WhitePicture:
    """The picture of a uniform white scene.

    Parameters
    ----------
    electrons
        Expected electrons of every pixel, shape (rows, columns).
    share
        Fraction of each pixel's light that comes through the lens contributing most.
    """

    electrons: Samples
    share: Samples


def white_picture(exposure: Exposure, recording: Recording, waves: Waves | None = None) -> WhitePicture:
    """The white picture that a calibration of the designed camera would record; by waves if they are given."""
    sensor = exposure.sensor
    gain = recording.electrons_at_f1(sensor)
    width = sensor.pixel_pitch * recording.pixel_fill
    electrons, share = (np.empty((sensor.rows, sensor.columns), np.float32) for _ in range(2))
    for top in range(0, sensor.rows, _ROWS_AT_ONCE):
        rows, columns = np.mgrid[top : min(top + _ROWS_AT_ONCE, sensor.rows), : sensor.columns]
        x = (columns.ravel() + 0.5 - sensor.columns / 2.0) * sensor.pixel_pitch
        y = (rows.ravel() + 0.5 - sensor.rows / 2.0) * sensor.pixel_pitch
        if waves is None:
            cones = exposure.cones(x, y)
            lit = lit_area(cones, width) / (np.pi * cones.lens_radius**2) * cones.light
        else:
            cones = exposure.cones(x, y, waves.beyond)
            lit = waves.tables(LEAST_NODES)[LEAST_NODES].passed_pixel(cones, width) * cones.light
        total, most = np.bincount(cones.pixel, weights=lit, minlength=x.size), np.zeros(x.size)
        np.maximum.at(most, cones.pixel, lit)
        electrons[rows[:, 0]] = (gain * total).reshape(rows.shape)
        share[rows[:, 0]] = np.divide(most, total, out=np.zeros(x.size), where=total > 0.0).reshape(rows.shape)
    return WhitePicture(electrons=electrons, share=share)


def flat_picture(values: NDArray[Any], white: WhitePicture, recording: Recording) -> FlatPicture:
    """Flat-field recorded digital numbers or electrons; saturated and dim pixels become NaN."""
    noise = recording.noise
    if recording.is_digital:
        electrons = values * recording.electrons_per_number - recording.black_level
        full = values >= 2**noise.bits - 1
        rounding = recording.electrons_per_number / 2.0
    else:
        electrons = np.asarray(values, np.float64)
        full, rounding = np.zeros(electrons.shape, bool), 0.0
    # The read noise of a full pixel may be negative.
    noise_of_full = _FULL_WITHIN * noise.read_noise_electrons if "read" in recording.model else 0.0
    full |= electrons >= noise.full_well_electrons - noise_of_full - rounding
    bright = white.electrons > _LEAST_LIGHT * float(np.percentile(white.electrons, 99.0))
    variance = np.zeros_like(electrons)
    if recording.model != "off":
        variance = np.maximum(electrons, 0.0)
    if "read" in recording.model:
        variance = variance + noise.read_noise_electrons**2
    if recording.is_digital:
        variance = variance + recording.electrons_per_number**2 / 12.0
    usable = bright & ~full
    flat = np.where(usable, white.electrons, np.nan)
    return FlatPicture(
        values=(electrons / flat).astype(np.float32),
        variance=(variance / np.square(flat)).astype(np.float32),
        pure=usable & (white.share >= _LEAST_SHARE),
    )
