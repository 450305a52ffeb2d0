"""A camera's own exposure time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tradestudy import load
from tradestudy.cameras.depth_camera import DepthCamera

CLOSE = Path(__file__).parents[2] / "studies" / "close_range.yaml"


def errors(exposure: float, electrons: float) -> np.ndarray:
    study = load(
        CLOSE,
        [f"pair-f22.sensor.relative_exposure={exposure}", f"scene.picture.light.electrons={electrons} electrons"],
    ).definition
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
