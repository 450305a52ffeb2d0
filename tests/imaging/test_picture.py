"""The derived disparity error: where cameras picture an object, how steps combine, what limits it."""

from __future__ import annotations

import itertools
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from tests.cameras.builders import F_MAIN, PITCH, YAW, r5, stereo
from tests.cameras.test_unfocused_plenoptic import camera as unfocused
from tests.imaging.scenes import RAYS, unit_geometry
from tradestudy.cameras.calibration import Calibration, Propagation
from tradestudy.cameras.depth_camera import declared_disparity_error
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.models import (
    DefocusModel,
    Light,
    PictureModels,
    PictureSettings,
    SensorNoise,
    Texture,
    texture_spectrum,
)
from tradestudy.imaging.optical_transfer import LensTransfers, kirchhoff_correction, kirchhoff_points
from tradestudy.imaging.passed_texture import band_nodes, matched_window, matching_bound_px
from tradestudy.imaging.picture import (
    PictureDisparityError,
    WeighedPicture,
    disparity_bound_px,
    disparity_error_px,
    filled_share,
)
from tradestudy.imaging.transfer import disc_transfer, square_transfer

SETTINGS = PictureSettings(
    texture=Texture(contrast=0.2, correlation_length=100e-6),
    light=Light(electrons=8000.0, f_number=9.8),
    sensor_noise=SensorNoise(read_noise_electrons=10.0, full_well_electrons=1e5, bits=12),
    wavelength=550e-9,
    window_px=15.0,
)
CLOSED = PictureModels(
    defocus_blur="disc",
    main_lens_diffraction="airy",
    microlens_diffraction="off",
    crosstalk="off",
    pixel_integration="square",
    spectrum="off",
    vignetting="off",
    sensor_noise="shot+read+quantisation",
)


def hand_lens(f_number: float = 9.8):
    """A pair of lenses such as the hand-lens imager's at 25 mm working distance: 55 mm from the principal plane."""
    return stereo(
        lens=Lens(focal_length=18.3e-3, f_number=f_number),
        sensor=Sensor(columns=1600, rows=1200, pixel_pitch=7.4e-6),
        focus_distance=55e-3,
        baseline=10e-3,
    )


def error_of(camera, distance, settings=SETTINGS, **models):
    return disparity_error_px(camera.picture_geometry(np.atleast_1d(distance)), settings, replace(CLOSED, **models))


# ---- geometry -------------------------------------------------------------------------------------------------------


def test_a_stereo_picture_agrees_with_a_written_out_calculation() -> None:
    geometry = hand_lens().picture_geometry(np.array([50e-3, 55e-3, 10e-3]))
    image = 18.3e-3 * 55 / (55 - 18.3)
    assert geometry.main_lens.f_number[:2] == pytest.approx([image / (18.3e-3 / 9.8)] * 2)
    assert geometry.magnification[:2] == pytest.approx([image / 50e-3, image / 55e-3])
    # Blur by similar triangles behind the lens: the image of 50 mm lies behind the sensor.
    behind = 18.3e-3 * 50 / (50 - 18.3)
    assert geometry.blur_px[0] == pytest.approx((18.3e-3 / 9.8) * (behind - image) / behind / 7.4e-6)
    assert geometry.blur_px[1] == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(geometry.magnification[2])


def test_in_focus_the_picture_is_that_of_the_airy_pattern_by_another_quadrature() -> None:
    """At f/22 exact paths differ from parabolic ones by next to nothing; an even grid over the whole band."""
    distance, focal_length, pixel = 55e-3, 18.3e-3, 7.4e-6
    image = focal_length * distance / (distance - focal_length)
    working = image / (focal_length / 22)
    electrons, length_px = 8000 * (9.8 / working) ** 2, 100e-6 * image / distance / pixel
    n = 400
    axis = (np.arange(n) + 0.5) / n - 0.5
    fx, fy = np.meshgrid(axis, axis)

    def density(x, y):
        s = np.minimum(np.hypot(x, y) * 550e-9 * working / pixel, 1.0)
        airy = 2 / np.pi * (np.arccos(s) - s * np.sqrt(1 - s * s))
        passed = airy * np.sinc(x) * np.sinc(y)
        return electrons**2 * texture_spectrum(np.hypot(x, y), 0.2, length_px) * passed**2

    signal, shifts = density(fx, fy), range(-2, 3)
    aliased = sum(density(fx + i, fy + j) for i in shifts for j in shifts if (i, j) != (0, 0))
    noise = electrons + 10.0**2 + (1e5 / 2**12) ** 2 / 12 + aliased
    coherence = signal / (signal + noise)
    expected = 1 / math.sqrt(15.0**2 * np.mean((2 * np.pi * fx) ** 2 * coherence**2 / (1 - coherence**2)))
    found = error_of(hand_lens(22.0), np.array([distance]), main_lens_diffraction="kirchhoff")
    # What is cut off at the spectrum's cusp by a grid of even steps is 1e-4.
    assert abs(found.value[0] / expected - 1) <= 5e-4 + found.error[0] / expected


def test_a_micro_image_agrees_with_a_written_out_calculation() -> None:
    camera, a = r5(), np.array([0.15, 0.3])
    geometry = camera.picture_geometry(a)
    image = a * F_MAIN / (a - F_MAIN)
    v = (camera.mla_distance - image) / camera.microlenses.gap
    assert geometry.magnification == pytest.approx(image / a / np.abs(v))
    assert geometry.main_lens.relay == pytest.approx(1 / np.abs(v))
    assert geometry.microlens is not None
    assert geometry.microlens.f_number == pytest.approx(camera.microlenses.gap / PITCH)
    # Types in focus at 1/v = 1/2 − (1, 3, 5)/23; at 150 mm, v = 2, the first is the sharpest, off by 1/23 of the pitch.
    assert geometry.blur_px[0] == pytest.approx(1.0, rel=1e-3)


def test_neighbours_of_different_types_are_as_sharp_as_the_second() -> None:
    pair = r5(estimator="adjacent-pair", lenses="all")
    blur = np.sort(pair.blur_px(np.array([0.2])), axis=0)[1]
    assert pair.picture_geometry(np.array([0.2])).blur_px == pytest.approx(blur)


def test_the_views_of_an_unfocused_camera_are_sampled_by_microlenses() -> None:
    camera = unfocused()
    geometry = camera.picture_geometry(np.array([0.1, camera.focus_distance]))
    assert geometry.sample_pitch == camera.microlenses.pitch
    assert geometry.main_lens.f_number == pytest.approx(camera.mla_distance / camera.view_pupil_diameter)
    apart = abs(1 / 0.1 - 1 / camera.focus_distance) * camera.mla_distance
    assert geometry.blur_px == pytest.approx([camera.view_pupil_diameter * apart / geometry.sample_pitch, 0], abs=1e-12)


def test_a_window_on_the_object_is_the_same_there_for_every_camera() -> None:
    settings = replace(SETTINGS, window_px=None, window_length=0.5e-3)
    for camera, distance in ((hand_lens(), 55e-3), (stereo(), 0.5), (r5(), 0.3)):
        geometry = camera.picture_geometry(np.array([distance]))
        side = matched_window(geometry, settings, CLOSED).side_px
        assert side * geometry.sample_pitch / geometry.magnification == pytest.approx(0.5e-3)


# ---- how the steps combine ------------------------------------------------------------------------------------------


def test_aliased_texture_is_the_sum_of_all_replicas() -> None:
    """Against replicas summed one by one on the nodes, far beyond those that the program sums."""
    blur, texture = 0.6, Texture(contrast=0.3, correlation_length=1.5)
    settings = replace(SETTINGS, texture=texture, light=Light(electrons=4000.0, f_number=1.0))
    found = disparity_error_px(unit_geometry(blur), settings, RAYS)
    nodes = band_nodes(40, 16)

    def density(x, y):
        r = np.hypot(x, y)
        passed = disc_transfer(r, blur) * square_transfer(x, y, 1.0)
        return 4000.0**2 * texture_spectrum(r, 0.3, 1.5) * passed**2

    aliased = sum(
        density(nodes.x + i, nodes.y + j) for i, j in itertools.product(range(-9, 10), repeat=2) if (i, j) != (0, 0)
    )
    direct = float(matching_bound_px(nodes, signal=density(nodes.x, nodes.y), noise=4100.0 + aliased, window_px=15.0))
    assert abs(found.value[0] - direct) < found.error[0] + 2e-4 * direct
    clean = float(matching_bound_px(nodes, signal=density(nodes.x, nodes.y), noise=4100.0, window_px=15.0))
    assert direct > 1.05 * clean  # aliasing is no small thing here


@pytest.mark.parametrize(
    ("camera", "distances"),
    [
        (hand_lens(), np.linspace(48e-3, 64e-3, 9)),
        (stereo(), np.geomspace(0.6, 4.0, 9)),
        (r5(), np.geomspace(0.15, 2, 9)),
    ],
    ids=["hand lens", "stereo", "r5"],
)
def test_the_stated_error_covers_a_much_finer_quadrature(camera, distances, monkeypatch: pytest.MonkeyPatch) -> None:
    from tradestudy.imaging import picture

    models = {"microlens_diffraction": "airy"} if camera.family == "plenoptic" else {}
    found = error_of(camera, distances, **models)
    monkeypatch.setattr(picture, "band_nodes", lambda along, across: band_nodes(4 * along, 4 * across))
    finer = error_of(camera, distances, **models)
    assert np.all(np.abs(found.value - finer.value) <= found.error + 1e-9)
    assert np.all(found.error[found.applies] < 1e-2 * found.value[found.applies])


def test_a_distance_gives_the_same_answer_alone_and_among_others() -> None:
    distance = np.linspace(45e-3, 70e-3, 26)
    together = error_of(hand_lens(), distance)
    alone = [error_of(hand_lens(), a).value[0] for a in distance]
    np.testing.assert_allclose(together.value, alone, rtol=1e-12)


def test_the_bound_alone_is_the_value_of_the_whole_answer() -> None:
    camera, distance = r5(), np.geomspace(0.15, 2.0, 26)
    geometry = camera.picture_geometry(distance)
    models = replace(CLOSED, main_lens_diffraction="fresnel", microlens_diffraction="fresnel")
    whole = disparity_error_px(geometry, SETTINGS, models).value
    np.testing.assert_allclose(disparity_bound_px(geometry, SETTINGS, models), whole, rtol=1e-12)
    assert np.isfinite(whole).any()


@pytest.mark.parametrize("camera", [hand_lens(5.6), hand_lens(22.0), r5()], ids=["f/5.6", "f/22", "r5"])
def test_models_evaluated_in_turn_have_the_bound_of_each_alone(camera) -> None:
    distance = np.geomspace(45e-3, 0.5, 14)
    settings = replace(SETTINGS, spectrum=((500e-9, 1.0), (640e-9, 2.0)))
    geometry = camera.picture_geometry(distance)
    weighed = WeighedPicture(geometry=geometry, settings=settings)
    micro = ("off",) if geometry.microlens is None else ("off", "airy", "fresnel")
    choices = itertools.product(("off", "disc"), ("off", "airy", "fresnel"), micro, ("off", "square"),
                                ("off", "weighted"))  # fmt: skip
    for defocus, main, second, pixel, spectrum in choices:
        models = replace(CLOSED, defocus_blur=defocus, main_lens_diffraction=main, microlens_diffraction=second,
                         pixel_integration=pixel, spectrum=spectrum)  # fmt: skip
        alone = disparity_bound_px(geometry, settings, models)
        np.testing.assert_array_equal(weighed.bound_px(models), alone)
        np.testing.assert_array_equal(weighed.bound_px(models), alone)


@pytest.mark.parametrize(("defocus", "count"), [("disc", 10), ("off", 4)])
def test_kirchhoff_evaluates_exactly_the_announced_points(defocus: DefocusModel, count: int) -> None:
    """Six around two neighbouring defoci, and four in focus, which serve where rays do and where defocus is off."""
    geometry = hand_lens(5.6).picture_geometry(np.array([55.3e-3, 55.6e-3, 30e-3, 28e-3]))
    models = replace(CLOSED, main_lens_diffraction="kirchhoff", defocus_blur=defocus)
    said = kirchhoff_points(geometry, SETTINGS, models)
    kirchhoff_correction.cache_clear()
    disparity_bound_px(geometry, SETTINGS, models)
    assert kirchhoff_correction.cache_info().misses == len(set(said)) == len(said) == count
    for point in said:
        kirchhoff_correction(*point)
    assert kirchhoff_correction.cache_info().misses == len(said)
    assert kirchhoff_points(geometry, SETTINGS, replace(models, main_lens_diffraction="fresnel")) == ()


@pytest.mark.parametrize("f_number", [1.4, 5.6, 22.0])
def test_no_lens_passes_frequencies_beyond_its_cutoff(f_number: float) -> None:
    geometry = hand_lens(f_number).picture_geometry(np.linspace(45e-3, 70e-3, 7))
    frequency = np.concatenate([np.linspace(0.0, 0.7, 30), np.linspace(0.5, 5.0, 400)])
    models = replace(CLOSED, main_lens_diffraction="fresnel")
    some, everything = (
        LensTransfers(geometry=geometry, settings=SETTINGS, frequency_px=frequency, always=always).product(models)[0]
        for always in (30, frequency.size)
    )
    reach = some.shape[1]
    assert reach >= 30
    np.testing.assert_allclose(some, everything[:, :reach], atol=1e-14)
    assert not np.any(everything[:, reach:])
    assert np.any(everything[:, reach - 1]) or reach == 30


@pytest.mark.parametrize("f_number", [2.8, 9.8, 22.0])
def test_the_margin_is_negative_exactly_where_a_matcher_misses_the_bound(f_number: float) -> None:
    camera = hand_lens(f_number)
    law = PictureDisparityError(settings=SETTINGS, models=CLOSED)
    distance = np.append(np.linspace(15e-3, 0.12, 211), [0.3, 1.0])
    margin, met = law.margin(camera, distance), law.limit(camera, distance).met
    np.testing.assert_array_equal(margin >= 0.0, met)
    assert met.any()
    assert not met.all()
    np.testing.assert_array_equal(np.isnan(margin), ~camera.images(distance))
    np.testing.assert_array_equal(met, law.derived(camera, distance).applies)


def test_the_error_does_not_depend_on_the_calibration() -> None:
    law = PictureDisparityError(settings=SETTINGS, models=CLOSED)
    distance = np.array([50e-3, 55e-3])
    perfect = replace(hand_lens(), calibration=Calibration())
    off = replace(perfect, calibration=Calibration(groups=(YAW,)), propagation=Propagation(model="exact"))
    np.testing.assert_array_equal(law.error_px(perfect, distance), law.error_px(off, distance))
    assert not np.allclose(law.error_px(hand_lens(), distance), law.error_px(hand_lens(5.6), distance))


def test_diffraction_and_defocus_in_one_pupil_lose_less_than_their_product() -> None:
    distance = np.linspace(50e-3, 60e-3, 11)
    product, one = (error_of(hand_lens(), distance, main_lens_diffraction=m).value for m in ("airy", "fresnel"))
    assert np.all(one <= product * (1 + 1e-9))
    assert one[5] == pytest.approx(product[5], rel=1e-6)  # in focus they are one
    assert np.max(product / one) < 1.2


def test_kirchhoff_and_fresnel_agree_for_a_slow_well_corrected_lens() -> None:
    distance = np.array([53e-3, 55e-3])
    wave, fresnel = (error_of(hand_lens(), distance, main_lens_diffraction=m) for m in ("kirchhoff", "fresnel"))
    assert np.all(np.abs(wave.value - fresnel.value) < 5e-4 * fresnel.value + wave.error)
    in_focus = error_of(hand_lens(), distance, main_lens_diffraction="kirchhoff", defocus_blur="off")
    assert in_focus.value[1] == pytest.approx(wave.value[1], rel=1e-6)
    assert in_focus.value[0] < wave.value[0]


def test_light_through_microlenses_is_blurred_by_them() -> None:
    models = {"main_lens_diffraction": "off", "defocus_blur": "off"}
    dim = replace(SETTINGS, light=Light(electrons=100.0, f_number=4.5))  # or aliasing, which blur heals, would rule
    errors = [
        error_of(r5(), 0.3, dim, microlens_diffraction=m, **models).value[0]
        for m in ("off", "airy", "fresnel", "kirchhoff")
    ]
    assert errors[1] > 1.02 * errors[0]
    assert errors[2] == pytest.approx(errors[1], rel=1e-6)
    assert errors[3] == pytest.approx(errors[2], rel=0.02)
    with pytest.raises(OutOfRangeError, match="not blurred by microlenses"):
        error_of(hand_lens(), 55e-3, microlens_diffraction="airy")


def test_a_spectrum_of_one_line_is_that_line_and_a_wide_one_lies_between_its_ends() -> None:
    one = replace(SETTINGS, spectrum=((550e-9, 3.0),))
    assert error_of(hand_lens(22), 55e-3, one, spectrum="weighted").value == pytest.approx(
        error_of(hand_lens(22), 55e-3).value, rel=1e-12
    )
    wide = replace(SETTINGS, spectrum=((450e-9, 1.0), (650e-9, 1.0)))
    blue, red = (error_of(hand_lens(22), 55e-3, replace(SETTINGS, wavelength=w)).value[0] for w in (450e-9, 650e-9))
    assert blue < error_of(hand_lens(22), 55e-3, wide, spectrum="weighted").value[0] < red
    with pytest.raises(OutOfRangeError, match="spectrum"):
        error_of(hand_lens(), 55e-3, spectrum="weighted")


def test_vignetting_costs_the_light_it_takes() -> None:
    tilted = replace(SETTINGS, field_angle=math.radians(30))
    dimmer = replace(SETTINGS, light=Light(electrons=8000.0 * 9 / 16, f_number=9.8))
    assert error_of(hand_lens(), 55e-3, tilted, vignetting="cos4").value == pytest.approx(
        error_of(hand_lens(), 55e-3, dimmer).value, rel=1e-12
    )
    assert error_of(hand_lens(), 55e-3, tilted).value == pytest.approx(error_of(hand_lens(), 55e-3).value, rel=1e-12)


def test_stopping_down_at_fixed_light_raises_the_error_and_more_than_its_light_alone() -> None:
    errors = [error_of(hand_lens(n), 55e-3).value[0] for n in (5.6, 9.8, 16.0, 22.0)]
    assert all(a < b for a, b in itertools.pairwise(errors))
    undiffracted = [error_of(hand_lens(n), 55e-3, main_lens_diffraction="off").value[0] for n in (9.8, 22.0)]
    assert errors[3] / errors[1] > 1.5 * undiffracted[1] / undiffracted[0]


# ---- where it applies -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"texture": Texture(contrast=0.001, correlation_length=100e-6)}, "exceeds"),
        ({"window_px": 3.0}, "too few samples"),
        ({"texture": Texture(contrast=0.2, correlation_length=5e-3)}, "correlation length"),
    ],
)
def test_conditions_are_named(change: dict, words: str) -> None:
    assert error_of(hand_lens(), 55e-3).applies.all()
    found = error_of(hand_lens(), 55e-3, replace(SETTINGS, **change))
    broken = [name for name, where in found.violated.items() if where[0]]
    assert not found.applies.any()
    assert any(words in name for name in broken)


def test_saturated_pixels_are_distinguished_from_bad_matching() -> None:
    lit = replace(SETTINGS, light=Light(electrons=5e5, f_number=9.8))
    assert error_of(hand_lens(), 55e-3, lit).applies.all()
    geometry = hand_lens().picture_geometry(np.array([55e-3]))
    usual, bright = (filled_share(geometry, settings, CLOSED)[0] for settings in (SETTINGS, lit))
    assert usual < 1.0 < bright
    # In proportion to the light that a pixel collects.
    assert bright / usual == pytest.approx(5e5 / SETTINGS.light.electrons)


def test_blur_wider_than_the_window_and_no_noise_at_all_are_outside() -> None:
    far = error_of(hand_lens(), 75e-3)
    assert far.violated["the window is too small for the blur"].all()
    clean = error_of(hand_lens(22), 55e-3, sensor_noise="off", defocus_blur="off")
    assert clean.value[0] < error_of(hand_lens(22), 55e-3).value[0]


@pytest.mark.parametrize(
    "change",
    [
        {"window_px": None},
        {"window_length": 1e-3},
        {"window_px": 0.0},
        {"wavelength": 0.0},
        {"pixel_fill": 1.1},
        {"field_angle": math.pi / 2},
        {"stop_separation": -1e-3},
        {"spectrum": ((0.0, 1.0),)},
        {"spectrum": ((5e-7, 0.0),)},
    ],
)
def test_impossible_settings_are_refused(change: dict) -> None:
    with pytest.raises(OutOfRangeError):
        replace(SETTINGS, **change)


@pytest.mark.parametrize("diffraction", ["airy", "fresnel"])
def test_extreme_distances_have_answers(diffraction: str) -> None:
    """The lens itself, its focal plane, where the main lens images onto the microlenses, and far away."""
    camera = r5()
    onto_array = F_MAIN * camera.mla_distance / (camera.mla_distance - F_MAIN)
    distance = np.array([1e-4, F_MAIN, F_MAIN * (1 + 1e-12), onto_array, np.nextafter(onto_array, 1.0), 1e3, 1e9])
    hopeless = replace(SETTINGS, texture=Texture(contrast=1e-9, correlation_length=1e-9))
    models = {"main_lens_diffraction": diffraction}
    for settings in (SETTINGS, hopeless, replace(SETTINGS, window_px=None, window_length=1e-3)):
        for found in (
            error_of(camera, distance, settings, microlens_diffraction=diffraction, **models),
            error_of(hand_lens(), distance, settings, **models),
            error_of(unfocused(), distance, settings, **models),
        ):
            assert not found.applies[:2].any()
            assert np.isnan(found.value[:2]).all()
            assert np.isfinite(found.value[found.applies]).all()
    found = error_of(camera, distance, hopeless, microlens_diffraction=diffraction, **models)
    assert np.isinf(found.value[-1])
    law = PictureDisparityError(settings=hopeless, models=replace(CLOSED, microlens_diffraction="airy"))
    assert np.isnan(law.error_px(replace(camera, disparity_error_px=law), 1e3))


# ---- as the law of a camera -----------------------------------------------------------------------------------------


def test_the_error_law_follows_its_camera_and_can_be_pickled() -> None:
    law = pickle.loads(pickle.dumps(PictureDisparityError(settings=SETTINGS, models=CLOSED)))
    camera = replace(hand_lens(), disparity_error_px=law)
    distance = np.array([[54e-3, 55e-3], [56e-3, 5e-3]])
    found = law.error_px(camera, distance)
    assert found.shape == (2, 2)
    assert np.isnan(found[1, 1])
    assert found.ravel()[:3] == pytest.approx(error_of(hand_lens(), distance.ravel()[:3]).value)
    stopped = replace(camera, lens=Lens(focal_length=18.3e-3, f_number=22))
    assert law.error_px(stopped, 55e-3) == pytest.approx(error_of(hand_lens(22), 55e-3).value[0])
    assert camera.noise(distance[0]) == pytest.approx(found[0] * 7.4e-6)
    with pytest.raises(OutOfRangeError, match="declare disparity_error"):
        declared_disparity_error(camera)
    assert declared_disparity_error(hand_lens()) == 0.1
