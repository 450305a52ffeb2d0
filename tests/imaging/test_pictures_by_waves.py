"""Pictures by waves against direct integration, closed forms, rays, and what a study reports of them."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from tests.imaging import direct_integration
from tests.imaging.direct_integration import DISTANCE, IMAGE, WAVELENGTH, brightness, integrated_picture
from tests.imaging.figure_7 import figure_7, wall
from tests.test_render import facts, study
from tradestudy import api
from tradestudy.cameras.light_cones import Exposure
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.cameras.single_lens import SingleLensExposure
from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.imaging.models import Light, SensorNoise
from tradestudy.imaging.render.sight import waves_of
from tradestudy.imaging.render.tiles import Recording, Tile, expected_electrons
from tradestudy.imaging.scenes.pattern import Pattern, pattern_of
from tradestudy.imaging.scenes.scene import Scene
from tradestudy.imaging.scenes.surfaces import Flat
from tradestudy.imaging.transfer import fresnel_transfer
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.two_apertures import Stop, TwoApertures


@dataclass(frozen=True)
class Built:
    """A source of a scene that is built already."""

    scene: Scene
    extent: tuple[float, float]

    def build(self) -> Scene:
        return self.scene


def tile_of(exposure: Exposure, pattern: Pattern, distance: float, samples: int) -> Tile:
    return Tile(
        camera="camera",
        exposure=exposure,
        scene=Built(wall(pattern, distance), (distance, distance)),  # type: ignore[arg-type]  # a stand-in
        recording=Recording(
            light=Light(electrons=1000.0, f_number=1.0),
            noise=SensorNoise(read_noise_electrons=1.0, full_well_electrons=1e9, bits=12),
            model="off",
        ),
        samples=samples,
        seed=1,
        rows=(0, exposure.sensor.rows),
        columns=(0, exposure.sensor.columns),
    )


def by_waves(tile: Tile, wavelength: float, fineness: int = 1) -> FloatArray:
    waves = replace(waves_of(tile.exposure, tile.scene, wavelength), fineness=fineness)
    return expected_electrons(replace(tile, waves=waves))[0]


def unlike(one: FloatArray, other: FloatArray) -> float:
    """Relative L2 difference, whatever their units."""
    scaled = one * np.vdot(one, other) / np.vdot(one, one)
    return float(np.linalg.norm(scaled - other) / np.linalg.norm(other))


def test_the_picture_of_a_plane_agrees_with_direct_integration_over_its_points() -> None:
    """Strong contrast up to a period of five pixels behind microlenses of 2.4 Fresnel zones; rays are 7 % wrong."""
    direct = integrated_picture()
    sample = 2e-6 * DISTANCE / IMAGE
    at = (np.arange(1024) - 512 + 0.5) * sample
    pattern = pattern_of(np.roll(brightness(at[None, :], at[:, None]), (512, 512), (0, 1))[None], sample)
    few, many = (tile_of(direct_integration.exposure(), pattern, DISTANCE, samples) for samples in (8, 128))
    assert unlike(expected_electrons(many)[0], direct) > 0.06
    assert unlike(by_waves(few, WAVELENGTH), direct) < 0.024
    assert unlike(by_waves(many, WAVELENGTH, fineness=2), direct) < 0.013


@pytest.mark.parametrize("waves", [0.0, 0.5, 2.0])
def test_the_spread_of_a_lens_has_the_transfer_of_its_defocused_pupil(waves: float) -> None:
    """The spread is cut off at 32 λN, beyond which lies 1 % of its light."""
    lens, n = TwoApertures(wavelength=WAVELENGTH, radius=1e-3), 10.0
    spread = lens.spread(0.0, float(lens.curvature(np.asarray(waves))))
    every = spread.columns(np.arange(spread.count))
    for line in (*spread.sums, every.sum(axis=0) / every.sum(), every.sum(axis=1) / every.sum()):
        for share in (0.1, 0.3, 0.6):
            found = float(np.sum(line * np.cos(2 * np.pi * spread.place * 2e-3 * share)))
            blur = 8.0 * WAVELENGTH * n * waves
            assert found == pytest.approx(fresnel_transfer(share / (WAVELENGTH * n), WAVELENGTH, n, blur), abs=0.012)


def test_a_stop_passes_the_light_that_falls_on_it() -> None:
    stop = Stop(scale=-10.9, reach=14.2e-3, radius=1.64e-3)
    lens = TwoApertures(wavelength=WAVELENGTH, radius=63e-6, stop=stop)
    offsets = np.array([0.0, 0.9e-3, 1.7e-3, 2.6e-3])
    across = stop.radius * np.linspace(-1.0, 1.0, 701)
    x, y = np.meshgrid(across, across)
    inside = np.hypot(x, y) < stop.radius
    radii = np.linspace(0.0, 6e-3, 6000)
    shadow = np.square(np.abs(lens.amplitude(radii)))
    cell = (across[1] - across[0]) ** 2
    expected = [np.interp(np.hypot(x + q, y), radii, shadow)[inside].sum() * cell for q in offsets]
    assert lens.passed_share(offsets) == pytest.approx(expected, abs=2e-3)
    # All light of the lens passes some place of the plane.
    far = np.linspace(0.0, 6e-3, 1001)
    assert np.trapezoid(2 * far * lens.passed_share(far), far) / stop.radius**2 == pytest.approx(1.0, abs=4e-3)


@pytest.mark.parametrize("reach", [14.2e-3, 0.14e-3], ids=["soft", "sharp"])
def test_a_used_lens_can_be_sent_to_another_process(reach: float) -> None:
    stop = Stop(scale=-10.9, reach=reach, radius=1.64e-3)
    lens = TwoApertures(wavelength=WAVELENGTH, radius=63e-6, stop=stop)
    offsets = np.array([0.0, 1.2e-3, 1.7e-3])
    expected = lens.passed_share(offsets)
    assert lens.is_sharp is (reach < 1e-3)
    assert_array_equal(pickle.loads(pickle.dumps(lens)).passed_share(offsets), expected)


def test_a_stop_that_cuts_sends_light_where_its_rays_go() -> None:
    stop = Stop(scale=-10.9, reach=14.2e-3, radius=1.64e-3)
    lens = TwoApertures(wavelength=100e-9, radius=63e-6, stop=stop)
    curvature = 1.3 * lens.focused_curvature
    spread = lens.spread(1.9e-3, curvature)
    eta = 63e-6 * np.linspace(-1, 1, 1001)
    x, y = np.meshgrid(eta, eta)
    lit = (np.hypot(x, y) < 63e-6) & (np.hypot(stop.scale * x - 1.9e-3, stop.scale * y) < stop.radius)
    expected = lens.rays_slope(curvature) * x[lit].mean() / lens.wavelength
    # The tail is heavy: half of the light to either side.
    median = float(np.interp(0.5, np.cumsum(spread.sums[0]), spread.place))
    assert median == pytest.approx(expected, rel=0.1)
    with pytest.raises(OutOfRangeError, match="no light passes"):
        lens.spread(9e-3, curvature)
    with pytest.raises(UnaffordableError, match="use rays"):
        lens.spread(0.0, 1e4 * lens.focused_curvature)


@pytest.mark.parametrize("kind", ["plenoptic", "single lens", "two stops"])
def test_light_approaches_rays_as_the_wavelength_shrinks(kind: str) -> None:
    exposure: Exposure = figure_7(pixels=48)
    if kind != "plenoptic":
        exposure = SingleLensExposure(
            name="image",
            sensor=Sensor(columns=48, rows=48, pixel_pitch=5.5e-6),
            lens=Lens(focal_length=12.5e-3, f_number=8.0),
            focus_distance=0.2,
            stop_separation=0.02 if kind == "two stops" else 0.0,
        )
    rng = np.random.default_rng(1)
    slow = np.hypot(*np.meshgrid(*2 * [np.fft.fftfreq(256)])) < 0.1
    smooth = np.fft.ifft2(np.fft.fft2(rng.standard_normal((256, 256))) * slow).real
    pattern = pattern_of((1.0 + 0.2 * smooth / smooth.std())[None], 0.1e-3)
    tile = tile_of(exposure, pattern, 0.3, 64)
    rays = expected_electrons(tile)[0]
    changes = [float(np.linalg.norm(by_waves(tile, line) - rays) / np.linalg.norm(rays)) for line in (5e-7, 2e-8)]
    assert changes[1] < 0.006
    assert changes[0] > changes[1]


def test_the_edge_of_a_surface_against_darkness_is_blurred_as_its_transfer_says() -> None:
    """Half of the pixels look past it: ``½ + (1/π) ∫ H(ν) sinc(νw) sin(2πνp)/ν dν`` at p from the edge."""
    f, focus, distance, pitch = 12.5e-3, 0.16, 0.15, 4e-6
    lens = Lens(focal_length=f, f_number=8.0)
    sensor = Sensor(columns=24, rows=1, pixel_pitch=pitch)
    exposure = SingleLensExposure(name="image", sensor=sensor, lens=lens, focus_distance=focus)
    tile = tile_of(exposure, pattern_of(np.ones((1, 64, 64)), 1e-3), distance, 1024)
    half = Flat(
        centre=(0.05, 0.0, distance),
        first=(1.0, 0.0, 0.0),
        second=(0.0, 1.0, 0.0),
        size=(0.1, np.inf),
        pattern=None,  # type: ignore[arg-type]  # a built scene has its pattern beside it
    )
    whole = tile.scene.build()
    scene = Built(replace(whole, surfaces=[half]), (distance, distance))
    cut = replace(tile, scene=scene)  # type: ignore[arg-type]  # a stand-in
    found = by_waves(cut, WAVELENGTH) / by_waves(tile, WAVELENGTH)
    c = exposure.image_distance
    n, blur = c / lens.pupil_diameter, lens.pupil_diameter * c * abs(1 / focus - 1 / distance)
    t, weight = np.polynomial.legendre.leggauss(200)
    nu, weight = (t + 1) / 2 / (WAVELENGTH * n), weight / 2 / (WAVELENGTH * n)
    at = (np.arange(24) + 0.5 - 12) * pitch
    passed = fresnel_transfer(nu, WAVELENGTH, n, blur) * np.sinc(nu * pitch) * weight / nu
    expected = 0.5 + np.sin(2 * np.pi * np.outer(at, nu)) @ passed / np.pi
    assert np.max(np.abs(found[0] - expected)) < 0.025
    assert np.max(np.abs((expected_electrons(cut)[0] / expected_electrons(tile)[0])[0] - expected)) > 0.05


def small(folder: Path, *more: str, effects: str) -> api.Study:
    return study(folder, "{shape: plane, distance: 150 mm}", "cameras: [pair]", *more, effects=effects)


def test_the_plan_justifies_rays_and_the_picture_states_what_they_leave_out(tmp_path: Path) -> None:
    plain = small(tmp_path, effects="accuracy: {pixel_intensity: 10 %}")
    (line,) = (line for line in str(plain.plan()).splitlines() if line.startswith("pair-pictures"))
    assert "no diffraction; leaving out diffraction at the main lens changes the pixel intensity" in line
    assert "trial at a few places; 10 % allowed" in line
    api.render(plain, tmp_path)
    left = facts(tmp_path, "pair")["pictures"]["left"]
    assert left["model"] == "rays"
    assert 0.0 < left["model_error"] < 0.1
    assert left["within_tolerance"] is True


def test_a_study_can_force_waves(tmp_path: Path) -> None:
    forced = small(
        tmp_path,
        "noise: 'off'",
        effects="effects: {main_lens_diffraction: fresnel}\naccuracy: {pixel_intensity: 0.01 %}",
    )
    (line,) = (line for line in str(forced.plan()).splitlines() if line.startswith("pair-pictures"))
    assert "Fresnel diffraction" in line
    api.render(forced, tmp_path)
    left = facts(tmp_path, "pair")["pictures"]["left"]
    assert left["model"] == "waves"
    assert left["model_error"] == 0.0  # nothing cuts what is bent
    assert 1e-4 < left["sampling_error"] < 0.02
    assert left["within_tolerance"] is False
