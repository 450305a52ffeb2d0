"""Propagation of a study's errors against closed forms, and what is said where moments do not exist."""

import numpy as np
import pytest
from scipy.special import ndtri

from tradestudy.analysis.depth import WAYS, evaluate_depth
from tradestudy.analysis.propagation import moments_end, propagate_way
from tradestudy.analysis.sensitivity import sensitivity_of
from tradestudy.analysis.uncertain_decision import crossovers, rank, stability
from tradestudy.calibration.declaration import StabilityQuestionPart
from tradestudy.execution import Steps
from tradestudy.study.loading import load_definition

SETTINGS = {"accuracy": 0.005, "budget": 2**16, "seed": 0}


@pytest.fixture
def uncertain(written):
    def assemble(cameras, overrides=()):
        definition = load_definition(written(cameras), tuple(overrides))
        part = definition.file.calibration
        return definition, definition.uncertain_cameras(part, Steps()).cameras

    return assemble


@pytest.mark.parametrize("name", ["rig", "r5"])
def test_sampling_agrees_with_the_closed_form_of_the_study(uncertain, name):
    """/depth adds the same errors up in closed form; the two tiers know nothing of each other."""
    definition, cameras = uncertain("rig: {}\nr5: {}")
    distance = np.array([0.4, 0.8, 1.5, 3.0])
    closed = evaluate_depth(definition.case.cameras[name], distance)
    for number, way in enumerate(WAYS):
        found = propagate_way(cameras[name], distance, 0.0, way, **SETTINGS).monte_carlo
        expected = closed.quantile[number].T
        finite = np.isfinite(expected)
        assert np.array_equal(finite, np.isfinite(found.quantiles))
        allowed = 3.0 * found.quantiles_error[finite] + 2e-4 * expected[finite]  # /depth is linear in calibration
        np.testing.assert_array_less(np.abs(found.quantiles - np.where(finite, expected, 0.0))[finite], allowed)
        np.testing.assert_allclose(
            found.infinite_fraction, closed.failed_fraction[number], atol=3e-4 + 3 * found.infinite_fraction_error.max()
        )


def test_stereo_closed_form_within_three_standard_errors(uncertain):
    """An error of disparity that is normal: quantiles f B/(d₀ + s Φ⁻¹), 5.9375, 10 and 31.66 m at 10 m."""
    _, cameras = uncertain(
        "rig: {}",
        ["rig.calibration.yaw=null", "rig.calibration.yaw.standard_deviation=1e-9 deg",
         f"rig.calibration.principal_point.standard_deviation={30.5 * float(np.radians(0.2))!r} mm"],
    )  # fmt: skip
    settings = SETTINGS | {"accuracy": 1e-4, "budget": 2**18}
    found = propagate_way(cameras["rig"], np.array([10.0]), 0.0, "calibration", **settings).monte_carlo
    error = found.quantiles_error[[0, 2, 4], 0]
    expected = 0.1 / (0.01 + np.radians(0.2) * ndtri([0.975, 0.5, 0.025]))
    assert expected[0] == pytest.approx(5.9375, rel=5e-5)
    np.testing.assert_array_less(np.abs(found.quantiles[[0, 2, 4], 0] - expected), 3.0 * error + 1e-4)
    assert found.infinite_fraction[0] == pytest.approx(2.09e-3, abs=4 * found.infinite_fraction_error[0] + 1e-5)
    assert not found.moments_exist[0]
    assert np.isnan(found.standard_deviation[0])
    assert np.isnan(found.bias[0])


def test_moments_end_where_infinity_is_six_deviations_away(uncertain):
    """B/(6 ψ) = 4.77 m for 0.2° and 100 mm."""
    _, cameras = uncertain("rig: {}")
    distance = np.array([1.0, 3.0, 4.0, 6.0, 10.0])
    found = propagate_way(cameras["rig"], distance, 0.0, "calibration", **SETTINGS).monte_carlo
    assert found.moments_exist.tolist() == [True, True, True, False, False]
    assert moments_end(found, distance) == pytest.approx(0.1 / (6 * np.radians(0.2)), rel=0.01)
    noise = propagate_way(cameras["rig"], distance, 0.0, "noise", **SETTINGS).monte_carlo
    assert moments_end(noise, distance) == np.inf


def test_tiers_are_chosen_by_the_accuracy_asked_for(uncertain):
    _, cameras = uncertain("rig: {}")
    distance = np.array([0.2, 0.5, 3.0, 10.0])
    found = propagate_way(cameras["rig"], distance, 0.0, "both", **SETTINGS)
    # Unseen at 0.2 m; linear to 0.5 % at 0.5 m; 3 m needs quantiles mapped back.
    assert found.tier[:3] == ("", "linear", "inverse linear")
    assert found.linear.verdict[3] == "invalid"
    assert found.monte_carlo.status[0] == "unranked"
    assert found.monte_carlo.failed[1, 0] == found.monte_carlo.draws  # counted as not seen
    rough = propagate_way(cameras["rig"], distance, 0.0, "both", **(SETTINGS | {"accuracy": 0.2}))
    assert rough.tier[2] == "linear"


def test_a_source_without_a_variance_has_no_line_but_quantiles(uncertain):
    _, cameras = uncertain(
        "rig: {errors: {left_distortion_k1: {shape: student-t, scale: 1e-3, degrees_of_freedom: 1.5}}}"
    )
    found = propagate_way(cameras["rig"], np.array([1.0]), 0.5, "both", **SETTINGS)
    assert found.linear.verdict.tolist() == ["no variance"]
    assert found.tier == ("sobol",)
    assert np.isfinite(found.monte_carlo.quantiles).all()
    assert not found.monte_carlo.moments_exist.any()
    driven = sensitivity_of(cameras["rig"], np.array([1.0]), 0.5, seed=0)
    assert driven.indices is None
    assert "a source has none" in driven.no_indices


def test_seed_zero_repeats_bit_for_bit_and_others_differ(uncertain):
    _, cameras = uncertain("rig: {}")
    at = np.array([1.0])
    runs = [
        propagate_way(cameras["rig"], at, 0.0, "both", **(SETTINGS | {"seed": seed})).monte_carlo.quantiles
        for seed in (0, 0, 1)
    ]
    assert np.array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_rank_probability_of_two_normal_errors_is_an_arctangent(uncertain):
    """P(|N(0, a)| < |N(0, b)|) = (2/π) atan(b/a): near enough for errors of a per mille."""
    _, cameras = uncertain("rig: {}\nother: {}")
    found = rank(cameras["other"], cameras["rig"], np.array([0.5, 1.0]), 0.0, "calibration", seed=0)
    np.testing.assert_allclose(found.first, 2 / np.pi * np.arctan(2.0), atol=0.003)
    np.testing.assert_allclose(found.first + found.second, 1.0, atol=1e-12)


def test_crossover_and_stability_are_those_of_the_closed_form(uncertain):
    definition, cameras = uncertain("rig: {}\nr5: {}", ["rig.calibration.yaw.standard_deviation=0.6 deg"])
    grid = np.geomspace(0.3, 3.0, 9)
    found = crossovers(cameras["r5"], cameras["rig"], grid, 0.0, "both", seed=0)
    fine = np.geomspace(0.3, 3.0, 4001)
    first, second = (evaluate_depth(definition.case.cameras[name], fine).uncertainty[2] for name in ("r5", "rig"))
    sign = np.flatnonzero(np.diff(np.sign(np.log(first / second))))
    assert len(found) == len(sign) == 1
    assert found[0].value == pytest.approx(fine[sign[0]], abs=4 * found[0].standard_error + 2e-3 * fine[sign[0]])
    question = StabilityQuestionPart(
        says="?", camera="rig", parameter="yaw", at=f"{found[0].value} m", equal="r5", way="both"
    )
    answer = stability(question, cameras, seed=0)
    assert answer.value == pytest.approx(np.radians(0.6), rel=5e-3)
    assert answer.as_declared == pytest.approx(answer.wanted, rel=5e-3)


def test_a_question_without_an_answer_says_why(uncertain):
    _, cameras = uncertain("rig: {}\nr5: {}")
    beyond = StabilityQuestionPart(
        says="?", camera="r5", parameter="mla_distance_and_focal_length", at="0.5 m", relative="1 %"
    )
    answer = stability(beyond, cameras, seed=0)
    assert np.isnan(answer.value)
    assert answer.reason == "not even without this error"
    assert answer.without > answer.wanted == pytest.approx(5e-3)
    alone = beyond.model_copy(update={"way": "calibration"})
    solved = stability(alone, cameras, seed=0)
    # Both deviations σ, correlated by ρ: u = (a − f)²/f² σ √(1 − 2ρw + w²), w = (1 + s/f)²; the gap adds (v b_L δ)².
    assert solved.value == pytest.approx(needed_deviation(), rel=0.01)


def needed_deviation():
    f, a, wanted = 12.5e-3, 0.5, 5e-3
    weight = (a / (a - f)) ** 2
    slope = ((a - f) / f) ** 2
    gap = 0.568093e-3
    v = (14.77255e-3 - f * a / (a - f)) / gap
    rest = slope * v * 0.2e-6
    return np.sqrt(wanted**2 - rest**2) / (slope * np.sqrt(1 - 2 * 0.9 * weight + weight**2))


def test_what_drives_depth_is_shared_out(uncertain):
    _, cameras = uncertain("rig: {}\nr5: {}")
    found = sensitivity_of(cameras["rig"], np.array([1.0]), 0.5, seed=0)
    bars = dict(zip(found.groups.names, found.groups.half_width[:, 0], strict=True))
    slope = 30.5e-3 * 0.1
    noise = 0.1 * 10e-6 / np.sqrt(2)
    assert bars["rig/left_pixel_noise"] == pytest.approx(noise / slope, rel=0.01)
    x = 0.5 * 5.12e-3 / 30.5e-3 - 0.05
    assert bars["rig/yaw"] == pytest.approx(np.radians(0.2) / 0.1 * (1 + x**2), rel=0.01)
    assert found.indices is not None
    np.testing.assert_allclose(found.indices.first.sum(axis=0), 1.0, atol=0.02)
    refused = sensitivity_of(cameras["r5"], np.array([0.5]), 0.0, seed=0)
    assert refused.parameters is None
    assert "mla_distance and focal_length correlated by +0.900" in refused.refused
