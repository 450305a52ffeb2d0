"""Energies are fractions of the power through the pupil: it is as accurate as the stated error of the intensity."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import j1

from tradestudy import optics
from tradestudy.errors import TradestudyError
from tradestudy.optics import CircularLens, PointSource, point_spread
from tradestudy.optics.propagation.lens import LensWave

RADIUS, FOCAL_LENGTH, WAVELENGTH, FAR = 3.125e-3, 50e-3, 550e-9, 1e15


@pytest.mark.parametrize(("periods", "tolerance"), [(20, 1e-3), (30, 1e-6), (60, 1e-6), (60, 1e-3)])
def test_the_power_of_a_grating_in_the_pupil(periods: float, tolerance: float) -> None:
    """The mean of cos²(m x/R) over the disc is 1/2 + J₁(2m)/(2m)."""
    field = optics.aperture_field(
        source=optics.PointSource(distance=FAR),
        lens=optics.CircularLens(
            radius=RADIUS,
            focal_length=FOCAL_LENGTH,
            lens_phase="perfect",
            pupil=optics.Pupil(amplitude=lambda x, _y: np.cos(periods * x)),
        ),
        targets=optics.TargetGrid.centred(centre=(0.0, 0.0), pitch=0.5e-6, count=65, distance=FOCAL_LENGTH),
        wavelength=WAVELENGTH,
        method="fresnel",
        accuracy=optics.FieldAccuracy(tolerance=tolerance),
    )
    mean = 0.5 + j1(2 * periods) / (2 * periods)
    exact = mean * np.pi * RADIUS**2 / (WAVELENGTH * FAR) ** 2
    assert abs(field.pupil_power / exact - 1) <= field.error.intensity


@pytest.mark.parametrize("f_number", [0.06, 0.1, 0.5, 4.0])
def test_power_of_a_very_wide_pupil(f_number: float) -> None:
    """The paper's amplitude a/(λ r²) of a point on the axis: ∬ = π R²/(λ² (a² + R²)) for the power."""
    a, wavelength = 2e-3, 550e-9
    radius = a / f_number / 2
    lens = CircularLens(radius=radius, focal_length=1e-3, lens_phase="perfect")
    wave = LensWave(source=PointSource(distance=a), lens=lens, wavelength=wavelength, paraxial=False, obliquity="paper")
    assert wave.power() == pytest.approx(np.pi * radius**2 / (wavelength**2 * (a**2 + radius**2)), rel=1e-12)


@pytest.mark.parametrize("f_number", [0.08, 0.1, 1.0])
def test_a_very_wide_clear_lens_has_a_strehl_ratio_of_one(f_number: float) -> None:
    found = point_spread(focal_length=1e-3, f_number=f_number, wavelength=550e-9).strehl_ratio()
    assert abs(found.value - 1.0) <= found.error < 1e-4


@pytest.mark.parametrize("width", [3e-3, 3e-4, 1e-5])
def test_an_opening_that_all_nodes_miss_is_refused(width: float) -> None:
    opening = optics.Pupil(amplitude=lambda x, y: np.exp(-((x - 0.3333) ** 2 + (y - 0.1234) ** 2) / (2 * width**2)))
    with pytest.raises(TradestudyError, match=r"does not reach its tolerance|passes light|nodes"):
        point_spread(
            focal_length=50e-3, f_number=8, wavelength=550e-9, pupil=opening, tolerance=1e-3,
            limits=optics.Limits(nodes=100_000),
        )  # fmt: skip
