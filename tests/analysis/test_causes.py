"""The largest cause of an uncertainty, where a calibration leaves its parameters strongly correlated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tradestudy
from tradestudy.answers.decision import NOISE, largest_cause
from tradestudy.answers.solutions import planned
from tradestudy.depth.evaluation import depth_uncertainty

STUDY = Path(__file__).parents[2] / "studies" / "calibration_plan.yaml"


def test_the_share_of_noise_is_its_fraction_of_the_total_variance() -> None:
    """Focal length, principal point and pose offset each other: alone, each would seem to outweigh the noise."""
    camera = planned(tradestudy.load(STUDY).prepared).case.cameras["rig"]
    for distance in (0.5, 1.0, 2.0):
        at = np.array([distance])
        noise, whole = (float(depth_uncertainty(camera, at, error_source)[0]) for error_source in ("noise", "both"))
        cause = largest_cause(camera, at)
        assert cause is not None
        assert cause.parameter == NOISE
        assert cause.share == pytest.approx((noise / whole) ** 2, rel=0.02)
