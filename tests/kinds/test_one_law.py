"""A stereo pair has one law from rays to depth: disparity, draws, posteriors and inverse answers go through it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tradestudy
from tests.calibration.rig_draws import depth_of_draws
from tests.cameras.builders import stereo
from tradestudy.answers.questions import solve
from tradestudy.optics import triangulation

STUDIES = Path(__file__).parents[2] / "studies"
SCALE = 1.001
DISTANCES = np.array([0.5, 1.0, 3.0])
# A pair of webcams: focal lengths, principal points and distortion of both [px, 1], rotation [rad], translation [m].
WEBCAMS = np.array([800.0, 800, 320, 240, 0, 0] * 2 + [0.001, 0.002, 0.001, -0.06, 0.001, 0.0005])


def forget() -> None:
    """What is kept of depths that were read by the law as it was."""
    for name, module in list(sys.modules.items()):
        if name.startswith(("tradestudy.depth.", "tradestudy.models.", "tradestudy.answers.")):
            for value in vars(module).values():
                if hasattr(value, "cache_clear"):
                    value.cache_clear()


@pytest.fixture
def scaled(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Scale the law wherever the program holds it."""
    law = triangulation.inverse_depth_on_ray

    def apply() -> None:
        forget()
        for name, module in list(sys.modules.items()):
            if name.startswith("tradestudy."):
                for key, value in list(vars(module).items()):
                    if value is law:
                        monkeypatch.setattr(module, key, lambda *ray: SCALE * law(*ray))

    yield apply
    forget()


def test_scaling_the_law_scales_depth_from_disparity(scaled: Any) -> None:
    rig, disparity = stereo(), stereo().disparity(DISTANCES)
    before = rig.depth_of_disparity(disparity, DISTANCES)
    scaled()
    np.testing.assert_allclose(rig.depth_of_disparity(disparity, DISTANCES) * SCALE, before, rtol=1e-12)


def test_scaling_the_law_scales_the_depth_of_draws(scaled: Any) -> None:
    rng = np.random.default_rng(0)
    errors = {"yaw": 1e-3 * rng.standard_normal((50, 1)), "baseline": 1e-4 * rng.standard_normal((50, 1))}
    before = stereo().read(DISTANCES, 0.5, errors).inverse_depth
    scaled()
    np.testing.assert_allclose(stereo().read(DISTANCES, 0.5, errors).inverse_depth, SCALE * before, rtol=1e-12)


def test_scaling_the_law_scales_the_depth_of_a_posterior(scaled: Any) -> None:
    draws = WEBCAMS + 1e-6 * np.random.default_rng(0).standard_normal((50, 18))
    before = depth_of_draws(WEBCAMS, draws, DISTANCES)
    scaled()
    np.testing.assert_allclose(depth_of_draws(WEBCAMS, draws, DISTANCES) * SCALE, before, rtol=1e-12)


def test_inverse_questions_follow_the_scaled_law(scaled: Any) -> None:
    """All depths of the rig shrink, so a yaw larger by as much makes it as uncertain as the other camera."""
    study = tradestudy.load(STUDIES / "plenoptic_vs_stereo.yaml").prepared
    question = study.file.solve["yaw-at-half-metre"]
    before = solve(study, question).value
    scaled()
    # Uncertainty is hardly noise there: σ ∝ yaw, to the share of the variance that noise has, a few per mille.
    assert solve(study, question).value / before - 1.0 == pytest.approx(SCALE - 1.0, rel=0.05)
