"""The spot behind a microlens array from numbers in one call: what is computed, and how well."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from tests.cameras.builders import r5
from tests.optics.small_chain import relative
from tradestudy import optics
from tradestudy.errors import NotConvergedError, OutOfRangeError, TradestudyError, UnaffordableError
from tradestudy.optics import microlens_camera as module
from tradestudy.optics.chain.arriving_light import blur_radius
from tradestudy.optics.chain.lit_part import array_reach

WAVELENGTH = 550e-9
CAMERA = optics.MicrolensCamera(
    focal_length=2e-3,
    f_number=8.0,
    array_distance=2.5e-3,
    microlens_focal_lengths=(70e-6, 76e-6, 85e-6),
    microlens_pitch=26e-6,
    gap=0.1e-3,
    pixel_pitch=4e-6,
    microlens_aperture=24e-6,
)
COMA = replace(CAMERA, pupil=optics.Pupil.from_waves({8: 0.6}, wavelength=WAVELENGTH))
POINT = optics.PointSource(x=0.3e-3, y=-0.2e-3, distance=20e-3)


def test_one_call_equals_the_chain_assembled_from_parts() -> None:
    """The microlenses and pixels that were left out hardly see any light."""
    image = module.microlens_image(CAMERA, POINT, wavelength=WAVELENGTH, tolerance=1e-3)
    path = CAMERA.light_path(POINT, wavelength=WAVELENGTH)
    centres = 26e-6 * np.array([[q + r / 2, r * np.sqrt(3) / 2] for q in range(-8, 9) for r in range(-8, 9)])
    types = np.array([(q - r) % 3 for q in range(-8, 9) for r in range(-8, 9)])
    near = np.linalg.norm(centres - path.chief_point(POINT), axis=1) < 110e-6
    by_hand = optics.LightPath(
        main_lens=optics.CircularLens(radius=0.125e-3, focal_length=2e-3, lens_phase="perfect"),
        microlenses=optics.Microlenses(
            centres=centres[near],
            focal_lengths=np.array([70e-6, 76e-6, 85e-6])[types[near]],
            aperture="circular",
            aperture_width=24e-6,
            pitch=26e-6,
            layout="hexagonal",
            gaps="opaque",
            lens_phase="parabolic",
        ),
        array_distance=2.5e-3,
        detector_distance=0.1e-3,
        pixels=path.pixels,
    )
    truth = optics.chain_image(
        by_hand,
        POINT,
        wavelength=WAVELENGTH,
        legs=optics.KIRCHHOFF,
        accuracy=optics.ChainAccuracy(tolerance=1e-3),
        rng=np.random.default_rng(3),
    )
    assert near.sum() > 1.5 * path.microlenses.count
    assert relative(image.pixels, truth.pixels) < 0.01
    assert image.numerical_error <= 1e-3
    assert 0.6 < image.pixels.sum() < 1.0
    edge = path.pixels.edges_x / 4e-6
    assert edge == pytest.approx(np.rint(edge), abs=1e-6)  # whole pixels of the sensor


def test_errors_of_single_pixels_and_of_their_sum_cover_what_a_finer_image_changes() -> None:
    coarse, fine = (
        module.microlens_image(CAMERA, POINT, wavelength=WAVELENGTH, tolerance=tolerance) for tolerance in (2e-2, 5e-4)
    )
    assert 0 < np.abs(coarse.pixels - fine.pixels).max() <= coarse.pixel_error <= 2e-2
    total = coarse.share_on_pixels
    assert abs(total.value - fine.pixels.sum()) <= total.error < 0.1
    single = replace(coarse, pixels=coarse.pixels[:1, :1])
    assert single.share_on_pixels.error == pytest.approx(single.numerical_error * single.pixels[0, 0], rel=1e-12)


def test_an_image_that_misses_its_tolerance_is_refined_or_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    coma = replace(CAMERA, pupil=optics.Pupil.from_waves({8: 0.25}, wavelength=WAVELENGTH))
    good = module.microlens_image(coma, POINT, wavelength=WAVELENGTH, tolerance=1e-3)
    assert good.numerical_error <= 1e-3
    assert good.within_tolerance
    rough = module.microlens_image(coma, POINT, wavelength=WAVELENGTH, tolerance=1e-2)
    assert relative(rough.pixels, good.pixels) <= rough.numerical_error + good.numerical_error
    asked = []

    def stubborn(*_: object, accuracy: optics.ChainAccuracy, **__: object) -> optics.ChainImage:
        asked.append(accuracy.tolerance)
        return replace(good, numerical_error=0.01)

    monkeypatch.setattr(module, "unguarded_image", stubborn)
    with pytest.raises(NotConvergedError, match=r"stated relative L2 error 0\.01"):
        module.microlens_image(coma, POINT, wavelength=WAVELENGTH, tolerance=1e-3)
    assert asked == sorted(asked, reverse=True)
    assert asked[-1] < 1e-2 * asked[0]


@pytest.mark.parametrize(("steepness", "centre", "tolerance"), [(22.0, 1.0, 1e-2), (60.0, 1.0, 3e-2)])
def test_light_from_the_rim_of_a_masked_pupil_is_not_left_out(
    steepness: float, centre: float, tolerance: float
) -> None:
    """A soft opening at the rim lights a microlens beside the geometric blur, which focuses on few pixels."""
    pupil = optics.Pupil(amplitude=lambda x, y: np.exp(-steepness * ((x - centre) ** 2 + y**2)))
    lens = replace(CAMERA, microlens_focal_lengths=76e-6, microlens_aperture=None, pupil=pupil)
    source = optics.PointSource(distance=20e-3)
    image = module.microlens_image(lens, source, wavelength=WAVELENGTH, tolerance=tolerance)
    path = lens.light_path(source, wavelength=WAVELENGTH)
    around = lens.next_microlenses(path, source)
    many = replace(
        around,
        centres=np.concatenate([path.microlenses.centres, around.centres]),
        focal_lengths=np.full(path.microlenses.count + around.count, 76e-6),
    )
    truth = optics.chain_image(
        replace(path, microlenses=many), source, wavelength=WAVELENGTH, legs=optics.KIRCHHOFF,
        accuracy=optics.ChainAccuracy(tolerance=tolerance / 3), rng=np.random.default_rng(3),
    )  # fmt: skip
    assert relative(image.pixels, truth.pixels) <= image.numerical_error + truth.numerical_error
    assert image.numerical_error <= tolerance


@pytest.mark.parametrize(
    ("waves", "wavelength", "tolerance"),
    [
        ({}, 550e-9, 2e-3),
        ({8: 0.5}, 550e-9, 2e-2),
        ({4: 1.0}, 550e-9, 2e-2),
        pytest.param({2: 4.0}, 550e-9, 2e-2, marks=pytest.mark.slow),
        ({}, 8e-6, 5e-2),
    ],
)
def test_light_of_microlenses_left_out_is_within_the_stated_error(
    waves: dict[int, float], wavelength: float, tolerance: float
) -> None:
    """Coma, defocus and tilt of whole waves, or far infrared, light microlenses far beyond the geometric blur."""
    pupil = optics.Pupil.from_waves(waves, wavelength=wavelength) if waves else None
    lens = replace(CAMERA, microlens_focal_lengths=76e-6, pupil=pupil)
    image = module.microlens_image(lens, POINT, wavelength=wavelength, tolerance=tolerance)
    path = lens.light_path(POINT, wavelength=wavelength)
    centres = 26e-6 * np.array([[q + r / 2, r * np.sqrt(3) / 2] for q in range(-15, 16) for r in range(-15, 16)])
    away = np.linalg.norm(centres - path.chief_point(POINT), axis=1)
    farthest = np.linalg.norm(path.microlenses.centres - path.chief_point(POINT), axis=1).max()
    near = away < farthest + 2.5 * 26e-6
    many = replace(path.microlenses, centres=centres[near], focal_lengths=np.full(near.sum(), 76e-6))
    truth = optics.chain_image(
        replace(path, microlenses=many), POINT, wavelength=wavelength, legs=optics.KIRCHHOFF,
        accuracy=optics.ChainAccuracy(tolerance=tolerance / 3), rng=np.random.default_rng(3),
    )  # fmt: skip
    assert many.count > 1.5 * path.microlenses.count
    assert relative(image.pixels, truth.pixels) <= image.numerical_error + truth.numerical_error
    assert image.numerical_error <= tolerance
    assert truth.pixels.sum() > 0.6
    assert image.error_terms["microlenses left out"] > 0.0


def test_light_behind_the_pupil_reaches_as_far_as_its_exact_rays() -> None:
    """Defocus of 2 waves rms moves the rim's rays by 4√3 W z/R beside the blur; tilt moves all rays by 2 W z/R."""
    path = CAMERA.light_path(POINT, wavelength=WAVELENGTH)
    blur = blur_radius(path, POINT)
    dark_ring = 0.61 * WAVELENGTH * 2.5e-3 / 0.125e-3
    for index, waves, moved in ((4, 2.0, 4 * np.sqrt(3)), (4, -2.0, -4 * np.sqrt(3)), (2, 5.0, 2.0)):
        pupil = optics.Pupil.from_waves({index: waves}, wavelength=WAVELENGTH)
        aberrated = replace(path, main_lens=replace(path.main_lens, pupil=pupil))
        reach = array_reach(aberrated, [POINT], WAVELENGTH) - dark_ring
        side = np.sign(path.image_at_array(POINT)[2])
        shift = moved * abs(waves) * WAVELENGTH * 2.5e-3 / 0.125e-3
        expected = abs(shift - side * blur) if index == 4 else shift + blur
        assert reach == pytest.approx(expected, rel=0.02)


def test_colour_and_curvature_move_the_image_as_another_focal_length_does() -> None:
    table = optics.FocalLengths(
        field_angles=np.array([0.0, 0.1]),
        wavelengths=np.array([500e-9, 600e-9]),
        focal_lengths=np.array([[1.99e-3, 2.01e-3], [1.97e-3, 1.99e-3]]),
        reference_wavelength=550e-9,
    )
    camera = replace(CAMERA, focal_length=table)
    spectrum = module.microlens_image(
        camera, POINT, wavelength=np.array([500e-9, 600e-9]), weights=np.array([1.0, 3.0]), tolerance=1e-2
    )
    angle = np.arctan(np.hypot(0.3, 0.2) / 20)
    images = []
    for wavelength, on_axis in ((500e-9, 1.99e-3), (600e-9, 2.01e-3)):
        focal_length = on_axis - 0.02e-3 * angle / 0.1
        plain = replace(CAMERA, focal_length=focal_length, f_number=focal_length / 0.25e-3)
        path = camera.light_path(POINT, wavelength=wavelength)
        assert path.main_lens.focal_length == pytest.approx(focal_length)
        assert path.main_lens.radius == pytest.approx(0.125e-3)
        images.append(module.microlens_image(plain, POINT, wavelength=wavelength, tolerance=1e-2).pixels)
    smallest = min(image.shape[0] for image in images)
    cropped = []
    for image in (*images, spectrum.pixels):
        margin = (image.shape[0] - smallest) // 2
        cropped.append(image[margin : margin + smallest, margin : margin + smallest])
    assert relative(cropped[2], 0.25 * cropped[0] + 0.75 * cropped[1]) < 0.02
    assert relative(cropped[0], cropped[1]) > 0.05
    with pytest.raises(OutOfRangeError, match="field curvature over a disc"):
        camera.light_path(optics.DiscSource(diameter=0.1e-3, distance=20e-3), wavelength=550e-9)


def test_a_declared_camera_gives_its_own_chain_in_one_call() -> None:
    camera = r5()
    chain = camera.light_chain()
    point = optics.PointSource(distance=0.3)
    path = chain.light_path(point, wavelength=WAVELENGTH)
    assert path.array_distance == camera.geometry.mla_distance
    assert path.main_lens.radius == pytest.approx(camera.main_lens.pupil_diameter / 2)
    # The disc of light on the array is what the camera's own geometry says, with a ring of microlenses around.
    reach = float(camera.radius_over_pitch(0.3)) * camera.microlenses.pitch
    distance = np.linalg.norm(path.microlenses.centres, axis=1)
    assert reach < distance.max() < reach + 1.01 * camera.microlenses.pitch
    shares = [np.isclose(path.microlenses.focal_lengths, f).mean() for f in camera.microlenses.focal_lengths]
    assert min(shares) > 0.2
    image = module.microlens_image(chain, point, wavelength=WAVELENGTH, legs=optics.GEOMETRIC)
    assert image.within_tolerance
    assert 0.6 < image.pixels.sum() < 1.0


def test_field_curvature_of_a_camera_moves_the_image_that_far() -> None:
    camera = r5(field_curvature=40e-6)
    z, corner = camera.geometry.mla_distance, camera.sensor.diagonal / 2
    flat = r5().light_chain()
    source = 1 / (1 / camera.main_lens.focal_length - 1 / z)  # what is in focus on the array
    for share in (0.0, 0.5, 1.0):
        point = optics.PointSource(x=share * 0.999999 * corner / z * source, distance=source)
        moved = camera.light_chain().light_path(point, wavelength=WAVELENGTH).image_at_array(point)[2]
        assert -moved == pytest.approx(40e-6 * share**2, rel=1e-3, abs=1e-9)
        assert flat.light_path(point, wavelength=WAVELENGTH).image_at_array(point)[2] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"microlens_aperture": 0.0}, OutOfRangeError),
        ({"microlens_pitch": 1e-9}, UnaffordableError),
        ({"pixel_pitch": 1e-12}, UnaffordableError),
        ({"pupil": optics.Pupil(zernikes={2: 0.06e-3})}, UnaffordableError),
        ({"pupil": optics.Pupil(zernikes={2: 0.1e-3})}, OutOfRangeError),
    ],
)
def test_impossible_arrays_are_refused_at_once(change: dict[str, float], error: type[TradestudyError]) -> None:
    data = {"microlens_focal_lengths": 76e-6, "microlens_pitch": 26e-6, "gap": 0.1e-3, "pixel_pitch": 4e-6} | change
    camera = optics.MicrolensCamera(focal_length=2e-3, f_number=8.0, array_distance=2.5e-3, **data)  # type: ignore[arg-type]
    with pytest.raises(error):
        camera.light_path(optics.PointSource(distance=20e-3), wavelength=550e-9)


@pytest.fixture(scope="module")
def with_coma() -> optics.ChainImage:
    return module.microlens_image(COMA, POINT, wavelength=WAVELENGTH, tolerance=1e-2)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("legs", [optics.FRESNEL, optics.KIRCHHOFF_FRESNEL])
def test_fresnel_behind_an_aberrated_lens_passes_its_check(
    with_coma: optics.ChainImage, legs: optics.Legs, seed: int
) -> None:
    """Its check once summed the light of microlenses so far away that their nodes did not resolve it."""
    image = module.microlens_image(COMA, POINT, wavelength=WAVELENGTH, legs=legs, tolerance=1e-2, seed=seed)
    assert image.direct_check["intensity on the detector"] < 0.03
    assert relative(image.pixels, with_coma.pixels) < 0.1  # the microlenses are faster than f/3


def test_a_dark_microlens_and_a_giant_coherent_disc_are_refused() -> None:
    dark = replace(CAMERA, microlens_pupil=optics.Pupil(amplitude=lambda x, _y: 0.0 * x))
    with pytest.raises(OutOfRangeError, match="microlenses' pupil"):
        module.microlens_image(dark, POINT, wavelength=WAVELENGTH)
    giant = optics.DiscSource(diameter=1e12, distance=1e15, coherent=True)
    with pytest.raises(UnaffordableError, match="coherent disc"):
        module.microlens_image(CAMERA, giant, wavelength=WAVELENGTH)
    with pytest.raises(TypeError, match="source"):
        CAMERA.light_path("x", wavelength=WAVELENGTH)  # type: ignore[arg-type]  # wrong on purpose


def test_wavelengths_that_no_memory_resolves_are_refused_before_nodes_are_placed() -> None:
    with pytest.raises(UnaffordableError, match="microlens nodes"):
        module.microlens_image(CAMERA, POINT, wavelength=1e-12)


@pytest.mark.parametrize("focal_length", [1e6, 5e-3])
def test_more_points_or_pupil_nodes_than_memory_holds_are_refused_before_they_are_placed(focal_length: float) -> None:
    """A plane 1 mm behind a lens 4 mm wide: steep light, fine fringes, more than 9 GB."""
    lenses = optics.Microlenses(
        centres=optics.square_centres(pitch=300e-6, count=5), focal_lengths=np.full(25, 10e-3), aperture="square",
        aperture_width=300e-6, pitch=300e-6, layout="square", gaps="opaque", lens_phase="parabolic",
    )  # fmt: skip
    path = optics.LightPath(
        main_lens=optics.CircularLens(radius=2e-3, focal_length=focal_length, lens_phase="parabolic"),
        microlenses=lenses, array_distance=1e-3, detector_distance=10e-3,
        pixels=optics.PixelGrid(pitch=5e-6, shape=(301, 301)),
    )  # fmt: skip
    one = replace(path, microlenses=replace(lenses.only(0), aperture_width=20e-6, pitch=20e-6))
    vast = replace(path, pixels=optics.PixelGrid(pitch=5e-6, shape=(100_000, 100_000)))
    tracemalloc.start()
    with pytest.raises(UnaffordableError, match=r"pixels of the detector.* use fewer pixels"):
        optics.chain_image(
            vast, optics.PointSource.at_infinity(), wavelength=633e-9, legs=optics.GEOMETRIC,
            accuracy=optics.ChainAccuracy(tolerance=1e-2), rng=np.random.default_rng(0),
        )  # fmt: skip
    for part, what in ((path, "points"), (one, "pupil nodes")):
        with pytest.raises(UnaffordableError, match=f"main-lens field on the array: .* {what}.* use fewer microlenses"):
            optics.chain_image(
                part, optics.PointSource.at_infinity(), wavelength=633e-9, legs=optics.FRESNEL,
                accuracy=optics.ChainAccuracy(tolerance=1e-2), rng=np.random.default_rng(0),
            )  # fmt: skip
    assert tracemalloc.get_traced_memory()[1] < 5e8
    tracemalloc.stop()
