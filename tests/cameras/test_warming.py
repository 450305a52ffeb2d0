"""Every part of a warmer camera expands by its own coefficient; depth is read with the calibration of the cold one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.cameras.builders import F_L, F_MAIN, PITCH, r5, stereo, unfocused
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_measurement import Environment

KELVIN = 3.0
PPM = 1e-6
AIR = 101_325.0
HOUSING, LENS = 23.0, 10.0
FIXED = {"housing": HOUSING, "lens": LENS, "array": 7.0, "sensor": 2.6}


def drift(camera: DepthCamera, distance: float, pressure: float = 0.0, **ppm: Any) -> float:
    """Relative error of depth that the program computes 3 K after the calibration; by default in vacuum."""
    found_again = ppm.get("centers") == "found-again"
    environment = Environment(
        housing_expansion=ppm["housing"] * PPM,
        baseline_expansion=ppm.get("baseline", ppm["housing"]) * PPM,
        array_expansion=ppm.get("array", 0.0) * PPM,
        scale_expansion=(ppm["array"] if found_again else ppm["sensor"]) * PPM,
        focal_length_expansion=ppm.get("lens", 0.0) * PPM,
        glass_index=1.52,
        wavelength=550e-9,
        temperature=293.15,
        pressure=pressure,
    )
    warm = {"temperature_change": np.array([[KELVIN]])}
    inverse = camera.read(np.array([distance]), 0.0, warm, environment).inverse_depth
    return float(1.0 / (inverse[0, 0] * distance) - 1.0)


def stale_micro_images(distance: float, *, z: float, gap: float, centers: str = "kept", **ppm: float) -> float:
    """Scale every length of a focused plenoptic camera, and read depth by eq. 8 as the cold camera would."""
    housing, array, sensor, lens = (1.0 + ppm[name] * PPM * KELVIN for name in ("housing", "array", "sensor", "lens"))
    spacing = np.sqrt(3.0) * PITCH  # of two microlenses of one type
    image = 1.0 / (1.0 / (F_MAIN * lens) - 1.0 / distance)
    virtual = z * housing - image
    apart = spacing * array * (1.0 + gap * housing / virtual) / sensor  # in pixels of the calibration, as a length
    centres = spacing
    if centers == "found-again":  # white images: those of the pupil, from which the cold camera's ratio gives centres
        centres = spacing * array * (1.0 + gap / z) / sensor / (1.0 + gap / z)
    b = z - gap * centres / (apart - centres)
    return F_MAIN * b / (b - F_MAIN) / distance - 1.0


PARTS = [
    {"array": 7.0, "sensor": 0.0},
    {"array": 7.0, "sensor": 2.6},
    {"array": 7.0, "sensor": 2.6, "centers": "found-again"},
    {"array": 0.5, "sensor": 2.6},
    {"array": 60.0, "sensor": 17.0, "centers": "found-again"},
    {"array": 60.0, "sensor": 17.0},
]


@pytest.mark.parametrize("parts", PARTS)
@pytest.mark.parametrize("distance", [0.3, 1.0])
def test_a_focused_plenoptic_camera_drifts_as_its_scaled_lengths_say(parts: dict[str, Any], distance: float) -> None:
    camera, ppm = r5(), {"housing": HOUSING, "lens": LENS, **parts}
    expected = stale_micro_images(distance, z=camera.mla_distance, gap=camera.microlenses.gap, **ppm)
    assert drift(camera, distance, **ppm) == pytest.approx(expected, rel=1e-8, abs=1e-12)


def test_a_glass_array_on_a_silicon_sensor_drifts_several_times_as_much_as_one_of_the_housing_s_metal() -> None:
    """By hand at 1 m and 3 K, where ∂a/∂z = −6.24 mm/µm, f = 12.5 mm, z = 14.773 mm, a_L = 2.114 mm, v = 3.72.

    Housing and lens move z − b = a_L by 3 K × (23 × 14.773 − 7.3 × 12.82 nm) = 0.74 µm, but the gap takes 3 K × 23 ppm
    of a_L, 0.15 µm: 0.59 µm, 3.7 mm. An array that grows by ε relative to the pixels adds Δx (1 + v)/v ε to
    Δσ = Δx/v, and a_L is read shorter by (1 + v) ε of itself: 7 against 2.6 ppm/K by 0.13 µm, 0.8 mm.
    """
    of_housing = drift(r5(), 1.0, AIR, **FIXED | {"array": HOUSING, "sensor": 0.0})
    assert of_housing == pytest.approx(-6.0e-4, rel=0.01)
    assert drift(r5(), 1.0, AIR, **FIXED | {"sensor": 0.0}) == pytest.approx(2.40e-3, rel=0.01)
    assert drift(r5(), 1.0, AIR, **FIXED) == pytest.approx(2.88e-3, rel=0.01)
    # Centres found again follow the array; then only the housing and the lens remain.
    again = {drift(r5(), 1.0, AIR, **FIXED | {"array": one, "centers": "found-again"}) for one in (0.5, 7.0, 60.0)}
    assert max(again) - min(again) < 1e-9
    assert max(again) == pytest.approx(3.71e-3, rel=0.01)


def stale_views(camera: Any, distance: float, *, centers: str = "kept", **ppm: float) -> float:
    """Trace two rays through a warm unfocused camera, pixel by pixel, and read depth as the cold one would."""
    housing, array, sensor, lens = (1.0 + ppm[name] * PPM * KELVIN for name in ("housing", "array", "sensor", "lens"))
    f, z, gap = F_MAIN * lens, camera.mla_distance * housing, F_L * housing
    pitch = PITCH * array
    views = camera.estimator_baseline * F_L / camera.mla_distance  # between the pixels of both views, cold
    centre_ratio = 1.0 + F_L / camera.mla_distance
    known_pitch = PITCH * array / sensor if centers == "found-again" else PITCH

    def microlens(offset: float) -> float:
        """Number of the microlens through whose middle the point lights the pixel that the calibration chooses."""

        def miss(height: float) -> tuple[float, float]:
            behind = (height - 0.0) / distance - height / f
            number = (height + behind * z) / pitch
            pixel = (number * known_pitch * centre_ratio + offset) * sensor
            return number * pitch + behind * gap - pixel, number

        (low, first), (high, last) = miss(-1e-3), miss(1e-3)
        return first + (last - first) * -low / (high - low)

    # The picture behind the lens is upside down: the pixel at a larger offset sees the lower part of the pupil.
    disparity = (microlens(-views / 2.0) - microlens(views / 2.0)) * known_pitch
    cold_z = camera.mla_distance
    return 1.0 / (1.0 / F_MAIN - 1.0 / cold_z + disparity * F_L / (views * cold_z**2)) / distance - 1.0


@pytest.mark.parametrize("parts", PARTS)
@pytest.mark.parametrize("distance", [0.1, 0.3, 1.0])
def test_an_unfocused_plenoptic_camera_drifts_as_two_traced_rays_say(parts: dict[str, Any], distance: float) -> None:
    camera, ppm = unfocused(), {"housing": HOUSING, "lens": LENS, **parts}
    assert drift(camera, distance, **ppm) == pytest.approx(stale_views(camera, distance, **ppm), rel=1e-8, abs=1e-12)


@pytest.mark.parametrize(("baseline", "sensor"), [(HOUSING, 0.0), (1.0, 0.0), (1.0, 2.6), (HOUSING, HOUSING)])
def test_a_rig_s_disparity_grows_with_baseline_and_housing_over_pixels(baseline: float, sensor: float) -> None:
    """Z = f B/d: read with the cold f, B and pixel."""
    growth = [1.0 + one * PPM * KELVIN for one in (HOUSING, baseline, sensor)]
    expected = growth[2] / (growth[0] * growth[1]) - 1.0
    found = drift(stereo(), 1.0, housing=HOUSING, baseline=baseline, sensor=sensor)
    assert found == pytest.approx(expected, rel=1e-9)
