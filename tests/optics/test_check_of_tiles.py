"""Targets split into parts whose errors differ by orders of magnitude: the stated error still covers the true one."""

from __future__ import annotations

import numpy as np
import pytest

from tradestudy import optics
from tradestudy.optics.propagation.aperture import lens_wave
from tradestudy.optics.propagation.kernels import direct_sum
from tradestudy.optics.propagation.sampling import NodeCounts
from tradestudy.optics.propagation.wave_optics import sample_wave

WAVELENGTH = 1e-6
STAR = optics.PointSource.at_infinity()


@pytest.mark.parametrize(("waves", "tolerance"), [(4.18, 3.6e-5), (4.18, 1e-5), (4.0, 3.6e-5)])
def test_few_targets_of_a_part_with_larger_errors_are_checked(waves: float, tolerance: float) -> None:
    """Fifteen parts are summed directly, to 1e-13; the sixteenth, a twentieth of the targets, only to the tolerance."""
    radius = waves * WAVELENGTH / 2
    lens = optics.CircularLens(
        radius=radius,
        focal_length=1.286 * radius,
        lens_phase="parabolic",
        pupil=optics.Pupil.from_waves({7: 0.184, 11: 0.0119}, wavelength=WAVELENGTH, obscuration=0.29),
    )
    targets = optics.TargetGrid.centred(
        centre=(0.13 * radius, 0.0), pitch=3 * radius / 32, count=33, distance=1.453 * radius
    )
    field = optics.aperture_field(
        source=STAR,
        lens=lens,
        targets=targets,
        wavelength=WAVELENGTH,
        method="kirchhoff",
        accuracy=optics.FieldAccuracy(tolerance=tolerance),
    )
    wave = lens_wave(source=STAR, lens=lens, wavelength=WAVELENGTH)
    counts = NodeCounts(radial=2 * field.effort.radial_nodes, angular=2 * field.effort.angular_nodes)
    kernel = optics.KirchhoffKernel(wavelength=WAVELENGTH, obliquity="paper")
    exact = np.abs(direct_sum(sample_wave(wave, counts), kernel, *targets.coordinates())) ** 2
    error = np.linalg.norm(field.intensity.ravel() - exact) / np.linalg.norm(exact)
    assert field.effort.tiles > 1
    assert error <= field.error.intensity <= tolerance
