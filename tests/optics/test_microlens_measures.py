"""Sums per microlens, MTF and plot of images behind microlenses, against sums and Fourier transforms by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.optics.small_chain import WAVELENGTH, camera
from tradestudy import optics
from tradestudy.errors import OutOfRangeError

PATH = camera(pixels=optics.PixelGrid(pitch=4e-6, shape=(9, 23), centre=(2e-6, -1e-6)))
POINT = optics.PointSource(x=0.05e-3, distance=20e-3)
ACCURACY = optics.ChainAccuracy(tolerance=1e-2)


def imaged(path: optics.LightPath = PATH) -> optics.ChainImage:
    return optics.chain_image(
        path, POINT, wavelength=WAVELENGTH, legs=optics.FRESNEL, accuracy=ACCURACY, rng=np.random.default_rng(1)
    )


IMAGE = imaged()


def owners() -> np.ndarray:
    """The nearest of the projected centres (they grow by 1 + b_L/z) to each pixel, among all of them."""
    rows, columns = np.indices(IMAGE.pixels.shape)
    x, y = 2e-6 + 4e-6 * (columns - 11.0), -1e-6 + 4e-6 * (rows - 4.0)
    centres = (1.0 + 0.1e-3 / 2.5e-3) * PATH.microlenses.centres
    return np.argmin([np.hypot(x - a, y - b) for a, b in centres], axis=0)


def test_light_per_microlens_is_that_of_its_pixels() -> None:
    light = IMAGE.light_per_microlens
    for index in range(3):
        assert light[index] == pytest.approx(IMAGE.pixels[owners() == index].sum(), rel=1e-12)
        assert light.error[index] == pytest.approx(np.sqrt((owners() == index).sum()) * IMAGE.pixel_error, rel=1e-12)
    assert np.sum(light) == pytest.approx(float(IMAGE.share_on_pixels), rel=1e-12)


@pytest.mark.parametrize("microlens", [None, 1])
def test_the_mtf_is_the_fourier_transform_of_the_pixels(microlens: int | None) -> None:
    light = IMAGE.pixels if microlens is None else np.where(owners() == microlens, IMAGE.pixels, 0.0)
    transform = np.abs(np.fft.fft2(light)) / light.sum()
    along_x, along_y = (np.fft.fftfreq(count, 4e-6) for count in (23, 9))
    np.testing.assert_allclose(IMAGE.modulation_transfer(along_x, microlens=microlens), transform[0], atol=1e-12)
    found = IMAGE.modulation_transfer(along_y, angle=np.pi / 2, microlens=microlens)
    np.testing.assert_allclose(found, transform[:, 0], atol=1e-9)
    assert IMAGE.modulation_transfer(0.0).value.shape == ()


def test_the_error_of_the_mtf_bounds_that_of_pixels_within_theirs() -> None:
    rng, frequency = np.random.default_rng(2), np.array([20e3, 70e3, 125e3])
    coarse = replace(IMAGE, numerical_error=0.05)
    stated = coarse.modulation_transfer(frequency, microlens=1)
    for _ in range(100):
        noise = rng.normal(size=IMAGE.pixels.shape) * (owners() == 1)
        moved = replace(coarse, pixels=IMAGE.pixels + coarse.pixel_error * noise / np.linalg.norm(noise))
        change = np.abs(np.asarray(moved.modulation_transfer(frequency, microlens=1)) - np.asarray(stated))
        assert np.all(change <= 1.05 * stated.error)


def test_every_way_to_an_image_knows_its_light_path() -> None:
    shared = {"legs": optics.FRESNEL, "accuracy": ACCURACY, "rng": np.random.default_rng(1)}
    spectral = optics.spectral_image(PATH, POINT, wavelengths=[5e-7, 6e-7], weights=[1.0, 1.0], **shared)
    separate = optics.separate_image(PATH, POINT, wavelength=WAVELENGTH, **shared)
    data = optics.MicrolensCamera(
        focal_length=2e-3, f_number=8.0, array_distance=2.5e-3, microlens_focal_lengths=76e-6, microlens_pitch=26e-6,
        gap=0.1e-3, pixel_pitch=4e-6,
    )  # fmt: skip
    whole = optics.microlens_image(data, POINT, wavelength=WAVELENGTH, tolerance=1e-2)
    for image in (spectral, separate, whole):
        assert np.sum(image.light_per_microlens) == pytest.approx(image.pixels.sum())


def test_the_plot_goes_into_given_axes_and_into_a_file(tmp_path: Path) -> None:
    figure = Figure()
    ax = figure.subplots()
    assert IMAGE.plot(str(tmp_path / "image.svg"), ax=ax) is figure
    assert (ax.get_xlabel(), ax.get_ylabel(), len(ax.patches)) == ("x, µm", "y, µm", 3)
    np.testing.assert_allclose(ax.images[0].get_array(), 100.0 * IMAGE.pixels)
    assert ax.images[0].get_extent() == pytest.approx((-44.0, 48.0, -19.0, 17.0))
    assert (tmp_path / "image.svg").exists()
    assert IMAGE.plot() is not figure


def test_a_spot_is_drawn_alone_or_in_four_axes() -> None:
    psf = optics.point_spread(focal_length=50e-3, f_number=8.0, wavelength=550e-9, window=4.0)
    figure = Figure()
    left, right = figure.subfigures(1, 2)
    assert psf.plot(ax=left.subplots()) is figure
    assert [len(axes.images) for axes in figure.axes] == [1]
    four = right.subplots(2, 2)
    psf.plot(ax=four)
    assert [bool(axes.lines) for axes in four.ravel()] == [False, True, True, True]
    with pytest.raises(OutOfRangeError, match="axes of the plot: 3"):
        psf.plot(ax=four.ravel()[:3])
    with pytest.raises(OutOfRangeError, match="axes of the plot: 1 of type str"):
        IMAGE.plot(ax="left")  # type: ignore[arg-type]  # wrong on purpose


def test_what_is_not_there_is_refused() -> None:
    with pytest.raises(OutOfRangeError, match="light path of the image"):
        _ = replace(IMAGE, path=None).light_per_microlens
    with pytest.raises(OutOfRangeError, match="light path of the image"):
        replace(IMAGE, pixels=IMAGE.pixels[1:]).plot()
    with pytest.raises(OutOfRangeError, match="spatial frequency: 130000 1/m"):
        IMAGE.modulation_transfer([0.0, 130e3])
    with pytest.raises(OutOfRangeError, match="behind microlens 3"):
        IMAGE.modulation_transfer(50e3, microlens=3)
