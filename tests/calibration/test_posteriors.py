"""Calibrations inferred: from synthetic targets, and from the corners of a real rig."""

import numpy as np
import pytest

from tests.calibration.cameras import (
    MEASURED,
    board,
    corners,
    focused,
    normal,
    shown,
    stereo,
    unfocused,
    webcams,
)
from tests.calibration.radial_rig import SHARED_NAMES
from tradestudy.calibration.corners.corner_file import CornerFileError
from tradestudy.calibration.corners.rig_measurement import GeometryContradictionError, check_geometry, rig_parameters
from tradestudy.calibration.posteriors import MOST_DRAWS, infer, to_infer
from tradestudy.cameras.calibrated_pair import RADIAL
from tradestudy.cameras.calibration_declaration import calibration_part
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.errors import NotConvergedError, OutOfRangeError
from tradestudy.execution.steps import fingerprint
from tradestudy.uncertainty.distributions import StudentT, Uniform
from tradestudy.uncertainty.joint import JointNormal
from tradestudy.uncertainty.sources import ErrorClass, Source

PRIORS = (
    normal("yaw", np.radians(0.2)),
    Source(name="baseline_direction_z", distribution=Uniform(low=-3e-3, high=3e-3), error_class=ErrorClass.RIG),
    normal("right_principal_point_x", 50e-6),
)
R5_PRIORS = tuple(
    normal(name, deviation)
    for name, deviation in {
        "mla_distance": 20e-6, "focal_length": 20e-6, "microlens_gap": 5e-6, "microlens_pitch": 1e-10,
        "array_tilt_x": 1.7e-3, "array_tilt_y": 1.7e-3, "array_offset_x": 50e-6, "array_offset_y": 50e-6,
        "field_curvature": 20e-6, "depth_distortion": 0.01, "distortion_k1": 0.02, "distortion_k2": 0.05,
    }.items()
)  # fmt: skip
CAREFUL = board(views=60, spacing=0.02, distances=(0.16, 1.0), half_field_angle=0.29, tilt=0.35, max_steps=20_000)


def r5(target=CAREFUL):
    """The R5 of the shipped study, calibrated; the scatter of its microlenses is no prior."""
    scatter = normal("microlens_center_scatter", 0.2e-6, ErrorClass.ELEMENT)
    return infer(shown(focused(), (*R5_PRIORS, scatter), target))


@pytest.mark.slow
def test_a_posterior_at_full_size_converges():
    inferred = r5()
    diagnostics = inferred.sample.diagnostics
    assert inferred.failures == ()
    assert diagnostics.lengths >= 50
    assert diagnostics.r_hat.max() <= 1.01
    assert min(diagnostics.bulk_effective_size.min(), diagnostics.tail_effective_size.min()) >= 400
    assert inferred.sample.chains.shape[0] >= 4
    (group,) = inferred.calibration.groups
    assert group.parameters == tuple(prior.name for prior in R5_PRIORS)
    assert group.error_class is ErrorClass.RIG
    assert group.draws.shape == (MOST_DRAWS, 12)


def test_the_target_ties_array_distance_and_focal_length():
    """What depth needs, z − f_M, is known better than either; Laplace and emcee agree."""
    inferred = r5(CAREFUL.model_copy(update={"views": 10, "max_steps": 400}))
    (group,) = inferred.calibration.groups
    z, f = group.parameters.index("mla_distance"), group.parameters.index("focal_length")
    covariance = group.covariance
    assert group.correlation[z, f] > 0.7
    difference = covariance[z, z] - 2 * covariance[z, f] + covariance[f, f]
    assert difference < 0.7 * min(covariance[z, z], covariance[f, f])
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)) / inferred.laplace_deviation, 1.0, atol=0.06)
    pitch = group.parameters.index("microlens_pitch")  # white images have said it better than the target
    assert np.sqrt(covariance[pitch, pitch]) == pytest.approx(1e-10, rel=0.05)


@pytest.mark.parametrize(
    ("camera", "priors", "part"),
    [
        (stereo(), PRIORS, board(max_steps=200)),
        (unfocused(), R5_PRIORS[:3], board(spacing=0.02, distances=(0.12, 0.3), half_field_angle=0.1, max_steps=200)),
    ],
)
def test_a_target_shrinks_what_depth_needs(camera, priors, part):
    """Depth by draws of the posterior beside depth by draws of the priors, by the same measurement."""
    # A uniform prior no wider than the posterior is refused where the peak lies outside: not with this seed.
    inferred = infer(shown(camera, priors, part, seed=5))
    (group,) = inferred.calibration.groups
    assert inferred.calibration.source == "target"
    at = np.array([part.distances[1]])
    scores = np.random.default_rng(0).standard_normal((group.dimensions, 4000))
    posterior = dict(zip(group.parameters, group.draw(scores)[..., None], strict=True))
    before = {
        prior.name: prior.draw(np.random.default_rng(k).standard_normal((1, 4000)))[0][:, None]
        for k, prior in enumerate(priors)
    }
    spread = [np.std(camera.read(at, 0.0, errors).inverse_depth) for errors in (posterior, before)]
    assert spread[0] < 0.3 * spread[1]
    if camera.family == "stereo":
        assert abs(group.correlation[0, 2]) > 0.9  # yaw and principal point look alike


def test_the_seed_says_which_rig_was_calibrated():
    """Up to 64 bits."""
    draws = [
        infer(shown(stereo(), PRIORS[:1], board(max_steps=50), seed=seed)).sample.draws for seed in (0, 0, 2**64 - 1)
    ]
    np.testing.assert_array_equal(draws[0], draws[1])
    distance = np.abs(draws[0].mean(axis=0) - draws[2].mean(axis=0))
    assert np.any(distance > 5 * draws[0].std(axis=0))


def test_corners_outside_the_sensor_are_not_seen():
    with pytest.raises(OutOfRangeError, match=r"rig: .* views: \d .allowed: at least 3 with 6 corners"):
        infer(shown(stereo(), PRIORS, board(spacing=2.0)))


@pytest.mark.parametrize(
    ("groups", "words"),
    [
        ((), "rig: .*errors"),
        (
            (
                JointNormal(
                    name="z and f",
                    parameters=("mla_distance", "focal_length"),
                    mean=np.zeros(2),
                    covariance=1e-12 * np.eye(2),
                    error_class=ErrorClass.RIG,
                ),
            ),
            ": mla_distance, focal_length .*independent",
        ),
        (
            (
                Source(
                    name="mla_distance",
                    distribution=StudentT(location=0.0, scale=1e-6, degrees_of_freedom=4.0),
                    error_class=ErrorClass.RIG,
                ),
            ),
            r"mla_distance .*: StudentT .allowed: normal or uniform",
        ),
    ],
)
def test_invalid_priors_are_refused(groups, words):
    with pytest.raises(OutOfRangeError, match=words):
        infer(shown(focused(), groups, CAREFUL))


def test_a_target_that_determines_nothing_names_the_parameters():
    flat = Source(name="left_distortion_k2", distribution=Uniform(low=-1.0, high=1.0), error_class=ErrorClass.RIG)
    with pytest.raises(NotConvergedError, match=r"do not determine|does not converge"):
        infer(shown(stereo(), (flat,), board(views=3, spacing=1e-6)))


@pytest.mark.slow
def test_chains_that_are_too_short_are_not_called_converged():
    assert any("too short" in one for one in infer(shown(stereo(), PRIORS, board(max_steps=100), seed=5)).failures)
    assert any("too short" in one for one in infer(corners(webcams(), MEASURED, steps=100)).failures)


def test_requested_posteriors_follow_from_the_declaration():
    """Nothing without target or corners; requests can be distinguished, so that each is computed once."""
    part = calibration_part(type(stereo()), "stereo")
    folder = {"folder": MEASURED.parent, "seed": 3}
    assert to_infer("rig", stereo(), part(errors={"yaw": {"standard_deviation": "0.2 deg"}}), **folder) is None
    asked = to_infer("rig", webcams(), part(corners={"file": MEASURED.name}), **folder)
    assert asked.content == corners(webcams(), MEASURED).content
    view = {
        "views": 8, "columns": 3, "rows": 3, "spacing": "0.1 m", "distances": ["1 m", "3 m"],
        "half_field_angle": "3 deg", "tilt": "25 deg", "corner_noise": "0.1 px",
    }  # fmt: skip
    target = to_infer("rig", stereo(), part(errors={"yaw": {"standard_deviation": "0.2 deg"}}, target=view), **folder)
    assert [group.name for group in target.groups] == ["yaw"]
    assert fingerprint(asked) != fingerprint(target)


@pytest.mark.slow
def test_the_real_rig_is_more_uncertain_than_it_claims(calibrated_webcams):
    """0.24 px of the pair against 0.16 px per camera; the left-right term explains it and widens the errors."""
    inferred = calibrated_webcams
    assert inferred.check.passed
    assert inferred.calibration.groups[0].parameters == SHARED_NAMES
    assert set(rig_parameters(RADIAL)) == set(SHARED_NAMES)
    fit = inferred.fit
    assert fit.left.corner_rms_px == pytest.approx(0.16, abs=0.01)
    assert fit.pair.corner_rms_px == pytest.approx(0.24, abs=0.01)
    assert fit.means.correlation < -0.99
    assert fit.explained.overconfidence[12:].min() > 1.2  # of the relative pose
    assert fit.explained.overconfidence.max() > 5.0


@pytest.fixture(scope="module")
def measured(calibrated_webcams):
    """Best parameters of the webcams, and draws about them by the fit."""
    fit = calibrated_webcams.fit.explained
    return fit.shared, np.random.default_rng(0).multivariate_normal(fit.shared, fit.covariance, 2000)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"baseline": 0.060}, "declared baseline 60 mm, corners say 94.1 ± 0.2 mm; correct cameras.rig.baseline or"),
        (
            {"convergence_angle": 0.2},
            "angle between the axes 11.46°, corners say 1.43 ± 0.04°; correct cameras.rig.convergence_distance or",
        ),
        (
            {"sensor": Sensor(columns=640, rows=360, pixel_pitch=6e-6)},
            "focal length 231.3 px, corners say .* px; correct cameras.rig.lenses or use another corner file",
        ),
        (
            {"sensor": Sensor(columns=1280, rows=720, pixel_pitch=3e-6)},
            r"declared sensor 1280 × 720 px, corners say that the left and right optical axes meet it at \(\d+, "
            r"\d+\) and \(\d+, \d+\) px; correct cameras.rig.sensor.pixels or use another corner file$",
        ),
    ],
)
def test_a_contradiction_of_declared_geometry_and_corners_gives_both_values(measured, changes, words):
    check_geometry("rig", webcams(), *measured, says="corners say")
    with pytest.raises(GeometryContradictionError, match=words):
        check_geometry("rig", webcams(**changes), *measured, says="corners say")


def test_all_contradictions_are_reported(measured):
    longer = webcams(lens=Lens(focal_length=30.5e-3, f_number=8.0), baseline=0.06, convergence_angle=0.1)
    with pytest.raises(GeometryContradictionError) as caught:
        check_geometry("rig", longer, *measured, says="corners say")
    lines = str(caught.value).splitlines()
    assert caught.value.exit_status == 2
    assert [line.split(",")[0] for line in lines] == [
        "declared focal length 10170 px",
        "declared baseline 60 mm",
        "declared angle between the axes 5.73°",
    ]
    assert "corners say 94.1 ± 0.2 mm; correct cameras.rig.baseline or " in lines[1]


def test_a_contradiction_counts_from_five_percent(measured):
    baseline = np.linalg.norm(measured[0][15:18])
    check_geometry("rig", webcams(baseline=baseline / 1.049), *measured, says="corners say")
    with pytest.raises(GeometryContradictionError, match="declared baseline"):
        check_geometry("rig", webcams(baseline=baseline / 1.054), *measured, says="corners say")


def test_corners_outside_the_declared_sensor_are_reported():
    small = webcams(sensor=Sensor(columns=320, rows=240, pixel_pitch=3e-6))
    with pytest.raises(GeometryContradictionError, match=r"sensor 320 × 240 px, .*sensor.pixels"):
        infer(corners(small, MEASURED))


def test_a_corner_file_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(CornerFileError, match=r"none\.csv cannot be read: No such file"):
        infer(corners(webcams(), tmp_path / "none.csv"))
