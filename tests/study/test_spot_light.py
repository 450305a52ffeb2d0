"""Spectra, hexagonal arrays of several types, coherent discs and points: what a study says is what is simulated.

Light paths are put together here by hand, lens by lens, and handed to the chain directly.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tradestudy
from tradestudy.models.light_spot import LightSpotProblem
from tradestudy.models.spot_images import SpotModels, light_path, spot_image, spot_picture
from tradestudy.optics.chain.accuracy import ChainAccuracy
from tradestudy.optics.chain.image import chain_image, separate_image, spectral_image
from tradestudy.optics.chain.scene import FRESNEL, LightPath, Microlenses, PixelGrid
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.lens import CircularLens, PointSource
from tradestudy.study.schema.wave_optics import LightSpotPart

STUDY = """
format: 2
study: small-spot
title: A spot behind a few microlenses of two types
question: What does the picture look like?
light_spot:
  main_lens: {focal_length: 12.5 mm, f_number: 8, lens_phase: parabolic}
  mla_distance: 14.8 mm
  microlenses:
    layout: hexagonal
    lenses_across: 3
    pitch: 60 um
    focal_length: [0.40 mm, 0.45 mm]
    aperture_width: 54 um
    gap: 0.55 mm
    interstices: opaque
    lens_phase: parabolic
  detector: {pixels: 15, pixel_pitch: 12 um}
  spot: {diameter: 0.1 mm, distance: 150 mm}
  spectrum: {wavelengths: [450 nm, 550 nm, 650 nm], weights: [1, 2, 1]}
  methods: [fresnel]
  tolerance: 20 %
accuracy: {tolerance: 20 %}
effects: {main_lens_diffraction: fresnel, microlens_diffraction: fresnel, spectrum: weighted, source_extent: disc}
"""
SPECTRUM = "spectrum: {wavelengths: [450 nm, 550 nm, 650 nm], weights: [1, 2, 1]}"
MEAN_ALONE = (SPECTRUM, "wavelength: 550 nm")
ONE_LINE = (" spectrum: weighted,", "")
PITCH, ROW = 60e-6, 60e-6 * math.sqrt(3.0) / 2.0
# Types take turns along each row and shift by one from row to row; the first is on the axis.
LENSES = [
    (-PITCH / 2, -ROW, 0.45e-3), (PITCH / 2, -ROW, 0.40e-3),
    (-PITCH, 0.0, 0.45e-3), (0.0, 0.0, 0.40e-3), (PITCH, 0.0, 0.45e-3),
    (-PITCH / 2, ROW, 0.40e-3), (PITCH / 2, ROW, 0.45e-3),
]  # fmt: skip
PATH = LightPath(
    main_lens=CircularLens(radius=12.5e-3 / 16, focal_length=12.5e-3, lens_phase="parabolic"),
    microlenses=Microlenses(
        centres=np.array([lens[:2] for lens in LENSES]),
        focal_lengths=np.array([lens[2] for lens in LENSES]),
        aperture="circular",
        aperture_width=54e-6,
        pitch=PITCH,
        layout="hexagonal",
        gaps="opaque",
        lens_phase="parabolic",
    ),
    array_distance=14.8e-3,
    detector_distance=0.55e-3,
    pixels=PixelGrid(pitch=12e-6, shape=(15, 15)),
)
DISC = DiscSource(diameter=0.1e-3, distance=0.150)
LOOSE = ChainAccuracy(tolerance=0.2)


def study(tmp_path: Path, *changes: tuple[str, str]) -> tradestudy.api.Study:
    text = STUDY
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "study.yaml"
    path.write_text(text, encoding="utf-8")
    return tradestudy.load(path)


def spot(tmp_path: Path, *changes: tuple[str, str]) -> LightSpotPart:
    part = study(tmp_path, *changes).file.light_spot
    assert part is not None
    return part


def relative(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def test_a_picture_reports_progress_and_does_not_depend_on_it(tmp_path: Path) -> None:
    part = spot(tmp_path, (SPECTRUM, "spectrum: {wavelengths: [500 nm, 600 nm], weights: [1, 1]}"))
    models = SpotModels(method="fresnel", tolerance=0.2)
    heard: list[float] = []
    image = spot_picture(part, models, heard.append)
    assert len(heard) >= 4  # rings of both wavelengths
    assert np.all(np.diff(heard) > 0.0)
    assert 0.0 < heard[0] < 0.5
    assert any(share == pytest.approx(0.5) for share in heard)  # the first wavelength is done
    assert heard[-1] == pytest.approx(1.0)
    again: list[float] = []
    assert spot_picture(part, models, again.append) is image  # what was computed is not computed again
    assert again == []
    alone: list[float] = []
    separate_image(
        PATH, PointSource(x=0.0, y=0.0, distance=0.150), wavelength=550e-9, legs=FRESNEL, accuracy=LOOSE, rng=rng(),
        done=alone.append,
    )  # fmt: skip
    assert alone == pytest.approx(np.arange(1, 8) / 7)


def test_a_spectrum_through_a_hexagonal_array_of_two_types(tmp_path: Path) -> None:
    result = study(tmp_path).run()
    data = result.data["images"].to_dataset()
    expected = spectral_image(
        PATH,
        DISC,
        wavelengths=np.array([450e-9, 550e-9, 650e-9]),
        weights=np.array([1.0, 2.0, 1.0]),
        legs=FRESNEL,
        accuracy=LOOSE,
        rng=rng(),
    )
    assert relative(data["image"].sel(propagator="fresnel").values, expected.pixels) < 1e-9
    assert float(data["numerical_error"].sel(propagator="fresnel")) == pytest.approx(expected.numerical_error, rel=0.5)
    assert relative(data["chosen_image"].values, expected.pixels) < 1e-9
    assert data["wavelength"].values.tolist() == [450e-9, 550e-9, 650e-9]
    assert data["spectral_share"].values.tolist() == [0.25, 0.5, 0.25]
    found = {tuple(np.round([x, y], 12)): f for x, y, f in zip(
        data["microlens_x"].values, data["microlens_y"].values, data["microlens_focal_length"].values, strict=True
    )}  # fmt: skip
    assert found == {tuple(np.round([x, y], 12)): f for x, y, f in LENSES}
    page = (result.write(tmp_path / "out", pdf=False) / "report.html").read_text(encoding="utf-8")
    for words in ("450\N{NO-BREAK SPACE}nm", "intensities", "hexagonal"):
        assert words in page


def test_the_mean_wavelength_alone_where_the_study_says_so(tmp_path: Path) -> None:
    forced = ("spectrum: weighted", "spectrum: off")
    data = study(tmp_path, forced).run().data["images"]
    mean = chain_image(PATH, DISC, wavelength=550e-9, legs=FRESNEL, accuracy=LOOSE, rng=rng()).pixels
    assert relative(data["chosen_image"].values, mean) < 1e-9
    compared = data["image"].sel(propagator="fresnel").values  # which leaves nothing out
    assert relative(compared, mean) > 1e-3
    assert (data.attrs["chosen_spectrum"], data.attrs["mean_wavelength"]) == (0.0, pytest.approx(550e-9, rel=1e-12))


def test_microlenses_apart_have_a_spectrum_too(tmp_path: Path) -> None:
    part = spot(tmp_path, ("diameter: 0.1 mm", "diameter: 0 mm"))
    found = spot_picture(part, SpotModels(method="fresnel", tolerance=0.2, separate=True, point=True))
    point = PointSource(distance=0.150)
    images = [
        separate_image(PATH, point, wavelength=w, legs=FRESNEL, accuracy=LOOSE, rng=rng())
        for w in (450e-9, 550e-9, 650e-9)
    ]
    expected = (images[0].pixels + 2.0 * images[1].pixels + images[2].pixels) / 4.0
    assert relative(found.pixels, expected) < 1e-9
    errors = [one.numerical_error * np.linalg.norm(one.pixels) for one in images]
    worst = (errors[0] + 2.0 * errors[1] + errors[2]) / 4.0 / np.linalg.norm(expected)
    assert found.numerical_error == pytest.approx(worst, rel=0.5)


def test_wavelengths_without_light_are_not_computed(tmp_path: Path) -> None:
    one = spot(tmp_path, ("weights: [1, 2, 1]", "weights: [0, 2, 0]"))
    assert one.lines == ((550e-9, 1.0),)
    slots = {slot.name: slot.models for slot in LightSpotProblem(one, {}).slots}
    assert slots["spectrum"] == ("off",)


def test_rays_are_the_same_at_every_wavelength(tmp_path: Path) -> None:
    many, one = spot(tmp_path), spot(tmp_path, (SPECTRUM, "wavelength: 450 nm"))
    assert np.array_equal(spot_image(many, "geometric").pixels, spot_image(one, "geometric").pixels)


@pytest.mark.usefixtures("empty_figures")
def test_a_coherent_disc_is_one_wave(tmp_path: Path) -> None:
    coherent = ("distance: 150 mm}", "distance: 150 mm, coherent: true}")
    loaded = study(tmp_path, MEAN_ALONE, ONE_LINE, coherent)
    result = loaded.run()
    data = result.data["images"]
    source = replace(DISC, coherent=True)
    expected = chain_image(PATH, source, wavelength=550e-9, legs=FRESNEL, accuracy=LOOSE, rng=rng()).pixels
    assert relative(data["image"].sel(propagator="fresnel").values, expected) < 1e-9
    apart = chain_image(PATH, DISC, wavelength=550e-9, legs=FRESNEL, accuracy=LOOSE, rng=rng()).pixels
    assert relative(expected, apart) > 0.1
    assert data.attrs["source"] == "coherent disc"
    page = (result.write(tmp_path / "out", pdf=False) / "report.html").read_text(encoding="utf-8")
    assert "one wave, of one phase over the disc" in page


def test_a_coherent_disc_has_no_rays(tmp_path: Path) -> None:
    part = spot(tmp_path, MEAN_ALONE, ("distance: 150 mm}", "distance: 150 mm, coherent: true}"))
    slots = {slot.name: slot.models for slot in LightSpotProblem(part, {}).slots}
    assert slots["main_lens_diffraction"] == slots["microlens_diffraction"] == ("fresnel", "kirchhoff")


def test_a_point_lands_behind_every_microlens_where_thin_lenses_put_it(tmp_path: Path) -> None:
    """The mean ray through a wholly lit lens at c starts at x' (main image, a_L before it): c + (c − x') b_L/a_L."""
    point = ("diameter: 0.1 mm, distance: 150 mm", "diameter: 0 mm, distance: 150 mm, x: 50 um")
    wide = (("f_number: 8", "f_number: 5"), ("pixels: 15, pixel_pitch: 12 um", "pixels: 61, pixel_pitch: 4 um"))
    pixels = spot_image(spot(tmp_path, MEAN_ALONE, point, *wide), "geometric").pixels
    image = 1.0 / (1.0 / 12.5e-3 - 1.0 / 0.150)
    magnified = 0.55e-3 / (14.8e-3 - image)
    across = 4e-6 * (np.arange(61) - 30)
    for x, y, _ in LENSES:
        place = x + (x + 50e-6 * image / 0.150) * magnified, y * (1.0 + magnified)
        near = (across[:, None] - place[1]) ** 2 + (across - place[0]) ** 2 < (30e-6) ** 2
        light = np.where(near, pixels, 0.0)
        assert light.sum() == pytest.approx(pixels.sum() / 7.0, rel=0.01)  # all lenses are lit alike
        assert light.sum(axis=0) @ across / light.sum() == pytest.approx(place[0], abs=0.5e-6)
        assert light.sum(axis=1) @ across / light.sum() == pytest.approx(place[1], abs=0.5e-6)


@pytest.mark.usefixtures("empty_figures")
def test_a_point_is_simulated_as_a_point(tmp_path: Path) -> None:
    loaded = study(
        tmp_path, MEAN_ALONE, ONE_LINE, (", source_extent: disc", ""), ("diameter: 0.1 mm", "diameter: 0 mm")
    )
    result = loaded.run()
    data = result.data["images"]
    expected = chain_image(
        PATH, PointSource(distance=0.150), wavelength=550e-9, legs=FRESNEL, accuracy=LOOSE, rng=rng()
    ).pixels
    assert relative(data["image"].sel(propagator="fresnel").values, expected) < 1e-9
    assert data.attrs["source"] == "point"
    part = loaded.file.light_spot
    assert part is not None
    slots = {slot.name: slot.models for slot in LightSpotProblem(part, {}).slots}
    assert slots["source_extent"] == ("off",)
    page = (result.write(tmp_path / "out", pdf=False) / "report.html").read_text(encoding="utf-8")
    assert "The spot is a point." in page


def test_three_types_on_a_hexagonal_array_form_three_arrays(tmp_path: Path) -> None:
    """Each on one of √3 times the pitch, as microlenses of three types are made."""
    part = spot(
        tmp_path,
        ("focal_length: [0.40 mm, 0.45 mm]", "focal_length: [0.40 mm, 0.42 mm, 0.45 mm]"),
        ("lenses_across: 3", "lenses_across: 5"),
    )
    lenses = light_path(part).microlenses
    assert lenses.count == 19
    assert lenses.focal_lengths[np.linalg.norm(lenses.centres, axis=1).argmin()] == 0.40e-3
    for kind in (0.40e-3, 0.42e-3, 0.45e-3):
        own = lenses.centres[lenses.focal_lengths == kind]
        apart = np.linalg.norm(own[:, None] - own, axis=-1)
        assert apart[apart > 0.0].min() == pytest.approx(math.sqrt(3.0) * PITCH, rel=1e-9)


def test_two_types_on_a_square_array_are_a_checkerboard(tmp_path: Path) -> None:
    square = (("layout: hexagonal", "layout: square"), ("pitch: 60 um", "pitch: 60 um\n    aperture: square"))
    lenses = light_path(spot(tmp_path, *square)).microlenses
    assert (lenses.aperture, lenses.aperture_width, lenses.layout) == ("square", 54e-6, "square")
    first = np.array([[1, 0, 1], [0, 1, 0], [1, 0, 1]], dtype=bool)
    assert np.array_equal(lenses.focal_lengths.reshape(3, 3) == 0.40e-3, first)
