"""The focused plenoptic camera against published figures and its own exact model perturbed."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cameras.builders import F_MAIN, PITCH, depth_read, r5
from tradestudy.cameras.depth_camera import UsableCriteria
from tradestudy.errors import OutOfRangeError


def sigma_v(camera, distance: float) -> float:
    """σ_v of pixel noise over σ_u/D, σ_u the error of one micro-image coordinate."""
    noise = float(camera.noise(distance))
    v, d = float(camera.virtual_depth(distance)), float(camera.disparity(distance))
    error_of_v = abs(v / d) * noise
    one_coordinate = noise / math.sqrt(2)
    return error_of_v / (one_coordinate / PITCH)


def test_published_noise_of_the_estimators() -> None:
    one_type = {"lenses": "all"}
    v = float(r5().virtual_depth(1.0))
    assert sigma_v(r5(estimator="adjacent-pair", **one_type), 1.0) == pytest.approx(math.sqrt(2) * v**2, rel=1e-9)
    assert sigma_v(r5(), 1.0) == pytest.approx(math.sqrt(2) * v**2 / math.sqrt(3), rel=1e-9)
    # All lenses by least squares: 2.97 for matched f-numbers and many lenses; the disc is z/b larger than |v|/2 here.
    assert sigma_v(r5(estimator="least-squares", **one_type), 1.0) == pytest.approx(
        2.97 * (12.658 / 14.773) ** 2, rel=0.03
    )


def test_one_sharp_type_of_three_costs_least_squares_the_root_of_three() -> None:
    everything = r5(estimator="least-squares", lenses="all")
    one = r5(estimator="least-squares", lenses="sharpest-type")
    # √3 for many lenses; a disc that holds only four or five of one type is worse, never better.
    assert 1.0 < sigma_v(one, 1.0) / sigma_v(everything, 1.0) / math.sqrt(3) < 1.1


@pytest.mark.parametrize(("distance", "relative"), [(0.5, 0.05), (1.0, 0.12)])
def test_published_uncertainty_of_the_reconstruction(distance: float, relative: float) -> None:
    slope = (depth_read(r5(), distance, pixel_noise=1e-9)[0] - distance) / 1e-9
    assert abs(slope * float(r5().noise(distance))) / distance == pytest.approx(relative, abs=0.005)


def test_published_equivalent_baselines_at_one_metre() -> None:
    assert float(r5().equivalent_baseline(1.0)) == pytest.approx(0.36e-3, abs=0.005e-3)
    everything = r5(estimator="least-squares", lenses="all")
    # 1.3 mm with the disc of |v|/2 pitches; the geometry's own disc is z/b larger, the baseline grows with its square.
    assert float(everything.equivalent_baseline(1.0)) == pytest.approx(1.36e-3 * (14.773 / 12.658) ** 2, rel=0.03)


def test_one_micrometre_of_z_and_f_moves_one_metre_by_published_amounts() -> None:
    camera = r5()

    def moved(**errors: float) -> float:
        return float(depth_read(camera, 1.0, **errors)[0]) - 1.0

    assert moved(mla_distance=1e-6, focal_length=1e-6) == pytest.approx(0.159e-3, abs=0.0005e-3)
    assert moved(mla_distance=1e-9) == pytest.approx(-6.24e-6, rel=1e-3)
    assert moved(focal_length=1e-9) == pytest.approx(6.40e-6, rel=1e-3)
    # Aluminium over the focal length, 23e-6 per kelvin.
    assert abs(moved(mla_distance=23e-6 * F_MAIN)) == pytest.approx(1.8e-3, abs=0.05e-3)
    assert abs(moved(focal_length=-10e-6)) == pytest.approx(60e-3, abs=5e-3)


def test_last_disparity_step_of_the_published_reconstruction() -> None:
    limit = UsableCriteria(disparity_step_px=0.1)
    distance = np.linspace(6.0, 8.0, 2001)
    met = r5().limits(distance, limit)["last_disparity_step"].met
    assert 6.6 < distance[met].max() < 6.95
    adjacent = r5(estimator="adjacent-pair", lenses="all").limits(np.linspace(3, 5, 2001), limit)["last_disparity_step"]
    assert np.linspace(3, 5, 2001)[adjacent.met].max() == pytest.approx(4.0, abs=0.1)


def test_types_are_sharp_in_the_published_intervals() -> None:
    camera = r5()
    edges = np.array([0.150, 0.187, 0.307])
    blur = camera.blur_px(edges)
    assert blur[0, :2] == pytest.approx([1.0, 1.0], abs=0.05)
    assert blur[1, 1:] == pytest.approx([1.0, 1.0], abs=0.05)


@given(a=st.floats(0.05, 50.0), step=st.floats(0.01, 0.5))
def test_discrimination_moves_the_disparity_by_one_step(a: float, step: float) -> None:
    camera = r5(discrimination_step_px=step)
    nearer, farther = (float(value) for value in camera.depth_discrimination(a))
    if abs(float(camera.virtual_depth(a))) < 1e-3 or abs(float(camera.virtual_depth(a - nearer))) < 1e-3:
        return
    moved = camera.disparity_px(a - nearer) - camera.disparity_px(a)
    assert float(moved) == pytest.approx(step, rel=1e-6)
    if math.isfinite(farther):
        assert float(camera.disparity_px(a) - camera.disparity_px(a + farther)) == pytest.approx(step, rel=1e-4)


def test_a_galilean_relay_sees_up_to_infinity() -> None:
    z = F_MAIN / (1 + 2 * PITCH / (F_MAIN / 3.8))
    gap = PITCH * z / (F_MAIN / 3.8)
    array = dataclasses.replace(
        r5().microlenses, gap=gap, focal_lengths=tuple(gap / (1 - 0.5 + k / 23) for k in (1, 3, 5))
    )
    camera = r5(microlenses=array, mla_distance=z)
    assert float(camera.virtual_depth(math.inf)) == pytest.approx(-2.0, rel=1e-9)
    distance = np.geomspace(10, 100, 2001)
    met = camera.limits(distance, UsableCriteria(disparity_step_px=0.1))["last_disparity_step"].met
    # Published as 36 m for a gap of 0.432 mm; depth goes as 1/gap.
    assert distance[met].max() == pytest.approx(36.0 * 0.432e-3 / gap, rel=0.01)


def test_noise_beyond_the_pole_keeps_its_rank() -> None:
    camera = r5()
    d = float(camera.disparity(3.0))
    depths = depth_read(camera, 3.0, pixel_noise=np.linspace(0.5, -1.5, 201) * d)[:, 0]
    assert np.all(np.diff(depths[np.isfinite(depths)]) >= 0)
    first_lost = int(np.argmax(np.isinf(depths)))
    assert first_lost > 0
    assert np.all(np.isinf(depths[first_lost:]))


def test_impossible_cameras_are_refused() -> None:
    with pytest.raises(OutOfRangeError, match=r"all \(allowed: sharpest-type\)"):
        r5(lenses="all")
    with pytest.raises(OutOfRangeError, match="no such error"):
        depth_read(r5(), 1.0, yaw=0.1)
    with pytest.raises(OutOfRangeError, match="overlap"):
        dataclasses.replace(r5().microlenses, aperture_diameter=130e-6)
    with pytest.raises(OutOfRangeError, match="1 or 3 types"):
        dataclasses.replace(r5().microlenses, focal_lengths=(4e-4, 4.1e-4))


def test_a_camera_without_errors_reads_the_truth_whatever_was_read_before() -> None:
    """Observations and baselines are kept from one reading to the next; a change of colour is not."""
    cameras = (r5(), r5(estimator="least-squares", lenses="all"), r5(mla_distance=14.8e-3))
    places = (np.array([0.3, 1.0, 2.0]), np.array([0.4, 1.0, 2.0]), np.array([[0.3], [1.0], [2.0]]))
    for _ in range(2):
        for camera in cameras:
            for place in places:
                for field in (0.0, 0.7):
                    found = camera.read(place, field, {})
                    np.testing.assert_allclose(found.inverse_depth * place, 1.0, rtol=1e-9)
                    assert not found.out_of_range.any()
                    shifted = camera.read(place, field, {"color_shift": np.array(1e-5)})
                    assert (np.abs(shifted.inverse_depth * place - 1.0) > 1e-4).all()
