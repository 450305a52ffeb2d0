"""What drives the depth of a camera, against closed forms, and where nothing is said."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.analysis.plain_depths import PIXEL, B, F, of_rig
from tests.cameras.builders import stereo
from tradestudy.answers.sensitivity import sensitivity_of
from tradestudy.cameras.calibration import Calibration
from tradestudy.uncertainty.distributions import Normal, StudentT
from tradestudy.uncertainty.joint import JointNormal
from tradestudy.uncertainty.sources import ErrorClass

YAW = math.radians(0.2)
AT = np.array([1.0])


def test_bars_and_indices_belong_to_each_error_alone() -> None:
    """At 1 m, half the way to the corner: yaw turns by ψ/B (1 + x²/f²), and x is −2.56 mm less half the disparity.

    The left half of the right camera's picture is the worse one: half the disparity adds to |x|.
    """
    yaw = of_rig("yaw", Normal(mean=0.0, standard_deviation=YAW))
    camera = stereo(disparity_error_px=0.1, calibration=Calibration(groups=(yaw,)))
    found = sensitivity_of("rig", camera, AT, 0.5)
    bars = dict(zip(found.groups.names, found.groups.half_width[:, 0], strict=True))
    assert found.corner == "lower left"
    x = -0.5 * 5.12e-3 / F - B / 2.0
    assert bars["yaw"] == pytest.approx(YAW / B * (1.0 + x**2), rel=0.01)
    assert bars["pixel_noise"] == pytest.approx(0.1 * PIXEL / (F * B), rel=0.01)
    assert found.indices is not None
    shares = dict(zip(found.indices.names, found.indices.first[:, 0], strict=True))
    variances = {name: bar**2 for name, bar in bars.items()}
    assert shares["yaw"] == pytest.approx(variances["yaw"] / sum(variances.values()), abs=0.02)
    assert sum(shares.values()) == pytest.approx(1.0, abs=0.02)


def test_errors_that_are_drawn_jointly_have_no_bars_of_their_own() -> None:
    joint = JointNormal(
        name="tied",
        parameters=("left_focal_length", "right_focal_length"),
        mean=np.zeros(2),
        covariance=1e-10 * np.array([[1.0, 0.9], [0.9, 1.0]]),
        error_class=ErrorClass.RIG,
    )
    found = sensitivity_of("rig", stereo(calibration=Calibration(groups=(joint,))), AT, 0.0)
    assert found.parameters is None
    assert "+0.900 between left focal length and right focal length" in found.refused
    assert set(found.groups.names) == {"tied", "pixel_noise"}


def test_a_source_without_a_variance_has_bars_but_no_indices() -> None:
    heavy = of_rig("baseline", StudentT(location=0.0, scale=1e-5, degrees_of_freedom=1.5))
    found = sensitivity_of("rig", stereo(calibration=Calibration(groups=(heavy,))), AT, 0.0)
    assert np.isfinite(found.groups.half_width).all()
    assert found.indices is None
    assert "a source has none" in found.no_indices
