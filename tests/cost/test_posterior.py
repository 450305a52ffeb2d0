"""Posteriors: not begun without time for what is held against them, and priced by the depth that follows from them."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from tests.calibration.cameras import board, normal, shown, stereo
from tradestudy.calibration.posteriors import TargetToInfer, infer
from tradestudy.cost import measuring, posterior
from tradestudy.cost.entries import CostTable
from tradestudy.cost.measuring import Allowance
from tradestudy.cost.posterior import EMCEE, LAPLACE, posterior_cost

DISTANCE = np.array([1.0, 2.0])
ASKED = shown(stereo(), (normal("yaw", np.radians(0.2)),), board(views=4, max_steps=100))


def cost(asked: TargetToInfer, *, seconds: float, inferring: float) -> CostTable:
    camera = replace(asked.camera, calibration=infer(asked).calibration)
    return posterior_cost(
        asked, camera, "Rig", DISTANCE, Allowance(seconds=seconds), progress=lambda *_: None, inferring=inferring
    )


def test_without_time_for_three_posteriors_none_is_begun() -> None:
    begin = time.perf_counter()
    found = posterior_cost(
        ASKED, ASKED.camera, "Rig", DISTANCE, Allowance(seconds=10.0), progress=lambda *_: None, inferring=4.0
    )
    assert time.perf_counter() - begin < 1.0
    assert found.entries == ()
    assert "about 12 s" in found.left_out[0]
    assert "a larger --budget" in found.left_out[0]


def test_the_normal_approximation_of_a_linear_problem_is_as_good_as_chains(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small angles and shifts move corners linearly: the posterior is normal, and the fit has no error but chance."""
    monkeypatch.setattr(posterior, "_STEPS", (50,))
    monkeypatch.setattr(posterior, "_REFERENCE_RUNS", (2, 2))
    monkeypatch.setattr(measuring, "_LONG", 0.0)  # once is enough
    found = cost(ASKED, seconds=1e3, inferring=1.0)
    errors = {(entry.model, entry.setting): entry.error for entry in found.entries}
    assert set(errors) == {(LAPLACE, ""), (EMCEE, "until converged"), (EMCEE, "50 steps")}
    assert errors[LAPLACE, ""] < 0.05
    assert [entry.setting for entry in found.entries if entry.chosen] == ["until converged"]
    assert "Depth" not in found.title
    assert "of Rig" in found.title
