"""What two micro-images share of an object, against searches on grids, traced rays and sums over lenses one by one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.cameras.builders import PITCH, r5, stereo, unfocused
from tests.campaigns.matching import measured, scene
from tests.imaging.scenes import bound_of
from tests.imaging.test_picture import CLOSED, SETTINGS
from tradestudy.cameras.picture_geometry import MatchedPairs, WholePictures, largest_common_square
from tradestudy.depth.evaluation import evaluate_depth
from tradestudy.imaging.models import Light, field_illumination, radial_pupil_width
from tradestudy.imaging.passed_texture import matched_window, picture_electrons
from tradestudy.imaging.picture import SMALLEST_WINDOW_PX, PictureDisparityError, disparity_bound_px, disparity_error_px
from tradestudy.optics.equivalent_baseline import equivalent_baseline, least_squares_pairs
from tradestudy.optics.thin_lens import image_distance

COS4 = replace(CLOSED, vignetting="cos4")
WIDE = replace(SETTINGS, window_px=500.0)
CORNER = math.radians(32.5)


def side_px(camera, distance, settings=WIDE, models=COS4):
    return matched_window(camera.picture_geometry(np.atleast_1d(distance)), settings, models).side_px


# ---- one pair -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("v", "expected"), [(2.0, 2.898), (3.72, 10.002)])
def test_neighbours_of_one_type_where_the_array_lies_in_the_image(v: float, expected: float) -> None:
    """23 px, √3 pitches apart, so d = n √3/v: by hand, from w² + w d = (n² − d²)/2."""
    found = float(largest_common_square(23.0, 23.0 * math.sqrt(3.0) / v))
    assert found == pytest.approx(expected, abs=5e-4)
    assert found**2 + found * 23.0 * math.sqrt(3.0) / v == pytest.approx((23.0**2 - 3.0 * 23.0**2 / v**2) / 2.0)


def largest_square_of(mask: np.ndarray) -> int:
    """Cells along the side of the largest square of true cells, by growing squares from their corners."""
    sides = mask.astype(int)
    for i in range(1, len(mask)):
        above, row = sides[i - 1], sides[i]
        for j in np.flatnonzero(mask[i, 1:]) + 1:
            row[j] = 1 + min(above[j], above[j - 1], row[j - 1])
    return int(sides.max())


def test_no_square_on_a_grid_is_larger_wherever_it_lies_and_however_it_is_turned() -> None:
    rng, cells = np.random.default_rng(5), 240
    x = (np.arange(cells) + 0.5) / cells - 0.5
    for _ in range(4):
        baseline, v = rng.choice([1.0, math.sqrt(3.0), 2.0]), rng.uniform(2.1, 6.0)
        apart, best = baseline / v, []
        for turned in np.linspace(0.0, math.pi / 2.0, 7):
            aside, up = apart / 2.0 * math.cos(turned), apart / 2.0 * math.sin(turned)
            both = [np.hypot(x - s * aside, x[:, np.newaxis] - s * up) <= 0.5 for s in (-1, 1)]
            best.append(largest_square_of(both[0] & both[1]) / cells)
        expected = float(largest_common_square(1.0, apart))
        assert best[0] == pytest.approx(expected, abs=2.5 / cells)
        assert max(best) <= best[0] + 1.0 / cells


def test_discs_in_one_place_and_discs_that_touch() -> None:
    np.testing.assert_allclose(largest_common_square(2.0, [0.0, 2.0, 5.0]), [math.sqrt(2.0), 0.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("z_relative", [0.97, 1.0, 1.03])
@pytest.mark.parametrize("estimator", ["same-type-pair", "adjacent-pair"])
def test_micro_images_share_what_rays_through_both_microlenses_reach(z_relative: float, estimator: str) -> None:
    """Rays from the rim of the pupil through either microlens onto the main lens's image: the object's coordinates."""
    lenses = "all" if estimator == "adjacent-pair" else "sharpest-type"
    camera, distances = r5(estimator=estimator, lenses=lenses), np.array([0.11, 0.15, 0.3, 1.0])
    camera = replace(camera, mla_distance=camera.mla_distance * z_relative)
    z, gap, pupil = camera.mla_distance, camera.microlenses.gap, camera.main_lens.pupil_diameter
    for a, found in zip(distances, side_px(camera, distances), strict=True):
        before = z - float(image_distance(a, camera.main_lens.focal_length))
        lens = np.array([0.0, PITCH * (1.0 if estimator == "adjacent-pair" else math.sqrt(3.0))])
        # The pupil's rim, at most as wide as a micro-image that fits the pitch.
        rim = min(pupil, PITCH * z / gap) / 2.0
        low, high = (lens + (side * rim - lens) * before / z for side in (-1, 1))
        on_sensor = gap / abs(before) / camera.sensor.pixel_pitch
        diameter, apart = abs(high[0] - low[0]) * on_sensor, abs(high[1] - high[0]) * on_sensor
        assert found == pytest.approx(float(largest_common_square(diameter, apart)), rel=1e-9)


def test_the_r5_has_a_window_where_it_has_a_pair() -> None:
    """z is 8 and 17 % longer than b at 150 mm and 1 m, so that windows are larger than for an array in the image."""
    np.testing.assert_allclose(side_px(r5(), [0.15, 1.0]), [4.22, 11.02], atol=0.005)
    distance = np.geomspace(0.1, 2.0, 400)
    there = r5().radius_over_pitch(distance) > math.sqrt(3.0) / 2.0
    np.testing.assert_array_equal(side_px(r5(), distance) > 0.0, there)
    assert 0 < there.sum() < there.size
    found = PictureDisparityError(settings=SETTINGS, models=CLOSED)
    assert np.all(np.isnan(found.error_px(r5(), distance[~there])))
    assert np.all(np.isnan(found.numerical_error_px(r5(), distance[~there])))
    assert not found.limit(r5(), distance[~there]).met.any()
    assert "the window has too few samples" in found.broken_conditions(r5(), 0.15)  # 4.2 px


def test_a_declared_window_is_the_largest() -> None:
    assert side_px(r5(), [0.15, 1.0], replace(SETTINGS, window_px=9.0)) == pytest.approx([4.22, 9.0], abs=0.005)
    length = replace(SETTINGS, window_px=None, window_length=1e-3)
    geometry = r5().picture_geometry(np.array([1.0]))
    asked = 1e-3 * geometry.magnification[0] / geometry.sample_pitch
    assert side_px(r5(), 1.0, length) == pytest.approx(asked)


def test_a_matcher_reaches_the_bound_in_the_window_that_two_micro_images_share() -> None:
    """10 px, the largest that neighbours of one type share at v = 3.72."""
    window = int(largest_common_square(23.0, 23.0 * math.sqrt(3.0) / 3.72))
    tried = scene(window=window)
    rms, uncertain, lost, _ = measured(tried, 400, np.random.default_rng(3))
    assert window == 10
    assert lost < 0.01
    bound = float(bound_of(tried).value[0])
    assert 1.0 - 3.0 * uncertain / bound < rms / bound < 1.25
    # The window that fits one micro-image promises less than a matcher of this one reaches.
    assert rms > 1.5 * float(bound_of(scene(window=16)).value[0])


# ---- several pairs --------------------------------------------------------------------------------------------------


def over_places(radius: float, places: int, rng: np.random.Generator) -> tuple[float, float]:
    """Window and baseline in the mean square of the error, lenses of a unit lattice looked up around random places."""
    i, j = (index.ravel() for index in np.mgrid[-16:17, -16:17])
    lattice = np.stack((i + j / 2.0, j * math.sqrt(0.75)), axis=-1)
    reported, by_length = [], []
    for place in rng.random((places, 2)) @ np.array([[1.0, 0.0], [0.5, math.sqrt(0.75)]]):
        seen = lattice[np.hypot(*(lattice - place).T) < radius]
        if len(seen) > 1:
            first, second = np.triu_indices(len(seen), 1)
            length = np.hypot(*(seen[first] - seen[second]).T)
            side = largest_common_square(23.0, 23.0 * length / (2.0 * radius))
            reported.append(2.0 / len(seen) * np.sum(np.square(length * side)))
            by_length.append(2.0 / len(seen) * np.sum(np.square(length)))
    baseline = np.mean(1.0 / np.array(by_length)) ** -0.5
    return float(np.mean(1.0 / np.array(reported)) ** -0.5 / baseline), float(baseline)


@pytest.mark.parametrize(("radius", "largest"), [(0.62, 0.001), (1.083, 0.08), (1.3, 0.025), (2.0, 0.02), (4.0, 0.005)])
def test_the_window_of_least_squares_is_that_of_all_pairs_one_by_one(radius: float, largest: float) -> None:
    """And errs to the safe side."""
    direct, baseline = over_places(radius, 1500 if radius < 3 else 200, np.random.default_rng(2))
    law = equivalent_baseline(np.array(radius), layout="hexagonal", judged="least-squares")
    assert float(law) == pytest.approx(baseline, rel=0.02)
    pairs = least_squares_pairs(np.array([radius]), layout="hexagonal")
    apart = 23.0 * pairs.over_pitch / (2.0 * radius)
    one = MatchedPairs(largest_px=largest_common_square(23.0, apart), apart_px=apart, weight=pairs.share)
    found = float(one.window(500.0).side_px[0])
    assert direct * (1.0 - largest) <= found <= direct * 1.002
    assert float(one.window(2.0).side_px[0]) <= 2.0 + 1e-12


def test_information_of_least_squares_is_the_sum_of_that_of_its_pairs() -> None:
    camera = r5(estimator="least-squares", lenses="all")
    geometry = camera.picture_geometry(np.array([0.3, 1.0]))
    whole = disparity_bound_px(geometry, SETTINGS, CLOSED)
    pairs = geometry.compared.through(1.0)
    parts = []
    for largest, weight in zip(pairs.largest_px, pairs.weight, strict=True):
        shown = np.flatnonzero(largest > 0.0)
        alone = np.zeros(2)
        one = replace(geometry, compared=WholePictures(side_px=largest)).at(shown)
        alone[shown] = weight[shown] / np.square(disparity_bound_px(one, SETTINGS, CLOSED))
        parts.append(alone)
    np.testing.assert_allclose(np.sum(parts, axis=0), 1.0 / np.square(whole), rtol=1e-9)
    np.testing.assert_allclose(np.sum(pairs.weight, axis=0), 1.0, rtol=1e-12)


def test_the_widest_pair_has_the_smallest_window() -> None:
    distance = np.array([0.2, 0.5, 1.0])
    by_length = [
        side_px(r5(estimator=estimator, lenses="all"), distance)
        for estimator in ("adjacent-pair", "least-squares", "widest-pair")
    ]
    assert np.all(np.diff(by_length, axis=0) < 0.0)
    widest = r5(estimator="widest-pair", lenses="all")
    ratio = widest.estimator_baseline(distance) / (2.0 * widest.radius_over_pitch(distance) * PITCH)
    np.testing.assert_allclose(by_length[2], largest_common_square(23.0, 23.0 * ratio), rtol=1e-4)
    assert np.all(by_length[2][1:] < SMALLEST_WINDOW_PX)
    found = disparity_error_px(widest.picture_geometry(distance[1:]), SETTINGS, CLOSED)
    assert found.violated["the window has too few samples"].all()


# ---- off the axis ---------------------------------------------------------------------------------------------------


def test_light_off_the_axis_and_the_radial_width_of_the_pupil() -> None:
    assert field_illumination(CORNER, pupil_diameter=3e-3, stop_separation=0.0) == pytest.approx(0.506, abs=5e-4)
    stops = {"pupil_diameter": 3e-3, "stop_separation": 1e-3}
    width = radial_pupil_width(CORNER, **stops)
    # On a grid over the pupil: along the radius and in all, what the second stop leaves of it.
    x, y = np.meshgrid(*[np.linspace(-1.5e-3, 1.5e-3, 1501)] * 2)
    inside = np.hypot(x, y) <= 1.5e-3
    left = inside & (np.hypot(x - 1e-3 * math.tan(CORNER), y) <= 1.5e-3)
    along = left[y == 0.0]
    assert width == pytest.approx(along.mean(), abs=2e-3)
    area = field_illumination(CORNER, **stops) / math.cos(CORNER) ** 4
    assert area == pytest.approx(left.sum() / inside.sum(), abs=2e-3)


def test_a_tilted_pupil_reaches_as_many_microlenses_as_an_upright_one() -> None:
    """Rays from the rim through an image point 32.5° off the axis, onto the array."""
    camera, a = r5(), 0.3
    z, image = camera.mla_distance, float(image_distance(a, camera.main_lens.focal_length))
    aside, turn = image * math.tan(CORNER), np.linspace(0.0, 2.0 * math.pi, 73)
    rim = camera.main_lens.pupil_diameter / 2.0 * np.stack((np.cos(turn), np.sin(turn)))
    beyond = np.array([[aside], [0.0]]) + (np.array([[aside], [0.0]]) - rim) * (z - image) / image
    across = np.ptp(beyond, axis=1) / 2.0 / PITCH
    np.testing.assert_allclose(across, float(camera.radius_over_pitch(a)), rtol=2e-3)
    # As seen along the ray to the middle of the pupil, that is narrower; this is one of the four cosines of light.
    along = rim[0] * math.cos(CORNER)
    assert np.ptp(along) / np.ptp(rim[1]) == pytest.approx(0.843, abs=2e-3)


def test_a_stereo_rig_loses_light_off_the_axis_and_nothing_else() -> None:
    camera, law = stereo(), PictureDisparityError(settings=SETTINGS, models=COS4)
    place = np.array([1.2, 1.5])  # seen by both cameras at 70 % of the way to the corner
    left = math.cos(camera.field_angle(1.0)) ** 4
    assert math.tan(camera.field_angle(1.0)) == pytest.approx(5.12e-3 * math.sqrt(2.0) / camera.principal_distance)
    dimmer = replace(law, settings=replace(SETTINGS, light=Light(electrons=8000.0 * left, f_number=9.8)))
    np.testing.assert_allclose(law.error_px(camera, place, 1.0), dimmer.error_px(camera, place), rtol=1e-12)
    np.testing.assert_array_equal(law.error_px(camera, place, 0.0), law.error_px(camera, place))
    derived = replace(camera, disparity_error_px=law)
    axis, corner = (evaluate_depth(derived, place, field) for field in (0.0, 0.7))
    noise = law.error_px(camera, place, 0.7)
    np.testing.assert_array_equal(corner.disparity_error_px, noise)
    np.testing.assert_allclose(corner.uncertainty[0] / axis.uncertainty[0], noise / axis.disparity_error_px, rtol=1e-3)
    assert np.all(corner.uncertainty[0] > axis.uncertainty[0])


def test_rims_dim_a_stereo_rig_and_narrow_the_micro_images_of_a_plenoptic_camera() -> None:
    stops = replace(WIDE, field_angle=CORNER, stop_separation=1e-3)
    pupil = r5().main_lens.pupil_diameter
    width = radial_pupil_width(CORNER, pupil_diameter=pupil, stop_separation=1e-3)
    assert 0.5 < width < 0.9
    geometry = r5().picture_geometry(np.array([0.3, 1.0]))
    dimmed = picture_electrons(geometry, stops, COS4) / picture_electrons(geometry, WIDE, COS4)
    np.testing.assert_allclose(dimmed, math.cos(CORNER) ** 4)
    # A camera of that much narrower pupil, its pixels and their light the same.
    narrow = r5(main_lens=replace(r5().main_lens, f_number=3.8 / width))
    np.testing.assert_allclose(side_px(r5(), [0.3, 1.0], stops), side_px(narrow, [0.3, 1.0]), rtol=1e-6)
    pair = stereo().picture_geometry(np.array([1.0]))
    taken = field_illumination(CORNER, pupil_diameter=30.5e-3 / 4.0, stop_separation=1e-3)
    assert picture_electrons(pair, stops, COS4) / picture_electrons(pair, WIDE, COS4) == pytest.approx(taken)
    assert side_px(stereo(), 1.0, stops) == pytest.approx(side_px(stereo(), 1.0))
    assert side_px(r5(), 1.0, stops, CLOSED) == pytest.approx(side_px(r5(), 1.0))  # vignetting is left out


@pytest.mark.parametrize(
    ("camera", "narrower"),
    [
        (
            r5(estimator="least-squares", lenses="all"),
            lambda width: r5(
                estimator="least-squares", lenses="all", main_lens=replace(r5().main_lens, f_number=3.8 / width)
            ),
        ),
        (unfocused(), lambda width: unfocused(main_lens=replace(unfocused().main_lens, f_number=3.8 / width))),
    ],
    ids=["lenses", "views"],
)
def test_fewer_lenses_and_views_have_a_shorter_baseline_off_the_axis(camera, narrower) -> None:
    """Depth noise is that of a camera of a narrower pupil in the same light: error over baseline."""
    law, distance = PictureDisparityError(settings=SETTINGS, models=COS4), np.array([0.5])
    pupil = camera.main_lens.pupil_diameter
    separation = pupil / 4.0 / math.tan(camera.field_angle(1.0))  # leaves three quarters
    stops = replace(law, settings=replace(SETTINGS, stop_separation=separation))
    other = narrower(0.75)
    dim = math.cos(camera.field_angle(1.0)) ** 4
    geometry, its = camera.picture_geometry(distance), other.picture_geometry(distance)
    window, own = (
        one.compared.through(width).window(SETTINGS.window_px).side_px for one, width in ((geometry, 0.75), (its, 1.0))
    )
    baseline, shorter = (one.equivalent_baseline(distance) for one in (camera, other))
    np.testing.assert_allclose(window * baseline, own * shorter, rtol=2e-3)
    assert np.all(window < 0.9 * geometry.compared.through(1.0).window(SETTINGS.window_px).side_px)
    dimmer = replace(law, settings=replace(SETTINGS, light=Light(electrons=8000.0 * dim, f_number=9.8)))
    ratio = stops.error_px(camera, distance, 1.0) / dimmer.error_px(camera, distance)
    full = geometry.compared.through(1.0).window(SETTINGS.window_px).side_px
    np.testing.assert_allclose(ratio, full / window, rtol=1e-9)
