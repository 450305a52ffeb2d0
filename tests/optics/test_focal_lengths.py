"""Focal length over field and wavelength: a thin lens of BK7, whose dispersion and Petzval surface are published."""

from __future__ import annotations

import numpy as np
import pytest

from tradestudy import optics
from tradestudy.errors import OutOfRangeError

FOCAL_LENGTH, F_NUMBER, GREEN = 50e-3, 11.0, 587.5618e-9
ANGLES = np.linspace(0.0, 0.2, 21)
WAVELENGTHS = np.linspace(450e-9, 700e-9, 51)
# Schott's data sheet of N-BK7 517642.
SELLMEIER = ((1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653))


def index(wavelength: float | np.ndarray) -> np.ndarray:
    squared = (np.asarray(wavelength) * 1e6) ** 2
    return np.sqrt(1 + sum(b * squared / (squared - c) for b, c in SELLMEIER))


def colour(wavelength: float | np.ndarray) -> np.ndarray:
    return FOCAL_LENGTH * (index(GREEN) - 1) / (index(wavelength) - 1)


def curved(angle: float | np.ndarray) -> np.ndarray:
    """Sag of Petzval's surface of a thin lens, of radius n f, at the height of the image."""
    return FOCAL_LENGTH - (FOCAL_LENGTH * np.tan(angle)) ** 2 / (2 * index(GREEN) * FOCAL_LENGTH)


def table(**changes: object) -> optics.FocalLengths:
    both = curved(ANGLES)[:, None] * colour(WAVELENGTHS)[None, :] / FOCAL_LENGTH
    settings = {
        "field_angles": ANGLES,
        "wavelengths": WAVELENGTHS,
        "focal_lengths": both,
        "reference_wavelength": GREEN,
    }
    return optics.FocalLengths(**(settings | changes))


def test_the_data_are_the_published_ones() -> None:
    assert float(index(GREEN)) == pytest.approx(1.51680, abs=5e-6)
    assert float((index(GREEN) - 1) / (index(486.1327e-9) - index(656.2725e-9))) == pytest.approx(64.17, abs=0.005)


@pytest.mark.parametrize(("angle", "wavelength"), [(0.0, 486.1e-9), (0.0, 656.3e-9), (0.1, GREEN), (0.15, 500e-9)])
def test_the_image_is_as_far_out_of_focus_as_the_data_say(angle: float, wavelength: float) -> None:
    """W waves of defocus leave sinc² W at the chief ray; the plane stays where green is sharp on the axis."""
    lens = table()
    psf = optics.point_spread(
        focal_length=lens,
        f_number=F_NUMBER,
        wavelength=wavelength,
        source=optics.PointSource.at_infinity(angle_x=angle),
        method="fresnel",
        window=12,
    )
    focal_length = curved(angle) * colour(wavelength) / FOCAL_LENGTH
    radius = lens.reference / F_NUMBER / 2
    waves = radius**2 / 2 * (1 / focal_length - 1 / lens.reference) / wavelength
    assert abs(waves) > 0.2
    found = float(psf.at(*psf.centre)) / psf.reference_peak
    assert psf.centre[0] == pytest.approx(-lens.reference * np.tan(angle))
    assert found == pytest.approx(float(np.sinc(waves) ** 2), abs=2e-3)  # the table's steps, by linear interpolation


def test_in_the_reference_light_on_the_axis_it_is_in_focus() -> None:
    psf = optics.point_spread(focal_length=table(), f_number=F_NUMBER, wavelength=GREEN, method="fresnel", window=4)
    assert abs(psf.strehl_ratio().value - 1) <= psf.strehl_ratio().error + 1e-9


def test_what_lies_beyond_the_table_is_refused() -> None:
    with pytest.raises(OutOfRangeError, match="extend the table"):
        table().at(field_angle=0.3, wavelength=GREEN)
    with pytest.raises(OutOfRangeError, match="extend the table"):
        table(reference_wavelength=800e-9)
    with pytest.raises(OutOfRangeError, match="increasing"):
        table(wavelengths=WAVELENGTHS[::-1])
    with pytest.raises(OutOfRangeError, match=r"\(n, m\)"):
        table(focal_lengths=np.ones((3, 3)))
