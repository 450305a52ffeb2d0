"""Sensors by their EMVA 1288 values: what the standard's own measurements find in pictures that they are used for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tradestudy
from tradestudy.cameras.camera import digitiser_contradictions, lens_contradictions
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.cameras.stated_declaration import StatedPart
from tradestudy.depth.evaluation import depth_uncertainty
from tradestudy.errors import TradestudyError
from tradestudy.imaging.models import Light, SensorNoise, noise_variance
from tradestudy.imaging.render.tiles import Recording
from tradestudy.study.prepared import PreparedStudy

STUDIES = Path(__file__).parents[2] / "studies"
GAIN, DARK, WELL, BITS = 0.31, 7.0, 9000.0, 12
LENS = Lens(focal_length=8e-3, f_number=4.0)


def sensor(**values: float) -> Sensor:
    return Sensor(columns=100, rows=100, pixel_pitch=5e-6, **values)


def recording(gain: float | None = GAIN, well: float = WELL) -> Recording:
    noise = SensorNoise(read_noise_electrons=DARK, full_well_electrons=well, bits=BITS, gain=gain)
    light = Light(electrons=1000.0, f_number=4.0)
    return Recording(light=light, noise=noise, model="shot+read+quantisation", black_level=200.0)


def test_photon_transfer_of_recorded_values_finds_gain_and_dark_noise() -> None:
    """EMVA 1288: σ_y² = K²σ_d² + 1/12 + K (μ_y − μ_y.dark), over several exposures."""
    rng = np.random.default_rng(0)
    levels = [np.full(200_000, electrons) for electrons in (0.0, 500.0, 1500.0, 4000.0)]
    taken = [recording().record(level, rng).astype(float) for level in levels]
    means, variances = np.array([(one.mean(), one.var()) for one in taken]).T
    slope = np.polyfit(means - means[0], variances, 1)[0]
    assert slope == pytest.approx(GAIN, rel=0.01)
    assert variances[0] == pytest.approx(GAIN**2 * DARK**2 + 1.0 / 12.0, rel=0.02)
    assert (means[3] - means[0]) / 4000.0 == pytest.approx(GAIN, rel=1e-3)
    noise = recording().noise
    stated = noise_variance(np.array([0.0, 4000.0]), noise, "shot+read+quantisation") * GAIN**2
    np.testing.assert_allclose(stated, variances[[0, 3]], rtol=0.02)


@pytest.mark.parametrize(("gain", "well"), [(GAIN, 9000.0), (GAIN, 50_000.0), (None, 9000.0)])
def test_pixels_saturate_at_the_full_well_or_the_last_number(gain: float | None, well: float) -> None:
    one = recording(gain, well)
    rng = np.random.default_rng(0)
    full = one.saturation_electrons
    assert full == pytest.approx(min(well, 2**BITS * one.noise.step_electrons - 200.0))
    below, above = (
        np.ptp(one.record(np.full(10_000, share * full), rng).astype(float) * one.noise.step_electrons)
        for share in (0.9, 1.3)
    )
    assert above < 0.25 * below  # no shot noise is left


def robot(values: dict[str, Any]) -> PreparedStudy:
    unasked = dict.fromkeys(("raytrix-r5", "decision", "trade_off", "requirements"))
    return tradestudy.load(STUDIES / "robot.yaml").with_values({**unasked, **values}).plan().study


def uncertainty(values: dict[str, Any]) -> float:
    camera = robot({"scene.picture.light.electrons": "2000 electrons", **values}).case.cameras["stereo-75mm"]
    return float(depth_uncertainty(camera, np.array([1.0]))[0])


def test_a_declared_sensor_acts_like_that_of_the_scene() -> None:
    own = uncertainty({"stereo-75mm.sensor.temporal_dark_noise": "40 electrons"})
    assert own == uncertainty({"scene.picture.read_noise": "40 electrons"})
    assert own > 1.02 * uncertainty({})
    own = uncertainty({"stereo-75mm.sensor.saturation_capacity": "4000 electrons"})
    assert own == uncertainty({"scene.picture.full_well": "4000 electrons"})
    coarse = uncertainty({"stereo-75mm.sensor.system_gain": "0.005 DN/e-"})
    assert coarse > 1.02 * uncertainty({})


def test_photons_become_electrons_by_the_quantum_efficiency() -> None:
    light = {"scene.picture.light.electrons": None, "scene.picture.light.photons": "4000 photons"}
    every = {f"{name}.sensor.quantum_efficiency": "50 %" for name in robot({}).case.cameras}
    assert uncertainty({**light, **every}) == uncertainty({})


def test_photons_need_a_quantum_efficiency_and_light_has_one_unit() -> None:
    with pytest.raises(TradestudyError, match=r"sensor\.quantum_efficiency"):
        uncertainty({"scene.picture.light.electrons": None, "scene.picture.light.photons": "4000 photons"})
    with pytest.raises(TradestudyError, match=r"scene\.picture\.light: .*electrons.*photons"):
        uncertainty({"scene.picture.light.photons": "4000 photons"})
    with pytest.raises(TradestudyError, match=r"sensor\.quantum_efficiency: .*120 %"):
        uncertainty({"stereo-75mm.sensor.quantum_efficiency": "120 %"})


@pytest.mark.parametrize("stated", [13.0, 14.0])
def test_a_threshold_that_contradicts_efficiency_and_noise_is_reported(stated: float) -> None:
    """η 60 %, σ_d 7 e⁻, K 0.31 DN/e⁻: signal equals noise, x² = x + σ², at x = 7.578 e⁻, 12.63 photons."""
    noise = DARK**2 + 1.0 / (12.0 * GAIN**2)
    equal = max(np.roots([1.0, -1.0, -noise]).real) / 0.6
    known = sensor(quantum_efficiency=0.6, temporal_dark_noise=DARK, system_gain=GAIN)
    right = StatedPart.model_construct(absolute_sensitivity_threshold=equal)
    assert lens_contradictions(LENS, known, right) == []
    (found,) = lens_contradictions(LENS, known, StatedPart.model_construct(absolute_sensitivity_threshold=stated))
    assert found.stated.startswith(f"{stated:g}")
    assert found.implied.startswith(f"{equal:.4g}")
    unknown = StatedPart.model_construct(absolute_sensitivity_threshold=stated)
    assert lens_contradictions(LENS, sensor(temporal_dark_noise=DARK), unknown) == []


def test_a_full_well_beyond_the_last_number_is_reported() -> None:
    assert digitiser_contradictions(sensor(system_gain=GAIN), 13_000.0, BITS) == []
    (found,) = digitiser_contradictions(sensor(system_gain=GAIN), 14_000.0, BITS)
    assert found.implied.startswith("13210 ")
    assert digitiser_contradictions(sensor(), 14_000.0, BITS) == []
