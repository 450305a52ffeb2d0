"""Energies are fractions of the power through the pupil: it is as accurate as the stated error of the intensity."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import j1

from tradestudy import optics

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
