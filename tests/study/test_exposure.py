"""A camera's own exposure time."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tradestudy import load
from tradestudy.cameras.depth_camera import DepthCamera

ROBOT = Path(__file__).parents[2] / "studies" / "robot.yaml"
CLOSE = Path(__file__).parents[2] / "studies" / "close_range.yaml"


def errors(exposure: float, electrons: float) -> np.ndarray:
    study = load(
        CLOSE,
        [f"pair-f22.sensor.relative_exposure={exposure}", f"scene.picture.light.electrons={electrons} electrons"],
    ).prepared
    found = []
    for name in ("pair-f22", "pair-f9.8"):
        camera = study.case.all_cameras[name]
        assert isinstance(camera, DepthCamera)
        found.append(camera.noise(np.array([50e-3, 55.3e-3, 62e-3])))
    return np.array(found)


def test_four_times_the_exposure_is_four_times_the_light_of_this_camera_alone() -> None:
    own, other = errors(4.0, 1000.0)
    np.testing.assert_allclose(own, errors(1.0, 4000.0)[0], rtol=1e-12)
    np.testing.assert_allclose(other, errors(1.0, 1000.0)[1], rtol=1e-12)
    # Between read noise and shot noise, four times the light lowers the error by a factor of 2 to 4.
    ratio = errors(1.0, 1000.0)[0] / own
    assert np.all((ratio > 2.0) & (ratio < 4.0))


@pytest.mark.parametrize(("exposure", "f_number", "warned"), [(1.0, 2.0, False), (3.0, 2.0, True), (3.0, 4.0, False)])
def test_the_full_well_is_held_against_the_light_of_this_exposure(
    exposure: float, f_number: float, warned: bool
) -> None:
    """4000 electrons at f/2 overfill 10 000 if exposed 3 times as long, but not through f/4."""
    own = {"sensor.relative_exposure": exposure, "lenses.f_number": f_number, "focus_distance": "infinity"}
    light = "scene.picture.light.electrons=4000 electrons"  # without a basis, which would silence the warning
    study = load(ROBOT, [light, *(f"stereo-75mm.{key}={value}" for key, value in own.items())])
    found = [re.sub(r"\s", " ", one) for one in study.warnings if "full well" in one]
    assert len(found) == warned
    if warned:
        assert "the pixels of stereo-75mm collect up to 12000 e⁻ on the axis" in found[0]
