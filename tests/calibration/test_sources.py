"""What a study may say of errors, and what is refused in one clear line."""

import numpy as np
import pytest
from scipy import stats

from tests.calibration.calibration_files import write_calibration
from tradestudy.calibration.calibration_file import (
    CalibrationCovariance,
    CalibrationDraws,
)
from tradestudy.calibration.uncertain_cameras import sources_of
from tradestudy.errors import OutOfRangeError, StudyError
from tradestudy.execution import Steps
from tradestudy.study.loading import load_definition
from tradestudy.uncertainty.error_class import ErrorClass


def assembled(file):
    definition = load_definition(file)
    return definition.uncertain_cameras(definition.file.calibration, Steps())


SHAPES = """
r5:
  errors:
    microlens_pitch: {shape: normal, standard_deviation: 2 nm, mean: 1 nm}
    array_rotation: {shape: uniform, half_width: 1 mrad}
    array_tilt_x: {shape: triangular, half_width: 1 mrad}
    array_tilt_y: {shape: student-t, scale: 1 mrad, degrees_of_freedom: 5, drawn: per session}
    field_curvature: {shape: arcsine, half_width: 10 um}
    depth_distortion: {shape: curvilinear-trapezoid, half_width: 0.02, inexactness: 0.005, drawn: per lens}
    distortion_k1: {shape: empirical, file: k1.csv, column: k1}
"""


def test_every_shape_is_drawn_from_its_own_quantiles(written, tmp_path):
    file = written(SHAPES)
    (tmp_path / "k1.csv").write_text("k0,k1\n" + "".join(f"0,{value}\n" for value in range(10)))
    groups = {group.name: group for group in assembled(file).cameras["r5"].groups}
    p = np.array([0.03, 0.4, 0.9])
    expected = {
        "microlens_pitch": stats.norm(1e-9, 2e-9).ppf(p),
        "array_rotation": stats.uniform(-1e-3, 2e-3).ppf(p),
        "array_tilt_x": stats.triang(0.5, -1e-3, 2e-3).ppf(p),
        "array_tilt_y": stats.t(5, scale=1e-3).ppf(p),
        "field_curvature": stats.arcsine(-10e-6, 20e-6).ppf(p),
        "distortion_k1": [0.0, 3.0, 8.0],
    }
    for name, values in expected.items():
        np.testing.assert_allclose(groups[name].marginal(0).quantile(p), values, rtol=1e-12)
    # JCGM 101, 6.4.3: u² = (b − a)²/12 + d²/9.
    assert groups["depth_distortion"].marginal(0).standard_deviation == pytest.approx(
        np.sqrt(0.04**2 / 12 + 0.005**2 / 9)
    )
    classes = {name: group.error_class for name, group in groups.items()}
    assert classes["array_tilt_y"] is ErrorClass.SESSION
    assert classes["depth_distortion"] is ErrorClass.ELEMENT
    assert classes["pixel_noise"] is ErrorClass.MEASUREMENT
    assert classes["microlens_gap"] is ErrorClass.RIG
    tied = groups["mla_distance_and_focal_length"]
    np.testing.assert_allclose(tied.correlation, [[1.0, 0.9], [0.9, 1.0]])


def test_declared_correlations_tie_any_shapes(written):
    file = written(
        "rig:\n  errors:\n"
        "    left_distortion_k1: {shape: normal, standard_deviation: 0.01}\n"
        "    right_distortion_k1: {shape: uniform, half_width: 0.02}\n"
        "  joint: {lenses: {parameters: [left_distortion_k1, right_distortion_k1], correlation: [[1, 0.8], [0.8, 1]]}}"
    )
    group = next(g for g in assembled(file).cameras["rig"].groups if g.name == "lenses")
    drawn = group.draw(np.random.default_rng(0).standard_normal((2, 40_000)))
    # A Gaussian copula of normal scores correlated by ρ has the rank correlation (6/π) asin(ρ/2).
    assert stats.spearmanr(drawn[0], drawn[1]).statistic == pytest.approx(6 / np.pi * np.arcsin(0.4), abs=0.01)
    assert np.abs(drawn[1]).max() <= 0.02


def test_surroundings_are_shared_and_stand_once(written):
    body = "{housing_expansion: 23 ppm/K, focal_length_expansion: 10 ppm/K, glass_index: 1.52}"
    found = assembled(
        written(
            f"rig: {{body: {body}}}\nr5: {{body: {body}}}\nother: {{}}",
            "  surroundings:\n    calibrated_at_temperature: 20 degC\n    calibrated_at_pressure: 1 atm\n"
            "    temperature_change: {shape: normal, standard_deviation: 3 K}\n"
            "    pressure_change: {shape: uniform, half_width: 2 kPa}\n",
        )
    ).cameras
    both = sources_of(found["rig"], found["r5"])
    assert both.parameters.count("temperature_change") == 1
    assert "rig/yaw" in both.parameters
    assert "r5/mla_distance" in both.parameters
    assert "temperature_change" not in found["other"].sources.parameters
    classes = {group.name: group.error_class for group in both.groups}
    assert classes["pressure_change"] is ErrorClass.SESSION


@pytest.mark.parametrize("suffix", ["csv", "nc"])
def test_a_calibration_file_takes_the_place_of_what_it_determines(written, tmp_path, suffix):
    names = ("yaw", "right_principal_point_x")
    covariance = np.array([[1e-6, 0.996 * 1e-3 * 3e-5], [0.996 * 1e-3 * 3e-5, 9e-10]])
    calibration = CalibrationCovariance(names=names, mean=np.array([0.01, 1e-4]), covariance=covariance)
    write_calibration(tmp_path / f"rig.{suffix}", calibration)
    draws = np.random.default_rng(1).multivariate_normal([0.01, 1e-4], covariance, 5000)
    write_calibration(tmp_path / f"draws.{suffix}", CalibrationDraws(names=names, draws=draws))
    found = assembled(written(f"rig: {{file: rig.{suffix}}}\nother: {{file: draws.{suffix}}}")).cameras
    for name in ("rig", "other"):
        groups = {group.name: group for group in found[name].groups}
        assert "yaw" not in groups
        assert groups["calibration"].parameters == names
        np.testing.assert_allclose(groups["calibration"].nominal, 0.0, atol=1e-15)  # errors about its best values
        np.testing.assert_allclose(groups["calibration"].covariance, covariance, rtol=0.1)
        assert {"left_pixel_noise", "right_pixel_noise"} <= set(groups)


@pytest.mark.parametrize(
    ("cameras", "path", "words"),
    [
        ("rigg: {}", "calibration.cameras.rigg", "no camera is called 'rigg'; nearest: 'rig'"),
        ("rig: {errors: {array_tilt_x: {shape: uniform, half_width: 1 mrad}}}", "array_tilt_x", "no such error"),
        ("rig: {errors: {yaw: {shape: uniform, half_width: 1 mm}}}", "errors.yaw", "an angle"),
        ("rig: {errors: {yaw: {shape: gauss, half_width: 1 mrad}}}", "errors.yaw", "normal"),
        (
            "rig: {joint: {a: {parameters: [yaw, roll], correlation: [[1, 0], [0, 1]]}}}",
            "joint.a",
            "'yaw' is not among",
        ),
        ("r5: {corners: {file: a.csv}}", "r5.corners", "calibrate a stereo rig"),
        ("rig: {file: a.csv, corners: {file: a.csv}}", "rig.corners", "one joint calibration; file is given already"),
        ("rig: {}\n  compare: [[rig, r5]]", "compare", "'r5' is not among the cameras of calibration"),
    ],
)
def test_mistakes_are_told_with_their_place(written, cameras, path, words):
    of_cameras, _, after = cameras.partition("\n")
    with pytest.raises(StudyError) as error:
        load_definition(written(of_cameras, after + "\n"))
    told = [str(problem) for problem in error.value.problems]
    assert any(path in line and words in line for line in told), told


@pytest.mark.parametrize(
    ("cameras", "words"),
    [
        ("rig: {errors: {yaw: {shape: normal, standard_deviation: 1 mrad}}}", "already: yaw"),
        ("rig: {errors: {left_distortion_k1: {shape: empirical, file: no.csv, column: a}}}", "no.csv"),
        ("rig: {errors: {left_distortion_k1: {shape: empirical, file: small.yaml, column: a}}}", "no column of draws"),
        ("r5: {file: part.csv}", "determines a part of mla_distance_and_focal_length: mla_distance"),
        ("rig: {file: part.csv}", "does not have: mla_distance"),
    ],
)  # fmt: skip
def test_contradictions_between_calibrations_are_refused(written, tmp_path, cameras, words):
    part = CalibrationCovariance(names=("mla_distance",), mean=np.zeros(1), covariance=np.full((1, 1), 1e-12))
    write_calibration(tmp_path / "part.csv", part)
    with pytest.raises(OutOfRangeError, match=words):
        assembled(written(cameras))
