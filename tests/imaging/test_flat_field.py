"""Which pixels flat-fielding takes for saturated."""

from __future__ import annotations

import numpy as np
import pytest

from tradestudy.imaging.estimation import WhitePicture, flat_picture
from tradestudy.imaging.models import Light, SensorNoise, SensorNoiseModel
from tradestudy.imaging.render.tiles import Recording

FULL_WELL, READ_NOISE = 10_000.0, 20.0


@pytest.mark.parametrize("black_level", [0.0, 200.0])
@pytest.mark.parametrize("gain", [None, 0.05, 0.39])
@pytest.mark.parametrize("model", ["off", "shot", "shot+read", "shot+read+quantisation"])
def test_full_pixels_are_never_used_whatever_their_noise(
    model: SensorNoiseModel, gain: float | None, black_level: float
) -> None:
    noise = SensorNoise(read_noise_electrons=READ_NOISE, full_well_electrons=FULL_WELL, bits=12, gain=gain)
    recording = Recording(
        light=Light(electrons=1.0, f_number=1.0, pixel_pitch=None), noise=noise, model=model, black_level=black_level
    )
    rng, shape = np.random.default_rng(3), (40, 400)
    white = WhitePicture(electrons=np.full(shape, 1e4, np.float32), share=np.ones(shape, np.float32))
    full = flat_picture(recording.record(np.full(shape, 2.0 * FULL_WELL), rng), white, recording)
    assert np.mean(np.isfinite(full.values)) < 1e-4  # four standard deviations of the read noise: 3e-5
    half = flat_picture(recording.record(np.full(shape, FULL_WELL / 2.0), rng), white, recording)
    assert np.all(np.isfinite(half.values))
    assert np.mean(half.values) == pytest.approx(0.5, rel=1e-3)
