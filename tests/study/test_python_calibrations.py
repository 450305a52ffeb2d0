"""Calibrations from arrays in Python, against linear propagation by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import tradestudy
from tradestudy.errors import TradestudyError

STUDY = Path(__file__).parents[2] / "studies" / "plenoptic_vs_stereo.yaml"
BASELINE, DISTANCE, DEVIATION = 20e-3, 1.0, 1e-4
NAMES = ["yaw", "baseline"]


def rig() -> tradestudy.Camera:
    """A rig whose other errors are next to 0."""
    others = {f"calibration.errors.{name}.standard_deviation": 1e-12 for name in ("pitch", "roll", "focal_length")}
    return tradestudy.load(STUDY).cameras["stereo-short"].replace(others)


def covariance(correlation: float) -> pd.DataFrame:
    matrix = DEVIATION**2 * np.array([[1.0, correlation], [correlation, 1.0]])
    return pd.DataFrame(matrix, index=NAMES, columns=NAMES)


def by_hand(correlation: float) -> float:
    """Z = f B/d: yaw shifts d by f times itself, so δZ = ∓Z²/B δyaw; the baseline scales depth, so δZ = −Z/B δB."""
    gradient = np.array([DISTANCE**2 / BASELINE, -DISTANCE / BASELINE])
    return float(np.sqrt(gradient @ covariance(correlation).to_numpy() @ gradient))


@pytest.mark.parametrize("correlation", [0.8, 0.0, -0.8])
def test_a_covariance_keeps_its_correlations(correlation: float) -> None:
    found = rig().replace({"calibration": covariance(correlation)}).depth_uncertainty(DISTANCE, errors="calibration")
    assert float(found) in (
        pytest.approx(by_hand(correlation), rel=0.01),
        pytest.approx(by_hand(-correlation), rel=0.01),
    )


def test_opposite_correlations_differ() -> None:
    found = [
        float(rig().replace({"calibration": covariance(one)}).depth_uncertainty(DISTANCE, errors="calibration"))
        for one in (-0.8, 0.8)
    ]
    assert sorted(found) == pytest.approx([by_hand(0.8), by_hand(-0.8)], rel=0.01)


def test_a_study_takes_it_too_as_it_takes_the_same_text() -> None:
    study = tradestudy.load(STUDY).with_values({"cameras.stereo-short.calibration": covariance(0.8)})
    again = tradestudy.load(STUDY).with_values(
        {
            "cameras.stereo-short.calibration.errors.yaw.standard_deviation": "1e-4 rad",
            "cameras.stereo-short.calibration.errors.baseline.standard_deviation": "0.1 mm",
            "cameras.stereo-short.calibration.correlations": {"yaw": {"baseline": 0.8}},
        }
    )
    found, expected = (float(one.cameras["stereo-short"].depth_uncertainty(DISTANCE)) for one in (study, again))
    assert found == pytest.approx(expected, rel=1e-9)


def test_joint_draws_are_written_and_read_as_a_file(tmp_path: Path) -> None:
    """Whole rows are drawn: the variance is that of the sample."""
    draws = pd.DataFrame(np.random.default_rng(5).multivariate_normal([0.0, 0.0], covariance(0.8), 4000), columns=NAMES)
    draws.to_csv(tmp_path / "draws.csv", index=False)
    none = {"calibration.errors.yaw": None, "calibration.errors.baseline": None}
    read = rig().replace({"calibration.posterior": {"file": str(tmp_path / "draws.csv")}, **none})
    found = float(read.depth_uncertainty(DISTANCE, errors="calibration"))
    assert found == pytest.approx(min(by_hand(0.8), by_hand(-0.8)), rel=0.03)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (pd.DataFrame(np.zeros((500, 2)), columns=NAMES), "no covariance .*500 rows, columns yaw, baseline.*to_csv"),
        (covariance(0.8).loc[::-1], "in one order"),
        (covariance(1.5), "positive semidefinite"),
        (covariance(0.8).rename({"yaw": "jaw"}).rename(columns={"yaw": "jaw"}), "jaw.*yaw"),
    ],
)
def test_what_is_no_covariance_of_its_errors_is_refused(given: pd.DataFrame, message: str) -> None:
    with pytest.raises(TradestudyError, match=message):
        rig().replace({"calibration": given})
