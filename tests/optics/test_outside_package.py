"""One case that another program can do too: the Fresnel pattern of a lens, defocused, from a source off the axis."""

from __future__ import annotations

import numpy as np
import pytest
from prysm import propagation

from tradestudy.optics.propagation.aperture import aperture_field
from tradestudy.optics.propagation.lens import CircularLens, PointSource
from tradestudy.optics.propagation.targets import TargetGrid
from tradestudy.optics.propagation.wave_optics import FieldAccuracy

WAVELENGTH, PITCH, COUNT = 550e-9, 0.5e-6, 96
SOURCE = PointSource(x=0.03e-3, y=-0.05e-3, distance=0.15)
LENS = CircularLens(radius=12.5e-3 / 7.6, focal_length=12.5e-3, lens_phase="parabolic")


def prysm_intensity(samples: int, distance: float) -> np.ndarray:
    """Matrix Fourier transform of the pupil: its optical path difference carries tilt and defocus."""
    step = 2 * LENS.radius / samples
    u, v = np.meshgrid(*[step * (np.arange(samples) - samples // 2)] * 2)
    power = 1 / SOURCE.distance - 1 / LENS.focal_length + 1 / distance
    path = (u**2 + v**2) / 2 * power - (u * SOURCE.x + v * SOURCE.y) / SOURCE.distance
    wave = propagation.Wavefront.from_amp_and_phase(
        (np.hypot(u, v) <= LENS.radius).astype(float), path * 1e9, WAVELENGTH * 1e6, step * 1e3
    )
    return np.abs(wave.focus_fixed_sampling(distance * 1e3, PITCH * 1e6, COUNT).data) ** 2


@pytest.mark.parametrize("defocus", [0.0, 40e-6])
def test_fresnel_pattern_is_prysms_as_its_pupil_samples_grow(defocus: float) -> None:
    """No pixel is shifted or mirrored, and what differs is prysm's staircase rim, which shrinks with its samples."""
    distance = LENS.image_of(SOURCE)[2] + defocus
    corner = -COUNT // 2 * PITCH
    targets = TargetGrid(
        x_start=corner,
        y_start=corner,
        x_pitch=PITCH,
        y_pitch=PITCH,
        x_count=COUNT,
        y_count=COUNT,
        distance=distance,
    )
    ours = aperture_field(
        source=SOURCE,
        lens=LENS,
        targets=targets,
        wavelength=WAVELENGTH,
        method="fresnel",
        accuracy=FieldAccuracy(tolerance=1e-6),
    ).intensity
    differences = []
    for samples in (128, 512):
        theirs = prysm_intensity(samples, distance)
        scale = np.sum(theirs * ours) / np.sum(theirs**2)  # its unit of intensity is another
        differences.append(float(np.linalg.norm(scale * theirs - ours) / np.linalg.norm(ours)))
    assert differences[1] < 6e-4
    assert differences[1] < differences[0] / 4
    assert np.linalg.norm(scale * theirs[::-1] - ours) > 0.3 * np.linalg.norm(ours)
