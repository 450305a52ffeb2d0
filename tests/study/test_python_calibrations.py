"""Calibrations from arrays in Python, against linear propagation by hand."""

from __future__ import annotations

import io
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import tradestudy
from tests.study.test_python_studies import RIG
from tests.study.test_python_studies import STUDY as SMALL
from tradestudy.errors import TradestudyError

STUDY = Path(__file__).parents[2] / "studies" / "plenoptic_vs_stereo.yaml"
BASELINE, DISTANCE, DEVIATION = 20e-3, 1.0, 1e-4
NAMES = ["yaw", "baseline"]


def rig() -> tradestudy.Camera:
    """A rig whose other errors are next to 0."""
    others = {f"calibration.errors.{name}.standard_deviation": 1e-12 for name in ("pitch", "roll", "focal_length")}
    return tradestudy.load(STUDY).cameras["stereo-short"].replace(others)


def errors_of(camera: tradestudy.Camera) -> dict[str, Any]:
    """The errors that a camera declares one by one."""
    declared: dict[str, Any] = camera.values["calibration"]["errors"]  # noqa: PD011  # no DataFrame
    return declared


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


def test_joint_draws_are_a_calibration_as_their_file_is(tmp_path: Path) -> None:
    """Whole rows are drawn: the variance is that of the sample."""
    draws = pd.DataFrame(np.random.default_rng(5).multivariate_normal([0.0, 0.0], covariance(0.8), 4000), columns=NAMES)
    draws.to_csv(tmp_path / "draws.csv", index=False)
    forms = ({"posterior": {"file": str(tmp_path / "draws.csv")}}, draws, draws.to_records(index=False))
    found = [
        float(
            rig()
            .replace({"calibration.errors": None})
            .replace({"calibration": form})
            .depth_uncertainty(DISTANCE, errors="calibration")
        )
        for form in forms
    ]
    assert found[0] == pytest.approx(min(by_hand(0.8), by_hand(-0.8)), rel=0.03)
    assert found == pytest.approx([found[0]] * 3, rel=1e-12)


@pytest.mark.parametrize("as_records", [False, True])
def test_joint_draws_replace_the_declared_errors_that_they_determine(as_records: bool) -> None:
    draws = pd.DataFrame(np.random.default_rng(5).multivariate_normal([0.0, 0.0], covariance(0.8), 4000), columns=NAMES)
    declared = rig().replace({"calibration.errors.pitch.standard_deviation": 2e-5})
    found = declared.replace(calibration=draws.to_records(index=False) if as_records else draws)
    assert errors_of(declared).keys() - errors_of(found).keys() == set(NAMES)
    assert errors_of(found).keys() < errors_of(declared).keys()
    assert errors_of(found.replace(calibration=2.0 * draws)) == errors_of(found)
    removed = declared.replace({f"calibration.errors.{name}": None for name in NAMES}).replace(calibration=draws)
    same = [float(one.depth_uncertainty(DISTANCE, errors="calibration")) for one in (found, removed)]
    assert same[0] == same[1] == pytest.approx(min(by_hand(0.8), by_hand(-0.8)), rel=0.03)


def test_joint_draws_calibrate_cameras_and_studies_made_in_python() -> None:
    draws = pd.DataFrame(np.random.default_rng(5).multivariate_normal([0.0, 0.0], covariance(0.8), 2000), columns=NAMES)
    values = {key: value for key, value in RIG.items() if key != "kind"} | {"calibration": draws}
    alone, study = (
        tradestudy.camera("stereo", **values),
        tradestudy.load({**SMALL, "cameras": {"rig": {**RIG, **values}}}),
    )
    assert pickle.loads(pickle.dumps(study)) == study == tradestudy.load(io.StringIO(study.to_yaml()))
    found = [float(one.depth_uncertainty(DISTANCE, errors="calibration")) for one in (alone, study.cameras["rig"])]
    gradient = np.array([DISTANCE**2 / RIG["baseline"], -DISTANCE / RIG["baseline"]])
    spread = [float(np.std(draws.to_numpy() @ (gradient * [sign, 1.0]))) for sign in (1.0, -1.0)]
    assert found == [pytest.approx(found[0], rel=1e-12)] * 2
    assert min(abs(found[0] / one - 1.0) for one in spread) < 0.02


def test_rows_of_a_covariance_may_have_another_order() -> None:
    ordered = covariance(0.8) * np.array([[1.0, 2.0], [2.0, 4.0]])
    found = [
        float(rig().replace({"calibration": form}).depth_uncertainty(DISTANCE, errors="calibration"))
        for form in (ordered, ordered.loc[::-1])
    ]
    assert found[0] == found[1]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            pd.DataFrame(np.zeros((2, 2)), columns=NAMES),
            "neither a covariance nor joint draws .*2 rows, columns yaw, baseline",
        ),
        (covariance(0.8).set_axis(["yaw", "roll"]), "the same names for rows and columns"),
        (covariance(1.5), "positive semidefinite"),
        (covariance(0.8).rename({"yaw": "jaw"}).rename(columns={"yaw": "jaw"}), "jaw.*yaw"),
        (pd.DataFrame(np.random.default_rng(5).normal(size=(500, 1)), columns=["jaw"]), "jaw.*yaw"),
    ],
)
def test_what_is_no_covariance_of_its_errors_is_refused(given: pd.DataFrame, message: str) -> None:
    with pytest.raises(TradestudyError, match=message):
        rig().replace({"calibration": given})
