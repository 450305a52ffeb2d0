"""Uncertainty budgets, against closed forms, derivatives in high precision, and the linear model of depth."""

from __future__ import annotations

import math
from pathlib import Path

import mpmath as mp
import numpy as np
import pandas as pd
import pytest
from scipy import stats

import tradestudy
from tests.analysis.plain_depths import PIXEL, B, F, of_rig
from tests.cameras.builders import F_MAIN, PITCH, YAW, r5, stereo
from tradestudy.answers.budget import CameraBudget, camera_budget
from tradestudy.cameras.calibration import Calibration, Propagation
from tradestudy.depth.evaluation import distribution
from tradestudy.depth.linear import linearised_depth
from tradestudy.errors import OutOfRangeError
from tradestudy.report.document import Table, plain_text
from tradestudy.report.sections.budget import list_budgets
from tradestudy.report.words import share
from tradestudy.result import Result
from tradestudy.uncertainty.distributions import Normal, StudentT, Uniform
from tradestudy.uncertainty.joint import GaussianCopula, JointDraws
from tradestudy.uncertainty.sources import ErrorClass

AT = np.array([0.3, 1.0])
ROUNDED = 1e-6  # of central differences over a thousandth of a standard deviation


def normal(deviation: float) -> Normal:
    return Normal(mean=0.0, standard_deviation=deviation)


def total(budget: CameraBudget) -> np.ndarray:
    return np.asarray(np.sum([row["variance"] for row in budget.rows.values()], axis=0))


def test_a_parallel_rig_has_the_budget_of_the_textbook() -> None:
    """Z = f B/d: Z²/(f B) per metre of disparity, Z/B, Z/f and, for a yaw of one camera, Z²/B + B/4."""
    groups = (of_rig("baseline", normal(20e-6)), of_rig("focal_length", normal(5e-6)), YAW)
    found = camera_budget(stereo(calibration=Calibration(groups=groups)), AT, 0.95)
    coefficients = {
        "pixel_noise": -(AT**2) / (F * B) * PIXEL,
        "baseline": AT / B,
        "focal_length": AT / F,
        "yaw": -(AT**2) / B - B / 4.0,
    }
    deviations = {"pixel_noise": 0.1, "baseline": 20e-6, "focal_length": 5e-6, "yaw": math.radians(0.2)}
    for name, row in found.rows.items():
        np.testing.assert_allclose(row["sensitivity_coefficient"], coefficients[name], rtol=ROUNDED)
        np.testing.assert_allclose(row["input_uncertainty"], deviations[name], rtol=1e-14)
        np.testing.assert_allclose(row["contribution"], np.abs(coefficients[name]) * deviations[name], rtol=ROUNDED)
    assert [row["input_units"] for row in found.rows.values()] == ["px", "m", "m", "rad"]
    expected = np.sqrt(sum((coefficients[name] * deviations[name]) ** 2 for name in coefficients))
    np.testing.assert_allclose(found.combined, expected, rtol=ROUNDED)
    np.testing.assert_allclose(found.factor, stats.norm.ppf(0.975), rtol=1e-12)


def depth_of_an_r5(distance: float, **errors: mp.mpf) -> mp.mpf:
    """Two neighbours of the same type, √3 pitches apart, solved for the object; Keplerian."""
    pitch, gap, z = mp.sqrt(3) * mp.mpf(PITCH), mp.mpf(0.568093e-3), mp.mpf(14.77255e-3)
    f, a = mp.mpf(F_MAIN), mp.mpf(distance)
    disparity = pitch * gap / (z - f * a / (a - f)) + errors.get("pixel_noise", 0) * mp.mpf(5.5e-6)
    image = z + errors.get("mla_distance", 0) - pitch * (gap + errors.get("microlens_gap", 0)) / disparity
    return 1 / (1 / (f + errors.get("focal_length", 0)) - 1 / image)


def test_correlated_inputs_have_a_row_whose_variance_completes_the_sum() -> None:
    """An R5 whose array distance and focal length are tied, against derivatives with 40 digits."""
    pair = GaussianCopula(
        name="tied",
        parameters=("mla_distance", "focal_length"),
        marginals=(normal(2e-6), normal(1e-6)),
        correlation=np.array([[1.0, 0.9], [0.9, 1.0]]),
        error_class=ErrorClass.RIG,
    )
    camera = r5(calibration=Calibration(groups=(pair, of_rig("microlens_gap", Uniform(low=-1e-7, high=1e-7)))))
    found, line = camera_budget(camera, AT, 0.95), linearised_depth(camera, AT, 0.0)
    deviations = {"pixel_noise": 0.1, "mla_distance": 2e-6, "focal_length": 1e-6, "microlens_gap": 2e-7 / math.sqrt(12)}
    exact = {}
    with mp.workdps(40):
        for name in deviations:
            slopes = [mp.diff(lambda x, n=name, a=a: depth_of_an_r5(a, **{n: x}), 0, h=mp.mpf(10) ** -15) for a in AT]
            exact[name] = np.array(slopes, dtype=float)
    tied = found.rows.pop("mla_distance and focal_length")
    for name, row in found.rows.items():
        np.testing.assert_allclose(row["sensitivity_coefficient"], exact[name], rtol=1e-5, err_msg=name)
        np.testing.assert_allclose(row["input_uncertainty"], deviations[name], rtol=1e-12)
    np.testing.assert_allclose(tied["correlation"], 0.9, rtol=1e-12)
    covariance = 2.0 * exact["mla_distance"] * exact["focal_length"] * 0.9 * 2e-6 * 1e-6
    np.testing.assert_allclose(tied["variance"], covariance, rtol=1e-5)
    np.testing.assert_allclose(total(found) + tied["variance"], found.combined**2, rtol=1e-9)
    np.testing.assert_allclose(found.combined, AT**2 * line.standard_deviation, rtol=1e-9)
    assert (tied["variance"] < 0.0).all()


def test_it_is_the_depth_uncertainty_to_first_order() -> None:
    """Inverse depth of the rig is linear: half the width of [1/(w + u), 1/(w − u)] is z² u/(1 − (z u)²)."""
    rig = stereo(calibration=Calibration(groups=(YAW,)))
    combined = camera_budget(rig, AT, 0.95).combined
    half = distribution(rig, AT, "both").half_width
    np.testing.assert_allclose(half, combined / (1.0 - (combined / AT) ** 2), rtol=1e-6)


def with_repeats(*freedom: float, noise: float = 1e-9) -> CameraBudget:
    names = ("baseline", "focal_length")[: len(freedom)]
    scales = {"baseline": 20e-6, "focal_length": 5e-6}
    groups = tuple(
        of_rig(name, StudentT(location=0.0, scale=scales[name], degrees_of_freedom=nu))
        for name, nu in zip(names, freedom, strict=True)
    )
    return camera_budget(stereo(disparity_error_px=noise, calibration=Calibration(groups=groups)), AT, 0.95)


def test_one_repeated_measurement_has_the_interval_of_its_t_distribution() -> None:
    """Whose standard deviation, √(4/2) times its scale, is what the budget combines."""
    found = with_repeats(4.0)
    np.testing.assert_allclose(found.freedom, 4.0, rtol=1e-5)
    np.testing.assert_allclose(found.combined, AT / B * 20e-6 * math.sqrt(2.0), rtol=ROUNDED)
    np.testing.assert_allclose(found.factor * found.combined, stats.t(4).ppf(0.975) * AT / B * 20e-6, rtol=1e-5)
    assert found.rows["baseline"]["evaluation"] == "A"
    assert found.rows["baseline"]["degrees_of_freedom"] == 4.0


def test_two_repeated_measurements_are_combined_by_welch_and_satterthwaite() -> None:
    """GUM G.4.1: ν_eff = u_c⁴ / Σ u⁴/ν, here with noise as a third, normal input."""
    found = with_repeats(5.0, 8.0, noise=0.1)
    parts = np.array([AT / B * 20e-6, AT / F * 5e-6, AT**2 / (F * B) * 0.1 * PIXEL])
    squares = np.sum(parts**2, axis=0)
    freedom = squares**2 / (parts[0] ** 4 / 5.0 + parts[1] ** 4 / 8.0)
    np.testing.assert_allclose(found.freedom, freedom, rtol=1e-5)
    expanded = stats.t(freedom).ppf(0.975) * np.sqrt(squares)
    np.testing.assert_allclose(found.factor * found.combined, expanded, rtol=1e-5)


def test_an_input_without_a_variance_leaves_names_and_no_numbers() -> None:
    found = with_repeats(2.0)
    assert np.isnan(found.combined).all()
    assert np.isnan(found.factor).all()
    assert list(found.rows) == ["pixel_noise", "baseline"]
    assert found.rows["baseline"]["distribution"] == "student-t"


@pytest.mark.parametrize(("source", "evaluation"), [("corners", "A"), ("posterior", "A"), ("target", "B")])
def test_draws_are_of_type_a_unless_a_simulated_target_gave_them(source, evaluation) -> None:
    draws = np.random.default_rng(1).normal(scale=1e-5, size=(64, 2))
    group = JointDraws(name="calibration", parameters=("baseline", "yaw"), draws=draws, error_class=ErrorClass.RIG)
    found = camera_budget(stereo(calibration=Calibration(groups=(group,), source=source)), AT, 0.95)
    kinds = [(row.get("distribution"), row.get("evaluation")) for row in found.rows.values()]
    assert kinds == [("normal", "B"), ("empirical", evaluation), ("empirical", evaluation), (None, None)]


def test_models_that_leave_calibration_out_leave_it_out_of_the_budget() -> None:
    found = camera_budget(stereo(propagation=Propagation(model="off")), AT, 0.95)
    assert list(found.rows) == ["pixel_noise"]


STUDY = """
format: 2
study: rig
title: A rig
question: How well does it measure?
cameras:
  rig:
    kind: stereo
    title: Rig
    lenses: {focal_length: 30.5 mm, f_number: 4}
    sensor: {pixels: [1024, 1024], pixel_pitch: 10 um}
    baseline: 100 mm
    convergence_distance: infinity
    focus_distance: 1 m
    depth: {estimator: disparity, disparity_error: 0.1 px, discrimination_step: 0.1 px}
    calibration:
      errors: {yaw: {standard_deviation: 0.2 deg}, baseline: {half_width: 20 um}}
      correlations: {yaw: {baseline: 0.5}}
  perfect:
    like: rig
    title: Perfect rig
    calibration: null
scene: {distances: {from: 0.2 m, to: 8 m, points: 41, spacing: log}, wavelength: 550 nm}
"""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    file = tmp_path_factory.mktemp("budget") / "rig.yaml"
    file.write_text(STUDY, encoding="utf-8")
    return tradestudy.load(file).run()


def test_a_run_has_budgets_at_the_distances_of_its_tables(result: Result) -> None:
    near, far = (result.budget("rig", place) for place in result.data["budget"]["distance"].to_numpy()[[1, -1]])
    assert list(near.index) == ["pixel_noise", "baseline", "yaw", "baseline and yaw"]
    assert near["variance"].sum() == pytest.approx(near.attrs["combined_uncertainty"] ** 2, rel=1e-9)
    assert near.attrs["units"]["contribution"] == "m"
    assert near.attrs["coverage"] == pytest.approx(0.95)
    expanded = near.attrs["coverage_factor"] * near.attrs["combined_uncertainty"]
    assert near.attrs["expanded_uncertainty"] == pytest.approx(expanded, rel=1e-12)
    # At 8 m yaw alone spreads depth by ±28 %: 1/(1/8 ∓ 1.96 u).
    assert math.isnan(far.attrs["coverage_factor"])
    assert far.attrs["interval_near"] == pytest.approx(1.0 / (1.0 / 8.0 + 1.96 * math.radians(0.2) / B), rel=1e-2)
    assert list(result.budget("perfect", 0.2).index) == ["pixel_noise"]
    assert result.budget("rig", 0.663).attrs["distance"] == result.data["budget"]["distance"][1]


def test_the_expanded_uncertainty_is_half_the_interval_wherever_it_is_given(result: Result) -> None:
    data = result.data["budget"].to_dataset()
    half = (data["interval_far"] - data["interval_near"]) / 2.0
    given = np.isfinite(data["expanded_uncertainty"])
    assert bool(given.any())
    assert bool((~given).any())
    np.testing.assert_allclose(data["expanded_uncertainty"].to_numpy()[given], half.to_numpy()[given], rtol=0.01)


@pytest.mark.parametrize(
    ("camera", "place", "says"), [("rug", 0.2, "rig, perfect"), ("rig", 0.25, "0.2 m.*8 m.*decision.at")]
)
def test_what_has_no_budget_is_refused(result: Result, camera: str, place: float, says: str) -> None:
    with pytest.raises(OutOfRangeError, match=says):
        result.budget(camera, place)


def tables(result: Result) -> list[list[list[str]]]:
    blocks = list_budgets(result.data)
    return [[[plain_text(cell) for cell in row] for row in block.rows] for block in blocks if isinstance(block, Table)]


def test_the_report_lists_the_budgets_with_their_results(result: Result) -> None:
    rig = tables(result)[0]
    first = rig.index(next(row for row in rig if row[0].startswith("At 0.663")))
    combined, k_or_not, interval = rig[first][0].split("; ")
    assert combined.startswith("At 0.663 m: uc = ")
    assert k_or_not.endswith("(k = 1.96)")
    assert interval.startswith("95 % interval 0.")
    assert rig[first + 1][:4] == ["yaw", "normal", "B", "0.2°"]
    assert rig[first + 1][4:6] == ["−77.2 mm/°", "15.4 mm"]  # (Z²/B + B/4) per radian
    assert ["uniform", "B", "11.5 µm"] in [row[1:4] for row in rig if len(row) > 1]
    assert "linear model refused" in next(row[0] for row in rig if row[0].startswith("At 8 m"))


def test_of_many_inputs_the_report_shows_those_that_matter(result: Result) -> None:
    """Thirty inputs of falling contributions: those that make up 99 % of the variance, at most twelve."""
    data = result.data["budget"].to_dataset().sel(source=["pixel_noise"] * 30).isel(camera=[1]).copy(deep=True)
    data = data.assign_coords(source=[f"input_{k}" for k in range(30)])
    parts = 0.5 ** np.arange(30)
    data["variance"] = data["variance"][:, :, :1].to_numpy() * parts + 0.0 * data["variance"]
    data["combined_uncertainty"] = np.sqrt(data["variance"].sum("source"))
    rows = tables(Result(data=result.data.assign({"budget": type(result.data)(data)}), run_record={}))[0]
    shown = rows[1 : rows.index(next(row for row in rows[1:] if len(row) == 1))]
    assert [row[0] for row in shown] == [f"input {k}" for k in range(7)] + ["23 other inputs"]
    assert shown[-1][-1] == "0.781 %"


def test_of_many_pairs_the_report_gives_the_sum(tmp_path: Path) -> None:
    """Five correlated inputs and the noise have 16 rows: the inputs stand alone, all ten pairs together."""
    names = ("yaw", "pitch", "roll", "baseline", "focal_length")
    deviations = dict.fromkeys(names[:3], "0.1 deg") | dict.fromkeys(names[3:], "20 um")
    errors = ", ".join(f"{name}: {{standard_deviation: {value}}}" for name, value in deviations.items())
    tied = ", ".join(
        f"{one}: {{{', '.join(f'{other}: 0.5' for other in names[k + 1 :])}}}" for k, one in enumerate(names[:-1])
    )
    file = tmp_path / "rig.yaml"
    start, end = STUDY.index("      errors:"), STUDY.index("  perfect:")
    calibration = f"      errors: {{{errors}}}\n      correlations: {{{tied}}}\n"
    file.write_text(STUDY[:start] + calibration + STUDY[end:], encoding="utf-8")
    result = tradestudy.load(file).run()
    frame, rows = result.budget("rig", 0.663), tables(result)[0]
    own = rows[1 : rows.index(next(row for row in rows[1:] if len(row) == 1))]
    assert len(frame) == 16
    pairs = frame["variance"][frame["distribution"] == ""].sum() / frame.attrs["combined_uncertainty"] ** 2
    assert own[-1] == ["10 correlated pairs", "", "", "", "", "", share(pairs).replace("\N{NO-BREAK SPACE}", " ")]


@pytest.mark.usefixtures("empty_figures")
def test_the_csv_has_what_python_gives(result: Result, tmp_path: Path) -> None:
    result.write(tmp_path, pdf=False)
    written = pd.read_csv(tmp_path / "tables" / "budget_by_camera_distance_source.csv")
    rows = written[(written["camera"] == "rig") & np.isclose(written["distance [m]"], 0.2)].set_index("source")
    frame = result.budget("rig", 0.2)
    np.testing.assert_array_equal(rows.loc[frame.index, "variance [m²]"], frame["variance"])
