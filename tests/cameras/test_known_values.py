"""Known values of a calibration, against rays traced here, brute-force draws and difference quotients."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tradestudy
from tests.cameras.builders import depth_read, r5, unfocused
from tradestudy.cameras.calibration import Calibration
from tradestudy.cameras.depth_measurement import PicturePlace
from tradestudy.cameras.focused_plenoptic.focus import DepthScaling
from tradestudy.cameras.parts import Lens
from tradestudy.cameras.plenoptic import KNOWN_VALUES, PlenopticCamera
from tradestudy.depth.evaluation import depth_uncertainty
from tradestudy.errors import OutOfRangeError, StudyError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.distributions import Normal
from tradestudy.uncertainty.sources import ErrorClass, Source

KNOWN = {
    "array_rotation": 2e-3,
    "array_tilt_x": 4e-3,
    "array_tilt_y": -3e-3,
    "array_offset_x": 4e-5,
    "array_offset_y": -3e-5,
    "principal_point_x": 2.5e-4,
    "principal_point_y": -1.5e-4,
    "depth_distortion": 0.02,
    "depth_distortion_d0": 0.3,
    "depth_distortion_d1": 4e-5,
    "depth_distortion_d2": -2e-5,
    "distortion_k1": -0.08,
    "distortion_k2": 0.05,
    "distortion_k3": -0.02,
    "distortion_p1": 2e-3,
    "distortion_p2": -1e-3,
}
THICK = Lens(focal_length=12.5e-3, f_number=3.8, entrance_pupil=3e-3)
CAMERAS = [
    r5(estimator="adjacent-pair", lenses="all"),
    r5(mla_distance=11.9e-3),
    unfocused(),
    r5(main_lens=THICK),
    unfocused(main_lens=THICK),
]
POINTS = [(0.02, -0.05, 0.3), (-0.2, 0.25, 1.0), (0.9, 0.7, 4.0)]


def known(camera: Any, values: dict[str, float] | None = None) -> Any:
    return replace(camera, known=tuple((KNOWN if values is None else values).items()))


def traced(camera: PlenopticCamera, point: tuple[float, float, float]) -> tuple[float, float, float]:
    """What the camera with the known values observes of a point, by rays of vectors: disparity, x and y."""
    behind = camera.main_lens.entrance_pupil
    v, x, y = KNOWN, point[0] / (point[2] + behind), point[1] / (point[2] + behind)
    r2 = x * x + y * y
    g = 1.0 + v["distortion_k1"] * r2 + v["distortion_k2"] * r2**2 + v["distortion_k3"] * r2**3
    p1, p2 = v["distortion_p1"], v["distortion_p2"]
    chief = np.array(
        [x * g + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * g + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y, 1.0]
    )
    # Behind the lens it comes from the exit pupil, and is steeper by the ratio of the pupils.
    f, corner = camera.main_lens.focal_length, camera.geometry.corner
    ratio = 1.0 + behind / f
    chief[:2] *= ratio
    pupil = np.array([0.0, 0.0, behind / ratio])
    # The plane of the array contains (−p, z) and the two directions (1, 0, t_x) and (0, 1, t_y).
    z, gap = camera.geometry.mla_distance, camera.microlenses.gap
    tilt = np.array([v["array_tilt_x"], v["array_tilt_y"]])
    axis = np.array([v["principal_point_x"], v["principal_point_y"]])
    normal = np.array([-tilt[0], -tilt[1], 1.0])
    place = pupil + chief * (normal @ (np.array([-axis[0], -axis[1], z]) - pupil)) / (normal @ chief)
    # The image: thin lens, displaced along the chief ray, and its distance to the array stretched.
    b = 1.0 / (1.0 / f - 1.0 / point[2])
    rho2 = (chief[0] ** 2 + chief[1] ** 2) * (b - pupil[2]) ** 2 / corner**2
    d0, d1, d2 = (v[f"depth_distortion_d{k}"] for k in range(3))
    displaced = b + (1.0 + d0 * b / z) * (d1 * rho2 + d2 * rho2**2)
    stretch = 1.0 + v["depth_distortion"] * (place[0] ** 2 + place[1] ** 2) / corner**2
    image = pupil + chief * (place[2] - (place[2] - displaced) / stretch - pupil[2])
    across = np.array([-tilt[1], tilt[0], 0.0]) / np.hypot(*tilt)  # two microlenses at the same distance
    x, y = place[:2] + axis + np.array([v["array_offset_x"], v["array_offset_y"]])
    if hasattr(camera, "estimator_baseline") and not isinstance(camera.estimator_baseline, float):
        spacing = float(camera.estimator_baseline(np.array([point[2]]))[0])
        lands = []
        for side in (-0.5, 0.5):
            centre = place + side * spacing * across
            ray = centre - image
            lands.append(centre + ray * ((z + gap - centre[2]) / ray[2]))
        return float((lands[1] - lands[0]) @ across), x, y
    # Pixels ±N/2 from the centres of the white images, which the centre of the pupil forms through each microlens.
    apart = camera.pixels_apart
    meets = []
    for side in (-0.5, 0.5):
        # On the line along `across`, s from the image's own foot: slope = o/b_L + (position from the axis)/z_p.
        a_L, along = place[2] - image[2], place @ across
        s = (image @ across + a_L * side * apart / (z + gap - place[2])) / (1.0 - a_L / (place[2] - pupil[2]))
        meets.append(s - along)
    return float(meets[0] - meets[1]), x, y


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("point", POINTS)
def test_a_camera_observes_what_rays_through_its_parts_show(camera: Any, point: tuple[float, float, float]) -> None:
    seen = [float(one) for one in known(camera).observe({}, *point)]
    np.testing.assert_allclose(seen, traced(camera, point), rtol=1e-9)


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("point", POINTS)
def test_it_measures_the_true_depth_from_them_and_a_camera_without_them_does_not(
    camera: Any, point: tuple[float, float, float]
) -> None:
    distance = np.array(point[2])
    seen = tuple(np.array(one) for one in traced(camera, point))
    inverse, valid = known(camera).believe({}, seen, distance)
    assert valid
    assert 1.0 / inverse == pytest.approx(point[2], rel=1e-9)
    assert abs(1.0 / camera.believe({}, seen, distance)[0] / point[2] - 1.0) > 1e-3


@pytest.mark.parametrize("camera", CAMERAS)
def test_points_at_a_position_in_the_picture_are_seen_there(camera: Any) -> None:
    place = PicturePlace(across=0.7, down=-0.9)
    _, x, y = known(camera).observe_at(np.array([0.3, 2.0]), place)
    half = camera.sensor.width / 2.0
    np.testing.assert_allclose(x, 0.7 * half, rtol=1e-9)
    np.testing.assert_allclose(y, -0.9 * half, rtol=1e-9)


@pytest.mark.parametrize("camera", CAMERAS)
def test_errors_add_to_known_values(camera: Any) -> None:
    distances = np.array([0.3, 1.0, 3.0])
    half = known(camera, {name: value / 2.0 for name, value in KNOWN.items()})
    errors = {name: np.array([[value / 2.0], [0.0]]) for name, value in KNOWN.items() if name != "array_rotation"}
    seen = half.observe({}, *half._points(distances, 0.6))
    both, _ = half.believe(errors, seen, distances)
    whole, _ = known(camera).believe({}, seen, distances)
    np.testing.assert_allclose(both[0], whole, rtol=1e-12)
    np.testing.assert_allclose(both[1], 1.0 / distances, rtol=1e-10)


def test_a_known_rotation_of_the_array_turns_pictures_and_not_depth() -> None:
    turned = known(r5(), {"array_rotation": 0.1})
    np.testing.assert_allclose(depth_read(turned, [0.3, 1.0]), [0.3, 1.0], rtol=1e-12)
    error = {"array_rotation": 0.02}  # relative to the rotation that the camera has
    np.testing.assert_allclose(depth_read(turned, [0.3], **error), depth_read(r5(), [0.3], **error), rtol=1e-12)


@pytest.mark.parametrize("camera", CAMERAS)
def test_zero_values_change_no_number(camera: Any) -> None:
    nothing = known(camera, dict.fromkeys(KNOWN, 1e-30))  # passes through every formula
    distances = np.array([0.2, 0.5, 1.0, 30.0])
    errors = {"pixel_noise": [1e-8, -2e-8], "mla_distance": [1e-7, 2e-7], "array_tilt_y": [1e-5, 0.0]}
    for field in (0.0, 0.8):
        mine, plain = (depth_read(one, distances, field, **errors) for one in (nothing, camera))
        np.testing.assert_allclose(mine, plain, rtol=1e-12)
    x, y = np.array([1e-3, -2e-3]), np.array([0.0, 3e-3])
    mine, plain = (one.exposures(0.3, {}, None, 0.0)[0].cones(x, y) for one in (nothing, camera))
    for name in ("pixel", "start", "slope", "start_by_pixel", "slope_by_lens", "light"):
        np.testing.assert_allclose(getattr(mine, name), getattr(plain, name), rtol=1e-12, atol=1e-18)


def test_propagation_about_a_known_tilt_is_that_of_draws() -> None:
    """Depths of 20 000 drawn calibrations, written out, of one observation on the edge of the picture."""
    values = {"array_tilt_x": 8e-3, "principal_point_x": 3e-4, "distortion_k1": -0.1}
    sigma, noise_px, a = 2e-4, 1e-3, 0.5
    tilt = Source(
        name="array_tilt_x", distribution=Normal(mean=0.0, standard_deviation=sigma), error_class=ErrorClass.RIG
    )
    camera = known(r5(disparity_error_px=noise_px, calibration=Calibration(groups=(tilt,))), values)
    place = PicturePlace(across=0.9, down=0.0)
    rng = np.random.default_rng(11)
    apart, x, _ = (one[0] for one in camera.observe_at(np.array([a]), place))
    spacing = float(camera.estimator_baseline(np.array([a]))[0])
    leaning = (values["array_tilt_x"] + sigma * rng.standard_normal(20_000)) * x  # x counts from the array's centre
    z, gap, f = camera.mla_distance + leaning, camera.microlenses.gap - leaning, camera.main_lens.focal_length
    noise = noise_px * 5.5e-6 * rng.standard_normal(20_000)
    b = z - gap * spacing / (apart + noise - spacing)
    drawn = f * b / (b - f)
    assert np.median(drawn) == pytest.approx(a, rel=1e-3)
    found = float(depth_uncertainty(camera, np.array([a]), field=place)[0])
    assert found == pytest.approx(drawn.std(), rel=0.02)
    level = float(depth_uncertainty(replace(camera, known=()), np.array([a]), field=place)[0])
    assert abs(found / level - 1.0) > 0.05  # the known tilt moves v, and with it the sensitivity


def test_a_scaling_multiplies_sensitivities_by_its_slope_beside_known_values() -> None:
    a, b, c = 0.11, 0.9, 0.012
    z = np.array([0.25, 0.5, 1.0])
    plain, scaled = known(r5()), known(r5(depth_scaling=DepthScaling(quadratic=a, linear=b, offset=c)))

    def quotient(camera: Any, at: FloatArray, name: str, step: float) -> FloatArray:
        up, down = depth_read(camera, at, 0.6, **{name: [step, -step]})
        return np.asarray((up - down) / (2.0 * step))

    for name, step in (("pixel_noise", 1e-10), ("array_tilt_x", 1e-8), ("depth_distortion_d1", 1e-10)):
        mine, of_plain = quotient(scaled, a * z**2 + b * z + c, name, step), quotient(plain, z, name, step)
        np.testing.assert_allclose(mine, np.abs(2 * a * z + b) * of_plain, rtol=1e-5)


@pytest.mark.parametrize("build", [r5, unfocused])
def test_rendered_pictures_show_points_where_rays_do(build: Any) -> None:
    """Rays back from where lines through the image and tilted microlenses land pass through the point."""
    values = {name: KNOWN[name] for name in KNOWN if "distortion" not in name}
    camera, world = known(build(), values), np.array([0.05, -0.04, 0.3])
    (exposure,) = camera.exposures(0.3, {}, None, 0.0)
    f, z, gap = camera.main_lens.focal_length, camera.mla_distance, camera.microlenses.gap
    image = world * (1.0 / (1.0 / f - 1.0 / world[2])) / world[2]
    axis, offset = (np.array([values[f"{name}_{k}"] for k in "xy"]) for name in ("principal_point", "array_offset"))
    number = np.rint(np.linalg.solve(exposure._basis, image[:2] * z / image[2] + axis)).astype(np.intp)
    near = exposure.centres(number[0] + np.array([0, 1, 0, -1]), number[1] + np.array([0, 0, 1, 1]))
    far = z + values["array_tilt_x"] * near[0] + values["array_tilt_y"] * near[1]
    centre = np.stack([near[0] - axis[0], near[1] - axis[1], far])
    ray = centre - image[:, np.newaxis]
    lands = (centre + ray * ((z + gap - far) / ray[2]))[:2] + (axis + offset)[:, np.newaxis]
    on_pupil = np.hypot(*(centre - ray * (far / ray[2]))[:2])
    lands = lands[:, on_pupil < camera.main_lens.pupil_diameter / 2.0]
    cones = exposure.cones(*lands)
    miss = np.hypot(*(cones.start + world[2] * cones.slope - world[:2, np.newaxis]))
    best = [miss[cones.pixel == pixel].min() for pixel in range(lands.shape[1])]
    assert len(best) >= (3 if build is r5 else 1)
    assert max(best) < 1e-9


def test_cropped_pictures_have_the_distortion_of_the_whole_ones() -> None:
    whole = known(r5(field_curvature=2e-5))
    small = whole.cropped(1024, 512)
    point = (0.03, -0.02, 0.3)
    np.testing.assert_allclose(small.observe({}, *point), whole.observe({}, *point), rtol=1e-12)


STUDY = """
format: 2
study: known
title: Known values
question: Which camera measures depth?
cameras:
  r5:
    from: R5
    depth: {scaling: {offset: 1 mm}}
    calibration: {known: {array_tilt_x: 0.05 deg, distortion_k1: -0.1, principal_point_y: 0 mm}}
  stereo:
    from: STEREO
scene: {distances: {from: 0.2 m, to: 2 m, points: 5}, wavelength: 550 nm}
"""


@pytest.mark.usefixtures("empty_figures")
def test_a_study_declares_them_and_page_one_says_where_they_do_not_act(tmp_path: Path) -> None:
    cameras = Path("studies/cameras").resolve()
    text = STUDY.replace("R5", f"{cameras}/raytrix-r5.yaml").replace("STEREO", f"{cameras}/stereo-100mm.yaml")
    (tmp_path / "known.yaml").write_text(text)
    study = tradestudy.load(tmp_path / "known.yaml")
    camera = study.definition.designs["r5"]
    assert isinstance(camera, PlenopticCamera)
    assert camera.known == (("array_tilt_x", math.radians(0.05)), ("distortion_k1", -0.1))
    study.run().write(tmp_path / "out", pdf=False)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "the known values of its calibration act in depth and rendered pictures, not in blur, coverage" in page
    assert "its depth scaling acts in measured depth, not in rendered pictures" in page
    wrong = text.replace("stereo-100mm.yaml", "stereo-100mm.yaml\n    calibration: {known: {}}")
    (tmp_path / "known.yaml").write_text(wrong)
    with pytest.raises(StudyError, match=r"stereo\.calibration\.known: unknown key"):
        tradestudy.load(tmp_path / "known.yaml")


def test_light_spots_of_a_camera_with_known_values_are_refused() -> None:
    with pytest.raises(OutOfRangeError, match=r"light spots .*array_tilt_x.*calibration\.known"):
        known(r5(), {"array_tilt_x": math.radians(0.1)}).light_chain()
    assert set(KNOWN) == {*KNOWN_VALUES}
