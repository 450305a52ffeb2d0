"""What a rig calibrated from corners reads, against plain numpy on the saved draws, and against the ideal rig."""

import numpy as np
import pytest

from tests.calibration.cameras import corners, stereo
from tests.calibration.plain_pair import depths_read
from tests.calibration.radial_rig import SHARED_NAMES
from tests.data.simulate_corners import true_rig
from tradestudy.calibration.corners.corner_file import read_corners
from tradestudy.calibration.corners.real_rig import fit_rig
from tradestudy.calibration.corners.rig_measurement import RigMeasurement, rig_parameters
from tradestudy.cameras.calibrated_pair import RADIAL
from tradestudy.cameras.depth_measurement import Environment
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.triangulation import depth_of_inverse

DISTANCES = np.array([0.3, 0.5, 1.0, 2.0, 5.0])


def measurement(best, camera=None, pixels=(1024, 1024)):
    camera = stereo() if camera is None else camera
    return RigMeasurement(
        best=np.asarray(best, dtype=float),
        pixels=pixels,
        pixel_pitch=camera.sensor.pixel_pitch,
        vocabulary={**rig_parameters(RADIAL), **camera.error_vocabulary},
    )


def half_width(depths):
    low, high = np.quantile(depths, [0.158655, 0.841345], axis=0)
    return (high - low) / 2.0


@pytest.mark.slow
def test_the_measured_rig_reads_depth_as_well_as_its_saved_draws_say(calibrated_webcams):
    """0.59, 0.78, 3.0, 15.6 and 114 mm on the axis, by 1500 of the draws in plain numpy."""
    assert calibrated_webcams.failures == ()
    best, draws = calibrated_webcams.posterior.best, calibrated_webcams.posterior.draws
    assert draws.shape == (2**13, 18)
    group, measurement = calibrated_webcams.calibration.groups[0], calibrated_webcams.calibration.measurement
    exact = depth_of_inverse(
        measurement(DISTANCES, 0.0, dict(zip(SHARED_NAMES, group.draws.T[..., None], strict=True))).inverse_depth
    )
    found = half_width(exact)
    np.testing.assert_allclose(found, [0.595e-3, 0.780e-3, 2.97e-3, 15.6e-3, 114.5e-3], rtol=0.05)
    centre = -np.linalg.inv(rotation(best[12:15])) @ best[15:18]
    axis = rotation(best[12:15])[2] + [0.0, 0.0, 1.0]
    points = np.stack([np.append(centre[:2] / 2 + z * axis[:2] / axis[2], z) for z in DISTANCES])
    some = np.arange(0, 2**13, 6)
    plain = depths_read(best, best + (draws - draws.mean(axis=0))[some], points)
    np.testing.assert_allclose(plain, exact[some], rtol=1e-9)
    # 1366 draws place half a 68 % interval to 2.6 % (one standard error)
    np.testing.assert_allclose(half_width(plain), found, rtol=3 * 0.026)


def rotation(vector):
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).as_matrix()


def test_a_rig_without_error_reads_its_own_points(calibrated_webcams):
    read = calibrated_webcams.calibration.measurement
    for field in (0.0, 0.6):
        found = read(DISTANCES, field, {})
        np.testing.assert_allclose(found.inverse_depth[0] * DISTANCES, 1.0, rtol=1e-12)
        assert not found.no_overlap[:, DISTANCES >= 0.5].any()
    assert read(DISTANCES, 1.0, {}).no_overlap.all()  # the right camera does not see the left one's corner


def test_noise_of_disparity_goes_half_to_each_side():
    """For parallel axes depth is f B/(d + e) with the error e of disparity, and y takes no part."""
    parallel = [800.0, 800.0, 511.5, 511.5, 0.0, 0.0] * 2 + [0.0, 0.0, 0.0, -0.1, 0.0, 0.0]
    noise = np.random.default_rng(0).normal(0.0, 1e-6, (7, DISTANCES.size))
    found = measurement(parallel)(DISTANCES, 0.3, {"pixel_noise": noise})
    disparity = 800.0 * 0.1 / DISTANCES + noise / 10e-6
    np.testing.assert_allclose(found.inverse_depth, disparity / 80.0, rtol=1e-12)
    one = measurement(parallel)(DISTANCES, 0.0, {"pixel_noise": noise[:, :1]})
    np.testing.assert_allclose(one.inverse_depth, (80.0 / DISTANCES + noise[:, :1] / 10e-6) / 80.0, rtol=1e-12)


def test_a_warmer_housing_moves_depth_as_it_does_that_of_the_ideal_rig():
    """Disparity f B/Z in pixels: f grows by 23 ppm/K, B by 1 and a pixel by 2.6, over 10 K."""
    warm = Environment(
        housing_expansion=23e-6,
        baseline_expansion=1e-6,
        array_expansion=0.0,
        scale_expansion=2.6e-6,
        focal_length_expansion=0.0,
        glass_index=1.5,
        wavelength=550e-9,
        temperature=293.0,
        pressure=101325.0,
    )
    parallel = [800.0, 800.0, 511.5, 511.5, 0.0, 0.0] * 2 + [0.0, 0.0, 0.0, -0.1, 0.0, 0.0]
    changes = {"temperature_change": np.array([[10.0]]), "pressure_change": np.array([[1e3]])}
    found = measurement(parallel)(DISTANCES, 0.0, changes, warm).inverse_depth
    np.testing.assert_allclose(found * DISTANCES, (1.0 + 23e-5) * (1.0 + 1e-5) / (1.0 + 2.6e-5), rtol=1e-12)
    camera = stereo()
    np.testing.assert_allclose(found, camera.read(DISTANCES, 0.0, changes, warm).inverse_depth, rtol=1e-12)
    np.testing.assert_allclose(
        measurement(parallel)(DISTANCES, 0.0, changes).inverse_depth[0] * DISTANCES, 1.0, rtol=1e-14
    )


AGED = {
    "yaw": 1e-3, "pitch": 2e-3, "roll": 2e-3, "baseline": 1e-4, "baseline_direction_y": 1e-3, "focal_length": 2e-5,
    "principal_point": 1e-5, "left_focal_length": 1e-5, "right_principal_point_x": 2e-6, "left_principal_point_y": 2e-6,
    "left_distortion_k1": 0.01, "right_distortion_k2": 0.01,
}  # fmt: skip


@pytest.mark.parametrize("names", [*((name,) for name in AGED), tuple(AGED)])
@pytest.mark.parametrize("field", [0.0, 0.4])
def test_ageing_acts_as_on_the_ideal_rig(names, field):
    """The pair of `cameras.stereo.pair` is another code, in the frame of the baseline; here it is the left camera's.

    They differ where rays become skew, and one takes the disparity in the right picture, the other along the baseline:
    by products of two small angles.
    """
    camera = stereo()
    focal = camera.principal_distance / camera.sensor.pixel_pitch
    parallel = [focal, focal, 511.5, 511.5, 0.0, 0.0] * 2 + [0.0, 0.0, 0.0, -0.1, 0.0, 0.0]
    errors = {name: np.array([[AGED[name]]]) for name in names}
    found = measurement(parallel)(DISTANCES, field, errors).inverse_depth[0]
    expected = np.broadcast_to(camera.read(DISTANCES, field, errors).inverse_depth, (1, 5))[0]
    change = np.abs(expected - 1.0 / DISTANCES)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=5e-3 * change.max() + 3e-5)


def test_names_and_places_that_do_not_exist_are_refused():
    with pytest.raises(OutOfRangeError, match="has no such error: array_tilt"):
        measurement(true_rig())(DISTANCES, 0.0, {"array_tilt": np.zeros((1, 1))})
    with pytest.raises(OutOfRangeError, match=r"1\.5 \(allowed: 0"):
        measurement(true_rig())(DISTANCES, 1.5, {})


def test_simulated_corners_recover_the_rig_within_their_spread():
    """18 true parameters: χ² with 18 degrees of freedom, and no single one beyond 3.5 standard deviations."""
    from scipy.stats import chi2

    asked = corners(stereo())
    fit = fit_rig(read_corners(asked.folder / asked.part.file))
    off = fit.explained.shared - true_rig()
    assert 0.01 < chi2.sf(off @ np.linalg.solve(fit.covariance, off), 18) < 0.99
    assert np.all(np.abs(off) < 3.5 * np.sqrt(np.diag(fit.covariance)))
    assert fit.explained.noise_px == pytest.approx(0.1, rel=0.03)
    assert fit.explained.motion_scale < 2e-5  # nothing moved between the exposures
