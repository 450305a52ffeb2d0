"""Discs larger than what the microlenses see, computed from the part that lights them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.campaigns.light_cases import large_part
from tradestudy.models.spot_images import light_path, light_source
from tradestudy.optics.chain import spot_image
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.image import chain_image
from tradestudy.optics.chain.lit_part import lit_disc
from tradestudy.optics.chain.scene import KIRCHHOFF, LightPath, Microlenses, PixelGrid, square_centres
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.lens import CircularLens


def large_disc() -> tuple[LightPath, DiscSource, float]:
    """A random disc of which the microlenses see about a third, and the wavelength."""
    part = large_part(np.random.default_rng([824, 238]))  # of a seed that set no factor of safety
    source = light_source(part)
    assert isinstance(source, DiscSource)
    return light_path(part), source, part.mean_wavelength


def image(path: LightPath, source: DiscSource, wavelength: float, tolerance: float, density: float) -> ChainImage:
    accuracy = ChainAccuracy(tolerance=tolerance, source_sampling=density)
    rng = np.random.default_rng(0)
    return chain_image(path, source, wavelength=wavelength, legs=KIRCHHOFF, accuracy=accuracy, rng=rng)


def test_the_lit_part_gives_the_image_of_the_whole_disc(monkeypatch: pytest.MonkeyPatch) -> None:
    path, source, wavelength = large_disc()
    found = image(path, source, wavelength, 0.1, 1.4)
    assert 0.0 < found.error_terms["dark part of the source"] < 0.05
    monkeypatch.setattr(spot_image, "lit_disc", lambda _path, whole, **_: whole)
    whole = image(path, source, wavelength, 0.04, 1.6)
    assert "dark part of the source" not in whole.error_terms
    change = np.linalg.norm(found.pixels - whole.pixels) / np.linalg.norm(whole.pixels)
    assert whole.numerical_error < change < found.numerical_error
    assert found.effort["source points"] < 0.5 * whole.effort["source points"]


def test_the_whole_disc_is_computed_where_the_rest_is_not_dark_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    path, source, wavelength = large_disc()
    monkeypatch.setattr(spot_image, "_LEFT_OUT", 0.0)
    found = image(path, source, wavelength, 0.2, 0.7)
    assert "dark part of the source" not in found.error_terms
    monkeypatch.setattr(spot_image, "lit_disc", lambda _path, whole, **_: whole)
    assert np.array_equal(found.pixels, image(path, source, wavelength, 0.2, 0.7).pixels)


def test_points_that_light_nothing_add_no_light(monkeypatch: pytest.MonkeyPatch) -> None:
    """A disc of twice the diameter has a quarter of its light on what the nine microlenses see."""
    monkeypatch.setattr(spot_image, "lit_disc", lambda _path, whole, **_: whole)
    pitch, width = 26e-6, 24e-6
    centres = square_centres(pitch=pitch, count=3)
    microlenses = Microlenses(
        centres=centres, focal_lengths=np.full(9, 76e-6), aperture="circular", aperture_width=width, pitch=pitch,
        layout="square", gaps="opaque", lens_phase="parabolic",
    )  # fmt: skip
    path = LightPath(
        main_lens=CircularLens(radius=0.2e-3, focal_length=2e-3, lens_phase="parabolic"),
        microlenses=microlenses,
        array_distance=2.5e-3,
        detector_distance=0.1e-3,
        pixels=PixelGrid(pitch=4e-6, shape=(21, 21)),
    )
    light = []
    for diameter in (1.5e-3, 3e-3):
        source = DiscSource(diameter=diameter, distance=20e-3)
        light.append(diameter**2 * float(image(path, source, 550e-9, 0.1, 0.7).pixels.sum()))
    assert light[1] == pytest.approx(light[0], rel=0.02)


def test_the_lit_part_grows_with_what_matters() -> None:
    path, source, wavelength = large_disc()

    def width(wavelength: float = wavelength, tolerance: float = 0.1) -> float:
        return lit_disc(path, source, wavelength=wavelength, tolerance=tolerance).diameter

    assert width() < width(tolerance=0.05) < source.diameter
    assert width() < width(wavelength=1.2 * wavelength)


def test_a_disc_that_the_microlenses_see_stays_whole() -> None:
    path, source, wavelength = large_disc()
    small = replace(source, diameter=lit_disc(path, source, wavelength=wavelength, tolerance=0.1).diameter)
    assert lit_disc(path, small, wavelength=wavelength, tolerance=0.1) is small
