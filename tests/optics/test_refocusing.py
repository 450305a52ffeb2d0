"""Refocusing by shifted views: against published numbers, another program, and rays traced at thirty digits."""

import math
from dataclasses import replace
from typing import Any

import mpmath
import numpy as np
import pytest

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.depth_of_field import depth_of_field
from tradestudy.optics.refocusing import Refocusing

# The camera of PlenoptiSign's tests (C. Hahne, A. Aggoun, SoftwareX 10, 2019), in mm: f193 lens of C. Hahne et al.,
# "Refocusing distance of a standard plenoptic camera", Optics Express 24 (2016). HH is its principal_separation.
F_U, HH, D_A, PIXEL, F_S, PITCH = 193.2935, -65.5563, 111.0324, 0.009, 2.75, 0.125


def hahne(image_distance: float = F_U, views_across: int = 13) -> Refocusing:
    """That camera in mm, its array at an image distance b_U behind H' and d_A behind the exit pupil."""
    return Refocusing(
        focus_distance=F_U * image_distance / (image_distance - F_U) if image_distance > F_U else math.inf,
        focal_length=F_U,
        entrance_pupil=entrance_pupil(image_distance - D_A, F_U),
        principal_separation=HH,
        view_slope=PIXEL / F_S,
        microlens_pitch=PITCH,
        views_across=views_across,
        pupil_views=13.0,
    )


def entrance_pupil(exit_pupil: float, f: float) -> float:
    """From 1/e' = 1/e + 1/f; −f for an exit pupil at infinity."""
    return exit_pupil / (1.0 - exit_pupil / f) if math.isfinite(exit_pupil) else -f


def test_distances_that_plenoptisign_prints() -> None:
    """The numbers of its unit tests: d = 962.7459 mm, and its limits, all counted from the array."""
    camera = hahne()
    limits = camera.ray_limits(1.0)
    found = [float(camera.from_array(one)) for one in (camera.distance(1.0), limits.far, limits.near)]
    assert found == pytest.approx([962.7459, 1110.0123, 838.1359], abs=5.1e-5)
    assert float(limits.extent) == pytest.approx(271.8764, abs=5.1e-5)


def test_baselines_and_triangulation_that_plenoptisign_prints() -> None:
    """B = 3.7956 mm for views six pixels apart; Z = 5869.2898 mm, which counts from the entrance pupil."""
    camera = hahne()
    assert camera.baseline([6, 1]) == pytest.approx([3.7956, 0.6326], abs=5.1e-5)
    assert float(camera.from_pupil(camera.triangulate(6, 1.0))) == pytest.approx(5869.2898, abs=5.1e-5)
    assert camera.triangulate(1, 0.0) == math.inf


# PlenoptiSign 1.1.3, run as a program of its own for the same lens: d_f, then b_U; α: d, far and near limit, from the
# array; last, (pixels, disparity): baseline and Z.
RUN = [
    pytest.param(
        203.4773544927733,
        13,
        {
            -1 / 12: (5601.179639149283, 8709.810338797812, 3999.999999999997),
            0.05: (3412.1399912745687, 4487.354867047871, 2689.1103575530474),
            0.25: (2142.2061738850343, 2586.4971109817225, 1795.7941963562903),
            1.0: (877.3959756877302, 980.5540328910977, 784.4390017903946),
            2.0: (477.72786236995205, 522.4699091991286, 435.5361655778237),
        },
        {
            (6, 1.0): (4.178865606579058, 2576.4739958343253),
            (6, -0.2): (4.178865606579058, 4556.675464208148),
            (1, 0.5): (0.69647760109651, 1494.226681769354),
        },
        id="focused at 4 m",
    ),
    pytest.param(
        225.88518412291828,
        11,
        {
            0.5: (1024.9329630581767, 1115.2688423823276, 936.7672901330129),
            1.5: (601.1199575059105, 654.5624407876148, 548.4908360171194),
        },
        {(6, 4.0): (5.372624581270611, 1045.5870768889972)},
        id="focused at 1.5 m, with 11 views",
    ),
]


@pytest.mark.parametrize(("image_distance", "views", "shifts", "pairs"), RUN)
def test_another_program_agrees(image_distance: float, views: int, shifts: Any, pairs: Any) -> None:
    camera = hahne(image_distance, views_across=views)
    limits = camera.ray_limits(list(shifts))
    found = camera.from_array(np.stack([camera.distance(list(shifts)), limits.far, limits.near], axis=-1))
    np.testing.assert_allclose(found, list(shifts.values()), rtol=1e-9)
    for (pixels, disparity), (baseline, distance) in pairs.items():
        assert camera.baseline(pixels) == pytest.approx(baseline, rel=1e-9)
        assert float(camera.from_pupil(camera.triangulate(pixels, disparity))) == pytest.approx(distance, rel=1e-9)


# The same program for thin lenses (H1H2 = 0 for both) with the exit pupil in the plane of the main lens.
THIN = [
    pytest.param(
        {"f": 193.2935, "d_f": 4000.0, "b_U": 203.66317189676258, "p_p": 0.009, "p_M": 0.125, "f_s": 2.75},
        {
            0.0: 4000.0,
            0.5: 1585.217740623372,
            1.0: 1048.0917548011657,
            2.0: 678.7104313191852,
            -1 / 11: 5768.467851081213,
        },
        id="its default camera as a thin lens",
    ),
    pytest.param(
        {"f": 12.5, "d_f": 163.63636363636363, "b_U": 13.636363636363637, "p_p": 0.0055, "p_M": 0.1265, "f_s": 0.432},
        {
            0.5: 43.59131139493473,
            1.0: 30.27522491706789,
            0.25: 63.57377541360283,
            -0.1: 769.3190977972486,
            -0.25: math.inf,
        },
        id="a hand lens focused at 150 mm",
    ),
]


@pytest.mark.parametrize(("camera", "distances"), THIN)
def test_refocusing_distances_of_thin_lenses_are_those_of_an_independent_program(camera, distances) -> None:
    c = {name: value * 1e-3 for name, value in camera.items()}
    found = thin(c["d_f"] - c["b_U"], c["f"], c["p_p"] / c["f_s"], c["p_M"]).distance(list(distances))
    np.testing.assert_allclose(found + c["b_U"], np.array(list(distances.values())) * 1e-3, rtol=1e-11)


def thin(a0: float = 0.15, f: float = 12.5e-3, slope: float = 5.5e-6 / 0.432e-3, pitch: float = 126.5e-6) -> Refocusing:
    """A thin lens, which holds its pupil: by default that of the R5."""
    return Refocusing(
        focus_distance=a0,
        focal_length=f,
        entrance_pupil=0.0,
        principal_separation=0.0,
        view_slope=slope,
        microlens_pitch=pitch,
        views_across=19,
        pupil_views=18.95,
    )


def test_views_of_a_point_refocused_on_are_shifted_by_whole_shifts() -> None:
    """Rays from the point through the middles of neighbouring views land so many microlenses apart on the array."""
    camera, f, p = thin(), 12.5e-3, 126.5e-6
    z, width = camera.pupil_distance, float(camera.baseline(1))
    for shift in (-0.1, 0.2, 0.7, 1.0):
        a = float(camera.distance(shift))
        on_array = [h + h * (1 / a - 1 / f) * z for h in (0.0, width)]
        assert (on_array[1] - on_array[0]) / p == pytest.approx(shift, rel=1e-9)
        assert float(camera.shift(a)) == pytest.approx(shift, rel=1e-12)


def test_refocusing_ends_at_infinity_and_at_the_focal_plane() -> None:
    camera = thin()
    assert camera.distance([-5.0, -1.0, camera.largest_shift, 3.0]).tolist() == [math.inf, math.inf, 12.5e-3, 12.5e-3]
    assert camera.largest_shift == pytest.approx(float(camera.baseline(1)) / 126.5e-6, rel=1e-14)


def test_single_views_are_sharp_up_to_a_shift_of_one_microlens() -> None:
    camera = thin(0.5, 50e-3, 20e-6 / 0.6e-3)
    view = depth_of_field(0.5, 50e-3, float(camera.baseline(1)), 126.5e-6)
    np.testing.assert_allclose([view.near, view.far], camera.reach(1.0), rtol=1e-12)


@pytest.mark.parametrize("blur", [0.3, 1.0])
def test_adding_shifted_views_blurs_by_the_criterion_at_the_blur_limits(blur: float) -> None:
    camera, f, p = thin(), 12.5e-3, 126.5e-6
    z, half = camera.pupil_distance, camera.pupil_views * float(camera.baseline(1)) / 2.0
    for shift in (0.0, 0.3, -0.05):
        middle, limits = float(camera.distance(shift)), camera.blur_limits(shift, blur)
        for limit in (float(limits.near), float(limits.far)):
            if math.isinf(limit):
                continue
            # Rays through both edges of the pupil, each view moved so that the refocused point lines up.
            on_array = {a: [h + h * (1 / a - 1 / f) * z for h in (-half, half)] for a in (limit, middle)}
            spread = [x - moved for x, moved in zip(on_array[limit], on_array[middle], strict=True)]
            assert abs(spread[1] - spread[0]) == pytest.approx(blur * p, rel=1e-9)


def traced(camera: Refocusing, start: tuple[float, float], end: tuple[float, float]) -> Any:
    """Where two rays, each by its height and slope at the array, meet in front of the lens; thirty digits."""
    f, z = (
        mpmath.mpf(camera.focal_length),
        1 / (1 / mpmath.mpf(camera.focal_length) - 1 / mpmath.mpf(camera.focus_distance)),
    )
    heights = [h - m * z for h, m in (start, end)]  # at H', and so at H
    slopes = [m + y / f for y, (_, m) in zip(heights, (start, end), strict=True)]
    return (heights[0] - heights[1]) / (slopes[0] - slopes[1])


@pytest.mark.parametrize("pupil_distance", [13.636363636363637e-3, 25e-3, 6e-3, math.inf, -40e-3])
@pytest.mark.parametrize("shift", [-0.05, 0.0, 0.25, 0.5])
def test_limits_are_crossings_of_traced_rays(shift: float, pupil_distance: float) -> None:
    """Rays from the edges of two pixels through the edges of two microlenses, bent by lens after lens."""
    camera = thin()
    camera = replace(camera, entrance_pupil=entrance_pupil(camera.array_distance - pupil_distance, 12.5e-3))
    assert camera.pupil_distance == pytest.approx(pupil_distance, rel=1e-12)
    f_s, pixel, p, apart = 0.432e-3, 5.5e-6, 126.5e-6, camera.views_across - 1
    with mpmath.workdps(30):

        def ray(side: int, pixel_edge: float, lens_edge: float) -> tuple[Any, Any]:
            """A ray by its height and slope at the array: a microlens sends it where its middle does."""
            middle = -side * mpmath.mpf(shift) * apart * p / 2
            on_sensor = (
                middle * (1 + f_s / mpmath.mpf(pupil_distance)) + (side * apart / mpmath.mpf(2) + pixel_edge) * pixel
            )
            return middle + lens_edge * p, (on_sensor - middle) / f_s

        crossing = traced(camera, ray(-1, 0.0, 0.0), ray(1, 0.0, 0.0))
        far = traced(camera, ray(-1, -0.5, -0.5), ray(1, 0.5, 0.5))
        near = traced(camera, ray(-1, 0.5, 0.5), ray(1, -0.5, -0.5))
    expected = [math.inf if one < 0 else float(one) for one in (near, crossing, far)]
    limits = camera.ray_limits(shift)
    found = [float(one) for one in (limits.near, camera.distance(shift), limits.far)]
    assert found == pytest.approx(expected, rel=1e-9)


def test_planes_are_whole_microlenses_of_the_outermost_views() -> None:
    camera = thin()
    found = camera.planes(1.0)
    infinity = float(camera.shift(math.inf))
    expected = [k / 18 for k in range(18, -19, -1) if k / 18 >= infinity]
    assert found.tolist() == pytest.approx(expected, rel=1e-12)
    assert len(expected) == 21
    distances = camera.distance(found)
    assert np.all(np.diff(distances) > 0.0)
    assert distances[0] == pytest.approx(camera.reach(1.0)[0], rel=1e-12)
    assert camera.planes(0.25).tolist() == pytest.approx([k / 18 for k in (4, 3, 2, 1, 0, -1, -2)], rel=1e-12)


def test_nothing_is_sharp_at_shifts_that_leave_the_scene() -> None:
    camera = thin()
    for limits in (camera.ray_limits([-0.9, 5.0]), camera.blur_limits([-0.9, 5.0], 1.0)):
        assert limits.empty.all()
        assert "no distance" in limits.reason


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda one: one.require_shifts([0.5, 19.0]), "19.*number of views"),
        (lambda one: one.require_shifts(math.inf), "inf.*number of views"),
        (lambda one: one.require_shifts(1.4), "1.4.*front focal point"),
        (lambda one: one.require_pair(19), "19.*1 to 18"),
        (lambda one: one.require_pair(0), "0.*1 to 18"),
        (lambda one: one.shift(12e-3), "0.012.*focal point"),
        (lambda one: one.blur_limits(0.0, 0.0), "0 .*above 0"),
        (lambda one: one.reach(20.0), "20.*below 19"),
    ],
)
def test_impossible_shifts_and_pairs_are_refused_with_a_remedy(call, words) -> None:
    with pytest.raises(OutOfRangeError, match=words) as refused:
        call(thin())
    assert refused.value.remedy
    assert refused.value.limit
