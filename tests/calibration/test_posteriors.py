"""Calibrations inferred for a study: from synthetic targets, and from the corners of a real rig."""

import numpy as np
import pytest

from tests.calibration.conftest import STUDIES
from tradestudy.analysis.propagation import propagate_way
from tradestudy.calibration.corners.corner_file import CornerFileError
from tradestudy.calibration.posteriors import CORNER_NOISE_NAMES, infer_from_target
from tradestudy.calibration.sources import declared_groups
from tradestudy.errors import NotConvergedError, OutOfRangeError
from tradestudy.execution import Steps
from tradestudy.run.groups.real_rig import rig_rows
from tradestudy.study.loading import load_definition
from tradestudy.uncertainty.error_class import ErrorClass

BOARD = "columns: 3, rows: 3, half_field: 0.05, tilt: 25 deg, corner_noise: 0.1 px"
SMALL = f"""
rig:
  errors:
    right_principal_point_x: {{shape: normal, standard_deviation: 50 um}}
    baseline_direction_z: {{shape: uniform, half_width: 3 mrad}}
  target: {{views: 8, spacing: 100 mm, distances: [1 m, 3 m], {BOARD}, maximum_steps: 300}}
"""


def assembled(file, overrides=()):
    definition = load_definition(file, tuple(overrides))
    return definition, definition.uncertain_cameras(definition.file.calibration, Steps())


@pytest.fixture(scope="module")
def shipped():
    """The R5 of the shipped study, calibrated at full size."""
    definition = load_definition(STUDIES / "calibration.yaml")
    part = definition.file.calibration
    name = "raytrix-r5-calibrated"
    camera = definition.case.cameras[name]
    groups = declared_groups(camera, part.cameras[name], STUDIES)
    return infer_from_target(name, camera, groups, part.cameras[name].target, seed=part.seed)


def test_the_shipped_posterior_converges(shipped):
    diagnostics = shipped.sample.diagnostics
    assert shipped.failures == ()
    assert diagnostics.lengths >= 50
    assert diagnostics.r_hat.max() <= 1.01
    assert min(diagnostics.bulk_effective_size.min(), diagnostics.tail_effective_size.min()) >= 400
    assert shipped.sample.chains.shape[0] >= 4


def test_the_target_ties_array_distance_and_focal_length(shipped):
    """What depth needs, z − f_M, is known better than either; Laplace and emcee agree."""
    names = shipped.group.parameters
    z, f = names.index("mla_distance"), names.index("focal_length")
    covariance = shipped.group.covariance
    assert shipped.group.correlation[z, f] > 0.7
    difference = covariance[z, z] - 2 * covariance[z, f] + covariance[f, f]
    assert difference < 0.7 * min(covariance[z, z], covariance[f, f])
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)) / shipped.laplace_deviation, 1.0, atol=0.06)
    pitch = names.index("microlens_pitch")  # the target says nothing of it that white images have not said better
    assert np.sqrt(covariance[pitch, pitch]) == pytest.approx(1e-10, rel=0.05)


def test_a_posterior_replaces_its_priors_and_shrinks_depth(written):
    file = written(SMALL + "other: {}")
    _, found = assembled(file)
    groups = {group.name: group for group in found.cameras["rig"].groups}
    assert set(groups) == {"calibration", "left_pixel_noise", "right_pixel_noise"}
    assert groups["calibration"].parameters == ("yaw", "baseline_direction_z", "right_principal_point_x")
    assert groups["calibration"].error_class is ErrorClass.RIG
    correlation = groups["calibration"].correlation
    assert abs(correlation[0, 2]) > 0.9  # yaw and principal point look alike
    at = {"accuracy": 0.01, "budget": 2**14, "seed": 0}
    uncertainty = [
        propagate_way(found.cameras[name], np.array([2.0]), 0.0, "calibration", **at).monte_carlo.half_width[0]
        for name in ("rig", "other")
    ]
    assert uncertainty[0] < 0.1 * uncertainty[1]


def test_the_seed_says_which_rig_was_calibrated(written):
    definition = load_definition(written(SMALL))
    part = definition.file.calibration.cameras["rig"]
    short = part.target.model_copy(update={"maximum_steps": 100})
    groups = declared_groups(definition.case.cameras["rig"], part, STUDIES)
    draws = [
        infer_from_target("rig", definition.case.cameras["rig"], groups, short, seed=seed).sample.draws
        for seed in (0, 0, 1)
    ]
    np.testing.assert_array_equal(draws[0], draws[1])
    distance = np.abs(draws[0].mean(axis=0) - draws[2].mean(axis=0))
    assert np.any(distance > 5 * draws[0].std(axis=0))


def test_corners_beside_the_sensor_are_not_seen(written):
    wide = SMALL.replace("spacing: 100 mm", "spacing: 600 mm")
    with pytest.raises(OutOfRangeError, match="seen in too few views"):
        assembled(written(wide))
    definition = load_definition(written(SMALL))
    rig = definition.case.cameras["rig"]
    left, _, right, _ = rig.observe({}, 0.3, 0.0, 1.0)
    assert abs(left) > rig.sensor.width / 2 > abs(rig.observe({}, 0.05, 0.0, 1.0)[0])
    assert right < left


def test_priors_that_are_tied_are_refused(written):
    board = f"target: {{views: 8, spacing: 20 mm, distances: [0.2 m, 1 m], {BOARD}}}"
    with pytest.raises(OutOfRangeError, match="mla_distance_and_focal_length is no prior"):
        assembled(written(f"r5: {{{board}}}"))


def test_chains_that_are_too_short_are_not_called_converged(written):
    file = written(SMALL.replace("maximum_steps: 300", "maximum_steps: 200"))
    _, found = assembled(file)
    assert any("too short" in failure for failure in found.calibrations["rig"].failures)


@pytest.fixture(scope="module")
def real():
    return assembled(STUDIES / "real_rig.yaml", ["calibration.cameras.webcams.corners.maximum_steps=400"])


def test_the_real_rig_reads_its_own_points(real):
    definition, found = real
    calibration, camera = found.calibrations["webcams"], found.cameras["webcams"]
    assert calibration.check.passed
    assert any("too short" in failure for failure in calibration.failures)  # 400 steps are not what is shipped
    assert camera.sources.parameters[-4:] == tuple("webcams/" + name for name in CORNER_NOISE_NAMES)
    distance = np.array(definition.file.calibration.distance_values())
    for field in (0.0, definition.file.calibration.edge):
        reading = camera.reading(distance, field, {})
        np.testing.assert_allclose(np.broadcast_to(reading.inverse_depth, (1, distance.size))[0] * distance, 1.0)
        assert not reading.no_overlap[distance >= 0.5].any()
    assert camera.reading(distance, 1.0, {}).no_overlap.all()  # the right camera does not see the left one's corner


def test_the_real_rig_is_more_uncertain_than_it_claims(real):
    """0.24 px of the pair against 0.16 px per camera; the left-right term explains it and widens the errors."""
    _, found = real
    rows = dict(zip(*(rig_rows(found.rigs)[name] for name in ("rig_quantity", "rig_value")), strict=True))
    assert rows["residual of the left camera alone"].startswith("0.16")
    assert rows["residual of the pair with one relative pose"].startswith("0.24")
    assert float(rows["correlation of the view means, left with right"].replace("−", "-")) < -0.99
    fit = found.rigs["webcams"].fit
    assert fit.explained.overconfidence[12:].min() > 1.2  # of the relative pose
    assert fit.explained.overconfidence.max() > 5.0
    assert "times too small" in rows["the same as claimed without the term"]


def test_depth_of_the_real_rig_follows_from_its_noise(real):
    """Single readings at 2 m: Z²/(f B) √2 σ of the corner noise, beside which calibration counts in quadrature."""
    _, found = real
    camera, rig = found.cameras["webcams"], found.rigs["webcams"]
    at = {"accuracy": 0.002, "budget": 2**16, "seed": 0}
    noise, calibration, both = (
        propagate_way(camera, np.array([2.0]), 0.0, way, **at).monte_carlo.half_width[0]
        for way in ("noise", "calibration", "both")
    )
    focal = rig.best[[0, 6]].mean()
    baseline = np.linalg.norm(rig.best[15:18])
    expected = 4.0 / (focal * baseline) * np.sqrt(2.0) * rig.fit.explained.noise_px
    assert noise == pytest.approx(expected, rel=0.03)
    assert both == pytest.approx(np.hypot(noise, calibration), rel=0.02)


def test_a_corner_file_that_contradicts_the_study_is_refused():
    with pytest.raises(CornerFileError, match="contradicts the declared baseline"):
        assembled(STUDIES / "real_rig.yaml", ["calibration.cameras.webcams.corners.declared_baseline=60 mm"])


def test_a_target_that_determines_nothing_says_what(written):
    flat = "errors: {left_distortion_k2: {shape: uniform, half_width: 1}}"
    board = f"target: {{views: 3, spacing: 1 um, distances: [1 m, 3 m], {BOARD}}}"
    with pytest.raises(NotConvergedError, match=r"do not determine|does not settle"):
        assembled(written(f"rig:\n  {flat}\n  {board}"))
